// Exclusive sums, in place: `reduce` sums blocks of 2048, `spine` scans those sums in one workgroup, `apply` scans each block. Sums
// saturate, so that a total beyond 32 bits is seen as one.

@group(0) @binding(0) var<storage, read_write> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> sums: array<u32>;
@group(0) @binding(2) var<storage, read_write> state: array<u32>;
@group(0) @binding(3) var<storage, read> pass_: Pass;

struct Pass {
    // Slot of `state` with the number of values, and the slot for their total.
    length: u32,
    total: u32,
}

const EACH: u32 = 8u;
const BLOCK: u32 = 2048u;

var<workgroup> shared_: array<u32, 256>;

fn plus(a: u32, b: u32) -> u32 {
    return select(a + b, 0xffffffffu, a + b < a);
}

// Sum of the invocations before this one; the total is in shared_[255].
fn before(local: u32, value: u32) -> u32 {
    shared_[local] = value;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step *= 2u) {
        var sum = shared_[local];
        if local >= step {
            sum = plus(sum, shared_[local - step]);
        }
        workgroupBarrier();
        shared_[local] = sum;
        workgroupBarrier();
    }
    if local == 0u {
        return 0u;
    }
    return shared_[local - 1u];
}

@compute @workgroup_size(256)
fn reduce(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = folded(group);
    let length = state[pass_.length];
    var sum = 0u;
    for (var k = 0u; k < EACH; k++) {
        let at = block * BLOCK + k * 256u + local;
        if at < length {
            sum = plus(sum, values[at]);
        }
    }
    _ = before(local, sum);
    if local == 0u && block * BLOCK < length {
        sums[block] = shared_[255];
    }
}

@compute @workgroup_size(256)
fn spine(@builtin(local_invocation_index) local: u32) {
    let blocks = (state[pass_.length] + BLOCK - 1u) / BLOCK;
    var total = 0u;
    for (var start = 0u; start < blocks; start += BLOCK) {
        let first = start + local * EACH;
        var part: array<u32, 8>;
        var sum = 0u;
        for (var k = 0u; k < EACH; k++) {
            part[k] = sum;
            if first + k < blocks {
                sum = plus(sum, sums[first + k]);
            }
        }
        let offset = plus(total, before(local, sum));
        for (var k = 0u; k < EACH; k++) {
            if first + k < blocks {
                sums[first + k] = plus(offset, part[k]);
            }
        }
        total = plus(total, shared_[255]);
        workgroupBarrier();
    }
    if local == 0u {
        state[pass_.total] = total;
    }
}

@compute @workgroup_size(256)
fn apply(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = folded(group);
    let length = state[pass_.length];
    let first = block * BLOCK + local * EACH;
    var part: array<u32, 8>;
    var sum = 0u;
    for (var k = 0u; k < EACH; k++) {
        part[k] = sum;
        if first + k < length {
            sum = plus(sum, values[first + k]);
        }
    }
    var offset = before(local, sum);
    if block * BLOCK < length {
        offset = plus(offset, sums[block]);
    }
    for (var k = 0u; k < EACH; k++) {
        if first + k < length {
            values[first + k] = plus(offset, part[k]);
        }
    }
}
