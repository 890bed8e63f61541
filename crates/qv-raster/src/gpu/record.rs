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

/// Time stamps of a frame.
#[derive(Debug)]
pub(crate) struct Stamps {
    set: wgpu::QuerySet,
    buffer: wgpu::Buffer,
    names: Vec<&'static str>,
}

/// A frame while it is recorded.
pub(crate) struct Recorder<'a> {
    gpu: &'a Gpu,
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
    pub fn run(&mut self, name: &'static str, steps: &[Step]) {
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
        let mut pass = self.encoder.begin_compute_pass(&descriptor);
        for step in steps {
            let pipeline = self.gpu.pipeline(step.stage, step.entry, &step.variant);
            let entries: Vec<wgpu::BindGroupEntry> = step
                .buffers
                .iter()
                .map(|(binding, buffer)| wgpu::BindGroupEntry {
                    binding: *binding,
                    resource: buffer.as_entire_binding(),
                })
                .collect();
            let group = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(step.entry),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            match step.groups {
                Groups::Fixed(x, y) => pass.dispatch_workgroups(x, y, 1),
                Groups::Indirect(buffer, slot) => pass.dispatch_workgroups_indirect(buffer, 12 * slot as u64),
            }
        }
    }

    /// Submits what was recorded.
    pub fn submit(mut self) -> Option<Stamps> {
        if let Some(stamps) = &self.stamps {
            let count = 2 * stamps.names.len() as u32;
            self.encoder.resolve_query_set(&stamps.set, 0..count, &stamps.buffer, 0);
        }
        self.gpu.queue.submit([self.encoder.finish()]);
        self.stamps
    }
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
