//! Evolution strategy with covariance matrix adaptation: Hansen, The CMA Evolution Strategy: A Tutorial (2016,
//! arXiv:1604.00772), figure 6 (eqs. 38 to 47) with the weights and constants of table 1; negative weights are left at 0.

use qv_core::random::SplitMix64;
use qv_fit::Matrix;
use qv_fit::linear::{add_outer, add_scaled, eigen, squared, times, transposed_times};

/// Constants of a dimension (table 1).
struct Constants {
    /// Weights of the better half, best first; they sum to 1 (eqs. 49 and 53).
    weights: Vec<f64>,
    /// `mu_eff`.
    effective: f64,
    /// `c_sigma` and `d_sigma` (eq. 55).
    path_rate: f64,
    damping: f64,
    /// `c_c` (eq. 56).
    covariance_path_rate: f64,
    /// `c_1` (eq. 57).
    rank_one: f64,
    /// `c_mu` (eq. 58).
    rank_mu: f64,
    /// `E |N(0, I)|`.
    expected_norm: f64,
}

impl Constants {
    fn new(dimension: usize) -> Self {
        let n = dimension as f64;
        let offspring = 4 + (3.0 * n.ln()).floor() as usize;
        let raw: Vec<f64> = (1..=offspring / 2).map(|i| ((offspring as f64 + 1.0) / 2.0 / i as f64).ln()).collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|w| w / sum).collect();
        let effective = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let path_rate = (effective + 2.0) / (n + effective + 5.0);
        let damping = 1.0 + 2.0 * (((effective - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + path_rate;
        let covariance_path_rate = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n);
        let rank_one = 2.0 / ((n + 1.3).powi(2) + effective);
        let rank_mu =
            (2.0 * (0.25 + effective + 1.0 / effective - 2.0) / ((n + 2.0).powi(2) + effective)).min(1.0 - rank_one);
        let expected_norm = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));
        Self { weights, effective, path_rate, damping, covariance_path_rate, rank_one, rank_mu, expected_norm }
    }
}

/// `share a + other b`.
fn mixed(share: f64, a: &[f64], other: f64, b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| share * a + other * b).collect()
}

/// A search for the least value of a function of `n` numbers, which the caller evaluates.
pub struct CmaEs {
    constants: Constants,
    /// Mean of the next generation, shape `[n]`.
    mean: Vec<f64>,
    /// Overall step.
    sigma: f64,
    covariance: Matrix,
    path: Vec<f64>,
    covariance_path: Vec<f64>,
    /// Eigenvectors of the covariance, and roots of its eigenvalues.
    axes: Matrix,
    lengths: Vec<f64>,
    /// `y` of the present generation.
    steps: Vec<Vec<f64>>,
    generation: i32,
    random: SplitMix64,
}

impl CmaEs {
    /// Starts at `mean` with steps of `sigma` along each number.
    pub fn new(mean: &[f64], sigma: f64, seed: u64) -> Self {
        let n = mean.len();
        Self {
            constants: Constants::new(n),
            mean: mean.to_vec(),
            sigma,
            covariance: Matrix::identity(n, n),
            path: vec![0.0; n],
            covariance_path: vec![0.0; n],
            axes: Matrix::identity(n, n),
            lengths: vec![1.0; n],
            steps: Vec::new(),
            generation: 0,
            random: SplitMix64::of(seed, 4001),
        }
    }

    /// Points of a generation: `4 + floor(3 ln n)`.
    pub fn offspring(dimension: usize) -> usize {
        4 + (3.0 * (dimension as f64).ln()).floor() as usize
    }

    /// The next generation (eqs. 38 to 40), shape `[offspring][n]`.
    pub fn ask(&mut self) -> Vec<Vec<f64>> {
        let n = self.mean.len();
        self.steps = (0..Self::offspring(n))
            .map(|_| {
                let z: Vec<f64> = self.lengths.iter().map(|length| length * self.random.normal(1.0)).collect();
                times(&self.axes, &z)
            })
            .collect();
        self.steps.iter().map(|y| mixed(1.0, &self.mean, self.sigma, y)).collect()
    }

