//! Planes of a place, from depths at pixels with texture.

use super::picture::Picture;
use super::plane::Plane;
use crate::{DepthFrame, depth};
use glam::DVec3;
use rayon::prelude::*;

/// Points that are looked at, over all frames.
const POINTS: usize = 60_000;
/// Planes tried for each that is found, through points picked evenly.
const TRIES: usize = 256;
/// Rounds of refining one.
const ROUNDS: usize = 5;
/// Most planes found one by one, and with those parallel to them.
const MOST: usize = 24;
const MOST_IN_ALL: usize = 48;
/// Least share of the points that lie on a plane; on a parallel one, whose direction is known, less is enough.
const LEAST: f64 = 0.006;
const LEAST_PARALLEL: f64 = 0.0012;
/// Cosines between the normal of a point and that of a plane it supports: while it is looked for, and of parallel ones.
const ALONG: f64 = 0.9;
const ALONG_PARALLEL: f64 = 0.9;
/// Directions that parallel planes are looked for along, and the cosine that parts two.
const DIRECTIONS: usize = 5;
const APART: f64 = 0.985;

/// A point with its normal, in the world.
struct Support {
    point: DVec3,
    normal: DVec3,
}

/// Planes with points within `distance` \[m\], largest first, then those parallel to the largest.
pub(super) fn planes(frames: &[DepthFrame], pictures: &[Picture], distance: f64) -> Vec<Plane> {
    let of_frame = POINTS / frames.len().max(1) + 1;
    let each = frames.par_iter().zip(pictures).map(|(frame, picture)| supports(frame, picture, of_frame));
    let points: Vec<Support> = each.collect::<Vec<_>>().into_iter().flatten().collect();
    let least = (LEAST * points.len() as f64).max(3.0) as usize;
    let mut left: Vec<usize> = (0..points.len()).collect();
    let mut found = vec![];
    while found.len() < MOST && left.len() >= least {
        let Some(plane) = largest(&points, &left, distance) else { break };
        let before = left.len();
        // A little more than supports it, so that its borders are not found as planes of their own.
        left.retain(|&k| !on(&points[k], &plane, 1.5 * distance, ALONG - 0.1));
        if before - left.len() < least {
            break;
        }
        found.push(plane);
    }
    for direction in directions(&found) {
        parallel(&points, direction, distance, &mut found);
    }
    found
}

