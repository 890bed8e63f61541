//! What the command line says of a reconstruction.

use clap::ValueEnum;
use std::path::PathBuf;

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Background {
    Mean,
    Black,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum PosesFrom {
    /// COLMAP poses if COLMAP is installed and they fit the images better
    Auto,
    /// Poses of the capture
    Capture,
    /// COLMAP poses, aligned to those of the capture
    Colmap,
}

#[derive(clap::Args)]
pub struct Reconstruct {
    /// Capture: transforms.json, COLMAP project, RGB-D folder or video
    pub(super) capture: PathBuf,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    pub(super) out: PathBuf,
    /// Train for N steps, one image each
    ///
    /// Above 7000 training stops early if held-aside images gain no more, unless --max-seconds is set.
    #[arg(long, default_value_t = 7000, value_parser = clap::value_parser!(u32).range(1..), value_name = "N", help_heading = "Training")]
    pub(super) iterations: u32,
    /// Limit the number of Gaussians
    #[arg(long, default_value_t = 300_000, value_name = "N", help_heading = "Training")]
    pub(super) cap: usize,
    /// Fit an affine colour transform per image
    ///
    /// The last 15 % of --iterations go without, so that the scene is drawn as the images are. With --max-seconds it may end before.
    #[arg(long, help_heading = "Scene")]
    pub(super) exposure: bool,
    /// Refine camera poses during training
    #[arg(long, help_heading = "Scene")]
    pub(super) refine_poses: bool,
    /// Select camera poses and intrinsics
    #[arg(long, value_enum, value_name = "WHOSE", default_value = "auto", help_heading = "Input")]
    pub(super) poses: PosesFrom,
    /// Divide image width and height by N
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64), value_name = "N", help_heading = "Input")]
    pub(super) downscale: u32,
    /// Set the random seed
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    pub(super) seed: u32,
    /// Resume from the checkpoint in --out
    #[arg(long, help_heading = "Training")]
    pub(super) resume: bool,
    /// Write rendered images beside the originals
    #[arg(long, help_heading = "Output")]
    pub(super) preview: bool,
    /// Hold out every Nth image for PSNR and SSIM; 0 for none
    #[arg(long, value_name = "N", default_value_t = 8, help_heading = "What to test")]
    pub(super) hold_out: usize,
    /// Stop training after this time
    #[arg(long, value_name = "SECONDS", value_parser = crate::numbers::not_negative, help_heading = "Training", hide_short_help = true)]
    pub(super) max_seconds: Option<f64>,
    /// Weight the flatness of Gaussians (surfels)
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0, help_heading = "Advanced", hide_short_help = true)]
    pub(super) flattening: f32,
    /// Weight measured depth [default: 0; with stereo 0.1]
    #[arg(long, value_name = "WEIGHT", help_heading = "Advanced", hide_short_help = true)]
    pub(super) depth_prior: Option<f32>,
    /// Disable multi-view stereo depth and dropout
    #[arg(long, help_heading = "Advanced", hide_short_help = true)]
    pub(super) no_stereo: bool,
    /// Mask moving objects, such as people; masks are written as images
    #[arg(long, help_heading = "Scene")]
    pub(super) transients: bool,
    /// Weight the consistency of depth and normals
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0, help_heading = "Advanced", hide_short_help = true)]
    pub(super) depth_normal: f32,
    /// Weight the consistency of patches between views
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0, help_heading = "Advanced", hide_short_help = true)]
    pub(super) multi_view: f32,
    /// Weight labels read from label images
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0, help_heading = "Advanced", hide_short_help = true)]
    pub(super) labels: f32,
    /// Train coarse to fine for this share of the steps
    ///
    /// Images have half the size for this share of the steps, a quarter for its square, and so on.
    #[arg(long = "coarse-to-fine", value_name = "SHARE", default_value_t = 0.0, value_parser = crate::numbers::share, alias = "small", help_heading = "Advanced", hide_short_help = true)]
    pub(super) small: f64,
    /// Train and render with anti-aliasing (Mip-Splatting)
    #[arg(long, help_heading = "Scene", hide_short_help = true)]
    pub(super) antialias: bool,
    /// Set the background: mean image colour, or black
    #[arg(long, value_name = "WHAT", value_enum, default_value_t = Background::Mean, help_heading = "Scene")]
    pub(super) background: Background,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    pub(super) json: bool,
    /// Train on the GPU
    #[cfg(feature = "gpu")]
    #[arg(long, help_heading = "Common")]
    pub(super) gpu: bool,
    /// Select the GPU by index [default: that which wgpu prefers]
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "N", requires = "gpu", help_heading = "Advanced", hide_short_help = true)]
    pub(super) gpu_index: Option<usize>,
    /// Sum in a fixed order on the GPU: slower, but bit-reproducible
    #[cfg(feature = "gpu")]
    #[arg(long, help_heading = "Advanced", hide_short_help = true)]
    pub(super) ordered: bool,
}
