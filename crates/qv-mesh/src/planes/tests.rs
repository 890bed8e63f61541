use super::picture::Picture;
use super::segments::segments;
use super::{Plane, RenderedFrame, lay_on_planes};
use crate::DepthFrame;
use crate::facts::States;
use glam::DVec3;
use qv_core::{Camera, Pose};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// Looks along z, from beside the origin.
fn camera(at: f64) -> Camera {
    let camera_from_world = Pose { position: DVec3::new(-at, 0.0, 0.0), ..Pose::IDENTITY };
    let (width, height) = (WIDTH as u32, HEIGHT as u32);
    Camera { fx: 120.0, fy: 120.0, cx: 80.0, cy: 60.0, width, height, camera_from_world }
}

/// What is seen of a wall at z = 2 m whose middle is a plain door; the door's depth is what `door` makes of the wall's.
fn frame(at: f64, door: impl Fn(f64) -> f64) -> (DepthFrame, Vec<f32>) {
    let camera = camera(at);
    let mut depth = vec![];
    let mut colour = vec![];
    for pixel in 0..WIDTH * HEIGHT {
        let (column, row) = ((pixel % WIDTH) as f64 + 0.5, (pixel / WIDTH) as f64 + 0.5);
        let (x, y) = (at + 2.0 * (column - camera.cx) / camera.fx, 2.0 * (row - camera.cy) / camera.fy);
        let in_door = x.abs() < 0.6 && y.abs() < 0.5;
        // 0 in the middle of the door, 1 at its border.
        let off = (x.abs() / 0.6).max(y.abs() / 0.5);
        depth.push(if in_door { door(off) } else { 2.0 } as f32);
        let bricks = 0.5 + 0.4 * (17.0 * x).sin() * (23.0 * y).sin();
        let c = if in_door { [0.6, 0.1, 0.1] } else { [bricks, bricks, 0.8 * bricks] };
        colour.extend(c.map(|c: f64| c as f32));
    }
    (DepthFrame { camera, depth, weight: vec![] }, colour)
}

fn frames(door: impl Fn(f64) -> f64 + Copy) -> (Vec<DepthFrame>, Vec<RenderedFrame>) {
    let all = [-0.2, 0.0, 0.2].map(|at| frame(at, door)).into_iter();
    all.map(|(frame, colour)| (frame.clone(), RenderedFrame { colour, depth: frame.depth })).unzip()
}

/// Largest distance of a frame's depths from 2 m, away from the door's border by two pixels.
fn off_the_wall(frame: &DepthFrame) -> f32 {
    let edge = |pixel: usize| {
        let at = |p: usize| (frame.depth[p] - frame.depth[pixel]).abs() > 0.2;
        pixel > 0 && at(pixel - 1)
    };
    (0..frame.depth.len()).filter(|p| !edge(*p)).map(|p| (frame.depth[p] - 2.0).abs()).fold(0.0, f32::max)
}

#[test]
fn a_plain_door_that_bends_behind_its_wall_is_laid_on_it() {
    // What shines is learned where its reflections are: up to 40 cm behind, right at the border.
    let dent = |off: f64| 2.0 + 0.4 * (1.0 - off * off);
    let (mut frames, drawn) = frames(dent);
    assert!(off_the_wall(&frames[0]) > 0.35);
    let laid = lay_on_planes(&mut frames, &drawn, 0.02).unwrap();
    let Plane { normal, offset } = laid.planes[0];
    assert!((normal + DVec3::Z).length() < 1e-3 && (offset + 2.0).abs() < 2e-3, "{:?}", laid.planes[0]);
    for frame in &frames {
        // The border has texture and keeps its own depth.
        assert!(off_the_wall(frame) < 0.07, "{}", off_the_wall(frame));
        assert!((frame.depth[HEIGHT / 2 * WIDTH + WIDTH / 2] - 2.0).abs() < 2e-3);
    }
    assert!((0.1..0.5).contains(&laid.share), "{}", laid.share);
}

#[test]
fn what_lies_deep_behind_or_has_texture_stays() {
    // An open door: what is behind is 1.5 m further.
    let (mut open, drawn) = frames(|_| 3.5);
    let before = open.clone();
    lay_on_planes(&mut open, &drawn, 0.02).unwrap();
    assert!(open.iter().zip(&before).all(|(a, b)| { a.depth.iter().zip(&b.depth).all(|(a, b)| (a - b).abs() < 0.05) }));
    // A bulge that has texture is seen; it is as it is.
    let (mut bulge, mut drawn) = frames(|off| 2.0 + 0.4 * (1.0 - off * off));
    for one in &mut drawn {
        for (k, c) in one.colour.iter_mut().enumerate() {
            *c = 0.5 + 0.4 * (((k / 3) % 5) as f32 - 2.0) / 2.0;
        }
    }
    let before = bulge.clone();
    let laid = lay_on_planes(&mut bulge, &drawn, 0.02).unwrap();
    assert_eq!((bulge, laid.share), (before, 0.0));
}

