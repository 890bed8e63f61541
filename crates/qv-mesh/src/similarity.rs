//! From the frame of a reconstruction to metres with z up.

use crate::error::off;
use crate::{DepthFrame, MeshError};
use glam::{DMat3, DQuat, DVec3};
use qv_core::{Pose, TriangleMesh};

/// Scale, then rotation, then translation: `a_from_b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Lengths in `a` per length in `b`.
    pub scale: f64,
    /// Rotation and translation, the latter in the units of `a`.
    pub pose: Pose,
}

impl Similarity {
    /// Changes nothing.
    pub const IDENTITY: Self = Self { scale: 1.0, pose: Pose::IDENTITY };

    /// A point in `b` as one in `a`.
    pub fn transform_point(&self, point_in_b: DVec3) -> DVec3 {
        self.pose.transform_point(self.scale * point_in_b)
    }

    /// `b_from_a` of this `a_from_b`.
    pub fn inverse(&self) -> Self {
        let rotation = self.pose.rotation.conjugate();
        let scale = 1.0 / self.scale;
        Self { scale, pose: Pose { position: -(rotation * self.pose.position) * scale, rotation } }
    }

    /// `a_from_b` after `b_from_c`.
    pub fn after(&self, b_from_c: &Self) -> Self {
        let moved = Pose { position: self.scale * b_from_c.pose.position, rotation: b_from_c.pose.rotation };
        Self { scale: self.scale * b_from_c.scale, pose: self.pose * moved }
    }

    /// Moves a mesh from `b` to `a`.
    pub fn apply(&self, mesh: &mut TriangleMesh) {
        mesh.vertices.iter_mut().for_each(|v| *v = self.transform_point(*v));
    }

    /// The pose of a camera in `a`, which looks from the same place at the same things; both are of the world to the camera.
    pub fn of_camera(&self, camera_from_b: &Pose) -> Pose {
        let rotation = (camera_from_b.rotation * self.pose.rotation.conjugate()).normalize();
        Pose { position: self.scale * camera_from_b.position - rotation * self.pose.position, rotation }
    }

    /// Moves a depth frame from `b` to `a`: its camera and its depths.
    pub fn apply_to_frame(&self, frame: &mut DepthFrame) {
        frame.camera.camera_from_world = self.of_camera(&frame.camera.camera_from_world);
        frame.depth.iter_mut().for_each(|depth| *depth = (f64::from(*depth) * self.scale) as f32);
    }

    /// `metric_from_scene` such that two points of the scene are a known distance apart \[m\].
    ///
    /// # Errors
    /// The distance is not positive, or the points are the same.
    pub fn from_distance(a: DVec3, b: DVec3, metres: f64) -> Result<Self, MeshError> {
        let found = a.distance(b);
        if !(metres.is_finite() && metres > 0.0 && found.is_finite() && found > 0.0) {
            let expected = "two different points and a positive distance";
            return Err(off("known distance", expected, format!("{metres} m between {a} and {b}")));
        }
        Ok(Self { scale: metres / found, pose: Pose::IDENTITY })
    }

    /// Turns a direction of the scene, such as that against gravity, to z.
    ///
    /// # Errors
    /// It has no length.
    pub fn from_up(up: DVec3) -> Result<Self, MeshError> {
        let up = up.try_normalize().ok_or_else(|| off("direction up", "a direction", up))?;
        let rotation = if up.z < -1.0 + 1e-12 {
            DQuat::from_rotation_x(std::f64::consts::PI)
        } else {
            DQuat::from_rotation_arc(up, DVec3::Z)
        };
        Ok(Self { scale: 1.0, pose: Pose { position: DVec3::ZERO, rotation } })
    }

