// Twin of `Relocation::apply`: `change` alters Gaussians that become one of several, `copy` puts copies of them elsewhere; the optimiser
// forgets both. An invocation for each item of a list.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(1) var<storage, read_write> means: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> scales: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> rotations: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> first: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> second: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> sh: array<f32>;
@group(0) @binding(7) var<storage, read_write> sh_first: array<f32>;
@group(0) @binding(8) var<storage, read_write> sh_second: array<f32>;
// Index, logit, what is added to log scales; or target and source. The first item is the number of those that follow.
@group(0) @binding(9) var<storage, read> list: array<vec4<u32>>;

@group(0) @binding(10) var<storage, read_write> features: array<f32>;
@group(0) @binding(11) var<storage, read_write> features_first: array<f32>;
@group(0) @binding(12) var<storage, read_write> features_second: array<f32>;

fn forget(i: u32) {
    for (var k = 0u; k < 3u; k++) {
        first[3u * i + k] = vec4<f32>(0.0);
        second[3u * i + k] = vec4<f32>(0.0);
    }
    let each = 3u * step.sh_count;
    for (var k = 0u; k < each; k++) {
        sh_first[each * i + k] = 0.0;
        sh_second[each * i + k] = 0.0;
    }
    for (var k = 0u; k < step.feature_count; k++) {
        features_first[step.feature_count * i + k] = 0.0;
        features_second[step.feature_count * i + k] = 0.0;
    }
}

@compute @workgroup_size(256)
fn change(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= list[0].x {
        return;
    }
    let item = list[id.x + 1u];
    scales[item.x] = vec4<f32>(scales[item.x].xyz + bitcast<f32>(item.z), bitcast<f32>(item.y));
    forget(item.x);
}

@compute @workgroup_size(256)
fn copy(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= list[0].x {
        return;
    }
    let target_ = list[id.x + 1u].x;
    let source = list[id.x + 1u].y;
    means[target_] = means[source];
    scales[target_] = scales[source];
    rotations[target_] = rotations[source];
    let each = 3u * step.sh_count;
    for (var k = 0u; k < each; k++) {
        sh[each * target_ + k] = sh[each * source + k];
    }
    for (var k = 0u; k < step.feature_count; k++) {
        features[step.feature_count * target_ + k] = features[step.feature_count * source + k];
    }
    forget(target_);
}
