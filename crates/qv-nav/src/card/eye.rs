//! The eye of [`SplatEye`] on a graphics card: all robots' pictures of a moment in one batch.

use crate::NavError;
use crate::eye::{Eye, FINER, Looks, Shot, SplatEye, finer};
use crate::net::{HEIGHT, WIDTH};
use qv_core::{GaussianCloud, Pose};
use qv_raster::gpu::{Gpu, GpuCloud, GpuOptions, GpuRasteriser, GpuSettings};
use qv_raster::{RasterError, Scene, Settings, View};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Draws what a [`SplatEye`] draws. All paints of a place lie in one cloud: each is a group that does not move and that is there in the episodes
/// which have this paint. So one batch has room for robots of all paints.
pub struct GpuEye {
    cloud: GaussianCloud,
    group_of: Vec<u32>,
    /// Groups of cones, which come first.
    cones: usize,
    looks: Looks,
    paints: usize,
    settings: Settings,
    card: Mutex<Card>,
}

/// What lies on the card.
struct Card {
    drawer: Drawer,
    cloud: GpuCloud,
}

/// What draws pictures of any cloud.
struct Drawer {
    rasteriser: GpuRasteriser,
    means: Means,
}

impl Drawer {
    fn new(gpu: Gpu) -> Result<Self, RasterError> {
        let means = Means::new(&gpu)?;
        Ok(Self { rasteriser: GpuRasteriser::new(gpu), means })
    }
}

/// Eyes for one place after another, several at once. Each has a device of its own, so that none waits for what another has submitted, and devices
/// are kept from place to place: a new one would compile its shaders anew.
pub struct GpuEyes {
    options: GpuOptions,
    idle: Mutex<Vec<Drawer>>,
}

impl GpuEyes {
    /// On an adapter.
    ///
    /// # Errors
    /// When the adapter cannot be used.
    pub fn new(options: GpuOptions) -> Result<Self, NavError> {
        let first = Drawer::new(Gpu::new(&options)?)?;
        Ok(Self { options, idle: Mutex::new(vec![first]) })
    }

    /// Calls `visit` with an eye on the card that sees what `eye` sees.
    ///
    /// # Errors
    /// When the cloud is too large for the device, or `visit` fails.
    pub fn lend(
        &self,
        eye: &SplatEye,
        visit: &mut dyn FnMut(&dyn Eye) -> Result<(), NavError>,
    ) -> Result<(), NavError> {
        let kept = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let drawer = kept.map_or_else(|| Drawer::new(Gpu::new(&self.options)?), Ok)?;
        let eye = GpuEye::with(eye, drawer)?;
        visit(&eye)?;
        let card = eye.card.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(card.drawer);
        Ok(())
    }
}

impl GpuEye {
    /// Copies an eye to a card.
    ///
    /// # Errors
    /// The clouds are too large for the device.
    pub fn new(eye: &SplatEye, gpu: Gpu) -> Result<Self, NavError> {
        Self::with(eye, Drawer::new(gpu)?)
    }

    fn with(eye: &SplatEye, drawer: Drawer) -> Result<Self, NavError> {
        let (clouds, groups) = eye.parts();
        let still = groups.iter().position(|group| *group > 0).unwrap_or(groups.len());
        let cones = groups.last().map_or(0, |last| *last as usize);
        let (mut cloud, mut group_of) = (part(&clouds[0], still..groups.len()), groups[still..].to_vec());
        for (k, paint) in clouds.iter().enumerate() {
            append(&mut cloud, &part(paint, 0..still));
            group_of.extend(std::iter::repeat_n((1 + cones + k) as u32, still));
        }
        let environments = [vec![None; cones + clouds.len()]];
        let scene = Scene { cloud: &cloud, group_of: &group_of, environments: &environments };
        let copy = GpuCloud::new(&drawer.rasteriser.gpu, &scene)?;
        let card = Mutex::new(Card { drawer, cloud: copy });
        let paints = clouds.len();
        Ok(Self { cloud, group_of, cones, looks: eye.looks(), paints, settings: eye.settings(), card })
    }

    /// Gaussians on the card: those of all paints and of the cones.
    pub fn count(&self) -> usize {
        self.cloud.len()
    }

    /// What the adapter is called.
    pub fn adapter(&self) -> String {
        let card = self.card.lock().unwrap_or_else(PoisonError::into_inner);
        card.drawer.means.gpu.info.name.clone()
    }

