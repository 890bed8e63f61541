//! The dispatches of a frame, stage by stage, with the buffers that each is bound to.

use super::buffers::Buffers;
use super::cloud::GpuCloud;
use super::constants::Constants;
use super::record::{Groups, Step};
use crate::lens::Batch;
use crate::shaders::{Variant, dispatch};

/// The dispatches of a frame.
pub(crate) struct FrameSteps<'a> {
    pub batch: &'a Batch,
    pub buffers: &'a Buffers,
    pub constants: &'a Constants,
    pub cloud: &'a GpuCloud,
}

impl<'a> FrameSteps<'a> {
    pub fn step(
        &self,
        stage: &'static str,
        entry: &'static str,
        groups: Groups<'a>,
        buffers: Vec<(u32, &'a wgpu::Buffer)>,
    ) -> Step<'a> {
        // Stages that do not depend on what is drawn share their pipelines.
        let all = Variant { digit: 0, ..self.buffers.sizes.variant };
        let variant = match stage {
            "project" => Variant { subgroup: 0, depth: false, bytes: all.packed(), keep: false, atomic: false, ..all },
            "sort" => Variant { subgroup: all.subgroup, ..Default::default() },
            "emit" => Variant { keep: all.keep, bytes: all.packed(), ..Default::default() },
            "blend" => Variant { sh_count: 0, atomic: false, antialias: false, ..all },
            "blend_backward" => Variant { sh_count: 0, bytes: false, antialias: false, ..all },
            "project_backward" => Variant { subgroup: 0, bytes: false, atomic: false, ..all },
            _ => Variant::default(),
        };
        Step { stage, entry, variant, groups, buffers }
    }

