//! One trained scene, published as compressed PLY and as SPZ of version 4 (SuperSplat 2.7.1): both must be the same cloud.

use crate::skipped::skipped;
use qv_splat::files::{Format, compressed_ply, read_any};
use std::fs;
use std::path::Path;

fn shared(name: &str) -> Option<Vec<u8>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes/splat_files").join(name);
    let bytes = fs::read(&path).ok();
    if bytes.is_none() {
        skipped(format!("no ../shared/scenes/splat_files/{name} beside the workspace"));
    }
    bytes
}

#[test]
fn both_files_are_the_same_cloud() {
    let (Some(ply), Some(spz)) = (shared("biker.compressed.ply"), shared("biker.spz")) else { return };
    let (a, b) = (read_any(&ply).unwrap(), read_any(&spz).unwrap());
    assert_eq!((a.format, b.format), (Format::CompressedPly, Format::Spz));
    assert_eq!((a.left_out, b.left_out, a.lost.len(), b.lost.len()), (0, 0, 0, 0));
    let (a, b) = (a.cloud, b.cloud);
    assert_eq!((a.len(), b.len(), a.sh_degree, b.sh_degree), (152_746, 152_746, 0, 0));
    let half = compressed_ply::half_steps(&ply).unwrap();
    // Largest differences in units of what both formats' rounding allows: mean, log scale, constant harmonic.
    let mut worst = [0.0f32; 3];
    let (mut opacity, mut angle, mut clamped) = (0.0f64, 0.0f64, 0);
    for i in 0..a.len() {
        let steps = half[i / 256];
        for k in 0..3 {
            // SPZ has log scales from -10 to 5.9375 and constants within ±10/3.
            let scale = a.log_scales[i][k].clamp(-10.0, 5.9375);
            let constant = a.sh[i][k].clamp(-0.5 / 0.15, 0.5 / 0.15);
            clamped += usize::from(scale != a.log_scales[i][k]) + usize::from(constant != a.sh[i][k]);
            let share = |a: f32, b: f32, half: f32| (a - b).abs() / half;
            worst[0] = worst[0].max(share(a.means[i][k], b.means[i][k], steps.mean[k] + 0.5 / 4096.0));
            worst[1] = worst[1].max(share(scale, b.log_scales[i][k], steps.log_scale[k] + 0.5 / 16.0));
            worst[2] = worst[2].max(share(constant, b.sh[i][k], steps.constant[k] + 0.5 / (255.0 * 0.15)));
        }
        let p = |logit: f32| 1.0 / (1.0 + (-f64::from(logit)).exp());
        opacity = opacity.max((p(a.opacity_logits[i]) - p(b.opacity_logits[i])).abs());
        angle = angle.max(angle_between(a.rotations[i], b.rotations[i]));
    }
    println!("shares of the steps {worst:?}, opacity {opacity:.6}, angle {angle:.5} rad, {clamped} clamped");
    assert!(worst.iter().all(|share| *share <= 1.001), "{worst:?}");
    assert!(opacity <= 1.0 / 255.0 + 1e-6, "{opacity}");
    assert!(angle < 1e-2, "{angle}");
}

/// Angle of the rotation between two \[rad\], whatever the quaternions' signs.
fn angle_between(a: [f32; 4], b: [f32; 4]) -> f64 {
    let unit = |q: [f32; 4]| {
        let length = q.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        q.map(|x| f64::from(x) / length)
    };
    let (a, b) = (unit(a), unit(b));
    let sign = if a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
    4.0 * (0.5 * a.iter().zip(&b).map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>().sqrt()).asin()
}
