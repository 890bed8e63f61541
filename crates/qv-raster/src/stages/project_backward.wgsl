// Twin of project_backward.rs: an invocation for each Gaussian goes through the views in order and adds up what comes to it; the poses'
// share is summed over a workgroup for each view, then over the workgroups by `poses`. No atomics.

@group(0) @binding(0) var<storage, read> lenses: array<Lens>;
@group(0) @binding(1) var<storage, read> motions: array<Motion>;
@group(0) @binding(2) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> scales: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> rotations: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> sh: array<f32>;
@group(0) @binding(6) var<storage, read> marks: array<u32>;
@group(0) @binding(7) var<storage, read> block_counts: array<u32>;
@group(0) @binding(8) var<storage, read> counts: array<u32>;
@group(0) @binding(9) var<storage, read> firsts: array<u32>;
@group(0) @binding(10) var<storage, read> record_gradients: array<f32>;
@group(0) @binding(11) var<storage, read> frame: Frame;
// Mean and opacity logit; log scales; quaternion: three vectors for each Gaussian.
@group(0) @binding(12) var<storage, read_write> by_shape: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> by_sh: array<f32>;
// Shape [views, workgroups, 6].
@group(0) @binding(14) var<storage, read_write> by_pose_parts: array<f32>;
//#if FEATURES
@group(0) @binding(15) var<storage, read_write> by_feature: array<f32>;
//#endif
@group(0) @binding(16) var<storage, read_write> by_pose: array<f32>;
@group(0) @binding(17) var<storage, read> entry_gradients: array<f32>;
@group(0) @binding(18) var<storage, read_write> summed: array<f32>;
@group(0) @binding(19) var<storage, read> state: array<u32>;

struct Frame {
    views: u32,
    splats: u32,
    groups: u32,
    blocks: u32,
    capacity: u32,
}

struct Share {
    mean: vec3<f32>,
    log_scales: vec3<f32>,
    rotation: vec4<f32>,
    logit: f32,
    shift: vec3<f32>,
    turn: vec3<f32>,
}

var<workgroup> parts: array<vec3<f32>, 512>;

fn outer_columns(m: mat3x3<f32>, n: mat3x3<f32>) -> vec3<f32> {
    return cross(m[0], n[0]) + cross(m[1], n[1]) + cross(m[2], n[2]);
}

// From the derivative by the rotation matrix to that by the quaternion w, x, y, z before it is normalised.
fn quaternion_backward(wxyz: vec4<f32>, length: f32, d: mat3x3<f32>) -> vec4<f32> {
    let q = wxyz / length;
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    // d[column][row]
    let by = 2.0 * vec4<f32>(
        x * (d[1][2] - d[2][1]) + y * (d[2][0] - d[0][2]) + z * (d[0][1] - d[1][0]),
        y * (d[1][0] + d[0][1]) + z * (d[2][0] + d[0][2]) + w * (d[1][2] - d[2][1]) - 2.0 * x * (d[1][1] + d[2][2]),
        x * (d[1][0] + d[0][1]) + z * (d[2][1] + d[1][2]) + w * (d[2][0] - d[0][2]) - 2.0 * y * (d[0][0] + d[2][2]),
        x * (d[2][0] + d[0][2]) + y * (d[2][1] + d[1][2]) + w * (d[0][1] - d[1][0]) - 2.0 * z * (d[0][0] + d[1][1]),
    );
    return (by - q * dot(q, by)) / length;
}

// Adds value times colour to a coefficient, and gives what comes to the direction.
fn add_coefficient(splat: u32, k: u32, value: f32, gradient: vec3<f32>, by_colour: vec3<f32>) -> vec3<f32> {
    let at = 3u * (splat * SH_COUNT + k);
    by_sh[at] += value * by_colour.x;
    by_sh[at + 1u] += value * by_colour.y;
    by_sh[at + 2u] += value * by_colour.z;
    return gradient * dot(by_colour, coefficient(splat, k));
}