    /// Poses of the cones and of the paints, by group.
    fn groups(&self, shot: &Shot) -> Vec<Option<Pose>> {
        let mut groups = self.looks.groups(&shot.cones);
        groups.resize(self.cones + self.paints, None);
        groups[self.cones + SplatEye::paint_of(shot, self.paints)] = Some(Pose::IDENTITY);
        groups
    }
}

impl Eye for GpuEye {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        if shots.is_empty() {
            return Ok(Vec::new());
        }
        let size = |shot: &Shot| (shot.camera.width as usize, shot.camera.height as usize);
        if let Some((width, height)) = shots.iter().map(size).find(|size| *size != (WIDTH, HEIGHT)) {
            return Err(NavError::value("picture", &format!("{WIDTH} x {HEIGHT}"), format!("{width} x {height}")));
        }
        let environments: Vec<_> = shots.iter().map(|shot| self.groups(shot)).collect();
        let scene = Scene { cloud: &self.cloud, group_of: &self.group_of, environments: &environments };
        let view = |(environment, shot): (usize, &Shot)| View { camera: finer(&shot.camera), environment };
        let views: Vec<View> = shots.iter().enumerate().map(view).collect();
        let how = GpuSettings { bytes: true, ..Default::default() };
        let mut card = self.card.lock().unwrap_or_else(PoisonError::into_inner);
        let Card { drawer: Drawer { rasteriser, means }, cloud } = &mut *card;
        let mut sums = Vec::with_capacity(shots.len() * WIDTH * HEIGHT);
        rasteriser.render_all(cloud, &scene, &views, &self.settings, &how, |first, images, _| {
            // As many as the card had room for come at once.
            let pixels = images.pixels() / (FINER * FINER);
            debug_assert_eq!(sums.len(), first * WIDTH * HEIGHT);
            sums.extend(means.sums(images.colour(), pixels / (WIDTH * HEIGHT))?);
            Ok::<(), RasterError>(())
        })?;
        // A thread that waits for others may take up any work, such as another look: it must not hold the card then.
        drop(card);
        Ok(sums.par_chunks_exact(WIDTH * HEIGHT).map(shown).collect())
    }
}

/// The mean of each square of a picture as shown, 0 to 1.
fn shown(sums: &[u32]) -> Vec<f32> {
    let share = |sum: u32| (sum & 1023) as f32 / (255 * FINER * FINER) as f32;
    sums.iter().flat_map(|sum| [*sum, sum >> 10, sum >> 20].map(share)).collect()
}

/// Sums squares of pixels on the card, so that a quarter of the bytes comes back.
struct Means {
    gpu: Gpu,
    pipeline: wgpu::ComputePipeline,
    /// Room for the sums of so many pictures.
    room: (usize, wgpu::Buffer),
}

/// Threads of a workgroup: two rows of a picture.
const THREADS: usize = 2 * WIDTH;

impl Means {
    fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        let (width, height) = (FINER * WIDTH, FINER * HEIGHT);
        // Four bytes add up to less than 1024: red, green and blue have room in one word.
        let text = format!(
            "@group(0) @binding(0) var<storage, read> fine: array<u32>;
@group(0) @binding(1) var<storage, read_write> coarse: array<u32>;
@compute @workgroup_size({THREADS})
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {{
  let pixel = group.x * {THREADS}u + thread;
  let corner = (group.y * {height}u + {FINER}u * (pixel / {WIDTH}u)) * {width}u + {FINER}u * (pixel % {WIDTH}u);
  var sum = 0u;
  for (var k = 0u; k < {square}u; k++) {{
    let colour = fine[corner + (k / {FINER}u) * {width}u + k % {FINER}u];
    sum += (colour & 255u) | (((colour >> 8u) & 255u) << 10u) | (((colour >> 16u) & 255u) << 20u);
  }}
  coarse[group.y * {pixels}u + pixel] = sum;
}}
",
            square = FINER * FINER,
            pixels = WIDTH * HEIGHT,
        );
        let device = gpu.device.clone();
        let own = Gpu::of_device(device, gpu.queue.clone(), gpu.info.clone(), &GpuOptions::default())?;
        let pipeline = super::pipeline(&own, "means", &text);
        let room = (0, own.buffer("means", 0)?);
        Ok(Self { gpu: own, pipeline, room })
    }

    /// Of the pictures that a buffer begins with: a word for each pixel, red in its lowest ten bits, then green, then blue.
    fn sums(&mut self, pictures: &wgpu::Buffer, count: usize) -> Result<Vec<u32>, RasterError> {
        if self.room.0 < count {
            self.room = (count, self.gpu.buffer("means", 4 * (count * WIDTH * HEIGHT) as u64)?);
        }
        let group = super::bind(&self.gpu, &self.pipeline, &[pictures, &self.room.1]);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((WIDTH * HEIGHT / THREADS) as u32, count as u32, 1);
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.read(&self.room.1, count * WIDTH * HEIGHT)
    }
}

