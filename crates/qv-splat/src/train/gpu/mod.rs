//! Steps on the graphics card. Photographs, Gaussians, derivatives and the optimiser's memory stay there; within a step nothing is read
//! back. Opacities are read when Gaussians come and go, the loss when it is asked for.

mod store;
#[cfg(test)]
mod tests;

use super::adam::harmonics_weight;
use super::cpu::outputs;
use super::dataset::{Dataset, Photograph};
use super::drop::Drop;
use super::engine::Engine;
use super::guide::{self, ErrorSum, Guide};
use super::mcmc::Relocation;
use super::model::Model;
use super::moments::bias;
use super::options::{Strategy, TrainOptions};
use super::random::{Purpose, words};
use super::terms::multi_view;
use super::{classic, clear, vignetting};
use crate::SplatError;
use crate::error::off;
use qv_core::Camera;
use qv_raster::gpu::{GpuCameras, GpuRasteriser, GpuSettings, Job, Recorder, Stamps};
use qv_raster::training::{FOLD, Kernels, StepWords};
use qv_raster::{Outputs, RasterError, Settings, View};
use store::{Store, pose_of};

/// Trains on a graphics card.
#[derive(Debug)]
pub struct GpuEngine<'a> {
    dataset: &'a Dataset,
    options: TrainOptions,
    rasteriser: GpuRasteriser,
    how: GpuSettings,
    kernels: Kernels,
    store: Store,
    /// Photographs as words of four bytes.
    photographs: Vec<wgpu::Buffer>,
    cameras: GpuCameras,
    step: wgpu::Buffer,
    /// What the steps of a submission are reported, one after the other.
    remarks: wgpu::Buffer,
    /// Steps that were recorded and not submitted.
    recorded: Vec<wgpu::CommandBuffer>,
    maps: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// Derivatives by the lens, of each workgroup.
    bends: wgpu::Buffer,
    /// Derivatives by the coefficients of vignetting, of each workgroup.
    fades: wgpu::Buffer,
    /// Camera of each photograph.
    groups: wgpu::Buffer,
    report: wgpu::Buffer,
    list: wgpu::Buffer,
    /// Opacity logits while a step leaves some Gaussians out; none when that is not asked for.
    logits: Option<wgpu::Buffer>,
    /// Log scales and logits as they are learned and the filter's squared deviations while a step draws filtered ones, and the cameras that
    /// show the filter; none without anti-aliasing.
    filter: Option<(wgpu::Buffer, wgpu::Buffer, GpuCameras)>,
    /// Plane depths of each photograph as they were last drawn; none when no term asks for them.
    plane_depths: Vec<wgpu::Buffer>,
    /// Measured depths of each photograph; none when no term asks for them.
    measured: Vec<wgpu::Buffer>,
    /// Given normals of each photograph, a word for each pixel; none when no term asks for them.
    normals: Vec<wgpu::Buffer>,
    /// Labels of each photograph, a byte for each pixel; none when no term asks for them.
    labels: Vec<wgpu::Buffer>,
    /// For each photograph those that are near it.
    partners: Vec<Vec<usize>>,
    /// Without Gaussians but with everything else that is not on the card; poses as they came.
    rest: Model,
    /// Size of the photographs and what is drawn of them, for which the rasteriser is prepared.
    prepared: Option<([u32; 2], Outputs)>,
    stamps: Option<Stamps>,
}

/// How the card works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GpuTraining {
    /// Add up with atomics: faster, and the last bits differ from run to run.
    pub atomic: bool,
}

impl Default for GpuTraining {
    fn default() -> Self {
        Self { atomic: true }
    }
}

/// Bytes that a step is reported.
const WORDS: u64 = size_of::<StepWords>() as u64;
/// Steps that are submitted at once: a submission costs the card a pause.
const AT_ONCE: usize = 8;

const WAITS: &str = "graphics device";

