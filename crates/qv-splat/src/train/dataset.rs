//! Photographs with pinhole cameras, some of them held out to score what was learned from the others.

use super::filter::{self, Sampling};
use super::undistort::{Pixels, smaller, undistorted};
use crate::SplatError;
use crate::captures::pictures::{self, ImageOrientation};
use crate::captures::{Capture, CaptureCamera, DepthFile};
use crate::error::off;
use glam::DVec3;
use qv_core::{Camera, GaussianCloud};
use qv_raster::{Outputs, Settings};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

/// A photograph without distortion.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// Name of its camera in the capture.
    pub name: String,
    /// How it was taken.
    pub camera: Camera,
    /// The photograph; masked where the mask is black or the lens shows nothing.
    pub pixels: Pixels,
    /// Measured depth along z \[m\], 0 where there is none, shape `[height, width]`; empty when not measured.
    pub depth: Vec<f32>,
    /// 0 where there is none, then 1 + the label, shape `[height, width]`; empty when not given.
    pub labels: Vec<u8>,
}

impl Photograph {
    /// Colours 0 to 1, shape `[height, width, 3]`.
    pub fn colour(&self) -> Vec<f32> {
        self.pixels.rgba.iter().flat_map(|p| [p[0], p[1], p[2]].map(|c| c as f32 * (1.0 / 255.0))).collect()
    }

    /// Which pixels count, shape `[height, width]`.
    pub fn valid(&self) -> Vec<bool> {
        self.pixels.rgba.iter().map(|p| p[3] != 0).collect()
    }
}

/// What training and scoring use.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Photographs to learn from, sorted by name.
    pub training: Vec<Photograph>,
    /// Photographs to score with, sorted by name.
    pub held_out: Vec<Photograph>,
    /// Largest distance of a camera from the mean of all, times 1.1 \[m\].
    pub extent: f32,
    /// Colour behind all Gaussians when photographs are drawn, 0 to 1: the mean of those to learn from, so that what none of them
    /// shows is wrong by less than if it were black.
    pub background: [f32; 3],
    /// Photographs are drawn with anti-aliasing: [`qv_raster::Settings::antialias`], and the filter of [`crate::train::filter`].
    pub antialias: bool,
    /// What of the capture could not be used, a line each.
    pub lost: Vec<String>,
    /// What was done with images that EXIF shows to turn, and how many.
    pub turned: BTreeMap<String, usize>,
}

/// How a capture is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Sides are divided by this.
    pub downscale: u32,
    /// Every so many, sorted by name and from the first on, one is held out; 0 holds out none.
    pub hold_out: usize,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { downscale: 1, hold_out: 8 }
    }
}

/// Gives the contents of a file of the capture by its path.
pub type Files<'a> = &'a (dyn Fn(&str) -> Result<Vec<u8>, String> + Sync);

