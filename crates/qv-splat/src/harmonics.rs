//! Real spherical harmonics under rotation and reflection, degrees 0 to 3, in the order and with the signs of
//! [`qv_core::GaussianCloud::sh`].

use glam::{DMat3, DVec3};

/// Functions of degrees 0 to 3.
pub const FUNCTIONS: usize = 16;

/// Value of each function in a unit direction. Constants from Kerbl et al., *3D Gaussian Splatting* (2023), as their code has
/// them: the real harmonics with Condon-Shortley phase.
pub fn basis(direction: DVec3) -> [f64; FUNCTIONS] {
    let DVec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let pi = std::f64::consts::PI;
    let root = |numerator: f64, denominator: f64| (numerator / (denominator * pi)).sqrt();
    [
        root(1.0, 4.0),
        -root(3.0, 4.0) * y,
        root(3.0, 4.0) * z,
        -root(3.0, 4.0) * x,
        root(15.0, 4.0) * x * y,
        -root(15.0, 4.0) * y * z,
        root(5.0, 16.0) * (2.0 * zz - xx - yy),
        -root(15.0, 4.0) * x * z,
        root(15.0, 16.0) * (xx - yy),
        -root(35.0, 32.0) * y * (3.0 * xx - yy),
        root(105.0, 4.0) * x * y * z,
        -root(21.0, 32.0) * y * (4.0 * zz - xx - yy),
        root(7.0, 16.0) * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -root(21.0, 32.0) * x * (4.0 * zz - xx - yy),
        root(105.0, 16.0) * z * (xx - yy),
        -root(35.0, 32.0) * x * (xx - 3.0 * yy),
    ]
}

/// Sign that each coefficient takes when the world's y and z change sign, a half turn about x: -1 for the functions that are
/// odd in y and z together.
pub const HALF_TURN_ABOUT_X: [f32; FUNCTIONS] =
    [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0];

/// A matrix for coefficients: new\[i\] = sum over j of `matrix[i][j]` old\[j\], so that the new function in a rotated direction is
/// the old one in the direction itself.
pub fn rotation(new_from_old: DMat3) -> [[f64; FUNCTIONS]; FUNCTIONS] {
    // The integral over the sphere of basis i (d) basis j (rotated-back d), which a product rule takes exactly: polynomials
    // of degree 6 at most, 4 Gauss-Legendre heights (exact to degree 7) times 8 angles (exact to degree 7).
    let (inner, outer) = ((3.0 - 2.0 * 1.2f64.sqrt()) / 7.0, (3.0 + 2.0 * 1.2f64.sqrt()) / 7.0);
    let (heavy, light) = ((18.0 + 30f64.sqrt()) / 36.0, (18.0 - 30f64.sqrt()) / 36.0);
    let heights = [(inner.sqrt(), heavy), (-inner.sqrt(), heavy), (outer.sqrt(), light), (-outer.sqrt(), light)];
    let mut out = [[0.0; FUNCTIONS]; FUNCTIONS];
    for (z, weight) in heights {
        for step in 0..8 {
            let angle = std::f64::consts::TAU * step as f64 / 8.0;
            let radius = (1.0 - z * z).sqrt();
            let direction = DVec3::new(radius * angle.cos(), radius * angle.sin(), z);
            let (new, old) = (basis(direction), basis(new_from_old.transpose() * direction));
            for i in 0..FUNCTIONS {
                for j in 0..FUNCTIONS {
                    out[i][j] += weight * std::f64::consts::TAU / 8.0 * new[i] * old[j];
                }
            }
        }
    }
    out
}

/// Coefficients of three colours through such a matrix.
pub fn mixed(matrix: &[[f64; FUNCTIONS]; FUNCTIONS], sh: &[[f32; 3]; FUNCTIONS]) -> [[f32; 3]; FUNCTIONS] {
    std::array::from_fn(|i| {
        std::array::from_fn(|c| (0..FUNCTIONS).map(|j| matrix[i][j] * f64::from(sh[j][c])).sum::<f64>() as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn value(coefficients: &[f64; FUNCTIONS], direction: DVec3) -> f64 {
        basis(direction).iter().zip(coefficients).map(|(b, c)| b * c).sum()
    }

    fn some() -> [f64; FUNCTIONS] {
        std::array::from_fn(|i| (1.7 * i as f64).sin())
    }

    #[test]
    fn rotated_coefficients_are_the_function_rotated() {
        let turn = DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize());
        let matrix = rotation(turn);
        let turned: [f64; FUNCTIONS] = std::array::from_fn(|i| matrix[i].iter().zip(&some()).map(|(m, c)| m * c).sum());
        for direction in [DVec3::X, DVec3::new(0.3, -0.8, 0.5).normalize(), DVec3::new(-0.6, 0.1, -0.9).normalize()] {
            assert!((value(&turned, turn * direction) - value(&some(), direction)).abs() < 1e-12);
        }
    }

    #[test]
    fn the_half_turn_is_a_rotation() {
        let matrix = rotation(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
        for i in 0..FUNCTIONS {
            for j in 0..FUNCTIONS {
                let expected = if i == j { f64::from(HALF_TURN_ABOUT_X[i]) } else { 0.0 };
                assert!((matrix[i][j] - expected).abs() < 1e-12, "{i} {j}: {}", matrix[i][j]);
            }
        }
    }
}