impl<'a> GpuEngine<'a> {
    /// Begins, or goes on, with a model.
    ///
    /// # Errors
    /// Options are off, the model is not of this many photographs, or the device has no room.
    pub fn new(
        rasteriser: GpuRasteriser,
        dataset: &'a Dataset,
        options: &TrainOptions,
        model: Model,
        how: GpuTraining,
    ) -> Result<Self, SplatError> {
        options.check()?;
        model.cloud.check()?;
        model.check(dataset)?;
        if dataset.shutter.is_some() {
            let expected = "cameras at rest (the CPU learns motions during exposures)";
            return Err(off("training on the graphics card", expected, "a shutter"));
        }
        let w = &options.weights;
        let gpu = &rasteriser.gpu;
        let pixels = dataset.training.iter().map(|one| one.pixels.rgba.len()).max().unwrap_or(1) as u64;
        let sides = |of: fn(&Camera) -> u32| dataset.training.iter().map(|one| of(&one.camera)).max().unwrap_or(1);
        let groups = sides(|c| c.width).div_ceil(16) as u64 * sides(|c| c.height).div_ceil(16) as u64;
        let capacity = options.cap.max(model.cloud.len());
        let photographs = dataset.training.iter().map(|one| gpu.filled("photograph", &one.pixels.rgba));
        let size = |one: &Photograph| 4 * one.pixels.rgba.len() as u64;
        let plane_depths =
            dataset.training.iter().filter(|_| w.planes()).map(|one| gpu.buffer("plane depths", size(one)));
        let measured = dataset.training.iter().filter(|_| w.depth_prior > 0.0).map(|one| match one.depth.is_empty() {
            true => gpu.buffer("measured", size(one)),
            false => gpu.filled("measured", &one.depth),
        });
        let normals =
            dataset.training.iter().filter(|_| w.normal_prior > 0.0).map(|one| match one.normals.is_empty() {
                true => gpu.buffer("normals", size(one)),
                false => gpu.filled("normals", &one.normals.iter().map(signed_bytes).collect::<Vec<_>>()),
            });
        let labels = dataset.training.iter().filter(|_| w.labels > 0.0).map(|one| {
            let mut bytes = one.labels.clone();
            bytes.resize(one.pixels.rgba.len().next_multiple_of(4), 0);
            gpu.filled("labels", &bytes)
        });
        let cameras_as_given: Vec<Camera> = dataset.training.iter().map(|one| one.camera).collect();
        let mut rest = model.clone();
        rest.retain(&vec![false; model.cloud.len()]);
        Ok(Self {
            photographs: photographs.collect::<Result<_, _>>()?,
            plane_depths: plane_depths.collect::<Result<_, _>>()?,
            measured: measured.collect::<Result<_, _>>()?,
            normals: normals.collect::<Result<_, _>>()?,
            labels: labels.collect::<Result<_, _>>()?,
            partners: multi_view::partners(&cameras_as_given, dataset.extent),
            cameras: cameras(&rasteriser, dataset, &model)?,
            step: gpu.buffer("step", WORDS)?,
            remarks: gpu.buffer("remarks", WORDS * AT_ONCE as u64)?,
            recorded: vec![],
            maps: gpu.buffer("maps", 36 * pixels)?,
            sums: gpu.buffer("sums", 64 * groups)?,
            bends: gpu.buffer("bends", 16 * groups)?,
            fades: gpu.buffer("fades", 16 * groups)?,
            groups: gpu.filled("cameras", &model.groups.iter().map(|group| *group as u32).collect::<Vec<_>>())?,
            report: gpu.filled("report", &[0.0f32; 4])?,
            list: gpu.buffer("list", 16 * (capacity as u64 + 1))?,
            logits: (options.drop > 0.0).then(|| gpu.buffer("logits", 4 * capacity as u64)).transpose()?,
            filter: match dataset.antialias {
                true => Some((
                    gpu.buffer("learned", 16 * capacity as u64)?,
                    gpu.buffer("squares", 4 * capacity as u64)?,
                    GpuCameras::new(gpu, &cameras_as_given.iter().map(|camera| View::of(*camera)).collect::<Vec<_>>())?,
                )),
                false => None,
            },
            store: Store::new(gpu, &model, capacity)?,
            kernels: Kernels::new(gpu),
            dataset,
            options: *options,
            how: GpuSettings { keep: true, atomic: how.atomic, timed: false, bytes: false },
            rasteriser,
            rest,
            prepared: None,
            stamps: None,
        })
    }

