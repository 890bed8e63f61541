//! Labels of pixels: cross-entropy of the drawn features, taken as logits, against label images.

use super::super::dataset::Photograph;
use qv_raster::Image;

/// Mean cross-entropy over pixels that have a label; `count` features are drawn.
pub fn add(image: &Image, photograph: &Photograph, count: usize, weight: f32, by: &mut Image) -> f32 {
    let share = weight / image.alpha.len().max(1) as f32;
    let mut sum = 0.0f64;
    for (pixel, &label) in photograph.labels.iter().enumerate() {
        let label = label as usize;
        if label == 0 || label > count || photograph.pixels.rgba[pixel][3] == 0 {
            continue;
        }
        let logits = &image.features[count * pixel..count * (pixel + 1)];
        let most = logits.iter().copied().fold(f32::MIN, f32::max);
        let powers: Vec<f32> = logits.iter().map(|x| (x - most).exp()).collect();
        let total: f32 = powers.iter().sum();
        sum += (total.ln() + most - logits[label - 1]) as f64;
        for (k, power) in powers.iter().enumerate() {
            let wanted = if k + 1 == label { 1.0 } else { 0.0 };
            by.features[count * pixel + k] += share * (power / total - wanted);
        }
    }
    share * sum as f32
}
