//! Stereo on scenes of which depth is known in each pixel.

use super::*;
use crate::facts::States;
use crate::train::{Photograph, Pixels};
use glam::{DQuat, DVec2, DVec3};
use qv_core::{Camera, Pose};

const WIDTH: u32 = 120;
const HEIGHT: u32 = 90;
/// Half of the side of the square on the far wall that is of one colour \[m\].
const PLAIN: f64 = 0.3;

/// A grey of a place, 0 to 1: noise on a lattice, mixed smoothly, of two sizes.
fn texture(at: DVec2) -> f64 {
    let corner = |p: DVec2| {
        let mut hash = (p.x as i64 as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
            ^ (p.y as i64 as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        hash ^= hash >> 29;
        hash = hash.wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (hash >> 40) as f64 / (1u64 << 24) as f64
    };
    let smooth = |at: DVec2| {
        let (low, share) = (at.floor(), at - at.floor());
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let row = |dy: f64| mix(corner(low + DVec2::new(0.0, dy)), corner(low + DVec2::new(1.0, dy)), share.x);
        mix(row(0.0), row(1.0), share.y)
    };
    0.5 * smooth(20.0 * at) + 0.5 * smooth(7.0 * at + 100.0)
}

/// What a ray meets: a floor at y = 0.6 (y down), a wall at z = 3 with a plain square, and left of x = -0.4 a step before it at z = 2.4.
fn meet(from: DVec3, ray: DVec3) -> (f64, f64) {
    let floor = (0.6 - from.y) / ray.y;
    let step = (2.4 - from.z) / ray.z;
    let wall = (3.0 - from.z) / ray.z;
    let on_step = from + step * ray;
    let (way, at) = if on_step.x < -0.4 { (step, on_step) } else { (wall, from + wall * ray) };
    if ray.y > 0.0 && floor < way {
        let at = from + floor * ray;
        return (floor, texture(DVec2::new(at.x, at.z)));
    }
    let is_plain = (at.x - 0.5).abs() < PLAIN && (at.y + 0.2).abs() < PLAIN && way == wall;
    (way, if is_plain { 0.5 } else { texture(at.truncate()) })
}

fn photograph(name: usize, camera: Camera) -> Photograph {
    let world_from_camera = camera.camera_from_world.inverse();
    let (mut rgba, mut depth) = (vec![], vec![]);
    for (y, x) in (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (y, x))) {
        let look = |dx: f64, dy: f64| {
            let (u, v) = (f64::from(x) + dx, f64::from(y) + dy);
            let ray = DVec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
            meet(world_from_camera.position, world_from_camera.rotation * ray)
        };
        let grid = [0.125, 0.375, 0.625, 0.875];
        let grey = grid.iter().flat_map(|dy| grid.iter().map(move |dx| look(*dx, *dy).1)).sum::<f64>() / 16.0;
        let grey = (255.0 * grey + 0.5) as u8;
        rgba.push([grey, grey, grey, 255]);
        depth.push(look(0.5, 0.5).0 as f32);
    }
    let pixels = Pixels { width: camera.width as usize, height: camera.height as usize, rgba };
    Photograph { name: format!("v{name}"), camera, pixels, depth, labels: vec![] }
}

fn camera(place: DVec3, turn: f64) -> Camera {
    let world_from_camera = Pose { position: place, rotation: DQuat::from_rotation_y(turn) };
    let (width, height) = (WIDTH, HEIGHT);
    let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
    Camera { fx: 100.0, fy: 100.0, cx, cy, width, height, camera_from_world: world_from_camera.inverse() }
}

/// Photographs without depth, and their depth.
fn scene(count: usize) -> (Dataset, Vec<Vec<f32>>) {
    let place = |k: usize| DVec3::new(0.15 * k as f64 - 0.3, 0.05 * (k % 2) as f64, 0.04 * (k % 3) as f64);
    let mut all: Vec<Photograph> =
        (0..count).map(|k| photograph(k, camera(place(k), 0.03 * (2.0 - k as f64)))).collect();
    let truth = all.iter_mut().map(|one| std::mem::take(&mut one.depth)).collect();
    (Dataset::of_photographs(all, 0).unwrap(), truth)
}

/// Points on what the photographs show.
fn points() -> Points {
    let places = (0..200).map(|k| {
        let ray = DVec3::new(0.01 * f64::from(k % 20) - 0.1, 0.04 * f64::from(k / 20) - 0.1, 1.0) * 3.0;
        (meet(DVec3::ZERO, ray).0 * ray).as_vec3().to_array()
    });
    Points { places: places.collect(), colours: vec![[0.5; 3]; 200], ..Default::default() }
}

const SILENT: fn(usize, usize) = |_, _| ();

#[test]
fn depth_of_planes_is_measured_and_that_of_what_is_plain_is_not() {
    let (mut dataset, truth) = scene(5);
    let remarks = measure(&mut dataset, Some(&points()), &StereoOptions::default(), &SILENT).unwrap();
    assert_eq!(remarks.photographs, 5);
    let (one, truth) = (&dataset.training[2], &truth[2]);
    let (mut off, mut known, mut plain) = (vec![], 0, [0, 0]);
    let width = WIDTH as usize;
    for y in 8..HEIGHT as usize - 8 {
        for x in 20..width - 20 {
            let at = y * width + x;
            let patch = |d: usize| {
                let rows = y - d..=y + d;
                rows.flat_map(move |v| (x - d..=x + d).map(move |u| v * width + u))
            };
            let grey = |k: usize| one.pixels.rgba[k][0];
            if patch(4).all(|k| grey(k) == grey(at)) {
                plain[usize::from(one.depth[at] > 0.0)] += 1;
                continue;
            }
            known += 1;
            if one.depth[at] > 0.0 {
                off.push((one.depth[at] - truth[at]).abs() / truth[at]);
            }
        }
    }
    off.sort_by(f32::total_cmp);
    let share = off.len() as f64 / f64::from(known);
    let (median, most) = (off[off.len() / 2], off[off.len() * 95 / 100]);
    assert!(share > 0.8, "{share}");
    assert!(median < 0.004 && most < 0.03, "{median}, {most}");
    assert!(plain[0] > 100 && 20 * plain[1] < plain[0], "{plain:?}");
    // Both sides of the step are where they are, and nothing is between them.
    let level = |x: usize| {
        let mut column: Vec<f32> = (20..50).map(|y| one.depth[y * width + x]).filter(|z| *z > 0.0).collect();
        column.sort_by(f32::total_cmp);
        column[column.len() / 2]
    };
    let edge = (0..width).find(|x| truth[30 * width + x] > 2.8).unwrap();
    let before = truth[30 * width + edge - 6];
    assert!((level(edge - 6) - before).abs() < 0.02 && (level(edge + 6) - truth[30 * width + edge + 6]).abs() < 0.03);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let on = |threads: usize| {
        let (mut dataset, _) = scene(4);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let remarks =
            pool.install(|| measure(&mut dataset, Some(&points()), &StereoOptions::default(), &SILENT).unwrap());
        (remarks, dataset.training.into_iter().map(|one| one.depth).collect::<Vec<_>>())
    };
    let (remarks, depths) = on(1);
    assert!(remarks.share > 0.3, "{remarks:?}");
    assert_eq!((remarks, depths), on(3));
}

#[test]
fn without_points_the_extent_of_the_cameras_gives_the_range() {
    let (mut dataset, truth) = scene(5);
    let remarks = measure(&mut dataset, None, &StereoOptions::default(), &SILENT).unwrap();
    let both = dataset.training[2].depth.iter().zip(&truth[2]).filter(|(z, _)| **z > 0.0);
    let near = both.clone().filter(|(z, known)| (*z - *known).abs() < 0.03 * *known).count();
    assert!(remarks.share > 0.3 && 10 * near > 9 * both.count(), "{remarks:?}, {near}");
}

#[test]
fn measured_depth_stays_and_progress_is_told() {
    let (mut dataset, truth) = scene(4);
    dataset.training[1].depth.clone_from(&truth[1]);
    let count = AtomicUsize::new(0);
    let done = |at: usize, of: usize| {
        assert!(at >= 1 && at <= of && of == 4);
        count.fetch_add(1, Ordering::Relaxed);
    };
    let remarks = measure(&mut dataset, Some(&points()), &StereoOptions::default(), &done).unwrap();
    assert_eq!((remarks.photographs, count.into_inner()), (3, 4));
    assert_eq!(dataset.training[1].depth, truth[1]);
    assert!(dataset.training[0].depth.iter().any(|z| *z > 0.0));
}

#[test]
fn masked_pixels_have_no_depth_and_spoil_none() {
    let (mut dataset, truth) = scene(5);
    for one in &mut dataset.training {
        one.pixels.rgba.iter_mut().skip(30 * WIDTH as usize).take(10 * WIDTH as usize).for_each(|p| *p = [0; 4]);
    }
    measure(&mut dataset, Some(&points()), &StereoOptions::default(), &SILENT).unwrap();
    let depth = &dataset.training[2].depth;
    let row = |y: usize| y * WIDTH as usize..(y + 1) * WIDTH as usize;
    assert!((30..40).all(|y| depth[row(y)].iter().all(|z| *z == 0.0)));
    let off = row(15).filter(|k| depth[*k] > 0.0).map(|k| (depth[k] - truth[2][k]).abs() / truth[2][k]);
    assert!(off.clone().count() > 40 && off.filter(|e| *e > 0.05).count() < 5);
}

#[test]
fn too_few_photographs_are_named() {
    let wrong = |mut dataset: Dataset| {
        measure(&mut dataset, Some(&points()), &StereoOptions::default(), &SILENT).unwrap_err().to_string()
    };
    let error = wrong(scene(2).0);
    assert!(error.states("images 3") && error.ends_with("found 2"), "{error}");
    // From one place nothing shows depth.
    let (mut dataset, _) = scene(4);
    for one in &mut dataset.training {
        one.camera.camera_from_world.position = DVec3::ZERO;
    }
    let error = wrong(dataset);
    assert!(error.ends_with("found 0 of 4"), "{error}");
}
