//! The graphics device, what it can do, and its pipelines.

use crate::RasterError;
use crate::shaders::{STAGES, Variant, text};
use std::collections::HashMap;
use std::sync::Mutex;
use wgpu::util::DeviceExt;

/// How to choose and use a graphics adapter.
#[derive(Debug, Clone, Copy, Default)]
pub struct GpuOptions {
    /// Do without subgroup operations even where the adapter has them.
    pub without_subgroups: bool,
    /// Which adapter, by its number in the order of the drivers: on a machine with several cards, each process can have its own.
    /// `None` is the one that wgpu prefers.
    pub adapter: Option<usize>,
}

/// A graphics device with the pipelines that were made for it so far.
#[derive(Debug)]
pub struct Gpu {
    /// The device; buffers of images belong to it.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What the adapter is.
    pub info: wgpu::AdapterInfo,
    /// Lanes of a subgroup; 0 when they are not used.
    pub subgroup: u32,
    /// Nanoseconds per tick of time stamps; `None` when there are none.
    pub tick: Option<f32>,
    /// Whether floats can be added up with atomics.
    pub float_atomics: bool,
    limits: wgpu::Limits,
    pipelines: Mutex<HashMap<(&'static str, &'static str, Variant), wgpu::ComputePipeline>>,
    bind_groups: Mutex<HashMap<BindKey, wgpu::BindGroup>>,
}

/// What a bind group is made of.
type BindKey = (wgpu::ComputePipeline, Vec<(u32, wgpu::Buffer)>);
/// Bind groups that are kept; they keep their buffers alive.
const MOST_BIND_GROUPS: usize = 1024;

/// What the adapter must have beyond what every adapter has.
const WORKGROUP_BYTES: u32 = 28 << 10;
const STORAGE_BUFFERS: u32 = 17;
/// Bytes of the smallest buffer, so that one for nothing holds at least one item.
pub(crate) const SMALLEST: u64 = 256;

/// What is used where an adapter has it.
const USEFUL: wgpu::Features =
    wgpu::Features::SUBGROUP.union(wgpu::Features::TIMESTAMP_QUERY).union(wgpu::Features::SHADER_FLOAT32_ATOMIC);

fn check_limits(limits: &wgpu::Limits) -> Result<(), RasterError> {
    for (what, needed, found) in [
        ("bytes of workgroup memory", WORKGROUP_BYTES, limits.max_compute_workgroup_storage_size),
        ("storage buffers per stage", STORAGE_BUFFERS, limits.max_storage_buffers_per_shader_stage),
        ("invocations per workgroup", 256, limits.max_compute_invocations_per_workgroup),
    ] {
        if found < needed {
            return Err(RasterError::Adapter { expected: format!("{needed} {what}"), found: found.to_string() });
        }
    }
    Ok(())
}

