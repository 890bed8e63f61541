//! Joint fits: every tolerated deviation has a narrow prior, the suspected effect a wide one, and models are compared by
//! their evidence (Laplace; linear-Gaussian in the deviations).
//!
//! With residuals `r` in units of the null, sensitivities `J` of the deviations and their prior `P`, the loss is
//! `r' (I + J P J')^-1 r = r'r - b' (P^-1 + H)^-1 b` with `b = J'r`, `H = J'J` (Woodbury); Rasmussen and Williams, Gaussian
//! Processes for Machine Learning (2006), eq. 2.11 and A.9.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A window's part of the normal equations.
#[derive(Debug, Clone)]
pub struct Normal {
    /// `J' r`, shape `[columns]`.
    pub b: DVector<f64>,
    /// `r' r`.
    pub e: f64,
    /// Numbers in `r`.
    pub count: usize,
}

/// Weighted sums over windows.
#[derive(Debug, Clone)]
pub struct Sums {
    /// Shape `[columns]`.
    pub b: DVector<f64>,
    /// Loss at no deviation.
    pub e: f64,
    /// Weighted count of numbers.
    pub count: f64,
}

/// Sums over the windows with their weights.
pub fn sum<'a>(parts: impl Iterator<Item = (&'a Normal, f64)>, columns: usize) -> Sums {
    let mut sums = Sums { b: DVector::zeros(columns), e: 0.0, count: 0.0 };
    for (part, weight) in parts {
        sums.b.axpy(weight, &part.b, 1.0);
        sums.e += weight * part.e;
        sums.count += weight * part.count as f64;
    }
    sums
}

/// The tolerated deviations integrated out.
pub struct Marginal {
    /// `J'J` over all columns.
    h: DMatrix<f64>,
    /// Of `P^-1 + H` over the tolerated columns.
    factor: Cholesky<f64, Dyn>,
    tolerated: usize,
    /// `H - H_t (P^-1 + H_tt)^-1 H_t'`: curvature along all columns with the deviations free.
    pub curvature: DMatrix<f64>,
}

impl Marginal {
    /// `h` over all columns, the first of which have the tolerances `tolerance`. `None` when the numbers are no good.
    pub fn new(h: DMatrix<f64>, tolerance: &[f64]) -> Option<Self> {
        let tolerated = tolerance.len();
        let mut a = h.view((0, 0), (tolerated, tolerated)).into_owned();
        tolerance.iter().enumerate().for_each(|(i, t)| a[(i, i)] += 1.0 / (t * t));
        let factor = a.cholesky()?;
        let across = h.rows(0, tolerated).into_owned();
        let curvature = &h - across.transpose() * factor.solve(&across);
        Some(Self { h, factor, tolerated, curvature })
    }

    /// Loss with the deviations at their best against their prior.
    pub fn loss(&self, sums: &Sums) -> f64 {
        let b = sums.b.rows(0, self.tolerated).into_owned();
        sums.e - b.dot(&self.factor.solve(&b))
    }

    /// Most probable deviations, in columns.
    pub fn deviations(&self, sums: &Sums) -> DVector<f64> {
        self.factor.solve(&sums.b.rows(0, self.tolerated).into_owned())
    }

    /// The same for `b`, shape `[columns]`, of any residual.
    pub fn best(&self, b: &DVector<f64>) -> DVector<f64> {
        self.factor.solve(&b.rows(0, self.tolerated).into_owned())
    }

    /// Half the gradient of the loss, downwards, along all columns with the deviations free.
    pub fn force(&self, sums: &Sums) -> DVector<f64> {
        let best = self.deviations(sums);
        &sums.b - self.h.columns(0, self.tolerated) * best
    }

    /// Inner product of two vectors of whitened features with the deviations integrated out, given their own product
    /// and their products with the columns.
    pub fn inner(&self, product: f64, a: &DVector<f64>, b: &DVector<f64>) -> f64 {
        let (a, b) = (a.rows(0, self.tolerated).into_owned(), b.rows(0, self.tolerated).into_owned());
        product - a.dot(&self.factor.solve(&b))
    }
}

