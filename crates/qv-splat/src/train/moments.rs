//! Steps of one number by its moments, and the logistic function.

/// Decay of the running mean of derivatives.
pub const BETA1: f32 = 0.9;

/// Decay of the running mean of squares.
pub const BETA2: f32 = 0.999;

/// Keeps the quotient from 0 / 0.
pub const EPSILON: f32 = 1e-15;

/// What the running means are divided by after so many steps, the first being 1.
pub fn bias(steps: u32) -> [f32; 2] {
    let one = |beta: f32| (1.0 - (beta as f64).powi(steps.min(i32::MAX as u32) as i32)) as f32;
    [one(BETA1), one(BETA2)]
}

/// Moves one parameter.
pub fn moved(value: &mut f32, first: &mut f32, second: &mut f32, by: f32, rate: f32, bias: [f32; 2]) {
    *first = BETA1 * *first + (1.0 - BETA1) * by;
    *second = BETA2 * *second + (1.0 - BETA2) * by * by;
    *value -= rate * (*first / bias[0]) / ((*second / bias[1]).sqrt() + EPSILON);
}

/// 1 / (1 + exp(-x)).
pub fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}
