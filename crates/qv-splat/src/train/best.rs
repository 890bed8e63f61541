//! The best scene so far, for training that is stopped: Gaussians that were just made transparent, or moved elsewhere, draw worse
//! than those of some hundred steps ago.

use super::dataset::Dataset;
use super::engine::taken;
use super::exposure::{Exposure, exposed_image};
use super::model::Model;
use super::motion::Motion;
use super::score::score;
use super::shared::SharedAppearance;
use crate::SplatError;
use qv_core::{GaussianCloud, Pose};

/// Photographs to learn from that a scene is judged by, spread evenly. Those that are held out have no say.
const JUDGES: usize = 3;
/// By how much an earlier scene must be better to be kept instead \[dB\].
const BETTER: f64 = 0.2;

/// The scene that drew photographs best of all that were shown to it.
#[derive(Debug, Clone, Default)]
pub struct Best {
    kept: Option<Snapshot>,
}

/// A scene with the cameras and exposures that belong to it, when it was, and how well it drew.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Steps that had been taken.
    pub iteration: u32,
    /// Mean PSNR over the photographs that it was judged by \[dB\].
    pub psnr: f64,
    /// The Gaussians.
    pub cloud: GaussianCloud,
    poses: Vec<Pose>,
    shared: Vec<SharedAppearance>,
    exposures: Vec<Exposure>,
    motions: Vec<Motion>,
}

impl Snapshot {
    fn of(model: &Model, psnr: f64) -> Self {
        Self {
            iteration: model.iteration,
            psnr,
            cloud: model.cloud.clone(),
            poses: model.poses.clone(),
            shared: model.shared.clone(),
            exposures: model.exposures.clone(),
            motions: model.motions.clone(),
        }
    }

    /// Makes `model` draw as it did then. Training cannot go on from that: what it knows of derivatives is of now.
    pub fn put_into(self, model: &mut Model) {
        model.cloud = self.cloud;
        (model.poses, model.shared, model.exposures) = (self.poses, self.shared, self.exposures);
        model.motions = self.motions;
    }
}

impl Best {
    /// Keeps the scene of `model` if it is the best so far; gives its PSNR \[dB\].
    ///
    /// # Errors
    /// Drawing fails.
    pub fn see(&mut self, model: &Model, dataset: &Dataset) -> Result<f64, SplatError> {
        let psnr = judged(model, dataset)?;
        if self.kept.as_ref().is_none_or(|kept| psnr > kept.psnr) {
            self.kept = Some(Snapshot::of(model, psnr));
        }
        Ok(psnr)
    }

    /// The best scene that was shown, for training that broke down.
    pub fn kept(self) -> Option<Snapshot> {
        self.kept
    }

    /// An earlier scene that is clearly better than that of `model`.
    ///
    /// # Errors
    /// Drawing fails.
    pub fn instead_of(self, model: &Model, dataset: &Dataset) -> Result<Option<Snapshot>, SplatError> {
        let Some(kept) = self.kept else { return Ok(None) };
        let now = judged(model, dataset)?;
        // Not a number is worse than anything.
        Ok(Some(kept).filter(|kept| now.is_nan() || kept.psnr > now + BETTER))
    }
}

/// Mean PSNR over some of the photographs to learn from, with their cameras and exposures as learned \[dB\].
fn judged(model: &Model, dataset: &Dataset) -> Result<f64, SplatError> {
    let count = dataset.training.len();
    let judges: Vec<usize> = (0..count.min(JUDGES)).map(|k| k * count / count.min(JUDGES)).collect();
    let psnr = |&k: &usize| {
        let colour = taken(model, dataset, k)?;
        Ok(score(&exposed_image(&model.exposures[k], &colour), &dataset.training[k]).psnr)
    };
    let all: Vec<f64> = judges.iter().map(psnr).collect::<Result<_, SplatError>>()?;
    Ok(all.iter().sum::<f64>() / all.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;

    #[test]
    fn a_scene_that_was_just_made_transparent_is_not_kept() {
        let tiny = tiny::scene(60, 8, 32);
        let good = Model::new(tiny.cloud.clone(), &tiny.dataset);
        let mut faint = good.clone();
        faint.poses[0].position.x += 1.0;
        faint.exposures[1][0] += 0.5;
        faint.cloud.opacity_logits.iter_mut().for_each(|x| *x -= 4.0);
        faint.iteration = 3000;
        let mut best = Best::default();
        assert_eq!(best.clone().instead_of(&faint, &tiny.dataset).unwrap(), None, "nothing was seen");
        let [psnr, lower] = [&good, &faint].map(|model| best.see(model, &tiny.dataset).unwrap());
        assert!(psnr > lower + 3.0, "{psnr} {lower}");
        let kept = best.clone().instead_of(&faint, &tiny.dataset).unwrap().unwrap();
        assert_eq!((kept.iteration, &kept.cloud), (0, &good.cloud));
        let mut again = faint.clone();
        kept.put_into(&mut again);
        assert_eq!((&again.cloud, &again.poses, &again.exposures), (&good.cloud, &good.poses, &good.exposures));
        assert_eq!(again.iteration, 3000, "training stands where it stood");
        // A little worse is no reason to go back.
        let (mut little, mut before) = (faint.clone(), Best::default());
        little.cloud.opacity_logits.iter_mut().for_each(|x| *x -= 0.01);
        assert!(before.see(&faint, &tiny.dataset).unwrap() > judged(&little, &tiny.dataset).unwrap());
        assert_eq!(before.instead_of(&little, &tiny.dataset).unwrap(), None);
        assert_eq!(best.instead_of(&good, &tiny.dataset).unwrap(), None);
    }
}
