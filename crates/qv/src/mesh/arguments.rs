//! What the command line says of a mesh.

use crate::numbers::{not_negative, positive};
use std::path::PathBuf;

/// Frames that may confirm a depth: the nearest.
pub(super) const NEIGHBOURS: usize = 8;

#[derive(clap::Args)]
pub struct Mesh {
    /// Gaussian scene, or folder with depth images
    pub(super) scene: PathBuf,
    /// Read cameras: transforms.json, COLMAP, RGB-D or qv-cameras JSON
    ///
    /// Required for a scene of Gaussians.
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    pub(super) cameras: Option<PathBuf>,
    /// Write the mesh: .glb, .ply or .stl
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(super) out: PathBuf,
    /// Write the Gaussian scene in the frame of the mesh
    ///
    /// It moves as --markers, --trajectory, --distance and --up move the mesh (.ply, .compressed.ply, .spz, .glb). `qv navigate`, `qv view` and `qv diagnose --scene` need both in one frame.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(super) scene_out: Option<PathBuf>,
    /// Move this scene with --scene-out, if the input is depth images
    #[arg(
        long,
        value_name = "SCENE.ply",
        requires = "scene_out",
        conflicts_with = "cameras",
        help_heading = "Advanced",
        hide_short_help = true
    )]
    pub(super) scene_in: Option<PathBuf>,
    /// Set the voxel size
    #[arg(long, value_name = "METRES", default_value_t = 0.02, value_parser = positive, help_heading = "Scene")]
    pub(super) voxel: f64,
    /// Set the truncation distance of the signed distance field
    #[arg(long, value_name = "VOXELS", default_value_t = 4.0, value_parser = positive, help_heading = "Advanced", hide_short_help = true)]
    pub(super) truncation: f64,
    /// Ignore depth beyond this distance
    #[arg(long, value_name = "METRES", default_value_t = 8.0, value_parser = positive, help_heading = "Advanced", hide_short_help = true)]
    pub(super) max_depth: f64,
    /// Require N of the 8 nearest frames to confirm a depth
    ///
    /// 0 keeps all depths. Default: 2 for a scene of Gaussians, 0 for measured depth.
    #[arg(long, value_name = "COUNT", value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(..=NEIGHBOURS as u64), help_heading = "Advanced", hide_short_help = true)]
    pub(super) agree: Option<usize>,
    /// Snap textureless regions to planes supported by surrounding texture
    #[arg(long, requires = "cameras", help_heading = "Scene")]
    pub(super) planes: bool,
    /// Simplify to at most this many triangles, walls and floor included
    #[arg(long, value_name = "COUNT", value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(4..), help_heading = "Scene")]
    pub(super) triangles: Option<usize>,
    /// Limit the surface error of --triangles [default: half a voxel]
    #[arg(long, value_name = "METRES", value_parser = positive, help_heading = "Advanced", hide_short_help = true)]
    pub(super) max_error: Option<f64>,
    /// Keep every piece of at least this area, not only the largest
    #[arg(long, value_name = "SQUARE_METRES", requires = "open", value_parser = positive, help_heading = "Advanced", hide_short_help = true)]
    pub(super) pieces: Option<f64>,
    /// Fill holes with a rim up to this length
    #[arg(long, value_name = "METRES", default_value_t = 3.0, value_parser = not_negative, help_heading = "Advanced", hide_short_help = true)]
    pub(super) max_hole: f64,
    /// Smooth COUNT times (one voxel each, at most 50)
    #[arg(long, value_name = "COUNT", default_value_t = 3, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(..=50), help_heading = "Advanced", hide_short_help = true)]
    pub(super) smoothing: usize,
    /// Leave the surface open instead of closing it to a solid
    #[arg(long, help_heading = "Scene")]
    pub(super) open: bool,
    /// Limit the memory of the voxels
    #[arg(long, value_name = "GIB", default_value_t = 8.0, value_parser = positive, help_heading = "Advanced", hide_short_help = true)]
    pub(super) memory: f64,
    /// Read names and friction of labels (TOML)
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    pub(super) labels: Option<PathBuf>,
    /// Align to control points: lines `x y z X Y Z`, metres, z up
    #[arg(long, value_name = "FILE", conflicts_with_all = ["trajectory", "distance"], help_heading = "Input")]
    pub(super) markers: Option<PathBuf>,
    /// Align to camera positions: lines `image X Y Z`, metres, z up
    #[arg(long, value_name = "FILE", conflicts_with = "distance", help_heading = "Input", hide_short_help = true)]
    pub(super) trajectory: Option<PathBuf>,
    /// Scale by two points and their distance: x,y,z,x,y,z,metres
    #[arg(
        long,
        value_name = "NUMBERS",
        value_delimiter = ',',
        allow_hyphen_values = true,
        help_heading = "Input",
        hide_short_help = true
    )]
    pub(super) distance: Option<Vec<f64>>,
    /// Set the up direction: x,y,z, or `ground` for the largest floor plane
    #[arg(long, value_name = "DIRECTION", allow_hyphen_values = true, help_heading = "Input")]
    pub(super) up: Option<String>,
    /// Print the F1 score against this mesh at 2 and 5 cm
    #[arg(long, value_name = "FILE", help_heading = "What to test", hide_short_help = true)]
    pub(super) compare: Option<PathBuf>,
    /// Compare only what these RGB-D frames could have measured
    #[arg(long, value_name = "DIR", requires = "compare", help_heading = "What to test", hide_short_help = true)]
    pub(super) compare_measured: Option<PathBuf>,
    /// Align to --compare by ICP first, so that F1 is of the shape alone
    #[arg(long, requires = "compare", help_heading = "What to test", hide_short_help = true)]
    pub(super) compare_aligned: bool,
    /// Read the folder as RGB-D frames
    #[arg(long, help_heading = "Advanced", hide_short_help = true)]
    pub(super) rgbd: bool,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    pub(super) json: bool,
}
