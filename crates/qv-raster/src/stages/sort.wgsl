// Twin of sort.rs: one pass of a stable sort by a digit. `histogram` counts the digits of each block of keys; after a scan of
// the counts, digit by digit, `scatter` ranks the keys of a block, puts them in order in workgroup memory and writes them out.

@group(0) @binding(0) var<storage, read> keys: array<u32>;
@group(0) @binding(1) var<storage, read_write> bins: array<u32>;
@group(0) @binding(2) var<storage, read> state: array<u32>;
@group(0) @binding(3) var<storage, read> pass_: Pass;
@group(0) @binding(4) var<storage, read> payloads: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> payloads_out: array<u32>;

struct Pass {
    shift: u32,
    bits: u32,
    // Slots of `state` with the number of keys and of blocks.
    length: u32,
    blocks: u32,
    // 1 when payloads are the indices of the keys.
    first: u32,
}

const EACH: u32 = SORT_BLOCK / 256u;

fn digit_of(key: u32) -> u32 {
    return (key >> pass_.shift) & ((1u << pass_.bits) - 1u);
}

var<workgroup> counted: array<atomic<u32>, 256>;

@compute @workgroup_size(256)
fn histogram(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = folded(group);
    let length = state[pass_.length];
    atomicStore(&counted[local], 0u);
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let at = block * SORT_BLOCK + k * 256u + local;
        if at < length {
            atomicAdd(&counted[digit_of(keys[at])], 1u);
        }
    }
    workgroupBarrier();
    let blocks = state[pass_.blocks];
    if local < (1u << pass_.bits) && block < blocks {
        bins[local * blocks + block] = atomicLoad(&counted[local]);
    }
}

// Keys, then payloads, in the order of their digits.
var<workgroup> ordered: array<u32, SORT_BLOCK>;
// Where a digit begins in `ordered`, and what to add to come to its place in the output.
var<workgroup> starts: array<u32, 256>;
var<workgroup> shifts: array<u32, 256>;
//#if SUBGROUPS
// Count of a digit in each subgroup, then in the subgroups before it.
var<workgroup> ranks: array<atomic<u32>, RANKS>;
//#else
// The invocations that hold a digit, 32 in a word.
var<workgroup> holders: array<atomic<u32>, 2048>;
// Count of a digit in the rounds before this one.
var<workgroup> ranks: array<u32, 256>;
//#endif

// Sum over the digits before this one.
fn digits_before(local: u32, value: u32) -> u32 {
    starts[local] = value;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step *= 2u) {
        var sum = starts[local];
        if local >= step {
            sum += starts[local - step];
        }
        workgroupBarrier();
        starts[local] = sum;
        workgroupBarrier();
    }
    let out = starts[local] - value;
    workgroupBarrier();
    return out;
}

@compute @workgroup_size(256)
fn scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
//#if SUBGROUPS
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) lane: u32,
//#endif
) {
    let block = folded(group);
    let length = state[pass_.length];
    let blocks = state[pass_.blocks];
    let digits = 1u << pass_.bits;
    if block >= blocks {
        return;
    }
    let first = block * SORT_BLOCK;
    let held = min(length - first, SORT_BLOCK);
    var key: array<u32, EACH>;
    var place: array<u32, EACH>;
    var from_: array<u32, EACH>;
//#if SUBGROUPS
    for (var k = local; k < RANKS; k += 256u) {
        atomicStore(&ranks[k], 0u);
    }
    workgroupBarrier();
    let below = (1u << lane) - 1u;
    for (var k = 0u; k < EACH; k++) {
        // A subgroup takes keys that follow one another.
        let at = subgroup * (SORT_BLOCK / SUBGROUP_COUNT) + k * SUBGROUP_SIZE + lane;
        from_[k] = at;
        key[k] = 0xffffffffu;
        if at < held {
            key[k] = keys[first + at];
        }
        let digit = digit_of(key[k]);
        var same = 0xffffffffu;
        for (var bit = 0u; bit < pass_.bits; bit++) {
            let on = ((digit >> bit) & 1u) == 1u;
            let votes = subgroupBallot(on).x;
            same &= select(~votes, votes, on);
        }
        same &= SUBGROUP_MASK;
        var rank = 0u;
        if (same & below) == 0u {
            rank = atomicAdd(&ranks[subgroup * digits + digit], countOneBits(same));
        }
        rank = subgroupShuffle(rank, firstTrailingBit(same));
        place[k] = rank + countOneBits(same & below);
    }
    workgroupBarrier();
    var total = 0u;
    if local < digits {
        for (var k = 0u; k < SUBGROUP_COUNT; k++) {
            let count = atomicLoad(&ranks[k * digits + local]);
            atomicStore(&ranks[k * digits + local], total);
            total += count;
        }
    }
//#else
    ranks[local] = 0u;
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let at = k * 256u + local;
        from_[k] = at;
        key[k] = 0xffffffffu;
        if at < held {
            key[k] = keys[first + at];
        }
        for (var word = local; word < 8u * digits; word += 256u) {
            atomicStore(&holders[word], 0u);
        }
        workgroupBarrier();
        let digit = digit_of(key[k]);
        atomicOr(&holders[digit * 8u + local / 32u], 1u << (local % 32u));
        workgroupBarrier();
        var rank = ranks[digit];
        for (var word = 0u; word < local / 32u; word++) {
            rank += countOneBits(atomicLoad(&holders[digit * 8u + word]));
        }
        let below = (1u << (local % 32u)) - 1u;
        place[k] = rank + countOneBits(atomicLoad(&holders[digit * 8u + local / 32u]) & below);
        workgroupBarrier();
        if local < digits {
            for (var word = 0u; word < 8u; word++) {
                ranks[local] += countOneBits(atomicLoad(&holders[local * 8u + word]));
            }
        }
        workgroupBarrier();
    }
    var total = 0u;
    if local < digits {
        total = ranks[local];
    }
//#endif
    let start = digits_before(local, total);
    starts[local] = start;
    if local < digits {
        shifts[local] = bins[local * blocks + block] - start;
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let digit = digit_of(key[k]);
        place[k] += starts[digit];
//#if SUBGROUPS
        place[k] += atomicLoad(&ranks[subgroup * digits + digit]);
//#endif
        ordered[place[k]] = key[k];
    }
    workgroupBarrier();
    var target_: array<u32, EACH>;
    for (var k = 0u; k < EACH; k++) {
        let at = k * 256u + local;
        let found = ordered[at];
        target_[k] = shifts[digit_of(found)] + at;
        if at < held {
            keys_out[target_[k]] = found;
        }
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        var payload = first + from_[k];
        if pass_.first == 0u && from_[k] < held {
            payload = payloads[first + from_[k]];
        }
        ordered[place[k]] = payload;
    }
    workgroupBarrier();
    for (var k = 0u; k < EACH; k++) {
        let at = k * 256u + local;
        if at < held {
            payloads_out[target_[k]] = ordered[at];
        }
    }
}
