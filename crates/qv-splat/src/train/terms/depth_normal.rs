//! Depth-normal consistency (Huang et al., *2DGS*, 2024, eq. 14; Chen et al., *PGSR*, 2024, eq. 6): the drawn normal N against that of the
//! surface which the plane depths of the four pixels around make, as the mean of 1 - N · n / |N|. The direction of N alone counts: its length
//! is how much is drawn there, and whatever gets denser would be rewarded.

use super::ray;
use glam::Vec3;
use qv_core::Camera;
use qv_raster::Image;

/// Largest relative step of depth from one side of a pixel to the other that counts as one surface.
const SMOOTH: f32 = 0.1;
/// Length of the drawn normal up to which it says nothing: little is drawn, or what is drawn points all ways.
const SHORT: f32 = 0.3;

/// The surface at a pixel: its unit normal towards the camera, and the two differences that it is across.
struct Surface {
    normal: Vec3,
    across: Vec3,
    down: Vec3,
    /// Length of the product of the two.
    area: f32,
}

fn surface(depth: &[f32], camera: &Camera, x: usize, y: usize) -> Option<Surface> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height {
        return None;
    }
    let pixel = y * width + x;
    let around = [pixel + 1, pixel - 1, pixel + width, pixel - width];
    let here = depth[pixel];
    if here <= 0.0 || around.iter().any(|&at| depth[at] <= 0.0 || (depth[at] - here).abs() > SMOOTH * here) {
        return None;
    }
    let [right, left, below, above] = around.map(|at| ray(camera, at) * depth[at]);
    let (across, down) = (right - left, below - above);
    let product = down.cross(across);
    let area = product.length();
    (area > 0.0).then(|| Surface { normal: product / area, across, down, area })
}

/// Adds the term.
pub fn add(image: &Image, camera: &Camera, weight: f32, by: &mut Image) -> f32 {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let share = weight / image.alpha.len().max(1) as f32;
    let mut sum = 0.0f64;
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let Some(s) = surface(&image.plane_depth, camera, x, y) else { continue };
        let pixel = y * width + x;
        let drawn = Vec3::from_slice(&image.normal[3 * pixel..]);
        let length = drawn.length();
        if length <= SHORT {
            continue;
        }
        let direction = drawn / length;
        sum += (1.0 - direction.dot(s.normal)) as f64;
        let by_normal = (s.normal - direction * direction.dot(s.normal)) * (-share / length);
        (0..3).for_each(|k| by.normal[3 * pixel + k] += by_normal[k]);
        // Through the unit length to the product, then to the two differences.
        let by_product = (direction - s.normal * direction.dot(s.normal)) * (-share / s.area);
        let by_down = s.across.cross(by_product);
        let by_across = by_product.cross(s.down);
        for (at, by_point) in
            [(pixel + 1, by_across), (pixel - 1, -by_across), (pixel + width, by_down), (pixel - width, -by_down)]
        {
            by.plane_depth[at] += by_point.dot(ray(camera, at));
        }
    }
    share * sum as f32
}
