// Twin of project.rs: one invocation for each candidate.

@group(0) @binding(0) var<storage, read> lenses: array<Lens>;
@group(0) @binding(1) var<storage, read> motions: array<Motion>;
@group(0) @binding(2) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> scales: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> rotations: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> sh: array<f32>;
@group(0) @binding(6) var<storage, read> candidates: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read_write> records: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> counts: array<u32>;
@group(0) @binding(9) var<storage, read_write> keys: array<u32>;
@group(0) @binding(10) var<storage, read_write> state: array<atomic<u32>>;
@group(0) @binding(11) var<storage, read> frame: Frame;
//#if PLANE
@group(0) @binding(12) var<storage, read_write> planes: array<vec4<f32>>;
//#endif
//#if PACKED
//#else
@group(0) @binding(14) var<storage, read_write> shades: array<vec4<f32>>;
//#endif
//#if FEATURES
@group(0) @binding(13) var<storage, read> features: array<f32>;
//#endif

struct Frame {
    views: u32,
    splats: u32,
    groups: u32,
    blocks: u32,
    capacity: u32,
}

// False when a number is not finite or the quaternion has no direction.
fn project_one(index: u32, view: u32, splat: u32) -> bool {
    let lens = lenses[view];
    let mean = means[splat];
    let shape = shape_of(lens, motions[view * frame.groups + bitcast<u32>(mean.w)], mean.xyz, scales[splat].xyz, rotations[splat]);
    if !shape.good {
        return false;
    }
    var opacity = logistic(scales[splat].w);
//#if ANTIALIAS
    opacity *= shape.kept;
//#endif
//#if PACKED
    opacity = unpack2x16unorm(pack2x16unorm(vec2<f32>(opacity, 0.0))).x;
//#endif
    let c = shape.centre;
    let at = lens.focal * (c.xy / c.z) + lens.centre;
    let factor = factor_of(shape);
    let before = colour_of(splat, transpose(shape.rotation) * normalize(c));
    let colour = max(before, vec3<f32>(0.0));
    var sum = abs(at.x) + abs(at.y) + abs(factor.x) + abs(factor.y) + abs(factor.z) + logistic(scales[splat].w);
    sum += abs(before.x) + abs(before.y) + abs(before.z) + abs(dot(c, c));
//#if FEATURES
    for (var k = 0u; k < FEATURE_COUNT; k++) {
        sum += abs(features[splat * FEATURE_COUNT + k]);
    }
//#endif
    if !finite(sum) || factor.x <= 0.0 || factor.z <= 0.0 {
        return false;
    }
    // How many tiles it touches is counted by `emit`; here only whether there may be any.
    var count = 0u;
    if opacity >= MIN_ALPHA {
        let rows = ellipse_rows(ellipse_of(at, factor.x, factor.y, factor.z, opacity), lens.size);
        count = rows.y - rows.x;
    }
    records[2u * index] = vec4<f32>(at, factor.xy);
//#if PACKED
    // Half precision for blue, which unpacks beside the opacity.
    let first = (pack2x16unorm(vec2<f32>(opacity, 0.0)) & 0xffffu) | (pack2x16float(vec2<f32>(0.0, colour.z)) & 0xffff0000u);
    records[2u * index + 1u] = vec4<f32>(factor.z, bitcast<f32>(first), bitcast<f32>(pack2x16float(colour.xy)), c.z);
//#else
    records[2u * index + 1u] = vec4<f32>(factor.z, opacity, bitcast<f32>(view), bitcast<f32>(splat));
    shades[index] = vec4<f32>(colour, c.z);
//#endif
//#if PLANE
    let normal = normal_of(shape).xyz;
    planes[index] = vec4<f32>(normal, -dot(normal, c));
//#endif
    counts[index] = count;
    keys[index] = select(0u, bitcast<u32>(c.z), count > 0u);
    return true;
}

@compute @workgroup_size(256)
fn project(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = folded(group) * 256u + local;
    if index >= atomicLoad(&state[VISIBLE]) {
        return;
    }
    let candidate = candidates[index];
    if !project_one(index, candidate.x, candidate.y) {
        counts[index] = 0u;
        keys[index] = 0u;
        atomicAdd(&state[FAULTY], 1u);
    }
}
