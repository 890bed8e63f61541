//! Labels of pixels: cross-entropy of the drawn features, taken as logits, against label images.

use super::super::dataset::Photograph;
use qv_raster::Image;

/// Mean cross-entropy; `count` features are drawn. A pixel that is labelled 0, none of them, is to look like no label more than like
/// another: sky that took the label of the wall before it would become part of the wall's mesh.
pub fn add(image: &Image, photograph: &Photograph, count: usize, weight: f32, by: &mut Image) -> f32 {
    let share = weight / image.alpha.len().max(1) as f32;
    let none = 1.0 / count.max(1) as f32;
    let mut sum = 0.0f64;
    for (pixel, &label) in photograph.labels.iter().enumerate() {
        let label = label as usize;
        if label > count || photograph.pixels.rgba[pixel][3] == 0 {
            continue;
        }
        let logits = &image.features[count * pixel..count * (pixel + 1)];
        let most = logits.iter().copied().fold(f32::MIN, f32::max);
        let powers: Vec<f32> = logits.iter().map(|x| (x - most).exp()).collect();
        let total: f32 = powers.iter().sum();
        for (k, power) in powers.iter().enumerate() {
            let wanted = match label {
                0 => none,
                label if label == k + 1 => 1.0,
                _ => 0.0,
            };
            sum += (wanted * (total.ln() + most - logits[k])) as f64;
            by.features[count * pixel + k] += share * (power / total - wanted);
        }
    }
    share * sum as f32
}
