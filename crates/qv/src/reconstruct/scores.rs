//! What held-out photographs say of a scene.

use super::Reconstruct;
use super::watch::beside;
use super::words::{named, of_ground};
use crate::Failure;
use qv_splat::train::{Dataset, Ground, GroundOptions, Model, Photograph, Score, drawn, ground_scores, pose, scores};
use serde_json::Value;

/// Steps by which a held-out camera is aligned.
const ALIGN_STEPS: u32 = 40;

/// Scores of held-out photographs, in their order.
pub(super) struct HeldOutScores {
    /// As the scene is drawn.
    pub drawn: Vec<Score>,
    /// With cameras moved to where they show the left half best; empty where poses are as given.
    pub aligned: Vec<Score>,
    /// Of the ground alone, for metrics.json.
    pub of_ground: Value,
}

impl HeldOutScores {
    pub fn means(&self) -> [Option<Score>; 2] {
        [&self.drawn, &self.aligned].map(|scores| Score::mean(scores))
    }

    /// Each photograph for metrics.json.
    pub fn by_name(&self, dataset: &Dataset) -> Vec<Value> {
        dataset.held_out.iter().zip(&self.drawn).map(|(one, score)| named(&one.name, score)).collect()
    }
}

impl Reconstruct {
    /// Draws held-out photographs with their cameras as learned, and with `--preview` shows them.
    pub(super) fn score(
        &self,
        model: &Model,
        dataset: &Dataset,
        held_out: &[Photograph],
    ) -> Result<HeldOutScores, Failure> {
        let ground = Ground::of(&model.cloud, dataset, &GroundOptions::default())?;
        let ground_alone = match &ground {
            Some(ground) => ground_scores(&model.cloud, dataset, held_out, ground)?,
            None => vec![],
        };
        if self.preview {
            let folder = self.out.join("held_out");
            for photograph in held_out {
                let image = drawn(&model.cloud, &photograph.camera, dataset)?;
                beside(photograph, &image, &folder, &photograph.name)?;
            }
        }
        Ok(HeldOutScores {
            drawn: scores(&model.cloud, held_out, dataset)?,
            aligned: self.aligned(model, dataset, held_out)?,
            of_ground: of_ground(ground.as_ref(), &ground_alone),
        })
    }

    /// Scores of held-out photographs with cameras that were moved to where they show the left half best; none when poses are as given.
    fn aligned(&self, model: &Model, dataset: &Dataset, held_out: &[Photograph]) -> Result<Vec<Score>, Failure> {
        if !self.refine_poses {
            return Ok(vec![]);
        }
        let align = |one: &Photograph| {
            let camera = pose::aligned(&model.cloud, one, dataset, ALIGN_STEPS)?;
            Ok(Photograph { camera, ..one.clone() })
        };
        let moved: Vec<Photograph> = held_out.iter().map(align).collect::<Result<_, Failure>>()?;
        Ok(scores(&model.cloud, &moved, dataset)?)
    }
}
