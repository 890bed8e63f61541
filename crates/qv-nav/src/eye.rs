//! What draws the pictures: the trait, and an eye that draws Gaussians.

use crate::NavError;
use crate::net::{HEIGHT, WIDTH};
use crate::sight::{COLOURS, Cone};
use glam::{DMat3, DQuat, DVec3};
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Scene, Settings, View, render};
use std::f64::consts::TAU;

/// One picture to be drawn.
#[derive(Debug, Clone)]
pub struct Shot {
    /// The camera, of [`WIDTH`] x [`HEIGHT`].
    pub camera: Camera,
    /// What stands in the place.
    pub cones: Vec<Cone>,
}

/// Draws pictures.
pub trait Eye: Sync {
    /// For each shot red, green, blue as shown, 0 to 1, shape `[HEIGHT, WIDTH, 3]`; without what the camera model adds.
    ///
    /// # Errors
    /// When a picture cannot be drawn.
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError>;
}

/// An eye that is a function of one shot: for renderers that this crate does not know.
pub struct FnEye<F>(pub F);

impl<F: Fn(&Shot) -> Vec<f32> + Sync> Eye for FnEye<F> {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        Ok(shots.iter().map(&self.0).collect())
    }
}

/// An eye that sees grey everywhere: for a policy that must do without.
pub struct BlindEye;

impl Eye for BlindEye {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        Ok(shots.iter().map(|_| vec![0.5; WIDTH * HEIGHT * 3]).collect())
    }
}

/// Linear colours of the cones, red, green, blue.
pub const LINEAR: [[f64; 3]; 3] = [[0.70, 0.04, 0.03], [0.03, 0.10, 0.60], [0.80, 0.55, 0.02]];
/// Looks of each colour in [`SplatEye`]: brightness, and the factor on the middle channel, which turns the hue by up to 5 degrees.
const LOOKS: [(f64, f64); 4] = [(0.55, 1.0), (0.85, 1.3), (1.1, 0.75), (1.5, 1.0)];

/// Draws a cloud of Gaussians with cones in it, on the CPU. Cones are Gaussians of their own which move as groups; they are all 0.45 m high.
pub struct SplatEye {
    cloud: GaussianCloud,
    group_of: Vec<u32>,
}

impl SplatEye {
    /// Over the cloud of a place.
    pub fn new(place: &GaussianCloud) -> Self {
        let mut cloud = place.clone();
        let mut group_of = vec![0; cloud.len()];
        for colour in 0..COLOURS.len() {
            for (brightness, hue) in LOOKS {
                let group = 1 + group_of.last().copied().unwrap_or(0);
                let linear = LINEAR[colour];
                let middle = if colour == 1 { 1 } else { 2 };
                let shade = |k: usize| brightness * linear[k] * if k == middle { hue } else { 1.0 };
                let count = add_cone(&mut cloud, [shade(0), shade(1), shade(2)]);
                group_of.extend(std::iter::repeat_n(group, count));
            }
        }
        Self { cloud, group_of }
    }

    /// Gaussians that are drawn, those of the cones included.
    pub fn count(&self) -> usize {
        self.cloud.len()
    }

    /// Poses of the cones by group.
    fn groups(cones: &[Cone]) -> Vec<Option<Pose>> {
        let mut groups = vec![None; COLOURS.len() * LOOKS.len()];
        for cone in cones {
            let rotation = DQuat::from_rotation_z(cone.turn);
            let at = cone.colour.min(COLOURS.len() - 1) * LOOKS.len() + cone.look % LOOKS.len();
            groups[at] = Some(Pose { position: DVec3::from(cone.place), rotation });
        }
        groups
    }
}

impl Eye for SplatEye {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        let environments: Vec<Vec<Option<Pose>>> = shots.iter().map(|s| Self::groups(&s.cones)).collect();
        let scene = Scene { cloud: &self.cloud, group_of: &self.group_of, environments: &environments };
        let views: Vec<View> =
            shots.iter().enumerate().map(|(environment, s)| View { camera: s.camera, environment }).collect();
        // Sky, where nothing is: what reconstructions leave empty is most often that.
        let settings = Settings { background: [0.75, 0.82, 0.9], ..Default::default() };
        let (images, _) = render(&scene, &views, &settings)?;
        Ok(images.into_iter().map(|image| image.colour).collect())
    }
}

