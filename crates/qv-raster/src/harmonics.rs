//! Real spherical harmonics to degree 3, in the order and with the signs of Kerbl et al. (2023) and gsplat.

use glam::Vec3;

const C0: f32 = 0.282_094_79;
const C1: f32 = 0.488_602_51;
const C2: [f32; 3] = [1.092_548_4, 0.315_391_57, 0.546_274_2];
const C3: [f32; 5] = [0.590_043_6, 2.890_611_4, 0.457_045_8, 0.373_176_34, 1.445_305_7];

/// Values of the first `(degree + 1)²` functions in a unit direction; the rest are 0.
pub fn basis(degree: u8, direction: Vec3) -> [f32; 16] {
    let Vec3 { x, y, z } = direction;
    let mut out = [0.0; 16];
    out[0] = C0;
    if degree == 0 {
        return out;
    }
    out[1] = -C1 * y;
    out[2] = C1 * z;
    out[3] = -C1 * x;
    if degree == 1 {
        return out;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    out[4] = C2[0] * x * y;
    out[5] = -C2[0] * y * z;
    out[6] = C2[1] * (2.0 * zz - xx - yy);
    out[7] = -C2[0] * x * z;
    out[8] = C2[2] * (xx - yy);
    if degree == 2 {
        return out;
    }
    out[9] = -C3[0] * y * (3.0 * xx - yy);
    out[10] = C3[1] * x * y * z;
    out[11] = -C3[2] * y * (4.0 * zz - xx - yy);
    out[12] = C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
    out[13] = -C3[2] * x * (4.0 * zz - xx - yy);
    out[14] = C3[4] * z * (xx - yy);
    out[15] = -C3[0] * x * (xx - 3.0 * yy);
    out
}

/// Derivatives of [`basis`], taken as polynomials, with respect to the direction.
pub fn basis_gradient(degree: u8, direction: Vec3) -> [Vec3; 16] {
    let Vec3 { x, y, z } = direction;
    let mut out = [Vec3::ZERO; 16];
    if degree == 0 {
        return out;
    }
    out[1] = Vec3::new(0.0, -C1, 0.0);
    out[2] = Vec3::new(0.0, 0.0, C1);
    out[3] = Vec3::new(-C1, 0.0, 0.0);
    if degree == 1 {
        return out;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    out[4] = C2[0] * Vec3::new(y, x, 0.0);
    out[5] = -C2[0] * Vec3::new(0.0, z, y);
    out[6] = C2[1] * Vec3::new(-2.0 * x, -2.0 * y, 4.0 * z);
    out[7] = -C2[0] * Vec3::new(z, 0.0, x);
    out[8] = C2[2] * Vec3::new(2.0 * x, -2.0 * y, 0.0);
    if degree == 2 {
        return out;
    }
    out[9] = -C3[0] * Vec3::new(6.0 * x * y, 3.0 * xx - 3.0 * yy, 0.0);
    out[10] = C3[1] * Vec3::new(y * z, x * z, x * y);
    out[11] = -C3[2] * Vec3::new(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z);
    out[12] = C3[3] * Vec3::new(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * xx - 3.0 * yy);
    out[13] = -C3[2] * Vec3::new(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z);
    out[14] = C3[4] * Vec3::new(2.0 * x * z, -2.0 * y * z, xx - yy);
    out[15] = -C3[0] * Vec3::new(3.0 * xx - 3.0 * yy, -6.0 * x * y, 0.0);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_orthonormal_on_the_sphere() {
        // Gauss-Legendre in z (exact to degree 7) times 16 longitudes integrates products of degree 6 exactly.
        let nodes = [(0.861_136_3, 0.347_854_85), (0.339_981_04, 0.652_145_15)];
        let mut product = [[0.0f64; 16]; 16];
        for (z, weight) in nodes.iter().flat_map(|&(z, w): &(f32, f64)| [(z, w), (-z, w)]) {
            for k in 0..16 {
                let angle = k as f32 * std::f32::consts::TAU / 16.0;
                let r = (1.0 - z * z).sqrt();
                let b = basis(3, Vec3::new(r * angle.cos(), r * angle.sin(), z));
                for i in 0..16 {
                    for j in 0..16 {
                        product[i][j] += weight * std::f64::consts::TAU / 16.0 * (b[i] * b[j]) as f64;
                    }
                }
            }
        }
        for i in 0..16 {
            for j in 0..16 {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((product[i][j] - expected).abs() < 1e-5, "{i} {j}: {}", product[i][j]);
            }
        }
    }

    #[test]
    fn gradients_are_those_of_the_values() {
        let at = Vec3::new(0.3, -0.5, 0.8);
        let h = 1e-2;
        let gradient = basis_gradient(3, at);
        for axis in 0..3 {
            let step = Vec3::AXES[axis] * h;
            let (plus, minus) = (basis(3, at + step), basis(3, at - step));
            for i in 0..16 {
                let difference = (plus[i] - minus[i]) / (2.0 * h);
                assert!((difference - gradient[i][axis]).abs() < 1e-3, "{i} {axis}: {difference} {}", gradient[i]);
            }
        }
    }
}