    /// The similarity with the least squared distances from `to` to the moved `from`, and the root mean square of what is left, in
    /// the units of `to`: markers, or places of a reference trajectory at the same instants (Umeyama, *Least-squares estimation of
    /// transformation parameters between two point patterns*, 1991; the rotation as Horn's quaternion, 1987).
    ///
    /// # Errors
    /// Fewer than three pairs, lists of different length, numbers that are not finite, or points on one line.
    pub fn from_points(from: &[DVec3], to: &[DVec3]) -> Result<(Self, f64), MeshError> {
        let n = from.len();
        if n != to.len() || n < 3 {
            return Err(off("pairs of points", "three or more, as many of each", format!("{n} and {}", to.len())));
        }
        if let Some(bad) = (0..n).find(|i| !from[*i].is_finite() || !to[*i].is_finite()) {
            return Err(off(
                format!("pair of points {bad}"),
                "finite numbers",
                format!("{} and {}", from[bad], to[bad]),
            ));
        }
        let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / n as f64;
        let (mean_from, mean_to) = (mean(from), mean(to));
        let (mut spread, mut cross) = (0.0, [[0.0f64; 3]; 3]);
        let mut scatter = DMat3::ZERO;
        for (p, q) in from.iter().zip(to) {
            let (p, q) = (*p - mean_from, *q - mean_to);
            spread += p.length_squared();
            scatter += DMat3::from_cols(p * p.x, p * p.y, p * p.z);
            for i in 0..3 {
                for j in 0..3 {
                    cross[i][j] += p[i] * q[j];
                }
            }
        }
        // Points on a line leave a turn about it free: the sum of the 2 x 2 principal minors is then 0.
        let minors = scatter.x_axis.x * scatter.y_axis.y
            + scatter.y_axis.y * scatter.z_axis.z
            + scatter.z_axis.z * scatter.x_axis.x
            - scatter.x_axis.y.powi(2)
            - scatter.y_axis.z.powi(2)
            - scatter.z_axis.x.powi(2);
        if !(spread > 0.0 && minors > 1e-9 * spread * spread) {
            return Err(off("pairs of points", "points that are not on one line", format!("{n} that are")));
        }
        let rotation = horn(&cross);
        let turned: f64 = from.iter().zip(to).map(|(p, q)| (rotation * (*p - mean_from)).dot(*q - mean_to)).sum();
        let scale = turned / spread;
        if scale.is_nan() || scale <= 0.0 {
            return Err(off("pairs of points", "patterns that are alike", "mirrored ones"));
        }
        let found = Self { scale, pose: Pose { position: mean_to - scale * (rotation * mean_from), rotation } };
        let left: f64 = from.iter().zip(to).map(|(p, q)| found.transform_point(*p).distance_squared(*q)).sum();
        Ok((found, (left / n as f64).sqrt()))
    }

    /// Lays the largest plane of a mesh, among those that face within 60 degrees of `up`, on z = 0. Planes are those of `tries`
    /// faces picked by their area; the one with the most area within `distance` \[units of the mesh\] is refined over that area.
    ///
    /// # Errors
    /// The mesh has no area, `up` no length, or no face looks up.
    pub fn from_ground(mesh: &TriangleMesh, up: DVec3, distance: f64, tries: usize) -> Result<Self, MeshError> {
        let up = up.try_normalize().ok_or_else(|| off("direction up", "a direction", up))?;
        let faces: Vec<(DVec3, DVec3)> = (0..mesh.triangles.len())
            .filter_map(|t| {
                let [a, b, c] = mesh.corners(t);
                let area = 0.5 * (b - a).cross(c - a);
                (area.dot(up) > 0.5 * area.length() && area.length() > 0.0).then_some(((a + b + c) / 3.0, area))
            })
            .collect();
        if faces.is_empty() {
            return Err(off("ground", "faces that look up", format!("none of {}", mesh.triangles.len())));
        }
        let support = |n: DVec3, p: DVec3| -> f64 {
            let near = faces.iter().filter(|(q, a)| n.dot(*q - p).abs() <= distance && a.dot(n) > 0.9 * a.length());
            near.map(|(_, a)| a.length()).sum()
        };
        let step = (faces.len() / tries.max(1)).max(1);
        let picked = faces.iter().step_by(step).map(|(p, a)| (a.normalize(), *p));
        let best = picked.map(|(n, p)| (support(n, p), n, p)).max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, mut normal, mut point)) = best else {
            return Err(off("ground", "faces that look up", "none"));
        };
        for _ in 0..5 {
            let near = faces
                .iter()
                .filter(|(q, a)| normal.dot(*q - point).abs() <= distance && a.dot(normal) > 0.9 * a.length());
            let (mut total, mut middle, mut sum) = (0.0, DVec3::ZERO, DVec3::ZERO);
            for (q, a) in near {
                total += a.length();
                middle += a.length() * *q;
                sum += *a;
            }
            if let (true, Some(n)) = (total > 0.0, sum.try_normalize()) {
                (normal, point) = (n, middle / total);
            }
        }
        let level = Self::from_up(normal)?;
        let height = level.transform_point(point).z;
        Ok(Self { pose: Pose { position: DVec3::new(0.0, 0.0, -height), ..level.pose }, ..level })
    }
}