    fn settings(&self) -> Settings {
        self.dataset.settings(outputs(&self.options, self.rest.iteration))
    }

    /// Makes the rasteriser ready for a photograph's size.
    fn prepare(&mut self, photograph: usize) -> Result<(), SplatError> {
        let camera = self.dataset.training[photograph].camera;
        let size = ([camera.width, camera.height], outputs(&self.options, self.rest.iteration));
        if self.prepared == Some(size) {
            return Ok(());
        }
        self.flush();
        let settings = self.settings();
        self.rasteriser.prepare_still(
            &self.store.cloud,
            &View::of(camera),
            self.store.capacity,
            &settings,
            &self.how,
        )?;
        // Derivatives of harmonics and features are cleared by whoever reads them; they begin as zeros.
        for buffer in ["by_sh", "by_feature"].iter().filter_map(|name| self.rasteriser.buffer(name)) {
            let mut encoder = self.rasteriser.gpu.device.create_command_encoder(&Default::default());
            encoder.clear_buffer(buffer, 0, None);
            self.rasteriser.gpu.queue.submit([encoder.finish()]);
        }
        self.prepared = Some(size);
        Ok(())
    }

    fn words(&self, photograph: usize) -> StepWords {
        let (options, weights) = (&self.options, &self.options.weights);
        let iteration = self.rest.iteration;
        let rates = options.rates(iteration, self.dataset.extent);
        let camera = &self.dataset.training[photograph].camera;
        let n = self.store.cloud.count.max(1) as f32;
        let mcmc = options.strategy == Strategy::Mcmc;
        let geometry = iteration >= options.geometry_from;
        let seen = iteration / self.dataset.training.len() as u32 + 1;
        let outputs = outputs(options, iteration);
        let features = if outputs.features { self.store.cloud.feature_count as u32 } else { 0 };
        let width = 9 + outputs.depth as u32 + 4 * outputs.plane as u32 + features;
        let group = self.rest.groups[photograph];
        let partner = self.partner(photograph);
        let random = words(options.seed, iteration, 1, Purpose::Pair);
        let from = [random[0] % multi_view::STRIDE, random[1] % multi_view::STRIDE];
        let looked = |side: u32, from: u32| side.saturating_sub(from).div_ceil(multi_view::STRIDE);
        let looked_at = looked(camera.width, from[0]) * looked(camera.height, from[1]);
        let other = &self.dataset.training[partner.unwrap_or(photograph)].camera;
        let pixels = camera.pixels() as f32;
        StepWords {
            count: self.store.cloud.count as u32,
            sh_count: (self.store.cloud.sh_degree as u32 + 1).pow(2),
            iteration,
            seed: options.seed,
            rates: [rates.means, rates.log_scales, rates.rotations, rates.opacities],
            colours: rates.colours,
            harmonics: rates.harmonics,
            bias: bias(iteration + 1),
            opacity: if mcmc { weights.opacity / n } else { 0.0 },
            scale: if mcmc { weights.scale / (3.0 * n * self.dataset.extent) } else { 0.0 },
            flat: if geometry { weights.flattening / (self.dataset.extent * n) } else { 0.0 },
            noise: if mcmc { options.noise_rate(iteration, self.dataset.extent) } else { 0.0 },
            width: camera.width,
            height: camera.height,
            photograph: photograph as u32,
            exposes: options.exposure as u32,
            ssim: weights.ssim,
            pixel: 1.0 / (3 * camera.pixels()) as f32,
            exposure_rate: rates.exposures,
            exposure_weight: weights.exposure,
            seen_bias: bias(seen),
            record_width: width,
            pose_rate: rates.poses,
            extent: self.dataset.extent,
            depth_prior: weights.depth_prior / pixels,
            depth_normal: weights.depth_normal / pixels,
            groups: camera.width.div_ceil(16) * camera.height.div_ceil(16),
            multi_view: weights.multi_view / looked_at.max(1) as f32,
            partner: partner.unwrap_or(photograph) as u32,
            partner_size: [other.width, other.height],
            from,
            normal_prior: weights.normal_prior / pixels,
            labels: weights.labels / pixels,
            feature_count: self.store.cloud.feature_count as u32,
            feature_rate: rates.features,
            photographs: self.dataset.training.len() as u32,
            camera: group as u32,
            refines: options.poses as u32 + 2 * options.lens as u32 + 4 * options.vignetting as u32,
            lens_rate: rates.lens,
            camera_bias: bias(self.rest.shared[group].seen + 1),
            focal: [camera.fx as f32, camera.fy as f32],
            drop: Drop::of(options, iteration).map_or(0.0, |drop| drop.share),
            shrink: harmonics_weight(self.store.cloud.count, self.dataset.training.len(), options),
            centre: [camera.cx as f32, camera.cy as f32],
            one_over_square: vignetting::one_over_square(camera) as f32,
            vignettes: options.vignetting as u32,
            vignetting_rate: rates.vignetting,
            vignetting_weight: weights.vignetting,
            free: [0.0; 2],
        }
    }

