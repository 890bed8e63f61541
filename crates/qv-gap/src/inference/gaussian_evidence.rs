//! Joint fits: every tolerated deviation has a narrow prior, the suspected effect a wide one, and models are compared by
//! their evidence (Laplace; linear-Gaussian in the deviations).
//!
//! With residuals `r` in units of the null, sensitivities `J` of the deviations and their prior `P`, the loss is
//! `r' (I + J P J')^-1 r = r'r - b' (P^-1 + H)^-1 b` with `b = J'r`, `H = J'J` (Woodbury); Rasmussen and Williams, Gaussian
//! Processes for Machine Learning (2006), eq. 2.11 and A.9.

use qv_fit::linear::{add_diagonal, add_scaled, corner, dot, gram, minus, times};
use qv_fit::{Cholesky, Matrix};

/// A window's part of the normal equations.
#[derive(Debug, Clone)]
pub struct Normal {
    /// `J' r`, shape `[columns]`.
    pub b: Vec<f64>,
    /// `r' r`.
    pub e: f64,
    /// Numbers in `r`.
    pub count: usize,
}

/// Weighted sums over windows.
#[derive(Debug, Clone)]
pub struct Sums {
    /// Shape `[columns]`.
    pub b: Vec<f64>,
    /// Loss at no deviation.
    pub e: f64,
    /// Weighted count of numbers.
    pub count: f64,
}

/// Sums over the windows with their weights.
pub fn sum<'a>(parts: impl Iterator<Item = (&'a Normal, f64)>, columns: usize) -> Sums {
    let mut sums = Sums { b: vec![0.0; columns], e: 0.0, count: 0.0 };
    for (part, weight) in parts {
        add_scaled(&mut sums.b, weight, &part.b);
        sums.e += weight * part.e;
        sums.count += weight * part.count as f64;
    }
    sums
}

/// The tolerated deviations integrated out.
pub struct Marginal {
    /// `J'J` over all columns.
    h: Matrix,
    /// Of `P^-1 + H` over the tolerated columns.
    factor: Cholesky,
    tolerated: usize,
    /// `H - H_t (P^-1 + H_tt)^-1 H_t'`: curvature along all columns with the deviations free.
    pub curvature: Matrix,
}

impl Marginal {
    /// `h` over all columns, the first of which have the tolerances `tolerance`. `None` when the numbers are no good.
    pub fn new(h: Matrix, tolerance: &[f64]) -> Option<Self> {
        let tolerated = tolerance.len();
        let mut a = corner(&h, tolerated, tolerated);
        add_diagonal(&mut a, &tolerance.iter().map(|t| 1.0 / (t * t)).collect::<Vec<_>>());
        let factor = Cholesky::new(&a)?;
        // With L L' = P^-1 + H_tt: the square of L^-1 H_t'.
        let mut across = corner(&h, tolerated, h.ncols());
        factor.whiten_columns(&mut across);
        let curvature = &h - gram(&across);
        Some(Self { h, factor, tolerated, curvature })
    }

    /// Loss with the deviations at their best against their prior.
    pub fn loss(&self, sums: &Sums) -> f64 {
        sums.e - self.factor.length(&sums.b[..self.tolerated])
    }

    /// Most probable deviations, in columns.
    pub fn deviations(&self, sums: &Sums) -> Vec<f64> {
        self.best(&sums.b)
    }

    /// The same for `b`, shape `[columns]`, of any residual.
    pub fn best(&self, b: &[f64]) -> Vec<f64> {
        self.factor.solve(&b[..self.tolerated])
    }

    /// Half the gradient of the loss, downwards, along all columns with the deviations free.
    pub fn force(&self, sums: &Sums) -> Vec<f64> {
        minus(&sums.b, &times(&self.h, &self.deviations(sums)))
    }

    /// Inner product of two vectors of whitened features with the deviations integrated out, given their own product
    /// and their products with the columns.
    pub fn inner(&self, product: f64, a: &[f64], b: &[f64]) -> f64 {
        product - dot(&a[..self.tolerated], &self.best(b))
    }
}