impl Dataset {
    /// Decodes the images of a capture and takes their distortion away. Images that are missing, damaged, of another size than their camera
    /// says, or there twice are left out, and named in `lost`; so are depths and labels that cannot be read.
    ///
    /// # Errors
    /// Fewer than two photographs to learn from are left (the first that is lost is named), or no two of them look at the same place.
    pub fn new(capture: &Capture, files: Files, options: &ReadOptions) -> Result<Self, SplatError> {
        if options.downscale == 0 {
            return Err(off("capture, downscale", "at least 1", 0));
        }
        let mut cameras: Vec<&CaptureCamera> = capture.cameras.iter().collect();
        cameras.sort_by(|a, b| a.image.cmp(&b.image).then(a.name.cmp(&b.name)));
        let mut lost = capture.lost.clone();
        // The same photograph to learn from and to score with would be learned by heart.
        let mut known = BTreeSet::new();
        cameras.retain(|one| {
            let is_new = known.insert(one.image.as_deref().map(|path| path.trim_start_matches("./")));
            if !is_new {
                let place = format!("image {}", one.image.as_deref().unwrap_or_default());
                lost.push(off(place, "each image once", format!("it again as {}", one.name)).to_string());
            }
            is_new
        });
        let read = |one: &&CaptureCamera| photograph(one, files, options.downscale, capture.shown);
        let read: Vec<Result<_, SplatError>> = cameras.par_iter().map(read).collect();
        let (mut all, mut turned) = (vec![], BTreeMap::new());
        for one in read {
            match one {
                Ok((photograph, without, turn)) => {
                    all.push(photograph);
                    lost.extend(without.iter().map(ToString::to_string));
                    turn.into_iter().for_each(|what| *turned.entry(what).or_insert(0) += 1);
                }
                Err(error) => lost.push(error.to_string()),
            }
        }
        let dataset = match &capture.held_out {
            Some(held) => Self::split(all, &|_, one| held.contains(&one.name), "as the capture says"),
            None => Self::of_photographs(all, options.hold_out),
        };
        match (dataset, lost.first()) {
            (Err(error), Some(first)) => {
                let found = format!("{error}; {} lost; the first: {first}", lost.len());
                Err(off("capture", "images that can be read and learned from", found))
            }
            (dataset, _) => Ok(Self { lost, turned, ..dataset? }),
        }
    }

    /// Photographs that are there already, sorted by name.
    ///
    /// # Errors
    /// Fewer than two to learn from, or no two of them look at the same place.
    pub fn of_photographs(all: Vec<Photograph>, hold_out: usize) -> Result<Self, SplatError> {
        let is_held = |index: usize, _: &Photograph| hold_out > 0 && index.is_multiple_of(hold_out);
        Self::split(all, &is_held, &format!("one in {hold_out}"))
    }

    fn split(
        all: Vec<Photograph>,
        is_held: &dyn Fn(usize, &Photograph) -> bool,
        which: &str,
    ) -> Result<Self, SplatError> {
        let cameras: Vec<Camera> = all.iter().map(|one| one.camera).collect();
        let (mut training, mut held_out) = (vec![], vec![]);
        for (index, one) in all.into_iter().enumerate() {
            if is_held(index, &one) { held_out.push(one) } else { training.push(one) }
        }
        if training.len() < 2 {
            let found = format!("{} of {}, {which} held out", training.len(), cameras.len());
            return Err(off("capture", "at least 2 images to learn from", found));
        }
        let background = mean_colour(&training);
        let (lost, turned, extent) = (vec![], BTreeMap::new(), extent(&cameras));
        let dataset = Self { training, held_out, extent, background, antialias: false, lost, turned };
        let count = dataset.training.len();
        if dataset.alone().len() == count {
            let expected = "two images that show the same place";
            return Err(off("capture", expected, format!("no overlap between any of {count}")));
        }
        Ok(dataset)
    }

    /// All but the photographs.
    pub(super) fn without_photographs(&self) -> Self {
        let (lost, turned) = (self.lost.clone(), self.turned.clone());
        let (extent, background) = (self.extent, self.background);
        Self { training: vec![], held_out: vec![], extent, background, antialias: self.antialias, lost, turned }
    }

    /// What the photographs to learn from sample, with their cameras as they were given.
    pub fn sampling(&self) -> Sampling {
        let cameras: Vec<Camera> = self.training.iter().map(|one| one.camera).collect();
        Sampling::of(&cameras)
    }

