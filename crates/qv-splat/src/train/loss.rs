//! The photometric loss (Kerbl et al., 2023, eq. 7): (1 - w) L1 + w (1 - SSIM), with its derivatives by hand.
//!
//! SSIM (Wang et al., *Image Quality Assessment*, 2004, eq. 13) is taken of each colour by itself, with a window of 11 taps of a Gaussian
//! with sigma 1.5 and zeros beyond the border. With the window's means m of x, y, xx, yy, xy and s = m_xx - m_x m_x and so on,
//! SSIM = (2 m_x m_y + c1)(2 s_xy + c2) / ((m_x² + m_y² + c1)(s_xx + s_yy + c2)). Its derivative by x at a pixel is a sum over the windows
//! that hold it, which is again a convolution by the window.

use qv_raster::training::WINDOW;
use rayon::prelude::*;

/// Taps of the window on each side of its middle.
pub const REACH: usize = 5;
/// Keeps the quotient of means from 0 / 0.
pub const C1: f32 = 1e-4;
/// Keeps the quotient of variances from 0 / 0.
pub const C2: f32 = 9e-4;

/// One colour, or one number per pixel of whatever kind, row by row.
type Plane = Vec<f32>;

/// The mean by the window around each pixel, zeros beyond the border.
fn blurred(plane: &[f32], width: usize) -> Plane {
    let height = plane.len() / width.max(1);
    let mut across = vec![0.0; plane.len()];
    across.par_chunks_mut(width.max(1)).zip(plane.par_chunks(width.max(1))).for_each(|(out, row)| {
        for x in 0..width {
            let mut sum = 0.0;
            for k in (x.max(REACH) - REACH)..(x + REACH + 1).min(width) {
                sum += WINDOW[k + REACH - x] * row[k];
            }
            out[x] = sum;
        }
    });
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, out)| {
        for k in (y.max(REACH) - REACH)..(y + REACH + 1).min(height) {
            let weight = WINDOW[k + REACH - y];
            for (sum, value) in out.iter_mut().zip(&across[k * width..(k + 1) * width]) {
                *sum += weight * value;
            }
        }
    });
    out
}

/// SSIM at a pixel, and its derivatives by the means of x, xx and xy.
fn ssim_at(x: f32, y: f32, xx: f32, yy: f32, xy: f32) -> (f32, [f32; 3]) {
    let a = 2.0 * x * y + C1;
    let b = 2.0 * (xy - x * y) + C2;
    let c = x * x + y * y + C1;
    let d = (xx - x * x) + (yy - y * y) + C2;
    let whole = a * b / (c * d);
    let by_xx = -whole / d;
    let by_xy = 2.0 * a / (c * d);
    let by_x = 2.0 * y * b / (c * d) - 2.0 * x * whole / c - 2.0 * x * by_xx - y * by_xy;
    (whole, [by_x, by_xx, by_xy])
}