/// Points of a frame at the half of its pixels that has more texture.
fn supports(frame: &DepthFrame, picture: &Picture, most: usize) -> Vec<Support> {
    let texture = picture.texture();
    let planes = depth::planes(frame, f32::INFINITY);
    let seen: Vec<usize> = (0..planes.len()).filter(|&k| planes[k].weight > 0.0).collect();
    let mut sorted: Vec<f32> = seen.iter().map(|&k| texture[k]).collect();
    sorted.sort_by(f32::total_cmp);
    let Some(&middle) = sorted.get(sorted.len() / 2) else { return vec![] };
    let textured: Vec<usize> = seen.into_iter().filter(|&k| texture[k] >= middle && texture[k] > 0.0).collect();
    let camera = &frame.camera;
    let world_from_camera = camera.camera_from_world.inverse();
    let one = |&pixel: &usize| {
        let plane = &planes[pixel];
        let (column, row) = ((pixel % picture.width) as f64 + 0.5, (pixel / picture.width) as f64 + 0.5);
        let ray = DVec3::new((column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1.0);
        let slope = plane.slope.map(f64::from);
        let (x, y) = (slope[0] * camera.fx, slope[1] * camera.fy);
        // n · p = 1 in camera axes points away from the camera.
        let away = DVec3::new(x, y, f64::from(plane.inverse) - x * ray.x - y * ray.y);
        let normal = -world_from_camera.transform_vector(away).try_normalize()?;
        Some(Support { point: world_from_camera.transform_point(ray / f64::from(plane.inverse)), normal })
    };
    textured.iter().step_by(textured.len() / most.max(1) + 1).filter_map(one).collect()
}

fn on(support: &Support, plane: &Plane, distance: f64, along: f64) -> bool {
    (plane.normal.dot(support.point) - plane.offset).abs() < distance && plane.normal.dot(support.normal) > along
}

/// The plane that most of the points that are left support, of those through some of them.
fn largest(points: &[Support], left: &[usize], distance: f64) -> Option<Plane> {
    let tried: Vec<usize> = left.iter().copied().step_by(left.len() / TRIES + 1).collect();
    let plane = |k: usize| Plane { normal: points[k].normal, offset: points[k].normal.dot(points[k].point) };
    let count = |plane: &Plane| left.iter().filter(|&&k| on(&points[k], plane, distance, ALONG)).count();
    let counts: Vec<usize> = tried.par_iter().map(|&k| count(&plane(k))).collect();
    let best = (0..tried.len()).max_by(|&a, &b| counts[a].cmp(&counts[b]).then(b.cmp(&a)))?;
    let mut plane = plane(tried[best]);
    for _ in 0..ROUNDS {
        let near = left.iter().map(|&k| &points[k]).filter(|p| on(p, &plane, distance, ALONG));
        plane = fitted(&plane, &near.map(|p| p.point).collect::<Vec<_>>())?;
    }
    Some(plane)
}

/// Least squares of the points' heights above a plane; `None` where they lie on a line.
fn fitted(plane: &Plane, points: &[DVec3]) -> Option<Plane> {
    let n = points.len() as f64;
    let middle = points.iter().sum::<DVec3>() / n;
    let (right, up) = plane.normal.any_orthonormal_pair();
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for point in points {
        let p = *point - middle;
        let (x, y, z) = (p.dot(right), p.dot(up), p.dot(plane.normal));
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        (xz, yz) = (xz + x * z, yz + y * z);
    }
    let determinant = xx * yy - xy * xy;
    if determinant.is_nan() || determinant <= 1e-6 * (xx + yy) * (xx + yy) {
        return None;
    }
    let (a, b) = ((yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant);
    let normal = (plane.normal - a * right - b * up).normalize();
    Some(Plane { normal, offset: normal.dot(middle) })
}

/// Normals of the largest planes, those alike once.
fn directions(planes: &[Plane]) -> Vec<DVec3> {
    let mut out: Vec<DVec3> = vec![];
    for plane in planes {
        if out.len() < DIRECTIONS && out.iter().all(|n| n.dot(plane.normal).abs() < APART) {
            out.push(plane.normal);
        }
    }
    out
}

/// Adds planes along `normal` where points with such normals are dense: fronts of cupboards have little texture, but edges all round.
fn parallel(points: &[Support], normal: DVec3, distance: f64, found: &mut Vec<Plane>) {
    let cell = 0.5 * distance;
    let along = points.iter().filter(|p| p.normal.dot(normal) > ALONG_PARALLEL);
    let offsets: Vec<f64> = along.map(|p| normal.dot(p.point)).collect();
    let Some(low) = offsets.iter().copied().min_by(f64::total_cmp) else { return };
    let high = offsets.iter().copied().fold(low, f64::max);
    let cells = ((high - low) / cell) as usize + 1;
    // A few points far off would ask for more cells than there are points.
    if cells > points.len() {
        return;
    }
    let mut counts = vec![0usize; cells];
    offsets.iter().for_each(|offset| counts[((offset - low) / cell) as usize] += 1);
    let window = |at: usize, reach: usize| at.saturating_sub(reach)..(at + reach + 1).min(cells);
    let dense: Vec<usize> = (0..cells).map(|at| window(at, 2).map(|k| counts[k]).sum()).collect();
    let least = (LEAST_PARALLEL * points.len() as f64).max(3.0) as usize;
    for at in 0..cells {
        let is_peak =
            dense[at] >= least && window(at, 5).all(|k| dense[k] < dense[at] || (dense[k] == dense[at] && k >= at));
        let offset = low + (at as f64 + 0.5) * cell;
        let same = |p: &Plane| {
            let cosine = p.normal.dot(normal);
            cosine.abs() > 0.995 && (cosine.signum() * p.offset - offset).abs() < 1.5 * distance
        };
        if is_peak && found.len() < MOST_IN_ALL && !found.iter().any(same) {
            found.push(Plane { normal, offset });
        }
    }
}
