//! Mass properties of merged bodies.

use glam::{DMat3, DVec3};
use qv_core::Pose;

/// Mass \[kg\], centre \[m\] and inertia about the centre \[kg m²\] in one frame.
#[derive(Debug, Clone, Copy)]
pub struct MassProperties {
    /// \[kg\]
    pub mass: f64,
    /// \[m\]
    pub com: DVec3,
    /// \[kg m²\]
    pub inertia: DMat3,
}

impl MassProperties {
    pub(crate) const ZERO: Self = Self { mass: 0.0, com: DVec3::ZERO, inertia: DMat3::ZERO };

    /// The same body seen from frame `a`.
    pub(crate) fn transformed(&self, a_from_b: &Pose) -> Self {
        let rotation = a_from_b.matrix();
        Self {
            mass: self.mass,
            com: a_from_b.transform_point(self.com),
            inertia: rotation * self.inertia * rotation.transpose(),
        }
    }

    /// Two bodies of one frame welded together (parallel-axis theorem).
    pub(crate) fn welded(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        if mass <= 0.0 {
            return Self::ZERO;
        }
        let com = (self.com * self.mass + other.com * other.mass) / mass;
        let inertia = self.about(com) + other.about(com);
        Self { mass, com, inertia }
    }

    fn about(&self, point: DVec3) -> DMat3 {
        self.inertia + point_inertia(self.mass, self.com - point)
    }
}

/// A payload on a link.
#[derive(Debug, Clone, Copy)]
pub struct Payload {
    /// \[kg\]; negative to take away.
    pub mass: f64,
    /// Where it is, in the link frame \[m\].
    pub at: DVec3,
    /// Its first moment about that place \[kg m\]: it lies at `at + moment / mass`. A place is linear in it where the mass is not known.
    pub moment: DVec3,
}

/// A payload lies no farther from its place than this, whatever its moment \[m\]: with little mass a moment is a shift of the centre of mass,
/// and the second moment `moment² / mass` would have no end.
const REACH: f64 = 1.0;

impl Payload {
    /// The body welded to it. Second moments about any point add up: those of the body, and
    /// `m d d' + d p' + p d' + p p' / m` for a mass m whose place is d and whose moment about that is p.
    pub fn on(&self, body: &MassProperties) -> MassProperties {
        let mass = body.mass + self.mass;
        if mass <= 0.0 || (self.mass == 0.0 && self.moment == DVec3::ZERO) {
            return MassProperties { mass, ..*body };
        }
        let com = (body.com * body.mass + self.at * self.mass + self.moment) / mass;
        let (d, p) = (self.at - com, self.moment);
        let mut inertia = body.about(com) + point_inertia(self.mass, d);
        if p != DVec3::ZERO {
            let spread = self.mass.max((p.length() / REACH).min(mass));
            inertia += point_inertia(1.0, d + p) - point_inertia(1.0, d) + point_inertia(1.0 / spread - 1.0, p);
        }
        MassProperties { mass, com, inertia }
    }
}

/// Inertia of a point mass at `d` from the reference point: m (|d|² 1 - d dᵀ).
pub(crate) fn point_inertia(mass: f64, d: DVec3) -> DMat3 {
    let outer = DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    (DMat3::IDENTITY * d.length_squared() - outer) * mass
}

/// Whether a symmetric matrix is positive definite (leading minors, Sylvester).
pub(crate) fn positive_definite(m: &DMat3) -> bool {
    let minor = m.x_axis.x * m.y_axis.y - m.x_axis.y * m.y_axis.x;
    m.x_axis.x > 0.0 && minor > 0.0 && m.determinant() > 0.0
}

/// Whether a body can have this inertia: all zero (a point), or positive definite with no principal moment above the sum of
/// the others, but for 2 % of rounding in files.
pub(crate) fn is_of_a_body(m: &DMat3) -> bool {
    if *m == DMat3::ZERO {
        return true;
    }
    let trace = m.x_axis.x + m.y_axis.y + m.z_axis.z;
    positive_definite(m) && positive_definite(&(DMat3::IDENTITY * (0.51 * trace) - *m))
}

/// Principal moments, least first.
pub(crate) fn principal_moments(m: &DMat3) -> [f64; 3] {
    principal(m).0
}

