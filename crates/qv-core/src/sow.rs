//! A mesh's surface sown with flat Gaussians: a splat without a reconstruction.

use crate::{GaussianCloud, TriangleMesh};
use glam::{DMat3, DQuat, DVec3};

/// Thickness of a flat Gaussian: standard deviation along the normal \[m\].
const THIN: f64 = 0.004;
/// The first harmonic: 1 / (2 sqrt(pi)).
const FIRST: f64 = 0.282_094_79;

/// Gaussians about `spacing` apart \[m\] on all triangles that have an area. `colour` is asked for each of them, with the index of its triangle
/// and its place \[m\], and says red, green, blue as shown, 0 to 1.
///
/// They lie on square grids, one for all triangles of a plane. So a mesh whose triangles are smaller than `spacing` and turned a little against
/// each other gets holes.
pub fn sow(mesh: &TriangleMesh, spacing: f64, colour: impl Fn(usize, DVec3) -> [f64; 3]) -> GaussianCloud {
    let mut cloud = GaussianCloud::default();
    for t in 0..mesh.triangles.len() {
        let corners = mesh.corners(t);
        let [a, b, c] = corners;
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
        let side = if normal.z.abs() > 0.9 { DVec3::X } else { DVec3::Z };
        let (u, v) = ((side - normal * side.dot(normal)).normalize(), normal.cross(side).normalize());
        let turn = DQuat::from_mat3(&DMat3::from_cols(u, normal.cross(u), normal));
        for [along, across] in grid(corners.map(|p| [p.dot(u) / spacing, p.dot(v) / spacing])) {
            let point = u * (along * spacing) + v * (across * spacing) + normal * a.dot(normal);
            cloud.means.push(point.as_vec3().to_array());
            cloud.log_scales.push([0.6 * spacing, 0.6 * spacing, THIN].map(|s| s.ln() as f32));
            cloud.rotations.push([turn.w, turn.x, turn.y, turn.z].map(|q| q as f32));
            cloud.opacity_logits.push(4.0);
            cloud.sh.push(colour(t, point).map(|x| ((x - 0.5) / FIRST) as f32));
        }
    }
    cloud
}

/// Middles of the unit squares that lie within a triangle. One on an edge belongs to both triangles of it: it is given twice, which no eye can determine.
fn grid(corners: [[f64; 2]; 3]) -> impl Iterator<Item = [f64; 2]> {
    let ends = move |k: usize| {
        let all = corners.map(|p| p[k]);
        let (low, high) = (all.iter().copied().fold(f64::MAX, f64::min), all.iter().copied().fold(f64::MIN, f64::max));
        (low - 0.5).ceil() as i64..=(high - 0.5).floor() as i64
    };
    let points = ends(0).flat_map(move |i| ends(1).map(move |j| [i as f64 + 0.5, j as f64 + 0.5]));
    points.filter(move |p| {
        let side = |s: [f64; 2], e: [f64; 2]| (e[0] - s[0]) * (p[1] - s[1]) - (e[1] - s[1]) * (p[0] - s[0]);
        let signs = [side(corners[0], corners[1]), side(corners[1], corners[2]), side(corners[2], corners[0])];
        signs.iter().all(|s| *s >= 0.0) || signs.iter().all(|s| *s <= 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussians_lie_in_the_triangle_and_know_it() {
        // A wall of 2 x 1 m as two triangles, and one without an area.
        let vertices = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)].map(|(x, z)| DVec3::new(x, 3.0, z));
        let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 1, 2]];
        let mesh = TriangleMesh { vertices: vertices.to_vec(), triangles, ..Default::default() };
        let cloud = sow(&mesh, 0.1, |t, p| [t as f64, p.x / 2.0, p.z]);
        cloud.check().unwrap();
        // 200 squares, of which those on the common edge count twice.
        assert!((200..=215).contains(&cloud.len()), "{}", cloud.len());
        for (mean, colour) in cloud.means.iter().zip(&cloud.sh) {
            let shown = colour.map(|c| 0.5 + FIRST as f32 * c);
            assert!(mean[1] == 3.0 && (0.0..=2.0).contains(&mean[0]) && (0.0..=1.0).contains(&mean[2]), "{mean:?}");
            assert!((shown[1] - mean[0] / 2.0).abs() < 1e-5 && (shown[2] - mean[2]).abs() < 1e-5, "{shown:?} {mean:?}");
            // The first triangle is below the diagonal.
            let above = mean[2] - mean[0] / 2.0;
            assert!(if shown[0] < 0.5 { above < 1e-6 } else { above > -1e-6 }, "{shown:?} {mean:?}");
        }
        // The thin axis is the normal.
        let [w, x, y, z] = cloud.rotations[0];
        let thin = glam::Quat::from_xyzw(x, y, z, w) * glam::Vec3::Z;
        assert!(thin.y.abs() > 0.9999 && cloud.log_scales[0][2] < cloud.log_scales[0][0]);
    }
}
