// A camera of a batch; `Lens` in lens.rs has the same layout.

struct Lens {
    focal: vec2<f32>,
    centre: vec2<f32>,
    lowest: vec2<f32>,
    highest: vec2<f32>,
    size: vec2<u32>,
    tiles: vec2<u32>,
    first_tile: u32,
    first_pixel: u32,
    unused: vec2<u32>,
}
