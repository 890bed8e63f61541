//! The shaders that train Gaussians on the card, and their pipelines. Their twins, what they are for and who runs them in which order is
//! in qv-splat's `train`; they stand here with all other shaders.

use crate::constants::GUARD;
#[cfg(feature = "gpu")]
use crate::gpu::Gpu;

/// Workgroups along x of large dispatches; the rest goes along y.
pub const FOLD: u32 = 32_768;

/// The shaders with their entry points.
pub const SHADERS: [(&str, &[&str]); 8] = [
    ("loss", &["similar", "pull", "error"]),
    ("finish", &["finish"]),
    ("cameras", &["bend", "turn"]),
    ("drop", &["leave_out", "bring_back"]),
    ("filter", &["widen", "narrow"]),
    ("update", &["shape", "harmonics", "features", "gather", "share"]),
    ("relocate", &["change", "copy"]),
    ("terms", &["planes", "consistent", "prior", "labels"]),
];

/// The window of SSIM in one dimension: 11 taps of a Gaussian with sigma 1.5, which sum up to 1.
pub const WINDOW: [f32; 11] = [
    0.001_028_38,
    0.007_598_758,
    0.036_000_773,
    0.109_360_69,
    0.213_005_54,
    0.266_011_72,
    0.213_005_54,
    0.109_360_69,
    0.036_000_773,
    0.007_598_758,
    0.001_028_38,
];

/// What a step is reported; `Step` in step.wgsl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct StepWords {
    /// Gaussians.
    pub count: u32,
    /// Harmonics of each.
    pub sh_count: u32,
    /// Steps that were taken before.
    pub iteration: u32,
    /// Seed of noise.
    pub seed: u32,
    /// Rates of means, log scales, rotations, opacities.
    pub rates: [f32; 4],
    /// Rate of the constant harmonic.
    pub colours: f32,
    /// Rate of the others.
    pub harmonics: f32,
    /// What the running means are divided by.
    pub bias: [f32; 2],
    /// Weight of the opacity of a Gaussian.
    pub opacity: f32,
    /// Weight of each of its scales.
    pub scale: f32,
    /// Weight of its smallest scale.
    pub flat: f32,
    /// Noise of means.
    pub noise: f32,
    /// Columns of the photograph.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Its index.
    pub photograph: u32,
    /// 1 when exposures are learned.
    pub exposes: u32,
    /// Share of SSIM.
    pub ssim: f32,
    /// One over three times the number of pixels.
    pub pixel: f32,
    /// Rate of exposures.
    pub exposure_rate: f32,
    /// Weight of their distance from identity.
    pub exposure_weight: f32,
    /// What the running means of exposure and pose are divided by.
    pub seen_bias: [f32; 2],
    /// Derivatives of a record.
    pub record_width: u32,
    /// Rate of poses.
    pub pose_rate: f32,
    /// Extent of the cameras \[m\].
    pub extent: f32,
    /// Weight of measured depth, over the number of pixels.
    pub depth_prior: f32,
    /// Weight of the consistency of depth and normal, over the number of pixels.
    pub depth_normal: f32,
    /// Workgroups of the loss.
    pub groups: u32,
    /// Weight of the agreement of patches, over the number of pixels that are looked at.
    pub multi_view: f32,
    /// The other photograph.
    pub partner: u32,
    /// Its columns and rows.
    pub partner_size: [u32; 2],
    /// First column and row that are looked at.
    pub from: [u32; 2],
    /// Weight of given normals, over the number of pixels.
    pub normal_prior: f32,
    /// Weight of labels, over the number of pixels.
    pub labels: f32,
    /// Features of each Gaussian.
    pub feature_count: u32,
    /// Their rate.
    pub feature_rate: f32,
    /// How many there are to learn from.
    pub photographs: u32,
    /// The camera that took it.
    pub camera: u32,
    /// Sum of what is learned of cameras: 1 poses, 2 lenses, 4 vignetting.
    pub refines: u32,
    /// Rate of lenses.
    pub lens_rate: f32,
    /// What the running means of the camera are divided by.
    pub camera_bias: [f32; 2],
    /// Focal lengths of the camera as they were given \[px\].
    pub focal: [f32; 2],
    /// Share of the Gaussians that the step leaves out.
    pub drop: f32,
    /// What harmonics but the constant one are pulled to 0 by.
    pub shrink: f32,
    /// Principal point as it was given \[px\].
    pub centre: [f32; 2],
    /// One over the square of half the diagonal \[1/px²\].
    pub one_over_square: f32,
    /// 1 when vignetting is learned.
    pub vignettes: u32,
    /// Rate of its coefficients.
    pub vignetting_rate: f32,
    /// Weight of their squares.
    pub vignetting_weight: f32,
    /// Nothing: words come in fours.
    pub free: [f32; 2],
}

