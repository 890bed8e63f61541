//! `qv render`: what cameras see of a scene of Gaussians.

use crate::numbers::three;
use crate::outcome::about;
use crate::output::{make_folder, put, write_whole};
use crate::progress::progress;
use crate::scene::{open_cameras, open_scene};
use crate::terminal::print_message;
use crate::{Failure, Outcome, say};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use qv_core::GaussianCloud;
use qv_raster::{Image, Outputs, Scene, Settings, View};
use qv_splat::captures::CaptureCamera;
use qv_splat::lens::Distorter;
use serde_json::json;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv render scene.ply --cameras transforms.json --out out/views\n\
     \x20 qv render scene.spz --cameras colmap/sparse/0 --out out/views --depth --normals --json\n\
     \n\
     Cameras as JSON:\n\
     \x20 {\"format\": \"qv-cameras/1\", \"cameras\": [{\"name\": \"front\", \"width\": 640, \"height\": 480, \"fx\": 500,\n\
     \x20  \"position\": [0, -2, 1], \"rotation\": [1, 0, 0, 0]}]}\n\
     \n\
     Results: NAME.png; --depth NAME_depth.npy (metres along the camera's z, 0 = no surface); --normals NAME_normal.png (x right,\n\
     y down, z forward; -1 to 1 as 0 to 255); --semantics NAME_labels.png (0 = none, 1 + the strongest feature).\n\
     OpenCV distortion (k1, k2, k3, p1, p2) is applied.",
    "3 done, but part of the input was lost (reported)"
);

/// Images that are drawn before they are written: so many, or so many pixels, whichever is less, but one at least.
const AT_ONCE: usize = 128;
const PIXELS_AT_ONCE: usize = 3 << 24;
/// Opacity of a pixel from which on it has a label or a normal.
const SOLID: f32 = 0.5;

#[derive(clap::Args)]
pub struct Render {
    /// Gaussian scene: .ply, .compressed.ply, .spz, .glb, .gltf or .splat
    scene: PathBuf,
    /// Read cameras: transforms.json, a COLMAP model, or qv-cameras JSON
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    cameras: PathBuf,
    /// Write the images into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Write depth maps (32-bit floats, metres)
    #[arg(long, help_heading = "Output")]
    depth: bool,
    /// Write normal maps (camera axes)
    #[arg(long, help_heading = "Output")]
    normals: bool,
    /// Write label maps [the scene needs features]
    #[arg(long, help_heading = "Output")]
    semantics: bool,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
    /// Set the background colour (0 to 1) [default: that of the scene]
    #[arg(long, value_name = "R,G,B", value_parser = colour, help_heading = "Scene")]
    background: Option<[f32; 3]>,
    /// Render on the GPU
    #[cfg(feature = "gpu")]
    #[arg(long, help_heading = "Advanced")]
    gpu: bool,
}

fn colour(text: &str) -> Result<[f32; 3], String> {
    let colour = three(text, "R,G,B")?;
    let is_one = colour.iter().all(|c| (0.0..=1.0).contains(c));
    if is_one { Ok(colour.map(|c| c as f32)) } else { Err(format!("expected R,G,B from 0 to 1, found `{text}`")) }
}

