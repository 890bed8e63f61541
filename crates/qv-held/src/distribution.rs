//! Tails of Student's and Fisher's distributions, by the regularised incomplete beta function (Press et al., Numerical Recipes, 3rd edition,
//! section 6.4: Lentz's continued fraction; logarithm of the gamma function by Lanczos' sum, section 6.1).

/// Terms of the continued fraction at most.
const TERMS: usize = 300;
const LANCZOS: [f64; 6] = [
    76.180_091_729_471_46,
    -86.505_320_329_416_77,
    24.014_098_240_830_91,
    -1.231_739_572_450_155,
    1.208_650_973_866_179e-3,
    -5.395_239_384_953e-6,
];

/// Logarithm of the gamma function, to 2e-10 of the function.
fn ln_gamma(x: f64) -> f64 {
    let shifted = x + 5.5;
    let sum: f64 = LANCZOS.iter().enumerate().map(|(k, c)| c / (x + 1.0 + k as f64)).sum();
    (2.506_628_274_631_000_5 * (1.000_000_000_190_015 + sum) / x).ln() - shifted + (x + 0.5) * shifted.ln()
}

/// Regularised incomplete beta function `I_x(a, b)`.
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (1.0 - x).ln()).exp();
    if x < (a + 1.0) / (a + b + 2.0) {
        front * fraction(a, b, x) / a
    } else {
        1.0 - front * fraction(b, a, 1.0 - x) / b
    }
}

fn fraction(a: f64, b: f64, x: f64) -> f64 {
    let guard = |value: f64| if value.abs() < 1e-300 { 1e-300 } else { value };
    let (mut c, mut d) = (1.0, 1.0 / guard(1.0 - (a + b) * x / (a + 1.0)));
    let mut value = d;
    for m in 1..=TERMS {
        let m = m as f64;
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / guard(1.0 + even * d);
        c = guard(1.0 + even / c);
        value *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / guard(1.0 + odd * d);
        c = guard(1.0 + odd / c);
        value *= d * c;
        if (d * c - 1.0).abs() < 1e-14 {
            break;
        }
    }
    value
}

/// Probability that a value of Fisher's distribution with `k` and `n` degrees of freedom exceeds `f`; 1 where `f` is no number.
pub(crate) fn fisher_tail(f: f64, k: f64, n: f64) -> f64 {
    if f.is_nan() || f <= 0.0 || n <= 0.0 {
        return 1.0;
    }
    incomplete_beta(0.5 * n, 0.5 * k, n / (n + k * f))
}

/// Probability that a value of Student's distribution with `n` degrees of freedom exceeds `t`; 1 where `t` is no number.
pub(crate) fn student_tail(t: f64, n: f64) -> f64 {
    if t.is_nan() || n <= 0.0 {
        return 1.0;
    }
    let outside = 0.5 * fisher_tail(t * t, 1.0, n);
    if t >= 0.0 { outside } else { 1.0 - outside }
}

/// Value that a value of Student's distribution exceeds with probability `tail`, below one half; by bisection.
pub(crate) fn student_quantile(tail: f64, n: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1e9);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if student_tail(middle, n) > tail { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_tables() {
        // Quantiles of the usual tables.
        for (tail, n, value) in
            [(0.025, 1.0, 12.706_2), (0.025, 10.0, 2.228_14), (0.05, 30.0, 1.697_26), (0.005, 5.0, 4.032_14)]
        {
            assert!((student_quantile(tail, n) - value).abs() < 1e-4, "{tail} {n}");
        }
        for (f, k, n) in [(18.512_8, 1.0, 2.0), (4.102_82, 2.0, 10.0), (2.710_89, 5.0, 20.0), (161.447_6, 1.0, 1.0)] {
            assert!((fisher_tail(f, k, n) - 0.05).abs() < 1e-5, "{f}: {}", fisher_tail(f, k, n));
        }
        assert!((student_tail(-1.0, 3.0) + student_tail(1.0, 3.0) - 1.0).abs() < 1e-12);
        assert_eq!([fisher_tail(f64::NAN, 1.0, 3.0), student_tail(f64::NAN, 3.0)], [1.0, 1.0]);
    }
}
