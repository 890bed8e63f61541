//! How close two surfaces are: precision, recall and F1 at a distance (Knapitsch et al., *Tanks and Temples*, 2017).

use crate::MeshError;
use crate::agree::seen;
use crate::depth::DepthFrame;
use crate::error::off;
use crate::nearest::PointGrid;
use crate::similarity::Similarity;
use glam::DVec3;
use qv_core::TriangleMesh;
use qv_core::random::{GAMMA, scrambled};
use rayon::prelude::*;

/// How close a mesh is to a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Likeness {
    /// The distance that counts as close \[m\].
    pub distance: f64,
    /// Share of the mesh's points that are close to the reference.
    pub precision: f64,
    /// Share of the reference's points that are close to the mesh.
    pub recall: f64,
}

impl Likeness {
    /// Harmonic mean of precision and recall.
    pub fn f1(&self) -> f64 {
        let sum = self.precision + self.recall;
        if sum > 0.0 { 2.0 * self.precision * self.recall / sum } else { 0.0 }
    }
}

/// `count` points spread over the surface, as many on equal areas; the same seed gives the same points.
///
/// # Errors
/// The mesh is not valid or has no area.
pub fn sample(mesh: &TriangleMesh, count: usize, seed: u64) -> Result<Vec<DVec3>, MeshError> {
    mesh.validate()?;
    let mut total = 0.0;
    let mut until = Vec::with_capacity(mesh.triangles.len());
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(t);
        total += 0.5 * (b - a).cross(c - a).length();
        until.push(total);
    }
    if !(total.is_finite() && total > 0.0) {
        return Err(off("mesh to sample", "triangles with an area", format!("{} triangles", mesh.triangles.len())));
    }
    Ok((0..count)
        .into_par_iter()
        .map(|i| {
            let [u, v, w] = [0, 1, 2].map(|k| uniform(seed, 3 * i as u64 + k));
            // Stratified along the list of triangles.
            let at = (i as f64 + u) / count as f64 * total;
            let t = until.partition_point(|sum| *sum <= at).min(until.len() - 1);
            let [a, b, c] = mesh.corners(t);
            let root = v.sqrt();
            (1.0 - root) * a + root * (1.0 - w) * b + root * w * c
        })
        .collect())
}

/// Uniform in 0 to 1 from a counter (SplitMix64).
fn uniform(seed: u64, counter: u64) -> f64 {
    let x = seed.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(counter.wrapping_mul(GAMMA));
    (scrambled(x) >> 11) as f64 / (1u64 << 53) as f64
}

/// Compares points of a surface with points of a reference \[m\] at several distances \[m\]. For precision only `counted` count, those of `found`
/// of which the reference shows something ([`measurable`]); what of the reference was found is asked of all.
///
/// # Errors
/// There are no points, one is not finite, or a distance is not positive.
pub fn compare_points(
    counted: &[DVec3],
    found: &[DVec3],
    reference: &[DVec3],
    distances: &[f64],
) -> Result<Vec<Likeness>, MeshError> {
    if counted.is_empty() || found.is_empty() || reference.is_empty() {
        let sizes = format!("{} of {} and {}", counted.len(), found.len(), reference.len());
        return Err(off("surfaces to compare", "points", sizes));
    }
    let most = distances.iter().copied().fold(0.0, f64::max);
    let gaps = |from: &[DVec3], to: &[DVec3]| -> Result<Vec<f64>, MeshError> {
        let grid = PointGrid::new(to, 0.5 * most)?;
        Ok(from.par_iter().map(|p| grid.nearest(*p, most).map_or(f64::INFINITY, |(_, d)| d)).collect())
    };
    let (there, back) = (gaps(counted, reference)?, gaps(reference, found)?);
    let share = |gaps: &[f64], most: f64| gaps.iter().filter(|d| **d <= most).count() as f64 / gaps.len() as f64;
    let at = |d: &f64| Likeness { distance: *d, precision: share(&there, *d), recall: share(&back, *d) };
    Ok(distances.iter().map(at).collect())
}

/// Compares two meshes at several distances \[m\], by `count` points on each. The mean gap between points on a surface of area A is
/// about sqrt(A / count) / 2; it should be well below the distances.
///
/// # Errors
/// As [`sample`] and [`compare_points`].
pub fn compare(
    mesh: &TriangleMesh,
    reference: &TriangleMesh,
    distances: &[f64],
    count: usize,
) -> Result<Vec<Likeness>, MeshError> {
    let found = sample(mesh, count, 1)?;
    compare_points(&found, &found, &sample(reference, count, 2)?, distances)
}

