//! Small dense linear algebra. Vectors are slices and `Vec`s, matrices are faer's, stored by columns. All of it runs on the thread that
//! calls, so that sums have the same order on any number of threads.

use faer::linalg::matmul::{matmul, triangular};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, Mat, Par, Side};

/// A dense matrix, stored by columns.
pub type Matrix = Mat<f64>;

/// Columns, or numbers of a sum, that are done side by side: one number after the other would be waited for.
const ABREAST: usize = 8;
/// Size up to which a factor is found in a plain loop, which begins sooner.
const SMALL: usize = 16;

/// Inner product of two vectors of one length.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "vectors of one length");
    let mut sums = [0.0; ABREAST];
    let (wholes, others) = (a.chunks_exact(ABREAST), b.chunks_exact(ABREAST));
    let rest: f64 = wholes.remainder().iter().zip(others.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in wholes.zip(others) {
        for k in 0..ABREAST {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// Sum of the squares of a vector.
pub fn squared(a: &[f64]) -> f64 {
    dot(a, a)
}

/// `a - b`.
pub fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    assert_eq!(a.len(), b.len(), "vectors of one length");
    a.iter().zip(b).map(|(x, y)| x - y).collect()
}

/// Adds `share` times `x` to `y`.
pub fn add_scaled(y: &mut [f64], share: f64, x: &[f64]) {
    assert_eq!(y.len(), x.len(), "vectors of one length");
    y.iter_mut().zip(x).for_each(|(y, x)| *y += share * x);
}

/// A matrix of columns of `rows` numbers each.
pub fn from_columns(rows: usize, columns: &[Vec<f64>]) -> Matrix {
    let mut matrix = Matrix::zeros(rows, columns.len());
    columns.iter().enumerate().for_each(|(k, c)| matrix.col_as_slice_mut(k).copy_from_slice(c));
    matrix
}

/// A matrix of numbers row by row.
pub fn from_rows(columns: usize, values: &[f64]) -> Matrix {
    Matrix::from_fn(values.len() / columns.max(1), columns, |i, k| values[i * columns + k])
}

/// A matrix with `diagonal` on its diagonal, and zeros.
pub fn diagonal(diagonal: &[f64]) -> Matrix {
    Matrix::from_fn(diagonal.len(), diagonal.len(), |i, k| if i == k { diagonal[i] } else { 0.0 })
}

/// The diagonal of a matrix.
pub fn diagonal_of(matrix: &Matrix) -> Vec<f64> {
    (0..matrix.nrows().min(matrix.ncols())).map(|i| matrix[(i, i)]).collect()
}

/// The first `rows` rows and `columns` columns.
pub fn corner(matrix: &Matrix, rows: usize, columns: usize) -> Matrix {
    matrix.submatrix(0, 0, rows, columns).to_owned()
}

/// Matrix times vector. A vector that is shorter than the matrix is wide goes with the first columns.
pub fn times(matrix: &Matrix, x: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; matrix.nrows()];
    x.iter().enumerate().for_each(|(k, x)| add_scaled(&mut out, *x, matrix.col_as_slice(k)));
    out
}

/// Transposed matrix times vector.
pub fn transposed_times(matrix: &Matrix, x: &[f64]) -> Vec<f64> {
    let (rows, columns) = matrix.shape();
    assert_eq!(rows, x.len(), "a number for each row");
    let mut out = vec![0.0; columns];
    for first in (0..columns).step_by(ABREAST) {
        // The last few columns are done twice rather than in a loop of their own.
        let first = first.min(columns.saturating_sub(ABREAST));
        let of: [&[f64]; ABREAST] =
            std::array::from_fn(|k| &matrix.col_as_slice((first + k).min(columns - 1))[..x.len()]);
        let mut sums = [0.0; ABREAST];
        for (i, x) in x.iter().enumerate() {
            for k in 0..ABREAST {
                sums[k] += of[k][i] * x;
            }
        }
        (0..ABREAST.min(columns)).for_each(|k| out[first + k] = sums[k]);
    }
    out
}

/// `a b`.
pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut out = Matrix::zeros(a.nrows(), b.ncols());
    matmul(out.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), 1.0, Par::Seq);
    out
}

/// `a' b`.
pub fn transposed_product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut out = Matrix::zeros(a.ncols(), b.ncols());
    matmul(out.as_mut(), Accum::Replace, a.transpose(), b.as_ref(), 1.0, Par::Seq);
    out
}

