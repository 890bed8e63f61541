//! Photographs as a pinhole camera of the same focal lengths, size and place would have taken them, made smaller on demand.

use crate::captures::distortion::Distortion;
use glam::DVec2;
use qv_core::Camera;
use rayon::prelude::*;

/// Red, green, blue and 255 where there is a photograph, 0 where there is none, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Pixels {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Shape `[height, width]`.
    pub rgba: Vec<[u8; 4]>,
}

impl Pixels {
    /// A pixel's colour from four neighbours; `None` outside, or where one of them is masked. `at` is in pixels, centres at one half.
    fn mixed(&self, at: DVec2) -> Option<[f32; 3]> {
        let corner = at - 0.5;
        let most = DVec2::new(self.width as f64 - 1.0, self.height as f64 - 1.0);
        if !(corner.cmpge(DVec2::splat(-0.5)).all() && corner.cmple(most + 0.5).all()) {
            return None;
        }
        let corner = corner.clamp(DVec2::ZERO, most);
        let (x, y) = (corner.x as usize, corner.y as usize);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let share = (corner - corner.floor()).as_vec2();
        let mut out = [0.0; 3];
        for (x, y, weight) in [
            (x, y, (1.0 - share.x) * (1.0 - share.y)),
            (right, y, share.x * (1.0 - share.y)),
            (x, below, (1.0 - share.x) * share.y),
            (right, below, share.x * share.y),
        ] {
            let pixel = self.rgba[y * self.width + x];
            if pixel[3] == 0 && weight > 0.0 {
                return None;
            }
            (0..3).for_each(|c| out[c] += weight * pixel[c] as f32);
        }
        Some(out)
    }
}

/// Whether the lens folds on the way from its axis to a pixel of the edge; where it does for none, it does for none within.
fn folds_at_edge(camera: &Camera, distortion: &Distortion) -> bool {
    let (width, height) = (camera.width, camera.height);
    let rows = (0..height).flat_map(|y| [(0, y), (width - 1, y)]);
    let columns = (0..width).flat_map(|x| [(x, 0), (x, height - 1)]);
    rows.chain(columns).any(|(x, y)| {
        let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        distortion.folds_before(DVec2::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy))
    })
}

/// The photograph without distortion; pixels that the lens does not show, or beyond where it folds, are masked.
pub fn undistorted(photograph: Pixels, camera: &Camera, distortion: &Distortion) -> Pixels {
    if distortion.is_none() {
        return photograph;
    }
    let (focal, centre) = (DVec2::new(camera.fx, camera.fy), DVec2::new(camera.cx, camera.cy));
    let folds = folds_at_edge(camera, distortion);
    let pixel = |index: usize| {
        let at = DVec2::new((index % photograph.width) as f64 + 0.5, (index / photograph.width) as f64 + 0.5);
        let ray = (at - centre) / focal;
        if folds && distortion.folds_before(ray) {
            return [0; 4];
        }
        match photograph.mixed(distortion.distort(ray) * focal + centre) {
            Some(colour) => {
                let [r, g, b] = colour.map(|c| (c + 0.5) as u8);
                [r, g, b, 255]
            }
            None => [0; 4],
        }
    };
    let rgba = (0..photograph.rgba.len()).into_par_iter().map(pixel).collect();
    Pixels { rgba, ..photograph }
}

/// Camera and photograph with sides divided by `by`: means of squares of pixels, masked where one of them is. What is left over at the right
/// and below is cut off.
pub fn smaller(photograph: Pixels, camera: &Camera, by: u32) -> (Pixels, Camera) {
    if by <= 1 {
        return (photograph, *camera);
    }
    let factor = by as f64;
    let side = |n: u32| (n / by).max(1);
    let camera = Camera {
        fx: camera.fx / factor,
        fy: camera.fy / factor,
        cx: camera.cx / factor,
        cy: camera.cy / factor,
        width: side(camera.width),
        height: side(camera.height),
        ..*camera
    };
    let (width, height) = (camera.width as usize, camera.height as usize);
    let by = by as usize;
    let rgba = (0..width * height).into_par_iter().map(|index| {
        let (x, y) = (index % width * by, index / width * by);
        let mut sum = [0u32; 4];
        let mut count = 0;
        for (v, u) in
            (y..(y + by).min(photograph.height)).flat_map(|v| (x..(x + by).min(photograph.width)).map(move |u| (v, u)))
        {
            let pixel = photograph.rgba[v * photograph.width + u];
            (0..4).for_each(|c| sum[c] += pixel[c] as u32);
            count += 1;
        }
        let mean = sum.map(|c| ((c + count / 2) / count.max(1)) as u8);
        if sum[3] == 255 * count { mean } else { [0; 4] }
    });
    (Pixels { width, height, rgba: rgba.collect() }, camera)
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::Pose;

    fn camera(width: u32, height: u32) -> Camera {
        let (cx, cy) = (width as f64 / 2.0, height as f64 / 2.0);
        Camera { fx: 50.0, fy: 50.0, cx, cy, width, height, camera_from_world: Pose::IDENTITY }
    }

    fn slope(width: usize, height: usize) -> Pixels {
        let rgba = (0..width * height).map(|i| [(4 * (i % width)) as u8, (4 * (i / width)) as u8, 9, 255]).collect();
        Pixels { width, height, rgba }
    }

    #[test]
    fn a_pixel_shows_what_the_lens_showed() {
        let lens = Distortion { k1: -0.2, k2: 0.05, p1: 0.004, ..Default::default() };
        let out = undistorted(slope(60, 40), &camera(60, 40), &lens);
        let at = DVec2::new(45.5, 10.5);
        let shown = lens.distort((at - DVec2::new(30.0, 20.0)) / 50.0) * 50.0 + DVec2::new(30.0, 20.0);
        let pixel = out.rgba[10 * 60 + 45];
        assert!((pixel[0] as f64 - 4.0 * (shown.x - 0.5)).abs() < 0.6, "{pixel:?} {shown}");
        assert!((pixel[1] as f64 - 4.0 * (shown.y - 0.5)).abs() < 0.6, "{pixel:?} {shown}");
        let pincushion = Distortion { k1: 0.3, ..Default::default() };
        let out = undistorted(slope(60, 40), &camera(60, 40), &pincushion);
        assert_eq!((out.rgba[0][3], out.rgba[20 * 60 + 30][3]), (0, 255));
    }

    #[test]
    fn beyond_the_fold_nothing_is_shown() {
        // r (1 - 0.9 r²) turns over at r = 0.61, 30 pixels from the centre: before that the whole image is shown, mirrored after it.
        let out = undistorted(slope(60, 40), &camera(60, 40), &Distortion { k1: -0.9, ..Default::default() });
        for (index, pixel) in out.rgba.iter().enumerate() {
            let from = DVec2::new((index % 60) as f64 - 29.5, (index / 60) as f64 - 19.5) / 50.0;
            let fold = (1.0f64 / 2.7).sqrt();
            if (from.length() - fold).abs() > 0.02 {
                assert_eq!(pixel[3] == 255, from.length() < fold, "{index} {from}");
            }
        }
    }

    #[test]
    fn smaller_is_the_mean_and_masks_spread() {
        let mut photograph = slope(9, 6);
        photograph.rgba[0][3] = 0;
        let (out, camera) = smaller(photograph, &camera(9, 6), 2);
        assert_eq!((out.width, out.height, camera.width, camera.fx), (4, 3, 4, 25.0));
        assert_eq!((out.rgba[0], out.rgba[1]), ([0; 4], [10, 2, 9, 255]));
    }
}
