//! Depths that others confirm.

use super::options::StereoOptions;
use super::views::{View, Way};
use glam::{Vec2, Vec3};

/// Inverse depths of a photograph that enough of its neighbours confirm, the mean with what those say; 0 elsewhere.
pub fn agreed(index: usize, views: &[View], maps: &[Vec<f32>], options: &StereoOptions) -> Vec<f32> {
    let view = &views[index];
    let others: Vec<(usize, Way, Way)> = view
        .neighbours
        .iter()
        .map(|&k| (k, Way::new(&view.camera, &views[k].camera), Way::new(&views[k].camera, &view.camera)))
        .collect();
    let one = |pixel: usize| {
        let inverse = maps[index][pixel];
        if inverse <= 0.0 {
            return 0.0;
        }
        let at = Vec2::new((pixel % view.width) as f32 + 0.5, (pixel / view.width) as f32 + 0.5);
        let (mut sum, mut count) = (inverse, 1);
        for (k, there, back) in &others {
            if let Some(said) = said(at, inverse, &views[*k], &maps[*k], there, back, options.within) {
                sum += said;
                count += 1;
            }
        }
        if count > options.agreeing { sum / count as f32 } else { 0.0 }
    };
    (0..view.grey.len()).map(one).collect()
}

/// Inverse depth that another photograph has of the place, as seen from the first; none where it has none or does not agree.
fn said(at: Vec2, inverse: f32, other: &View, map: &[f32], there: &Way, back: &Way, within: f32) -> Option<f32> {
    let p = there.turn * at.extend(1.0) + there.shift * inverse;
    let uv = p.truncate() / p.z;
    let inside = p.z > 0.0 && uv.x >= 0.0 && uv.y >= 0.0 && uv.x < other.width as f32 && uv.y < other.height as f32;
    if !inside {
        return None;
    }
    let found = map[uv.y as usize * other.width + uv.x as usize];
    // p is the point in units of its depth in the first photograph.
    let expected = inverse / p.z;
    if found <= 0.0 || (found - expected).abs() > within * other.step {
        return None;
    }
    let q: Vec3 = back.turn * uv.extend(1.0) + back.shift * found;
    (q.z > 0.0).then(|| found / q.z)
}
