//! A network of one hidden layer of tanh and one output, and the steps that train it: Adam, Kingma and Ba (ICLR 2015),
//! algorithm 1 with its default rates of decay.

use qv_core::random::SplitMix64;

/// Width of the hidden layer.
pub const HIDDEN: usize = 32;

/// `y = v tanh(W x + b) + c`.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    inputs: usize,
    /// `W`, row by row, then `b`, `v`, `c`.
    pub weights: Vec<f64>,
}

impl Network {
    /// Random weights of a size that keeps the layer's sums near 1; the output is 0 at first.
    pub fn new(inputs: usize, seed: u64) -> Self {
        let mut random = SplitMix64::of(seed, 4002);
        let deviation = (inputs.max(1) as f64).sqrt().recip();
        let mut weights: Vec<f64> = (0..HIDDEN * inputs).map(|_| random.normal(deviation)).collect();
        weights.resize(HIDDEN * (inputs + 2) + 1, 0.0);
        Self { inputs, weights }
    }

    /// The output, and the hidden layer in `hidden`, shape `[HIDDEN]`.
    pub fn output(&self, x: &[f64], hidden: &mut [f64; HIDDEN]) -> f64 {
        let (matrix, rest) = self.weights.split_at(HIDDEN * self.inputs);
        let (bias, rest) = rest.split_at(HIDDEN);
        let mut y = rest[HIDDEN];
        for h in 0..HIDDEN {
            let row = &matrix[h * self.inputs..(h + 1) * self.inputs];
            let sum: f64 = row.iter().zip(x).map(|(w, x)| w * x).sum();
            hidden[h] = (sum + bias[h]).tanh();
            y += rest[h] * hidden[h];
        }
        y
    }

    /// Adds to `gradient` that of a loss whose slope along the output is `slope`, at an input and its hidden layer.
    pub fn add_gradient(&self, x: &[f64], hidden: &[f64; HIDDEN], slope: f64, gradient: &mut [f64]) {
        let (n, bias, outer) = (self.inputs, HIDDEN * self.inputs, HIDDEN * (self.inputs + 1));
        for h in 0..HIDDEN {
            gradient[outer + h] += slope * hidden[h];
            let inner = slope * self.weights[outer + h] * (1.0 - hidden[h] * hidden[h]);
            gradient[bias + h] += inner;
            gradient[h * n..(h + 1) * n].iter_mut().zip(x).for_each(|(g, x)| *g += inner * x);
        }
        gradient[outer + HIDDEN] += slope;
    }
}

/// Moments of the gradients so far.
pub struct Adam {
    rate: f64,
    first: Vec<f64>,
    second: Vec<f64>,
    steps: i32,
}

impl Adam {
    /// For so many weights, with steps of about `rate`.
    pub fn new(weights: usize, rate: f64) -> Self {
        Self { rate, first: vec![0.0; weights], second: vec![0.0; weights], steps: 0 }
    }

    /// One step downhill.
    pub fn step(&mut self, weights: &mut [f64], gradient: &[f64]) {
        const DECAY: [f64; 2] = [0.9, 0.999];
        self.steps += 1;
        let [one, two] = DECAY.map(|d| 1.0 - d.powi(self.steps));
        for (k, g) in gradient.iter().enumerate() {
            self.first[k] += (1.0 - DECAY[0]) * (g - self.first[k]);
            self.second[k] += (1.0 - DECAY[1]) * (g * g - self.second[k]);
            weights[k] -= self.rate * (self.first[k] / one) / ((self.second[k] / two).sqrt() + 1e-8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn examples(seed: u64, count: usize) -> Vec<(Vec<f64>, f64)> {
        let mut random = SplitMix64::of(seed, 0);
        let one = |_| {
            let x: Vec<f64> = (0..3).map(|_| 4.0 * random.uniform() - 2.0).collect();
            let y = 0.7 * (3.0 * x[0]).tanh() + 0.4 * x[1] * x[2];
            (x, y)
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn a_function_is_learnt_better_than_its_mean_on_points_not_seen() {
        let (seen, unseen) = (examples(1, 400), examples(2, 200));
        let mut network = Network::new(3, 5);
        let mut adam = Adam::new(network.weights.len(), 0.01);
        let mut hidden = [0.0; HIDDEN];
        for _ in 0..500 {
            let mut gradient = vec![0.0; network.weights.len()];
            for (x, y) in &seen {
                let slope = (network.output(x, &mut hidden) - y) / seen.len() as f64;
                network.add_gradient(x, &hidden, slope, &mut gradient);
            }
            adam.step(&mut network.weights, &gradient);
        }
        let mean = unseen.iter().map(|(_, y)| y).sum::<f64>() / unseen.len() as f64;
        let all: f64 = unseen.iter().map(|(_, y)| (y - mean).powi(2)).sum();
        let left: f64 = unseen.iter().map(|(x, y)| (y - network.output(x, &mut hidden)).powi(2)).sum();
        assert!(left < 0.05 * all, "{left} of {all}");
    }

    #[test]
    fn the_gradient_is_that_of_the_output() {
        let mut network = Network::new(2, 1);
        let mut random = SplitMix64::of(9, 0);
        network.weights.iter_mut().for_each(|w| *w = random.normal(0.5));
        let (x, mut hidden) = ([0.4, -1.1], [0.0; HIDDEN]);
        network.output(&x, &mut hidden);
        let mut gradient = vec![0.0; network.weights.len()];
        network.add_gradient(&x, &hidden, 1.0, &mut gradient);
        for k in [0, 1, 37, 64, 70, 97, 128] {
            let at = |by: f64| {
                let mut moved = network.clone();
                moved.weights[k] += by;
                moved.output(&x, &mut [0.0; HIDDEN])
            };
            let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((slope - gradient[k]).abs() < 1e-8, "weight {k}: {slope} {}", gradient[k]);
        }
    }
}
