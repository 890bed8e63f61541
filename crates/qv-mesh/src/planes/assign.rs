//! Plain regions of a frame on planes.

use super::picture::Picture;
use super::plane::Plane;
use super::segments::segments;
use crate::DepthFrame;
use glam::DVec3;

/// Change of colour per pixel below which a pixel is plain: photographs say nothing of its depth.
const PLAIN: f32 = 0.02;
/// Least share of plain pixels in a region that is laid.
const LEAST_PLAIN: f64 = 0.5;
/// Width of the rim round a region that is asked, too \[px\].
const RIM: usize = 8;
/// A depth lies on a plane when it differs by less than this share.
const ON: f64 = 0.015;
/// Least share of the rim that lies on a region's plane.
const LEAST_RIM: f64 = 0.1;
/// Least share of the region between pixels that lie on its plane: inside their convex hull.
const BETWEEN: f64 = 0.6;
/// Depths that differ from the plane by a larger share are of something else.
const ELSEWHERE: f64 = 0.3;

/// Lays the plain pixels of each plain region of the frame's picture on the plane that most of the region and of its rim lie on; returns
/// how many were, by plane. `drawn` are the frame's depths before any was left out.
pub(super) fn lay(frame: &mut DepthFrame, picture: &Picture, drawn: &[f32], planes: &[Plane]) -> Vec<usize> {
    let on_rays = OnRays::new(frame, planes);
    let before = frame.depth.clone();
    let texture = picture.texture();
    let is_plain = |pixel: &u32| texture[*pixel as usize] < PLAIN;
    let mut laid = vec![0; planes.len()];
    for region in segments(picture) {
        let plain: Vec<u32> = region.iter().copied().filter(is_plain).collect();
        if (plain.len() as f64) < LEAST_PLAIN * region.len() as f64 {
            continue;
        }
        let rim = rim(&region, picture);
        let Some(plane) = on_rays.best(&region, &rim, &before, picture.width) else { continue };
        for pixel in plain {
            let at = pixel as usize;
            let Some(depth) = on_rays.depth(plane, pixel) else { continue };
            if may_be(depth, before[at], drawn[at]) {
                frame.depth[at] = depth as f32;
                laid[plane] += 1;
            }
        }
    }
    laid
}

/// Whether a pixel may have the depth of a plane, given the depth that it has and the one that was drawn. What nothing was drawn of is
/// sky. What lies far behind the plane is seen through an opening, whether other frames confirm it or not; what floats before it and is
/// not confirmed is nothing.
fn may_be(plane: f64, depth: f32, drawn: f32) -> bool {
    let [depth, drawn] = [depth, drawn].map(f64::from);
    let is_confirmed = depth > 0.0 && depth.is_finite();
    let is_drawn = drawn > 0.0 && drawn.is_finite();
    is_drawn && drawn - plane < ELSEWHERE * drawn && (!is_confirmed || (plane - depth).abs() < ELSEWHERE * depth)
}

/// Planes as the rays of a camera meet them: 1 / depth is linear in the ray.
struct OnRays {
    /// `n · ray` is the inverse depth, by plane.
    inverse: Vec<DVec3>,
    rays: Vec<DVec3>,
}

