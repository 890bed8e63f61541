//! Fits that are no lines: a bent valley, outliers, what runs away, what means nothing.

use crate::problems::{line, noisy_line};
use qv_fit::{Blocks, Differences, FitError, Loss, Options, Problem, StopReason, fit};

/// Rosenbrock's valley (Computer Journal 3, 1960): least at (1, 1).
fn valley(points: &[Vec<f64>]) -> Result<Vec<Blocks>, FitError> {
    Ok(points.iter().map(|p| vec![vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]]]).collect())
}

#[test]
fn the_end_of_a_bent_valley_is_found_in_few_calls() {
    for differences in [Differences::OneSided, Differences::Central] {
        let problem = Problem { differences, ..Problem::new(&[-1.2, 1.0], &[1e-6, 1e-6]) };
        let mut calls = 0;
        let count = |p: &[Vec<f64>]| {
            calls += 1;
            valley(p)
        };
        let found = fit(&problem, &Options { fall: 0.0, ..Options::default() }, count).unwrap();
        assert!(found.values.iter().all(|x| (x - 1.0).abs() < 1e-6), "{found:?}");
        assert!(calls <= 60, "{calls}");
    }
}

#[test]
fn outliers_hardly_move_a_line_with_tails() {
    let mut y = noisy_line([0.7, -1.3], 60, 0.1, 2);
    (0..9).for_each(|k| y[3 + 6 * k] += 40.0);
    let problem = Problem::new(&[0.0, 0.0], &[0.01, 0.01]);
    // Numbers in units of their noise.
    let scaled = |p: &[Vec<f64>]| -> Result<Vec<Blocks>, FitError> {
        let mut found = line(&y, p)?;
        found.iter_mut().flatten().flatten().for_each(|r| *r /= 0.1);
        Ok(found)
    };
    let options = |loss| Options { loss, rounds: 60, ..Options::default() };
    let robust = fit(&problem, &options(Loss::student(4.0)), scaled).unwrap();
    let squares = fit(&problem, &options(Loss::SQUARES), scaled).unwrap();
    let off = |v: &[f64]| (v[0] - 0.7).hypot(v[1] + 1.3);
    assert!(off(&robust.values) < 0.06, "{:?}", robust.values);
    assert!(off(&squares.values) > 3.0, "{:?}", squares.values);
}

#[test]
fn a_block_that_runs_away_costs_what_is_stated() {
    // What is simulated fails beyond 0.5; without a price for that the fit stays on this side.
    let roof = |points: &[Vec<f64>]| -> Result<Vec<Blocks>, FitError> {
        let of = |p: &Vec<f64>| vec![vec![p[0] - 2.0], if p[0] > 0.5 { vec![] } else { vec![0.1] }];
        Ok(points.iter().map(of).collect())
    };
    let problem = Problem::new(&[0.0], &[0.01]);
    let strict = fit(&problem, &Options::default(), roof).unwrap();
    assert!(strict.values[0] <= 0.5 && strict.cost.is_finite(), "{strict:?}");
    let loss = Loss { ran_away: 0.2, ..Loss::SQUARES };
    let priced = fit(&problem, &Options { loss, ..Options::default() }, roof).unwrap();
    assert!((priced.values[0] - 2.0).abs() < 1e-6 && (priced.cost - 0.2).abs() < 1e-9, "{priced:?}");
}

#[test]
fn what_has_no_number_is_an_error_and_not_a_fit() {
    let problem = Problem::new(&[0.0], &[0.01]);
    let none = |points: &[Vec<f64>]| -> Result<Vec<Blocks>, FitError> { Ok(vec![vec![vec![f64::NAN]]; points.len()]) };
    let error = fit(&problem, &Options::default(), none).unwrap_err().to_string();
    assert!(error.contains("'start'") && error.contains("ran away"), "{error}");
    let few = |_: &[Vec<f64>]| -> Result<Vec<Blocks>, FitError> { Ok(vec![vec![vec![1.0]]]) };
    let error = fit(&problem, &Options::default(), few).unwrap_err().to_string();
    assert!(error.contains("2 points") && error.contains("found 1"), "{error}");
    for bad in [
        Problem { step: vec![0.0], ..problem.clone() },
        Problem { low: vec![1.0], high: vec![0.0], ..problem.clone() },
        Problem { prior: vec![Some([0.0, 0.0])], ..problem.clone() },
        Problem { prior: vec![], ..problem.clone() },
    ] {
        let error = fit(&bad, &Options::default(), none).unwrap_err();
        assert!(error.what != "start", "{error}");
    }
}

#[test]
fn a_parameter_that_shows_in_nothing_stays_and_is_not_known() {
    let blind = |points: &[Vec<f64>]| -> Result<Vec<Blocks>, FitError> {
        Ok(points.iter().map(|p| vec![vec![p[0] - 1.0], vec![p[0] - 1.2]]).collect())
    };
    let found = fit(&Problem::new(&[0.0, 3.0], &[0.01, 0.01]), &Options::default(), blind).unwrap();
    assert_eq!((found.values[1], found.stopped), (3.0, StopReason::Stuck));
    assert!(found.deviations().iter().all(|d| d.is_infinite()));
}
