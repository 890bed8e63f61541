//! A photograph against the scene: what has to be moved for the two to agree.
//!
//! Direct alignment (Engel, Koltun and Cremers, *Direct Sparse Odometry*, 2018; Lucas and Kanade, 1981) of a photograph with what the scene
//! shows at the measured pose: Gauss-Newton on ten numbers from coarse to fine, with the scene drawn anew in every step. Slopes come
//! from the drawn picture and its depth, not from a derivative of the rasteriser: where they are wrong, at occlusions, the steps get
//! longer or shorter, and the weights leave those pixels out.

use crate::CameraError;
use crate::error::raster_error;
use crate::footage::Intrinsics;
use crate::path::{Twist, pose_of, twist_of};
use crate::picture::Picture;
use qv_core::{Camera, GaussianCloud, Pose};
use qv_fit::{Cholesky, Matrix};
use qv_raster::{Outputs, Scene, Settings, View, render};

/// Numbers that a photograph is off by: translation \[m\] and rotation \[rad\] in camera axes, logarithm of the focal length, variance of
/// a blur \[px² of the working picture\], logarithm of the gain of displayed values, offset of displayed values.
pub const NUMBERS: usize = 10;
/// The first eight are geometry, the last two brightness.
pub(crate) const GEOMETRY: usize = 8;
/// Deviations that are ever looked for, one photograph at a time: what keeps a photograph of a blank wall from running away. An offset of
/// displayed values is held near 0: a scene that lacks contrast would otherwise pass as one that is darker and brightened.
const REACH: [f64; NUMBERS] = [0.12, 0.12, 0.12, 0.12, 0.12, 0.12, 0.1, 4.0, 0.7, 0.01];
/// Residuals of neighbouring pixels go together: so many count as one.
const PIXELS_PER_NUMBER: f64 = 50.0;
/// Opacity from which the scene is there.
const SOLID: f32 = 0.8;
/// Border that is left out \[px\].
const BORDER: usize = 2;
/// The picture is drawn this many times larger along each side and averaged: the rasteriser's low-pass of 0.3 px² would blur it.
const FINER: u32 = 2;
/// Residual of displayed brightness beyond which a pixel shows something else than the scene.
const FOREIGN: f64 = 0.2;
/// Largest displayed value.
const FULL: f32 = 1.0;
/// Most steps on each level.
const STEPS: usize = 6;

/// One number for each that a photograph is off by.
pub type Numbers = [f64; NUMBERS];

/// What a photograph is off by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offsets {
    /// `camera_from_nominal`: where the camera was, seen from where it should have been.
    pub camera_from_nominal: Pose,
    /// Logarithm of the focal length over the nominal one.
    pub focal: f64,
    /// Variance of a blur \[px² of the working picture\]; negative where the photograph is sharper than the scene.
    pub blur: f64,
    /// Logarithm of the factor on displayed values.
    pub gain: f64,
    /// Added to displayed values.
    pub bias: f64,
}

impl Offsets {
    /// None.
    pub const NONE: Self = Self { camera_from_nominal: Pose::IDENTITY, focal: 0.0, blur: 0.0, gain: 0.0, bias: 0.0 };

    /// As ten numbers.
    pub fn numbers(&self) -> [f64; NUMBERS] {
        let [a, b, c, d, e, f] = twist_of(&self.camera_from_nominal);
        [a, b, c, d, e, f, self.focal, self.blur, self.gain, self.bias]
    }

    /// Moved on by a step.
    fn moved(&self, step: &[f64]) -> Self {
        let twist: Twist = std::array::from_fn(|i| step[i]);
        Self {
            camera_from_nominal: pose_of(&twist) * self.camera_from_nominal,
            focal: self.focal + step[6],
            blur: self.blur + step[7],
            gain: self.gain + step[8],
            bias: self.bias + step[9],
        }
    }
}

/// A photograph in several sizes with the camera where it should have been.
#[derive(Debug, Clone)]
pub struct Target {
    /// The camera of the whole photograph at the measured pose.
    pub camera: Camera,
    /// Colour that the scene was made to be drawn over.
    pub background: [f32; 3],
    /// Brightness from coarse to fine; not finite where there is no photograph.
    pub pictures: Vec<Picture>,
}

