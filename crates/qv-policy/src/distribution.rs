//! A normal distribution for each action, independent, with a spread that does not depend on the state.

/// Half the logarithm of two pi.
const HALF_LOG_TAU: f32 = 0.918_938_5;

/// Spreads of all actions, and what densities need of them, found once.
#[derive(Debug, Clone, Default)]
pub struct Spread {
    /// Standard deviations.
    pub std: Vec<f32>,
    /// One over each.
    pub inverse: Vec<f32>,
    /// Log density at the mean.
    peak: f32,
    log: f32,
}

impl Spread {
    /// From log standard deviations.
    pub fn new(log_std: &[f32]) -> Self {
        let std: Vec<f32> = log_std.iter().map(|s| s.exp()).collect();
        let inverse = log_std.iter().map(|s| (-s).exp()).collect();
        let log = log_std.iter().sum::<f32>();
        Self { std, inverse, peak: -log - HALF_LOG_TAU * log_std.len() as f32, log }
    }

    /// Log density of `action` under means.
    pub fn log_density(&self, action: &[f32], mean: &[f32]) -> f32 {
        let mut sum = 0.0;
        for ((&action, &mean), &inverse) in action.iter().zip(mean).zip(&self.inverse) {
            let z = (action - mean) * inverse;
            sum += z * z;
        }
        self.peak - 0.5 * sum
    }

    /// Entropy in nats.
    pub fn entropy(&self) -> f32 {
        self.log + (0.5 + HALF_LOG_TAU) * self.std.len() as f32
    }

    /// Kullback-Leibler divergence of this distribution at `mean` from an older one at `old_mean`.
    pub fn divergence(&self, mean: &[f32], old: &Self, old_mean: &[f32]) -> f32 {
        let mut sum = 0.0;
        for k in 0..self.std.len() {
            let shift = (old_mean[k] - mean[k]) * self.inverse[k];
            let ratio = old.std[k] * self.inverse[k];
            sum += ratio * ratio + shift * shift - 1.0;
        }
        self.log - old.log + 0.5 * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert!((Spread::new(&[0.0]).log_density(&[0.0], &[0.0]) + 0.918_938_5).abs() < 1e-6);
        let two = Spread::new(&[2f32.ln(), 0.0]).log_density(&[1.0, -1.0], &[0.0, 0.0]);
        assert!((two - (-0.125 - 2f32.ln() - 0.5 - 2.0 * 0.918_938_5)).abs() < 1e-6);
        assert!((Spread::new(&[0.0]).entropy() - 1.418_938_5).abs() < 1e-6);
        let spread = Spread::new(&[0.3, -0.1]);
        assert!(spread.divergence(&[1.0, 2.0], &spread, &[1.0, 2.0]).abs() < 1e-6);
        // N(1, 1) from N(0, 1): half the squared shift; N(0, 2) from N(0, 1) by the formula.
        let one = Spread::new(&[0.0]);
        assert!((one.divergence(&[1.0], &one, &[0.0]) - 0.5).abs() < 1e-6);
        let wide = Spread::new(&[2f32.ln()]).divergence(&[0.0], &one, &[0.0]);
        assert!((wide - (2f32.ln() + 0.125 - 0.5)).abs() < 1e-6);
    }
}