impl Render {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let file = open_scene(&self.scene)?;
        let cameras = open_cameras(&self.cameras)?.cameras;
        if cameras.is_empty() {
            return Err(about(&self.cameras, "expected cameras, found none"));
        }
        if self.semantics && file.cloud.feature_count == 0 {
            return Err(about(
                &self.scene,
                "expected features for --semantics (PLY properties feature_0, ...), found none",
            ));
        }
        let mut lost = file.lost;
        if file.left_out > 0 {
            lost.push(format!("{} Gaussians whose numbers are not finite", file.left_out));
        }
        make_folder(&self.out).map_err(|e| about(&self.out, format!("expected a directory, found {e}")))?;
        let clock = Instant::now();
        let background = self.background.or(file.background).unwrap_or_default();
        let RenderResult { written, seconds, skipped } =
            self.draw(&file.cloud, &cameras, background, file.antialias)?;
        let total = clock.elapsed().as_secs_f64();
        if skipped > 0 {
            lost.push(format!("{skipped} times a Gaussian was left out of a view since its numbers overflow"));
        }
        if self.json {
            say(&format!(
                "{}\n",
                json!({"format": "qv-render/1", "scene": self.scene.display().to_string(),
                    "scene_format": file.format.name(), "gaussians": file.cloud.len(), "left_out": file.left_out,
                    "background": background, "images": written, "draw_s": seconds, "total_s": total, "lost": lost})
            ))?;
        } else {
            say(&format!(
                "{} Gaussians ({}), {} images, {:.3} s each to draw\nwritten to {}\n",
                file.cloud.len(),
                file.format.name(),
                cameras.len(),
                seconds / cameras.len() as f64,
                self.out.display()
            ))?;
        }
        lost.iter().for_each(|what| print_message!("lost from {}: {what}", self.scene.display()));
        Ok(if lost.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    /// Draws and writes all images.
    fn draw(
        &self,
        cloud: &GaussianCloud,
        cameras: &[CaptureCamera],
        background: [f32; 3],
        antialias: bool,
    ) -> Result<RenderResult, Failure> {
        let outputs = Outputs { depth: self.depth, plane: self.normals, features: self.semantics };
        let settings = Settings { outputs, background, antialias };
        // All lenses first, so that a bad one is found before the work.
        let lens = |one: &CaptureCamera| {
            Distorter::new(&one.camera, &one.distortion)
                .map_err(|e| about(&self.cameras, format!("camera {}: {e}", one.name)))
        };
        let lenses: Vec<Distorter> = cameras.iter().map(lens).collect::<Result<_, _>>()?;
        self.check_names(cameras)?;
        let mut drawer = self.drawer(cloud)?;
        let bar = progress(cameras.len() as u64, "rendering");
        let mut out = RenderResult::default();
        let pixels = lenses.iter().map(|lens| lens.pinhole.pixels()).max().unwrap_or(1);
        let at_once = (PIXELS_AT_ONCE / pixels.max(1)).clamp(1, AT_ONCE);
        for (some, lenses) in cameras.chunks(at_once).zip(lenses.chunks(at_once)) {
            let clock = Instant::now();
            let views: Vec<View> = lenses.iter().map(|lens| View::of(lens.pinhole)).collect();
            let (images, skipped) = drawer.draw(&views, &settings).map_err(|e| about(&self.scene, e))?;
            out.skipped += skipped;
            let images: Vec<Image> = lenses.iter().zip(images).map(|(lens, image)| lens.distort(image)).collect();
            out.seconds += clock.elapsed().as_secs_f64();
            for (one, image) in some.iter().zip(&images) {
                let files = self.write(&one.name, image, cloud.feature_count)?;
                out.written
                    .push(json!({"name": one.name, "width": image.width, "height": image.height, "files": files}));
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(out)
    }

    #[cfg(not(feature = "gpu"))]
    fn drawer<'a>(&self, cloud: &'a GaussianCloud) -> Result<Drawer<'a>, Failure> {
        Ok(Drawer::Cpu(cloud))
    }

    #[cfg(feature = "gpu")]
    fn drawer<'a>(&self, cloud: &'a GaussianCloud) -> Result<Drawer<'a>, Failure> {
        use qv_raster::gpu::{Gpu, GpuCloud, GpuOptions, GpuRasteriser};
        if !self.gpu {
            return Ok(Drawer::Cpu(cloud));
        }
        let gpu = Gpu::new(&GpuOptions::default())?;
        let copy = GpuCloud::new(&gpu, &Scene::still(cloud))?;
        Ok(Drawer::Gpu { cloud, copy, rasteriser: Box::new(GpuRasteriser::new(gpu)) })
    }

    /// No image may take the place of another.
    fn check_names(&self, cameras: &[CaptureCamera]) -> Result<(), Failure> {
        let mut taken = HashSet::new();
        for one in cameras {
            if let Some(clash) = self.files(&one.name).into_iter().find(|file| !taken.insert(file.clone())) {
                let name = &one.name;
                return Err(about(
                    &self.cameras,
                    format!("camera {name}: expected files of its own, found {clash} twice"),
                ));
            }
        }
        Ok(())
    }

    /// Names of the files of a camera: colour, then what else was asked for.
    fn files(&self, name: &str) -> Vec<String> {
        let more = [(self.depth, "_depth.npy"), (self.normals, "_normal.png"), (self.semantics, "_labels.png")];
        let asked = more.into_iter().filter(|(wanted, _)| *wanted).map(|(_, ending)| ending);
        std::iter::once(".png").chain(asked).map(|ending| format!("{name}{ending}")).collect()
    }

    /// Writes the images of one camera; returns the names of the files.
    fn write(&self, name: &str, image: &Image, features: usize) -> Result<Vec<String>, Failure> {
        let size = [image.width as u32, image.height as u32];
        let files = self.files(name);
        let mut paths = files.iter().map(|file| self.out.join(file));
        let mut next = || paths.next().unwrap_or_default();
        png(&next(), &image.colour_u8(), size, ExtendedColorType::Rgb8)?;
        if self.depth {
            let path = next();
            put(&path, npy(&image.depth, size)).map_err(|e| about(&path, unwritable(e)))?;
        }
        if self.normals {
            png(&next(), &normals(image), size, ExtendedColorType::Rgb8)?;
        }
        if self.semantics {
            png(&next(), &labels(image, features), size, ExtendedColorType::L8)?;
        }
        Ok(files)
    }
}