#[test]
fn a_region_beside_a_plane_is_not_drawn_out_from_it() {
    // Texture on the left alone; the plain right half goes away from the camera, as a wall round a corner does.
    let camera = camera(0.0);
    let mut depth = vec![2.0f32; WIDTH * HEIGHT];
    let mut colour = vec![0.4f32; 3 * WIDTH * HEIGHT];
    for pixel in 0..WIDTH * HEIGHT {
        let column = pixel % WIDTH;
        if column >= WIDTH / 2 {
            depth[pixel] = 2.0 + 0.006 * (column - WIDTH / 2) as f32;
        } else {
            let bright = 0.5 + 0.4 * (0.9 * column as f32).sin() * (0.7 * (pixel / WIDTH) as f32).sin();
            (0..3).for_each(|c| colour[3 * pixel + c] = bright);
        }
    }
    let mut frames = vec![DepthFrame { camera, depth: depth.clone(), weight: vec![] }];
    let drawn = RenderedFrame { colour, depth: depth.clone() };
    lay_on_planes(&mut frames, &[drawn], 0.02).unwrap();
    let moved = frames[0].depth.iter().zip(&depth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(moved < 0.05, "{moved}");
}

#[test]
fn regions_are_those_of_one_colour() {
    let (frame, colour) = frame(0.0, |_| 2.0);
    let picture = Picture::smoothed(&frame.camera, &colour);
    let regions = segments(&picture);
    let middle = (HEIGHT / 2 * WIDTH + WIDTH / 2) as u32;
    let door = regions.iter().find(|region| region.contains(&middle)).unwrap();
    // 72 x 60 pixels.
    assert!((3600..4800).contains(&door.len()), "{}", door.len());
    assert_eq!(regions.iter().map(Vec::len).sum::<usize>(), WIDTH * HEIGHT);
}

#[test]
fn nothing_to_see_lays_nothing_and_what_does_not_fit_is_named() {
    let (mut all, drawn) = frames(|_| 2.0);
    all.iter_mut().for_each(|frame| frame.depth.fill(0.0));
    let laid = lay_on_planes(&mut all, &drawn, 0.02).unwrap();
    assert_eq!((laid.planes.len(), laid.share), (0, 0.0));
    let (mut all, mut drawn) = frames(|_| 2.0);
    drawn.iter_mut().flat_map(|d| &mut d.colour).for_each(|c| *c = f32::NAN);
    assert_eq!(lay_on_planes(&mut all, &drawn, 0.02).unwrap().share, 0.0);
    drawn[1].colour.pop();
    let error = lay_on_planes(&mut all, &drawn, 0.02).unwrap_err().to_string();
    assert!(error.states("picture 1 57600 57599"), "{error}");
    drawn[0].depth.pop();
    let error = lay_on_planes(&mut all, &drawn, 0.02).unwrap_err().to_string();
    assert!(error.states("numbers 0 19200 19199"), "{error}");
    drawn.pop();
    assert!(lay_on_planes(&mut all, &drawn, 0.02).unwrap_err().to_string().states("each 3"));
    assert_eq!(lay_on_planes(&mut [], &[], 0.02).unwrap().share, 0.0);
}

/// How many pixels of the door get a depth when nothing of it was confirmed and `drawn` is what was drawn there.
fn laid_in_the_door(drawn: f32) -> usize {
    let (mut all, mut seen) = frames(|_| 3.5);
    let in_door = |depth: &f32| (*depth - 3.5).abs() < 1e-6;
    for (frame, seen) in all.iter_mut().zip(&mut seen) {
        frame.depth.iter_mut().filter(|d| in_door(d)).for_each(|d| *d = 0.0);
        seen.depth.iter_mut().filter(|d| in_door(d)).for_each(|d| *d = drawn);
    }
    let count = |all: &[DepthFrame]| all.iter().flat_map(|f| &f.depth).filter(|d| **d > 0.0).count();
    let before = count(&all);
    lay_on_planes(&mut all, &seen, 0.02).unwrap();
    count(&all) - before
}

#[test]
fn an_opening_stays_open_whether_what_is_behind_is_confirmed_or_not() {
    // A room behind, and the sky, of which nothing solid is drawn.
    assert_eq!([laid_in_the_door(3.5), laid_in_the_door(0.0)], [0, 0]);
    // A front that shines, drawn a little behind its wall, and what floats before it.
    assert!([laid_in_the_door(2.4), laid_in_the_door(0.7)].iter().all(|count| *count > 5000));
}