/// The inertia of a body that is nearest in the Frobenius norm, made positive definite: its axes stay, its principal moments
/// are projected on those that meet the triangle inequality. Zero where the nearest is zero.
pub(crate) fn nearest_of_a_body(m: &DMat3) -> DMat3 {
    /// Of a rod, what its thickness adds: that of one a thousand times as long as it is thick.
    const THICKNESS: f64 = 1e-6;
    let ([a, b, c], axes) = principal(m);
    let excess = ((c - a - b) / 3.0).max(0.0);
    let face = [a + excess, b + excess, c - excess];
    // Below a least moment of zero the nearest point lies on the edge of the cone: a rod along the first axis.
    let mean = (0.5 * (b + c)).max(0.0);
    let [a, b, c] = if face[0] >= 0.0 { face } else { [0.0, mean, mean] };
    let thin = THICKNESS * (a + b + c);
    let diagonal = if a > thin { DVec3::new(a, b, c) } else { DVec3::new(a + thin, b + thin, c + thin) };
    let whole = axes * DMat3::from_diagonal(diagonal) * axes.transpose();
    // Exactly symmetric, whatever rounding left.
    (whole + whole.transpose()) * 0.5
}

/// Eigenvalues, least first, and eigenvectors as columns, of a symmetric matrix (Jacobi's rotations).
fn principal(m: &DMat3) -> ([f64; 3], DMat3) {
    // Each sweep squares what is left off the diagonal: a handful reaches the last bit.
    const SWEEPS: usize = 16;
    let mut a = *m;
    let mut axes = DMat3::IDENTITY;
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(q)[p];
            if off == 0.0 {
                continue;
            }
            let angle = 0.5 * (2.0 * off).atan2(a.col(q)[q] - a.col(p)[p]);
            let (sin, cos) = angle.sin_cos();
            let mut turn = DMat3::IDENTITY;
            (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (cos, cos);
            (turn.col_mut(q)[p], turn.col_mut(p)[q]) = (sin, -sin);
            a = turn.transpose() * a * turn;
            axes *= turn;
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a.col(i)[i].total_cmp(&a.col(j)[j]));
    let [i, j, k] = order;
    ([a.col(i)[i], a.col(j)[j], a.col(k)[k]], DMat3::from_cols(axes.col(i), axes.col(j), axes.col(k)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_points_make_a_dumbbell() {
        let ball = MassProperties { mass: 1.0, com: DVec3::X, inertia: DMat3::ZERO };
        let other = MassProperties { mass: 1.0, com: -DVec3::X, inertia: DMat3::ZERO };
        let both = ball.welded(&other);
        assert_eq!((both.mass, both.com), (2.0, DVec3::ZERO));
        assert_eq!(both.inertia, DMat3::from_diagonal(DVec3::new(0.0, 2.0, 2.0)));
    }

    #[test]
    fn principal_axes_make_the_matrix_again() {
        let turned = Pose::from_xyz_rpy([0.0; 3], [0.3, -0.7, 1.9]).matrix();
        let m = turned * DMat3::from_diagonal(DVec3::new(3.0, -1.0, 2.0)) * turned.transpose();
        let (moments, axes) = principal(&m);
        for (found, right) in moments.iter().zip([-1.0, 2.0, 3.0]) {
            assert!((found - right).abs() < 1e-14, "{moments:?}");
        }
        let again = axes * DMat3::from_diagonal(DVec3::from_array(moments)) * axes.transpose();
        assert!((again - m).to_cols_array().iter().all(|x| x.abs() < 1e-14));
    }

    /// The nearest point of the cone, against a search over all of it.
    #[test]
    fn the_nearest_inertia_of_a_body() {
        for moments in [[1.0, 1.0, 3.0], [-1.0, 2.0, 2.0], [-0.1, 1.0, 4.0], [0.0, 0.0, 3.0], [0.2, 0.5, 0.6]] {
            let turned = Pose::from_xyz_rpy([0.0; 3], [1.0, 0.2, -0.4]).matrix();
            let m = turned * DMat3::from_diagonal(DVec3::from_array(moments)) * turned.transpose();
            let nearest = nearest_of_a_body(&m);
            assert!(is_of_a_body(&nearest), "{moments:?} -> {nearest}");
            let distance = |x: [f64; 3]| (0..3).map(|i| (x[i] - moments[i]).powi(2)).sum::<f64>().sqrt();
            let found = distance(principal_moments(&nearest));
            let steps = 80_usize;
            let second = |i: usize| 3.0 * i as f64 / steps as f64;
            let mut best = f64::INFINITY;
            for (i, j, k) in (0..steps.pow(3)).map(|n| (n % steps, n / steps % steps, n / steps / steps)) {
                let (x, y, z) = (second(i), second(j), second(k));
                best = best.min(distance([y + z, x + z, x + y]));
            }
            assert!(found < best + 1e-4, "{moments:?}: {found} against {best}");
        }
        assert_eq!(nearest_of_a_body(&-DMat3::IDENTITY), DMat3::ZERO);
    }

    #[test]
    fn definiteness() {
        assert!(positive_definite(&DMat3::IDENTITY));
        assert!(!positive_definite(&DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0))));
    }
}
