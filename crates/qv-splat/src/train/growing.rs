//! Photographs that grow while training runs: first steps learn from small ones, which cost a quarter as much and show all that few
//! Gaussians can draw. Chen et al., *DashGaussian* (CVPR 2025), let resolution grow with the number of Gaussians; here sides double at fixed
//! shares of the steps.

use super::dataset::{Dataset, Photograph};
use super::undistort::smaller;

/// No side of a photograph gets smaller than this \[px\]: the window of SSIM is 11 px wide.
const LEAST_SIDE: u32 = 64;

/// By what sides are divided, each until some step, the last of which is `iterations`: halves until `share` of the steps, quarters until `share`
/// squared of them, and so on as far as the smallest side of the photographs allows. `share` is 0 (never) to 1.
pub fn stages(dataset: &Dataset, iterations: u32, share: f64) -> Vec<(u32, u32)> {
    let sides = dataset.training.iter().map(|one| one.camera.width.min(one.camera.height));
    let least = sides.min().unwrap_or(0);
    let mut stages = vec![(1, iterations)];
    let (mut factor, mut until) = (2, share.clamp(0.0, 1.0) * f64::from(iterations));
    while least / factor >= LEAST_SIDE && until >= 1.0 {
        stages.push((factor, until as u32));
        (factor, until) = (2 * factor, share * until);
    }
    stages.reverse();
    stages
}

impl Dataset {
    /// The photographs to learn from with sides divided by `by`: colours are means, depths and labels those of the pixel in the middle.
    /// Nothing is held out. Extent and background stay, so that a step does the same.
    pub fn smaller(&self, by: u32) -> Self {
        Self { training: self.training.iter().map(|one| small(one, by)).collect(), ..self.without_photographs() }
    }
}

fn small(one: &Photograph, by: u32) -> Photograph {
    let (pixels, camera) = smaller(one.pixels.clone(), &one.camera, by);
    let (wide, by) = (one.pixels.width, by.max(1) as usize);
    let middle = |index: usize| {
        let (x, y) = (index % pixels.width * by + by / 2, index / pixels.width * by + by / 2);
        y.min(one.pixels.height - 1) * wide + x.min(wide - 1)
    };
    let count = pixels.width * pixels.height;
    Photograph {
        name: one.name.clone(),
        camera,
        depth: picked(&one.depth, count, middle),
        labels: picked(&one.labels, count, middle),
        pixels,
    }
}

/// Values of picked pixels; nothing of nothing.
fn picked<T: Copy>(values: &[T], count: usize, at: impl Fn(usize) -> usize) -> Vec<T> {
    if values.is_empty() { vec![] } else { (0..count).map(|index| values[at(index)]).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;

    #[test]
    fn sides_double_at_shares_of_the_steps() {
        let of = |side: u32, share| stages(&tiny::scene(5, 2, side).dataset, 1000, share);
        assert_eq!(of(300, 0.5), [(4, 250), (2, 500), (1, 1000)]);
        assert_eq!(of(130, 0.5), [(2, 500), (1, 1000)]);
        assert_eq!((of(300, 0.0), of(100, 0.5)), (vec![(1, 1000)], vec![(1, 1000)]));
    }

    #[test]
    fn small_photographs_show_the_same() {
        let mut scene = tiny::scene(5, 2, 9);
        let one = &mut scene.dataset.training[0];
        one.depth = (0..81).map(|k| k as f32).collect();
        one.pixels.rgba[0] = [0; 4];
        let (large, small) = (&scene.dataset, scene.dataset.smaller(2));
        let (from, to) = (&large.training[0], &small.training[0]);
        assert_eq!((to.camera.width, to.camera.height, to.pixels.rgba.len()), (4, 4, 16));
        assert_eq!((to.camera.fx, to.camera.cx), (from.camera.fx / 2.0, from.camera.cx / 2.0));
        assert_eq!(to.pixels.rgba[0][3], 0, "a pixel is masked where one of its four is");
        let mean = (0..4).map(|k| u32::from(from.pixels.rgba[[2, 3, 11, 12][k]][0])).sum::<u32>();
        assert_eq!(u32::from(to.pixels.rgba[1][0]), (mean + 2) / 4);
        assert_eq!((to.depth[0], to.depth[5]), (10.0, 30.0));
        assert!(to.labels.is_empty() && small.held_out.is_empty());
        assert_eq!((small.extent, small.background), (large.extent, large.background));
    }
}
