//! What networks do to each number by itself. Loops without branches, which the compiler turns into vector instructions; no operation
//! in them is fused, so that every processor gives the same bits.

/// Compiles a loop for the widest registers that are there.
macro_rules! vectorised {
    ($(#[$doc:meta])* $visible:vis $name:ident, $avx512:ident, $avx2:ident, $body:ident, ($($arg:ident: $type:ty),*)) => {
        $(#[$doc])*
        $visible fn $name($($arg: $type),*) {
            #[cfg(target_arch = "x86_64")]
            {
                // The features that the calls need were found.
                if is_x86_feature_detected!("avx512f") {
                    return unsafe { $avx512($($arg),*) };
                }
                if is_x86_feature_detected!("avx2") {
                    return unsafe { $avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f")]
        fn $avx512($($arg: $type),*) {
            $body($($arg),*)
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2")]
        fn $avx2($($arg: $type),*) {
            $body($($arg),*)
        }
    };
}

vectorised!(
    /// The exponential linear unit in place: x above zero, exp(x) - 1 below (Clevert et al. 2015, alpha = 1).
    pub elu, elu_avx512, elu_avx2, elu_loop, (values: &mut [f32])
);
vectorised!(
    /// Takes a gradient back through [`elu`], given what it put out.
    pub elu_back, elu_back_avx512, elu_back_avx2, elu_back_loop, (gradient: &mut [f32], out: &[f32])
);
vectorised!(
    /// The logistic function in place.
    pub sigmoid, sigmoid_avx512, sigmoid_avx2, sigmoid_loop, (values: &mut [f32])
);
vectorised!(
    /// The hyperbolic tangent in place.
    pub tanh, tanh_avx512, tanh_avx2, tanh_loop, (values: &mut [f32])
);
vectorised!(
    /// One step of Adam, see [`crate::adam`].
    pub(crate) adam, adam_avx512, adam_avx2, adam_loop,
    (parameters: &mut [f32], first: &mut [f32], second: &mut [f32], gradient: &[f32], step: AdamStep)
);

/// exp(x) for x from -87 to 87, else that of the nearer end; 2 units in the last place (coefficients of Cephes' `expf`).
#[inline(always)]
fn exp(x: f32) -> f32 {
    /// Adding it rounds to an integer in the low bits.
    const ROUNDER: f32 = 12_582_912.0;
    let x = if x > -87.0 { x } else { -87.0 };
    let x = if x < 87.0 { x } else { 87.0 };
    let shifted = x * std::f32::consts::LOG2_E + ROUNDER;
    let whole = shifted - ROUNDER;
    let r = x - whole * 0.693_359_4;
    let r = r - whole * -2.121_944_4e-4;
    let mut p = 1.987_569_1e-4;
    p = p * r + 1.398_199_9e-3;
    p = p * r + 8.333_452e-3;
    p = p * r + 4.166_579_6e-2;
    p = p * r + 1.666_666_5e-1;
    p = p * r + 5.000_000_3e-1;
    let p = p * r * r + r + 1.0;
    let exponent = shifted.to_bits().wrapping_sub(ROUNDER.to_bits()).wrapping_add(127) << 23;
    p * f32::from_bits(exponent)
}

#[inline(always)]
fn elu_loop(values: &mut [f32]) {
    for value in values {
        let below = exp(if *value < 0.0 { *value } else { 0.0 }) - 1.0;
        // What is not a number stays so: it must be found, not hidden.
        *value = if *value <= 0.0 { below } else { *value };
    }
}

#[inline(always)]
fn elu_back_loop(gradient: &mut [f32], out: &[f32]) {
    for (gradient, &out) in gradient.iter_mut().zip(out) {
        *gradient *= if out > 0.0 { 1.0 } else { out + 1.0 };
    }
}

#[inline(always)]
fn sigmoid_loop(values: &mut [f32]) {
    for value in values {
        *value = 1.0 / (1.0 + exp(-*value));
    }
}

#[inline(always)]
fn tanh_loop(values: &mut [f32]) {
    for value in values {
        *value = 1.0 - 2.0 / (1.0 + exp(2.0 * *value));
    }
}

/// Numbers of a step of Adam: decay rates, learning rate and both corrections of the bias folded in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AdamStep {
    pub beta1: f32,
    pub beta2: f32,
    /// Learning rate over `1 - beta1^t`.
    pub rate: f32,
    /// One over `1 - beta2^t`.
    pub unbias: f32,
    pub epsilon: f32,
    /// Gradients are multiplied by this first.
    pub scale: f32,
}

#[inline(always)]
fn adam_loop(parameters: &mut [f32], first: &mut [f32], second: &mut [f32], gradient: &[f32], step: AdamStep) {
    for (((parameter, first), second), &gradient) in parameters.iter_mut().zip(first).zip(second).zip(gradient) {
        let gradient = gradient * step.scale;
        *first = step.beta1 * *first + (1.0 - step.beta1) * gradient;
        *second = step.beta2 * *second + (1.0 - step.beta2) * (gradient * gradient);
        *parameter -= step.rate * *first / ((*second * step.unbias).sqrt() + step.epsilon);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_those_of_the_library() {
        let numbers: Vec<f32> = (-2000..2000).map(|i| i as f32 * 0.01).collect();
        let check = |f: fn(&mut [f32]), plain: fn(&mut [f32]), exact: fn(f64) -> f64, what: &str| {
            let (mut found, mut slow) = (numbers.clone(), numbers.clone());
            f(&mut found);
            plain(&mut slow);
            assert_eq!(found, slow, "{what}: with and without vector registers");
            for (x, y) in numbers.iter().zip(found) {
                let exact = exact(f64::from(*x));
                assert!((f64::from(y) - exact).abs() < 3e-7 * exact.abs().max(0.5), "{what}({x}) = {y} for {exact}");
            }
        };
        check(elu, elu_loop, |x| if x > 0.0 { x } else { x.exp_m1() }, "elu");
        check(sigmoid, sigmoid_loop, |x| 1.0 / (1.0 + (-x).exp()), "sigmoid");
        check(tanh, tanh_loop, f64::tanh, "tanh");
    }

    #[test]
    fn far_numbers_stay_finite() {
        let mut values = [-1e30, -200.0, 200.0, 1e30, f32::MIN_POSITIVE];
        elu(&mut values);
        assert_eq!(values[..2], [-1.0, -1.0]);
        assert!(values.iter().all(|x| x.is_finite()));
        let mut values = [f32::NAN, 1.0];
        elu(&mut values);
        assert!(values[0].is_nan());
        let mut values = [-1e30, 1e30];
        tanh(&mut values);
        assert_eq!(values, [-1.0, 1.0]);
    }
}
