//! Mass properties of merged bodies.

use glam::{DMat3, DVec3};
use qv_core::Pose;

/// Mass \[kg\], centre \[m\] and inertia about the centre \[kg m²\] in one frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MassProperties {
    pub mass: f64,
    pub com: DVec3,
    pub inertia: DMat3,
}

impl MassProperties {
    pub const ZERO: Self = Self { mass: 0.0, com: DVec3::ZERO, inertia: DMat3::ZERO };

    /// The same body seen from frame `a`.
    pub fn transformed(&self, a_from_b: &Pose) -> Self {
        let rotation = a_from_b.matrix();
        Self {
            mass: self.mass,
            com: a_from_b.transform_point(self.com),
            inertia: rotation * self.inertia * rotation.transpose(),
        }
    }

    /// Two bodies of one frame welded together (parallel-axis theorem).
    pub fn welded(&self, other: &Self) -> Self {
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
    fn definiteness() {
        assert!(positive_definite(&DMat3::IDENTITY));
        assert!(!positive_definite(&DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0))));
    }
}
