// Twin of drop.rs: `leave_out` makes some Gaussians transparent for a step and the others denser; `bring_back` puts the logits back and
// brings the derivatives to them.

@group(0) @binding(0) var<storage, read> step: Step;
// Log scales and opacity logit.
@group(0) @binding(1) var<storage, read_write> scales: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> logits: array<f32>;
// Mean and logit; log scales; quaternion: three vectors for each Gaussian.
@group(0) @binding(3) var<storage, read_write> by_shape: array<vec4<f32>>;

const DROP: u32 = 7u;
const TRANSPARENT: f32 = -40.0;
const DENSEST: f32 = 0.9999;

fn is_left_out(i: u32) -> bool {
    return unit(words(step.seed, step.iteration, i, DROP).x) < step.drop;
}

fn denser(logit: f32) -> f32 {
    return min(logistic(logit) / (1.0 - step.drop), DENSEST);
}

@compute @workgroup_size(256)
fn leave_out(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= step.count {
        return;
    }
    let logit = scales[i].w;
    logits[i] = logit;
    let opacity = denser(logit);
    scales[i].w = select(log(opacity / (1.0 - opacity)), TRANSPARENT, is_left_out(i));
}

@compute @workgroup_size(256)
fn bring_back(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= step.count {
        return;
    }
    let logit = logits[i];
    scales[i].w = logit;
    let opacity = logistic(logit);
    let seen = denser(logit);
    let chain = opacity * (1.0 - opacity) / ((1.0 - step.drop) * seen * (1.0 - seen));
    by_shape[3u * i].w *= select(chain, 0.0, is_left_out(i));
}
