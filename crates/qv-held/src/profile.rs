//! Fits of hypotheses to the sums of a recording whose robot is uncertain within a box of tolerances.
//!
//! `min over h, n of (c - D n - H h)' A (c - D n - H h) + n' K n` with `|n_k| <= t_k`: a Gaussian prior alone does not hold, for thousands of
//! samples outweigh it, and friction of ten tolerances explains a halved gain. Solved by block principal pivoting (Júdice and Pires, Computers and
//! Operations Research 21, 1994): what leaves the box is pinned at its side, what is pinned and would return is free again.

use crate::hypothesis::{Direction, Nuisance};
use qv_fit::linear::{
    Cholesky, Matrix, add_diagonal, add_scaled, dot, product, times, transposed_product, transposed_times,
};

/// Exchanges of whole blocks, and of single values after them.
const BLOCKS: usize = 12;
const EXCHANGES: usize = 40;
/// Share of its diagonal that is put onto a sum where columns may be the same.
const RIDGE: f64 = 1e-9;

/// Where a value that is uncertain lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Free,
    Lower,
    Upper,
}

/// What is uncertain about a robot.
struct Uncertainty {
    /// Directions, shape `[width + 1, count]`.
    directions: Matrix,
    /// Sums times directions, the same shape.
    across: Matrix,
    /// Stiffness and sums between directions, shape `[count, count]`.
    own: Matrix,
    /// Sums between directions and what is left without them, shape `[count]`.
    right: Vec<f64>,
    bounds: Vec<f64>,
}

/// Sums of a recording, what is pinned, and what is uncertain.
pub(crate) struct Profile {
    sum: Matrix,
    /// Values of all columns, with that of `y` as the last, where nothing differs from what is pinned.
    opening: Vec<f64>,
    uncertain: Option<Uncertainty>,
    /// Sides and factor of the fit without a hypothesis, from which the others start.
    start: Vec<Side>,
    factor: Option<Cholesky>,
}

/// A hypothesis at its best.
#[derive(Clone)]
pub(crate) struct Fit {
    pub size: Vec<f64>,
    /// Information in the sums.
    pub information: Matrix,
    /// Loss of all rows.
    pub loss: f64,
    /// Values of all columns, with that of `y` (1) as the last, of what is left.
    pub values: Vec<f64>,
    /// By how much each size differs from that with what is pinned at the sides of the box in its middle.
    pub play: Vec<f64>,
    /// The same without the hypothesis, where the rest is as beside it.
    without: Vec<f64>,
    /// By what a unit of each size changes all columns, with what it moves of what is uncertain.
    directions: Vec<Vec<f64>>,
}

impl Fit {
    /// Values with a size that other rows ask for: those of `sum`.
    pub fn refitted(&self, sum: &Matrix) -> Option<Vec<f64>> {
        let across: Vec<Vec<f64>> = self.directions.iter().map(|d| times(sum, d)).collect();
        let information = Matrix::from_fn(across.len(), across.len(), |i, k| dot(&self.directions[i], &across[k]));
        let right: Vec<f64> = across.iter().map(|a| dot(a, &self.without)).collect();
        let size = Cholesky::new(&information)?.solve(&right);
        let mut values = self.without.clone();
        size.iter().zip(&self.directions).for_each(|(x, d)| add_scaled(&mut values, -x, d));
        Some(values)
    }

    /// By what each block moves a size: `M^-1 e' A_b c`.
    pub fn influences(&self, blocks: &[Matrix]) -> Option<Vec<Vec<f64>>> {
        let factor = Cholesky::new(&self.information)?;
        let score = |block: &Matrix| -> Vec<f64> {
            let left = times(block, &self.values);
            self.directions.iter().map(|d| dot(d, &left)).collect()
        };
        Some(blocks.iter().map(|b| factor.solve(&score(b))).collect())
    }
}

