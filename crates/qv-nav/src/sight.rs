//! Cones, the camera on the robot, and what of a cone can be seen.

use crate::map::Map;
use crate::net::{HEIGHT, WIDTH};
use glam::{DMat3, DQuat, DVec2, DVec3, EulerRot};
use qv_core::{Camera, Pose};
use serde::{Deserialize, Serialize};

/// Colours that a cone can have.
pub const COLOURS: [&str; 3] = ["red", "blue", "yellow"];
/// Linear colours of these cones, red, green, blue.
pub const LINEAR: [[f64; 3]; 3] = [[0.70, 0.04, 0.03], [0.03, 0.10, 0.60], [0.80, 0.55, 0.02]];

/// A cone that stands upright.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cone {
    /// Centre of its foot in the world \[m\].
    pub place: [f64; 3],
    /// Height \[m\].
    pub height: f64,
    /// Index into [`COLOURS`], or into the goals of the place ([`crate::goals::GoalSet`]).
    pub colour: usize,
    /// How it looks, for an eye that has several looks of each colour.
    pub look: usize,
    /// Turn about the vertical \[rad\], for eyes whose cones have a bright side.
    pub turn: f64,
}

impl Cone {
    /// Radius of its foot \[m\].
    pub fn radius(&self) -> f64 {
        0.10 / 0.45 * self.height
    }

    /// Its axis from above \[m\].
    pub fn axis(&self) -> DVec2 {
        DVec2::new(self.place[0], self.place[1])
    }
}

/// How the camera sits on the robot, and its lens.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// Place of the camera in the base: forwards, to the left, up \[m\].
    pub place: [f64; 3],
    /// Roll, pitch (positive: down), yaw of the camera in the base \[rad\].
    pub turn: [f64; 3],
    /// Focal length in pixels of the camera's own 640 columns.
    pub focal: f64,
    /// Distance of the head's tip before the base's origin \[m\].
    pub head: f64,
}

impl Default for Rig {
    /// It looks down by 17 degrees. Level, a cone's foot leaves the picture a metre before it; its tip is about as high as the camera, so that what is
    /// left of it looks the same at all distances, and nobody could show when to stop.
    fn default() -> Self {
        Self { place: [0.30, 0.0, 0.12], turn: [0.0, 0.30, 0.0], focal: 615.0, head: 0.33 }
    }
}

/// Axes of a camera (right, down, ahead) in those of a mounting (ahead, left, up).
fn level() -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X))
}

impl Rig {
    /// The same robot with its camera at a pose in the base, with OpenCV's axes; `focal` in pixels of 640 columns.
    pub fn mounted(&self, base_from_camera: &Pose, focal: f64) -> Self {
        let (yaw, pitch, roll) = (base_from_camera.rotation * level().inverse()).to_euler(EulerRot::ZYX);
        Self { place: base_from_camera.position.to_array(), turn: [roll, pitch, yaw], focal, ..*self }
    }

    /// Pose of the camera in the base, with OpenCV's axes: x to the right, y down, z ahead.
    pub fn base_from_camera(&self) -> Pose {
        let mounting = Pose::from_xyz_rpy(self.place, self.turn);
        Pose { rotation: (mounting.rotation * level()).normalize(), ..mounting }
    }

    /// The camera of the network's picture for a pose of the base.
    pub fn camera(&self, world_from_base: &Pose) -> Camera {
        let focal = self.focal * WIDTH as f64 / 640.0;
        Camera {
            fx: focal,
            fy: focal,
            cx: 0.5 * WIDTH as f64,
            cy: 0.5 * HEIGHT as f64,
            width: WIDTH as u32,
            height: HEIGHT as u32,
            camera_from_world: (*world_from_base * self.base_from_camera()).inverse(),
        }
    }

    /// The tip of the head from above \[m\].
    pub fn head(&self, world_from_base: &Pose) -> DVec2 {
        let yaw = world_from_base.yaw();
        world_from_base.position.truncate() + self.head * DVec2::new(yaw.cos(), yaw.sin())
    }
}

/// Whether a point lies in the picture.
pub(crate) fn in_frustum(camera: &Camera, point: DVec3) -> bool {
    let p = camera.camera_from_world.transform_point(point);
    let (u, v) = (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
    p.z > 0.05 && u >= 0.0 && v >= 0.0 && u <= f64::from(camera.width) && v <= f64::from(camera.height)
}

/// Rays of nine to points of a cone that are free, and whether those within the picture alone count.
pub(crate) fn free_rays(map: &Map, camera: &Camera, cone: &Cone, in_picture: bool) -> usize {
    let eye = camera.camera_from_world.inverse().position;
    let foot = DVec3::from(cone.place);
    let along = (foot - eye).truncate().normalize_or(DVec2::X);
    let aside = DVec3::new(-along.y, along.x, 0.0);
    let points = (0..9).map(|k| {
        let up = [0.15, 0.5, 0.85][k / 3];
        let wide = [-0.6, 0.0, 0.6][k % 3] * cone.radius() * (1.0 - up);
        foot + DVec3::Z * (up * cone.height) + aside * wide
    });
    points.filter(|p| (!in_picture || in_frustum(camera, *p)) && map.is_free(eye, *p)).count()
}

/// So many rays of nine make a cone seen.
pub const SEEN: usize = 3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cones_foot_is_seen_until_it_is_near() {
        let rig = Rig::default();
        let camera = rig.camera(&Pose::from_xyz_rpy([0.0, 0.0, 0.3], [0.0; 3]));
        let at = |away: f64, up: f64| DVec3::new(rig.place[0] + away, 0.0, up);
        // The head stops about 0.3 m before it; farther off, a tip as high as the camera is in the picture, too.
        assert!(in_frustum(&camera, at(0.55, 0.0)) && in_frustum(&camera, at(3.0, 0.45)));
        let level = Rig { turn: [0.0, 0.05, 0.0], ..rig }.camera(&Pose::from_xyz_rpy([0.0, 0.0, 0.3], [0.0; 3]));
        assert!(!in_frustum(&level, at(0.9, 0.0)), "a level camera loses it a metre before");
    }

    #[test]
    fn a_mounting_is_its_pose() {
        let rig = Rig { turn: [0.02, 0.4, -0.3], ..Rig::default() };
        let again = Rig::default().mounted(&rig.base_from_camera(), rig.focal);
        assert!((0..3).all(|k| (again.turn[k] - rig.turn[k]).abs() < 1e-12), "{again:?}");
        assert_eq!((again.place, again.focal, again.head), (rig.place, rig.focal, rig.head));
    }

    #[test]
    fn the_camera_looks_ahead_and_down() {
        let rig = Rig::default();
        let base = Pose::from_xyz_rpy([1.0, 2.0, 0.3], [0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let camera = rig.camera(&base);
        camera.check().unwrap();
        let eye = camera.camera_from_world.inverse();
        assert!((eye.position - DVec3::new(1.0, 2.3, 0.42)).length() < 1e-12);
        let ahead = eye.transform_vector(DVec3::Z);
        assert!(ahead.y > 0.95 && (ahead.z + 0.30f64.sin()).abs() < 1e-12, "{ahead}");
        assert!(eye.transform_vector(DVec3::X).x > 0.99, "right is right");
        assert!(in_frustum(&camera, DVec3::new(1.0, 5.0, 0.2)) && !in_frustum(&camera, DVec3::new(1.0, 0.0, 0.2)));
        assert!((rig.head(&base) - DVec2::new(1.0, 2.33)).length() < 1e-12);
    }
}