    /// The Gaussians as they are drawn: with anti-aliasing filtered.
    pub fn filtered<'a>(&self, cloud: &'a GaussianCloud) -> Cow<'a, GaussianCloud> {
        match self.antialias {
            true => Cow::Owned(filter::seen(cloud, &self.sampling().deviations(&cloud.means))),
            false => Cow::Borrowed(cloud),
        }
    }

    /// How photographs are drawn.
    pub fn settings(&self, outputs: Outputs) -> Settings {
        Settings { outputs, background: self.background, antialias: self.antialias }
    }

    /// Whether all photographs to learn from were taken from one place, so that no two of them show a depth.
    pub fn stands_still(&self) -> bool {
        let place = |one: &Photograph| one.camera.camera_from_world.inverse().position;
        let first = self.training.first().map(place);
        let near = |one: &Photograph| {
            first.is_some_and(|first| place(one).distance(first) < SAME_PLACE * first.length().max(1.0))
        };
        self.training.iter().all(near)
    }

    /// Names of the photographs to learn from that show nothing which another could show: what is learned of it has no depth.
    pub fn alone(&self) -> Vec<&str> {
        let meets = |a: &Photograph, b: &Photograph| overlap(&a.camera, &b.camera) || overlap(&b.camera, &a.camera);
        let is_alone = |a: &&Photograph| !self.training.iter().any(|b| a.name != b.name && meets(a, b));
        self.training.iter().filter(is_alone).map(|one| one.name.as_str()).collect()
    }
}

/// Mean over all pixels that count; black where there are none.
fn mean_colour(photographs: &[Photograph]) -> [f32; 3] {
    let (mut sums, mut count) = ([0u64; 3], 0u64);
    for pixel in photographs.iter().flat_map(|one| &one.pixels.rgba).filter(|p| p[3] != 0) {
        (0..3).for_each(|c| sums[c] += u64::from(pixel[c]));
        count += 255;
    }
    sums.map(|sum| (sum as f64 / count.max(1) as f64) as f32)
}

fn extent(cameras: &[Camera]) -> f32 {
    let places: Vec<DVec3> = cameras.iter().map(|camera| camera.camera_from_world.inverse().position).collect();
    let mean = places.iter().sum::<DVec3>() / places.len().max(1) as f64;
    let far = places.iter().map(|place| place.distance(mean)).fold(0.0, f64::max);
    // Cameras that only turn have no extent; a metre is as good as any.
    if far > 0.0 { (1.1 * far) as f32 } else { 1.0 }
}

/// Distance of two cameras that stand in one place, as a share of that from the origin, or of a metre.
const SAME_PLACE: f64 = 1e-9;
/// Depths, in units of the distance of two cameras, at which they may see the same place.
const DEPTHS: [f64; 7] = [0.25, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0];

/// Whether a point in front of camera `a` is in the image of `b`.
fn overlap(a: &Camera, b: &Camera) -> bool {
    let world_from_a = a.camera_from_world.inverse();
    let apart = world_from_a.position.distance(b.camera_from_world.inverse().position);
    let unit = if apart > 0.0 { apart } else { 1.0 };
    let grid = [0.1, 0.3, 0.5, 0.7, 0.9];
    grid.iter().flat_map(|v| grid.iter().map(move |u| (u, v))).any(|(u, v)| {
        let ray = DVec3::new((u * a.width as f64 - a.cx) / a.fx, (v * a.height as f64 - a.cy) / a.fy, 1.0);
        DEPTHS.iter().any(|depth| {
            let p = b.camera_from_world.transform_point(world_from_a.transform_point(ray * (depth * unit)));
            let (x, y) = (b.fx * p.x / p.z + b.cx, b.fy * p.y / p.z + b.cy);
            p.z > 0.0 && (0.0..b.width as f64).contains(&x) && (0.0..b.height as f64).contains(&y)
        })
    })
}

/// A photograph, what beside it cannot be read, and how it was turned.
type PhotographRead = (Photograph, Vec<SplatError>, Option<String>);

