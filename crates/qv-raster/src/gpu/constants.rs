//! Small buffers that depend on the batch alone.

/// Small buffers that depend on the batch alone.
#[derive(Debug)]
pub(crate) struct Constants {
    pub lenses: wgpu::Buffer,
    pub motions: wgpu::Buffer,
    pub look: wgpu::Buffer,
    pub frame: wgpu::Buffer,
    pub scans: [wgpu::Buffer; 4],
    pub emits: [wgpu::Buffer; 2],
    pub depth_passes: Vec<wgpu::Buffer>,
    pub tile_passes: Vec<wgpu::Buffer>,
    pub depth_bits: u32,
    pub tile_bits: u32,
}

impl Constants {
    /// Name of the buffer in which the order by depth ends.
    pub fn order(&self) -> &'static str {
        if self.depth_passes.len().is_multiple_of(2) { "order" } else { "order_other" }
    }

    /// Names of the buffers in which the sorted entries end: their tiles, and what is sorted with them.
    pub fn sorted(&self, keep: bool) -> (&'static str, &'static str) {
        match (self.tile_passes.len().is_multiple_of(2), keep) {
            (true, true) => ("tiles", "sorted"),
            (true, false) => ("tiles", "owners"),
            _ => ("tiles_other", "sorted_other"),
        }
    }
}
