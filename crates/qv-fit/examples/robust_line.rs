//! A line through numbers of which a few are wrong: squares follow them, a loss with tails does not.

use qv_fit::{Blocks, FitError, Loss, Options, Problem, fit};

fn main() -> Result<(), FitError> {
    let noise = |k: usize| 0.1 * (12.9898 * k as f64).sin();
    let y: Vec<f64> = (0..50).map(|k| 1.0 + 0.2 * k as f64 + noise(k) + if k % 9 == 4 { 30.0 } else { 0.0 }).collect();
    let residuals = |points: &[Vec<f64>]| -> Result<Vec<Blocks>, FitError> {
        let of = |p: &Vec<f64>| (0..y.len()).map(|k| vec![(y[k] - p[0] - p[1] * k as f64) / 0.1]).collect();
        Ok(points.iter().map(of).collect())
    };
    let mut problem = Problem::new(&[0.0, 0.0], &[0.01, 0.01]);
    problem.low[1] = 0.0;
    for (name, loss) in [("squares", Loss::SQUARES), ("tails", Loss::student(4.0))] {
        let found = fit(&problem, &Options { loss, rounds: 100, ..Options::default() }, residuals)?;
        let [low, high] = found.intervals(&found.block_deviations(), 1.96)[1];
        println!("{name}: {:.2} + {:.3} x, slope {low:.3} to {high:.3}", found.values[0], found.values[1]);
    }
    Ok(())
}