fn photograph(
    one: &CaptureCamera,
    files: Files,
    downscale: u32,
    shown: ImageOrientation,
) -> Result<PhotographRead, SplatError> {
    let place = format!("camera {}", one.name);
    let path = one.image.as_deref().ok_or_else(|| off(&*place, "an image", "none"))?;
    let camera = &one.camera;
    let (decoded, turned) = decode_turned(path, files, camera, shown)?;
    let decoded = decoded.into_rgba8();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut pixels = Pixels { width, height, rgba: decoded.pixels().map(|p| p.0).collect() };
    let mask = one.attachments.mask.as_deref().map(|path| decode(path, files, camera)).transpose()?;
    let mask = mask.map(|mask| mask.into_luma8());
    for (index, pixel) in pixels.rgba.iter_mut().enumerate() {
        let masked = mask.as_ref().is_some_and(|mask| mask.as_raw()[index] == 0);
        pixel[3] = if masked || pixel[3] == 0 { 0 } else { 255 };
    }
    let (pixels, camera) = smaller(undistorted(pixels, camera, &one.distortion), camera, downscale);
    if pixels.rgba.iter().all(|pixel| pixel[3] == 0) {
        let expected =
            format!("a pixel that is not masked, shown by the lens and within {downscale} x {downscale} that are");
        return Err(off(format!("image {path}"), expected, "none"));
    }
    // For images that are not to be mixed: the pixel of the original that a pixel shows.
    let shown = |index: usize, of: &Camera| -> Option<usize> {
        let (x, y) = ((index % pixels.width) as f64 + 0.5, (index / pixels.width) as f64 + 0.5);
        let ray = glam::DVec2::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
        let bent = one.distortion.distort(ray);
        let (u, v) = (bent.x * of.fx + of.cx, bent.y * of.fy + of.cy);
        let inside = u >= 0.0 && v >= 0.0 && u < of.width as f64 && v < of.height as f64;
        inside.then(|| v as usize * of.width as usize + u as usize)
    };
    let count = pixels.rgba.len();
    let depth = one.attachments.depth.as_ref().map_or(Ok(vec![]), |file| {
        let of = file.camera.unwrap_or(one.camera);
        let units = depth_image(file, files, &of)?;
        let metres = |units: u16| if units == u16::MAX { 0.0 } else { (units as f64 * file.metres_per_unit) as f32 };
        Ok((0..count).map(|index| shown(index, &of).map_or(0.0, |at| metres(units[at]))).collect())
    });
    let labels = one.attachments.labels.as_deref().map_or(Ok(vec![]), |path| {
        let image = label_image(path, files, &one.camera)?;
        Ok((0..count).map(|index| shown(index, &one.camera).map_or(0, |at| image[at])).collect())
    });
    let mut without = vec![];
    let (depth, labels) = (or_none(depth, &mut without), or_none(labels, &mut without));
    let name = one.name.clone();
    Ok((Photograph { name, camera, pixels, depth, labels }, without, turned))
}

/// What was read, or nothing, and why.
fn or_none<T>(read: Result<Vec<T>, SplatError>, without: &mut Vec<SplatError>) -> Vec<T> {
    read.unwrap_or_else(|error| {
        without.push(error);
        vec![]
    })
}

/// An image beside a photograph.
fn decode(path: &str, files: Files, camera: &Camera) -> Result<image::DynamicImage, SplatError> {
    Ok(decode_turned(path, files, camera, ImageOrientation::Turned)?.0)
}

fn decode_turned(
    path: &str,
    files: Files,
    camera: &Camera,
    shown: ImageOrientation,
) -> Result<(image::DynamicImage, Option<String>), SplatError> {
    let bytes = files(path).map_err(|found| off(format!("image {path}"), "a file", found))?;
    let size = [camera.width, camera.height];
    let (image, turned) = pictures::decode(&bytes, size, shown)
        .map_err(|found| off(format!("image {path}"), "a JPEG or PNG image", found))?;
    if [image.width(), image.height()] != size {
        let expected = format!("{} x {} pixels, as its camera has", camera.width, camera.height);
        return Err(off(format!("image {path}"), expected, format!("{} x {}", image.width(), image.height())));
    }
    Ok((image, turned))
}