impl OnRays {
    fn new(frame: &DepthFrame, planes: &[Plane]) -> Self {
        let camera = &frame.camera;
        let world_from_camera = camera.camera_from_world.inverse();
        let inverse = |plane: &Plane| {
            // Seen from behind, a plane is none.
            let height = plane.offset - plane.normal.dot(world_from_camera.position);
            let normal = camera.camera_from_world.transform_vector(plane.normal);
            if height < 0.0 { normal / height } else { DVec3::ZERO }
        };
        let width = camera.width as usize;
        let ray = |pixel: usize| {
            let (column, row) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            DVec3::new((column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1.0)
        };
        Self { inverse: planes.iter().map(inverse).collect(), rays: (0..camera.pixels()).map(ray).collect() }
    }

    /// Depth at which a plane is seen \[m\].
    fn depth(&self, plane: usize, pixel: u32) -> Option<f64> {
        let inverse = self.inverse[plane].dot(self.rays[pixel as usize]);
        (inverse > 0.0).then_some(1.0 / inverse)
    }

    fn is_on(&self, plane: usize, pixel: u32, depths: &[f32]) -> bool {
        let depth = f64::from(depths[pixel as usize]);
        (self.inverse[plane].dot(self.rays[pixel as usize]) * depth - 1.0).abs() < ON
    }

    /// The plane with most of a region and its rim, of those that have some of the rim and lie round the region.
    fn best(&self, region: &[u32], rim: &[u32], depths: &[f32], width: usize) -> Option<usize> {
        let mut best: Option<(usize, usize)> = None;
        for plane in 0..self.inverse.len() {
            let is_on = |pixel: &&u32| self.is_on(plane, **pixel, depths);
            let of_rim: Vec<u32> = rim.iter().filter(is_on).copied().collect();
            if (of_rim.len() as f64) < LEAST_RIM * rim.len() as f64 {
                continue;
            }
            let mut all = of_rim;
            all.extend(region.iter().filter(is_on));
            if best.is_none_or(|(most, _)| all.len() > most) && is_between(region, &all, width) {
                best = Some((all.len(), plane));
            }
        }
        best.map(|(_, plane)| plane)
    }
}

/// Pixels with a place round a region, within [`RIM`] of it.
fn rim(region: &[u32], picture: &Picture) -> Vec<u32> {
    let (width, height) = (picture.width, picture.height);
    let at = |pixel: &u32| (*pixel as usize % width, *pixel as usize / width);
    let (mut low, mut high) = ((width, height), (0, 0));
    for (x, y) in region.iter().map(at) {
        low = (low.0.min(x), low.1.min(y));
        high = (high.0.max(x), high.1.max(y));
    }
    let low = (low.0.saturating_sub(RIM), low.1.saturating_sub(RIM));
    let high = ((high.0 + RIM).min(width - 1), (high.1 + RIM).min(height - 1));
    let (wide, tall) = (high.0 - low.0 + 1, high.1 - low.1 + 1);
    let mut own = vec![false; wide * tall];
    region.iter().map(at).for_each(|(x, y)| own[(y - low.1) * wide + x - low.0] = true);
    // Rows, then columns.
    let mut near = vec![false; wide * tall];
    for y in 0..tall {
        spread(&mut near, wide, |k| own[y * wide + k], |k| y * wide + k);
    }
    let rows = near.clone();
    for x in 0..wide {
        spread(&mut near, tall, |k| rows[k * wide + x], |k| k * wide + x);
    }
    let outside = (0..wide * tall).filter(|&k| near[k] && !own[k]);
    outside.map(|k| ((low.1 + k / wide) * width + low.0 + k % wide) as u32).collect()
}

/// Sets what is within [`RIM`] of something set, along a line of `count`.
fn spread(near: &mut [bool], count: usize, is_set: impl Fn(usize) -> bool, place: impl Fn(usize) -> usize) {
    let mut reach = 0;
    for k in 0..count {
        reach = if is_set(k) { RIM + 1 } else { reach };
        near[place(k)] |= reach > 0;
        reach = reach.saturating_sub(1);
    }
    reach = 0;
    for k in (0..count).rev() {
        reach = if is_set(k) { RIM + 1 } else { reach };
        near[place(k)] |= reach > 0;
        reach = reach.saturating_sub(1);
    }
}

/// Whether enough of a region lies inside the convex hull of `pixels`.
fn is_between(region: &[u32], pixels: &[u32], width: usize) -> bool {
    let place = |pixel: u32| ((pixel as usize % width) as i64, (pixel as usize / width) as i64);
    let hull = hull(pixels.iter().map(|p| place(*p)).collect());
    let inside = |p: (i64, i64)| {
        let side = |k: usize| turn(hull[k], hull[(k + 1) % hull.len()], p) >= 0;
        hull.len() > 2 && (0..hull.len()).all(side)
    };
    const ASKED: usize = 500;
    let asked = region.iter().step_by(region.len() / ASKED + 1);
    let (count, within) = asked.fold((0, 0), |(n, w), p| (n + 1, w + usize::from(inside(place(*p)))));
    f64::from(within as u32) >= BETWEEN * f64::from(count)
}

/// Positive where `c` lies to the left of the way from `a` to `b`.
fn turn(a: (i64, i64), b: (i64, i64), c: (i64, i64)) -> i64 {
    (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
}

/// Corners of the convex hull, turning left (Andrew's monotone chain).
fn hull(mut points: Vec<(i64, i64)>) -> Vec<(i64, i64)> {
    points.sort_unstable();
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = (i64, i64)>| {
        let mut out: Vec<(i64, i64)> = vec![];
        for p in points {
            while out.len() >= 2 && turn(out[out.len() - 2], out[out.len() - 1], p) <= 0 {
                out.pop();
            }
            out.push(p);
        }
        out.pop();
        out
    };
    let mut out = half(&mut points.iter().copied());
    out.extend(half(&mut points.iter().rev().copied()));
    out
}
