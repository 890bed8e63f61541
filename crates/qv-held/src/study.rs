//! A recording beside its references: weights, what is pinned, and sums from which every hypothesis is fitted.
//!
//! With references that were recorded, what robots differ in is fitted to them and pinned. With a simulated fleet it is free within the tolerances
//! instead (a ridge about the fleet's mean, tempered by the autocorrelation time), and eliminated from all sums (Schur complement).

use crate::balance::{Balance, Equation};
use crate::gram::{Gram, Layout, assemble, totals};
use crate::hypothesis::{Direction, Nuisance};
use crate::profile::{Profile, spread};
use qv_fit::linear::{Cholesky, Matrix, add_diagonal, add_scaled_matrix, product, transposed_product};

/// How much wider than tolerances a robot is taken to be whose own recordings show what it is.
const SLACK: f64 = 10.0;
/// Share of its diagonal that is put onto a sum where columns may be the same.
const RIDGE: f64 = 1e-9;

/// Sums of a reference, recorded or simulated: equations in the order of the target's, narrow band and wide.
pub(crate) struct Reference {
    pub sums: [Vec<Gram>; 2],
    /// Mean square of each equation with all of its columns free.
    pub noise: Vec<f64>,
    /// Autocorrelation time of that \[rows\].
    pub kappa: f64,
}

impl Reference {
    /// Of a recording; `None` where it lacks an equation of the target.
    pub fn new(balance: &Balance, target: &[Equation]) -> Option<Self> {
        let find = |own: &Equation| balance.equations.iter().position(|e| e.joint == own.joint && e.kind == own.kind);
        let order: Vec<usize> = target.iter().map(find).collect::<Option<_>>()?;
        let sums = totals(balance).map(|all| order.iter().map(|&k| all[k].clone()).collect::<Vec<Gram>>());
        let mut noise = Vec::new();
        let mut kappas = Vec::new();
        for (&k, own) in order.iter().zip(&sums[0]) {
            let left = residual(&balance.equations[k].values, &free_fit(own));
            noise.push((qv_fit::linear::squared(&left) / own.rows).max(1e-18));
            kappas.push(autocorrelation_time(&left));
        }
        let kappa = kappas.iter().sum::<f64>() / kappas.len().max(1) as f64;
        Some(Self { sums, noise, kappa })
    }

    pub fn rows(&self) -> f64 {
        self.sums[0].first().map_or(1.0, |g| g.rows)
    }
}

/// Least squares of `y` by all columns of an equation.
pub(crate) fn free_fit(gram: &Gram) -> Vec<f64> {
    let width = gram.sums.nrows() - 1;
    let scale: Vec<f64> = (0..width).map(|i| gram.sums[(i, i)].sqrt().max(1e-12)).collect();
    let mut a = Matrix::from_fn(width, width, |i, k| gram.sums[(i, k)] / (scale[i] * scale[k]));
    add_diagonal(&mut a, &vec![1e-6; width]);
    let right: Vec<f64> = (0..width).map(|i| gram.sums[(i, width)] / scale[i]).collect();
    let solved = Cholesky::new(&a).map_or(vec![0.0; width], |f| f.solve(&right));
    solved.iter().zip(&scale).map(|(x, s)| x / s).collect()
}

/// `y` less columns times values; columns with `y` as the last.
pub(crate) fn residual(columns: &[Vec<f64>], values: &[f64]) -> Vec<f64> {
    let mut left = columns[columns.len() - 1].clone();
    values.iter().zip(columns).for_each(|(x, c)| qv_fit::linear::add_scaled(&mut left, -x, c));
    left
}

/// Integrated autocorrelation time in samples, at least 1, by Sokal's window (Sokal, Monte Carlo Methods in Statistical Mechanics, 1997).
pub(crate) fn autocorrelation_time(values: &[f64]) -> f64 {
    let count = values.len();
    let mean = values.iter().sum::<f64>() / count.max(1) as f64;
    let about: Vec<f64> = values.iter().map(|x| x - mean).collect();
    let variance: f64 = about.iter().map(|x| x * x).sum();
    if variance <= 0.0 {
        return 1.0;
    }
    let mut time = 1.0;
    for lag in 1..count / 2 {
        let shared: f64 = (lag..count).map(|k| about[k] * about[k - lag]).sum();
        time += 2.0 * shared / variance;
        if lag as f64 >= 5.0 * time {
            break;
        }
    }
    time.max(1.0)
}