/// `a' a`, symmetric to the bit.
pub fn gram(a: &Matrix) -> Matrix {
    let mut out = Matrix::zeros(a.ncols(), a.ncols());
    lower_product(&mut out, a.transpose(), a.as_ref());
    mirror(&mut out);
    out
}

/// `a a'`, symmetric to the bit.
pub fn outer(a: &Matrix) -> Matrix {
    let mut out = Matrix::zeros(a.nrows(), a.nrows());
    lower_product(&mut out, a.as_ref(), a.transpose());
    mirror(&mut out);
    out
}

fn lower_product(out: &mut Matrix, a: faer::MatRef<'_, f64>, b: faer::MatRef<'_, f64>) {
    use triangular::BlockStructure::{Rectangular, TriangularLower};
    let out = out.as_mut();
    triangular::matmul(out, TriangularLower, Accum::Replace, a, Rectangular, b, Rectangular, 1.0, Par::Seq);
}

fn mirror(matrix: &mut Matrix) {
    for k in 0..matrix.ncols() {
        (0..k).for_each(|i| matrix[(i, k)] = matrix[(k, i)]);
    }
}

/// Adds `share` times `x` to a matrix.
pub fn add_scaled_matrix(matrix: &mut Matrix, share: f64, x: &Matrix) {
    (0..x.ncols()).for_each(|k| add_scaled(matrix.col_as_slice_mut(k), share, x.col_as_slice(k)));
}

/// Adds `share` times `x x'`.
pub fn add_outer(matrix: &mut Matrix, share: f64, x: &[f64]) {
    x.iter().enumerate().for_each(|(k, of)| add_scaled(matrix.col_as_slice_mut(k), share * of, x));
}

/// Adds numbers to the diagonal.
pub fn add_diagonal(matrix: &mut Matrix, diagonal: &[f64]) {
    diagonal.iter().enumerate().for_each(|(i, x)| matrix[(i, i)] += x);
}

/// Cholesky factor of a symmetric positive definite matrix (Golub and Van Loan, Matrix Computations, 4th edition, section 4.2).
#[derive(Debug, Clone)]
pub struct Cholesky {
    /// `L` with `L L' = a`; zero above the diagonal.
    lower: Matrix,
}

impl Cholesky {
    /// Of a matrix of which only the lower triangle is read; `None` where it is not positive definite or not finite.
    pub fn new(a: &Matrix) -> Option<Self> {
        let size = a.nrows();
        let lower = if size <= SMALL { small(a)? } else { large(a)? };
        // A number that is none may hide below the diagonal of the last columns only if it is on it, too.
        (0..size).all(|i| lower[(i, i)].is_finite() && lower[(i, i)] > 0.0).then_some(Self { lower })
    }

    /// `L`, zero above the diagonal.
    pub fn lower(&self) -> &Matrix {
        &self.lower
    }

    /// Logarithm of the determinant of the matrix.
    pub fn log_determinant(&self) -> f64 {
        2.0 * diagonal_of(&self.lower).iter().map(|x| x.ln()).sum::<f64>()
    }

    /// `L^-1 x` in place: numbers whose covariance is the matrix become independent ones of variance 1.
    pub fn whiten(&self, x: &mut [f64]) {
        for k in 0..x.len() {
            let column = &self.lower.col_as_slice(k)[k..x.len()];
            let of = x[k] / column[0];
            x[k] = of;
            add_scaled(&mut x[k + 1..], -of, &column[1..]);
        }
    }

    /// The same of each column.
    pub fn whiten_columns(&self, columns: &mut Matrix) {
        solve_lower_triangular_in_place(self.lower.as_ref(), columns.as_mut(), Par::Seq);
    }

    /// `a^-1 x`.
    pub fn solve(&self, x: &[f64]) -> Vec<f64> {
        let mut out = x.to_vec();
        self.whiten(&mut out);
        for k in (0..out.len()).rev() {
            let column = &self.lower.col_as_slice(k)[k..];
            out[k] = (out[k] - dot(&column[1..], &out[k + 1..])) / column[0];
        }
        out
    }

    /// `x' a^-1 x`.
    pub fn length(&self, x: &[f64]) -> f64 {
        let mut white = x.to_vec();
        self.whiten(&mut white);
        squared(&white)
    }

