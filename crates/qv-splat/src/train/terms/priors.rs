//! Measured depth.

use super::super::dataset::Photograph;
use qv_raster::Image;

/// Opacity below which a pixel shows too little for its depth to mean something.
const SOLID: f32 = 0.5;

/// Mean of |d - d*| / d* of the mean depth d against the measured one, where there is one and the image is solid.
pub fn depth(image: &Image, photograph: &Photograph, weight: f32, by: &mut Image) -> f32 {
    let share = weight / image.depth.len().max(1) as f32;
    let mut sum = 0.0f64;
    for (pixel, &measured) in photograph.depth.iter().enumerate() {
        if measured > 0.0 && image.alpha[pixel] >= SOLID && photograph.pixels.rgba[pixel][3] != 0 {
            let off = image.depth[pixel] - measured;
            sum += (off.abs() / measured) as f64;
            by.depth[pixel] += share * off.signum() / measured;
        }
    }
    share * sum as f32
}
