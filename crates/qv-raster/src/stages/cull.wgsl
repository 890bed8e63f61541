// Twin of cull.rs. `mark` tests 256 Gaussians against VIEWS views and counts what may be seen; after a scan of the counts,
// `gather` writes the candidates by view, then by Gaussian.

const VIEWS: u32 = 16u;

@group(0) @binding(0) var<storage, read> lenses: array<Lens>;
@group(0) @binding(1) var<storage, read> motions: array<Motion>;
@group(0) @binding(2) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> scales: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> marks: array<u32>;
@group(0) @binding(5) var<storage, read_write> block_counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> candidates: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read> frame: Frame;

struct Frame {
    views: u32,
    splats: u32,
    groups: u32,
    blocks: u32,
    capacity: u32,
}

var<workgroup> words: array<atomic<u32>, 128>;

fn may_be_seen(view: u32, mean: vec4<f32>, largest: f32, square: f32) -> bool {
    let m = motions[view * frame.groups + bitcast<u32>(mean.w)];
    let point = vec4<f32>(mean.xyz, 1.0);
    let p = vec3<f32>(dot(m.x, point), dot(m.y, point), dot(m.z, point));
    if p.z <= NEAR {
        return false;
    }
    let lens = lenses[view];
    let ratio = p.xy / p.z;
    let slope = clamp(ratio, lens.lowest, lens.highest);
    let stretch = lens.focal / p.z * largest;
    let reach = sqrt(square * (stretch * stretch * (1.0 + slope * slope) + LOW_PASS));
    let at = lens.focal * ratio + lens.centre;
    let sum = at.x + at.y + reach.x + reach.y;
    return !finite(sum) || (all(at + reach >= vec2<f32>(0.0)) && all(at - reach <= vec2<f32>(lens.size)));
}

@compute @workgroup_size(256)
fn mark(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local < 128u {
        atomicStore(&words[local], 0u);
    }
    workgroupBarrier();
    let splat = group.x * 256u + local;
    let first = group.y * VIEWS;
    if splat < frame.splats {
        let mean = means[splat];
        let scale = scales[splat];
        let opacity = logistic(scale.w);
        let nowhere = !finite(mean.x + mean.y + mean.z);
        if nowhere || !finite(scale.w) || opacity >= MIN_ALPHA {
            let largest = exp(max(max(scale.x, scale.y), scale.z));
            let square = (2.0 * log(opacity / MIN_ALPHA) + 0.01) * 1.01;
            for (var k = 0u; k < VIEWS && first + k < frame.views; k++) {
                if nowhere || may_be_seen(first + k, mean, largest, square) {
                    atomicOr(&words[k * 8u + local / 32u], 1u << (local % 32u));
                }
            }
        }
    }
    workgroupBarrier();
    if local < 128u && first + local / 8u < frame.views {
        marks[((first + local / 8u) * frame.blocks + group.x) * 8u + local % 8u] = atomicLoad(&words[local]);
    }
    if local < VIEWS && first + local < frame.views {
        var count = 0u;
        for (var k = 0u; k < 8u; k++) {
            count += countOneBits(atomicLoad(&words[local * 8u + k]));
        }
        block_counts[(first + local) * frame.blocks + group.x] = count;
    }
}

@compute @workgroup_size(256)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = group.y * VIEWS;
    for (var view = first; view < min(first + VIEWS, frame.views); view++) {
        let block = view * frame.blocks + group.x;
        let word = marks[block * 8u + local / 32u];
        let bit = 1u << (local % 32u);
        if (word & bit) != 0u {
            var place = block_counts[block] + countOneBits(word & (bit - 1u));
            for (var k = 0u; k < local / 32u; k++) {
                place += countOneBits(marks[block * 8u + k]);
            }
            if place < frame.capacity {
                candidates[place] = vec2<u32>(view, group.x * 256u + local);
            }
        }
    }
}
