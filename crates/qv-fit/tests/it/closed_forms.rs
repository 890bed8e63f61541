//! Fits whose answer is known in closed form.

use crate::problems::{line, noisy_line};
use qv_fit::linear::{Cholesky, Matrix, add_outer};
use qv_fit::{Options, Problem, fit};

/// Mean and covariance of a line's posterior by the normal equations.
fn posterior(y: &[f64], prior: [[f64; 2]; 2]) -> (Vec<f64>, Matrix) {
    let mut a = Matrix::from_fn(2, 2, |i, k| if i == k { prior[i][1].powi(-2) } else { 0.0 });
    let mut b: Vec<f64> = prior.iter().map(|[mean, d]| mean / (d * d)).collect();
    for (k, y) in y.iter().enumerate() {
        let row = [1.0, -1.0 + 2.0 * k as f64 / 39.0];
        add_outer(&mut a, 1.0, &row);
        b.iter_mut().zip(row).for_each(|(b, x)| *b += x * y);
    }
    let factor = Cholesky::new(&a).unwrap();
    (factor.solve(&b), factor.inverse())
}

#[test]
fn a_line_with_priors_is_the_normal_equations() {
    let y = noisy_line([0.7, -1.3], 40, 1.0, 5);
    let prior = [[0.2, 0.1], [-1.0, 0.5]];
    let mut problem = Problem::new(&[9.0, 9.0], &[0.01, 0.01]);
    problem.prior = prior.map(Some).to_vec();
    let found = fit(&problem, &Options::default(), |p| line(&y, p)).unwrap();
    let (mean, covariance) = posterior(&y, prior);
    let of = found.slopes.posterior().unwrap();
    for i in 0..2 {
        assert!((found.values[i] - mean[i]).abs() < 1e-10, "{:?} {mean:?}", found.values);
        (0..2).for_each(|k| assert!((of[(i, k)] - covariance[(i, k)]).abs() < 1e-10));
    }
    assert!(found.costs.windows(2).all(|c| c[1] < c[0]) && found.costs.len() < 5, "{:?}", found.costs);
}

#[test]
fn a_bound_holds_what_would_leave_it_and_the_rest_is_the_best_beside_it() {
    let y = noisy_line([0.7, -1.3], 40, 0.3, 6);
    let mut problem = Problem::new(&[0.0, 0.0], &[0.01, 0.01]);
    problem.low[1] = -0.5;
    let found = fit(&problem, &Options::default(), |p| line(&y, p)).unwrap();
    let mean = y.iter().sum::<f64>() / 40.0;
    // Places are even about zero: the mean does not depend on the slope.
    assert_eq!(found.values[1], -0.5);
    assert!((found.values[0] - mean).abs() < 1e-9, "{:?} {mean}", found.values);
}

#[test]
fn blocks_in_another_order_are_the_same_fit() {
    let y = noisy_line([0.7, -1.3], 24, 1.0, 8);
    let problem = Problem::new(&[0.0, 0.0], &[0.01, 0.01]);
    let options = Options { loss: qv_fit::Loss::student(3.0), fall: 1e-14, ..Options::default() };
    let order: Vec<usize> = (0..24).map(|k| (7 * k + 3) % 24).collect();
    let shuffled = |points: &[Vec<f64>]| -> Result<_, qv_fit::FitError> {
        let of = |b: qv_fit::Blocks| order.iter().map(|&k| b[k].clone()).collect();
        Ok(line(&y, points)?.into_iter().map(of).collect())
    };
    let (a, b) = (fit(&problem, &options, |p| line(&y, p)).unwrap(), fit(&problem, &options, shuffled).unwrap());
    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-7);
    assert!(close(&a.values, &b.values) && close(&a.block_deviations(), &b.block_deviations()), "{a:?} {b:?}");
}
