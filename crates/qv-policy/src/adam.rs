//! Adam (Kingma and Ba 2014, algorithm 1) with the gradient's length limited.

use crate::net::{AdamStep, adam};

/// The optimiser's memory of one flat array of parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    /// Running mean of the gradient.
    pub first: Vec<f32>,
    /// Running mean of its square.
    pub second: Vec<f32>,
    /// Steps taken.
    pub steps: u64,
}

/// Decay rates of the two means, and the number that keeps the division finite: the paper's.
const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

impl Adam {
    /// For `count` parameters.
    pub fn new(count: usize) -> Self {
        Self { first: vec![0.0; count], second: vec![0.0; count], steps: 0 }
    }

    /// One step against the gradient, shortened to `longest` first. Returns the gradient's length before.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], rate: f32, longest: f32) -> f32 {
        let length = length(gradient);
        self.steps += 1;
        let steps = i32::try_from(self.steps.min(1 << 30)).unwrap_or(i32::MAX);
        let step = AdamStep {
            beta1: BETA1,
            beta2: BETA2,
            rate: rate / (1.0 - BETA1.powi(steps)),
            unbias: 1.0 / (1.0 - BETA2.powi(steps)),
            epsilon: EPSILON,
            scale: if length > longest { longest / length } else { 1.0 },
        };
        adam(parameters, &mut self.first, &mut self.second, gradient, step);
        length
    }
}

/// Length of a vector, summed in double precision.
pub fn length(vector: &[f32]) -> f32 {
    vector.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_rate_along_each_sign() {
        let (mut x, mut adam) = (vec![1.0, 2.0, 3.0], Adam::new(3));
        let length = adam.step(&mut x, &[0.3, -0.4, 0.0], 0.01, 1.0);
        assert!((length - 0.5).abs() < 1e-6);
        assert!((x[0] - 0.99).abs() < 1e-6 && (x[1] - 2.01).abs() < 1e-6 && x[2] == 3.0, "{x:?}");
    }

    #[test]
    fn it_finds_the_bottom_of_a_bowl() {
        let (mut x, mut adam) = (vec![3.0f32, -2.0], Adam::new(2));
        for _ in 0..2000 {
            let gradient = [20.0 * (x[0] - 1.0), 0.2 * (x[1] - 0.5)];
            adam.step(&mut x, &gradient, 0.01, 1.0);
        }
        assert!((x[0] - 1.0).abs() < 1e-2 && (x[1] - 0.5).abs() < 1e-2, "{x:?}");
    }
}