impl Profile {
    /// Of sums, shape `[width + 1, width + 1]`; `pinned` has a value for each column, `uncertain` its deviations from these with the
    /// autocorrelation time that tempers their prior.
    pub fn new(sum: Matrix, pinned: &[f64], uncertain: Option<(&Nuisance, f64)>) -> Self {
        let opening: Vec<f64> = pinned.iter().map(|x| -x).chain([1.0]).collect();
        let uncertain = uncertain.map(|(nuisance, kappa)| {
            let directions = spread(opening.len(), &nuisance.directions);
            let across = product(&sum, &directions);
            let mut own = transposed_product(&directions, &across);
            add_diagonal(&mut own, &nuisance.tolerances.iter().map(|t| kappa / (t * t)).collect::<Vec<_>>());
            let right = transposed_times(&across, &opening);
            Uncertainty { directions, across, own, right, bounds: nuisance.tolerances.clone() }
        });
        let start = vec![Side::Free; uncertain.as_ref().map_or(0, |u| u.bounds.len())];
        let mut own = Self { sum, opening, uncertain, start, factor: None };
        if own.uncertain.is_some() {
            if let Some((_, sides)) = own.pivoted(&[]) {
                own.start = sides;
            }
            own.factor = own.factor_of(&own.start);
        }
        own
    }

    /// The fit without a hypothesis.
    pub fn none(&self) -> Fit {
        let values = || Fit {
            size: Vec::new(),
            information: Matrix::zeros(0, 0),
            loss: dot(&self.opening, &times(&self.sum, &self.opening)),
            values: self.opening.clone(),
            play: Vec::new(),
            without: self.opening.clone(),
            directions: Vec::new(),
        };
        self.fit(&[]).unwrap_or_else(values)
    }

    /// Fits directions; `None` where they are not distinguished.
    pub fn fit(&self, directions: &[Direction]) -> Option<Fit> {
        self.pivoted(directions).map(|(fit, _)| fit)
    }

    fn factor_of(&self, sides: &[Side]) -> Option<Cholesky> {
        let own = &self.uncertain.as_ref()?.own;
        let free: Vec<usize> = (0..sides.len()).filter(|&k| sides[k] == Side::Free).collect();
        Cholesky::new(&Matrix::from_fn(free.len(), free.len(), |i, k| own[(free[i], free[k])]))
    }

    fn pivoted(&self, directions: &[Direction]) -> Option<(Fit, Vec<Side>)> {
        let dense = spread(self.opening.len(), directions);
        let dense: Vec<Vec<f64>> = (0..directions.len()).map(|k| dense.col_as_slice(k).to_vec()).collect();
        let across: Vec<Vec<f64>> = dense.iter().map(|d| times(&self.sum, d)).collect();
        if across.iter().zip(&dense).any(|(a, d)| dot(a, d).is_nan() || dot(a, d) <= 1e-24) {
            return None;
        }
        let mut sides = self.start.clone();
        for round in 0..BLOCKS + EXCHANGES {
            let (fit, values) = self.solve(&dense, &across, &sides)?;
            let wrong = self.wrong(&values, &fit, &sides);
            let Some(first) = wrong.first().copied() else { return Some((fit, sides)) };
            let picked = if round < BLOCKS { &wrong[..] } else { std::slice::from_ref(&first) };
            picked.iter().for_each(|&(k, side)| sides[k] = side);
        }
        let (fit, _) = self.solve(&dense, &across, &sides)?;
        Some((fit, sides))
    }

