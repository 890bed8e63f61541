// What all stages declare. Constants are put before this text by the program (gpu/shaders.rs).

// Rows of camera_from_group.
struct Motion {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}

// Large dispatches are folded into rows of this many workgroups.
const FOLD: u32 = 32768u;

fn folded(group: vec3<u32>) -> u32 {
    return group.y * FOLD + group.x;
}

// Compilers may assume that there is no NaN, so bits are asked.
fn finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn logistic(x: f32) -> f32 {
    return 1.0 / (1.0 + exp(-x));
}

// A record is two vectors: mean, u00, u01; u11, opacity, view, Gaussian. Packed, the second holds u11, opacity and blue, red and green,
// depth.
fn opacity_of(b: vec4<f32>) -> f32 {
//#if PACKED
    return unpack2x16unorm(bitcast<u32>(b.y)).x;
//#else
    return b.y;
//#endif
}
