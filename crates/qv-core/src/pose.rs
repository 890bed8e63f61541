//! Rigid transforms.

use glam::{DMat3, DQuat, DVec3};

/// A rigid transform `a_from_b`: rotation followed by translation, metres.
///
/// Name every value for its frames: `world_from_base.transform_point(point_in_base)` is a point in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin of frame `b` in frame `a` \[m\].
    pub position: DVec3,
    /// Rotation taking directions in `b` to directions in `a` (unit quaternion).
    pub rotation: DQuat,
}

impl Pose {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self { position: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// From a position \[m\] and a quaternion `w, x, y, z`, which is normalised. A zero or non-finite quaternion
    /// gives `None`.
    pub fn from_position_wxyz(position: [f64; 3], wxyz: [f64; 4]) -> Option<Self> {
        let [w, x, y, z] = wxyz;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let position = DVec3::from_array(position);
        let length = rotation.length();
        if !position.is_finite() || !length.is_finite() || length < 1e-9 {
            return None;
        }
        Some(Self { position, rotation: rotation / length })
    }

    /// From a translation \[m\] and URDF roll, pitch, yaw \[rad\] about fixed axes x, y, z.
    pub fn from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Self {
        let rotation = DQuat::from_rotation_z(rpy[2]) * DQuat::from_rotation_y(rpy[1]) * DQuat::from_rotation_x(rpy[0]);
        Self { position: DVec3::from_array(xyz), rotation }
    }

    /// The quaternion as `w, x, y, z`.
    pub fn wxyz(&self) -> [f64; 4] {
        [self.rotation.w, self.rotation.x, self.rotation.y, self.rotation.z]
    }

    /// The rotation as a matrix.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// `b_from_a` of this `a_from_b`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { position: -(rotation * self.position), rotation }
    }

    /// Point in `b` to point in `a` \[m\].
    pub fn transform_point(&self, point_in_b: DVec3) -> DVec3 {
        self.rotation * point_in_b + self.position
    }

    /// Direction in `b` to direction in `a`.
    pub fn transform_vector(&self, vector_in_b: DVec3) -> DVec3 {
        self.rotation * vector_in_b
    }

    /// Yaw \[rad\]: heading of the x axis of `b` in the xy plane of `a`.
    pub fn yaw(&self) -> f64 {
        let heading = self.rotation * DVec3::X;
        heading.y.atan2(heading.x)
    }
}

impl std::ops::Mul for Pose {
    type Output = Self;
    /// `a_from_b * b_from_c = a_from_c`.
    fn mul(self, b_from_c: Self) -> Self {
        Self {
            position: self.transform_point(b_from_c.position),
            rotation: (self.rotation * b_from_c.rotation).normalize(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn off_axis() -> Pose {
        Pose::from_position_wxyz([0.3, -1.0, 2.0], [0.5, 0.4, -0.7, 0.2]).unwrap()
    }

    #[test]
    fn inverse_undoes() {
        let point = DVec3::new(0.1, 0.2, 0.3);
        let back = off_axis().inverse().transform_point(off_axis().transform_point(point));
        assert!((back - point).length() < 1e-14);
    }

    #[test]
    fn quaternion_order_is_w_first() {
        let quarter_turn_about_z =
            Pose::from_position_wxyz([0.0; 3], [0.5f64.sqrt(), 0.0, 0.0, 0.5f64.sqrt()]).unwrap();
        assert!((quarter_turn_about_z.transform_vector(DVec3::X) - DVec3::Y).length() < 1e-14);
        assert!((quarter_turn_about_z.yaw() - std::f64::consts::FRAC_PI_2).abs() < 1e-14);
    }

    #[test]
    fn rpy_turns_about_fixed_axes() {
        let pose = Pose::from_xyz_rpy([0.0; 3], [0.3, -0.4, 1.1]);
        let expected = DMat3::from_rotation_z(1.1) * DMat3::from_rotation_y(-0.4) * DMat3::from_rotation_x(0.3);
        assert!((pose.matrix().x_axis - expected.x_axis).length() < 1e-14);
        assert!((pose.matrix().z_axis - expected.z_axis).length() < 1e-14);
    }

    #[test]
    fn bad_quaternions_are_refused() {
        assert!(Pose::from_position_wxyz([0.0; 3], [0.0; 4]).is_none());
        assert!(Pose::from_position_wxyz([0.0; 3], [f64::NAN, 0.0, 0.0, 1.0]).is_none());
        assert!(Pose::from_position_wxyz([f64::INFINITY, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]).is_none());
    }
}