/// The rotation that turns `from` to `to`, of `cross` = sum of from · toᵀ: eigenvector of Horn's matrix with the largest eigenvalue.
fn horn(s: &[[f64; 3]; 3]) -> DQuat {
    let mut m = [
        [s[0][0] + s[1][1] + s[2][2], s[1][2] - s[2][1], s[2][0] - s[0][2], s[0][1] - s[1][0]],
        [s[1][2] - s[2][1], s[0][0] - s[1][1] - s[2][2], s[0][1] + s[1][0], s[2][0] + s[0][2]],
        [s[2][0] - s[0][2], s[0][1] + s[1][0], s[1][1] - s[0][0] - s[2][2], s[1][2] + s[2][1]],
        [s[0][1] - s[1][0], s[2][0] + s[0][2], s[1][2] + s[2][1], s[2][2] - s[0][0] - s[1][1]],
    ];
    let mut vectors = [[0.0f64; 4]; 4];
    (0..4).for_each(|k| vectors[k][k] = 1.0);
    // Jacobi's rotations; ten sweeps are more than a 4 x 4 matrix needs.
    for _ in 0..10 {
        for p in 0..4 {
            for q in p + 1..4 {
                if m[p][q].abs() < 1e-300 {
                    continue;
                }
                let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..4 {
                    (m[k][p], m[k][q]) = (c * m[k][p] - s * m[k][q], s * m[k][p] + c * m[k][q]);
                }
                for k in 0..4 {
                    (m[p][k], m[q][k]) = (c * m[p][k] - s * m[q][k], s * m[p][k] + c * m[q][k]);
                    (vectors[k][p], vectors[k][q]) =
                        (c * vectors[k][p] - s * vectors[k][q], s * vectors[k][p] + c * vectors[k][q]);
                }
            }
        }
    }
    let best = (1..4).fold(0, |best, k| if m[k][k] > m[best][best] { k } else { best });
    let [w, x, y, z] = [0, 1, 2, 3].map(|k| vectors[k][best]);
    DQuat::from_xyzw(x, y, z, w).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    fn off_axis() -> Similarity {
        let pose = Pose::from_position_wxyz([0.4, -1.2, 2.0], [0.3, -0.5, 0.7, 0.2]).unwrap();
        Similarity { scale: 2.5, pose }
    }

    fn markers() -> Vec<DVec3> {
        vec![
            DVec3::new(0.1, 0.2, 0.3),
            DVec3::new(1.0, -0.4, 0.2),
            DVec3::new(-0.3, 0.8, 1.1),
            DVec3::new(0.5, 0.5, -0.6),
        ]
    }

    #[test]
    fn markers_give_back_what_moved_them() {
        let to: Vec<DVec3> = markers().iter().map(|p| off_axis().transform_point(*p)).collect();
        let (found, left) = Similarity::from_points(&markers(), &to).unwrap();
        assert!((found.scale - 2.5).abs() < 1e-12 && left < 1e-12, "{found:?} {left}");
        for p in markers() {
            assert!((found.inverse().transform_point(off_axis().transform_point(p)) - p).length() < 1e-12);
            let twice = found.after(&found).transform_point(p);
            assert!((twice - found.transform_point(found.transform_point(p))).length() < 1e-12);
        }
        // Three markers in a plane are enough.
        let (flat, _) = Similarity::from_points(&markers()[..3], &to[..3]).unwrap();
        assert!((flat.scale - 2.5).abs() < 1e-9);
    }

    #[test]
    fn frames_move_with_what_they_show() {
        let camera_from_world = Pose::from_position_wxyz([0.3, 0.1, 0.5], [0.9, 0.1, -0.3, 0.2]).unwrap();
        let camera = qv_core::Camera { fx: 50.0, fy: 50.0, cx: 8.0, cy: 8.0, width: 16, height: 16, camera_from_world };
        let mut frame = DepthFrame { camera, depth: vec![2.0; 256], weight: vec![] };
        let point_in_camera = DVec3::new(0.2, -0.1, 2.0);
        let shown = camera_from_world.inverse().transform_point(point_in_camera);
        off_axis().apply_to_frame(&mut frame);
        let moved = frame.camera.camera_from_world.inverse().transform_point(2.5 * point_in_camera);
        assert!((moved - off_axis().transform_point(shown)).length() < 1e-12 && (frame.depth[0] - 5.0).abs() < 1e-6);
    }

    #[test]
    fn noise_is_spread_over_all_markers() {
        let mut to: Vec<DVec3> = markers().iter().map(|p| off_axis().transform_point(*p)).collect();
        to[1].x += 0.01;
        let (found, left) = Similarity::from_points(&markers(), &to).unwrap();
        assert!((found.scale - 2.5).abs() < 0.02 && left < 0.005 && left > 1e-4, "{found:?} {left}");
    }

    #[test]
    fn distances_and_directions() {
        let scaled = Similarity::from_distance(DVec3::ZERO, DVec3::new(0.0, 3.0, 4.0), 1.0).unwrap();
        assert!((scaled.scale - 0.2).abs() < 1e-15);
        for up in [DVec3::new(0.2, -0.4, 0.6), DVec3::NEG_Z, DVec3::Z] {
            let level = Similarity::from_up(up).unwrap();
            assert!((level.transform_point(up.normalize()) - DVec3::Z).length() < 1e-12, "{up}");
        }
    }

    #[test]
    fn the_ground_is_laid_on_zero() {
        // Ground with a table on it, tilted and raised.
        let mut mesh = TriangleMesh::default();
        for (size, z) in [(2.0, 0.0), (0.6, 0.7)] {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(
                [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(size * x, size * y, z)),
            );
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        let tilt = Similarity { scale: 1.0, pose: Pose::from_xyz_rpy([0.3, 0.1, -1.2], [0.3, -0.2, 0.4]) };
        tilt.apply(&mut mesh);
        let level = Similarity::from_ground(&mesh, DVec3::Z, 0.02, 100).unwrap();
        level.apply(&mut mesh);
        assert!(mesh.vertices[..4].iter().all(|v| v.z.abs() < 1e-9), "{:?}", mesh.vertices);
        assert!(mesh.vertices[4..].iter().all(|v| (v.z - 0.7).abs() < 1e-9));
    }

    #[test]
    fn what_is_not_enough_is_named() {
        let line: Vec<DVec3> = (0..5).map(|i| DVec3::new(1.0, 2.0, -1.0) * f64::from(i)).collect();
        let fault = |a: &[DVec3], b: &[DVec3]| Similarity::from_points(a, b).unwrap_err().to_string();
        assert!(fault(&line, &line).states("line"));
        assert!(fault(&markers()[..2], &markers()[..2]).states("three"));
        assert!(fault(&markers(), &markers()[..3]).states("and 4 3"));
        assert!(fault(&[DVec3::NAN; 3], &markers()[..3]).states("points 0"));
        assert!(
            Similarity::from_distance(DVec3::ONE, DVec3::ONE, 1.0).is_err()
                && Similarity::from_up(DVec3::ZERO).is_err()
        );
        assert!(Similarity::from_ground(&TriangleMesh::default(), DVec3::Z, 0.02, 10).is_err());
    }
}