/// Log evidence ratio of giving the directions `d` (shape `[columns, k]`) a prior of deviations `wide`, against not; and
/// the values along them. Losses are divided by `dispersion`.
pub fn widen(
    curvature: &DMatrix<f64>,
    force: &DVector<f64>,
    d: &DMatrix<f64>,
    wide: &[f64],
    dispersion: f64,
) -> Option<(f64, DVector<f64>)> {
    let k = wide.len();
    // Hardly any of some hundred columns is part of a direction.
    let parts: Vec<Vec<(usize, f64)>> =
        d.column_iter().map(|c| c.iter().copied().enumerate().filter(|x| x.1 != 0.0).collect()).collect();
    let product = |a: &[(usize, f64)], b: &[(usize, f64)]| -> f64 {
        a.iter().map(|&(i, x)| x * b.iter().map(|&(j, y)| curvature[(i, j)] * y).sum::<f64>()).sum()
    };
    let h = DMatrix::from_fn(k, k, |a, b| product(&parts[a], &parts[b]) / dispersion);
    let g = DVector::from_fn(k, |a, _| parts[a].iter().map(|&(i, x)| x * force[i]).sum::<f64>() / dispersion);
    let mut a = h.clone();
    (0..k).for_each(|i| a[(i, i)] += 1.0 / (wide[i] * wide[i]));
    let factor = a.cholesky()?;
    let best = factor.solve(&g);
    let volume: f64 =
        factor.l().diagonal().iter().map(|x| x.ln()).sum::<f64>() + wide.iter().map(|w| w.ln()).sum::<f64>();
    Some((0.5 * g.dot(&best) - volume, best))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two columns of six numbers each, and a residual.
    fn example() -> (DMatrix<f64>, DVector<f64>) {
        let j = DMatrix::from_column_slice(6, 2, &[1.0, 0.0, 2.0, -1.0, 0.5, 0.0, 0.0, 1.0, 1.0, 0.0, -2.0, 0.3]);
        (j, DVector::from_column_slice(&[0.5, -0.2, 1.0, 0.1, -0.7, 0.4]))
    }

    fn sums(j: &DMatrix<f64>, r: &DVector<f64>) -> Sums {
        Sums { b: j.tr_mul(r), e: r.norm_squared(), count: r.len() as f64 }
    }

    #[test]
    fn the_loss_is_that_of_the_covariance() {
        let (j, r) = example();
        let tolerance = [0.3, 2.0];
        let prior = DMatrix::from_diagonal(&DVector::from_column_slice(&[0.09, 4.0]));
        let covariance = DMatrix::identity(6, 6) + &j * prior * j.transpose();
        let direct = r.dot(&covariance.cholesky().unwrap().solve(&r));
        let marginal = Marginal::new(j.tr_mul(&j), &tolerance).unwrap();
        assert!((marginal.loss(&sums(&j, &r)) - direct).abs() < 1e-12);
    }

    #[test]
    fn evidence_is_the_ratio_of_two_gaussians() {
        let (j, r) = example();
        let first = j.columns(0, 1).into_owned();
        let log_density = |covariance: DMatrix<f64>| {
            let factor = covariance.cholesky().unwrap();
            -0.5 * r.dot(&factor.solve(&r)) - factor.l().diagonal().iter().map(|x| x.ln()).sum::<f64>()
        };
        let narrow = DMatrix::identity(6, 6) + 0.09 * &first * first.transpose();
        let second = j.columns(1, 1).into_owned();
        let wide = &narrow + 4.0 * &second * second.transpose();
        let direct = log_density(wide) - log_density(narrow);
        let marginal = Marginal::new(j.tr_mul(&j), &[0.3]).unwrap();
        let force = marginal.force(&sums(&j, &r));
        let d = DMatrix::from_column_slice(2, 1, &[0.0, 1.0]);
        let (evidence, _) = widen(&marginal.curvature, &force, &d, &[2.0], 1.0).unwrap();
        assert!((evidence - direct).abs() < 1e-12, "{evidence} {direct}");
    }

    #[test]
    fn numbers_that_are_no_good_are_refused() {
        assert!(Marginal::new(DMatrix::from_element(2, 2, f64::NAN), &[1.0, 1.0]).is_none());
    }
}