    /// The other photograph of a pair, as on the CPU.
    fn partner(&self, photograph: usize) -> Option<usize> {
        let partners = self.partners.get(photograph).filter(|partners| !partners.is_empty())?;
        let word = words(self.options.seed, self.rest.iteration, 0, Purpose::Pair)[0];
        Some(partners[word as usize % partners.len()])
    }

    /// Terms of geometry, where they are drawn.
    fn record_terms(&self, photograph: usize, words: &StepWords, recorder: &mut Recorder) -> Result<(), SplatError> {
        let outputs = outputs(&self.options, self.rest.iteration);
        let image = [words.width.div_ceil(16), words.height.div_ceil(16)];
        let photo = &self.photographs[photograph];
        let (lenses, motions) = (&self.cameras.lenses, &self.cameras.motions);
        let mut jobs = vec![];
        if outputs.plane {
            let (plane_image, by_planes) = (self.buffer("plane_image")?, self.buffer("by_planes")?);
            let own = &self.plane_depths[photograph];
            // Any buffer stands for normals that nobody asks for.
            let normals = self.normals.get(photograph).unwrap_or(&self.report);
            let planes = vec![
                (0, &self.step),
                (2, photo),
                (3, plane_image),
                (4, by_planes),
                (5, lenses),
                (7, own),
                (13, normals),
            ];
            jobs.push(self.job("planes", image, planes));
            if let Some(partner) = self.partner(photograph).filter(|_| words.multi_view > 0.0) {
                let consistent = vec![
                    (0, &self.step),
                    (2, photo),
                    (3, plane_image),
                    (4, by_planes),
                    (5, lenses),
                    (6, motions),
                    (8, &self.plane_depths[partner]),
                    (9, &self.photographs[partner]),
                ];
                let each = 16 * multi_view::STRIDE;
                jobs.push(self.job(
                    "consistent",
                    [words.width.div_ceil(each), words.height.div_ceil(each)],
                    consistent,
                ));
            }
        }
        if outputs.depth {
            let prior = vec![
                (0, &self.step),
                (1, self.buffer("colours")?),
                (2, photo),
                (10, self.buffer("depths")?),
                (11, self.buffer("by_depths")?),
                (12, &self.measured[photograph]),
            ];
            jobs.push(self.job("prior", image, prior));
        }
        if let Some(labels) = self.labels.get(photograph).filter(|_| outputs.features) {
            let (features, by_features) = (self.buffer("feature_image")?, self.buffer("by_features")?);
            let buffers = vec![(0, &self.step), (2, photo), (14, features), (15, by_features), (16, labels)];
            jobs.push(self.job("labels", image, buffers));
        }
        if !jobs.is_empty() {
            recorder.run_jobs("terms", &jobs);
        }
        Ok(())
    }

