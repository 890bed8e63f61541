//! Recording of dispatches, one compute pass for each stage, with time stamps around it.

use super::device::Gpu;
use crate::RasterError;
use crate::shaders::Variant;

/// Most stages of a frame that are timed.
const MOST: u32 = 64;

/// How many workgroups a dispatch takes.
#[derive(Clone, Copy)]
pub(crate) enum Groups<'a> {
    /// Known here.
    Fixed(u32, u32),
    /// Three words of a buffer, by slot.
    Indirect(&'a wgpu::Buffer, u32),
}

/// One dispatch.
pub(crate) struct Step<'a> {
    pub stage: &'static str,
    pub entry: &'static str,
    pub variant: Variant,
    pub groups: Groups<'a>,
    pub buffers: Vec<(u32, &'a wgpu::Buffer)>,
}

/// One dispatch of a pipeline that is not of this crate.
#[derive(Debug)]
pub struct Job<'a> {
    /// The pipeline, with an automatic layout.
    pub pipeline: &'a wgpu::ComputePipeline,
    /// Workgroups along x and y.
    pub groups: [u32; 2],
    /// Buffers by binding of group 0.
    pub buffers: Vec<(u32, &'a wgpu::Buffer)>,
}

/// Time stamps of a frame.
#[derive(Debug)]
pub struct Stamps {
    set: wgpu::QuerySet,
    buffer: wgpu::Buffer,
    names: Vec<&'static str>,
}

/// A frame while it is recorded.
#[derive(Debug)]
pub struct Recorder<'a> {
    gpu: &'a Gpu,
    /// Where copies between passes go.
    pub encoder: wgpu::CommandEncoder,
    stamps: Option<Stamps>,
}

impl<'a> Recorder<'a> {
    /// `timed` asks for time stamps, which are left out where the device has none.
    pub fn new(gpu: &'a Gpu, timed: bool) -> Self {
        let stamps = gpu.tick.filter(|_| timed).map(|_| Stamps {
            set: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MOST,
            }),
            buffer: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("stamps"),
                size: 16 * MOST as u64,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            names: vec![],
        });
        Self { gpu, encoder: gpu.device.create_command_encoder(&Default::default()), stamps }
    }

    /// Dispatches in a row, timed under one name.
    pub(crate) fn run(&mut self, name: &'static str, steps: &[Step]) {
        let gpu = self.gpu;
        let mut pass = self.pass(name);
        for step in steps {
            let pipeline = gpu.pipeline(step.stage, step.entry, &step.variant);
            bind(gpu, &mut pass, &pipeline, &step.buffers);
            match step.groups {
                Groups::Fixed(x, y) => pass.dispatch_workgroups(x, y, 1),
                Groups::Indirect(buffer, slot) => pass.dispatch_workgroups_indirect(buffer, 12 * slot as u64),
            }
        }
    }

    /// Dispatches of other programs in a row, timed under one name.
    pub fn run_jobs(&mut self, name: &'static str, jobs: &[Job]) {
        let gpu = self.gpu;
        let mut pass = self.pass(name);
        for job in jobs {
            bind(gpu, &mut pass, job.pipeline, &job.buffers);
            pass.dispatch_workgroups(job.groups[0], job.groups[1], 1);
        }
    }

    fn pass(&mut self, name: &'static str) -> wgpu::ComputePass<'_> {
        let timestamp_writes = self.stamps.as_mut().filter(|stamps| stamps.names.len() < MOST as usize).map(|stamps| {
            let at = 2 * stamps.names.len() as u32;
            stamps.names.push(name);
            wgpu::ComputePassTimestampWrites {
                query_set: &stamps.set,
                beginning_of_pass_write_index: Some(at),
                end_of_pass_write_index: Some(at + 1),
            }
        });
        let descriptor = wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes };
        self.encoder.begin_compute_pass(&descriptor)
    }

    /// Submits what was recorded.
    pub fn submit(self) -> Option<Stamps> {
        let queue = &self.gpu.queue;
        let (commands, stamps) = self.finish();
        queue.submit([commands]);
        stamps
    }

    /// What was recorded, to be submitted with more.
    pub fn finish(mut self) -> (wgpu::CommandBuffer, Option<Stamps>) {
        if let Some(stamps) = &self.stamps {
            let count = 2 * stamps.names.len() as u32;
            self.encoder.resolve_query_set(&stamps.set, 0..count, &stamps.buffer, 0);
        }
        (self.encoder.finish(), self.stamps)
    }
}

fn bind(gpu: &Gpu, pass: &mut wgpu::ComputePass, pipeline: &wgpu::ComputePipeline, buffers: &[(u32, &wgpu::Buffer)]) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &gpu.bind_group(pipeline, buffers), &[]);
}

impl Stamps {
    /// Milliseconds of each stage in order; those of the same name are added up. The last is from the first to the last.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<(&'static str, f64)>, RasterError> {
        let ticks: Vec<u64> = gpu.read(&self.buffer, 2 * self.names.len())?;
        let tick = gpu.tick.unwrap_or(0.0) as f64 * 1e-6;
        let mut out: Vec<(&'static str, f64)> = vec![];
        for (name, pair) in self.names.iter().zip(ticks.chunks_exact(2)) {
            let time = pair[1].wrapping_sub(pair[0]) as f64 * tick;
            match out.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += time,
                None => out.push((name, time)),
            }
        }
        if let (Some(first), Some(last)) = (ticks.first(), ticks.last()) {
            out.push(("total", last.wrapping_sub(*first) as f64 * tick));
        }
        Ok(out)
    }
}
