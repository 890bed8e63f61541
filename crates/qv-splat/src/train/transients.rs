//! What moves through a capture: people, cars, shadows that are in one photograph and in no other. Scenes are still, so they leave residuals in
//! their photograph, which are outliers among those of all photographs (robust training: Sabour et al., *RobustNeRF*, CVPR 2023; Sabour et al.,
//! *SpotLessSplats*, 2024). Pixels that show them are left out of the loss of their photograph.
//!
//! A photograph is divided into square cells. The residual of a cell is the difference of the means over its pixels of drawn and photographed
//! colours: texture that is not drawn yet has a small one, something that stands in the way a large one. Drawn colours are multiplied first
//! by the median over cells of the quotient of both, the exposure that all cells have in common. As in RobustNeRF a cell is an outlier
//! beyond a quantile of all residuals, and counts with its neighbours; two things keep what is merely not learned yet from being left out:
//!
//! - Of a residual is taken what is usual for the Gaussians that the camera has in the cell: the median over them of the median over all
//!   photographs that each is in. A place that is drawn badly everywhere does not move, and where there is no Gaussian nothing is known.
//! - The quantile is a scale: seeds are cells above `SEED` times the `SCALE` quantile and above `LEAST`. So nothing need be left out.
//!
//! A region is what is connected to a seed and above half of it. Small ones stay. Cells beside a region stay, too: what is left out of a scene
//! that few photographs show costs more than what is left of a person's edge.

use super::dataset::{Dataset, Photograph};
use glam::DVec3;
use qv_core::Camera;
use qv_core::statistics::median;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Cells along the longer side of a photograph, and the least side of a cell \[px\].
const CELLS: u32 = 64;
const LEAST_SIDE: u32 = 4;
/// Quantile of the residuals of all photographs that they are measured by.
const SCALE: f64 = 0.75;
/// Residual of a seed, in units of it.
const SEED: f32 = 4.0;
/// Least residual of a seed, 0 to 1.
const LEAST: f32 = 0.1;
/// Most Gaussians that are asked what is usual, and fewest photographs that one must be in.
const MOST_GAUSSIANS: usize = 40_000;
const FEWEST_PHOTOGRAPHS: usize = 3;
/// Fewest cells of a region, as a share of those of the photograph.
const FEWEST: f64 = 0.005;
/// Most of the cells of a photograph that are left out: a photograph that is wrong all over has another fault.
const MOST: f64 = 0.5;

/// Residuals of the cells of a photograph, shape `[height, width]`: the mean over colours of their size, 0 to 1; NaN where fewer than half of
/// the pixels count.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Residuals {
    width: usize,
    height: usize,
    cells: Vec<f32>,
}

/// Cells of a photograph that are left out.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Mask {
    /// Cells in a row.
    pub width: usize,
    /// Rows of cells.
    pub height: usize,
    /// Whether each is left out, shape `[height, width]`.
    pub cells: Vec<bool>,
}

impl Mask {
    /// Share of the cells that are left out.
    pub fn share(&self) -> f64 {
        self.cells.iter().filter(|out| **out).count() as f64 / self.cells.len().max(1) as f64
    }

    /// The photograph without what is left out, whatever its size.
    pub fn masked(&self, photograph: &Photograph) -> Photograph {
        let mut out = photograph.clone();
        let [width, height] = [out.pixels.width, out.pixels.height];
        for (at, pixel) in out.pixels.rgba.iter_mut().enumerate() {
            let cell = at / width * self.height / height * self.width + at % width * self.width / width;
            if self.cells.get(cell).copied().unwrap_or(false) {
                pixel[3] = 0;
            }
        }
        out
    }
}

/// Photographs to learn from without what is left out; none where there are no masks.
pub(crate) fn masked(dataset: &Dataset, masks: &[Mask]) -> Vec<Photograph> {
    dataset.training.iter().zip(masks).map(|(one, mask)| mask.masked(one)).collect()
}

