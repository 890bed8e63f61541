//! What a distorted camera sees: a wider pinhole image is drawn first, and every pixel of the distorted one is looked up in it.

use crate::SplatError;
use crate::captures::distortion::Distortion;
use crate::error::off;
use glam::DVec2;
use qv_core::Camera;
use qv_raster::Image;

/// Points along each edge of the image at which the wider camera's edges are found.
const EDGE_POINTS: u32 = 64;
/// The wider image may be this many times as wide and high; a lens that needs more is nearly folded.
const GROWTH: f64 = 4.0;
/// Pixels that the wider image has beyond them on each side, for interpolation.
const MARGIN: f64 = 2.0;
/// Points of a side at which a lens is looked at within the image: it may fold there and unfold before the edge.
const GRID_POINTS: u32 = 32;

/// A distorted camera as a pinhole camera and the way back.
#[derive(Debug, Clone, PartialEq)]
pub struct Distorter {
    /// What to draw: same focal lengths and pose, wide enough for all that the distorted image shows.
    pub pinhole: Camera,
    distorted: Camera,
    distortion: Distortion,
}

impl Distorter {
    /// For a camera with a distortion.
    ///
    /// # Errors
    /// The distortion folds within the image, so that there are pixels that no ray reaches, or the wider image would be too
    /// large.
    pub fn new(camera: &Camera, distortion: &Distortion) -> Result<Self, SplatError> {
        let mut out = Self { pinhole: *camera, distorted: *camera, distortion: *distortion };
        if distortion.is_none() {
            return Ok(out);
        }
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for point in edge(camera).chain(grid(camera)) {
            let ray = out.ray(point).filter(|ray| !distortion.folds_before(*ray)).ok_or_else(|| {
                let found = format!("a fold before pixel ({:.0}, {:.0})", point.x, point.y);
                off("distortion of a camera", "one that can be undone over the whole image", found)
            })?;
            low = low.min(ray);
            high = high.max(ray);
        }
        let focal = DVec2::new(camera.fx, camera.fy);
        let first = (low * focal - MARGIN).floor();
        let size = (high * focal + MARGIN).ceil() - first;
        let widest = GROWTH * (DVec2::new(f64::from(camera.width), f64::from(camera.height)) + MARGIN);
        if !size.cmple(widest).all() {
            let expected = format!("an undistorted image within {widest} pixels");
            return Err(off("distortion of a camera", expected, size));
        }
        (out.pinhole.cx, out.pinhole.cy) = (-first.x, -first.y);
        (out.pinhole.width, out.pinhole.height) = (size.x as u32, size.y as u32);
        out.pinhole.check().map_err(|error| off("distortion of a camera", "a camera when undone", error))?;
        Ok(out)
    }

    /// The point on the plane z = 1 that a pixel coordinate of the distorted image shows.
    fn ray(&self, pixel: DVec2) -> Option<DVec2> {
        let c = &self.distorted;
        self.distortion.undistort((pixel - DVec2::new(c.cx, c.cy)) / DVec2::new(c.fx, c.fy))
    }

    /// The distorted image of an image by [`Self::pinhole`]. Colour, alpha, normal and features are interpolated, depths are those
    /// of the nearest pixel, since a mean of near and far is neither.
    pub fn distort(&self, image: Image) -> Image {
        if self.distortion.is_none() {
            return image;
        }
        let (width, height) = (self.distorted.width as usize, self.distorted.height as usize);
        let pixels = width * height;
        let per_pixel = |array: &[f32]| array.len() / (image.width * image.height).max(1);
        let blank = |array: &[f32]| vec![0.0; per_pixel(array) * pixels];
        let mut out = Image {
            width,
            height,
            colour: blank(&image.colour),
            alpha: blank(&image.alpha),
            depth: blank(&image.depth),
            plane_depth: blank(&image.plane_depth),
            normal: blank(&image.normal),
            features: blank(&image.features),
        };
        let pinhole = &self.pinhole;
        for pixel in 0..pixels {
            let centre = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let Some(ray) = self.ray(centre) else { continue };
            let at = ray * DVec2::new(pinhole.fx, pinhole.fy) + DVec2::new(pinhole.cx, pinhole.cy);
            let sample = Sample::new(at, image.width, image.height);
            for (from, to) in [
                (&image.colour, &mut out.colour),
                (&image.alpha, &mut out.alpha),
                (&image.normal, &mut out.normal),
                (&image.features, &mut out.features),
            ] {
                sample.mixed(from, pixel, per_pixel(from), to);
            }
            for (from, to) in [(&image.depth, &mut out.depth), (&image.plane_depth, &mut out.plane_depth)] {
                if !from.is_empty() {
                    to[pixel] = from[sample.nearest];
                }
            }
        }
        out
    }
}

/// Pixel coordinates along the border.
fn edge(camera: &Camera) -> impl Iterator<Item = DVec2> {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    (0..=EDGE_POINTS).flat_map(move |step| {
        let share = f64::from(step) / f64::from(EDGE_POINTS);
        let (x, y) = (share * width, share * height);
        [DVec2::new(x, 0.0), DVec2::new(x, height), DVec2::new(0.0, y), DVec2::new(width, y)]
    })
}