    /// Values that left the box, and pinned ones that would return, with where they belong; the farthest first.
    fn wrong(&self, values: &[f64], fit: &Fit, sides: &[Side]) -> Vec<(usize, Side)> {
        let Some(uncertain) = &self.uncertain else { return Vec::new() };
        let pull = transposed_times(&uncertain.across, &fit.values);
        let mut all: Vec<(f64, usize, Side)> = Vec::new();
        for (k, &bound) in uncertain.bounds.iter().enumerate() {
            let value = values[k] / bound;
            // What the rest would move it by.
            let stiffness = uncertain.own[(k, k)];
            let kappa = stiffness - dot(uncertain.directions.col_as_slice(k), uncertain.across.col_as_slice(k));
            let moved = (pull[k] - kappa * values[k]) / (stiffness * bound);
            match sides[k] {
                Side::Free if value > 1.0 + 1e-6 => all.push((value - 1.0, k, Side::Upper)),
                Side::Free if value < -1.0 - 1e-6 => all.push((-1.0 - value, k, Side::Lower)),
                Side::Upper if moved < -1e-6 => all.push((-moved, k, Side::Free)),
                Side::Lower if moved > 1e-6 => all.push((moved, k, Side::Free)),
                _ => {}
            }
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all.into_iter().map(|(_, k, side)| (k, side)).collect()
    }

    /// The best with some of what is uncertain pinned at its sides; the fit, and values of what is uncertain.
    fn solve(&self, dense: &[Vec<f64>], across: &[Vec<f64>], sides: &[Side]) -> Option<(Fit, Vec<f64>)> {
        let free: Vec<usize> = (0..sides.len()).filter(|&k| sides[k] == Side::Free).collect();
        let (mut without, mut effective) = (self.opening.clone(), dense.to_vec());
        let (mut values, mut moves) = (vec![0.0; sides.len()], Vec::new());
        if let Some(uncertain) = &self.uncertain {
            let cached = self.factor.as_ref().filter(|_| sides == self.start);
            let fresh = if cached.is_some() { None } else { self.factor_of(sides) };
            let factor = cached.or(fresh.as_ref())?;
            values = uncertain.values(factor, sides, &free);
            uncertain.take(&mut without, &values);
            for direction in &mut effective {
                moves.push(uncertain.follow(factor, direction, &free));
            }
        }
        let left = times(&self.sum, &without);
        let information = Matrix::from_fn(dense.len(), dense.len(), |i, k| dot(&across[i], &effective[k]));
        let right: Vec<f64> = dense.iter().map(|d| dot(d, &left)).collect();
        let size = sizes(&information, &right)?;
        let mut all = without.clone();
        size.iter().zip(&effective).for_each(|(x, d)| add_scaled(&mut all, -x, d));
        for (x, taken) in size.iter().zip(&moves) {
            free.iter().zip(taken).for_each(|(&k, by)| values[k] -= x * by);
        }
        let loss = dot(&all, &times(&self.sum, &all)).max(0.0);
        let play = self.play(&effective, &information, sides);
        Some((Fit { size, information, loss, values: all, play, without, directions: effective }, values))
    }

    /// What values at the sides of the box make of a size.
    fn play(&self, directions: &[Vec<f64>], information: &Matrix, sides: &[Side]) -> Vec<f64> {
        let still = || vec![0.0; directions.len()];
        let (Some(uncertain), Some(factor)) = (&self.uncertain, Cholesky::new(information)) else { return still() };
        let pull = times(&uncertain.across, &uncertain.at_sides(sides));
        factor.solve(&directions.iter().map(|d| dot(d, &pull)).collect::<Vec<_>>())
    }
}

impl Uncertainty {
    /// The best values without a hypothesis, those at a side pinned there.
    fn values(&self, factor: &Cholesky, sides: &[Side], free: &[usize]) -> Vec<f64> {
        let mut values = self.at_sides(sides);
        let pinned = times(&self.own, &values);
        let own = factor.solve(&free.iter().map(|&k| self.right[k] - pinned[k]).collect::<Vec<_>>());
        free.iter().zip(own).for_each(|(&k, x)| values[k] = x);
        values
    }

    /// Values at the sides of the box; 0 of those that are free.
    fn at_sides(&self, sides: &[Side]) -> Vec<f64> {
        let at = |(side, bound): (&Side, &f64)| match side {
            Side::Free => 0.0,
            Side::Lower => -bound,
            Side::Upper => *bound,
        };
        sides.iter().zip(&self.bounds).map(at).collect()
    }

    /// Takes values from those of all columns.
    fn take(&self, columns: &mut [f64], values: &[f64]) {
        let of = |k: usize| self.directions.col_as_slice(k);
        values.iter().enumerate().for_each(|(k, x)| add_scaled(columns, -x, of(k)));
    }

