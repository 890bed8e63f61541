// Sums of the workgroups of `pull`; the exposure of the photograph takes its step; `turn` moves its pose. One workgroup.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(1) var<storage, read> sums: array<f32>;
@group(0) @binding(2) var<storage, read_write> exposures: array<f32>;
// Sum of losses, steps, and the most candidates and entries that were needed.
@group(0) @binding(3) var<storage, read_write> report: array<f32>;
@group(0) @binding(4) var<storage, read> state: array<u32>;
@group(0) @binding(5) var<storage, read> by_pose: array<f32>;
// Rows of camera_from_world of all photographs.
@group(0) @binding(6) var<storage, read_write> motions: array<vec4<f32>>;
// Running means of derivatives by poses and of their squares, 12 for each photograph.
@group(0) @binding(7) var<storage, read_write> pose_moments: array<f32>;

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

@compute @workgroup_size(1)
fn turn() {
    var twist: array<f32, 6>;
    for (var k = 0u; k < 6u; k++) {
        let unit = select(1.0, step.extent, k < 3u);
        let at = 12u * step.photograph + k;
        let by = by_pose[k] * unit;
        let first = BETA1 * pose_moments[at] + (1.0 - BETA1) * by;
        let second = BETA2 * pose_moments[at + 6u] + (1.0 - BETA2) * by * by;
        pose_moments[at] = first;
        pose_moments[at + 6u] = second;
        twist[k] = -unit * step.pose_rate * (first / step.seen_bias1) / (sqrt(second / step.seen_bias2) + EPSILON);
    }
    // The rotation of a small angle, made orthogonal again below.
    let w = vec3<f32>(twist[3], twist[4], twist[5]);
    let v = vec3<f32>(twist[0], twist[1], twist[2]);
    let m = 3u * step.photograph;
    var columns: array<vec3<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        let c = vec3<f32>(motions[m][k], motions[m + 1u][k], motions[m + 2u][k]);
        let once = cross(w, c);
        columns[k] = c + once + 0.5 * cross(w, once);
    }
    let x = normalize(columns[0]);
    let y = normalize(columns[1] - x * dot(x, columns[1]));
    let z = cross(x, y);
    let t = columns[3] + v;
    motions[m] = vec4<f32>(x.x, y.x, z.x, t.x);
    motions[m + 1u] = vec4<f32>(x.y, y.y, z.y, t.y);
    motions[m + 2u] = vec4<f32>(x.z, y.z, z.z, t.z);
}