/// Pixel coordinates all over the image.
fn grid(camera: &Camera) -> impl Iterator<Item = DVec2> {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let share = |step: u32| f64::from(step) / f64::from(GRID_POINTS);
    (0..=GRID_POINTS).flat_map(move |y| (0..=GRID_POINTS).map(move |x| size * DVec2::new(share(x), share(y))))
}

/// Four pixels around a place in an image, and their weights.
struct Sample {
    pixels: [usize; 4],
    weights: [f32; 4],
    nearest: usize,
}

impl Sample {
    fn new(at: DVec2, width: usize, height: usize) -> Self {
        let corner = (at - 0.5).clamp(DVec2::ZERO, DVec2::new(width as f64 - 1.0, height as f64 - 1.0));
        let (x, y) = (corner.x as usize, corner.y as usize);
        let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
        let share = (corner - corner.floor()).as_vec2();
        let nearest = (corner.x + 0.5) as usize + width * (corner.y + 0.5) as usize;
        Self {
            pixels: [y * width + x, y * width + right, below * width + x, below * width + right],
            weights: [
                (1.0 - share.x) * (1.0 - share.y),
                share.x * (1.0 - share.y),
                (1.0 - share.x) * share.y,
                share.x * share.y,
            ],
            nearest,
        }
    }

    fn mixed(&self, from: &[f32], pixel: usize, per_pixel: usize, to: &mut [f32]) {
        for k in 0..per_pixel {
            let parts = self.pixels.iter().zip(self.weights);
            to[pixel * per_pixel + k] = parts.map(|(at, weight)| from[at * per_pixel + k] * weight).sum();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use glam::DVec3;
    use qv_core::{GaussianCloud, Pose};
    use qv_raster::{Outputs, Scene, Settings, View, render};

    const CAMERA: Camera =
        Camera { fx: 90.0, fy: 92.0, cx: 60.5, cy: 45.0, width: 120, height: 90, camera_from_world: Pose::IDENTITY };

    #[test]
    fn points_are_seen_where_the_lens_shows_them() {
        let lens = Distortion { k1: -0.15, k2: 0.03, k3: 0.0, p1: 0.004, p2: -0.002 };
        let point = DVec3::new(0.7, -0.5, 1.6);
        let cloud = GaussianCloud {
            means: vec![point.as_vec3().to_array()],
            log_scales: vec![[-4.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            opacity_logits: vec![5.0],
            sh: vec![[1.0; 3]],
            ..Default::default()
        };
        let distorter = Distorter::new(&CAMERA, &lens).unwrap();
        assert!(distorter.pinhole.width > CAMERA.width && distorter.pinhole.fx == CAMERA.fx);
        let settings = Settings { outputs: Outputs { depth: true, ..Default::default() }, ..Default::default() };
        let (mut images, _) = render(&Scene::still(&cloud), &[View::of(distorter.pinhole)], &settings).unwrap();
        let image = distorter.distort(images.remove(0));
        assert_eq!((image.width, image.height, image.colour.len()), (120, 90, 3 * 120 * 90));
        let (mut centre, mut total) = (DVec2::ZERO, 0.0);
        for (pixel, alpha) in image.alpha.iter().enumerate() {
            let place = DVec2::new((pixel % 120) as f64 + 0.5, (pixel / 120) as f64 + 0.5);
            centre += f64::from(*alpha) * place;
            total += f64::from(*alpha);
        }
        let shown = lens.distort(point.truncate() / point.z);
        let expected = DVec2::new(shown.x * CAMERA.fx + CAMERA.cx, shown.y * CAMERA.fy + CAMERA.cy);
        assert!((centre / total - expected).length() < 0.1, "{} {expected}", centre / total);
        let deepest = image.depth.iter().fold(0.0f32, |most, depth| most.max(*depth));
        assert!((deepest - 1.6).abs() < 1e-3, "{deepest}");
    }

    #[test]
    fn without_distortion_nothing_changes() {
        let distorter = Distorter::new(&CAMERA, &Distortion::default()).unwrap();
        assert_eq!(distorter.pinhole, CAMERA);
    }

    #[test]
    fn a_fold_that_unfolds_before_the_edge_is_an_error_too() {
        let fold = Distortion { k1: -1.5, k2: 1.0, ..Default::default() };
        let wide = Camera { fx: 300.0, fy: 300.0, cx: 320.0, cy: 240.0, width: 640, height: 480, ..CAMERA };
        assert!(Distorter::new(&wide, &fold).unwrap_err().to_string().states("before"));
    }

    #[test]
    fn a_fold_within_the_image_is_an_error() {
        let fold = Distortion { k1: -2.0, ..Default::default() };
        let error = Distorter::new(&CAMERA, &fold).unwrap_err().to_string();
        assert!(error.states("undone"), "{error}");
    }

    #[test]
    fn a_lens_that_needs_a_huge_image_is_an_error() {
        let wide = Distortion { k1: -0.2, ..Default::default() };
        let tiny = Camera { width: 4, height: 4, cx: 2.0, cy: 2.0, fx: 3.5, fy: 3.5, ..CAMERA };
        assert!(Distorter::new(&tiny, &wide).is_ok_and(|distorter| distorter.pinhole.width <= 24));
        let far = Camera { fx: 1e200, cx: -1e210, ..CAMERA };
        let error = Distorter::new(&far, &wide).unwrap_err().to_string();
        assert!(error.states("distortion"), "{error}");
    }
}
