// Twin of emit.rs. `count` lays the counts out in the order of depth; after a scan, `emit` writes the entries: a workgroup takes 256
// Gaussians and shares out their entries, since one may have many and its neighbours few.

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

@compute @workgroup_size(256)
fn count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    if index < state[VISIBLE] {
        offsets[index] = counts[order[index]];
    }
}

// Ellipses of the workgroup's Gaussians, their views and first rows, where their entries begin, and their records.
var<workgroup> shapes: array<Ellipse, 256>;
var<workgroup> places: array<vec2<u32>, 256>;
var<workgroup> begins: array<u32, 256>;
var<workgroup> own: array<u32, 256>;
var<workgroup> last_end: u32;

@compute @workgroup_size(256)
fn emit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    let visible = state[VISIBLE];
    let held = min(visible - min(visible, folded(group) * 256u), 256u);
    begins[local] = 0xffffffffu;
    if local < held {
        let record = order[index];
        let begin = offsets[index];
//#if KEEP
        firsts[record] = begin;
//#endif
        begins[local] = begin;
        own[local] = record;
        if local + 1u == held {
            last_end = min(begin + counts[record], state[ENTRIES]);
        }
        if counts[record] > 0u {
            let a = records[2u * record];
            let b = records[2u * record + 1u];
            let view = candidates[record].x;
            let e = ellipse_of(a.xy, a.z, a.w, b.x, opacity_of(b));
            shapes[local] = e;
            places[local] = vec2<u32>(view, ellipse_rows(e, lenses[view].size).x);
        }
    }
    workgroupBarrier();
    if held == 0u {
        return;
    }
    for (var at = begins[0] + local; at < last_end; at += 256u) {
        // The last Gaussian that begins here or before: those without entries begin where the next one does.
        var k = 0u;
        for (var step = 128u; step > 0u; step /= 2u) {
            if begins[k + step] <= at {
                k += step;
            }
        }
        let e = shapes[k];
        let view = places[k].x;
        let size = lenses[view].size;
        var row = places[k].y;
        var rest = at - begins[k];
        var span = ellipse_row(e, row, size);
        while rest >= span.y - span.x {
            rest -= span.y - span.x;
            row += 1u;
            span = ellipse_row(e, row, size);
        }
        tiles[at] = lenses[view].first_tile + row * lenses[view].tiles.x + span.x + rest;
        owners[at] = own[k];
    }
}