/// How far apart points may be that are taken for the same at first and at last \[m\], and in how many rounds the one becomes the other.
const REACH: [f64; 2] = [0.3, 0.05];
const ROUNDS: usize = 80;
/// Points of a surface that are followed.
const FOLLOWED: usize = 20_000;

/// How a surface was laid on a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registration {
    /// Where it was laid.
    pub reference_from_found: Similarity,
    /// Share of the points of both that have one of the other within 5 cm then.
    pub share: f64,
}

/// The similarity that lays points of a surface on a reference: pairs of closest points, over and over, nearer ones each time (Besl and
/// McKay, *A method for registration of 3-D shapes*, 1992; as Knapitsch et al. register what they compare). A reconstruction from photographs has the
/// place and the size that its cameras were given; with it, F1 is of the shape alone.
///
/// # Errors
/// There are no points, one is not finite, or fewer than three are near the reference.
pub fn register(found: &[DVec3], reference: &[DVec3]) -> Result<Registration, MeshError> {
    let some =
        |all: &[DVec3]| -> Vec<DVec3> { all.iter().copied().step_by(all.len().div_ceil(FOLLOWED).max(1)).collect() };
    let (found, reference) = (some(found), some(reference));
    let grids = (PointGrid::new(&found, 0.25 * REACH[0])?, PointGrid::new(&reference, 0.25 * REACH[0])?);
    let (mut reference_from_found, mut share) = (Similarity::IDENTITY, 0.0);
    for round in 0..ROUNDS {
        let reach = REACH[0] * (REACH[1] / REACH[0]).powf(round as f64 / (ROUNDS - 1) as f64);
        let found_from_reference = reference_from_found.inverse();
        // Both ways: what sticks out beyond the rim of the other has its closest points on that rim, which alone would shrink it.
        let there = |p: &DVec3| {
            let near = grids.1.nearest(reference_from_found.transform_point(*p), reach)?;
            Some((*p, reference[near.0]))
        };
        let back = |p: &DVec3| {
            let near = grids.0.nearest(found_from_reference.transform_point(*p), reach * found_from_reference.scale)?;
            Some((found[near.0], *p))
        };
        let pairs = found.par_iter().filter_map(there).chain(reference.par_iter().filter_map(back));
        let (from, to): (Vec<DVec3>, Vec<DVec3>) = pairs.unzip();
        if from.len() < 3 {
            let expected = format!("points of both within {reach:.2} m of each other");
            return Err(off("surface to lay on a reference", expected, from.len()));
        }
        reference_from_found = Similarity::from_points(&from, &to)?.0;
        share = from.len() as f64 / (found.len() + reference.len()) as f64;
    }
    Ok(Registration { reference_from_found, share })
}

