//! Learning on a graphics card: what [`crate::dagger`] does with its records, with gradients and Adam on the card.

use super::layers::{Plan, TARGET};
use super::{bind, pipeline};
use crate::NavError;
use crate::augment::Change;
use crate::net::{Net, STATE, WIDTH};
use crate::recall::RECALL;
use crate::roll::Record;
use crate::settings::TrainSettings;
use qv_raster::RasterError;
use qv_raster::gpu::Gpu;
use rayon::prelude::*;
use std::collections::{HashMap, VecDeque};

/// A network's gradients and its optimiser on a card. Sums have a fixed order there, so the same card gives the same bits; they are not those of
/// the CPU.
pub struct GpuLearner {
    gpu: Gpu,
    buffers: HashMap<&'static str, wgpu::Buffer>,
    dispatches: Vec<(wgpu::ComputePipeline, wgpu::BindGroup, [u32; 3])>,
    lanes: usize,
    /// Decisions of a stretch.
    stretch: usize,
    /// Bytes of a picture.
    picture: usize,
    steps: i32,
}

/// An episode that is learnt from.
#[derive(Default)]
struct Lane {
    episode: Option<(usize, Change)>,
    next: usize,
    /// Decisions of this stretch; 0 when there is no episode left.
    count: usize,
}

/// What the card is reported for the next decisions of all lanes, each with room for a whole stretch.
struct Stretch {
    pictures: Vec<u8>,
    states: Vec<f32>,
    recalls: Vec<f32>,
    targets: Vec<f32>,
    /// Whether a lane begins an episode, and how many decisions it has.
    lanes: Vec<u32>,
    samples: usize,
}

/// Steps of the optimiser that may wait on the card.
const WAITING: usize = 2;

impl GpuLearner {
    /// For a network and the settings of its training.
    ///
    /// # Errors
    /// When the card has no room, or refuses a shader.
    pub fn new(gpu: Gpu, net: &Net, settings: &TrainSettings) -> Result<Self, NavError> {
        let plan = Plan::new(net, settings);
        let mut buffers = HashMap::new();
        for (name, count) in &plan.buffers {
            buffers.insert(*name, gpu.buffer(name, 4 * *count as u64)?);
        }
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let mut pipelines = HashMap::new();
        let mut dispatches = Vec::new();
        for kernel in &plan.kernels {
            let pipeline = pipelines.entry(&kernel.text).or_insert_with(|| pipeline(&gpu, &kernel.label, &kernel.text));
            let bound: Vec<&wgpu::Buffer> = kernel.buffers.iter().map(|name| &buffers[name]).collect();
            dispatches.push((pipeline.clone(), bind(&gpu, pipeline, &bound), kernel.groups));
        }
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(RasterError::Device(error.to_string()).into());
        }
        let (lanes, stretch, picture) = (settings.batch, settings.truncated, net.picture_len());
        Ok(Self { gpu, buffers, dispatches, lanes, stretch, picture, steps: 0 })
    }

    /// Learns once from episodes in a queue; gives the summed loss and the number of decisions. `rate` says the learning rate after so many.
    pub(crate) fn epoch(
        &mut self,
        records: &[Record],
        queue: &mut (impl Iterator<Item = (usize, Change)> + Send),
        settings: &TrainSettings,
        rate: impl Fn(usize) -> f32 + Sync,
        parameters: &mut [f32],
    ) -> Result<(f64, usize), NavError> {
        let rows = self.lanes * self.stretch;
        self.gpu.queue.write_buffer(&self.buffers["parameters"], 0, bytemuck::cast_slice(parameters));
        self.gpu.queue.write_buffer(&self.buffers["losses"], 0, bytemuck::cast_slice(&vec![0.0f32; rows]));
        let (mut samples, mut waiting) = (0, VecDeque::new());
        let mut lanes: Vec<Lane> = (0..self.lanes).map(|_| Lane::default()).collect();
        let mut pair = [(); 2].map(|()| Stretch::new(self.lanes, self.stretch, self.picture));
        let mut is_there = pair[0].fill(&mut lanes, records, queue);
        while is_there {
            let [now, next] = &mut pair;
            // The next stretch is gathered while this one goes to the card.
            let submit = || {
                self.upload(now);
                self.hyper(settings, rate(samples), now.samples);
                self.submit()
            };
            let (index, more) = rayon::join(submit, || next.fill(&mut lanes, records, queue));
            waiting.push_back(index);
            if waiting.len() > WAITING {
                self.wait(waiting.pop_front())?;
            }
            samples += now.samples;
            is_there = more;
            pair.swap(0, 1);
        }
        let found: Vec<f32> = self.gpu.read(&self.buffers["parameters"], parameters.len())?;
        let losses: Vec<f32> = self.gpu.read(&self.buffers["losses"], rows)?;
        if let Some(bad) = found.iter().find(|x| !x.is_finite()) {
            return Err(NavError::value("number of the network", "a finite one", bad));
        }
        parameters.copy_from_slice(&found);
        Ok((losses.iter().map(|&x| f64::from(x)).sum(), samples))
    }

    fn upload(&self, stretch: &Stretch) {
        let write = |name: &str, bytes: &[u8]| self.gpu.queue.write_buffer(&self.buffers[name], 0, bytes);
        write("pictures", &stretch.pictures);
        write("states", bytemuck::cast_slice(&stretch.states));
        write("recalls", bytemuck::cast_slice(&stretch.recalls));
        write("targets", bytemuck::cast_slice(&stretch.targets));
        write("lanes", bytemuck::cast_slice(&stretch.lanes));
    }

    /// The numbers of a step of Adam, as `qv_policy::adam` has them.
    fn hyper(&mut self, settings: &TrainSettings, rate: f32, samples: usize) {
        self.steps = self.steps.saturating_add(1);
        let least = 0.25 * (settings.batch * settings.truncated) as f32;
        let scale = 1.0 / (samples as f32).max(least);
        let unbias = 1.0 / (1.0 - 0.999f32.powi(self.steps));
        let numbers = [rate / (1.0 - 0.9f32.powi(self.steps)), unbias, scale, settings.longest];
        self.gpu.queue.write_buffer(&self.buffers["hyper"], 0, bytemuck::cast_slice(&numbers));
    }

    fn submit(&self) -> wgpu::SubmissionIndex {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        for (pipeline, group, [x, y, z]) in &self.dispatches {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(*x, *y, *z);
        }
        drop(pass);
        self.gpu.queue.submit([encoder.finish()])
    }

    fn wait(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<(), NavError> {
        let waited = self.gpu.device.poll(wgpu::PollType::Wait { submission_index, timeout: None });
        waited.map(|_| ()).map_err(|error| RasterError::Device(error.to_string()).into())
    }
}

