//! How many steps help: found on photographs to learn from that are put aside (early stopping on a validation set, Prechelt, *Early
//! Stopping: But When?*, 1998), after which all are learned from with that many.
//!
//! Few photographs are learned by heart: after enough steps they are drawn ever better, and what lies between them ever worse. When that begins
//! depends on the capture, so it is measured. Photographs that are held out to score with have no part in it.

use super::bake::bake;
use super::cameras::as_learned;
use super::dataset::{Dataset, Photograph};
use super::engine::scores;
use super::model::Model;
use super::score::Score;
use crate::SplatError;

/// Fewest photographs to learn from of which some are put aside.
pub const FEWEST: usize = 4;
/// By how much a number of steps is larger than the last one that was looked at.
const GROWTH: f64 = 1.15;
/// Training ends when so many times the best number of steps did no better.
const PATIENCE: f64 = 2.0;
/// Numbers of steps that differ by at most this \[dB\] are as good as each other, and the fewest are taken: two runs of one number differ by more.
const ALIKE: f64 = 0.1;

/// The same capture with every `every`th photograph to learn from, from the second on, held out in the place of those that were; none when
/// there are too few.
pub fn put_aside(dataset: &Dataset, every: usize) -> Option<Dataset> {
    if every == 0 || dataset.training.len() < FEWEST {
        return None;
    }
    // Half of few, so that one at least is aside and two are left.
    let every = every.min(dataset.training.len() / 2).max(2);
    let is_aside = |index: usize| index % every == 1;
    let some = |aside: bool| -> Vec<Photograph> {
        let all = dataset.training.iter().enumerate();
        all.filter(|(index, _)| is_aside(*index) == aside).map(|(_, one)| one.clone()).collect()
    };
    // Extent and background stay, so that a step does the same.
    Some(Dataset { training: some(false), held_out: some(true), ..dataset.clone() })
}

/// Mean PSNR over the photographs that were put aside \[dB\]; exposures are left out of it, their median baked in.
///
/// # Errors
/// Drawing fails.
pub fn judged(mut model: Model, dataset: &Dataset) -> Result<f64, SplatError> {
    let aside: Vec<Photograph> = dataset.held_out.iter().map(|one| as_learned(&model, dataset, one)).collect();
    bake(&mut model, dataset.background);
    let all = scores(&model.cloud, &aside, dataset)?;
    Ok(Score::mean(&all).map_or(f64::NAN, |mean| mean.psnr))
}

/// The search for the number of steps that helps most.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    fewest: u32,
    next: u32,
    /// Steps, and PSNR after them \[dB\].
    pub seen: Vec<(u32, f64)>,
}

impl Search {
    /// Among numbers of at least `fewest`.
    pub fn new(fewest: u32) -> Self {
        Self { fewest, next: fewest, seen: vec![] }
    }

    /// Whether the scene is to be looked at after so many steps.
    pub fn is_time(&self, steps: u32) -> bool {
        steps >= self.next
    }

    /// Takes what was found after so many steps; false when more will not help.
    pub fn see(&mut self, steps: u32, psnr: f64) -> bool {
        self.seen.push((steps, psnr));
        self.next = (f64::from(steps) * GROWTH).ceil() as u32;
        f64::from(steps) < PATIENCE * f64::from(self.best())
    }

    /// The fewest steps after which photographs that are aside were drawn as well as after any number, within `ALIKE`; the fewest of all
    /// where nothing was seen.
    pub fn best(&self) -> u32 {
        // Not a number is worse than anything.
        let most = self.seen.iter().map(|(_, psnr)| *psnr).fold(f64::NEG_INFINITY, f64::max);
        let is_best = |(_, psnr): &&(u32, f64)| *psnr >= most - ALIKE;
        self.seen.iter().find(is_best).map_or(self.fewest, |(steps, _)| *steps)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;

    #[test]
    fn some_are_put_aside_and_nothing_else_changes() {
        let scene = tiny::scene(40, 9, 24);
        let inner = put_aside(&scene.dataset, 4).unwrap();
        let names = |all: &[Photograph]| all.iter().map(|one| one.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&inner.held_out), ["v01", "v05"]);
        assert_eq!((inner.training.len(), inner.extent), (7, scene.dataset.extent));
        assert_eq!(inner.background, scene.dataset.background);
        assert!(put_aside(&scene.dataset, 0).is_none());
        let few = put_aside(&tiny::scene(40, 4, 24).dataset, 8).unwrap();
        assert_eq!((few.training.len(), few.held_out.len()), (2, 2));
        assert!(put_aside(&tiny::scene(40, 3, 24).dataset, 8).is_none());
    }

    #[test]
    fn the_search_ends_when_more_steps_do_no_better() {
        let mut search = Search::new(7000);
        let mut steps = 0;
        // Best after 9000 steps.
        let psnr = |steps: u32| 25.0 - (f64::from(steps) - 9000.0).abs() / 1e4;
        let mut looked = 0;
        loop {
            steps += 100;
            if search.is_time(steps) {
                looked += 1;
                if !search.see(steps, psnr(steps)) {
                    break;
                }
            }
        }
        assert!((8000..=9000).contains(&search.best()), "{search:?}");
        assert!(steps >= 2 * search.best() && steps < 3 * search.best() && looked < 12, "{steps} {looked}");
        assert_eq!(Search::new(7000).best(), 7000);
        // Within a tenth of a decibel more steps are no better.
        let mut flat = Search::new(7000);
        let more: Vec<bool> =
            [(7000, 25.0), (8050, 25.06), (9258, 24.9), (14_000, 25.09)].map(|(n, psnr)| flat.see(n, psnr)).into();
        assert_eq!((flat.best(), more), (7000, vec![true, true, true, false]));
        assert!(flat.see(16_100, 25.2) && flat.best() == 16_100);
        let mut odd = Search::new(7000);
        odd.see(7000, f64::NAN);
        assert_eq!(odd.best(), 7000);
    }

    #[test]
    fn a_scene_is_judged_by_what_it_has_not_learned() {
        let scene = tiny::scene(40, 6, 32);
        let inner = put_aside(&scene.dataset, 3).unwrap();
        let model = Model::new(scene.cloud.clone(), &inner);
        let mut faint = model.clone();
        faint.cloud.opacity_logits.iter_mut().for_each(|logit| *logit -= 3.0);
        let [right, wrong] = [&model, &faint].map(|model| judged(model.clone(), &inner).unwrap());
        assert!(right > wrong + 5.0, "{right} {wrong}");
        let mut exposed = model.clone();
        exposed.exposures.iter_mut().for_each(|e| e[3] += 0.1);
        assert_ne!(judged(exposed, &inner).unwrap(), right, "the median exposure counts");
    }
}