/// Points that some depth frame could have measured: in its image, where it has a depth, and not more than `behind` \[m\] behind that. Of what
/// lies behind all that was measured, or where nothing was, a reference made of these frames says nothing (the culling by
/// visibility of Azinović et al., *Neural RGB-D Surface Reconstruction*, 2022).
pub fn measurable(points: Vec<DVec3>, frames: &[DepthFrame], behind: f64) -> Vec<DVec3> {
    let by = |point: &DVec3, frame: &DepthFrame| {
        seen(frame, *point).is_some_and(|(expected, there)| expected <= there + behind)
    };
    points.into_par_iter().filter(|point| frames.iter().any(|frame| by(point, frame))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use glam::DQuat;
    use qv_core::Pose;
    use std::f64::consts::FRAC_PI_2;

    fn square(size: f64, z: f64) -> TriangleMesh {
        let p = |x: f64, y: f64| DVec3::new(x * size, y * size, z);
        TriangleMesh {
            vertices: vec![p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Default::default()
        }
    }

    #[test]
    fn shares_are_those_of_areas() {
        // A square of half the area 1 cm above the whole.
        let half = square(0.5f64.sqrt(), 0.01);
        let [near, far] = compare(&half, &square(1.0, 0.0), &[0.005, 0.02], 40_000).unwrap()[..] else { panic!() };
        assert_eq!((near.precision, near.recall, near.f1()), (0.0, 0.0, 0.0));
        assert_eq!(far.precision, 1.0);
        // Beyond the half's edges points are close up to sqrt(0.02² - 0.01²) more.
        assert!((far.recall - 0.5 - 2.0 * 0.5f64.sqrt() * 0.0173).abs() < 0.006, "{}", far.recall);
    }

    #[test]
    fn what_no_frame_could_have_measured_does_not_count() {
        use qv_core::{Camera, Pose};
        let camera =
            Camera { fx: 20.0, fy: 20.0, cx: 10.0, cy: 10.0, width: 20, height: 20, camera_from_world: Pose::IDENTITY };
        // A wall 2 m ahead; the left half of the image has no depth.
        let depth = (0..400).map(|i| if i % 20 < 10 { 0.0 } else { 2.0 }).collect();
        let frame = DepthFrame { camera, depth, weight: vec![] };
        let points = [
            DVec3::new(0.5, 0.0, 2.0),
            DVec3::new(0.5, 0.0, 1.2),
            DVec3::new(0.5, 0.0, 2.04),
            DVec3::new(0.5, 0.0, 2.5),
            DVec3::new(-0.5, 0.0, 2.0),
            DVec3::new(0.5, 0.0, -1.0),
            DVec3::new(5.0, 0.0, 2.0),
        ];
        // On the wall, in free space before it and hardly behind it; not behind it, where nothing was measured, behind the camera, beside the image.
        assert_eq!(measurable(points.to_vec(), &[frame], 0.05), points[..3]);
    }

    #[test]
    fn what_does_not_count_still_finds_the_reference() {
        let points: Vec<DVec3> = (0..10).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
        let [one] = compare_points(&points[..5], &points, &points, &[0.1]).unwrap()[..] else { panic!() };
        assert_eq!((one.precision, one.recall), (1.0, 1.0));
        let [one] = compare_points(&points[5..], &points[5..], &points, &[0.1]).unwrap()[..] else { panic!() };
        assert_eq!((one.precision, one.recall), (1.0, 0.5));
    }

    #[test]
    fn a_surface_is_laid_on_its_reference() {
        // Two walls and a floor, turned, moved and scaled; no closest point is at first the right one.
        let mut room = square(1.0, 0.0);
        for turn in [DQuat::from_rotation_x(FRAC_PI_2), DQuat::from_rotation_y(-FRAC_PI_2)] {
            let first = room.vertices.len() as u32;
            room.vertices.extend(square(0.7, 0.0).vertices.iter().map(|p| turn * *p));
            room.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        let reference = sample(&room, 8_000, 2).unwrap();
        let pose = Pose { rotation: DQuat::from_rotation_z(0.04), position: DVec3::new(0.05, -0.04, 0.03) };
        let moved = Similarity { scale: 1.03, pose };
        let found: Vec<DVec3> =
            sample(&room, 8_000, 1).unwrap().into_iter().map(|p| moved.transform_point(p)).collect();
        let before = compare_points(&found, &found, &reference, &[0.02]).unwrap()[0].f1();
        let laid = register(&found, &reference).unwrap();
        let back = laid.reference_from_found;
        assert!(laid.share > 0.99, "{laid:?}");
        let laid: Vec<DVec3> = found.iter().map(|p| back.transform_point(*p)).collect();
        let after = compare_points(&laid, &laid, &reference, &[0.02]).unwrap()[0].f1();
        assert!(before < 0.6 && after > 0.99, "{before} {after}");
        assert!((back.scale * 1.03 - 1.0).abs() < 0.005, "{back:?}");
        let far: Vec<DVec3> = found.iter().map(|p| *p + 10.0).collect();
        let error = register(&far, &reference).unwrap_err().to_string();
        assert!(error.states("points 0.30 0"), "{error}");
        // Too far off to be found, and reported: most of it stays without a counterpart.
        let turned: Vec<DVec3> = found.iter().map(|p| DQuat::from_rotation_y(2.0) * *p).collect();
        assert!(register(&turned, &reference).unwrap().share < 0.5);
    }

    #[test]
    fn samples_fill_the_area_evenly() {
        let points = sample(&square(1.0, 0.0), 10_000, 3).unwrap();
        let left = points.iter().filter(|p| p.x < 0.3).count();
        let corner = points.iter().filter(|p| p.x + p.y > 1.5).count();
        assert!(
            (left as f64 / 1e4 - 0.3).abs() < 0.02 && (corner as f64 / 1e4 - 0.125).abs() < 0.02,
            "{left} {corner}"
        );
    }

    #[test]
    fn what_cannot_be_compared_is_named() {
        let empty = TriangleMesh::default();
        assert!(compare(&empty, &square(1.0, 0.0), &[0.1], 10).unwrap_err().to_string().states("area"));
        assert!(compare_points(&[], &[], &[DVec3::ZERO], &[0.1]).is_err());
        assert!(compare(&square(1.0, 0.0), &square(1.0, 0.0), &[-1.0], 10).is_err());
    }
}