impl Target {
    /// Of a photograph's colours, 0 to 255 with a fourth number that is 0 where there is none, and the nominal camera. The finest picture
    /// has `width` columns.
    pub fn new(rgba: &[[u8; 4]], intrinsics: &Intrinsics, camera: Camera, width: usize) -> Self {
        let colour = |p: &[u8; 4]| match p[3] {
            0 => f32::NAN,
            _ => crate::picture::brightness([p[0], p[1], p[2]].map(|c| f32::from(c) / 255.0)),
        };
        let whole = Picture {
            width: intrinsics.width as usize,
            height: intrinsics.height as usize,
            values: rgba.iter().map(colour).collect(),
        };
        let mut pictures: Vec<Picture> =
            sizes(intrinsics, width).iter().rev().map(|&(w, h)| whole.shrunk(w, h)).collect();
        pictures.reverse();
        Self { camera, background: [0.0; 3], pictures }
    }

    /// The same for a scene that was made to be drawn over a colour; black otherwise.
    pub fn over(self, background: [f32; 3]) -> Self {
        Self { background, ..self }
    }

    /// Levels.
    pub fn levels(&self) -> usize {
        self.pictures.len()
    }

    fn finest(&self) -> &Picture {
        self.pictures.last().expect("there is a level")
    }
}

/// Sizes of the levels from coarse to fine.
pub fn sizes(intrinsics: &Intrinsics, width: usize) -> Vec<(usize, usize)> {
    let fine = width.min(intrinsics.width as usize).max(16);
    let size = |w: usize| {
        let h = (w as f64 * f64::from(intrinsics.height) / f64::from(intrinsics.width)).round() as usize;
        (w, h.max(8))
    };
    [4, 2, 1].iter().map(|divisor| size((fine / divisor).max(16))).collect()
}

/// What the scene shows.
pub struct RenderedView {
    /// Brightness.
    pub picture: Picture,
    /// Depth \[m\]; 0 where the scene is not solid.
    pub depth: Vec<f32>,
    /// Red, green, blue, shape `[height, width, 3]`.
    pub colour: Vec<f32>,
}

/// Draws the scene for a camera with offsets as a picture of the given size.
///
/// # Errors
/// The rasteriser's.
pub fn draw(
    cloud: &GaussianCloud,
    target: &Target,
    offsets: &Offsets,
    size: (usize, usize),
) -> Result<RenderedView, CameraError> {
    let camera = &target.camera;
    let (width, height) = (size.0 as u32 * FINER, size.1 as u32 * FINER);
    let (x, y) = (f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height));
    let focal = offsets.focal.exp();
    let camera = Camera {
        fx: camera.fx * x * focal,
        fy: camera.fy * y * focal,
        cx: camera.cx * x,
        cy: camera.cy * y,
        width,
        height,
        camera_from_world: offsets.camera_from_nominal * camera.camera_from_world,
    };
    let outputs = Outputs { depth: true, ..Default::default() };
    let settings = Settings { outputs, background: target.background, ..Default::default() };
    let (images, _) = render(&Scene::still(cloud), &[View::of(camera)], &settings).map_err(raster_error)?;
    let image = &images[0];
    let shrunk =
        |values: Vec<f32>| Picture { width: image.width, height: image.height, values }.shrunk(size.0, size.1).values;
    let channel = |c: usize| shrunk(image.colour.iter().skip(c).step_by(3).copied().collect());
    let channels = [channel(0), channel(1), channel(2)];
    let colour: Vec<f32> = (0..size.0 * size.1).flat_map(|i| [0, 1, 2].map(|c| channels[c][i])).collect();
    let alpha = shrunk(image.alpha.clone());
    let weighted = shrunk(image.depth.iter().zip(&image.alpha).map(|(d, a)| d * a).collect());
    let solid = |(d, a): (f32, f32)| if a >= SOLID { d / a } else { 0.0 };
    let depth = weighted.into_iter().zip(alpha).map(solid).collect();
    Ok(RenderedView { picture: Picture::of_colour(size.0, size.1, &colour), depth, colour })
}

/// The mean over pixels of r² / (1 + r² / c²) with residuals r of displayed brightness and c = 0.2 (Geman and McClure), and the share of
/// pixels that show the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disagreement {
    /// Mean of the loss.
    pub loss: f64,
    /// The same mean for a picture of one grey in place of the scene: a scene that does no better is not what the camera sees.
    pub blank: f64,
    /// Share of the pixels that count.
    pub seen: f64,
}

/// How far a photograph and the scene disagree on the finest level under given offsets.
///
/// # Errors
/// The rasteriser's.
pub fn disagreement(
    cloud: &GaussianCloud,
    target: &Target,
    offsets: &Offsets,
    level: usize,
) -> Result<Disagreement, CameraError> {
    let wanted = &target.pictures[level];
    let drawn = draw(cloud, target, offsets, (wanted.width, wanted.height))?;
    Ok(loss(wanted, &drawn, offsets, scale(target, level), FOREIGN))
}

/// How much smaller a level is than the finest.
fn scale(target: &Target, level: usize) -> f64 {
    target.pictures[level].width as f64 / target.finest().width as f64
}

