// Twin of adam.rs: `shape` moves means, opacities, scales and rotations, an invocation for each Gaussian, with regularisers and noise;
// `harmonics` moves four coefficients' numbers in each invocation and clears their derivatives for the next step.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(1) var<storage, read_write> means: array<vec4<f32>>;
// Log scales and opacity logit.
@group(0) @binding(2) var<storage, read_write> scales: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> rotations: array<vec4<f32>>;
// Mean and logit; log scales; quaternion: three vectors for each Gaussian, as the running means.
@group(0) @binding(4) var<storage, read> by_shape: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> first: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> second: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> sh: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> by_sh: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> sh_first: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> sh_second: array<vec4<f32>>;

const NOISE: u32 = 4u;

// What a parameter moves by in units of its rate; the running means are put where they belong.
fn adam(at: u32, by: vec4<f32>) -> vec4<f32> {
    let m = BETA1 * first[at] + (1.0 - BETA1) * by;
    let v = BETA2 * second[at] + (1.0 - BETA2) * by * by;
    first[at] = m;
    second[at] = v;
    return (m / step.bias1) / (sqrt(v / step.bias2) + EPSILON);
}

fn axes_of(q: vec4<f32>) -> mat3x3<f32> {
    let w = q.x;
    let v = q.yzw;
    return mat3x3<f32>(
        1.0 - 2.0 * (v.y * v.y + v.z * v.z), 2.0 * (v.x * v.y + w * v.z), 2.0 * (v.x * v.z - w * v.y),
        2.0 * (v.x * v.y - w * v.z), 1.0 - 2.0 * (v.x * v.x + v.z * v.z), 2.0 * (v.y * v.z + w * v.x),
        2.0 * (v.x * v.z + w * v.y), 2.0 * (v.y * v.z - w * v.x), 1.0 - 2.0 * (v.x * v.x + v.y * v.y),
    );
}

@compute @workgroup_size(256)
fn shape(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= step.count {
        return;
    }
    let log_scales = scales[i].xyz;
    let s = exp(log_scales);
    let o = logistic(scales[i].w);
    var by_mean = by_shape[3u * i];
    var by_scale = by_shape[3u * i + 1u];
    by_mean.w += step.opacity * o * (1.0 - o);
    by_scale += vec4<f32>(step.scale * s, 0.0);
    if s.x <= s.y && s.x <= s.z {
        by_scale.x += step.flat * s.x;
    } else if s.y <= s.z {
        by_scale.y += step.flat * s.y;
    } else {
        by_scale.z += step.flat * s.z;
    }
    let move_mean = adam(3u * i, by_mean);
    let move_scale = adam(3u * i + 1u, by_scale);
    let turned = rotations[i] - step.rates.z * adam(3u * i + 2u, by_shape[3u * i + 2u]);
    let new_scales = log_scales - step.rates.y * move_scale.xyz;
    let logit = scales[i].w - step.rates.w * move_mean.w;
    var mean = means[i].xyz - step.rates.x * move_mean.xyz;
    if step.noise > 0.0 {
        let share = logistic(100.0 * (1.0 - logistic(logit) - 0.995)) * step.noise;
        let word = words(step.seed, step.iteration, i, NOISE);
        let a = sqrt(-2.0 * log(1.0 - unit(word.x)));
        let b = sqrt(-2.0 * log(1.0 - unit(word.z)));
        let angle = 6.2831853 * unit(word.y);
        let random = vec3<f32>(a * cos(angle), a * sin(angle), b * cos(6.2831853 * unit(word.w)));
        let axes = axes_of(turned / length(turned));
        let spread = exp(new_scales);
        let shift = axes * (spread * spread * (transpose(axes) * random)) * share;
        let sum = abs(shift.x) + abs(shift.y) + abs(shift.z);
        if (bitcast<u32>(sum) & 0x7f800000u) != 0x7f800000u {
            mean += shift;
        }
    }
    means[i] = vec4<f32>(mean, means[i].w);
    scales[i] = vec4<f32>(new_scales, logit);
    rotations[i] = turned;
}

@compute @workgroup_size(256)
fn harmonics(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = (group.y * 32768u + group.x) * 256u + local;
    let floats = 3u * step.count * step.sh_count;
    if 4u * at >= floats {
        return;
    }
    let by = by_sh[at];
    var rates: vec4<f32>;
    for (var k = 0u; k < 4u; k++) {
        let constant = (4u * at + k) / 3u % step.sh_count == 0u;
        rates[k] = select(step.harmonics, step.colours, constant);
    }
    let m = BETA1 * sh_first[at] + (1.0 - BETA1) * by;
    let v = BETA2 * sh_second[at] + (1.0 - BETA2) * by * by;
    sh_first[at] = m;
    sh_second[at] = v;
    sh[at] -= rates * (m / step.bias1) / (sqrt(v / step.bias2) + EPSILON);
    by_sh[at] = vec4<f32>(0.0);
}

// Features, with the buffers of harmonics.
@compute @workgroup_size(256)
fn features(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = (group.y * 32768u + group.x) * 256u + local;
    if 4u * at >= step.count * step.feature_count {
        return;
    }
    let by = by_sh[at];
    let m = BETA1 * sh_first[at] + (1.0 - BETA1) * by;
    let v = BETA2 * sh_second[at] + (1.0 - BETA2) * by * by;
    sh_first[at] = m;
    sh_second[at] = v;
    sh[at] -= step.feature_rate * (m / step.bias1) / (sqrt(v / step.bias2) + EPSILON);
    by_sh[at] = vec4<f32>(0.0);
}
