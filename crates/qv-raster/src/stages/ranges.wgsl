// Twin of ranges.rs: first entry of each tile and the one after its last. The ranges are zeros before.

@group(0) @binding(0) var<storage, read> sorted_tiles: array<u32>;
@group(0) @binding(1) var<storage, read_write> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> state: array<u32>;

@compute @workgroup_size(256)
fn find(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    let length = state[ENTRIES];
    if index >= length {
        return;
    }
    let tile = sorted_tiles[index];
    if index == 0u || sorted_tiles[index - 1u] != tile {
        ranges[tile].x = index;
    }
    if index + 1u == length || sorted_tiles[index + 1u] != tile {
        ranges[tile].y = index + 1u;
    }
}
