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
    /// COLMAP's where they explain the matches between photographs clearly better, and COLMAP is there
    Auto,
    /// The capture's
    Capture,
    /// COLMAP's, brought to where the capture's are
    Colmap,
}

#[derive(clap::Args)]
pub struct Reconstruct {
    /// transforms.json or its folder, a COLMAP project, a folder of RGB-D frames, or a video
    pub(super) capture: PathBuf,
    /// Folder for what is written; made if need be
    #[arg(long, value_name = "DIR")]
    pub(super) out: PathBuf,
    /// Steps, one photograph each. Of more than 7000 as many as help photographs that are put aside at first (with --max-seconds all)
    #[arg(long, default_value_t = 7000, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) iterations: u32,
    /// Most Gaussians
    #[arg(long, default_value_t = 300_000)]
    pub(super) cap: usize,
    /// Learns an affine colour transform for each photograph
    #[arg(long)]
    pub(super) exposure: bool,
    /// Refines the photographs' poses, and where each camera is on what its poses were measured of
    #[arg(long)]
    pub(super) refine_poses: bool,
    /// Whose poses and lenses
    #[arg(long, value_enum, value_name = "WHOSE", default_value = "auto")]
    pub(super) poses: PosesFrom,
    /// Divides the sides of photographs by this
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(super) downscale: u32,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u32,
    /// Goes on from the checkpoint in the output folder
    #[arg(long)]
    pub(super) resume: bool,
    /// Writes pictures beside photographs: one while training runs, at the end all that were held out
    #[arg(long)]
    pub(super) preview: bool,
    /// Holds out every Nth photograph, by name from the first on, to score with; 0 for none
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub(super) hold_out: usize,
    /// Stops after so many seconds
    #[arg(long, value_name = "S", value_parser = crate::numbers::not_negative)]
    pub(super) max_seconds: Option<f64>,
    /// Weight of flatness: the smallest scale of each Gaussian goes to 0
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) flattening: f32,
    /// Weight of measured depth [default: 0; where it is measured from the photographs 0.1]
    #[arg(long, value_name = "WEIGHT")]
    pub(super) depth_prior: Option<f32>,
    /// Measures no depth from the photographs (multi-view stereo), and leaves no Gaussians out of steps (dropout)
    #[arg(long)]
    pub(super) no_stereo: bool,
    /// Leaves out of photographs what moves through the capture, such as people; the masks are written as pictures
    #[arg(long)]
    pub(super) transients: bool,
    /// Weight of the agreement of normals with depth
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) depth_normal: f32,
    /// Weight of the agreement of patches between views
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) multi_view: f32,
    /// Weight of labels from files
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) labels: f32,
    /// Learns from photographs of half the size for this share of the steps, of a quarter for its square, and so on
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = crate::numbers::share)]
    pub(super) small: f64,
    /// Makes a scene whose small images are right, too: Gaussians no finer than what photographs sample, drawn with anti-aliasing (Mip-Splatting)
    #[arg(long)]
    pub(super) antialias: bool,
    /// What is behind everything: the mean colour of the photographs, or black
    #[arg(long, value_name = "WHAT", value_enum, default_value_t = Background::Mean, hide_short_help = true)]
    pub(super) background: Background,
    /// One line of JSON at the end instead of the summary
    #[arg(long)]
    pub(super) json: bool,
    /// Works on the graphics card
    #[cfg(feature = "gpu")]
    #[arg(long)]
    pub(super) gpu: bool,
    /// Which card, by its number in the order of the drivers; the one that wgpu prefers unless reported
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "N", requires = "gpu", hide_short_help = true)]
    pub(super) gpu_index: Option<usize>,
    /// Adds up in a fixed order on the card: slower, the same bits from run to run
    #[cfg(feature = "gpu")]
    #[arg(long)]
    pub(super) ordered: bool,
}