/// Fits what is uncertain to some references; the values of all columns, shape `[width]`.
fn fit_nuisance(layout: Layout, nuisance: &Nuisance, slack: f64, sum: &Matrix, kappa: f64) -> Vec<f64> {
    let width = layout.width();
    let d = spread(width + 1, &nuisance.directions);
    let g = product(sum, &d);
    let mut a = transposed_product(&d, &g);
    let stiffness: Vec<f64> = nuisance.tolerances.iter().map(|t| kappa / (slack * t).powi(2)).collect();
    add_diagonal(&mut a, &stiffness);
    let right: Vec<f64> = (0..a.nrows()).map(|k| g[(width, k)]).collect();
    let Some(factor) = Cholesky::new(&a) else { return vec![0.0; width] };
    let solved = factor.solve(&right);
    qv_fit::linear::times(&d, &solved)[..width].to_vec()
}

/// Sums of what is left: `y` less what is pinned, all columns less what `uncertain` directions take, which are free at a stiffness beside everything.
pub(crate) fn reduced(sum: &Matrix, pinned: &[f64], uncertain: Option<(&Nuisance, f64)>) -> Matrix {
    let width = pinned.len();
    let mut transform = Matrix::identity(width + 1, width + 1);
    pinned.iter().enumerate().for_each(|(i, x)| transform[(i, width)] = -x);
    let mut reduced = sandwiched(sum, &transform);
    let Some((nuisance, kappa)) = uncertain else { return reduced };
    let d = spread(width + 1, &nuisance.directions);
    let across = product(&reduced, &d);
    let mut own = transposed_product(&d, &across);
    add_diagonal(&mut own, &nuisance.tolerances.iter().map(|t| kappa / (t * t)).collect::<Vec<_>>());
    if let Some(factor) = Cholesky::new(&own) {
        let taken = factor.solve_columns(&across.transpose().to_owned());
        add_scaled_matrix(&mut reduced, -1.0, &product(&across, &taken));
    }
    reduced
}

fn sandwiched(sum: &Matrix, transform: &Matrix) -> Matrix {
    transposed_product(transform, &product(sum, transform))
}

/// A recording whose hypotheses are fitted: both bands, and its rows.
pub(crate) struct Profiles {
    pub bands: [Profile; 2],
    /// Sums of the narrow band with everything uncertain taken out, of which the freest fit is made.
    pub free: Matrix,
    pub rows: f64,
}

/// What references say of a robot.
pub(crate) struct Study<'a> {
    pub layout: Layout,
    pub references: &'a [Reference],
    /// Whether they are simulated.
    pub is_fleet: bool,
    /// Of each equation.
    pub weights: Vec<f64>,
    pub kappa: f64,
    nuisance: &'a Nuisance,
    /// What is uncertain in each recording within its tolerances, whatever references say.
    uncertain: Option<&'a Nuisance>,
    equations: &'a [Equation],
    /// Weighted sums of each reference, both bands.
    sums: Vec<[Matrix; 2]>,
}

impl<'a> Study<'a> {
    pub fn new(
        layout: Layout,
        equations: &'a [Equation],
        references: &'a [Reference],
        (nuisance, uncertain): (&'a Nuisance, Option<&'a Nuisance>),
        is_fleet: bool,
    ) -> Self {
        let count = references.len() as f64;
        let noise = |e: usize| references.iter().map(|r| r.noise[e]).sum::<f64>() / count;
        let weights: Vec<f64> = (0..equations.len()).map(|e| 1.0 / noise(e)).collect();
        let kappa = references.iter().map(|r| r.kappa).sum::<f64>() / count;
        let sums = Vec::new();
        let mut study = Self { layout, references, is_fleet, weights, kappa, nuisance, uncertain, equations, sums };
        study.weigh();
        // What they leave together, not each with everything free, is what a robot wanders by.
        let values = study.values_of_references();
        study.weights = (0..equations.len()).map(|e| 1.0 / study.left(e, &values)).collect();
        study.weigh();
        study
    }