    /// Leaves Gaussians out for a step, where that is asked for, or brings them back.
    fn record_drop(&self, entry: &str, words: &StepWords, recorder: &mut Recorder) -> Result<(), SplatError> {
        let Some(logits) = self.logits.as_ref().filter(|_| words.drop > 0.0) else { return Ok(()) };
        let mut buffers = vec![(0, &self.step), (1, &self.store.cloud.scales), (2, logits)];
        if entry == "bring_back" {
            buffers.push((3, self.buffer("by_shape")?));
        }
        recorder.run_jobs("drop", &[self.job(entry, [words.count.div_ceil(256), 1], buffers)]);
        Ok(())
    }

    /// Puts filtered Gaussians in the place of those that are learned, with anti-aliasing, or these back.
    fn record_filter(&self, entry: &str, words: &StepWords, recorder: &mut Recorder) -> Result<(), SplatError> {
        let Some((learned, squares, cameras)) = &self.filter else { return Ok(()) };
        let mut buffers = vec![(0, &self.step), (2, &self.store.cloud.scales), (3, learned), (4, squares)];
        match entry {
            "widen" => buffers.extend([(1, &self.store.cloud.means), (6, &cameras.lenses), (7, &cameras.motions)]),
            _ => buffers.push((5, self.buffer("by_shape")?)),
        }
        recorder.run_jobs("filter", &[self.job(entry, [words.count.div_ceil(256), 1], buffers)]);
        Ok(())
    }

    fn buffer(&self, name: &str) -> Result<&wgpu::Buffer, RasterError> {
        let missing = || RasterError::Device(format!("expected a buffer `{name}`, found none"));
        self.rasteriser.buffer(name).ok_or_else(missing)
    }

    fn look(&mut self, photograph: usize) -> Result<(), SplatError> {
        let words = self.words(photograph);
        let gpu = &self.rasteriser.gpu;
        // What is written goes before all that is submitted later, so each step of a submission has a place of its own.
        let place = WORDS * self.recorded.len() as u64;
        gpu.queue.write_buffer(&self.remarks, place, bytemuck::bytes_of(&words));
        let mut recorder = Recorder::new(gpu, self.how.timed);
        recorder.encoder.copy_buffer_to_buffer(&self.remarks, place, &self.step, 0, WORDS);
        self.rasteriser.aim(&self.cameras, photograph, &mut recorder)?;
        self.record_filter("widen", &words, &mut recorder)?;
        self.record_drop("leave_out", &words, &mut recorder)?;
        self.rasteriser.record_forward(&self.store.cloud, &mut recorder)?;
        let get = |name: &str| self.buffer(name);
        let (colours, by_colours, state) = (get("colours")?, get("by_colours")?, get("state")?);
        let image = [words.width.div_ceil(16), words.height.div_ceil(16)];
        let exposures = &self.store.exposures;
        let photo = &self.photographs[photograph];
        let similar = vec![
            (0, &self.step),
            (1, colours),
            (2, photo),
            (3, exposures),
            (4, &self.maps),
            (6, &self.sums),
            (7, &self.store.shared),
        ];
        let mut pull = similar.clone();
        pull.extend([(5, by_colours), (8, &self.fades)]);
        recorder.run_jobs("loss", &[self.job("similar", image, similar), self.job("pull", image, pull)]);
        if self.options.lens {
            let bend =
                vec![(0, &self.step), (1, colours), (2, by_colours), (3, &self.bends), (5, &self.cameras.lenses)];
            recorder.run_jobs("lens", &[self.job("bend", image, bend)]);
        }
        self.record_terms(photograph, &words, &mut recorder)?;
        self.rasteriser.record_backward(&self.store.cloud, &mut recorder)?;
        self.record_drop("bring_back", &words, &mut recorder)?;
        self.record_filter("narrow", &words, &mut recorder)?;
        let finish = vec![(0, &self.step), (1, &self.sums), (2, exposures), (3, &self.report), (4, state)];
        let mut last = vec![self.job("finish", [1, 1], finish)];
        if words.refines > 0 {
            let turn = vec![
                (0, &self.step),
                (3, &self.bends),
                (4, get("by_pose")?),
                (5, &self.cameras.lenses),
                (6, &self.cameras.motions),
                (7, &self.store.pose_moments),
                (8, &self.store.shared),
                (9, &self.groups),
                (10, &self.fades),
            ];
            last.push(self.job("turn", [1, 1], turn));
        }
        if self.options.strategy == Strategy::Classic {
            let records = vec![
                (0, &self.step),
                (11, state),
                (12, get("records")?),
                (13, get("counts")?),
                (14, get("record_gradients")?),
                (15, &self.store.pulls),
            ];
            last.push(self.job("gather", folded(words.count.div_ceil(256)), records));
        }
        recorder.run_jobs("finish", &last);
        let (store, cloud) = (&self.store, &self.store.cloud);
        let shape = vec![
            (0, &self.step),
            (1, &cloud.means),
            (2, &cloud.scales),
            (3, &cloud.rotations),
            (4, get("by_shape")?),
            (5, &store.first),
            (6, &store.second),
        ];
        let harmonics =
            vec![(0, &self.step), (7, &cloud.sh), (8, get("by_sh")?), (9, &store.sh_first), (10, &store.sh_second)];
        let fours = (3 * words.count * words.sh_count).div_ceil(4).div_ceil(256);
        recorder.run_jobs("adam shape", &[self.job("shape", [words.count.div_ceil(256), 1], shape)]);
        let mut rest = vec![self.job("harmonics", folded(fours), harmonics)];
        if let Some(by_feature) = self.rasteriser.buffer("by_feature") {
            let features = vec![
                (0, &self.step),
                (7, &cloud.features),
                (8, by_feature),
                (9, &store.features_first),
                (10, &store.features_second),
            ];
            rest.push(self.job("features", folded((words.count * words.feature_count).div_ceil(1024)), features));
        }
        recorder.run_jobs("adam harmonics", &rest);
        let (commands, stamps) = recorder.finish();
        self.recorded.push(commands);
        if let Some(stamps) = stamps {
            self.stamps = Some(stamps);
            self.how.timed = false;
        }
        if self.recorded.len() == AT_ONCE {
            self.flush();
        }
        Ok(())
    }

