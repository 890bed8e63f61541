//! The text of the shaders: constants of the CPU side, what a stage shares with others, the stage.

use crate::constants::*;
use std::fmt::Write;

/// Slots of the buffer `state`.
pub mod slot {
    /// Candidates that are drawn.
    pub const VISIBLE: u32 = 0;
    /// Entries that are drawn.
    pub const ENTRIES: u32 = 1;
    /// Candidates that there are.
    pub const NEEDED_VISIBLE: u32 = 2;
    /// Entries that there are.
    pub const NEEDED_ENTRIES: u32 = 3;
    /// Candidates with numbers that are not finite.
    pub const FAULTY: u32 = 4;
    /// Blocks of the sort by depth.
    pub const DEPTH_BLOCKS: u32 = 5;
    /// Bins of the sort by depth, all blocks together.
    pub const DEPTH_BINS: u32 = 6;
    /// Blocks of the sort by tile.
    pub const TILE_BLOCKS: u32 = 7;
    /// Bins of the sort by tile, all blocks together.
    pub const TILE_BINS: u32 = 8;
    /// Blocks of Gaussians times views.
    pub const CULL_BLOCKS: u32 = 9;
    /// Totals that nobody reads.
    pub const UNUSED: u32 = 10;
    /// How many there are.
    pub const COUNT: u32 = 16;
}

/// Slots of the buffer `arguments`, three words each.
pub mod dispatch {
    /// An invocation for each candidate.
    pub const BY_VISIBLE: u32 = 0;
    /// A scan over the candidates.
    pub const BY_VISIBLE_SCAN: u32 = 1;
    /// A workgroup for each block of the sort by depth.
    pub const BY_DEPTH_BLOCK: u32 = 2;
    /// A scan over the bins of the sort by depth.
    pub const BY_DEPTH_SCAN: u32 = 3;
    /// An invocation for each entry.
    pub const BY_ENTRY: u32 = 4;
    /// A workgroup for each block of the sort by tile.
    pub const BY_TILE_BLOCK: u32 = 5;
    /// A scan over the bins of the sort by tile.
    pub const BY_TILE_SCAN: u32 = 6;
    /// A workgroup for each 32 candidates.
    pub const BY_RECORDS: u32 = 7;
    /// How many there are.
    pub const COUNT: u32 = 8;
}

/// Keys that a workgroup of the sort holds.
pub const SORT_BLOCK: u32 = 4096;

/// What a shader is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Variant {
    /// Lanes of a subgroup when all have as many, at most 32; 0 to do without.
    pub subgroup: u32,
    /// Spherical harmonics per Gaussian.
    pub sh_count: u32,
    /// Features per Gaussian that are drawn.
    pub features: u32,
    /// Draw depth.
    pub depth: bool,
    /// Draw normal and plane depth.
    pub plane: bool,
    /// Colour as bytes.
    pub bytes: bool,
    /// Keep what the derivatives need.
    pub keep: bool,
    /// Add up derivatives with atomics; only with subgroups.
    pub atomic: bool,
    /// Make up for the low-pass.
    pub antialias: bool,
    /// Most bits of a digit of the sort.
    pub digit: u32,
}

impl Variant {
    fn flag(&self, name: &str) -> bool {
        match name {
            "SUBGROUPS" => self.subgroup > 0,
            "FEATURES" => self.features > 0,
            "DEPTH" => self.depth,
            "PLANE" => self.plane,
            "BYTES" => self.bytes,
            "KEEP" => self.keep,
            "PACKED" => self.packed(),
            "ATOMIC" => self.atomic,
            "ANTIALIAS" => self.antialias,
            _ => false,
        }
    }

    /// Whether records hold the colour in half precision and the opacity in 16 bits: enough for bytes.
    pub fn packed(&self) -> bool {
        self.bytes && !self.keep && self.features == 0
    }

    /// How often lines are repeated.
    fn times(&self, what: &str) -> u32 {
        match what {
            // Keys that an invocation of the sort holds.
            "KEYS" => SORT_BLOCK / 256,
            "CHANNELS" => self.channels(),
            "FEATURES" => self.features,
            // Derivatives of an entry, eight at a time.
            "EIGHTS" => self.width().div_ceil(8),
            _ => 0,
        }
    }