    /// `a^-1 x` of each column.
    pub fn solve_columns(&self, x: &Matrix) -> Matrix {
        let mut out = x.clone();
        self.whiten_columns(&mut out);
        solve_upper_triangular_in_place(self.lower.transpose(), out.as_mut(), Par::Seq);
        out
    }

    /// `a^-1`.
    pub fn inverse(&self) -> Matrix {
        self.solve_columns(&Matrix::identity(self.lower.nrows(), self.lower.nrows()))
    }
}

fn large(a: &Matrix) -> Option<Matrix> {
    let factor = faer::linalg::solvers::Llt::new(a.as_ref(), Side::Lower).ok()?;
    let lower = factor.L();
    Some(Matrix::from_fn(a.nrows(), a.nrows(), |i, k| if i < k { 0.0 } else { lower[(i, k)] }))
}

/// Column by column.
fn small(a: &Matrix) -> Option<Matrix> {
    let size = a.nrows();
    let mut lower = Matrix::zeros(size, size);
    for k in 0..size {
        for i in k..size {
            let known: f64 = (0..k).map(|c| lower[(i, c)] * lower[(k, c)]).sum();
            lower[(i, k)] = a[(i, k)] - known;
        }
        let root = lower[(k, k)].sqrt();
        if root.is_nan() || root <= 0.0 {
            return None;
        }
        (k..size).for_each(|i| lower[(i, k)] /= root);
    }
    Some(lower)
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::SplitMix64;

    fn drawn(rows: usize, columns: usize, seed: u64) -> Matrix {
        let mut random = SplitMix64::of(seed, 0);
        Matrix::from_fn(rows, columns, |_, _| random.normal(1.0))
    }

    fn off(a: &Matrix, b: &Matrix) -> f64 {
        assert_eq!(a.shape(), b.shape());
        (a - b).norm_max()
    }

    #[test]
    fn products_are_those_of_sums() {
        for (rows, columns) in [(1, 1), (7, 3), (40, 8), (129, 21), (60, 70)] {
            let (a, x) = (drawn(rows, columns, 1), drawn(rows, 1, 2));
            let plain = |i: usize, k: usize| (0..rows).map(|r| a[(r, i)] * a[(r, k)]).sum::<f64>();
            assert!(off(&gram(&a), &Matrix::from_fn(columns, columns, plain)) < 1e-11);
            let across = a.transpose().to_owned();
            assert!(off(&outer(&across), &gram(&a)) < 1e-11);
            assert!(off(&product(&across, &a), &gram(&a)) < 1e-11);
            let slow = product(&across, &x);
            let fast = transposed_times(&a, x.col_as_slice(0));
            assert!((0..columns).all(|k| (slow[(k, 0)] - fast[k]).abs() < 1e-11));
            assert!(minus(&times(&across, x.col_as_slice(0)), &fast).iter().all(|d| d.abs() < 1e-11));
        }
    }

    #[test]
    fn a_factor_solves_whitens_and_inverts_in_any_size() {
        for size in [1, 4, SMALL, SMALL + 1, 90] {
            let mut a = gram(&drawn(2 * size, size, 3));
            add_diagonal(&mut a, &vec![0.1; size]);
            let factor = Cholesky::new(&a).unwrap();
            assert!(off(&outer(factor.lower()), &a) < 1e-10);
            let x = drawn(size, 1, 4);
            let solved = factor.solve(x.col_as_slice(0));
            assert!(minus(&times(&a, &solved), x.col_as_slice(0)).iter().all(|d| d.abs() < 1e-9));
            assert!((factor.length(x.col_as_slice(0)) - dot(&solved, x.col_as_slice(0))).abs() < 1e-9);
            assert!(off(&product(&a, &factor.inverse()), &Matrix::identity(size, size)) < 1e-9);
        }
    }

    #[test]
    fn what_is_not_positive_or_no_number_has_no_factor() {
        for size in [2, 40] {
            let mut a = Matrix::identity(size, size);
            a[(size - 1, size - 1)] = -1.0;
            assert!(Cholesky::new(&a).is_none());
            assert!(Cholesky::new(&Matrix::from_fn(size, size, |_, _| f64::NAN)).is_none());
            let mut a = Matrix::identity(size, size);
            (a[(size - 1, 0)], a[(0, size - 1)]) = (f64::NAN, f64::NAN);
            assert!(Cholesky::new(&a).is_none());
        }
    }
}
