//! Photographs as they are compared: small and grey, each with a range of depths and with others that show the same.

use super::options::StereoOptions;
use crate::files::Points;
use crate::train::{Dataset, Photograph, smaller};
use glam::{DMat3, DVec3, Mat3, Vec3};
use qv_core::Camera;
use rayon::prelude::*;

/// Angle between two rays at a point that shows depth best, and how fast it shows less for smaller and for larger ones \[rad\]
/// (Yao et al., *MVSNet*, 2018: 5, 1 and 10 degrees).
const BEST_ANGLE: f64 = 5.0 / 180.0 * std::f64::consts::PI;
const NARROW: f64 = 1.0 / 180.0 * std::f64::consts::PI;
const WIDE: f64 = 10.0 / 180.0 * std::f64::consts::PI;
/// Share of the points' depths left out at each end of the range, and how far it is stretched (COLMAP's patch match).
const OUTLIERS: f64 = 0.01;
const STRETCH: [f64; 2] = [0.75, 1.25];
/// Fewest points in an image that show a range.
const FEWEST: usize = 50;
/// Range without points, in units of the extent of the cameras: from where random points begin to where parallax ends.
const BLIND: [f64; 2] = [0.3, 30.0];
/// Rays of a side and depths of a ray at which two photographs are compared without points.
const GRID: usize = 12;
const DEPTHS: usize = 6;
/// Least score of a pair, as a share of the points of a photograph, all at the best angle.
const LEAST_SCORE: f64 = 0.02;

/// A photograph as it is compared.
pub struct View {
    pub width: usize,
    pub height: usize,
    /// 0 to 1, NaN where masked, shape `[height, width]`.
    pub grey: Vec<f32>,
    pub camera: Camera,
    /// What sides were divided by.
    pub by: u32,
    /// Inverse depth of the farthest plane and from one to the next \[1/m\].
    pub farthest: f32,
    pub step: f32,
    pub planes: usize,
    /// Indices of others, the best first.
    pub neighbours: Vec<usize>,
}

impl View {
    fn new(photograph: &Photograph, options: &StereoOptions) -> Self {
        let longest = photograph.camera.width.max(photograph.camera.height);
        let by = longest.div_ceil(options.side.max(1)).max(1);
        let (pixels, camera) = smaller(photograph.pixels.clone(), &photograph.camera, by);
        // Rec. 601.
        let luma = |p: &[u8; 4]| (0.299 * p[0] as f32 + 0.587 * p[1] as f32 + 0.114 * p[2] as f32) / 255.0;
        let grey = pixels.rgba.iter().map(|p| if p[3] == 0 { f32::NAN } else { luma(p) }).collect();
        let (width, height) = (pixels.width, pixels.height);
        Self { width, height, grey, camera, by, farthest: 0.0, step: 0.0, planes: 0, neighbours: vec![] }
    }

    /// Inverse depth of a plane; planes in between are, too.
    pub fn inverse_depth(&self, plane: f32) -> f32 {
        self.farthest + plane * self.step
    }

    /// Depths \[m\] of inverse depths, for each pixel of the photograph; 0 where there is none.
    pub fn at_full_size(&self, map: &[f32], photograph: &Photograph) -> Vec<f32> {
        let (width, by) = (photograph.pixels.width, self.by as usize);
        let depth = |index: usize| {
            let (x, y) = (index % width / by, index / width / by);
            let inverse = if x < self.width && y < self.height { map[y * self.width + x] } else { 0.0 };
            if inverse > 0.0 && photograph.pixels.rgba[index][3] != 0 { 1.0 / inverse } else { 0.0 }
        };
        (0..photograph.pixels.rgba.len()).map(depth).collect()
    }
}

/// Where a point of inverse depth w at pixel (u, v) of one photograph is in another: the pixel of `turn` (u, v, 1) + w `shift`.
pub struct Way {
    pub turn: Mat3,
    pub shift: Vec3,
}

impl Way {
    pub fn new(from: &Camera, to: &Camera) -> Self {
        let lens = |c: &Camera| {
            DMat3::from_cols(DVec3::new(c.fx, 0.0, 0.0), DVec3::new(0.0, c.fy, 0.0), DVec3::new(c.cx, c.cy, 1.0))
        };
        let to_from = to.camera_from_world * from.camera_from_world.inverse();
        let turn = lens(to) * to_from.matrix() * lens(from).inverse();
        Self { turn: turn.as_mat3(), shift: (lens(to) * to_from.position).as_vec3() }
    }
}

