// Twin of ellipse.rs.

const SLACK: f32 = 1e-4;
const SLACK_PIXELS: f32 = 1e-3;

struct Ellipse {
    mean: vec2<f32>,
    u00: f32,
    u01: f32,
    u11: f32,
    reach: f32,
    half_height: f32,
    rightmost: f32,
}

fn ellipse_of(mean: vec2<f32>, u00: f32, u01: f32, u11: f32, opacity: f32) -> Ellipse {
    let reach = sqrt(2.0 * log(max(opacity / MIN_ALPHA, 1.0)) + SLACK);
    let slope = sqrt(u01 * u01 + u11 * u11);
    return Ellipse(mean, u00, u01, u11, reach, reach / u11, -reach * u01 / (u11 * slope));
}

// Tiles that hold a pixel centre between two coordinates: first, and after last.
fn tiles_between(low: f32, high: f32, size: u32) -> vec2<u32> {
    let first = max(ceil(low - 0.5 - SLACK_PIXELS), 0.0);
    let last = min(floor(high - 0.5 + SLACK_PIXELS), f32(size) - 1.0);
    if first <= last {
        return vec2<u32>(u32(first) / TILE, u32(last) / TILE + 1u);
    }
    return vec2<u32>(0u, 0u);
}

fn ellipse_rows(e: Ellipse, size: vec2<u32>) -> vec2<u32> {
    return tiles_between(e.mean.y - e.half_height, e.mean.y + e.half_height, size.y);
}

fn ellipse_offset(e: Ellipse, offset: f32, side: f32) -> f32 {
    let y = clamp(offset, -e.half_height, e.half_height);
    let square = e.reach * e.reach - e.u11 * e.u11 * y * y;
    return (side * sqrt(max(square, 0.0)) - e.u01 * y) / e.u00;
}

fn ellipse_row(e: Ellipse, row: u32, size: vec2<u32>) -> vec2<u32> {
    let top = f32(row * TILE) + 0.5 - SLACK_PIXELS - e.mean.y;
    let bottom = top + f32(TILE - 1u) + 2.0 * SLACK_PIXELS;
    let right = ellipse_offset(e, clamp(e.rightmost, top, bottom), 1.0);
    let left = ellipse_offset(e, clamp(-e.rightmost, top, bottom), -1.0);
    return tiles_between(e.mean.x + left, e.mean.x + right, size.x);
}