    /// Values of all columns, with that of `y`, with which what each reference leaves is found.
    fn values_of_references(&self) -> Vec<Vec<f64>> {
        let pinned = self.pinned(None);
        self.sums.iter().map(|sums| self.profile(&sums[0], &pinned[0]).none().values).collect()
    }

    fn weigh(&mut self) {
        let of = |sums: &[Gram]| {
            let mut all = assemble(self.layout, self.equations, &self.weights, sums);
            let scale = 1.0 / self.equations.len().max(1) as f64;
            (0..all.ncols()).for_each(|k| all.col_as_slice_mut(k).iter_mut().for_each(|x| *x *= scale));
            all
        };
        self.sums = self.references.iter().map(|r| [of(&r.sums[0]), of(&r.sums[1])]).collect();
    }

    /// Weighted sums of parts of an equation each, so that a row of mean square 1 in all equations counts 1.
    pub fn sum(&self, grams: &[Gram]) -> Matrix {
        let mut all = assemble(self.layout, self.equations, &self.weights, grams);
        let scale = 1.0 / self.equations.len().max(1) as f64;
        (0..all.ncols()).for_each(|k| all.col_as_slice_mut(k).iter_mut().for_each(|x| *x *= scale));
        all
    }

    /// Mean square that an equation leaves in all references with values of its columns.
    fn left(&self, e: usize, all: &[Vec<f64>]) -> f64 {
        let columns = &self.equations[e].columns;
        let (mut squares, mut rows) = (0.0, 0.0);
        for (reference, values) in self.references.iter().zip(all) {
            let own: Vec<f64> = columns.iter().map(|&c| values[self.layout.place(c)]).chain([1.0]).collect();
            let gram = &reference.sums[0][e];
            squares += qv_fit::linear::dot(&own, &qv_fit::linear::times(&gram.sums, &own));
            rows += gram.rows;
        }
        (squares / rows).max(1e-18)
    }

    /// Values that references but one ask for, in both bands, shape `[width]`.
    pub fn pinned(&self, without: Option<usize>) -> [Vec<f64>; 2] {
        [0, 1].map(|band| {
            let width = self.layout.width();
            let mut sum = Matrix::zeros(width + 1, width + 1);
            let others = (0..self.sums.len()).filter(|r| Some(*r) != without);
            others.for_each(|r| add_scaled_matrix(&mut sum, 1.0, &self.sums[r][band]));
            fit_nuisance(self.layout, self.nuisance, if self.is_fleet { 1.0 } else { SLACK }, &sum, self.kappa)
        })
    }

    /// Values that all references ask for within some tolerances, narrow band, shape `[width]`.
    pub fn fit_references(&self, slack: f64) -> Vec<f64> {
        let width = self.layout.width();
        let mut sum = Matrix::zeros(width + 1, width + 1);
        self.sums.iter().for_each(|s| add_scaled_matrix(&mut sum, 1.0, &s[0]));
        fit_nuisance(self.layout, self.nuisance, slack, &sum, self.kappa)
    }

    /// A reference as if it were to be diagnosed, by the others.
    pub fn left_out(&self, r: usize) -> Profiles {
        // A fleet's mean hardly depends on one of its robots.
        let pinned = self.pinned((!self.is_fleet).then_some(r));
        self.profiles([&self.sums[r][0], &self.sums[r][1]], &pinned, self.references[r].rows())
    }

    /// Sums over all rows of a recording, from which hypotheses are fitted.
    pub fn profiles(&self, sums: [&Matrix; 2], pinned: &[Vec<f64>; 2], rows: f64) -> Profiles {
        let free = reduced(sums[0], &pinned[0], self.uncertain());
        Profiles { bands: [0, 1].map(|band| self.profile(sums[band], &pinned[band])), free, rows }
    }

    fn profile(&self, sum: &Matrix, pinned: &[f64]) -> Profile {
        Profile::new(sum.clone(), pinned, self.uncertain())
    }

    /// Size of a direction that robots of one make may differ by; 0 of one whose tolerance is not stated.
    pub fn tolerance(&self, direction: &Direction) -> f64 {
        let all = [Some(self.nuisance), self.uncertain];
        let stated = || all.iter().flatten().flat_map(|n| n.directions.iter().zip(&n.tolerances));
        let of = |&(place, factor): &(usize, f64)| {
            let own = stated().filter(|(d, _)| d.len() == 1 && d[0].0 == place).map(|(_, t)| *t);
            own.fold(0.0, f64::max) / f64::abs(factor)
        };
        direction.iter().map(of).fold(0.0, f64::max)
    }