fn product(a: &[f32], b: &[f32]) -> Plane {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// SSIM of each pixel of one colour, and the derivative of its sum by `x`.
fn ssim_plane(x: &[f32], y: &[f32], width: usize, derived: bool) -> (Plane, Plane) {
    let (mx, my) = (blurred(x, width), blurred(y, width));
    let (mxx, myy) = (blurred(&product(x, x), width), blurred(&product(y, y), width));
    let mxy = blurred(&product(x, y), width);
    let at = |i: usize| ssim_at(mx[i], my[i], mxx[i], myy[i], mxy[i]);
    let all: Vec<(f32, [f32; 3])> = (0..x.len()).into_par_iter().map(at).collect();
    let map = all.iter().map(|(ssim, _)| *ssim).collect();
    if !derived {
        return (map, vec![]);
    }
    let spread = |k: usize| blurred(&all.iter().map(|(_, by)| by[k]).collect::<Plane>(), width);
    let [by_x, by_xx, by_xy] = [spread(0), spread(1), spread(2)];
    let by = |i: usize| by_x[i] + 2.0 * x[i] * by_xx[i] + y[i] * by_xy[i];
    (map, (0..x.len()).map(by).collect())
}

fn plane(image: &[f32], c: usize) -> Plane {
    image.iter().skip(c).step_by(3).copied().collect()
}

/// SSIM of two images, shape `[height, width, 3]`, of each pixel, as a mean over colours.
pub(crate) fn ssim_map(a: &[f32], b: &[f32], width: usize) -> Vec<f32> {
    let mut out = vec![0.0; a.len() / 3];
    for c in 0..3 {
        let (map, _) = ssim_plane(&plane(a, c), &plane(b, c), width, false);
        out.iter_mut().zip(map).for_each(|(out, ssim)| *out += ssim / 3.0);
    }
    out
}

/// The loss of an image against a photograph and its derivative, both of shape `[height, width, 3]`. Where `valid` (shape
/// `[height, width]`) is false the image counts as equal to the photograph.
pub fn photometric(
    image: &[f32],
    photograph: &[f32],
    valid: &[bool],
    width: usize,
    ssim_share: f32,
) -> (f32, Vec<f32>) {
    let mut x: Vec<f32> = image.to_vec();
    for (pixel, _) in valid.iter().enumerate().filter(|(_, valid)| !**valid) {
        x[3 * pixel..3 * pixel + 3].copy_from_slice(&photograph[3 * pixel..3 * pixel + 3]);
    }
    let scale = 1.0 / image.len().max(1) as f32;
    let far: f64 = x.iter().zip(photograph).map(|(a, b)| (a - b).abs() as f64).sum();
    let mut loss = (1.0 - ssim_share) as f64 * far * scale as f64;
    let sign = |d: f32| if d == 0.0 { 0.0 } else { d.signum() };
    let mut by: Vec<f32> = x.iter().zip(photograph).map(|(a, b)| (1.0 - ssim_share) * scale * sign(a - b)).collect();
    if ssim_share > 0.0 {
        for c in 0..3 {
            let (map, by_plane) = ssim_plane(&plane(&x, c), &plane(photograph, c), width, true);
            let lost: f64 = map.iter().map(|ssim| 1.0 - *ssim as f64).sum();
            loss += ssim_share as f64 * lost * scale as f64;
            for (pixel, slope) in by_plane.iter().enumerate() {
                by[3 * pixel + c] -= ssim_share * scale * slope;
            }
        }
    }
    for (pixel, _) in valid.iter().enumerate().filter(|(_, valid)| !**valid) {
        by[3 * pixel..3 * pixel + 3].fill(0.0);
    }
    (loss as f32, by)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made_up(width: usize, height: usize, shift: f32) -> Vec<f32> {
        (0..width * height * 3).map(|i| 0.5 + 0.4 * (i as f32 * 0.37 + shift + (i / 31) as f32).sin()).collect()
    }

    /// SSIM from the formula in double precision, window by window.
    fn ssim_slow(a: &[f32], b: &[f32], width: usize, height: usize) -> f64 {
        let tap = |d: i64| (-(d * d) as f64 / (2.0 * 1.5 * 1.5)).exp();
        let norm: f64 = (-5..=5).map(tap).sum();
        let mut sum = 0.0;
        for c in 0..3 {
            for (y, x) in (0..height as i64).flat_map(|y| (0..width as i64).map(move |x| (y, x))) {
                let mut m = [0.0f64; 5];
                for (dy, dx) in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
                    let (v, u) = (y + dy, x + dx);
                    if (0..height as i64).contains(&v) && (0..width as i64).contains(&u) {
                        let at = 3 * (v as usize * width + u as usize) + c;
                        let (p, q) = (a[at] as f64, b[at] as f64);
                        let w = tap(dy) * tap(dx) / (norm * norm);
                        [p, q, p * p, q * q, p * q].iter().zip(&mut m).for_each(|(v, m)| *m += w * v);
                    }
                }
                let (sx, sy, sxy) = (m[2] - m[0] * m[0], m[3] - m[1] * m[1], m[4] - m[0] * m[1]);
                sum += (2.0 * m[0] * m[1] + 1e-4) * (2.0 * sxy + 9e-4)
                    / ((m[0] * m[0] + m[1] * m[1] + 1e-4) * (sx + sy + 9e-4));
            }
        }
        sum / (3 * width * height) as f64
    }

    #[test]
    fn ssim_is_that_of_the_formula() {
        let (a, b) = (made_up(19, 14, 0.0), made_up(19, 14, 0.8));
        let map = ssim_map(&a, &b, 19);
        let mean = map.iter().map(|x| *x as f64).sum::<f64>() / map.len() as f64;
        assert!((mean - ssim_slow(&a, &b, 19, 14)).abs() < 1e-5, "{mean}");
        assert!(ssim_map(&a, &a, 19).iter().all(|x| (x - 1.0).abs() < 1e-5));
    }

    #[test]
    fn derivatives_are_those_of_the_loss() {
        let (mut a, b) = (made_up(17, 15, 0.0), made_up(17, 15, 0.5));
        let valid: Vec<bool> = (0..17 * 15).map(|i| i % 11 != 3).collect();
        let (loss, by) = photometric(&a, &b, &valid, 17, 0.2);
        assert!(loss > 0.05);
        let h = 3e-3;
        for at in (0..a.len()).step_by(13) {
            if !valid[at / 3] || (a[at] - b[at]).abs() < 2.0 * h {
                assert!(valid[at / 3] || by[at] == 0.0);
                continue;
            }
            let before = a[at];
            a[at] = before + h;
            let plus = photometric(&a, &b, &valid, 17, 0.2).0;
            a[at] = before - h;
            let minus = photometric(&a, &b, &valid, 17, 0.2).0;
            a[at] = before;
            let expected = (plus - minus) / (2.0 * h);
            assert!((by[at] - expected).abs() < 0.02 * expected.abs() + 3e-5, "{at}: {} {expected}", by[at]);
        }
    }
}
