// Twin of emit.rs. `count` lays the counts out in the order of depth; after a scan, `emit` writes the entries.

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

@compute @workgroup_size(256)
fn count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    if index < state[VISIBLE] {
        offsets[index] = counts[order[index]];
    }
}

@compute @workgroup_size(256)
fn emit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    if index >= state[VISIBLE] {
        return;
    }
    let record = order[index];
    var at = offsets[index];
//#if KEEP
    firsts[record] = at;
//#endif
    if counts[record] == 0u {
        return;
    }
    let a = records[3u * record];
    let b = records[3u * record + 1u];
    let view = bitcast<u32>(b.w);
    let size = lenses[view].size;
    let first_tile = lenses[view].first_tile;
    let across = lenses[view].tiles.x;
    let e = ellipse_of(a.xy, a.z, a.w, b.x, b.y);
    let rows = ellipse_rows(e, size);
    let end = min(offsets[index] + counts[record], state[ENTRIES]);
    for (var row = rows.x; row < rows.y; row++) {
        let span = ellipse_row(e, row, size);
        for (var column = span.x; column < span.y; column++) {
            if at < end {
                tiles[at] = first_tile + row * across + column;
                owners[at] = record;
            }
            at += 1u;
        }
    }
}
