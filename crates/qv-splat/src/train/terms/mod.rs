//! Terms of the loss that know of geometry. Each takes what was drawn, adds its derivative to that of the drawn images, and gives its
//! value; all are means over the pixels of the photograph.

pub mod depth_normal;
pub mod labels;
pub mod multi_view;
pub mod priors;
#[cfg(test)]
mod tests;

use glam::Vec3;
use qv_core::Camera;

/// The ray of a pixel with z = 1, camera axes.
pub fn ray(camera: &Camera, pixel: usize) -> Vec3 {
    let (x, y) = ((pixel % camera.width as usize) as f64 + 0.5, (pixel / camera.width as usize) as f64 + 0.5);
    Vec3::new(((x - camera.cx) / camera.fx) as f32, ((y - camera.cy) / camera.fy) as f32, 1.0)
}