    /// Submits the steps that were recorded: before anything else is asked of the card.
    fn flush(&mut self) {
        self.rasteriser.gpu.queue.submit(self.recorded.drain(..));
    }

    fn job<'b>(&'b self, entry: &str, groups: [u32; 2], buffers: Vec<(u32, &'b wgpu::Buffer)>) -> Job<'b> {
        Job { pipeline: self.kernels.get(entry), groups, buffers }
    }

    /// Most candidates and entries that a photograph needed since this was last looked at make buffers grow.
    fn grow(&mut self, candidates: f32, entries: f32) -> Result<(), SplatError> {
        let [visible, room] = self.rasteriser.room();
        let (candidates, entries) = (candidates as u64, entries as u64);
        // With room for as many again by half: Gaussians come before this is looked at again.
        let most = self.store.capacity as u64;
        if (5 * candidates > 4 * visible && visible < most) || 5 * entries > 4 * room {
            let settings = self.settings();
            let (candidates, entries) =
                ((candidates + candidates / 2).min(most) as usize, (entries + entries / 2) as usize);
            self.rasteriser.make_more_room(&self.store.cloud, &settings, candidates, entries)?;
            let size = self.prepared.take();
            if size.is_some() {
                self.prepare(0)?;
            }
        }
        Ok(())
    }

    fn relocate(&mut self, what: &Relocation) -> Result<(), SplatError> {
        let changes = what.changes.iter().map(|c| [c.index, c.logit.to_bits(), c.shift.to_bits(), 0]);
        let copies = what.copies.iter().map(|[target, source]| [*target, *source, 0, 0]);
        let new = what.copies.iter().map(|copy| copy[0] as usize + 1).max().unwrap_or(0);
        self.run_list("change", changes.collect())?;
        self.run_list("copy", copies.collect())?;
        self.store.cloud.count = self.store.cloud.count.max(new);
        self.rasteriser.recount(&self.store.cloud);
        Ok(())
    }

    fn run_list(&mut self, entry: &str, items: Vec<[u32; 4]>) -> Result<(), SplatError> {
        if items.is_empty() {
            return Ok(());
        }
        let groups = [(items.len() as u32).div_ceil(256), 1];
        let mut list = vec![[items.len() as u32, 0, 0, 0]];
        list.extend(items);
        let gpu = &self.rasteriser.gpu;
        gpu.queue.write_buffer(&self.list, 0, bytemuck::cast_slice(&list));
        let (store, cloud) = (&self.store, &self.store.cloud);
        let mut buffers = vec![
            (0, &self.step),
            (2, &cloud.scales),
            (4, &store.first),
            (5, &store.second),
            (7, &store.sh_first),
            (8, &store.sh_second),
            (9, &self.list),
            (11, &store.features_first),
            (12, &store.features_second),
        ];
        if entry == "copy" {
            buffers.extend([(1, &cloud.means), (3, &cloud.rotations), (6, &cloud.sh), (10, &cloud.features)]);
        }
        let mut recorder = Recorder::new(gpu, false);
        recorder.run_jobs("relocate", &[self.job(entry, groups, buffers)]);
        recorder.submit();
        Ok(())
    }

    /// Puts a model in the place of the one on the card.
    fn put(&mut self, model: Model) -> Result<(), SplatError> {
        self.store = Store::new(&self.rasteriser.gpu, &model, self.store.capacity)?;
        self.rasteriser.gpu.forget_bind_groups();
        self.prepared = None;
        Ok(())
    }

    /// As on the CPU.
    fn guide_weights(&mut self) -> Result<Vec<f32>, SplatError> {
        let options = self.options;
        if options.guide == Guide::Opacity {
            return Ok(vec![]);
        }
        let mut encoder = self.rasteriser.gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.store.pulls, 0, None);
        self.rasteriser.gpu.queue.submit([encoder.finish()]);
        for photograph in guide::looked_at(self.dataset.training.len(), options.seed, self.rest.iteration) {
            self.prepare(photograph)?;
            self.add_errors(photograph)?;
        }
        let sums: Vec<ErrorSum> = self.rasteriser.gpu.read(&self.store.pulls, self.store.cloud.count)?;
        Ok(options.guide.weights(&sums))
    }