    fn uncertain(&self) -> Option<(&Nuisance, f64)> {
        self.uncertain.map(|nuisance| (nuisance, self.kappa))
    }
}

/// A hypothesis at its best in some sums.
#[derive(Clone)]
pub(crate) struct OwnSize {
    pub size: Vec<f64>,
    /// Information in these sums.
    pub information: Matrix,
    /// Loss of `y` without and with it.
    pub loss: [f64; 2],
}

/// Fits directions to reduced sums; `None` where they are not distinguished.
pub(crate) fn fit(sum: &Matrix, directions: &[Direction]) -> Option<OwnSize> {
    let y = sum.nrows() - 1;
    let between = |a: &Direction, b: &Direction| -> f64 {
        a.iter().map(|&(i, x)| b.iter().map(|&(k, z)| x * z * sum[(i, k)]).sum::<f64>()).sum()
    };
    let count = directions.len();
    let information = Matrix::from_fn(count, count, |i, k| between(&directions[i], &directions[k]));
    let right: Vec<f64> = directions.iter().map(|d| d.iter().map(|&(i, x)| x * sum[(i, y)]).sum()).collect();
    let scale: Vec<f64> = (0..count).map(|i| information[(i, i)].sqrt()).collect();
    if scale.iter().any(|s| !s.is_finite() || *s <= 1e-12) {
        return None;
    }
    let unit = Matrix::from_fn(count, count, |i, k| {
        information[(i, k)] / (scale[i] * scale[k]) - if i == k { RIDGE } else { 0.0 }
    });
    Cholesky::new(&unit)?;
    let factor = Cholesky::new(&information)?;
    let size = factor.solve(&right);
    let fall = qv_fit::linear::dot(&size, &right);
    size.iter().all(|x| x.is_finite()).then_some(OwnSize { size, information, loss: [sum[(y, y)], sum[(y, y)] - fall] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::SplitMix64;

    #[test]
    fn the_autocorrelation_time_is_that_of_an_autoregressive_series() {
        let mut random = SplitMix64::of(5, 1);
        for share in [0.0f64, 0.5, 0.8] {
            let mut x = 0.0;
            let series: Vec<f64> = (0..60_000)
                .map(|_| {
                    x = share * x + random.normal(1.0);
                    x
                })
                .collect();
            let right = (1.0 + share) / (1.0 - share);
            let found = autocorrelation_time(&series);
            assert!((found / right - 1.0).abs() < 0.1, "{share}: {found} {right}");
        }
    }

    /// Eliminating a column whose size is uncertain is what generalised least squares with its covariance does.
    #[test]
    fn a_ridge_that_is_eliminated_is_generalised_least_squares() {
        let mut random = SplitMix64::of(6, 1);
        let (rows, tolerance) = (40, 0.3);
        let columns: Vec<Vec<f64>> = (0..3).map(|_| (0..rows).map(|_| random.normal(1.0)).collect()).collect();
        let gram = Gram::of(&columns, 0..rows);
        let nuisance = Nuisance { directions: vec![vec![(1, 1.0)]], tolerances: vec![tolerance] };
        let sum = reduced(&gram.sums, &[0.0, 0.0], Some((&nuisance, 1.0)));
        let own = fit(&sum, &[vec![(0, 1.0)]]).unwrap();
        // Covariance of rows: 1 + tolerance² u u'.
        let (x, u, y) = (&columns[0], &columns[1], &columns[2]);
        let covariance = Matrix::from_fn(rows, rows, |i, k| f64::from(i == k) + tolerance * tolerance * u[i] * u[k]);
        let factor = Cholesky::new(&covariance).unwrap();
        let dot = |a: &[f64], b: &[f64]| qv_fit::linear::dot(a, &factor.solve(b));
        assert!((own.size[0] - dot(x, y) / dot(x, x)).abs() < 1e-10);
        assert!((own.information[(0, 0)] - dot(x, x)).abs() < 1e-9);
        assert!((own.loss[0] - dot(y, y)).abs() < 1e-9);
    }
}