impl Lane {
    /// Takes the next episode if it has none left; says whether it did.
    fn refill(&mut self, records: &[Record], queue: &mut impl Iterator<Item = (usize, Change)>) -> bool {
        self.next += self.count;
        self.count = 0;
        if self.episode.as_ref().is_some_and(|(record, _)| self.next < records[*record].len()) {
            return false;
        }
        (self.episode, self.next) = (queue.next(), 0);
        true
    }

    /// Gathers its next decisions: pictures, states, recalls, targets.
    fn fill(&mut self, records: &[Record], stretch: usize, pictures: &mut [u8], room: [&mut [f32]; 3]) {
        let Some((record, change)) = &mut self.episode else { return };
        let record = &records[*record];
        let size = record.pictures.len() / record.len();
        self.count = (record.len() - self.next).min(stretch);
        let [states, recalls, targets] = room;
        for (at, target) in (self.next..self.next + self.count).zip(targets.chunks_exact_mut(TARGET)) {
            let found = [f32::from(u8::from(record.found[at]))];
            let acted = record.acted.get(at).copied().unwrap_or_default().numbers();
            let parts: [&[f32]; 6] =
                [&record.commands[at], &record.cones[at], &found, &record.known[at], &record.sights[at], &acted];
            target.iter_mut().zip(parts.into_iter().flatten()).for_each(|(out, x)| *out = *x);
        }
        states[..self.count * STATE].copy_from_slice(&record.states[self.next * STATE..][..self.count * STATE]);
        recalls[..self.count * RECALL].copy_from_slice(&record.recalls[self.next * RECALL..][..self.count * RECALL]);
        // Changing pictures is most of the work, and lanes may be fewer than threads.
        let changes: Vec<Change> = (0..self.count).map(|_| change.take_next(size / (3 * WIDTH))).collect();
        let work = pictures.par_chunks_exact_mut(size).zip(record.pictures[self.next * size..].par_chunks_exact(size));
        work.zip(changes).for_each(|((out, picture), mut change)| change.put(picture, out));
    }
}

impl Stretch {
    fn new(lanes: usize, stretch: usize, size: usize) -> Self {
        let room = |each: usize| vec![0.0; lanes * stretch * each];
        Self {
            pictures: vec![0; lanes * stretch * size],
            states: room(STATE),
            recalls: room(RECALL),
            targets: room(TARGET),
            lanes: Vec::new(),
            samples: 0,
        }
    }

    /// Gathers the next decisions of all lanes, in parallel; false when there are none left.
    fn fill(
        &mut self,
        lanes: &mut [Lane],
        records: &[Record],
        queue: &mut impl Iterator<Item = (usize, Change)>,
    ) -> bool {
        let fresh: Vec<bool> = lanes.iter_mut().map(|lane| lane.refill(records, queue)).collect();
        let count = lanes.len();
        let stretch = self.targets.len() / (TARGET * count);
        let each = self.pictures.len() / count;
        let pictures = self.pictures.par_chunks_exact_mut(each);
        let numbers = self
            .states
            .par_chunks_exact_mut(stretch * STATE)
            .zip(self.recalls.par_chunks_exact_mut(stretch * RECALL))
            .zip(self.targets.par_chunks_exact_mut(stretch * TARGET));
        lanes.par_iter_mut().zip(pictures).zip(numbers).for_each(|((lane, pictures), ((states, recalls), targets))| {
            lane.fill(records, stretch, pictures, [states, recalls, targets]);
        });
        self.lanes = lanes.iter().zip(fresh).flat_map(|(lane, fresh)| [u32::from(fresh), lane.count as u32]).collect();
        self.samples = lanes.iter().map(|lane| lane.count).sum();
        self.samples > 0
    }
}