/// Residuals of a photograph that is drawn as `colour`, shape `[height, width, 3]`, with its exposure.
pub(crate) fn residuals(colour: &[f32], photograph: &Photograph) -> Residuals {
    let [wide, high] = [photograph.pixels.width, photograph.pixels.height];
    let side = (wide.max(high) / CELLS as usize).max(LEAST_SIDE as usize);
    let [width, height] = [wide, high].map(|pixels| (pixels / side).max(1));
    let mut sums = vec![[[0.0f32; 3]; 2]; width * height];
    let (mut counts, mut pixels) = (vec![0u32; width * height], vec![0u32; width * height]);
    for (at, (drawn, wanted)) in colour.chunks_exact(3).zip(&photograph.pixels.rgba).enumerate() {
        let cell = at / wide * height / high * width + at % wide * width / wide;
        pixels[cell] += 1;
        if wanted[3] > 0 {
            (0..3).for_each(|c| sums[cell][0][c] += drawn[c].clamp(0.0, 1.0));
            (0..3).for_each(|c| sums[cell][1][c] += f32::from(wanted[c]) / 255.0);
            counts[cell] += 1;
        }
    }
    let all: Vec<usize> = (0..width * height).filter(|cell| 2 * counts[*cell] >= pixels[*cell].max(1)).collect();
    let gains = [0, 1, 2].map(|c| {
        let ratio = |cell: &usize| f64::from((sums[*cell][1][c] + 1e-3) / (sums[*cell][0][c] + 1e-3));
        median(&mut all.iter().map(ratio).collect::<Vec<_>>()) as f32
    });
    let mut cells = vec![f32::NAN; width * height];
    for cell in all {
        let apart = |c: usize| (gains[c] * sums[cell][0][c] - sums[cell][1][c]).abs() / counts[cell] as f32;
        cells[cell] = (0..3).map(apart).sum::<f32>() / 3.0;
    }
    Residuals { width, height, cells }
}

/// What is left out of each photograph: cells with residuals far above what the Gaussians in them have in other photographs. `cameras` are
/// those of the photographs.
pub(crate) fn masks(means: &[[f32; 3]], cameras: &[Camera], all: &[Residuals]) -> Vec<Mask> {
    let all = &beyond_usual(means, cameras, all);
    let mut values: Vec<f32> = all.iter().flat_map(|one| &one.cells).copied().filter(|x| x.is_finite()).collect();
    if values.is_empty() {
        return vec![Mask::default(); all.len()];
    }
    let at = (SCALE * (values.len() - 1) as f64) as usize;
    let scale = *values.select_nth_unstable_by(at, f32::total_cmp).1;
    let seed = (SEED * scale).max(LEAST);
    all.iter().map(|one| mask(one, seed)).collect()
}

/// Residuals less those that are usual for the Gaussians in each cell: the median over Gaussians of the median over the photographs that they
/// are in. NaN where no Gaussian says what is usual, so that what nobody has learned yet is not taken for something that moves.
fn beyond_usual(means: &[[f32; 3]], cameras: &[Camera], all: &[Residuals]) -> Vec<Residuals> {
    let step = means.len().div_ceil(MOST_GAUSSIANS).max(1);
    let some: Vec<DVec3> = means.iter().step_by(step).map(|mean| DVec3::from(mean.map(f64::from))).collect();
    let usual_of = |mean: &DVec3| {
        let mut seen: Vec<f64> = vec![];
        for (camera, one) in cameras.iter().zip(all) {
            let residual = cell_of(camera, one, *mean).map_or(f32::NAN, |cell| one.cells[cell]);
            if residual.is_finite() {
                seen.push(f64::from(residual));
            }
        }
        if seen.len() < FEWEST_PHOTOGRAPHS { f64::NAN } else { median(&mut seen) }
    };
    let usual: Vec<f64> = some.par_iter().map(usual_of).collect();
    let beyond = |(camera, one): (&Camera, &Residuals)| {
        let mut of_cells = vec![vec![]; one.cells.len()];
        for (mean, usual) in some.iter().zip(&usual).filter(|(_, usual)| usual.is_finite()) {
            if let Some(cell) = cell_of(camera, one, *mean) {
                of_cells[cell].push(*usual);
            }
        }
        // The median of nothing is no number.
        let cells = one.cells.iter().zip(&mut of_cells).map(|(residual, usual)| residual - median(usual) as f32);
        Residuals { cells: cells.collect(), ..*one }
    };
    cameras.par_iter().zip(all).map(beyond).collect()
}

