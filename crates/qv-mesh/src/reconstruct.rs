//! All steps from depth maps to a collision mesh, one after the other.

use crate::clean::{DroppedPieces, keep_largest, smooth, split_fans};
use crate::close::{ClosedSurface, close_to_solid, fill_holes};
use crate::decimate::{DecimateOptions, Decimation, decimate};
use crate::error::off;
use crate::labels::{LabelOptions, LabelledPoints, label_faces};
use crate::{DepthFrame, FuseOptions, MeshError, Topology, Volume, extract, fuse};
use qv_core::{Material, TriangleMesh};

/// What becomes of the surface after it is extracted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshOptions {
    /// Rounds of smoothing.
    pub smoothing: usize,
    /// Keeps pieces of at least this area \[m²\] beside the largest; none keeps the largest alone.
    pub pieces: Option<f64>,
    /// Holes with a longer rim stay, or get walls and a floor of their own \[m\].
    pub max_hole: f64,
    /// Makes the open ground a watertight solid, with a floor this far below its lowest point \[m\]; none leaves it open.
    pub solid: Option<f64>,
    /// Triangles to come down to; none for all.
    pub triangles: Option<usize>,
    /// How far that may move the surface \[m\].
    pub max_error: f64,
    /// How faces are labelled.
    pub labels: LabelOptions,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self {
            smoothing: 3,
            pieces: None,
            max_hole: 3.0,
            solid: Some(0.2),
            triangles: None,
            max_error: 0.01,
            labels: LabelOptions::default(),
        }
    }
}

/// What was done.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MeshReport {
    /// Blocks of the volume, and its memory, bytes.
    pub blocks: usize,
    /// Memory of the volume, bytes.
    pub volume_bytes: u64,
    /// Triangles of the surface before anything was done to it.
    pub extracted: usize,
    /// Pieces that were dropped.
    pub dropped: DroppedPieces,
    /// Holes.
    pub holes: ClosedSurface,
    /// Rims that were closed by walls and a floor.
    pub rims: ClosedSurface,
    /// Faces that had labelled points nearby.
    pub labelled: usize,
    /// Taking away triangles.
    pub decimated: Decimation,
    /// The mesh that came out.
    pub topology: Topology,
}

/// Depth maps to a collision mesh: [`fuse`], [`extract`] and [`finish`].
///
/// # Errors
/// What these say.
pub fn reconstruct(
    frames: &[DepthFrame],
    labels: Option<(&LabelledPoints, &[Material])>,
    fusing: &FuseOptions,
    options: &MeshOptions,
) -> Result<(TriangleMesh, MeshReport), MeshError> {
    let volume = fuse(frames, fusing)?;
    finish(&volume, labels, options)
}

/// A volume to a collision mesh: [`surface`], then closed to a solid when the options say so.
///
/// # Errors
/// As [`surface`].
pub fn finish(
    volume: &Volume,
    labels: Option<(&LabelledPoints, &[Material])>,
    options: &MeshOptions,
) -> Result<(TriangleMesh, MeshReport), MeshError> {
    let (mut mesh, mut report) = surface(volume, labels, options)?;
    if let Some(thickness) = options.solid {
        report.rims = close_to_solid(&mut mesh, thickness);
        report.topology = Topology::of(&mesh);
    }
    Ok((mesh, report))
}

/// The open surface of a volume: largest piece or pieces, holes filled, smoothed, labelled, fewer triangles.
///
/// # Errors
/// There is no surface, or the labels do not fit.
pub fn surface(
    volume: &Volume,
    labels: Option<(&LabelledPoints, &[Material])>,
    options: &MeshOptions,
) -> Result<(TriangleMesh, MeshReport), MeshError> {
    let mut mesh = extract(volume);
    let mut report = MeshReport {
        blocks: volume.block_count(),
        volume_bytes: volume.memory(),
        extracted: mesh.triangles.len(),
        ..Default::default()
    };
    if mesh.triangles.is_empty() {
        let expected = "a surface that was seen on enough voxels (frames that see less of it ask for larger ones)";
        return Err(off("fused depth", expected, format!("none in {} blocks", report.blocks)));
    }
    split_fans(&mut mesh);
    report.dropped = keep_largest(&mut mesh, options.pieces);
    report.holes = fill_holes(&mut mesh, options.max_hole);
    smooth(&mut mesh, options.smoothing);
    if let Some((points, materials)) = labels {
        report.labelled = label_faces(&mut mesh, materials, points, &options.labels)?;
    }
    if let Some(triangles) = options.triangles {
        let how = DecimateOptions { triangles, max_error: options.max_error };
        report.decimated = decimate(&mut mesh, &how);
    }
    report.topology = Topology::of(&mesh);
    Ok((mesh, report))
}
