//! Measured depth and given normals.

use super::super::dataset::Photograph;
use glam::Vec3;
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

/// Mean of 1 - N · n* of the drawn normal N, which is as long as the image is solid, against a given unit one.
pub fn normals(image: &Image, photograph: &Photograph, weight: f32, by: &mut Image) -> f32 {
    let share = weight / image.alpha.len().max(1) as f32;
    let mut sum = 0.0f64;
    for (pixel, given) in photograph.normals.iter().enumerate() {
        let given = Vec3::from_array(*given);
        if given != Vec3::ZERO && photograph.pixels.rgba[pixel][3] != 0 {
            let drawn = Vec3::from_slice(&image.normal[3 * pixel..]);
            sum += (1.0 - drawn.dot(given)) as f64;
            (0..3).for_each(|k| by.normal[3 * pixel + k] -= share * given[k]);
        }
    }
    share * sum as f32
}
