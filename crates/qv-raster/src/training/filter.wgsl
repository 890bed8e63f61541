// Twin of filter.rs: `widen` puts Gaussians that are no finer than what photographs sample in the place of those that are learned, for a step;
// `narrow` puts these back and brings the derivatives to them.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(1) var<storage, read> means: array<vec4<f32>>;
// Log scales and opacity logit.
@group(0) @binding(2) var<storage, read_write> scales: array<vec4<f32>>;
// The same as they are learned, and the squared deviation of the filter.
@group(0) @binding(3) var<storage, read_write> learned: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> squares: array<f32>;
// Mean and logit; log scales; quaternion: three vectors for each Gaussian.
@group(0) @binding(5) var<storage, read_write> by_shape: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> lenses: array<Lens>;
// Rows of camera_from_world of all photographs.
@group(0) @binding(7) var<storage, read> motions: array<vec4<f32>>;

const VARIANCE: f32 = 0.2;
const NEAREST: f32 = 0.01;
const MOST: f32 = 0.999999;
const FAR: f32 = 1e30;

fn square_at(mean: vec3<f32>) -> f32 {
    let point = vec4<f32>(mean, 1.0);
    var seen = FAR;
    var before = FAR;
    for (var k = 0u; k < step.photographs; k++) {
        let p = vec3<f32>(dot(motions[3u * k], point), dot(motions[3u * k + 1u], point), dot(motions[3u * k + 2u], point));
        if p.z <= NEAREST {
            continue;
        }
        let lens = lenses[k];
        let apart = p.z / max(lens.focal.x, lens.focal.y);
        let slope = p.xy / p.z;
        before = min(before, apart);
        if all(slope >= lens.lowest) && all(slope <= lens.highest) {
            seen = min(seen, apart);
        }
    }
    let apart = select(before, seen, seen < FAR);
    return select(0.0, VARIANCE * apart * apart, apart < FAR);
}

fn kept_of(log_scales: vec3<f32>, square: f32) -> vec3<f32> {
    let own = exp(2.0 * log_scales);
    let sum = own + square;
    return select(vec3<f32>(1.0), own / sum, sum > vec3<f32>(0.0));
}

@compute @workgroup_size(256)
fn widen(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= step.count {
        return;
    }
    let own = scales[i];
    let square = square_at(means[i].xyz);
    learned[i] = own;
    squares[i] = square;
    let kept = kept_of(own.xyz, square);
    let opacity = clamp(logistic(own.w) * sqrt(kept.x * kept.y * kept.z), 1e-12, MOST);
    let wide = select(own.xyz, 0.5 * log(exp(2.0 * own.xyz) + square), square > 0.0);
    scales[i] = vec4<f32>(wide, log(opacity / (1.0 - opacity)));
}

@compute @workgroup_size(256)
fn narrow(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= step.count {
        return;
    }
    let own = learned[i];
    scales[i] = own;
    let kept = kept_of(own.xyz, squares[i]);
    let opacity = logistic(own.w);
    let left = 1.0 - min(opacity * sqrt(kept.x * kept.y * kept.z), MOST);
    let by_logit = by_shape[3u * i].w;
    let by_scales = by_shape[3u * i + 1u];
    by_shape[3u * i + 1u] = vec4<f32>(by_scales.xyz * kept + by_logit / left * (1.0 - kept), by_scales.w);
    by_shape[3u * i].w = by_logit * (1.0 - opacity) / left;
}
