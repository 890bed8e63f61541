// How many workgroups each stage takes: `visible` once the candidates are counted, `entries` once the entries are. What does not fit
// is cut off here and told by the needed numbers.

@group(0) @binding(0) var<storage, read_write> state: array<u32>;
@group(0) @binding(1) var<storage, read_write> arguments: array<u32>;
@group(0) @binding(2) var<storage, read> frame: Frame;

struct Frame {
    views: u32,
    splats: u32,
    groups: u32,
    blocks: u32,
    capacity: u32,
    entry_capacity: u32,
    depth_bins: u32,
    tile_bins: u32,
}

fn dispatch(slot: u32, groups: u32) {
    arguments[3u * slot] = min(groups, FOLD);
    arguments[3u * slot + 1u] = (groups + FOLD - 1u) / FOLD;
    arguments[3u * slot + 2u] = 1u;
}

fn over(n: u32, each: u32) -> u32 {
    return (n + each - 1u) / each;
}

@compute @workgroup_size(1)
fn visible() {
    let n = min(state[NEEDED_VISIBLE], frame.capacity);
    state[VISIBLE] = n;
    state[FAULTY] = 0u;
    let blocks = over(n, SORT_BLOCK);
    state[DEPTH_BLOCKS] = blocks;
    state[DEPTH_BINS] = blocks * frame.depth_bins;
    dispatch(BY_VISIBLE, over(n, 256u));
    dispatch(BY_RECORDS, over(n, 32u));
    dispatch(BY_VISIBLE_SCAN, over(n, 2048u));
    dispatch(BY_DEPTH_BLOCK, blocks);
    dispatch(BY_DEPTH_SCAN, over(blocks * frame.depth_bins, 2048u));
}

@compute @workgroup_size(1)
fn entries() {
    let n = min(state[NEEDED_ENTRIES], frame.entry_capacity);
    state[ENTRIES] = n;
    let blocks = over(n, SORT_BLOCK);
    state[TILE_BLOCKS] = blocks;
    state[TILE_BINS] = blocks * frame.tile_bins;
    dispatch(BY_ENTRY, over(n, 256u));
    dispatch(BY_TILE_BLOCK, blocks);
    dispatch(BY_TILE_SCAN, over(blocks * frame.tile_bins, 2048u));
}
