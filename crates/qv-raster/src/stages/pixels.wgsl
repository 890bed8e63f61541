// What the blending and its derivatives share: where an invocation's pixel is in its tile, and whether a block of pixels is touched.

// sqrt(log2(e) / 2): U times this makes opacity fall with exp2(-|U d|²).
const TO_EXP2: f32 = 0.84932180;

// Every other bit, from the lowest.
fn squeeze(x: u32) -> u32 {
    let a = x & 0x55u;
    let b = (a | (a >> 1u)) & 0x33u;
    return (b | (b >> 2u)) & 0x0fu;
}

//#if SUBGROUPS
// What `touches` needs of an ellipse, with U scaled so: the square that |U d| must not pass, half the height, the offset along y of
// the leftmost point, 1 / u00.
fn bound_of(a: vec4<f32>, u11: f32, opacity: f32) -> vec4<f32> {
    let square = log2(max(opacity / MIN_ALPHA, 1.0)) + 1e-4;
    let limit = sqrt(square) / u11;
    return vec4<f32>(square, limit, limit * a.w / sqrt(a.w * a.w + u11 * u11), 1.0 / a.z);
}

// Whether a pixel centre between two corners may be inside an ellipse.
fn touches(a: vec4<f32>, u11: f32, bound: vec4<f32>, low: vec2<f32>, high: vec2<f32>) -> bool {
    let top = max(low.y - a.y, -bound.y);
    let bottom = min(high.y - a.y, bound.y);
    // Where the ellipse is widest, or as near to that as the rows come.
    let right_y = clamp(-bound.z, top, bottom);
    let left_y = clamp(bound.z, top, bottom);
    let right_over = u11 * right_y;
    let left_over = u11 * left_y;
    let right = (sqrt(max(bound.x - right_over * right_over, 0.0)) - a.w * right_y) * bound.w;
    let left = (-sqrt(max(bound.x - left_over * left_over, 0.0)) - a.w * left_y) * bound.w;
    return top <= bottom + 1e-3 && low.x - a.x <= right + 1e-3 && high.x - a.x >= left - 1e-3;
}
//#endif
