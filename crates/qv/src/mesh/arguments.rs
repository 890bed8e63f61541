//! What the command line says of a mesh.

use crate::numbers::{not_negative, positive};
use std::path::PathBuf;

/// Frames that may confirm a depth: the nearest.
pub(super) const NEIGHBOURS: usize = 8;

#[derive(clap::Args)]
pub struct Mesh {
    /// A scene of Gaussians (.ply, .compressed.ply, .spz, .glb), or a folder with depth images
    pub(super) scene: PathBuf,
    /// For a scene of Gaussians: transforms.json, a folder with a COLMAP model or RGB-D frames, or cameras in a JSON of our own
    #[arg(long, value_name = "FILE")]
    pub(super) cameras: Option<PathBuf>,
    /// The mesh to write: .glb, .ply or .stl
    #[arg(long, value_name = "FILE")]
    pub(super) out: PathBuf,
    /// Writes the scene of Gaussians, moved as --markers, --trajectory, --distance and --up move the mesh (.ply, .compressed.ply, .spz, .glb):
    /// `qv navigate`, `qv view` and `qv diagnose --scene` need both in one frame
    #[arg(long, value_name = "FILE")]
    pub(super) scene_out: Option<PathBuf>,
    /// For depth images: the scene of Gaussians that --scene-out moves, in the frame of their cameras
    #[arg(long, value_name = "SCENE.ply", requires = "scene_out", conflicts_with = "cameras")]
    pub(super) scene_in: Option<PathBuf>,
    /// Side of a voxel, in metres
    #[arg(long, value_name = "METRES", default_value_t = 0.02, value_parser = positive)]
    pub(super) voxel: f64,
    /// Distance at which the signed distance is cut off, in voxels
    #[arg(long, value_name = "VOXELS", default_value_t = 4.0, value_parser = positive)]
    pub(super) truncation: f64,
    /// Largest depth that counts, in metres
    #[arg(long, value_name = "METRES", default_value_t = 8.0, value_parser = positive)]
    pub(super) max_depth: f64,
    /// Frames of the nearest 8 that must confirm each depth; 0 keeps all. Default 2 for a scene of Gaussians, 0 for measured depth
    #[arg(long, value_name = "COUNT", value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(..=NEIGHBOURS as u64))]
    pub(super) agree: Option<usize>,
    /// Lays plain regions of a scene of Gaussians on planes that what has texture supports all round them: walls and fronts of one colour,
    /// and what shines, where photographs alone say nothing of depth
    #[arg(long, requires = "cameras")]
    pub(super) planes: bool,
    /// Triangles to come down to; without it all are kept
    #[arg(long, value_name = "COUNT", value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(4..))]
    pub(super) triangles: Option<usize>,
    /// How far --triangles may move the surface, in metres; half a voxel without it
    #[arg(long, value_name = "METRES", value_parser = positive)]
    pub(super) max_error: Option<f64>,
    /// Keeps every piece of at least this area, in square metres, instead of the largest alone
    #[arg(long, value_name = "AREA", requires = "open", value_parser = positive)]
    pub(super) pieces: Option<f64>,
    /// Longest rim of a hole that is filled, in metres
    #[arg(long, value_name = "METRES", default_value_t = 3.0, value_parser = not_negative)]
    pub(super) max_hole: f64,
    /// Rounds of smoothing, each of about one voxel; 50 at most
    #[arg(long, value_name = "COUNT", default_value_t = 3, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(..=50))]
    pub(super) smoothing: usize,
    /// Leaves the surface open instead of making it a solid
    #[arg(long)]
    pub(super) open: bool,
    /// Most memory for voxels, in GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0, value_parser = positive)]
    pub(super) memory: f64,
    /// Names and friction of labels (TOML)
    #[arg(long, value_name = "FILE")]
    pub(super) labels: Option<PathBuf>,
    /// Lines `x y z X Y Z`: points of the scene and where they are, in metres, z up
    #[arg(long, value_name = "FILE", conflicts_with_all = ["trajectory", "distance"])]
    pub(super) markers: Option<PathBuf>,
    /// Lines `image X Y Z`: names of images and where their cameras were, in metres, z up
    #[arg(long, value_name = "FILE", conflicts_with = "distance")]
    pub(super) trajectory: Option<PathBuf>,
    /// Two points of the scene and their distance: x,y,z,x,y,z,metres
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',', allow_hyphen_values = true)]
    pub(super) distance: Option<Vec<f64>>,
    /// What is up in the scene: x,y,z; or `ground` for the largest plane that faces the cameras' up
    #[arg(long, value_name = "DIRECTION", allow_hyphen_values = true)]
    pub(super) up: Option<String>,
    /// A mesh (.glb or .ply) to compare the surface with, before it is closed: F1 at 2 and 5 cm
    #[arg(long, value_name = "FILE")]
    pub(super) compare: Option<PathBuf>,
    /// RGB-D frames that the mesh of --compare was made of: of ours, only what they could have measured is compared
    #[arg(long, value_name = "FOLDER", requires = "compare")]
    pub(super) compare_measured: Option<PathBuf>,
    /// Lays the surface on the mesh of --compare by closest points first: F1 is of the shape, not of where cameras were said to be
    #[arg(long, requires = "compare")]
    pub(super) compare_aligned: bool,
    /// Takes the folder for one of RGB-D frames, whatever it looks like
    #[arg(long)]
    pub(super) rgbd: bool,
    /// One line of JSON at the end instead of the summary
    #[arg(long)]
    pub(super) json: bool,
}
