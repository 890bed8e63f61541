//! What the command line says of a reconstruction.

use crate::normals::{self, Colours};
use clap::ValueEnum;
use std::path::PathBuf;

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum StrategyName {
    Mcmc,
    Classic,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum GuideName {
    Opacity,
    Error,
    Views,
}

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
    /// Steps, one photograph each
    #[arg(long, default_value_t = 7000, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) iterations: u32,
    /// Most Gaussians
    #[arg(long, default_value_t = 300_000)]
    pub(super) cap: usize,
    /// How Gaussians come and go
    #[arg(long, value_enum, default_value = "mcmc")]
    pub(super) strategy: StrategyName,
    /// Beside which Gaussians others are put with mcmc: those of high opacity, those in pixels that are drawn wrong, or that several photographs want better
    #[arg(long, value_enum, value_name = "WHAT", default_value = "opacity")]
    pub(super) guide: GuideName,
    /// Learns an affine colour transform for each photograph
    #[arg(long)]
    pub(super) exposure: bool,
    /// Learns how the lens of each camera darkens photographs towards their corners
    #[arg(long)]
    pub(super) vignetting: bool,
    /// Refines the photographs' poses, and where each camera is on what its poses were measured of
    #[arg(long)]
    pub(super) refine_poses: bool,
    /// Refines focal length and principal point of each camera
    #[arg(long)]
    pub(super) refine_lens: bool,
    /// Learns how each camera moved while its shutter was open: a scene sharper than photographs with motion blur (on the CPU)
    #[arg(long)]
    pub(super) shutter: bool,
    /// Rolling shutter: the time from the first row's beginning to the last row's, as a share of that and a row's exposure together
    #[arg(long, value_name = "SHARE", requires = "shutter", default_value_t = 0.0)]
    pub(super) readout: f32,
    /// Poses that a photograph of a moving camera is drawn from
    #[arg(long, value_name = "N", requires = "shutter", default_value_t = 5, hide_short_help = true)]
    pub(super) shutter_samples: usize,
    /// Exponent from the photographs' colours to the light that a moving camera sums up
    #[arg(long, value_name = "EXPONENT", requires = "shutter", default_value_t = 2.2, hide_short_help = true)]
    pub(super) gamma: f32,
    /// Whose poses and lenses
    #[arg(long, value_enum, value_name = "WHOSE", default_value = "auto")]
    pub(super) poses: PosesFrom,
    /// Most frames that are taken of a video
    #[arg(long, value_name = "N", default_value_t = 150, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(8..=2000))]
    pub(super) frames: usize,
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
    /// With more than 7000 steps: puts every Nth photograph aside at first, to find how many steps help, up to those asked for; then learns from all (0, and --max-seconds: no search)
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub(super) aside: usize,
    /// Stops after so many seconds
    #[arg(long, value_name = "S", value_parser = crate::numbers::not_negative)]
    pub(super) max_seconds: Option<f64>,
    /// Weight of flatness: the smallest scale of each Gaussian goes to 0
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) flattening: f32,
    /// Weight of measured depth [default: 0, with --stereo 0.1]
    #[arg(long, value_name = "WEIGHT")]
    pub(super) depth_prior: Option<f32>,
    /// Measures depth from the photographs themselves where none was measured: multi-view stereo
    #[arg(long)]
    pub(super) stereo: bool,
    /// Longest side of the images that depth is measured from, in pixels
    #[arg(long, value_name = "PX", requires = "stereo", hide_short_help = true, value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub(super) stereo_side: Option<u32>,
    /// Weight of the agreement of normals with depth
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) depth_normal: f32,
    /// Weight of the agreement of patches between views
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) multi_view: f32,
    /// Weight of normals, from files or a model
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) normal_prior: f32,
    /// A model of yours that sees normals, run by onnxruntime: takes [1, 3, H, W], gives [1, 3, h, w]
    #[arg(long, value_name = "FILE.onnx", requires = "normal_prior")]
    pub(super) normal_model: Option<PathBuf>,
    /// Which axes of the model are x right, y down, z forward: x,-y,-z for one with y up and z to the viewer
    #[arg(long, value_name = "AXES", default_value = "x,y,z", value_parser = normals::axes, allow_hyphen_values = true)]
    pub(super) normal_axes: String,
    /// What the model takes colours as
    #[arg(long, value_enum, value_name = "HOW", default_value = "imagenet")]
    pub(super) normal_colours: Colours,
    /// Weight of labels from files
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0)]
    pub(super) labels: f32,
    /// Points to begin with on random rays, besides those of the capture; 20000 where it has none, else none
    #[arg(long, value_name = "N")]
    pub(super) random_points: Option<usize>,
    /// Points to begin with at measured depths, besides those of the capture; 100000 with --depth-prior, else none
    #[arg(long, value_name = "N")]
    pub(super) depth_points: Option<usize>,
    /// Points to begin with far behind everything: for sky, and for what is too far to be triangulated
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) far_points: usize,
    /// Learns more often from photographs that show much ground: in proportion to 1 + S times its share of what each shows
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::numbers::not_negative)]
    pub(super) ground_views: f64,
    /// Labels of the ground in the label images; without them the plane that most points below the cameras lie on is the ground
    #[arg(long, value_name = "N,N", value_delimiter = ',', requires = "ground_views", hide_short_help = true, value_parser = clap::value_parser!(u8).range(1..))]
    pub(super) ground_labels: Vec<u8>,
    /// Lets no Gaussian stay nearer to a camera than this share of the nearest points in its image (with mcmc; 0 lets them be)
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub(super) clear: f32,
    /// Leaves up to this share of the Gaussians out of each step, at random: fewer photographs are learned by heart
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub(super) drop: f32,
    /// Learns from photographs of half the size for this share of the steps, of a quarter for its square, and so on
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = crate::numbers::share)]
    pub(super) small: f64,
    /// Makes a scene whose small images are right, too: Gaussians no finer than what photographs sample, drawn with anti-aliasing (Mip-Splatting)
    #[arg(long)]
    pub(super) antialias: bool,
    /// What the rates of the Gaussians fall to in the last sixth of the steps
    #[arg(long, value_name = "SHARE", default_value_t = 1.0, hide_short_help = true)]
    pub(super) settle: f32,
    /// Weight of harmonics but the constant one
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.0, hide_short_help = true)]
    pub(super) harmonics_weight: f32,
    /// Noise of the means with mcmc, in units of their rate
    #[arg(long, default_value_t = 5e5, hide_short_help = true)]
    pub(super) noise: f32,
    /// What is behind everything: the mean colour of the photographs, or black
    #[arg(long, value_name = "WHAT", value_enum, default_value_t = Background::Mean, hide_short_help = true)]
    pub(super) background: Background,
    /// Weight of opacity with mcmc
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.01, hide_short_help = true)]
    pub(super) opacity_weight: f32,
    /// Weight of scale with mcmc, in units of the extent of the cameras
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.01, hide_short_help = true)]
    pub(super) scale_weight: f32,
    /// Reports how long the stages of a step take on the card
    #[arg(long, hide = true)]
    pub(super) times: bool,
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