impl Gpu {
    /// The adapter that was asked for, or that wgpu prefers.
    ///
    /// # Errors
    /// There is none, or it lacks what the shaders need.
    pub fn new(options: &GpuOptions) -> Result<Self, RasterError> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        // No validation of indirect dispatches: it adds a dispatch to each, and the arguments are our own.
        descriptor.flags = wgpu::InstanceFlags::empty();
        let backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
        descriptor.backends = backends;
        let instance = wgpu::Instance::new(descriptor);
        if let Some(number) = options.adapter {
            let all = pollster::block_on(instance.enumerate_adapters(backends));
            let adapter = all.get(number).ok_or_else(|| {
                let names: Vec<String> = all.iter().map(|adapter| adapter.get_info().name).collect();
                let found = format!("{} adapters: {}", names.len(), names.join(", "));
                RasterError::Adapter { expected: format!("adapter {number}, counted from 0"), found }
            })?;
            return Self::of_adapter(adapter, options);
        }
        let preference = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&preference)).map_err(|error| {
            RasterError::Adapter { expected: "one for Vulkan, Metal or DirectX 12".into(), found: error.to_string() }
        })?;
        Self::of_adapter(&adapter, options)
    }

    /// A device of an adapter.
    ///
    /// # Errors
    /// The adapter lacks what the shaders need, or gives no device.
    pub fn of_adapter(adapter: &wgpu::Adapter, options: &GpuOptions) -> Result<Self, RasterError> {
        check_limits(&adapter.limits())?;
        let description = wgpu::DeviceDescriptor {
            label: Some("qv-raster"),
            required_features: adapter.features() & USEFUL,
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&description))
            .map_err(|error| RasterError::Device(error.to_string()))?;
        Self::of_device(device, queue, adapter.get_info(), options)
    }

    /// A device that others use, too, so that they can read the images without a copy. Of the features that it was made with, subgroups,
    /// time stamps and atomics for floats are used.
    ///
    /// # Errors
    /// The device lacks what the shaders need.
    pub fn of_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        info: wgpu::AdapterInfo,
        options: &GpuOptions,
    ) -> Result<Self, RasterError> {
        let (limits, features) = (device.limits(), device.features());
        check_limits(&limits)?;
        let (least, most) = (info.subgroup_min_size, info.subgroup_max_size);
        // Of one size only: the shaders are made for it.
        let has_subgroups = features.contains(wgpu::Features::SUBGROUP) && least == most && (8..=32).contains(&least);
        Ok(Self {
            subgroup: if has_subgroups && !options.without_subgroups { least } else { 0 },
            tick: features.contains(wgpu::Features::TIMESTAMP_QUERY).then(|| queue.get_timestamp_period()),
            float_atomics: features.contains(wgpu::Features::SHADER_FLOAT32_ATOMIC),
            device,
            queue,
            info,
            limits,
            pipelines: Mutex::default(),
            bind_groups: Mutex::default(),
        })
    }

    /// Most bytes of one buffer.
    pub fn largest_buffer(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// Most workgroups along one axis of a dispatch.
    pub(crate) fn most_workgroups(&self) -> u32 {
        self.limits.max_compute_workgroups_per_dimension
    }

    /// Whether a dispatch can have a workgroup for each subgroup of a tile of so many views.
    pub(crate) fn fits(&self, views: usize) -> bool {
        views * (256 / self.subgroup.max(1)) as usize <= self.most_workgroups() as usize
    }

    /// The pipeline of an entry point of a stage.
    pub(crate) fn pipeline(
        &self,
        stage: &'static str,
        entry: &'static str,
        variant: &Variant,
    ) -> wgpu::ComputePipeline {
        let mut pipelines = match self.pipelines.lock() {
            Ok(pipelines) => pipelines,
            // A thread that panicked while it held the lock has put no half-made pipeline in.
            Err(poisoned) => poisoned.into_inner(),
        };
        if let Some(found) = pipelines.get(&(stage, entry, *variant)) {
            return found.clone();
        }
        let source = wgpu::ShaderSource::Wgsl(text(stage, variant).into());
        let descriptor = wgpu::ShaderModuleDescriptor { label: Some(stage), source };
        // SAFETY: every index in the shaders is below a count or a capacity that the buffers were made for, and every
        // loop ends; a test validates the texts with naga.
        let module =
            unsafe { self.device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked()) };
        let (_, entries) = STAGES.iter().find(|(name, _)| *name == stage).copied().unwrap_or((stage, &[]));
        for &entry in entries {
            let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions {
                    // The shaders set what they read.
                    zero_initialize_workgroup_memory: false,
                    ..Default::default()
                },
                cache: None,
            });
            pipelines.insert((stage, entry, *variant), pipeline);
        }
        pipelines[&(stage, entry, *variant)].clone()
    }

    /// The bind group of some buffers, which is made once.
    pub(crate) fn bind_group(
        &self,
        pipeline: &wgpu::ComputePipeline,
        buffers: &[(u32, &wgpu::Buffer)],
    ) -> wgpu::BindGroup {
        let key = (pipeline.clone(), buffers.iter().map(|(at, buffer)| (*at, (*buffer).clone())).collect());
        let mut groups = self.bind_groups.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(found) = groups.get(&key) {
            return found.clone();
        }
        if groups.len() >= MOST_BIND_GROUPS {
            groups.clear();
        }
        let mut entries = vec![];
        for &(binding, buffer) in buffers {
            entries.push(wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() });
        }
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        groups.insert(key, group.clone());
        group
    }

    /// Forgets bind groups, which keep the buffers that they are of alive.
    pub fn forget_bind_groups(&self) {
        self.bind_groups.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clear();
    }

    /// A buffer for shaders.
    ///
    /// # Errors
    /// It is larger than the device allows, or there is no memory for it.
    pub fn buffer(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer, RasterError> {
        let size = bytes.max(SMALLEST).next_multiple_of(16);
        if size > self.largest_buffer() {
            let what = format!("bytes of the buffer `{label}`");
            return Err(RasterError::TooLarge { what, limit: self.largest_buffer(), found: size });
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::INDIRECT,
            mapped_at_creation: false,
        });
        match pollster::block_on(scope.pop()) {
            None => Ok(buffer),
            Some(error) => {
                Err(RasterError::DeviceMemory { what: label.into(), bytes: size, reason: error.to_string() })
            }
        }
    }

    /// A buffer for shaders that holds something.
    ///
    /// # Errors
    /// As [`Self::buffer`].
    pub fn filled<T: bytemuck::Pod>(&self, label: &str, contents: &[T]) -> Result<wgpu::Buffer, RasterError> {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        if bytes.len() >= 1 << 20 || bytes.is_empty() {
            let buffer = self.buffer(label, bytes.len() as u64)?;
            self.queue.write_buffer(&buffer, 0, bytes);
            return Ok(buffer);
        }
        Ok(self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(label),
            contents: bytes,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
        }))
    }

    /// The first bytes of a buffer. Waits for the device.
    ///
    /// # Errors
    /// The device fails.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, RasterError> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(vec![]);
        }
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read"),
            size: bytes.next_multiple_of(4),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes.next_multiple_of(4));
        self.queue.submit([encoder.finish()]);
        let failed = |error: &dyn std::fmt::Display| RasterError::Device(error.to_string());
        staging.map_async(wgpu::MapMode::Read, .., |_| {});
        self.wait()?;
        let view = staging.get_mapped_range(..).map_err(|error| failed(&error))?;
        Ok(bytemuck::pod_collect_to_vec(&view[..bytes as usize]))
    }

    /// Waits until all that was submitted is done.
    ///
    /// # Errors
    /// The device fails.
    pub fn wait(&self) -> Result<(), RasterError> {
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
        waited.map(|_| ()).map_err(|error| RasterError::Device(error.to_string()))
    }
}