    /// Shares the error of a photograph out among the Gaussians that are seen in it.
    fn add_errors(&self, photograph: usize) -> Result<(), SplatError> {
        let words = self.words(photograph);
        let gpu = &self.rasteriser.gpu;
        gpu.queue.write_buffer(&self.step, 0, bytemuck::bytes_of(&words));
        let mut recorder = Recorder::new(gpu, false);
        self.rasteriser.aim(&self.cameras, photograph, &mut recorder)?;
        self.record_filter("widen", &words, &mut recorder)?;
        self.rasteriser.record_forward(&self.store.cloud, &mut recorder)?;
        // Of the derivatives by images only those by colours are filled anew; by others they would be of an earlier step.
        for name in ["by_depths", "by_planes", "by_features"] {
            if let Some(buffer) = self.rasteriser.buffer(name) {
                recorder.encoder.clear_buffer(buffer, 0, None);
            }
        }
        let error = vec![
            (0, &self.step),
            (1, self.buffer("colours")?),
            (2, &self.photographs[photograph]),
            (3, &self.store.exposures),
            (5, self.buffer("by_colours")?),
            (7, &self.store.shared),
        ];
        let image = [words.width.div_ceil(16), words.height.div_ceil(16)];
        recorder.run_jobs("errors", &[self.job("error", image, error)]);
        self.rasteriser.record_shares(&self.store.cloud, &mut recorder)?;
        let share = vec![
            (0, &self.step),
            (11, self.buffer("state")?),
            (12, self.buffer("records")?),
            (13, self.buffer("counts")?),
            (14, self.buffer("record_gradients")?),
            (15, &self.store.pulls),
        ];
        recorder.run_jobs("errors", &[self.job("share", folded(words.count.div_ceil(256)), share)]);
        self.record_filter("narrow", &words, &mut recorder)?;
        recorder.submit();
        Ok(())
    }

