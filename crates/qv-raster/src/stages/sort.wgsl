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
    let first = block * SORT_BLOCK + local;
//#repeat KEYS
    if first + $Ku * 256u < length {
        atomicAdd(&counted[digit_of(keys[first + $Ku * 256u])], 1u);
    }
//#end
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

// Lanes whose bit is as this lane's.
fn agree(digit: u32, bit: u32) -> u32 {
    let on = ((digit >> bit) & 1u) == 1u;
    let votes = subgroupBallot(on).x;
    return select(~votes, votes, on);
}

// Lanes that hold the same digit.
fn holders_of(digit: u32) -> u32 {
    var same = SUBGROUP_MASK & agree(digit, 0u);
    if DIGIT_BITS > 1u {
        same &= agree(digit, 1u);
    }
    if DIGIT_BITS > 2u {
        same &= agree(digit, 2u);
    }
    if DIGIT_BITS > 3u {
        same &= agree(digit, 3u);
    }
    if DIGIT_BITS > 4u {
        same &= agree(digit, 4u);
    }
    if DIGIT_BITS > 5u {
        same &= agree(digit, 5u);
    }
    if DIGIT_BITS > 6u {
        same &= agree(digit, 6u);
    }
    if DIGIT_BITS > 7u {
        same &= agree(digit, 7u);
    }
    return same;
}
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
//#if SUBGROUPS
    // A subgroup takes keys that follow one another.
    let mine = subgroup * (SORT_BLOCK / SUBGROUP_COUNT) + lane;
    let stride = SUBGROUP_SIZE;
    for (var k = local; k < RANKS; k += 256u) {
        atomicStore(&ranks[k], 0u);
    }
//#else
    let mine = local;
    let stride = 256u;
    ranks[local] = 0u;
//#endif
    // All that is read is asked for before any of it is used.
//#repeat KEYS
    var key_$K = 0xffffffffu;
    if mine + $Ku * stride < held {
        key_$K = keys[first + mine + $Ku * stride];
    }
//#end
//#repeat KEYS
    var payload_$K = first + mine + $Ku * stride;
    if pass_.first == 0u && mine + $Ku * stride < held {
        payload_$K = payloads[first + mine + $Ku * stride];
    }
//#end
    workgroupBarrier();
//#if SUBGROUPS
    let below = (1u << lane) - 1u;
    let own = subgroup * digits;
//#repeat KEYS
    let same_$K = holders_of(digit_of(key_$K));
    var rank_$K = 0u;
    if (same_$K & below) == 0u {
        rank_$K = atomicAdd(&ranks[own + digit_of(key_$K)], countOneBits(same_$K));
    }
    var place_$K = subgroupShuffle(rank_$K, firstTrailingBit(same_$K)) + countOneBits(same_$K & below);
//#end
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
    let below = (1u << (local % 32u)) - 1u;
//#repeat KEYS
    for (var word = local; word < 8u * digits; word += 256u) {
        atomicStore(&holders[word], 0u);
    }
    workgroupBarrier();
    let digit_$K = digit_of(key_$K);
    atomicOr(&holders[digit_$K * 8u + local / 32u], 1u << (local % 32u));
    workgroupBarrier();
    var place_$K = ranks[digit_$K] + countOneBits(atomicLoad(&holders[digit_$K * 8u + local / 32u]) & below);
    for (var word = 0u; word < local / 32u; word++) {
        place_$K += countOneBits(atomicLoad(&holders[digit_$K * 8u + word]));
    }
    workgroupBarrier();
    if local < digits {
        for (var word = 0u; word < 8u; word++) {
            ranks[local] += countOneBits(atomicLoad(&holders[local * 8u + word]));
        }
    }
    workgroupBarrier();
//#end
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
//#repeat KEYS
    place_$K += starts[digit_of(key_$K)];
//#if SUBGROUPS
    place_$K += atomicLoad(&ranks[own + digit_of(key_$K)]);
//#endif
    ordered[place_$K] = key_$K;
//#end
    workgroupBarrier();
//#repeat KEYS
    let found_$K = ordered[$Ku * 256u + local];
    let target_$K = shifts[digit_of(found_$K)] + $Ku * 256u + local;
    if $Ku * 256u + local < held {
        keys_out[target_$K] = found_$K;
    }
//#end
    workgroupBarrier();
//#repeat KEYS
    ordered[place_$K] = payload_$K;
//#end
    workgroupBarrier();
//#repeat KEYS
    if $Ku * 256u + local < held {
        payloads_out[target_$K] = ordered[$Ku * 256u + local];
    }
//#end
}
