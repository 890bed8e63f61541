// Twin of compose.rs: images of what moves over prepared images of what does not, in place.

//#if BYTES
@group(0) @binding(0) var<storage, read_write> front: array<u32>;
@group(0) @binding(1) var<storage, read> back: array<u32>;
//#else
@group(0) @binding(0) var<storage, read_write> front: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> back: array<vec4<f32>>;
//#endif
//#if DEPTH
@group(0) @binding(2) var<storage, read_write> front_depth: array<f32>;
@group(0) @binding(3) var<storage, read> back_depth: array<f32>;
//#endif

@compute @workgroup_size(256)
fn compose(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let pixel = folded(group) * 256u + local;
    if pixel >= arrayLength(&back) {
        return;
    }
//#if BYTES
    let near = unpack4x8unorm(front[pixel]);
    let far = unpack4x8unorm(back[pixel]);
//#else
    let near = front[pixel];
    let far = back[pixel];
//#endif
    var hidden = 0.0;
//#if DEPTH
    let near_depth = front_depth[pixel];
    let far_depth = back_depth[pixel];
    hidden = select(0.0, far.w, near_depth > far_depth);
//#endif
    let shown = near.w * (1.0 - hidden);
    let left = 1.0 - shown;
    let covered = shown + left * far.w;
    let both = vec4<f32>((1.0 - hidden) * near.xyz + left * far.xyz, covered);
//#if BYTES
    front[pixel] = pack4x8unorm(both);
//#else
    front[pixel] = both;
//#endif
//#if DEPTH
    let mixed = (shown * near_depth + left * far.w * far_depth) / covered;
    front_depth[pixel] = select(near_depth, mixed, covered > 0.0);
//#endif
}
