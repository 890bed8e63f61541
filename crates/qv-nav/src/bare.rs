//! An eye that knows the shape of a place and not how it looks: what one has without a splat. It draws the collision geometry in flat colours.

use crate::NavError;
use crate::eye::SplatEye;
use glam::DVec3;
use qv_core::random::Xoshiro256PlusPlus;
use qv_core::{GaussianCloud, TriangleMesh, sow};
use serde::{Deserialize, Serialize};

/// How bare geometry is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Bare {
    /// Metres between Gaussians on the surface, see [`sow`].
    pub spacing: f64,
    /// How many paints there are; an episode has one of them. The first is grey. In the others each surface has a colour that is drawn: one for
    /// each label and each of six directions that it may look to.
    pub paints: usize,
}

impl Default for Bare {
    fn default() -> Self {
        Self { spacing: 0.06, paints: 8 }
    }
}

/// Least and greatest brightness of a colour that is drawn, and the deviation of the logarithm of single channels.
const LEVELS: [f32; 2] = [0.15, 0.85];
const HUE: f32 = 0.2;
/// Gaussians beyond which a spacing is taken for an error.
const MOST: f64 = 4e6;

impl SplatEye {
    /// Over the bare geometry of a place; cones look as they always do.
    ///
    /// # Errors
    /// When the mesh is not valid, or a setting means nothing.
    pub fn bare(mesh: &TriangleMesh, bare: &Bare, seed: u64) -> Result<Self, NavError> {
        mesh.validate().map_err(|error| NavError::value("mesh", "a valid one", error))?;
        let area: f64 = (0..mesh.triangles.len()).map(|t| 0.5 * cross(mesh, t).length()).sum();
        if !(bare.spacing > 0.0 && area / bare.spacing.powi(2) <= MOST) {
            let expected = format!("metres, for at most {MOST:e} Gaussians on {area:.0} m^2");
            return Err(NavError::value("spacing", &expected, bare.spacing));
        }
        if !(1..=256).contains(&bare.paints) {
            return Err(NavError::value("paints", "1 to 256", bare.paints));
        }
        Ok(Self::over((0..bare.paints).map(|index| cloud(mesh, bare.spacing, (index, seed))).collect()))
    }
}

/// The surface in one paint.
fn cloud(mesh: &TriangleMesh, spacing: f64, (index, seed): (usize, u64)) -> GaussianCloud {
    let mut random = Xoshiro256PlusPlus::of(seed, 96, index as u64);
    let labels = 1 + mesh.labels.iter().copied().max().map_or(0, usize::from);
    let colours: Vec<[f64; 3]> = (0..6 * labels)
        .map(|_| {
            let level = random.between(LEVELS[0], LEVELS[1]);
            [0; 3].map(|_| f64::from(level * (HUE * random.normal()).exp()))
        })
        .collect();
    sow(mesh, spacing, |t, _| {
        let normal = cross(mesh, t).normalize();
        let label = mesh.labels.get(t).copied().map_or(0, usize::from);
        let shown = if index == 0 { [0.6; 3] } else { colours[6 * label + side(normal)] };
        shown.map(|c| (c * (0.9 + 0.1 * normal.z)).clamp(0.0, 1.0))
    })
}

fn cross(mesh: &TriangleMesh, t: usize) -> DVec3 {
    let [a, b, c] = mesh.corners(t);
    (b - a).cross(c - a)
}

/// Which of six directions a normal is nearest to.
fn side(normal: DVec3) -> usize {
    let n = normal.to_array();
    let axis = (0..3).max_by(|&a, &b| n[a].abs().total_cmp(&n[b].abs())).unwrap_or(2);
    2 * axis + usize::from(n[axis] < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eye::{Eye, Shot};
    use crate::facts::States;
    use crate::net::{HEIGHT, WIDTH};
    use crate::sight::{Cone, Rig};
    use qv_core::Pose;

    /// A floor, and a wall across it at x = 3 m that looks back.
    fn place() -> TriangleMesh {
        let floor = [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let wall = [(4.0, 0.0), (-4.0, 0.0), (-4.0, 2.0), (4.0, 2.0)].map(|(y, z)| DVec3::new(3.0, y, z));
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        TriangleMesh { vertices: [floor, wall].concat(), triangles, ..Default::default() }
    }

    /// Colours of the pixel at the upper and at the lower edge, and whether a cone of the goal's red is seen.
    fn seen(eye: &SplatEye, seed: u64) -> ([Vec<f32>; 2], bool) {
        let camera = Rig::default().camera(&Pose::from_xyz_rpy([0.0, 0.0, 0.3], [0.0; 3]));
        let cones = vec![Cone { place: [1.5, 0.0, 0.0], height: 0.45, colour: 0, look: 1, turn: 0.0 }];
        let picture = eye.look(&[Shot { camera, cones, seed }]).unwrap().swap_remove(0);
        let at = |row: usize| picture[3 * (row * WIDTH + 5)..][..3].to_vec();
        let red = picture.chunks_exact(3).filter(|p| p[0] > 3.0 * p[1] && p[0] > 3.0 * p[2]).count();
        ([at(1), at(HEIGHT - 2)], red > 40)
    }

    #[test]
    fn surfaces_are_grey_or_one_drawn_colour_each_and_cones_are_cones() {
        let eye = SplatEye::bare(&place(), &Bare { spacing: 0.05, paints: 3 }, 7).unwrap();
        let grey = |p: &[f32]| (p[0] - p[1]).abs() < 0.01 && (p[1] - p[2]).abs() < 0.01 && (0.4..0.7).contains(&p[0]);
        let ([wall, floor], cone) = seen(&eye, 0);
        assert!(grey(&wall) && grey(&floor) && cone, "{wall:?} {floor:?} {cone}");
        let painted = [1, 2].map(|k| seen(&eye, k << 8));
        for ([wall, floor], cone) in &painted {
            assert!(!grey(wall) && wall != floor && *cone, "{wall:?} {floor:?}");
        }
        assert_ne!(painted[0], painted[1]);
        let again = SplatEye::bare(&place(), &Bare { spacing: 0.05, paints: 3 }, 7).unwrap();
        assert_eq!(seen(&again, 1 << 8), painted[0], "the same bits of the same seed");
    }

    #[test]
    fn what_means_nothing_is_refused() {
        let said = |mesh: &TriangleMesh, bare: Bare| SplatEye::bare(mesh, &bare, 0).err().unwrap().to_string();
        for spacing in [0.0, -1.0, f64::NAN, 1e-5] {
            assert!(said(&place(), Bare { spacing, ..Bare::default() }).states("spacing"));
        }
        assert!(said(&place(), Bare { paints: 0, ..Bare::default() }).states("paints 1 256 0"));
        let torn = TriangleMesh { triangles: vec![[0, 1, 99]], ..place() };
        assert!(said(&torn, Bare::default()).states("valid"));
    }
}
