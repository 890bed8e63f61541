// Twin of emit.rs. `count` lays the counts out in the order of depth; after a scan, `emit` writes the entries: an
// invocation those of one Gaussian, several invocations those of a large one.

@group(0) @binding(0) var<storage, read> lenses: array<Lens>;
@group(0) @binding(1) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> counts: array<u32>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(5) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(6) var<storage, read_write> owners: array<u32>;
@group(0) @binding(7) var<storage, read> state: array<u32>;
//#if KEEP
@group(0) @binding(8) var<storage, read_write> firsts: array<u32>;
//#endif
@group(0) @binding(9) var<storage, read> candidates: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read> frame: Frame;

struct Frame {
    views: u32,
    splats: u32,
    groups: u32,
    blocks: u32,
    capacity: u32,
    entry_capacity: u32,
    depth_bins: u32,
    tile_bins: u32,
    tiles: u32,
}

@compute @workgroup_size(256)
fn count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    if index < state[VISIBLE] {
        offsets[index] = counts[order[index]];
    }
}

// Gaussians with more entries than this are left to the whole workgroup.
const MANY: u32 = 16u;

var<workgroup> large_count: atomic<u32>;
var<workgroup> large_held: u32;
// Indices of the large ones, in any order: where their entries stand is fixed.
var<workgroup> large: array<u32, 256>;

fn record_ellipse(record: u32) -> Ellipse {
    let a = records[2u * record];
    let b = records[2u * record + 1u];
    return ellipse_of(a.xy, a.z, a.w, b.x, opacity_of(b));
}

@compute @workgroup_size(256)
fn emit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&large_count, 0u);
    }
    workgroupBarrier();
    let index = folded(group) * 256u + local;
    let limit = state[ENTRIES];
    // The tile after the last: rounding may differ between the stage that counted and this one, and an entry that was counted
    // for nothing must be in no tile.
    let nowhere = frame.tiles;
    if index < state[VISIBLE] {
        let record = order[index];
        let count = counts[record];
        var at = offsets[index];
//#if KEEP
        firsts[record] = at;
//#endif
        if count > MANY {
            large[atomicAdd(&large_count, 1u)] = index;
        } else if count > 0u {
            let view = candidates[record].x;
            let size = lenses[view].size;
            let e = record_ellipse(record);
            let rows = ellipse_rows(e, size);
            let end = min(at + count, limit);
            for (var row = rows.x; row < rows.y; row++) {
                let span = ellipse_row(e, row, size);
                let first = lenses[view].first_tile + row * lenses[view].tiles.x;
                for (var column = span.x; column < span.y && at < end; column++) {
                    tiles[at] = first + column;
                    owners[at] = record;
                    at += 1u;
                }
            }
            for (; at < end; at++) {
                tiles[at] = nowhere;
                owners[at] = record;
            }
        }
    }
    workgroupBarrier();
    if local == 0u {
        large_held = atomicLoad(&large_count);
    }
    let larges = workgroupUniformLoad(&large_held);
    // 16 invocations for each of the large ones, each with every 16th entry.
    for (var k = local / 16u; k < larges; k += 16u) {
        let record = order[large[k]];
        let count = counts[record];
        let begin = offsets[large[k]];
        let view = candidates[record].x;
        let size = lenses[view].size;
        let e = record_ellipse(record);
        let rows = ellipse_rows(e, size);
        var row = rows.x;
        var span = ellipse_row(e, row, size);
        // Entries of the rows before.
        var before = 0u;
        for (var rank = local % 16u; rank < count && begin + rank < limit; rank += 16u) {
            while row < rows.y && rank >= before + span.y - span.x {
                before += span.y - span.x;
                row += 1u;
                span = ellipse_row(e, row, size);
            }
            let tile = lenses[view].first_tile + row * lenses[view].tiles.x + span.x + rank - before;
            tiles[begin + rank] = select(nowhere, tile, row < rows.y);
            owners[begin + rank] = record;
        }
    }
}