/// All photographs to learn from.
pub fn all(dataset: &Dataset, points: Option<&Points>, options: &StereoOptions) -> Vec<View> {
    let mut views: Vec<View> = dataset.training.par_iter().map(|one| View::new(one, options)).collect();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let places = points.map_or(&[][..], |points| &points.places);
    views.par_iter_mut().enumerate().for_each(|(index, view)| {
        let seen: Vec<DVec3> = places.iter().filter_map(|p| seen_at(&view.camera, *p)).collect();
        let (range, seen) = if seen.len() < FEWEST {
            let range = BLIND.map(|share| share * f64::from(dataset.extent));
            (range, grid(&view.camera, range))
        } else {
            (range_of(&view.camera, &seen), seen)
        };
        view.neighbours = neighbours(index, &cameras, &seen, options);
        let [nearest, farthest] = range.map(|depth| 1.0 / depth);
        let px: Vec<f64> =
            view.neighbours.iter().map(|&other| moved_px(&view.camera, &cameras[other], range)).collect();
        let wanted = median(&mut px.clone(), f64::total_cmp).unwrap_or(0.0) / options.plane_px;
        view.planes = (wanted.ceil() as usize + 1).clamp(options.planes[0], options.planes[1]);
        view.farthest = farthest as f32;
        view.step = ((nearest - farthest) / (view.planes - 1) as f64) as f32;
    });
    views
}

/// A point of the world that lies in an image.
fn seen_at(camera: &Camera, point: [f32; 3]) -> Option<DVec3> {
    let point = DVec3::from(point.map(f64::from));
    pixel_of(camera, point).is_some().then_some(point)
}

fn pixel_of(camera: &Camera, point: DVec3) -> Option<[f64; 2]> {
    let p = camera.camera_from_world.transform_point(point);
    let (u, v) = (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
    let inside = (0.0..f64::from(camera.width)).contains(&u) && (0.0..f64::from(camera.height)).contains(&v);
    (p.z > 0.0 && inside).then_some([u, v])
}

fn range_of(camera: &Camera, seen: &[DVec3]) -> [f64; 2] {
    let mut depths: Vec<f64> = seen.iter().map(|p| camera.camera_from_world.transform_point(*p).z).collect();
    depths.sort_by(f64::total_cmp);
    let at = (OUTLIERS * depths.len() as f64) as usize;
    [STRETCH[0] * depths[at], STRETCH[1] * depths[depths.len() - 1 - at]]
}

/// Points of a range that stand for what is not known: on a grid of rays, uniform in the logarithm of depth.
fn grid(camera: &Camera, range: [f64; 2]) -> Vec<DVec3> {
    let world_from_camera = camera.camera_from_world.inverse();
    let share = |k: usize, of: usize| (k as f64 + 0.5) / of as f64;
    let all = (0..GRID * GRID * DEPTHS).map(|k| (k % GRID, k / GRID % GRID, k / GRID / GRID));
    let place = |(x, y, d): (usize, usize, usize)| {
        let (u, v) = (share(x, GRID) * f64::from(camera.width), share(y, GRID) * f64::from(camera.height));
        let ray = DVec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let depth = range[0] * (range[1] / range[0]).powf(share(d, DEPTHS));
        world_from_camera.transform_point(ray * depth)
    };
    all.map(place).collect()
}

/// The photographs that show most of the points at angles that show depth.
fn neighbours(index: usize, cameras: &[Camera], seen: &[DVec3], options: &StereoOptions) -> Vec<usize> {
    let place = |camera: &Camera| camera.camera_from_world.inverse().position;
    let own = place(&cameras[index]);
    let score = |other: usize| {
        let there = place(&cameras[other]);
        let of_point = |point: &DVec3| match pixel_of(&cameras[other], *point) {
            Some(_) => {
                let off = (own - *point).angle_between(there - *point) - BEST_ANGLE;
                (-0.5 * (off / if off < 0.0 { NARROW } else { WIDE }).powi(2)).exp()
            }
            None => 0.0,
        };
        seen.iter().map(of_point).sum::<f64>() / seen.len().max(1) as f64
    };
    let others = (0..cameras.len()).filter(|&other| other != index);
    let mut scored: Vec<(f64, usize)> = others.map(|other| (score(other), other)).collect();
    scored.retain(|(score, _)| *score > LEAST_SCORE);
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    scored.iter().take(options.neighbours).map(|(_, other)| *other).collect()
}

/// How far the middle of an image moves in another from one end of the range to the other \[px\].
fn moved_px(camera: &Camera, other: &Camera, range: [f64; 2]) -> f64 {
    let way = Way::new(camera, other);
    let middle = Vec3::new(0.5 * camera.width as f32, 0.5 * camera.height as f32, 1.0);
    let [near, far] = range.map(|depth| {
        let p = way.turn * middle + way.shift / depth as f32;
        (p.truncate() / p.z.max(1e-3)).as_dvec2()
    });
    near.distance(far)
}

pub(super) fn median<T: Copy>(some: &mut [T], order: impl Fn(&T, &T) -> std::cmp::Ordering) -> Option<T> {
    some.sort_by(order);
    some.get(some.len() / 2).copied()
}