fn loss(wanted: &Picture, drawn: &RenderedView, offsets: &Offsets, scale: f64, cut: f64) -> Disagreement {
    let shown = drawn.picture.blurred(offsets.blur * scale * scale);
    let (gain, bias) = (offsets.gain.exp() as f32, offsets.bias as f32);
    let (mut mean, mut count) = (0.0, 0usize);
    for_each_seen(wanted, drawn, |at| {
        mean += f64::from(wanted.values[at]);
        count += 1;
    });
    let pixels = count.max(1) as f64;
    mean /= pixels;
    let bounded = |r: f64| r * r / (1.0 + (r / cut).powi(2));
    let (mut sum, mut of_grey) = (0.0, 0.0);
    for_each_seen(wanted, drawn, |at| {
        sum += bounded(f64::from(wanted.values[at] - (gain * shown.values[at] + bias).min(FULL)));
        of_grey += bounded(f64::from(wanted.values[at]) - mean);
    });
    Disagreement { loss: sum / pixels, blank: of_grey / pixels, seen: count as f64 / wanted.values.len() as f64 }
}

fn for_each_seen(wanted: &Picture, drawn: &RenderedView, mut each: impl FnMut(usize)) {
    for y in BORDER..wanted.height.saturating_sub(BORDER) {
        for x in BORDER..wanted.width.saturating_sub(BORDER) {
            let at = y * wanted.width + x;
            if drawn.depth[at] > 0.0 && wanted.values[at].is_finite() {
                each(at);
            }
        }
    }
}

/// A photograph's offsets and how well they are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Offsets.
    pub offsets: Offsets,
    /// Inverse of the covariance that the picture alone would give.
    pub information: Matrix,
    /// On the finest level.
    pub disagreement: Disagreement,
}

/// Aligns a photograph on levels `from..to`, beginning at `start`.
///
/// # Errors
/// The rasteriser's.
pub fn align(
    cloud: &GaussianCloud,
    target: &Target,
    start: Offsets,
    levels: std::ops::Range<usize>,
) -> Result<Alignment, CameraError> {
    let mut offsets = start;
    let mut information = Matrix::identity(NUMBERS, NUMBERS);
    let mut disagreement = Disagreement { loss: f64::INFINITY, blank: 0.0, seen: 0.0 };
    for level in levels {
        (offsets, information, disagreement) = on_level(cloud, target, offsets, level)?;
    }
    Ok(Alignment { offsets, information, disagreement })
}

fn on_level(
    cloud: &GaussianCloud,
    target: &Target,
    start: Offsets,
    level: usize,
) -> Result<(Offsets, Matrix, Disagreement), CameraError> {
    let wanted = &target.pictures[level];
    let size = (wanted.width, wanted.height);
    let small = scale(target, level);
    // Small pictures say nothing of blur and little of the focal length.
    let frozen: &[usize] = if small < 1.0 { &[6, 7] } else { &[] };
    let mut offsets = start;
    let mut drawn = draw(cloud, target, &offsets, size)?;
    // Fixed on a level, so that steps lower one and the same loss.
    let cut = 2.5 * noise(wanted, &drawn, &offsets, small);
    let mut now = loss(wanted, &drawn, &offsets, small, cut);
    let (mut h, mut b) = normal(target, wanted, &drawn, &offsets, small, cut);
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let is_free = |i: usize, k: usize| !frozen.contains(&i) && !frozen.contains(&k);
        let a = Matrix::from_fn(NUMBERS, NUMBERS, |i, k| match (i == k, is_free(i, k)) {
            (true, true) => h[(i, i)] * (1.0 + damping),
            (true, false) => 1.0,
            (false, true) => h[(i, k)],
            (false, false) => 0.0,
        });
        let mut force = b;
        frozen.iter().for_each(|&i| force[i] = 0.0);
        let Some(step) = Cholesky::new(&a).map(|c| c.solve(&force)) else { break };
        let next = offsets.moved(&step);
        let then = draw(cloud, target, &next, size)?;
        let found = loss(wanted, &then, &next, small, cut);
        if found.loss < now.loss && found.seen > 0.5 * now.seen {
            let gained = now.loss - found.loss;
            (offsets, drawn, now) = (next, then, found);
            (h, b) = normal(target, wanted, &drawn, &offsets, small, cut);
            damping = (0.1 * damping).max(1e-6);
            if gained < 1e-3 * now.loss {
                break;
            }
        } else {
            damping = (damping * 30.0).max(1e-2);
            if damping > 10.0 {
                break;
            }
        }
    }
    Ok((offsets, h, loss(wanted, &drawn, &offsets, small, FOREIGN)))
}