    pub fn indirect(&self, slot: u32) -> Groups<'a> {
        Groups::Indirect(&self.buffers.arguments, slot)
    }

    pub fn get(&self, name: &str) -> &'a wgpu::Buffer {
        self.buffers.get(name)
    }

    fn scan(&self, values: &'a wgpu::Buffer, which: usize, groups: Groups<'a>) -> Vec<Step<'a>> {
        let (sums, state, pass) = (self.get("sums"), &self.buffers.state, &self.constants.scans[which]);
        vec![
            self.step("scan", "reduce", groups, vec![(0, values), (1, sums), (2, state), (3, pass)]),
            self.step("scan", "spine", Groups::Fixed(1, 1), vec![(1, sums), (2, state), (3, pass)]),
            self.step("scan", "apply", groups, vec![(0, values), (1, sums), (2, state), (3, pass)]),
        ]
    }

    pub fn plan(&self, entry: &'static str) -> Step<'a> {
        let buffers = vec![(0, &self.buffers.state), (1, &self.buffers.arguments), (2, &self.constants.frame)];
        self.step("plan", entry, Groups::Fixed(1, 1), buffers)
    }

    pub fn cull(&self) -> Vec<Step<'a>> {
        let views = self.batch.lenses.len() as u32;
        let blocks = self.cloud.count.div_ceil(256) as u32;
        let groups = Groups::Fixed(blocks, views.div_ceil(16));
        let c = self.constants;
        let (marks, counts) = (self.get("marks"), self.get("block_counts"));
        let mark = vec![
            (0, &c.lenses),
            (1, &c.motions),
            (2, &self.cloud.means),
            (3, &self.cloud.scales),
            (4, marks),
            (5, counts),
            (7, &c.frame),
        ];
        let scan_blocks = (views * blocks).div_ceil(2048);
        let scan_groups = Groups::Fixed(scan_blocks.min(32768), scan_blocks.div_ceil(32768));
        let mut steps = vec![self.step("cull", "mark", groups, mark)];
        steps.extend(self.scan(counts, 0, scan_groups));
        steps.push(self.plan("visible"));
        let gather = vec![(4, marks), (5, counts), (6, self.get("candidates")), (7, &c.frame)];
        steps.push(self.step("cull", "gather", groups, gather));
        steps
    }

    pub fn project(&self) -> Vec<Step<'a>> {
        let c = self.constants;
        let mut buffers = vec![
            (0, &c.lenses),
            (1, &c.motions),
            (2, &self.cloud.means),
            (3, &self.cloud.scales),
            (4, &self.cloud.rotations),
            (5, &self.cloud.sh),
            (6, self.get("candidates")),
            (7, self.get("records")),
            (8, self.get("counts")),
            (9, self.get("depth_keys")),
            (10, &self.buffers.state),
            (11, &c.frame),
        ];
        if !self.buffers.sizes.variant.packed() {
            buffers.push((14, self.get("shades")));
        }
        if self.buffers.sizes.variant.plane {
            buffers.push((12, self.get("planes")));
        }
        if self.buffers.sizes.variant.features > 0 {
            buffers.push((13, &self.cloud.features));
        }
        vec![self.step("project", "project", self.indirect(dispatch::BY_VISIBLE), buffers)]
    }

    /// One pass for each digit; keys and payloads go back and forth between two buffers, the first payloads are `[3]` where given.
    fn sort(
        &self,
        passes: &'a [wgpu::Buffer],
        keys: [&'a wgpu::Buffer; 2],
        payloads: [&'a wgpu::Buffer; 3],
        by_block: u32,
        (by_scan, which, digit): (u32, usize, u32),
    ) -> Vec<Step<'a>> {
        let (bins, state) = (self.get("bins"), &self.buffers.state);
        let mut steps = vec![];
        for (k, pass) in passes.iter().enumerate() {
            let (from, to) = (k % 2, 1 - k % 2);
            let source = if k == 0 { payloads[2] } else { payloads[from] };
            let count = vec![(0, keys[from]), (1, bins), (2, state), (3, pass)];
            let digits = |mut step: Step<'a>| {
                step.variant.digit = digit;
                step
            };
            steps.push(digits(self.step("sort", "histogram", self.indirect(by_block), count)));
            steps.extend(self.scan(bins, which, self.indirect(by_scan)));
            let place =
                vec![(0, keys[from]), (1, bins), (2, state), (3, pass), (4, source), (5, keys[to]), (6, payloads[to])];
            steps.push(digits(self.step("sort", "scatter", self.indirect(by_block), place)));
        }
        steps
    }

    pub fn sort_by_depth(&self) -> Vec<Step<'a>> {
        let keys = [self.get("depth_keys"), self.get("depth_keys_other")];
        let orders = [self.get("order"), self.get("order_other"), self.get("order")];
        let scan = (dispatch::BY_DEPTH_SCAN, 1, self.constants.depth_bits);
        self.sort(&self.constants.depth_passes, keys, orders, dispatch::BY_DEPTH_BLOCK, scan)
    }

    fn order(&self) -> &'a wgpu::Buffer {
        self.get(self.constants.order())
    }

    pub fn emit(&self) -> Vec<Step<'a>> {
        let offsets = self.get("offsets");
        let pass = |which: usize| {
            let mut buffers = vec![
                (0, &self.constants.lenses),
                (1, self.get("records")),
                (2, self.get("candidates")),
                (3, self.order()),
                (4, offsets),
                (5, self.get("tiles")),
                (6, self.get("owners")),
                (7, &self.buffers.state),
                (8, self.get("counts")),
                (9, &self.constants.emits[which]),
            ];
            if self.buffers.sizes.variant.keep {
                buffers.push((10, self.get("firsts")));
            }
            self.step("emit", "emit", self.indirect(dispatch::BY_VISIBLE), buffers)
        };
        let gather = vec![(3, self.order()), (4, offsets), (7, &self.buffers.state), (8, self.get("counts"))];
        let mut steps = vec![pass(0), self.step("emit", "gather", self.indirect(dispatch::BY_VISIBLE), gather)];
        steps.extend(self.scan(offsets, 2, self.indirect(dispatch::BY_VISIBLE_SCAN)));
        steps.push(self.plan("entries"));
        steps.push(pass(1));
        steps
    }

    pub fn sort_by_tile(&self) -> Vec<Step<'a>> {
        let keys = [self.get("tiles"), self.get("tiles_other")];
        let (owners, other) = (self.get("owners"), self.get("sorted_other"));
        // With `keep` the entries' owners stay, and what is sorted are the entries' indices.
        let even = if self.buffers.sizes.variant.keep { self.get("sorted") } else { owners };
        let scan = (dispatch::BY_TILE_SCAN, 3, self.constants.tile_bits);
        self.sort(&self.constants.tile_passes, keys, [even, other, owners], dispatch::BY_TILE_BLOCK, scan)
    }

    /// The sorted entries: their tiles, and what was sorted with them.
    pub fn sorted(&self) -> (&'a wgpu::Buffer, &'a wgpu::Buffer) {
        let (tiles, sorted) = self.constants.sorted(self.buffers.sizes.variant.keep);
        (self.get(tiles), self.get(sorted))
    }

    pub fn ranges(&self) -> Vec<Step<'a>> {
        let buffers = vec![(0, self.sorted().0), (1, self.get("ranges")), (2, &self.buffers.state)];
        vec![self.step("ranges", "find", self.indirect(dispatch::BY_ENTRY), buffers)]
    }

    pub fn blend(&self) -> Vec<Step<'a>> {
        let variant = &self.buffers.sizes.variant;
        let mut buffers = vec![
            (0, &self.constants.lenses),
            (1, self.get("records")),
            (2, self.get("ranges")),
            (3, self.sorted().1),
            (4, &self.constants.look),
            (5, self.get("colours")),
        ];
        let mut with = |wanted: bool, binding: u32, buffer: &'a wgpu::Buffer| {
            if wanted {
                buffers.push((binding, buffer));
            }
        };
        with(!variant.packed(), 13, self.get("shades"));
        with(variant.depth, 6, self.get("depths"));
        with(variant.plane, 7, self.get("planes"));
        with(variant.plane, 8, self.get("plane_image"));
        with(variant.features > 0, 9, &self.cloud.features);
        with(variant.features > 0, 10, self.get("feature_image"));
        with(variant.keep, 11, self.get("owners"));
        with(variant.keep, 12, self.get("left_image"));
        let tiles = self.batch.lenses.iter().map(|lens| lens.tiles[0] * lens.tiles[1]).max().unwrap_or(0);
        vec![self.step("blend", "blend", Groups::Fixed(tiles, self.batch.lenses.len() as u32), buffers)]
    }
}
