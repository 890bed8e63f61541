//! What comes of the camera. The two are independent evidence: images say nothing of motors, and joints nothing of a camera.

use super::evidence::CameraEvidence;
use super::policy::Policy;
use crate::findings::{RankedEffect, Verdict};

/// Name of no effect in the ranking of the camera.
pub const NONE: &str = "none";
/// Most steps of `Policy::nats` that evidence counts: no more can be distinguished.
const MOST_STEPS: f64 = 60.0;

/// What the evidence of a camera comes to.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraDecision {
    /// The outcome for this interface.
    pub verdict: Verdict,
    /// Effects of the camera and [`NONE`] by score.
    pub ranking: Vec<RankedEffect>,
}

/// Decides on the camera alone.
pub fn decide_camera(camera: &CameraEvidence, policy: &Policy) -> CameraDecision {
    // Without causes the level with them is that without.
    let is_explained = camera.level[1] < policy.camera.explained && !camera.is_scene_off;
    let verdict = match (camera.causes.is_empty(), is_explained) {
        (true, true) => Verdict::NoGap,
        (true, false) => Verdict::Unexplained,
        (false, true) => Verdict::Explained,
        (false, false) => Verdict::PartlyExplained,
    };
    CameraDecision { verdict, ranking: ranking(camera, policy) }
}

/// The verdict on robot and camera together.
pub fn both(robot: Verdict, camera: Verdict) -> Verdict {
    match (robot, camera) {
        (Verdict::NoGap, other) | (other, Verdict::NoGap) => other,
        (a, b) if a == b => a,
        _ => Verdict::PartlyExplained,
    }
}

/// That each effect is there; several can be, so that they need not sum to 1. Evidence counts in steps of `Policy::nats`: beyond any doubt
/// about the model itself odds mean nothing.
fn ranking(camera: &CameraEvidence, policy: &Policy) -> Vec<RankedEffect> {
    let weight = |evidence: f64| (evidence / policy.nats).min(MOST_STEPS).exp();
    let weights = || camera.evidence.iter().map(|(_, evidence)| weight(*evidence));
    // Without an accusation none is likelier than all of them.
    let of_none = if camera.causes.is_empty() { weights().fold(1.0, f64::max) * policy.camera.none } else { 1.0 };
    let total: f64 = of_none + weights().sum::<f64>();
    let one = |(effect, evidence): &(String, f64)| {
        let share = weight(*evidence) / total;
        let is_accused = camera.causes.iter().any(|c| c.effect == *effect);
        let score = if is_accused { share.max(policy.explained) } else { share };
        RankedEffect { effect: effect.clone(), score }
    };
    let mut all: Vec<RankedEffect> = camera.evidence.iter().map(one).collect();
    all.push(RankedEffect { effect: NONE.into(), score: of_none / total });
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_verdicts_make_one() {
        use Verdict::{Explained, NoGap, PartlyExplained, Unexplained};
        assert_eq!(both(NoGap, NoGap), NoGap);
        assert_eq!(both(Explained, NoGap), Explained);
        assert_eq!(both(NoGap, Unexplained), Unexplained);
        assert_eq!(both(Explained, Explained), Explained);
        assert_eq!(both(Unexplained, Explained), PartlyExplained);
    }
}
