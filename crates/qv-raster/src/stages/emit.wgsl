// Twin of emit.rs: one entry point counts and emits, so that both come from the same instructions; compilers may round the same text
// differently in two places. Without `write` it counts the entries of each record; `gather` puts the counts in the order of depth; after a
// scan, with `write`, it makes the entries. An invocation makes those of one Gaussian, several those of a large one.

@group(0) @binding(0) var<storage, read> lenses: array<Lens>;
@group(0) @binding(1) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> candidates: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(5) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(6) var<storage, read_write> owners: array<u32>;
@group(0) @binding(7) var<storage, read> state: array<u32>;
// In: 0 where nothing is drawn. Out: the number of entries.
@group(0) @binding(8) var<storage, read_write> counts: array<u32>;
@group(0) @binding(9) var<storage, read> pass_: Pass;
//#if KEEP
@group(0) @binding(10) var<storage, read_write> firsts: array<u32>;
//#endif

@compute @workgroup_size(256)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    if index < state[VISIBLE] {
        offsets[index] = counts[order[index]];
    }
}

struct Pass {
    write: u32,
}

// Gaussians with more entries than this are left to several invocations.
const MANY: u32 = 16u;
const SEVERAL: u32 = 16u;

var<workgroup> large_count: atomic<u32>;
var<workgroup> large_held: u32;
// Places in the order of the large ones, as they come: where their entries stand is fixed.
var<workgroup> large: array<u32, 256>;

@compute @workgroup_size(256)
fn emit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&large_count, 0u);
    }
    workgroupBarrier();
    let visible = state[VISIBLE];
    let limit = state[ENTRIES];
    let write = pass_.write == 1u;
    // First each its own, then all of them the large ones.
    var turns = 1u;
    var larges = 0u;
    for (var turn = 0u; turn < turns; turn++) {
        var index = folded(group) * 256u + local;
        var lane = 0u;
        var stride = 1u;
        var wanted = index < visible;
        if turn > 0u {
            let k = (turn - 1u) * (256u / SEVERAL) + local / SEVERAL;
            wanted = k < larges;
            if wanted {
                index = large[k];
            }
            lane = local % SEVERAL;
            stride = SEVERAL;
        }
        if wanted {
            var record = index;
            var begin = 0u;
            if write {
                record = order[index];
                begin = offsets[index];
                if turn == 0u {
//#if KEEP
                    firsts[record] = begin;
//#endif
                    var end = state[NEEDED_ENTRIES];
                    if index + 1u < visible {
                        end = offsets[index + 1u];
                    }
                    if end - begin > MANY {
                        large[atomicAdd(&large_count, 1u)] = index;
                        wanted = false;
                    }
                    wanted = wanted && end > begin;
                }
            } else {
                wanted = counts[record] > 0u;
            }
            var count = 0u;
            if wanted {
                let a = records[2u * record];
                let b = records[2u * record + 1u];
                let view = candidates[record].x;
                let size = lenses[view].size;
                let e = ellipse_of(a.xy, a.z, a.w, b.x, opacity_of(b));
                let rows = ellipse_rows(e, size);
                // The next entry that this invocation makes.
                var rank = select(0xffffffffu, lane, write);
                for (var row = rows.x; row < rows.y; row++) {
                    let span = ellipse_row(e, row, size);
                    let end = count + span.y - span.x;
                    while rank < end {
                        if begin + rank < limit {
                            let column = span.x + rank - count;
                            tiles[begin + rank] = lenses[view].first_tile + row * lenses[view].tiles.x + column;
                            owners[begin + rank] = record;
                        }
                        rank += stride;
                    }
                    count = end;
                }
            }
            if !write {
                counts[record] = count;
            }
        }
        if turn == 0u {
            workgroupBarrier();
            if local == 0u {
                large_held = atomicLoad(&large_count);
            }
            larges = workgroupUniformLoad(&large_held);
            turns = 1u + (larges * SEVERAL + 255u) / 256u;
        }
    }
}