fn depth_image(file: &DepthFile, files: Files, camera: &Camera) -> Result<Vec<u16>, SplatError> {
    match decode(&file.path, files, camera)? {
        image::DynamicImage::ImageLuma16(image) => Ok(image.into_raw()),
        other => Err(off(format!("image {}", file.path), "grey values of 16 bits", format!("{:?}", other.color()))),
    }
}

fn label_image(path: &str, files: Files, camera: &Camera) -> Result<Vec<u8>, SplatError> {
    match decode(path, files, camera)? {
        image::DynamicImage::ImageLuma8(image) => Ok(image.into_raw()),
        // Grey made of colours, or of 16 bits, would be other labels.
        other => Err(off(format!("image {path}"), "labels as grey of 8 bits", format!("{:?}", other.color()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captures::{Attachments, distortion::Distortion};
    use crate::facts::States;
    use qv_core::Pose;

    fn capture(count: usize, turn: f64) -> Capture {
        let one = |k: usize| {
            let rotation = glam::DQuat::from_rotation_y(turn * k as f64);
            let camera_from_world = Pose { position: rotation * DVec3::new(-0.1 * k as f64, 0.0, 0.0), rotation };
            let camera = Camera { fx: 20.0, fy: 20.0, cx: 4.0, cy: 3.0, width: 8, height: 6, camera_from_world };
            CaptureCamera {
                name: format!("v{k}"),
                camera,
                distortion: Distortion::default(),
                image: Some(format!("v{k}.png")),
                attachments: Attachments::default(),
            }
        };
        Capture { cameras: (0..count).map(one).collect(), ..Capture::default() }
    }

    fn png(width: u32, height: u32, grey: u8) -> Vec<u8> {
        let mut out = std::io::Cursor::new(vec![]);
        let image = image::GrayImage::from_pixel(width, height, image::Luma([grey]));
        image.write_to(&mut out, image::ImageFormat::Png).unwrap();
        out.into_inner()
    }

    #[test]
    fn views_are_held_out_and_masked() {
        let mut capture = capture(9, 0.0);
        capture.cameras[1].attachments.mask = Some("mask.png".into());
        let half = image::GrayImage::from_fn(8, 6, |x, _| image::Luma([if x < 4 { 0 } else { 255 }]));
        let mut mask = std::io::Cursor::new(vec![]);
        half.write_to(&mut mask, image::ImageFormat::Png).unwrap();
        let files = |name: &str| Ok(if name == "mask.png" { mask.get_ref().clone() } else { png(8, 6, 128) });
        let data = Dataset::new(&capture, &files, &ReadOptions { downscale: 2, hold_out: 8 }).unwrap();
        let names: Vec<&str> = data.held_out.iter().map(|one| one.name.as_str()).collect();
        assert_eq!((names, data.training.len()), (vec!["v0", "v8"], 7));
        let one = &data.training[1];
        assert_eq!((one.camera.width, one.camera.fx, one.pixels.rgba[0]), (4, 10.0, [128, 128, 128, 255]));
        assert_eq!(data.training[0].valid()[..4], [false, false, true, true]);
        assert!(data.background.iter().all(|c| (c - 128.0 / 255.0).abs() < 1e-6), "{:?}", data.background);
        assert!((data.extent - 0.44).abs() < 1e-6, "{}", data.extent);
    }

    #[test]
    fn the_mean_colour_is_that_of_the_pixels_that_count() {
        let mut scene = super::super::tiny::scene(5, 2, 4);
        let colours = [[255, 0, 0, 255], [0, 51, 0, 255], [9, 9, 9, 0]];
        scene.dataset.training.iter_mut().for_each(|one| one.pixels.rgba = colours.to_vec());
        assert_eq!(mean_colour(&scene.dataset.training), [0.5, 0.1, 0.0]);
        assert_eq!(mean_colour(&[]), [0.0; 3]);
    }

    #[test]
    fn faults_are_named() {
        let fault = |capture: &Capture, files: Files, options: &ReadOptions| {
            Dataset::new(capture, files, options).unwrap_err().to_string()
        };
        let (good, options) = (|_: &str| Ok(png(8, 6, 128)), ReadOptions::default());
        let error = fault(&capture(3, 0.0), &|_| Ok(png(9, 6, 1)), &options);
        assert!(error.states("pixels 8 6 9 6"), "{error}");
        assert!(error.states("lost 3"), "{error}");
        let error = fault(&capture(3, 0.0), &|_| Ok(vec![1, 2]), &options);
        assert!(error.states("JPEG PNG"), "{error}");
        let error = fault(&capture(1, 0.0), &good, &ReadOptions { hold_out: 0, downscale: 1 });
        assert!(error.states("images 2 1 1"), "{error}");
        let error = fault(&capture(3, 1.5), &good, &options);
        assert!(error.states("overlap"), "{error}");
        let mut one_off = capture(4, 0.0);
        one_off.cameras[2].camera.camera_from_world.rotation = glam::DQuat::from_rotation_y(3.0);
        let read = Dataset::new(&one_off, &good, &ReadOptions { hold_out: 0, downscale: 1 }).unwrap();
        assert_eq!(read.alone(), vec!["v2"]);
        assert!(!read.stands_still());
        one_off.cameras.iter_mut().for_each(|one| one.camera.camera_from_world.position = DVec3::ZERO);
        assert!(Dataset::new(&one_off, &good, &options).unwrap().stands_still());
        let half_masked = |name: &str| if name.contains("mask") { Ok(png(8, 6, 0)) } else { good(name) };
        let mut masked = capture(3, 0.0);
        masked.cameras.iter_mut().for_each(|one| one.attachments.mask = Some("mask.png".into()));
        assert!(fault(&masked, &half_masked, &options).states("masked"));
    }

    #[test]
    fn what_cannot_be_used_is_left_out_and_named() {
        let mut capture = capture(7, 0.0);
        let twice = capture.cameras[6].clone();
        capture.cameras.push(CaptureCamera { name: "again".into(), image: Some("./v6.png".into()), ..twice });
        capture.cameras[1].attachments.mask = Some("m.png".into());
        capture.cameras[2].attachments.depth =
            Some(DepthFile { path: "d.png".into(), metres_per_unit: 1e-3, camera: None });
        capture.cameras[3].attachments.labels = Some("l.png".into());
        let mut colours = std::io::Cursor::new(vec![]);
        image::RgbImage::new(8, 6).write_to(&mut colours, image::ImageFormat::Png).unwrap();
        let files = |name: &str| match name {
            "v0.png" => Err("none".into()),
            "m.png" => Ok(png(8, 6, 0)),
            "l.png" => Ok(colours.get_ref().clone()),
            _ => Ok(png(8, 6, 9)),
        };
        let data = Dataset::new(&capture, &files, &ReadOptions { hold_out: 0, downscale: 1 }).unwrap();
        let names: Vec<&str> = data.training.iter().map(|one| one.name.as_str()).collect();
        assert_eq!(names.len(), 5, "{names:?}");
        assert!(!names.contains(&"v0") && !names.contains(&"v1"), "{names:?}");
        assert!(data.training.iter().all(|one| one.depth.is_empty() && one.labels.is_empty()));
        for (lost, expected) in data.lost.iter().zip([
            "v6.png: expected each image once, found it again as",
            "image v0.png: expected a file, found none",
            "image v1.png: expected a pixel that is not masked",
            "image d.png: expected grey values of 16 bits",
            "image l.png: expected labels as grey of 8 bits, found Rgb8",
        ]) {
            assert!(lost.contains(expected), "{lost}, {expected}");
        }
        assert_eq!(data.lost.len(), 5, "{:?}", data.lost);
    }
}
