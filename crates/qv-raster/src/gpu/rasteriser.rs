//! What draws on the graphics card, and how.

use super::buffers::Buffers;
use super::cloud::GpuCloud;
use super::constants::Constants;
use super::device::Gpu;
use super::record::Stamps;
use crate::lens::Batch;

/// The stages between which work can pass from the CPU to the card.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Candidates.
    Cull,
    /// Records.
    Project,
    /// Records from near to far.
    SortByDepth,
    /// Entries.
    Emit,
    /// Entries by tile.
    SortByTile,
    /// Entries of each tile.
    Ranges,
}

impl Stage {
    /// All of them in order.
    pub const ALL: [Self; 6] =
        [Self::Cull, Self::Project, Self::SortByDepth, Self::Emit, Self::SortByTile, Self::Ranges];
}

/// How the card draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GpuSettings {
    /// Colour and alpha as four bytes instead of four floats.
    pub bytes: bool,
    /// Keep what the derivatives need.
    pub keep: bool,
    /// Add up derivatives with atomics: faster, and the last bits differ from run to run. Left out where the adapter has no
    /// atomics for floats, or no subgroups.
    pub atomic: bool,
    /// Put time stamps around the stages.
    pub timed: bool,
}

/// Draws batches, with buffers that it keeps from one to the next.
#[derive(Debug)]
pub struct GpuRasteriser {
    /// The device.
    pub gpu: Gpu,
    /// Most bytes that the buffers of a batch may take; batches that would take more are refused, or split.
    pub memory: u64,
    pub(crate) buffers: Option<Buffers>,
    pub(crate) batch: Option<Batch>,
    pub(crate) stamps: Option<Stamps>,
    pub(crate) constants: Option<Constants>,
    /// The stage up to which the CPU drew the last batch.
    pub(crate) after: Option<Stage>,
    /// Whether the prepared batch was drawn.
    pub(crate) drawn: bool,
    /// The cloud that the batch was prepared for.
    pub(crate) kind: Kind,
}

impl GpuRasteriser {
    /// On a device.
    pub fn new(gpu: Gpu) -> Self {
        Self {
            gpu,
            memory: u64::MAX,
            buffers: None,
            batch: None,
            stamps: None,
            constants: None,
            after: None,
            drawn: false,
            kind: (0, 0, 0, 0),
        }
    }
}

/// Gaussians, degree, features and groups of a cloud: what shaders rely on.
pub(crate) type Kind = (usize, u8, usize, usize);

pub(crate) fn kind(cloud: &GpuCloud) -> Kind {
    (cloud.count, cloud.sh_degree, cloud.feature_count, cloud.groups)
}