/// Deviation of the residuals, from their median size.
fn noise(wanted: &Picture, drawn: &RenderedView, offsets: &Offsets, small: f64) -> f64 {
    let shown = drawn.picture.blurred(offsets.blur * small * small);
    let (gain, bias) = (offsets.gain.exp() as f32, offsets.bias as f32);
    let mut sizes = Vec::new();
    for_each_seen(wanted, drawn, |at| {
        sizes.push((wanted.values[at] - (gain * shown.values[at] + bias).min(FULL)).abs());
    });
    let middle = sizes.len() / 2;
    match sizes.is_empty() {
        true => 1.0,
        false => (1.4826 * f64::from(*sizes.select_nth_unstable_by(middle, f32::total_cmp).1)).max(4e-3),
    }
}

/// Normal equations of the weighted residuals in units of their noise, with the reach of each number as its prior.
fn normal(
    target: &Target,
    wanted: &Picture,
    drawn: &RenderedView,
    offsets: &Offsets,
    small: f64,
    cut: f64,
) -> (Matrix, Numbers) {
    let noise = noise(wanted, drawn, offsets, small);
    let shown = drawn.picture.blurred(offsets.blur * small * small);
    let [slope_x, slope_y] = shown.slopes();
    let bent = shown.laplacian();
    let (gain, bias) = (offsets.gain.exp(), offsets.bias);
    let full = f64::from(FULL);
    let camera = &target.camera;
    let focal = offsets.focal.exp();
    let (kx, ky) = (wanted.width as f64 / f64::from(camera.width), wanted.height as f64 / f64::from(camera.height));
    let (fx, fy, cx, cy) = (camera.fx * kx * focal, camera.fy * ky * focal, camera.cx * kx, camera.cy * ky);
    let (mut h, mut b) = ([[0.0; NUMBERS]; NUMBERS], [0.0; NUMBERS]);
    for_each_seen(wanted, drawn, |at| {
        let (px, py) = ((at % wanted.width) as f64 + 0.5 - cx, (at / wanted.width) as f64 + 0.5 - cy);
        let z = f64::from(drawn.depth[at]);
        let (x, y) = (px / fx, py / fy);
        // Along the slope of the picture: what is seen moves the other way than the place it is looked up at.
        let (gx, gy) = (-gain * f64::from(slope_x[at]) * fx, -gain * f64::from(slope_y[at]) * fy);
        let value = gain * f64::from(shown.values[at]) + bias;
        // Where the sensor is full nothing moves.
        if value >= full && f64::from(wanted.values[at]) >= full - 0.02 {
            return;
        }
        let r = f64::from(wanted.values[at]) - value.min(full);
        let j: Numbers = [
            gx / z,
            gy / z,
            -(gx * x + gy * y) / z,
            -gx * x * y - gy * (1.0 + y * y),
            gx * (1.0 + x * x) + gy * x * y,
            -gx * y + gy * x,
            gx * x + gy * y,
            0.5 * gain * small * small * f64::from(bent[at]),
            gain * f64::from(shown.values[at]),
            1.0,
        ];
        let weight = (1.0 + (r / cut).powi(2)).powi(-2) / (noise * noise * PIXELS_PER_NUMBER * small * small);
        for i in 0..NUMBERS {
            b[i] += weight * r * j[i];
            (0..=i).for_each(|k| h[i][k] += weight * j[i] * j[k]);
        }
    });
    let mut h = Matrix::from_fn(NUMBERS, NUMBERS, |i, k| h[i.max(k)][i.min(k)]);
    for (i, (at, reach)) in offsets.numbers().iter().zip(REACH).enumerate() {
        h[(i, i)] += 1.0 / (reach * reach);
        b[i] -= at / (reach * reach);
    }
    (h, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_behind_the_scene_is_drawn() {
        let intrinsics = Intrinsics { fx: 20.0, fy: 20.0, cx: 16.0, cy: 12.0, width: 32, height: 24 };
        let camera =
            Camera { fx: 20.0, fy: 20.0, cx: 16.0, cy: 12.0, width: 32, height: 24, camera_from_world: Pose::IDENTITY };
        let target = Target::new(&vec![[9, 9, 9, 255]; 32 * 24], &intrinsics, camera, 32);
        let drawn = |target: &Target| draw(&GaussianCloud::default(), target, &Offsets::NONE, (32, 24)).unwrap();
        assert!(drawn(&target).colour.iter().all(|c| *c == 0.0));
        let over = drawn(&target.over([0.25, 0.5, 0.75]));
        assert!(over.colour.chunks(3).all(|c| c == [0.25, 0.5, 0.75]) && over.depth.iter().all(|d| *d == 0.0));
    }
}