    /// Lets what is free follow a direction; by what a unit of it moves that.
    fn follow(&self, factor: &Cholesky, direction: &mut [f64], free: &[usize]) -> Vec<f64> {
        let pull = transposed_times(&self.across, direction);
        let taken = factor.solve(&free.iter().map(|&k| pull[k]).collect::<Vec<_>>());
        free.iter().zip(&taken).for_each(|(&k, x)| add_scaled(direction, -x, self.directions.col_as_slice(k)));
        taken
    }
}

/// Directions as the columns of a matrix.
pub(crate) fn spread(rows: usize, directions: &[Direction]) -> Matrix {
    let mut all = Matrix::zeros(rows, directions.len());
    for (k, direction) in directions.iter().enumerate() {
        direction.iter().for_each(|&(place, x)| all[(place, k)] += x);
    }
    all
}

fn sizes(information: &Matrix, right: &[f64]) -> Option<Vec<f64>> {
    let count = right.len();
    let scale: Vec<f64> = (0..count).map(|i| information[(i, i)].sqrt()).collect();
    if scale.iter().any(|s| !s.is_finite() || *s <= 1e-12) {
        return None;
    }
    let unit = |i: usize, k: usize| information[(i, k)] / (scale[i] * scale[k]) - if i == k { RIDGE } else { 0.0 };
    Cholesky::new(&Matrix::from_fn(count, count, unit))?;
    let size = Cholesky::new(information)?.solve(right);
    size.iter().all(|x| x.is_finite()).then_some(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::SplitMix64;
    use qv_fit::linear::{from_columns, gram};

    /// Two columns that are alike: a size of the one that is a cause beside the other within its tolerance.
    fn sums(size: f64, uncertain: f64) -> Matrix {
        let mut random = SplitMix64::of(7, 1);
        let first: Vec<f64> = (0..400).map(|_| random.normal(1.0)).collect();
        let second: Vec<f64> = first.iter().map(|x| 0.8 * x + random.normal(0.6)).collect();
        let y = first.iter().zip(&second).map(|(a, b)| size * a + uncertain * b + random.normal(0.01)).collect();
        gram(&from_columns(400, &[first, second, y]))
    }

    fn nuisance() -> Nuisance {
        Nuisance { directions: vec![vec![(1, 1.0)]], tolerances: vec![0.1] }
    }

    #[test]
    fn what_is_uncertain_stays_in_its_box() {
        let nuisance = nuisance();
        let profile = Profile::new(sums(0.0, 0.7), &[0.0, 0.0], Some((&nuisance, 1.0)));
        let none = profile.none();
        assert!((none.values[1] + 0.1).abs() < 1e-12, "{:?}", none.values);
        // Within the box it follows the data but for its prior.
        let inside = Profile::new(sums(0.0, 0.05), &[0.0, 0.0], Some((&nuisance, 1e-6))).none();
        assert!((inside.values[1] + 0.05).abs() < 2e-3, "{:?}", inside.values);
    }

    #[test]
    fn a_size_beside_a_box_is_the_minimum_over_both() {
        let nuisance = nuisance();
        for uncertain in [-0.4, 0.02, 0.3] {
            let sum = sums(0.5, uncertain);
            let fit = Profile::new(sum.clone(), &[0.0, 0.0], Some((&nuisance, 1.0))).fit(&[vec![(0, 1.0)]]).unwrap();
            let loss = |h: f64, n: f64| {
                let values = [-h, -n, 1.0];
                dot(&values, &times(&sum, &values)) + n * n / 0.01
            };
            let (h, n) = (fit.size[0], -fit.values[1]);
            assert!(n.abs() <= 0.1 + 1e-9);
            // With the second column in the middle of its box the first would take what that has at its side.
            let middle = Profile::new(sum.clone(), &[0.0, 0.0], None).fit(&[vec![(0, 1.0)]]).unwrap();
            let play = if n.abs() > 0.1 - 1e-9 { h - middle.size[0] } else { 0.0 };
            assert!((fit.play[0].abs() - play.abs()).abs() < 1e-9, "{:?} {play}", fit.play);
            for (more_h, more_n) in [(1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-3), (0.0, -1e-3)] {
                if (n + more_n).abs() <= 0.1 {
                    assert!(loss(h + more_h, n + more_n) >= loss(h, n), "{uncertain}: {h} {n}");
                }
            }
        }
    }

    #[test]
    fn columns_that_are_one_are_not_fitted() {
        let profile = Profile::new(sums(0.5, 0.0), &[0.0, 0.0], None);
        assert!(profile.fit(&[vec![(0, 1.0)], vec![(0, 2.0)]]).is_none());
    }
}