    /// Numbers that are blended.
    pub fn channels(&self) -> u32 {
        3 + self.depth as u32 + 4 * self.plane as u32 + self.features
    }

    /// Derivatives of an entry.
    pub fn width(&self) -> u32 {
        crate::stages::blend_backward::SHAPE_GRADIENTS as u32 + self.channels()
    }

    /// Workgroups of `blend_backward` for each tile.
    pub fn groups_per_tile(&self) -> u32 {
        if self.atomic { 256 / self.subgroup.max(1) } else { 1 }
    }

    /// Entries that a workgroup of `blend_backward` takes at once: the sums of its subgroups must fit 20 KiB.
    fn batch(&self) -> u32 {
        match self.subgroup {
            0 => 32,
            lanes if self.atomic => lanes,
            lanes => 1 << (20_480 / (256 / lanes * self.width().next_multiple_of(8) * 4)).ilog2().min(5),
        }
    }

    /// Most bits of a digit of the sort: the counts of all subgroups must fit 2048 words.
    pub fn digit_bits(&self) -> u32 {
        match self.subgroup {
            0 => 8,
            lanes => (lanes * 8).ilog2(),
        }
    }
}

/// The stages that have a shader, each with its entry points.
pub const STAGES: [(&str, &[&str]); 11] = [
    ("cull", &["mark", "gather"]),
    ("plan", &["visible", "entries"]),
    ("scan", &["reduce", "spine", "apply"]),
    ("project", &["project"]),
    ("sort", &["histogram", "scatter"]),
    ("emit", &["gather", "emit"]),
    ("ranges", &["find"]),
    ("blend", &["blend"]),
    ("compose", &["compose"]),
    ("blend_backward", &["blend_backward"]),
    ("project_backward", &["sum_entries", "project_backward", "poses"]),
];

/// The text of a stage.
pub fn text(stage: &str, variant: &Variant) -> String {
    let parts: &[&str] = match stage {
        "cull" => &[include_str!("stages/cull.wgsl")],
        "plan" => &[include_str!("gpu/plan.wgsl")],
        "scan" => &[include_str!("gpu/scan.wgsl")],
        "project" => &[
            include_str!("ellipse.wgsl"),
            include_str!("harmonics.wgsl"),
            include_str!("stages/shape.wgsl"),
            include_str!("stages/project.wgsl"),
        ],
        "sort" => &[include_str!("stages/sort.wgsl")],
        "emit" => &[include_str!("ellipse.wgsl"), include_str!("stages/emit.wgsl")],
        "ranges" => &[include_str!("stages/ranges.wgsl")],
        "blend" => &[include_str!("stages/pixels.wgsl"), include_str!("stages/blend.wgsl")],
        "compose" => &[include_str!("stages/compose.wgsl")],
        "blend_backward" => &[include_str!("stages/pixels.wgsl"), include_str!("stages/blend_backward.wgsl")],
        _ => &[
            include_str!("harmonics.wgsl"),
            include_str!("stages/shape.wgsl"),
            include_str!("stages/project_backward.wgsl"),
        ],
    };
    let mut out = constants(variant);
    for part in [&[include_str!("lens.wgsl"), include_str!("gpu/prelude.wgsl")], parts].concat() {
        choose(part, variant, &mut out);
    }
    out
}