    fn come_and_go(&mut self) -> Result<(), SplatError> {
        let (options, iteration) = (self.options, self.rest.iteration);
        let (refines, resets) = (options.refines(iteration), options.resets(iteration));
        if refines || resets {
            self.flush();
        }
        if refines && options.strategy == Strategy::Mcmc {
            let mut logits = self.store.logits(&self.rasteriser.gpu)?;
            if options.clear > 0.0 {
                logits = clear::cleared(self.dataset, &self.store.means(&self.rasteriser.gpu)?, &logits, options.clear);
            }
            let weights = self.guide_weights()?;
            let dead = Relocation::of_dead(&logits, &weights, options.seed, iteration);
            self.relocate(&dead)?;
            dead.changes.iter().for_each(|change| logits[change.index as usize] = change.logit);
            for [target, source] in &dead.copies {
                logits[*target as usize] = logits[*source as usize];
            }
            let weights = dead.shared_weights(weights);
            self.relocate(&Relocation::of_new(&logits, &weights, options.cap, options.seed, iteration))?;
        } else if refines || resets {
            let mut model = self.model()?;
            if refines {
                classic::refine(&mut model, self.dataset.extent, options.cap, options.seed);
            }
            if resets {
                classic::reset(&mut model);
            }
            self.put(model)?;
        }
        Ok(())
    }
}

/// A unit normal as bytes with a sign, and 127 where there is one.
fn signed_bytes(normal: &[f32; 3]) -> [i8; 4] {
    let there = *normal != [0.0; 3];
    let [x, y, z] = normal.map(|n| (n * 127.0).round() as i8);
    [x, y, z, if there { 127 } else { 0 }]
}

/// Workgroups of a long list.
fn folded(groups: u32) -> [u32; 2] {
    [groups.min(FOLD), groups.div_ceil(FOLD)]
}

fn cameras(rasteriser: &GpuRasteriser, dataset: &Dataset, model: &Model) -> Result<GpuCameras, SplatError> {
    let views: Vec<View> = (0..dataset.training.len()).map(|k| View::of(model.camera(dataset, k))).collect();
    Ok(GpuCameras::new(&rasteriser.gpu, &views)?)
}

impl Engine for GpuEngine<'_> {
    fn step(&mut self, photograph: usize) -> Result<(), SplatError> {
        let degree = self.options.degree(self.rest.iteration);
        if degree > self.store.cloud.sh_degree {
            let mut model = self.model()?;
            model.raise_degree(degree);
            self.put(model)?;
        }
        self.prepare(photograph)?;
        self.look(photograph)?;
        let group = self.rest.groups[photograph];
        self.rest.shared[group].seen += 1;
        self.come_and_go()?;
        self.rest.iteration += 1;
        Ok(())
    }

    fn iteration(&self) -> u32 {
        self.rest.iteration
    }

    fn splats(&self) -> usize {
        self.store.cloud.count
    }

    fn loss(&mut self) -> Result<f32, SplatError> {
        self.flush();
        let gpu = &self.rasteriser.gpu;
        let report: Vec<f32> = gpu.read(&self.report, 4)?;
        gpu.queue.write_buffer(&self.report, 0, bytemuck::cast_slice(&[0.0f32; 4]));
        let [sum, steps, candidates, entries] = report[..] else {
            return Err(off(WAITS, "a report of 4 numbers", report.len()));
        };
        self.grow(candidates, entries)?;
        Ok(sum / steps.max(1.0))
    }

    fn model(&mut self) -> Result<Model, SplatError> {
        self.flush();
        let mut model = self.rest.clone();
        self.store.read(&self.rasteriser.gpu, &mut model)?;
        if self.options.poses {
            let rows: Vec<[[f32; 4]; 3]> = self.rasteriser.gpu.read(&self.cameras.motions, model.poses.len())?;
            model.poses = rows.iter().map(pose_of).collect();
        }
        Ok(model)
    }

    fn time_next(&mut self) {
        self.how.timed = true;
    }

    fn times(&mut self) -> Result<Vec<(&'static str, f64)>, SplatError> {
        self.flush();
        Ok(self.stamps.take().map_or(Ok(vec![]), |stamps| stamps.read(&self.rasteriser.gpu))?)
    }
}