fn harmonics_backward(i: u32, d: vec3<f32>, by: vec3<f32>) -> vec3<f32> {
    var sum = add_coefficient(i, 0u, C0, vec3<f32>(0.0), by);
    if SH_COUNT < 4u {
        return sum;
    }
    sum += add_coefficient(i, 1u, -C1 * d.y, vec3<f32>(0.0, -C1, 0.0), by);
    sum += add_coefficient(i, 2u, C1 * d.z, vec3<f32>(0.0, 0.0, C1), by);
    sum += add_coefficient(i, 3u, -C1 * d.x, vec3<f32>(-C1, 0.0, 0.0), by);
    if SH_COUNT < 9u {
        return sum;
    }
    let s = d * d;
    sum += add_coefficient(i, 4u, C2.x * d.x * d.y, C2.x * vec3<f32>(d.y, d.x, 0.0), by);
    sum += add_coefficient(i, 5u, -C2.x * d.y * d.z, -C2.x * vec3<f32>(0.0, d.z, d.y), by);
    let g6 = C2.y * vec3<f32>(-2.0 * d.x, -2.0 * d.y, 4.0 * d.z);
    sum += add_coefficient(i, 6u, C2.y * (2.0 * s.z - s.x - s.y), g6, by);
    sum += add_coefficient(i, 7u, -C2.x * d.x * d.z, -C2.x * vec3<f32>(d.z, 0.0, d.x), by);
    sum += add_coefficient(i, 8u, C2.z * (s.x - s.y), C2.z * vec3<f32>(2.0 * d.x, -2.0 * d.y, 0.0), by);
    if SH_COUNT < 16u {
        return sum;
    }
    let g9 = -C3[0] * vec3<f32>(6.0 * d.x * d.y, 3.0 * s.x - 3.0 * s.y, 0.0);
    sum += add_coefficient(i, 9u, -C3[0] * d.y * (3.0 * s.x - s.y), g9, by);
    sum += add_coefficient(i, 10u, C3[1] * d.x * d.y * d.z, C3[1] * vec3<f32>(d.y * d.z, d.x * d.z, d.x * d.y), by);
    let g11 = -C3[2] * vec3<f32>(-2.0 * d.x * d.y, 4.0 * s.z - s.x - 3.0 * s.y, 8.0 * d.y * d.z);
    sum += add_coefficient(i, 11u, -C3[2] * d.y * (4.0 * s.z - s.x - s.y), g11, by);
    let g12 = C3[3] * vec3<f32>(-6.0 * d.x * d.z, -6.0 * d.y * d.z, 6.0 * s.z - 3.0 * s.x - 3.0 * s.y);
    sum += add_coefficient(i, 12u, C3[3] * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y), g12, by);
    let g13 = -C3[2] * vec3<f32>(4.0 * s.z - 3.0 * s.x - s.y, -2.0 * d.x * d.y, 8.0 * d.x * d.z);
    sum += add_coefficient(i, 13u, -C3[2] * d.x * (4.0 * s.z - s.x - s.y), g13, by);
    let g14 = C3[4] * vec3<f32>(2.0 * d.x * d.z, -2.0 * d.y * d.z, s.x - s.y);
    sum += add_coefficient(i, 14u, C3[4] * d.z * (s.x - s.y), g14, by);
    let g15 = -C3[0] * vec3<f32>(3.0 * s.x - 3.0 * s.y, -6.0 * d.x * d.y, 0.0);
    sum += add_coefficient(i, 15u, -C3[0] * d.x * (s.x - 3.0 * s.y), g15, by);
    return sum;
}

