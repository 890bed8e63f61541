//! Learning on a graphics card: what [`crate::dagger`] does with its records, with gradients and Adam on the card.

use super::layers::{Plan, TARGET};
use crate::NavError;
use crate::augment::Change;
use crate::dagger::TrainSettings;
use crate::net::{Net, STATE};
use crate::recall::RECALL;
use crate::roll::Record;
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
    lanes: Vec<Lane>,
    /// Decisions of a stretch.
    stretch: usize,
    steps: i32,
}

/// An episode that is learnt from, and room for what the card is told of its next decisions.
#[derive(Default)]
struct Lane {
    episode: Option<(usize, Change)>,
    next: usize,
    /// Decisions of this stretch; 0 when there is no episode left.
    count: usize,
    pictures: Vec<u8>,
    states: Vec<f32>,
    recalls: Vec<f32>,
    targets: Vec<f32>,
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
        let moments = (0..settings.truncated as u32).map(|step| gpu.filled("moment", &[step, 0, 0, 0]));
        let moments = moments.collect::<Result<Vec<_>, RasterError>>()?;
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let mut pipelines = HashMap::new();
        let mut dispatches = Vec::new();
        for kernel in &plan.kernels {
            let pipeline = pipelines.entry(&kernel.text).or_insert_with(|| pipeline(&gpu, &kernel.label, &kernel.text));
            let buffer = |name: &&str| match (*name, kernel.moment) {
                ("moment", Some(step)) => &moments[step],
                _ => &buffers[*name],
            };
            let bound: Vec<&wgpu::Buffer> = kernel.buffers.iter().map(buffer).collect();
            dispatches.push((pipeline.clone(), bind(&gpu, pipeline, &bound), kernel.groups));
        }
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(RasterError::Device(error.to_string()).into());
        }
        let lanes = (0..settings.batch).map(|_| Lane::default()).collect();
        Ok(Self { gpu, buffers, dispatches, lanes, stretch: settings.truncated, steps: 0 })
    }

    /// Learns once from episodes in a queue; gives the summed loss and the number of decisions. `rate` says the learning rate after so many.
    pub(crate) fn epoch(
        &mut self,
        records: &[Record],
        queue: &mut impl Iterator<Item = (usize, Change)>,
        settings: &TrainSettings,
        rate: impl Fn(usize) -> f32,
        parameters: &mut [f32],
    ) -> Result<(f64, usize), NavError> {
        let rows = self.lanes.len() * self.stretch;
        self.gpu.queue.write_buffer(&self.buffers["parameters"], 0, bytemuck::cast_slice(parameters));
        self.gpu.queue.write_buffer(&self.buffers["losses"], 0, bytemuck::cast_slice(&vec![0.0f32; rows]));
        let (mut samples, mut waiting) = (0, VecDeque::new());
        self.lanes.iter_mut().for_each(|lane| (lane.episode, lane.count) = (None, 0));
        loop {
            let fresh: Vec<bool> = self.lanes.iter_mut().map(|lane| lane.refill(records, queue)).collect();
            if self.lanes.iter().all(|lane| lane.episode.is_none()) {
                break;
            }
            let stretch = self.stretch;
            self.lanes.par_iter_mut().for_each(|lane| lane.fill(records, stretch));
            self.upload(&fresh);
            let now: usize = self.lanes.iter().map(|lane| lane.count).sum();
            self.hyper(settings, rate(samples), now);
            waiting.push_back(self.submit());
            if waiting.len() > WAITING {
                self.wait(waiting.pop_front())?;
            }
            samples += now;
        }
        let found: Vec<f32> = self.gpu.read(&self.buffers["parameters"], parameters.len())?;
        let losses: Vec<f32> = self.gpu.read(&self.buffers["losses"], rows)?;
        if let Some(bad) = found.iter().find(|x| !x.is_finite()) {
            return Err(NavError::value("number of the network", "a finite one", bad));
        }
        parameters.copy_from_slice(&found);
        Ok((losses.iter().map(|&x| f64::from(x)).sum(), samples))
    }

    fn upload(&self, fresh: &[bool]) {
        let mut words = Vec::with_capacity(2 * self.lanes.len());
        for (k, lane) in self.lanes.iter().enumerate() {
            words.extend([u32::from(fresh[k]), lane.count as u32]);
            let at = |each: usize| (k * self.stretch * each) as u64;
            let picture = lane.pictures.len() / lane.count.max(1);
            let write = |name: &str, offset: u64, bytes: &[u8]| {
                if !bytes.is_empty() {
                    self.gpu.queue.write_buffer(&self.buffers[name], offset, bytes);
                }
            };
            write("pictures", at(picture), &lane.pictures);
            write("states", at(4 * STATE), bytemuck::cast_slice(&lane.states));
            write("recalls", at(4 * RECALL), bytemuck::cast_slice(&lane.recalls));
            write("targets", at(4 * TARGET), bytemuck::cast_slice(&lane.targets));
        }
        self.gpu.queue.write_buffer(&self.buffers["lanes"], 0, bytemuck::cast_slice(&words));
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

    /// Gathers its next decisions.
    fn fill(&mut self, records: &[Record], stretch: usize) {
        self.pictures.clear();
        [&mut self.states, &mut self.recalls, &mut self.targets].into_iter().for_each(Vec::clear);
        let Some((record, change)) = &mut self.episode else { return };
        let record = &records[*record];
        let size = record.pictures.len() / record.len();
        self.count = (record.len() - self.next).min(stretch);
        let range = self.next..self.next + self.count;
        for at in range.clone() {
            change.add(&record.pictures[at * size..][..size], &mut self.pictures);
            self.targets.extend(record.commands[at]);
            self.targets.extend(record.cones[at]);
            self.targets.push(f32::from(u8::from(record.found[at])));
            self.targets.extend(record.known[at]);
            self.targets.extend(record.sights[at]);
        }
        self.states.extend_from_slice(&record.states[range.start * STATE..range.end * STATE]);
        self.recalls.extend_from_slice(&record.recalls[range.start * RECALL..range.end * RECALL]);
    }
}

fn pipeline(gpu: &Gpu, label: &str, text: &str) -> wgpu::ComputePipeline {
    let source = wgpu::ShaderSource::Wgsl(text.into());
    let descriptor = wgpu::ShaderModuleDescriptor { label: Some(label), source };
    // SAFETY: every index in the shaders is below a count that the buffers were made for, and every loop ends.
    let module = unsafe { gpu.device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked()) };
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(label),
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions {
            // The shaders set what they read.
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        },
        cache: None,
    })
}

fn bind(gpu: &Gpu, pipeline: &wgpu::ComputePipeline, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
    let mut entries = Vec::new();
    for (binding, buffer) in buffers.iter().enumerate() {
        entries.push(wgpu::BindGroupEntry { binding: binding as u32, resource: buffer.as_entire_binding() });
    }
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    })
}