/// What came of drawing.
#[derive(Default)]
struct RenderResult {
    /// Names, sizes and files of the images.
    written: Vec<serde_json::Value>,
    /// Time that drawing took, without writing \[s\].
    seconds: f64,
    /// Gaussians that were left out because their numbers overflow, counted once for each view.
    skipped: usize,
}

/// What draws.
enum Drawer<'a> {
    Cpu(&'a GaussianCloud),
    #[cfg(feature = "gpu")]
    Gpu {
        cloud: &'a GaussianCloud,
        copy: qv_raster::gpu::GpuCloud,
        rasteriser: Box<qv_raster::gpu::GpuRasteriser>,
    },
}

impl Drawer<'_> {
    /// Images, and how many Gaussians were left out of them.
    fn draw(&mut self, views: &[View], settings: &Settings) -> Result<(Vec<Image>, usize), qv_raster::RasterError> {
        match self {
            Self::Cpu(cloud) => qv_raster::render(&Scene::still(cloud), views, settings),
            #[cfg(feature = "gpu")]
            Self::Gpu { cloud, copy, rasteriser } => {
                let how = qv_raster::gpu::GpuSettings::default();
                let mut all = Vec::with_capacity(views.len());
                let mut left_out = 0;
                rasteriser.render_all(copy, &Scene::still(cloud), views, settings, &how, |_, images, counts| {
                    left_out += counts.faulty;
                    all.extend(images.read()?);
                    Ok(())
                })?;
                Ok((all, left_out))
            }
        }
    }
}

fn unwritable(error: impl std::fmt::Display) -> String {
    format!("expected to write it, found {error}")
}

/// Writes a PNG.
pub fn png(path: &Path, bytes: &[u8], [width, height]: [u32; 2], kind: ExtendedColorType) -> Result<(), Failure> {
    let mut file = vec![];
    PngEncoder::new(&mut file).write_image(bytes, width, height, kind).map_err(|e| about(path, unwritable(e)))?;
    write_whole(path, &file)
}

/// NumPy's file of an array of 32-bit floats, shape `[height, width]` (format version 1.0: magic, length of the header, header
/// padded to 64 bytes, data).
fn npy(numbers: &[f32], [width, height]: [u32; 2]) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\0".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    out
}

/// Unit normals as bytes, shape `[height, width, 3]`; 0, 0, 0 where the scene is not solid.
fn normals(image: &Image) -> Vec<u8> {
    let byte = |x: f32| (x.mul_add(0.5, 0.5).clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixels = image.normal.chunks_exact(3).zip(&image.alpha);
    pixels
        .flat_map(|(normal, alpha)| {
            let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt();
            let solid = *alpha >= SOLID && length > 0.0;
            [0, 1, 2].map(|k| if solid { byte(normal[k] / length) } else { 0 })
        })
        .collect()
}

/// One plus the index of the largest feature, shape `[height, width]`; 0 where the scene is not solid.
fn labels(image: &Image, features: usize) -> Vec<u8> {
    let pixels = image.features.chunks_exact(features).zip(&image.alpha);
    pixels
        .map(|(scores, alpha)| {
            let best = (1..features).fold(0, |best, k| if scores[k] > scores[best] { k } else { best });
            if *alpha >= SOLID { best as u8 + 1 } else { 0 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn an_npy_file_is_as_numpy_has_it() {
        let bytes = npy(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [3, 2]);
        let header = u16::from_le_bytes([bytes[8], bytes[9]]) as usize;
        assert_eq!((&bytes[..8], (10 + header) % 64), (&b"\x93NUMPY\x01\0"[..], 0));
        assert!(std::str::from_utf8(&bytes[10..10 + header]).unwrap().states("'shape' 2 3"));
        assert_eq!(bytes[10 + header + 20..], 6.0f32.to_le_bytes());
    }

    #[test]
    fn labels_and_normals_need_something_solid() {
        let image = Image {
            width: 2,
            height: 1,
            alpha: vec![0.9, 0.1],
            normal: vec![0.0, 0.0, -0.5, 0.0, 0.0, -0.5],
            features: vec![0.1, 0.7, 0.2, 0.9, 0.0, 0.0],
            ..Default::default()
        };
        assert_eq!(labels(&image, 3), [2, 0]);
        assert_eq!(normals(&image), [128, 128, 0, 0, 0, 0]);
    }
}