fn record_backward(view: u32, splat: u32, record: u32) -> Share {
    let lens = lenses[view];
    let mean = means[splat];
    let quaternion = rotations[splat];
    let s = shape_of(lens, motions[view * frame.groups + bitcast<u32>(mean.w)], mean.xyz, scales[splat].xyz, quaternion);
    var sum: array<f32, WIDTH>;
    for (var k = 0u; k < WIDTH; k++) {
        sum[k] = record_gradients[record * WIDTH + k];
    }
    let p = s.centre;
    let f = lens.focal / p.z;

    // Through the projected mean.
    var centre = vec3<f32>(f * vec2<f32>(sum[0], sum[1]), 0.0);
    centre.z = -(centre.x * p.x + centre.y * p.y) / p.z;

    // Through the covariance, see project_backward.rs.
    let factor = factor_of(s);
    let v_x = factor.x * s.row_x + factor.y * s.row_y;
    let v_y = factor.z * s.row_y;
    let by_v_x = -2.0 * sum[2] * v_x - sum[3] * v_y;
    let by_v_y = -sum[3] * v_x - 2.0 * sum[4] * v_y;
    var by_log_scales = v_x * by_v_x + v_y * by_v_y;
    var by_row_x = factor.x * by_v_x;
    var by_row_y = factor.y * by_v_x + factor.z * by_v_y;
    let opacity = logistic(scales[splat].w);
    var by_opacity = sum[5];
//#if ANTIALIAS
    // As `by_rows_of_kept`.
    let by_kept = sum[5] * opacity;
    by_opacity *= s.kept;
    let long = length(s.area);
    let unit = select(s.area / long, vec3<f32>(0.0), long == 0.0);
    let root = sqrt(s.determinant);
    let share = s.kept / s.determinant;
    let kept_x = by_kept * (cross(s.row_y, unit) / root - share * (cross(s.row_y, s.area) + LOW_PASS * s.row_x));
    let kept_y = by_kept * (cross(unit, s.row_x) / root - share * (cross(s.area, s.row_x) + LOW_PASS * s.row_y));
    by_row_x += kept_x;
    by_row_y += kept_y;
    by_log_scales += kept_x * s.row_x + kept_y * s.row_y;
//#endif
    let by_spread = transpose(mat3x3<f32>(
        f.x * by_row_x, f.y * by_row_y, -f.x * s.slope.x * by_row_x - f.y * s.slope.y * by_row_y,
    ));
    centre.z -= (by_log_scales.x + by_log_scales.y + by_log_scales.z) / p.z;
    let along = transpose(s.spread)[2];
    let by_slope = -f * vec2<f32>(dot(along, by_row_x), dot(along, by_row_y));
    let ratio = p.xy / p.z;
    if ratio.x == s.slope.x {
        centre.x += by_slope.x / p.z;
        centre.z -= by_slope.x * ratio.x / p.z;
    }
    if ratio.y == s.slope.y {
        centre.y += by_slope.y / p.z;
        centre.z -= by_slope.y * ratio.y / p.z;
    }
//#if DEPTH
    centre.z += sum[6u + DEPTH_AT];
//#endif
    var out: Share;
    var by_axes = mat3x3<f32>();
//#if PLANE
    let normal = normal_of(s);
    let by_distance = sum[6u + PLANE_AT + 3u];
    centre -= normal.xyz * by_distance;
    let by_normal = vec3<f32>(sum[6u + PLANE_AT], sum[6u + PLANE_AT + 1u], sum[6u + PLANE_AT + 2u]) - p * by_distance;
    out.turn = cross(normal.xyz, by_normal);
    let by_axis = transpose(s.rotation) * (by_normal * normal.w);
    if s.shortest == 0u {
        by_axes[0] = by_axis;
    } else if s.shortest == 1u {
        by_axes[1] = by_axis;
    } else {
        by_axes[2] = by_axis;
    }
//#endif
    out.turn += cross(p, centre) + outer_columns(s.spread, by_spread);
    let in_group = transpose(s.rotation) * by_spread;
    out.log_scales = by_log_scales;
    by_axes += mat3x3<f32>(s.scales.x * in_group[0], s.scales.y * in_group[1], s.scales.z * in_group[2]);
    out.rotation = quaternion_backward(quaternion, s.length, by_axes);
    out.logit = by_opacity * opacity * (1.0 - opacity);

    let distance = length(p);
    let direction = transpose(s.rotation) * (p / distance);
    let before = colour_of(splat, direction);
    let by_colour = select(vec3<f32>(0.0), vec3<f32>(sum[6], sum[7], sum[8]), before > vec3<f32>(0.0));
    let by_direction = harmonics_backward(splat, direction, by_colour);
    let by_offset = (by_direction - direction * dot(direction, by_direction)) / distance;
//#if FEATURES
    for (var k = 0u; k < FEATURE_COUNT; k++) {
        by_feature[splat * FEATURE_COUNT + k] += sum[6u + FEATURES_AT + k];
    }
//#endif
    out.mean = transpose(s.rotation) * centre + by_offset;
    out.shift = centre + s.rotation * by_offset;
    return out;
}

// A record with more entries than this is summed by the whole workgroup.
const MANY: u32 = 32u;

var<workgroup> held: array<u32, 32>;
var<workgroup> partial: array<f32, 256>;

