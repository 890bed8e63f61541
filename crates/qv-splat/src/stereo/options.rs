//! How stereo is done.

/// How depth is measured. Lengths of images are in pixels of the images that are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoOptions {
    /// Longest side of the images that are compared \[px\]: sides of photographs are divided by the smallest whole number that gives it.
    pub side: u32,
    /// Most photographs that one is compared with.
    pub neighbours: usize,
    /// Half side of a patch less one half \[px\]: 3 for 7 x 7.
    pub radius: usize,
    /// Deviation of grey by noise, 0 to 1: patches that vary by less are alike by chance.
    pub noise: f32,
    /// What lies between two planes in the photographs compared, in the median \[px\].
    pub plane_px: f64,
    /// Fewest and most planes.
    pub planes: [usize; 2],
    /// Cost of one plane between two pixels side by side, in units of 1 - NCC (Hirschmüller's P1).
    pub small_jump: f32,
    /// Cost of more than one (P2), where grey does not change.
    pub large_jump: f32,
    /// Change of grey at which the large one costs half.
    pub edge: f32,
    /// Least correlation of a depth that counts.
    pub least_ncc: f32,
    /// Photographs that must agree.
    pub agreeing: usize,
    /// Difference of inverse depths that agree, in planes.
    pub within: f32,
}

impl Default for StereoOptions {
    fn default() -> Self {
        Self {
            side: 400,
            neighbours: 8,
            radius: 3,
            noise: 2.0 / 255.0,
            plane_px: 1.0,
            planes: [32, 256],
            small_jump: 0.08,
            large_jump: 0.4,
            edge: 0.04,
            least_ncc: 0.3,
            agreeing: 2,
            within: 1.0,
        }
    }
}