    /// Learns from the values of the generation last asked for (eqs. 41 to 47).
    pub fn tell(&mut self, values: &[f64]) {
        let c = &self.constants;
        let n = self.mean.len() as f64;
        let mut order: Vec<usize> = (0..values.len().min(self.steps.len())).collect();
        order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
        let best: Vec<&Vec<f64>> = order.iter().take(c.weights.len()).map(|&k| &self.steps[k]).collect();
        let mut step = vec![0.0; self.mean.len()];
        c.weights.iter().zip(&best).for_each(|(w, y)| add_scaled(&mut step, *w, y));
        add_scaled(&mut self.mean, self.sigma, &step);
        self.generation += 1;
        // C^-1/2 of the mean step.
        let mut white = transposed_times(&self.axes, &step);
        white.iter_mut().zip(&self.lengths).for_each(|(x, d)| *x /= d);
        let white = times(&self.axes, &white);
        let rate = c.path_rate;
        self.path = mixed(1.0 - rate, &self.path, (rate * (2.0 - rate) * c.effective).sqrt(), &white);
        let length = squared(&self.path).sqrt() / c.expected_norm;
        let settled = (1.0 - (1.0 - rate).powi(2 * self.generation)).sqrt();
        let goes_on = f64::from(u8::from(length / settled < 1.4 + 2.0 / (n + 1.0)));
        let slow = c.covariance_path_rate;
        let share = goes_on * (slow * (2.0 - slow) * c.effective).sqrt();
        self.covariance_path = mixed(1.0 - slow, &self.covariance_path, share, &step);
        let lost = (1.0 - goes_on) * slow * (2.0 - slow);
        self.covariance *= 1.0 + c.rank_one * lost - c.rank_one - c.rank_mu;
        add_outer(&mut self.covariance, c.rank_one, &self.covariance_path);
        c.weights.iter().zip(&best).for_each(|(w, y)| add_outer(&mut self.covariance, c.rank_mu * w, y));
        self.sigma *= (rate / c.damping * (length - 1.0)).exp();
        self.decompose();
    }

    fn decompose(&mut self) {
        // Where the numbers ran away the last axes stay.
        let Some((values, vectors)) = eigen(&self.covariance) else { return };
        self.lengths = values.iter().map(|v| v.max(1e-20).sqrt()).collect();
        self.axes = vectors;
    }

    /// The most likely point, shape `[n]`.
    #[cfg(test)]
    fn mean(&self) -> &[f64] {
        &self.mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turned by 45 degrees in each pair of neighbours, with axes from 1 to 1000; least at 0.3 in each number.
    fn ellipsoid(x: &[f64]) -> f64 {
        let n = x.len();
        let mut y: Vec<f64> = x.iter().map(|x| x - 0.3).collect();
        let half = 0.5_f64.sqrt();
        for i in 0..n - 1 {
            (y[i], y[i + 1]) = (half * (y[i] + y[i + 1]), half * (y[i] - y[i + 1]));
        }
        y.iter().enumerate().map(|(i, y)| 1e6_f64.powf(i as f64 / (n - 1) as f64) * y * y).sum()
    }

    fn minimise(seed: u64) -> CmaEs {
        let mut search = CmaEs::new(&[0.8; 8], 0.3, seed);
        for _ in 0..600 {
            let values: Vec<f64> = search.ask().iter().map(|x| ellipsoid(x)).collect();
            search.tell(&values);
        }
        search
    }

    #[test]
    fn a_turned_ellipsoid_is_minimised_and_again_alike() {
        let search = minimise(3);
        assert!(ellipsoid(search.mean()) < 1e-12, "{}", ellipsoid(search.mean()));
        assert!(search.mean().iter().all(|x| (x - 0.3).abs() < 1e-6), "{:?}", search.mean());
        assert_eq!(search.mean(), minimise(3).mean());
        assert_ne!(search.mean(), minimise(4).mean());
    }

    #[test]
    fn weights_sum_to_one_and_values_without_a_number_are_the_worst() {
        let constants = Constants::new(36);
        assert!((constants.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!((constants.weights.len(), CmaEs::offspring(36)), (7, 14));
        let mut search = CmaEs::new(&[0.5; 3], 0.1, 1);
        for _ in 0..60 {
            let value = |x: &Vec<f64>| if x[0] > 0.5 { f64::NAN } else { x.iter().map(|x| x * x).sum() };
            let values: Vec<f64> = search.ask().iter().map(value).collect();
            search.tell(&values);
        }
        assert!(search.mean().iter().all(|x| x.abs() < 1e-3), "{:?}", search.mean());
    }
}