// Sums the entries of records, 32 of them to a workgroup, in an order that depends on nothing but their number.
@compute @workgroup_size(256)
fn sum_entries(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first_record = folded(group) * 32u;
    let visible = state[VISIBLE];
    let lane = local % 8u;
    let slot = local / 8u;
    if local < 32u {
        held[local] = 0u;
        if first_record + local < visible {
            held[local] = counts[first_record + local];
        }
    }
    workgroupBarrier();
    if first_record + slot < visible && held[slot] <= MANY {
        let first = firsts[first_record + slot];
        for (var k = lane; k < WIDTH; k += 8u) {
            var sum = 0.0;
            for (var entry = 0u; entry < held[slot]; entry++) {
                sum += entry_gradients[(first + entry) * WIDTH + k];
            }
            summed[(first_record + slot) * WIDTH + k] = sum;
        }
    }
    for (var r = 0u; r < 32u; r++) {
        if workgroupUniformLoad(&held[r]) <= MANY {
            continue;
        }
        let first = firsts[first_record + r];
        for (var eight = 0u; eight < WIDTH; eight += 8u) {
            var sum = 0.0;
            if eight + lane < WIDTH {
                for (var entry = slot; entry < held[r]; entry += 32u) {
                    sum += entry_gradients[(first + entry) * WIDTH + eight + lane];
                }
            }
            partial[local] = sum;
            workgroupBarrier();
            for (var half = 128u; half >= 8u; half /= 2u) {
                if local < half {
                    partial[local] += partial[local + half];
                }
                workgroupBarrier();
            }
            if local < 8u && eight + lane < WIDTH {
                summed[(first_record + r) * WIDTH + eight + lane] = partial[local];
            }
            workgroupBarrier();
        }
    }
}

@compute @workgroup_size(256)
fn project_backward(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let splat = group.x * 256u + local;
    var all: Share;
    for (var view = 0u; view < frame.views; view++) {
        let block = view * frame.blocks + group.x;
        let word = marks[block * 8u + local / 32u];
        let bit = 1u << (local % 32u);
        parts[local] = vec3<f32>(0.0);
        parts[256u + local] = vec3<f32>(0.0);
        if (word & bit) != 0u {
            var record = block_counts[block] + countOneBits(word & (bit - 1u));
            for (var k = 0u; k < local / 32u; k++) {
                record += countOneBits(marks[block * 8u + k]);
            }
            if record < frame.capacity && counts[record] > 0u {
                let share = record_backward(view, splat, record);
                all.mean += share.mean;
                all.log_scales += share.log_scales;
                all.rotation += share.rotation;
                all.logit += share.logit;
                parts[local] = share.shift;
                parts[256u + local] = share.turn;
            }
        }
        workgroupBarrier();
        for (var half = 128u; half > 0u; half /= 2u) {
            if local < half {
                parts[local] += parts[local + half];
                parts[256u + local] += parts[256u + local + half];
            }
            workgroupBarrier();
        }
        if local < 6u {
            by_pose_parts[block * 6u + local] = parts[256u * (local / 3u)][local % 3u];
        }
        workgroupBarrier();
    }
    if splat < frame.splats {
        by_shape[3u * splat] = vec4<f32>(all.mean, all.logit);
        by_shape[3u * splat + 1u] = vec4<f32>(all.log_scales, 0.0);
        by_shape[3u * splat + 2u] = all.rotation;
    }
}

// A workgroup for each view.
@compute @workgroup_size(256)
fn poses(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    var shift = vec3<f32>(0.0);
    var turn = vec3<f32>(0.0);
    for (var block = local; block < frame.blocks; block += 256u) {
        let at = (group.x * frame.blocks + block) * 6u;
        shift += vec3<f32>(by_pose_parts[at], by_pose_parts[at + 1u], by_pose_parts[at + 2u]);
        turn += vec3<f32>(by_pose_parts[at + 3u], by_pose_parts[at + 4u], by_pose_parts[at + 5u]);
    }
    parts[local] = shift;
    parts[256u + local] = turn;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if local < half {
            parts[local] += parts[local + half];
            parts[256u + local] += parts[256u + local + half];
        }
        workgroupBarrier();
    }
    if local < 6u {
        by_pose[group.x * 6u + local] = parts[256u * (local / 3u)][local % 3u];
    }
}