/// Log evidence ratio of giving the directions `d` (shape `[columns, k]`) a prior of deviations `wide`, against not; and
/// the values along them. Losses are divided by `dispersion`.
pub fn widen(curvature: &Matrix, force: &[f64], d: &Matrix, wide: &[f64], dispersion: f64) -> Option<(f64, Vec<f64>)> {
    let k = wide.len();
    // Hardly any of some hundred columns is part of a direction.
    let part = |c: usize| d.col_as_slice(c).iter().copied().enumerate().filter(|x| x.1 != 0.0).collect();
    let parts: Vec<Vec<(usize, f64)>> = (0..d.ncols()).map(part).collect();
    let product = |a: &[(usize, f64)], b: &[(usize, f64)]| -> f64 {
        a.iter().map(|&(i, x)| x * b.iter().map(|&(j, y)| curvature[(i, j)] * y).sum::<f64>()).sum()
    };
    let mut a = Matrix::from_fn(k, k, |a, b| product(&parts[a], &parts[b]) / dispersion);
    let along = |part: &Vec<(usize, f64)>| part.iter().map(|&(i, x)| x * force[i]).sum::<f64>() / dispersion;
    let g: Vec<f64> = parts.iter().map(along).collect();
    add_diagonal(&mut a, &wide.iter().map(|w| 1.0 / (w * w)).collect::<Vec<_>>());
    let factor = Cholesky::new(&a)?;
    let best = factor.solve(&g);
    let volume = 0.5 * factor.log_determinant() + wide.iter().map(|w| w.ln()).sum::<f64>();
    Some((0.5 * dot(&g, &best) - volume, best))
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_fit::linear::{add_outer, from_columns, squared, transposed_times};

    /// Two columns of six numbers each, and a residual.
    fn example() -> (Matrix, Vec<f64>) {
        let columns = [vec![1.0, 0.0, 2.0, -1.0, 0.5, 0.0], vec![0.0, 1.0, 1.0, 0.0, -2.0, 0.3]];
        (from_columns(6, &columns), vec![0.5, -0.2, 1.0, 0.1, -0.7, 0.4])
    }

    fn sums(j: &Matrix, r: &[f64]) -> Sums {
        Sums { b: transposed_times(j, r), e: squared(r), count: r.len() as f64 }
    }

    /// Of the residual, with deviations of the columns.
    fn covariance(j: &Matrix, deviations: &[f64]) -> Matrix {
        let mut covariance = Matrix::identity(6, 6);
        (0..2).for_each(|k| add_outer(&mut covariance, deviations[k].powi(2), j.col_as_slice(k)));
        covariance
    }

    #[test]
    fn the_loss_is_that_of_the_covariance() {
        let (j, r) = example();
        let tolerance = [0.3, 2.0];
        let covariance = covariance(&j, &tolerance);
        let direct = Cholesky::new(&covariance).unwrap().length(&r);
        let marginal = Marginal::new(gram(&j), &tolerance).unwrap();
        assert!((marginal.loss(&sums(&j, &r)) - direct).abs() < 1e-12);
    }

    #[test]
    fn evidence_is_the_ratio_of_two_gaussians() {
        let (j, r) = example();
        let log_density = |deviations: [f64; 2]| {
            let factor = Cholesky::new(&covariance(&j, &deviations)).unwrap();
            -0.5 * (factor.length(&r) + factor.log_determinant())
        };
        let direct = log_density([0.3, 2.0]) - log_density([0.3, 0.0]);
        let marginal = Marginal::new(gram(&j), &[0.3]).unwrap();
        let force = marginal.force(&sums(&j, &r));
        let d = from_columns(2, &[vec![0.0, 1.0]]);
        let (evidence, _) = widen(&marginal.curvature, &force, &d, &[2.0], 1.0).unwrap();
        assert!((evidence - direct).abs() < 1e-12, "{evidence} {direct}");
    }

    #[test]
    fn numbers_that_are_no_good_are_refused() {
        assert!(Marginal::new(Matrix::from_fn(2, 2, |_, _| f64::NAN), &[1.0, 1.0]).is_none());
    }
}
