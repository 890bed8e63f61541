// Sums of the workgroups of `pull`; the exposure of the photograph takes its step. One workgroup.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(1) var<storage, read> sums: array<f32>;
@group(0) @binding(2) var<storage, read_write> exposures: array<f32>;
// Sum of losses, steps, and the most candidates and entries that were needed.
@group(0) @binding(3) var<storage, read_write> report: array<f32>;
@group(0) @binding(4) var<storage, read> state: array<u32>;

// Slots of `state` as the rasteriser has them.
const NEEDED_VISIBLE: u32 = 2u;
const NEEDED_ENTRIES: u32 = 3u;

var<workgroup> parts: array<f32, 256>;
var<workgroup> shifts: array<f32, 12>;

@compute @workgroup_size(256)
fn finish(@builtin(local_invocation_index) local: u32) {
    let value = local % 16u;
    var sum = 0.0;
    for (var k = local / 16u; k < step.groups; k += 16u) {
        sum += sums[16u * k + value];
    }
    parts[local] = sum;
    workgroupBarrier();
    if local < 16u {
        sum = 0.0;
        for (var k = 0u; k < 16u; k++) {
            sum += parts[16u * k + local];
        }
        parts[local] = sum;
    }
    workgroupBarrier();
    if local == 0u {
        report[0] += step.pixel * ((1.0 - step.ssim) * parts[12] + step.ssim * parts[13]);
        report[1] += 1.0;
        report[2] = max(report[2], f32(state[NEEDED_VISIBLE]));
        report[3] = max(report[3], f32(state[NEEDED_ENTRIES]));
    }
    if local < 12u && step.exposes != 0u {
        let at = 36u * step.photograph + local;
        let neutral = select(0.0, 1.0, local % 5u == 0u);
        let by = parts[local] + 2.0 * step.exposure_weight * (exposures[at] - neutral);
        let first = BETA1 * exposures[at + 12u] + (1.0 - BETA1) * by;
        let second = BETA2 * exposures[at + 24u] + (1.0 - BETA2) * by * by;
        exposures[at + 12u] = first;
        exposures[at + 24u] = second;
        let shift = -step.exposure_rate * (first / step.seen_bias1) / (sqrt(second / step.seen_bias2) + EPSILON);
        exposures[at] += shift;
        shifts[local] = shift / f32(step.photographs);
    }
    storageBarrier();
    workgroupBarrier();
    // The mean of all exposures stays what it was.
    for (var k = local; k < 12u * step.photographs && step.exposes != 0u; k += 256u) {
        exposures[36u * (k / 12u) + k % 12u] -= shifts[k % 12u];
    }
}
