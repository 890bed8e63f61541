//! The buffers of a frame: made for a number of candidates and of entries, and made anew when those do not suffice.

use super::device::{Gpu, SMALLEST};
use crate::RasterError;
use crate::lens::Batch;
use crate::shaders::{SORT_BLOCK, Variant, dispatch, slot};

/// What early stages leave goes into buffers that later stages fill: name, and whose memory it has. What is read for the last
/// time in a stage may go where the next stage writes, but not where the stage itself does: *project* and *emit* read candidates, *emit*
/// the order and not the keys.
const BORROWED: [(&str, &str); 4] = [
    ("candidates", "tiles_other"),
    ("depth_keys", "tiles"),
    ("depth_keys_other", "owners"),
    ("order_other", "sorted_other"),
];

/// Whether what is in a buffer is written over within the frame.
pub fn is_borrowed(name: &str) -> bool {
    BORROWED.iter().any(|(guest, _)| *guest == name)
}

/// What the buffers are made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// Views.
    pub views: u64,
    /// Blocks of 256 Gaussians.
    pub blocks: u64,
    /// Candidates of all views.
    pub visible: u64,
    /// Entries of all views.
    pub entries: u64,
    /// Tiles of all views.
    pub tiles: u64,
    /// Pixels of all views.
    pub pixels: u64,
    /// What is drawn.
    pub variant: Variant,
}

impl Sizes {
    /// Whether buffers of this size do for others.
    pub fn hold(&self, wanted: &Self) -> bool {
        self.views >= wanted.views
            && self.blocks >= wanted.blocks
            && self.visible >= wanted.visible
            && self.entries >= wanted.entries
            && self.tiles >= wanted.tiles
            && self.pixels >= wanted.pixels
            && self.variant == wanted.variant
    }

    /// The least candidates and entries to begin with, when nothing is known: an eighth of the Gaussians in each view, each
    /// on three tiles. Too little costs the first batch a second run, too much costs memory for good.
    pub fn guess(batch: &Batch, splats: usize, variant: Variant) -> Self {
        let pairs = (batch.lenses.len() * splats) as u64;
        let visible = pairs.min((pairs / 8).max(1 << 16)).max(1);
        Self {
            views: batch.lenses.len() as u64,
            blocks: splats.div_ceil(256) as u64,
            visible,
            entries: 3 * visible + (1 << 16),
            tiles: batch.tiles as u64,
            pixels: batch.pixels as u64,
            variant,
        }
    }

    /// Bytes of all buffers of a frame, the images included.
    pub fn bytes(&self) -> u64 {
        self.list().iter().map(|(_, bytes)| bytes.max(&SMALLEST)).sum()
    }

    fn list(&self) -> Vec<(&'static str, u64)> {
        let v = &self.variant;
        let bins = (self.visible.max(self.entries).div_ceil(SORT_BLOCK as u64)) << v.digit_bits();
        let scanned = bins.max(self.visible).max(self.views * self.blocks);
        let mut list = vec![
            ("marks", self.views * self.blocks * 32),
            ("block_counts", self.views * self.blocks * 4),
            ("records", self.visible * 32),
            ("counts", self.visible * 4),
            ("order", self.visible * 4),
            ("offsets", self.visible * 4),
            ("tiles", self.entries.max(self.visible) * 4),
            ("tiles_other", self.entries.max(2 * self.visible) * 4),
            ("owners", self.entries.max(self.visible) * 4),
            ("sorted_other", self.entries.max(self.visible) * 4),
            ("bins", bins * 4),
            ("sums", scanned.div_ceil(2048) * 4 + 4),
            ("ranges", self.tiles * 8),
            ("colours", self.pixels * if v.bytes { 4 } else { 16 }),
        ];
        let mut with = |wanted: bool, name: &'static str, bytes: u64| {
            if wanted {
                list.push((name, bytes));
            }
        };
        with(!v.packed(), "shades", self.visible * 16);
        with(v.depth, "depths", self.pixels * 4);
        with(v.plane, "planes", self.visible * 16);
        with(v.plane, "plane_image", self.pixels * 16);
        with(v.features > 0, "feature_image", self.pixels * 4 * v.features as u64);
        with(v.keep, "firsts", self.visible * 4);
        with(v.keep, "sorted", self.entries * 4);
        with(v.keep, "left_image", self.pixels * 8);
        let splats = self.blocks * 256;
        with(v.keep && !v.atomic, "entry_gradients", self.entries * 4 * v.width() as u64);
        with(v.keep, "record_gradients", self.visible * 4 * v.width() as u64);
        with(v.keep, "by_colours", self.pixels * 16);
        with(v.keep && v.depth, "by_depths", self.pixels * 4);
        with(v.keep && v.plane, "by_planes", self.pixels * 16);
        with(v.keep && v.features > 0, "by_features", self.pixels * 4 * v.features as u64);
        with(v.keep, "by_shape", splats * 48);
        with(v.keep, "by_sh", splats * 12 * v.sh_count as u64);
        with(v.keep && v.features > 0, "by_feature", splats * 4 * v.features as u64);
        with(v.keep, "by_pose_parts", self.views * self.blocks * 24);
        with(v.keep, "by_pose", self.views * 24);
        list
    }
}

/// The buffers of a frame by name.
#[derive(Debug)]
pub struct Buffers {
    /// What they are made for.
    pub sizes: Sizes,
    /// Counts that stages hand on.
    pub state: wgpu::Buffer,
    /// Arguments of indirect dispatches.
    pub arguments: wgpu::Buffer,
    list: Vec<(&'static str, wgpu::Buffer)>,
}

impl Buffers {
    /// Makes them.
    ///
    /// # Errors
    /// One is larger than the device allows, all are larger than `memory` \[bytes\], or there is none left.
    pub fn new(gpu: &Gpu, sizes: Sizes, memory: u64) -> Result<Self, RasterError> {
        if sizes.bytes() > memory {
            let what = "bytes of all buffers of a batch".to_string();
            return Err(RasterError::TooLarge { what, limit: memory, found: sizes.bytes() });
        }
        let wanted = sizes.list();
        let limit = gpu.largest_buffer();
        // All are checked before any is made.
        if let Some((name, bytes)) = wanted.iter().find(|(_, bytes)| *bytes > limit) {
            return Err(RasterError::TooLarge { what: format!("bytes of the buffer `{name}`"), limit, found: *bytes });
        }
        let list = wanted.iter().map(|(name, bytes)| Ok((*name, gpu.buffer(name, *bytes)?)));
        Ok(Self {
            sizes,
            state: gpu.buffer("state", slot::COUNT as u64 * 4)?,
            arguments: gpu.buffer("arguments", dispatch::COUNT as u64 * 12)?,
            list: list.collect::<Result<_, RasterError>>()?,
        })
    }

    /// One of them; `state` stands in for one that the variant does not have.
    pub fn get(&self, name: &str) -> &wgpu::Buffer {
        self.find(name).unwrap_or(&self.state)
    }

    /// One of them.
    pub fn find(&self, name: &str) -> Option<&wgpu::Buffer> {
        let name = BORROWED.iter().find(|(guest, _)| *guest == name).map_or(name, |(_, host)| *host);
        self.list.iter().find(|(known, _)| *known == name).map(|(_, buffer)| buffer)
    }
}
