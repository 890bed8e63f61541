//! Pictures and learning on a graphics card, through wgpu.

mod eye;
mod layers;
mod learn;
mod product;

pub use eye::{GpuEye, GpuEyes};
pub use learn::GpuLearner;
pub use qv_raster::gpu::{Gpu, GpuOptions};

/// The pipeline of a shader whose entry is `main`.
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

/// The bind group of buffers, in the order of their bindings.
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
