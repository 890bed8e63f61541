//! A normal distribution for each action, independent, with a spread that does not depend on the state.

/// Half the logarithm of two pi.
const HALF_LOG_TAU: f32 = 0.918_938_5;

/// Log density of `action` under means and log standard deviations.
pub fn log_density(action: &[f32], mean: &[f32], log_std: &[f32]) -> f32 {
    let mut sum = 0.0;
    for ((&action, &mean), &log_std) in action.iter().zip(mean).zip(log_std) {
        let z = (action - mean) * (-log_std).exp();
        sum -= 0.5 * z * z + log_std + HALF_LOG_TAU;
    }
    sum
}

/// Entropy in nats.
pub fn entropy(log_std: &[f32]) -> f32 {
    log_std.iter().map(|s| s + 0.5 + HALF_LOG_TAU).sum()
}

/// Kullback-Leibler divergence of the new distribution from the old one.
pub fn divergence(old_mean: &[f32], old_log_std: &[f32], mean: &[f32], log_std: &[f32]) -> f32 {
    let mut sum = 0.0;
    for k in 0..log_std.len() {
        let shift = old_mean[k] - mean[k];
        let old_variance = (2.0 * old_log_std[k]).exp();
        sum += log_std[k] - old_log_std[k] + 0.5 * (old_variance + shift * shift) * (-2.0 * log_std[k]).exp() - 0.5;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert!((log_density(&[0.0], &[0.0], &[0.0]) + 0.918_938_5).abs() < 1e-6);
        let two = log_density(&[1.0, -1.0], &[0.0, 0.0], &[2f32.ln(), 0.0]);
        assert!((two - (-0.125 - 2f32.ln() - 0.5 - 2.0 * 0.918_938_5)).abs() < 1e-6);
        assert!((entropy(&[0.0]) - 1.418_938_5).abs() < 1e-6);
        assert!(divergence(&[1.0, 2.0], &[0.3, -0.1], &[1.0, 2.0], &[0.3, -0.1]).abs() < 1e-6);
        // N(1, 1) from N(0, 1): half the squared shift.
        assert!((divergence(&[0.0], &[0.0], &[1.0], &[0.0]) - 0.5).abs() < 1e-6);
    }
}
