//! Depth from several photographs, where none was measured: multi-view stereo.
//!
//! For each photograph: a few others chosen by angle and overlap (`views`); normalised cross-correlation with them on planes that are
//! uniform in inverse depth (`sweep`; Collins 1996), the better half of the others counting (Kang, Szeliski, Chai 2001); semi-global
//! aggregation (`aggregate`; Hirschmüller 2008). A depth counts where depths of other photographs agree (`agree`; Merrell et al. 2007);
//! everything else is not measured. `docs/guide/reconstruction.md` has the equations.
//!
//! The same photographs give the same bits on any number of threads.

mod aggregate;
mod agree;
mod options;
mod sweep;
#[cfg(test)]
mod tests;
mod views;

pub use options::StereoOptions;

use crate::SplatError;
use crate::error::off;
use crate::files::Points;
use crate::train::Dataset;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use views::{View, median};

/// What was measured.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StereoDepth {
    /// Photographs that had no depth, and were looked at.
    pub photographs: usize,
    /// Share of their pixels that have a depth now.
    pub share: f64,
    /// Median number of planes.
    pub planes: usize,
    /// Median distance of two planes, as a share of the depth in the middle of the range.
    pub step: f64,
}

/// Fewest photographs to learn from: a depth of one must be confirmed by two others.
const FEWEST: usize = 3;

/// Measures depth of photographs to learn from that have none, and leaves that of others alone. `points` of the scene show how far it
/// reaches and which photographs show the same; without them the extent of the cameras does. `done` is reported how many of how many
/// photographs are compared.
///
/// # Errors
/// There are fewer than three photographs to learn from, or none has enough others that show the same from another place.
pub fn measure(
    dataset: &mut Dataset,
    points: Option<&Points>,
    options: &StereoOptions,
    done: &(dyn Fn(usize, usize) + Sync),
) -> Result<StereoDepth, SplatError> {
    let place = "stereo";
    let count = dataset.training.len();
    let expected = || format!("at least {FEWEST} images to learn from that show the same from different places");
    if count < FEWEST {
        return Err(off(place, expected(), count));
    }
    let views: Vec<View> = views::all(dataset, points, options);
    let usable = views.iter().filter(|view| view.neighbours.len() >= options.agreeing).count();
    if usable < FEWEST {
        return Err(off(place, expected(), format!("{usable} of {count}")));
    }
    let compared = AtomicUsize::new(0);
    let one = |view: &View| {
        let map = if view.neighbours.len() < options.agreeing {
            vec![0.0; view.grey.len()]
        } else {
            let costs = sweep::costs(view, &views, options);
            aggregate::winners(view, &costs, options)
        };
        done(compared.fetch_add(1, Ordering::Relaxed) + 1, count);
        map
    };
    // In inverse depth, 0 where there is none. Each photograph is the work of one thread.
    let maps: Vec<Vec<f32>> = views.par_iter().map(one).collect();
    let agreed: Vec<Vec<f32>> =
        (0..count).into_par_iter().map(|index| agree::agreed(index, &views, &maps, options)).collect();
    let mut remarks = StereoDepth::default();
    let (mut measured, mut pixels) = (0, 0);
    let (mut planes, mut steps) = (vec![], vec![]);
    for ((photograph, view), map) in dataset.training.iter_mut().zip(&views).zip(agreed) {
        if photograph.depth.iter().any(|z| *z > 0.0) {
            continue;
        }
        photograph.depth = view.at_full_size(&map, photograph);
        remarks.photographs += 1;
        measured += photograph.depth.iter().filter(|z| **z > 0.0).count();
        pixels += photograph.depth.len();
        planes.push(view.planes);
        steps.push(f64::from(view.step / view.inverse_depth(0.5 * (view.planes - 1) as f32)));
    }
    remarks.share = measured as f64 / pixels.max(1) as f64;
    remarks.planes = median(&mut planes, |a, b| a.cmp(b)).unwrap_or(0);
    remarks.step = median(&mut steps, f64::total_cmp).unwrap_or(0.0);
    Ok(remarks)
}