/// Adds a cone of 0.45 m as flat Gaussians, lit from one side; gives their number.
fn add_cone(cloud: &mut GaussianCloud, linear: [f64; 3]) -> usize {
    const TALL: f64 = 0.45;
    const WIDE: f64 = 0.10;
    const ROWS: usize = 9;
    let sun = DVec3::new(0.57, 0.0, 0.82);
    let before = cloud.len();
    for row in 0..ROWS {
        let up = (row as f64 + 0.5) / ROWS as f64;
        let radius = WIDE * (1.0 - up);
        let around = (TAU * radius / 0.035).round().max(4.0) as usize;
        for k in 0..around {
            let out = DVec3::new((TAU * k as f64 / around as f64).cos(), (TAU * k as f64 / around as f64).sin(), 0.0);
            let normal = (out * TALL + DVec3::Z * WIDE).normalize();
            let across = DVec3::Z.cross(out);
            let axes = DMat3::from_cols(across, normal.cross(across), normal);
            let turn = DQuat::from_mat3(&axes);
            let light = 0.4 + 0.2 * normal.z + 0.7 * normal.dot(sun).max(0.0);
            let shown = linear.map(|c| (c * light).clamp(0.0, 1.0).powf(1.0 / 2.2));
            cloud.means.push((out * radius + DVec3::Z * (up * TALL)).as_vec3().to_array());
            cloud
                .log_scales
                .push([(0.5 * TAU * radius / around as f64).max(0.004), 0.022, 0.002].map(|s| s.ln() as f32));
            cloud.rotations.push([turn.w, turn.x, turn.y, turn.z].map(|q| q as f32));
            cloud.opacity_logits.push(4.0);
            // The first harmonic is 1 / (2 sqrt(pi)).
            cloud.sh.push(shown.map(|c| ((c - 0.5) / 0.282_094_79) as f32));
            cloud.sh.extend(std::iter::repeat_n([0.0; 3], cloud.sh_count() - 1));
            cloud.features.extend(std::iter::repeat_n(0.0, cloud.feature_count));
        }
    }
    cloud.len() - before
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sight::Rig;

    #[test]
    fn a_cone_is_drawn_where_it_stands_in_its_colour() {
        let eye = SplatEye::new(&GaussianCloud::default());
        let base = Pose::from_xyz_rpy([0.0, 0.0, 0.3], [0.0; 3]);
        let camera = Rig::default().camera(&base);
        let cone = |colour, y| Cone { place: [1.5, y, 0.0], height: 0.45, colour, look: 1, turn: 1.0 };
        let shots = [vec![cone(0, 0.0)], vec![cone(1, 0.3)], vec![]];
        let shots: Vec<Shot> = shots.into_iter().map(|cones| Shot { camera, cones }).collect();
        let images = eye.look(&shots).unwrap();
        let like = |image: &[f32], test: fn(&[f32]) -> bool| -> Vec<usize> {
            image.chunks_exact(3).enumerate().filter(|(_, p)| test(p)).map(|(k, _)| k % WIDTH).collect()
        };
        let red = like(&images[0], |p| p[0] > 2.0 * p[1] && p[0] > 2.0 * p[2]);
        let blue = like(&images[1], |p| p[2] > 1.7 * p[0] && p[2] > 1.4 * p[1]);
        let mean = |columns: &[usize]| columns.iter().sum::<usize>() as f64 / columns.len().max(1) as f64;
        assert!(red.len() > 60 && (mean(&red) - 39.5).abs() < 1.5, "{} {}", red.len(), mean(&red));
        // To the left is a smaller column: 0.3 m at 1.2 m.
        assert!(blue.len() > 60 && (mean(&blue) - (39.5 - 76.9 * 0.25)).abs() < 2.0, "{} {}", blue.len(), mean(&blue));
        assert!(images[2].chunks_exact(3).all(|p| p == [0.75, 0.82, 0.9]));
    }
}