/// The text of a shader. Lines between `//#taps` and `//#end` are repeated for each tap of the window, with its index for `$K` and its
/// weight for `$W`.
pub fn text(name: &str) -> String {
    let body = match name {
        "loss" => include_str!("loss.wgsl"),
        "finish" => include_str!("finish.wgsl"),
        "cameras" => include_str!("cameras.wgsl"),
        "drop" => include_str!("drop.wgsl"),
        "filter" => include_str!("filter.wgsl"),
        "update" => include_str!("update.wgsl"),
        "relocate" => include_str!("relocate.wgsl"),
        _ => include_str!("terms.wgsl"),
    };
    let (lens, step) = (include_str!("../lens.wgsl"), include_str!("step.wgsl"));
    let mut out = format!("const GUARD: f32 = {GUARD:e}f;\n{lens}\n{step}");
    let mut block: Option<String> = None;
    for line in body.lines() {
        match (line.trim(), &mut block) {
            ("//#taps", _) => block = Some(String::new()),
            ("//#end", _) => {
                let text = block.take().unwrap_or_default();
                for (k, weight) in WINDOW.iter().enumerate() {
                    out += &text.replace("$K", &format!("{k}u")).replace("$W", &format!("{weight:e}f"));
                }
            }
            (_, Some(text)) => *text += &format!("{line}\n"),
            (_, None) => out += &format!("{line}\n"),
        }
    }
    out
}

/// The pipelines by entry point.
#[cfg(feature = "gpu")]
#[derive(Debug)]
pub struct Kernels(Vec<(&'static str, wgpu::ComputePipeline)>);

#[cfg(feature = "gpu")]
impl Kernels {
    /// Compiles all shaders.
    pub fn new(gpu: &Gpu) -> Self {
        let mut list = vec![];
        for (name, entries) in SHADERS {
            let source = wgpu::ShaderSource::Wgsl(text(name).into());
            let descriptor = wgpu::ShaderModuleDescriptor { label: Some(name), source };
            // SAFETY: every index in the shaders is below a count that the buffers were made for, and every loop ends; a test validates
            // the texts with naga.
            let module =
                unsafe { gpu.device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked()) };
            for entry in entries {
                let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
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
                list.push((*entry, pipeline));
            }
        }
        Self(list)
    }

    /// The pipeline of an entry point, which must be one of [`SHADERS`].
    pub fn get(&self, entry: &str) -> &wgpu::ComputePipeline {
        let found = self.0.iter().position(|(known, _)| *known == entry);
        &self.0[found.unwrap_or(0)].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    #[test]
    fn every_shader_is_valid_and_has_its_entry_points() {
        for (name, entries) in SHADERS {
            let text = text(name);
            let module =
                naga::front::wgsl::parse_str(&text).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&text)));
            if let Err(error) = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module) {
                panic!("{name}: {}", error.emit_to_string(&text));
            }
            let found: Vec<&str> = module.entry_points.iter().map(|entry| entry.name.as_str()).collect();
            assert_eq!(found, entries);
        }
        assert_eq!(size_of::<StepWords>() % 16, 0);
    }
}