fn constants(variant: &Variant) -> String {
    let mut out = String::new();
    for (name, value) in [
        ("MAX_ALPHA", MAX_ALPHA),
        ("MIN_ALPHA", MIN_ALPHA),
        ("MIN_TRANSMITTANCE", MIN_TRANSMITTANCE),
        ("LOW_PASS", if variant.antialias { ANTIALIAS_LOW_PASS } else { LOW_PASS }),
        ("NEAR", NEAR),
        ("MIN_FACING", MIN_FACING),
        ("MIN_QUATERNION", MIN_QUATERNION),
    ] {
        _ = writeln!(out, "const {name}: f32 = {value:e};");
    }
    let lanes = variant.subgroup.max(1);
    for (name, value) in [
        ("TILE", TILE),
        ("SORT_BLOCK", SORT_BLOCK),
        ("SH_COUNT", variant.sh_count.max(1)),
        ("FEATURE_COUNT", variant.features),
        ("DIGIT_BITS", variant.digit),
        ("SUBGROUP_SIZE", lanes),
        ("BLOCK_WIDTH", 1 << lanes.ilog2().div_ceil(2)),
        ("BLOCK_HEIGHT", 1 << (lanes.ilog2() / 2)),
        ("SUBGROUP_COUNT", 256 / lanes),
        ("SUBGROUP_MASK", ((1u64 << lanes) - 1) as u32),
        ("RANKS", (256 / lanes) << variant.digit),
        ("CHANNELS", variant.channels()),
        ("DEPTH_AT", 3),
        ("PLANE_AT", 3 + variant.depth as u32),
        ("FEATURES_AT", 3 + variant.depth as u32 + 4 * variant.plane as u32),
        ("WIDTH", variant.width()),
        ("NUMBERS", variant.width().next_multiple_of(8)),
        ("BATCH", variant.batch()),
        ("SUM_WORDS", 256 / lanes * variant.batch() * variant.width().next_multiple_of(8)),
        ("GROUPS_PER_TILE", variant.groups_per_tile()),
        ("GROUP_SIZE", 256 / variant.groups_per_tile()),
        ("VISIBLE", slot::VISIBLE),
        ("ENTRIES", slot::ENTRIES),
        ("NEEDED_VISIBLE", slot::NEEDED_VISIBLE),
        ("NEEDED_ENTRIES", slot::NEEDED_ENTRIES),
        ("FAULTY", slot::FAULTY),
        ("DEPTH_BLOCKS", slot::DEPTH_BLOCKS),
        ("DEPTH_BINS", slot::DEPTH_BINS),
        ("TILE_BLOCKS", slot::TILE_BLOCKS),
        ("TILE_BINS", slot::TILE_BINS),
        ("BY_VISIBLE", dispatch::BY_VISIBLE),
        ("BY_VISIBLE_SCAN", dispatch::BY_VISIBLE_SCAN),
        ("BY_DEPTH_BLOCK", dispatch::BY_DEPTH_BLOCK),
        ("BY_DEPTH_SCAN", dispatch::BY_DEPTH_SCAN),
        ("BY_ENTRY", dispatch::BY_ENTRY),
        ("BY_TILE_BLOCK", dispatch::BY_TILE_BLOCK),
        ("BY_TILE_SCAN", dispatch::BY_TILE_SCAN),
        ("BY_RECORDS", dispatch::BY_RECORDS),
    ] {
        _ = writeln!(out, "const {name}: u32 = {value}u;");
    }
    out
}

/// Keeps the lines between `//#if FLAG`, `//#else` and `//#endif` that the variant wants, and repeats those between `//#repeat WHAT`
/// and `//#end` with 0, 1, ... in the place of `$K`: arrays with indices that the compiler knows stay in registers.
fn choose(part: &str, variant: &Variant, out: &mut String) {
    let mut conditions: Vec<bool> = vec![];
    let mut block: Option<(String, u32)> = None;
    for line in part.lines() {
        let wanted = conditions.iter().all(|condition| *condition);
        match line.trim().strip_prefix("//#") {
            Some("else") => {
                if let Some(last) = conditions.last_mut() {
                    *last = !*last;
                }
            }
            Some("endif") => _ = conditions.pop(),
            Some("end") => {
                let (text, times) = block.take().unwrap_or_default();
                (0..times).for_each(|k| out.push_str(&text.replace("$K", &k.to_string())));
            }
            Some(directive) if wanted && directive.starts_with("repeat ") => {
                block = Some((String::new(), variant.times(&directive["repeat ".len()..])));
            }
            Some(directive) if directive.starts_with("repeat ") => {}
            Some(condition) => conditions.push(variant.flag(condition.trim_start_matches("if "))),
            None if wanted => {
                let to = block.as_mut().map_or(&mut *out, |(text, _)| text);
                to.push_str(line);
                to.push('\n');
            }
            None => {}
        }
    }
}