/// Some Gaussians of a cloud.
fn part(cloud: &GaussianCloud, range: std::ops::Range<usize>) -> GaussianCloud {
    let (bands, features) = (cloud.sh_count(), cloud.feature_count);
    GaussianCloud {
        means: cloud.means[range.clone()].to_vec(),
        log_scales: cloud.log_scales[range.clone()].to_vec(),
        rotations: cloud.rotations[range.clone()].to_vec(),
        opacity_logits: cloud.opacity_logits[range.clone()].to_vec(),
        sh: cloud.sh[bands * range.start..bands * range.end].to_vec(),
        features: cloud.features[features * range.start..features * range.end].to_vec(),
        ..cloud.clone()
    }
}

/// Adds the Gaussians of a cloud of the same kind.
fn append(cloud: &mut GaussianCloud, other: &GaussianCloud) {
    cloud.means.extend_from_slice(&other.means);
    cloud.log_scales.extend_from_slice(&other.log_scales);
    cloud.rotations.extend_from_slice(&other.rotations);
    cloud.opacity_logits.extend_from_slice(&other.opacity_logits);
    cloud.sh.extend_from_slice(&other.sh);
    cloud.features.extend_from_slice(&other.features);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bare::Bare;
    use crate::sight::{Cone, Rig};
    use qv_core::TriangleMesh;
    use qv_core::glam::DVec3;

    #[test]
    fn it_sees_what_the_eye_on_the_cpu_sees() {
        let gpu = match Gpu::new(&Default::default()) {
            Ok(gpu) => gpu,
            Err(why) => return crate::skipped::skipped(why),
        };
        let floor = [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let wall = [(4.0, 0.0), (-4.0, 0.0), (-4.0, 2.0), (4.0, 2.0)].map(|(y, z)| DVec3::new(3.0, y, z));
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let place = TriangleMesh { vertices: [floor, wall].concat(), triangles, ..Default::default() };
        let cpu = SplatEye::bare(&place, &Bare { spacing: 0.1, paints: 3 }, 7).unwrap();
        let cpu = cpu.as_made(Some([0.9, 0.3, 0.1]), true);
        let card = GpuEye::new(&cpu, gpu).unwrap();
        let shot = |k: u64| {
            let base = Pose::from_xyz_rpy([0.1 * k as f64, 0.0, 0.3], [0.0, 0.0, 0.2 * k as f64]);
            let cone = |colour, x| Cone { place: [x, 0.2, 0.0], height: 0.45, colour, look: k as usize, turn: 0.3 };
            let cones = (0..k as usize % 4).map(|c| cone(c, 1.2 + 0.5 * c as f64)).collect();
            Shot { camera: Rig::default().camera(&base), cones, seed: k << 8 }
        };
        let shots: Vec<Shot> = (0..7).map(shot).collect();
        // The drawer of one place draws another, whose cloud has another size.
        let eyes = GpuEyes::new(GpuOptions::default()).unwrap();
        let other = SplatEye::bare(&place, &Bare { spacing: 0.2, paints: 1 }, 8).unwrap();
        eyes.lend(&other, &mut |eye| eye.look(&shots).map(drop)).unwrap();
        let mut lent = Vec::new();
        eyes.lend(&cpu, &mut |eye| {
            lent = eye.look(&shots)?;
            Ok(())
        })
        .unwrap();
        assert_eq!(lent, card.look(&shots).unwrap());
        // Another number of shots after the first batch, as when episodes end.
        for shots in [&shots[..], &shots[2..5], &[]] {
            let (expected, found) = (cpu.look(shots).unwrap(), card.look(shots).unwrap());
            assert_eq!(expected.len(), found.len());
            let off = expected.iter().flatten().zip(found.iter().flatten()).map(|(a, b)| (a.clamp(0.0, 1.0) - b).abs());
            let off: Vec<f32> = off.collect();
            let (mean, most) =
                (off.iter().sum::<f32>() / off.len().max(1) as f32, off.iter().fold(0.0, |m: f32, x| m.max(*x)));
            println!("{} on {}: mean difference {mean:e}, greatest {most}", shots.len(), card.adapter());
            assert_eq!(off.len(), shots.len() * 80 * 60 * 3);
            // Bytes are rounded before four of them are averaged.
            assert!(mean < 1.5e-3 && most < 0.02, "{mean} {most}");
        }
    }
}
