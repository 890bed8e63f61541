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
// With U scaled so: whether a pixel centre between two corners may be inside an ellipse.
fn touches(a: vec4<f32>, b: vec4<f32>, low: vec2<f32>, high: vec2<f32>) -> bool {
    let square = log2(b.y / MIN_ALPHA) + 1e-4;
    let top = low.y - a.y;
    let bottom = high.y - a.y;
    let nearest = b.x * clamp(0.0, top, bottom);
    if nearest * nearest > square {
        return false;
    }
    // Where the ellipse is widest, or as near to that as the rows come.
    let slope = sqrt(a.w * a.w + b.x * b.x);
    let limit = sqrt(square) / b.x;
    let widest = limit * a.w / slope;
    let right_y = clamp(clamp(-widest, top, bottom), -limit, limit);
    let left_y = clamp(clamp(widest, top, bottom), -limit, limit);
    let right = (sqrt(max(square - b.x * b.x * right_y * right_y, 0.0)) - a.w * right_y) / a.z;
    let left = (-sqrt(max(square - b.x * b.x * left_y * left_y, 0.0)) - a.w * left_y) / a.z;
    return low.x - a.x <= right + 1e-3 && high.x - a.x >= left - 1e-3;
}
//#endif