/// The cell in which a camera sees a point.
fn cell_of(camera: &Camera, of: &Residuals, point: DVec3) -> Option<usize> {
    let p = camera.camera_from_world.transform_point(point);
    let (u, v) = (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let inside = p.z > 0.0 && (0.0..width).contains(&u) && (0.0..height).contains(&v);
    let place = |at: f64, side: f64, cells: usize| ((at / side * cells as f64) as usize).min(cells - 1);
    inside.then(|| place(v, height, of.height) * of.width + place(u, width, of.width))
}

fn mask(of: &Residuals, seed: f32) -> Mask {
    let mut out = Mask { width: of.width, height: of.height, cells: vec![false; of.cells.len()] };
    let mut known = vec![false; of.cells.len()];
    for first in 0..of.cells.len() {
        let is_seed = of.cells[first] > seed;
        if known[first] || !is_seed {
            continue;
        }
        let region = region(of, first, 0.5 * seed, &mut known);
        if region.len() as f64 >= FEWEST * of.cells.len() as f64 {
            region.iter().for_each(|cell| out.cells[*cell] = true);
        }
    }
    if out.share() > MOST { Mask { cells: vec![false; of.cells.len()], ..out } } else { out }
}

/// Cells that are connected to the first one and have residuals above `least`.
fn region(of: &Residuals, first: usize, least: f32, known: &mut [bool]) -> Vec<usize> {
    known[first] = true;
    let (mut region, mut next) = (vec![], VecDeque::from([first]));
    while let Some(cell) = next.pop_front() {
        region.push(cell);
        for beside in around(of, cell) {
            if !known[beside] && of.cells[beside] > least {
                known[beside] = true;
                next.push_back(beside);
            }
        }
    }
    region
}

/// A cell and those that touch it.
fn around(of: &Residuals, cell: usize) -> Vec<usize> {
    let (column, row) = (cell % of.width, cell / of.width);
    let rows = row.saturating_sub(1)..=(row + 1).min(of.height - 1);
    let columns = column.saturating_sub(1)..=(column + 1).min(of.width - 1);
    rows.flat_map(|row| columns.clone().map(move |column| row * of.width + column)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::start::of_points;
    use super::super::{CpuEngine, Engine, Model, Score, TrainOptions, scores, tiny, train};
    use super::*;
    use crate::files::Points;

    const SIDE: usize = 64;

    /// Puts a disc into each photograph to learn from, elsewhere and in another colour in each; gives which pixels it covers.
    fn pass(dataset: &mut Dataset) -> Vec<Vec<bool>> {
        let one = |(k, photograph): (usize, &mut Photograph)| {
            let at = |speed: f32| 0.5 + 0.15 * (speed * (k as f32 + 1.0)).sin();
            let [x, y] = [at(1.7), at(2.9)].map(|x| x * SIDE as f32);
            let colour = [2.3, 4.1, 5.9].map(|speed| (255.0 * (at(speed) - 0.35) / 0.3) as u8);
            let covers = |pixel: &usize| {
                let (u, v) = ((pixel % SIDE) as f32 + 0.5 - x, (pixel / SIDE) as f32 + 0.5 - y);
                u * u + v * v < (0.14 * SIDE as f32).powi(2)
            };
            let covered: Vec<bool> = (0..SIDE * SIDE).map(|pixel| covers(&pixel)).collect();
            for (pixel, _) in photograph.pixels.rgba.iter_mut().zip(&covered).filter(|(_, covers)| **covers) {
                *pixel = [colour[0], colour[1], colour[2], 255];
            }
            covered
        };
        dataset.training.iter_mut().enumerate().map(one).collect()
    }

    fn learned(dataset: &Dataset, cloud: &qv_core::GaussianCloud, transients: bool) -> (f64, Model) {
        let options = TrainOptions { iterations: 1000, cap: 400, transients, sh_degree: 1, ..Default::default() };
        let places: Vec<[f32; 3]> = cloud.means.iter().map(|mean| mean.map(|x| x + 0.03 * (9.0 * x).sin())).collect();
        let points = Points { colours: vec![[0.5; 3]; places.len()], places, ..Default::default() };
        let mut engine =
            CpuEngine::new(dataset, &options, Model::new(of_points(&points, &options).unwrap(), dataset)).unwrap();
        train(&mut engine, dataset.training.len(), 1000, 0, 100, &mut |_, _| Ok(true)).unwrap();
        let model = engine.model().unwrap();
        (Score::mean(&scores(&model.cloud, &dataset.held_out, dataset).unwrap()).unwrap().psnr, model)
    }

    #[test]
    fn what_passes_is_left_out_and_a_still_scene_stays() {
        let all = tiny::scene(120, 24, SIDE as u32);
        let clean = Dataset { background: [0.0; 3], ..Dataset::of_photographs(all.dataset.training, 8).unwrap() };
        let mut passed = clean.clone();
        let covered = pass(&mut passed);
        let (still, kept) = learned(&clean, &all.cloud, true);
        let [(harmed, _), (robust, found)] = [false, true].map(|masks| learned(&passed, &all.cloud, masks));
        let (mut hits, mut count) = (0, 0);
        for (mask, (one, covered)) in found.masks.iter().zip(passed.training.iter().zip(&covered)) {
            let masked = mask.masked(one);
            for (pixel, _) in masked.pixels.rgba.iter().zip(covered).filter(|(_, covers)| **covers) {
                hits += usize::from(pixel[3] == 0);
                count += 1;
            }
        }
        let hit = hits as f64 / count as f64;
        println!(
            "nothing passes {still:.2} dB; discs {harmed:.2}, with masks {robust:.2} dB, {hit:.3} of them left out"
        );
        assert!(kept.masks.iter().all(|mask| mask.share() == 0.0), "a still scene loses nothing");
        assert!(robust > harmed + 0.4 && hit > 0.6, "{harmed} {robust} {still} {hit}");
    }
}
