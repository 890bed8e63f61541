// What the blending and its derivatives share: where an invocation's pixel is in its tile, and whether a block of pixels is touched.

// sqrt(log2(e) / 2): U times this makes opacity fall with exp2(-|U d|²).
const TO_EXP2: f32 = 0.84932180;
// Its square undone.
const FROM_EXP2: f32 = 1.0 / (TO_EXP2 * TO_EXP2);

// Every other bit, from the lowest.
fn squeeze(x: u32) -> u32 {
    let a = x & 0x55u;
    let b = (a | (a >> 1u)) & 0x33u;
    return (b | (b >> 2u)) & 0x0fu;
}

//#if SUBGROUPS
// Blocks of pixels that an ellipse may touch, a bit for each, row by row, of a tile of which the first pixel centre is `corner`. A block
// is what a subgroup holds; U is scaled so.
fn touched_blocks(a: vec4<f32>, u11: f32, opacity: f32, corner: vec2<f32>) -> u32 {
    let square = log2(max(opacity / MIN_ALPHA, 1.0)) + 1e-4;
    let limit = sqrt(square) / u11;
    let widest = limit * a.w / sqrt(a.w * a.w + u11 * u11);
    let inverse = 1.0 / a.z;
    let offset = corner - a.xy;
    var out = 0u;
    for (var row = 0u; row < TILE / BLOCK_HEIGHT; row++) {
        let top = max(offset.y + f32(row * BLOCK_HEIGHT), -limit);
        let bottom = min(offset.y + f32(row * BLOCK_HEIGHT + BLOCK_HEIGHT - 1u), limit);
        // Where the ellipse is widest, or as near to that as the rows come.
        let right_y = clamp(-widest, top, bottom);
        let left_y = clamp(widest, top, bottom);
        let right_over = u11 * right_y;
        let left_over = u11 * left_y;
        let right = (sqrt(max(square - right_over * right_over, 0.0)) - a.w * right_y) * inverse + 1e-3;
        let left = (-sqrt(max(square - left_over * left_over, 0.0)) - a.w * left_y) * inverse - 1e-3;
        for (var column = 0u; column < TILE / BLOCK_WIDTH; column++) {
            let low = offset.x + f32(column * BLOCK_WIDTH);
            let touched = top <= bottom + 1e-3 && low <= right && low + f32(BLOCK_WIDTH - 1u) >= left;
            out |= select(0u, 1u << (row * (TILE / BLOCK_WIDTH) + column), touched);
        }
    }
    return out;
}

// The block of a pixel of a tile.
fn block_of(x: u32, y: u32) -> u32 {
    return y / BLOCK_HEIGHT * (TILE / BLOCK_WIDTH) + x / BLOCK_WIDTH;
}
//#endif
