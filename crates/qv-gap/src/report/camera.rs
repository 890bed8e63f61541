//! What the camera shows in a report: a part of its own, causes and shares among those of the robot.

use super::{Cause, Gap, RankedEffect, Report, Share, Sight, Verdict, VisualGap};
use crate::decision::evidence::CameraEvidence;
use crate::decision::{CameraDecision, NONE, both};

impl Sight {
    /// What was decided on evidence.
    pub fn new(camera: &CameraEvidence, decision: &CameraDecision) -> Self {
        let CameraDecision { verdict, ranking } = decision.clone();
        let score = |effect: &str| ranking.iter().find(|r| r.effect == effect).map_or(0.0, |r| r.score);
        let cause = |cause: &Cause| Cause { score: score(&cause.effect), ..cause.clone() };
        let causes: Vec<Cause> = camera.causes.iter().map(cause).collect();
        let CameraEvidence { photographs, size, gap, level, evidence, shared, noise, cannot_tell, .. } = camera.clone();
        let sentence = sentence(verdict, &causes, &gap, photographs);
        Self { verdict, sentence, photographs, size, gap, level, causes, ranking, evidence, shared, noise, cannot_tell }
    }
}

/// Adds what the camera says to what the rest of the robot says.
///
/// Each keeps its causes and their probabilities; the verdict is that of both, and `where` has the camera's share of what both exceed their
/// null by. The gap that is reported is that of the robot, or the camera's when the robot has none.
pub fn join(report: &mut Report, sight: Sight) {
    let robot = if report.verdict == Verdict::NoGap { 0.0 } else { (report.gap.before - report.gap.floor).max(1e-3) };
    let camera = if sight.verdict == Verdict::NoGap { 0.0 } else { (sight.level[0] - 1.0).max(1e-3) };
    let share = if robot + camera > 0.0 { camera / (robot + camera) } else { 0.0 };
    for interface in &mut report.place.interfaces {
        interface.share *= 1.0 - share;
    }
    match report.place.interfaces.iter_mut().find(|i| i.name == "visual") {
        Some(visual) => visual.share += share,
        None => report.place.interfaces.push(Share { name: "visual".into(), share }),
    }
    if robot == 0.0 && camera > 0.0 {
        let of = &sight.gap;
        report.gap = Gap {
            before: of.before,
            after: of.after,
            floor: of.floor,
            closed: of.closed,
            closed_ci95: of.closed_ci95,
            closed_in_fit: None,
            unit: of.unit.clone(),
            heldout: of.heldout,
            joint_rms: report.gap.joint_rms,
            joint_rms_apart: report.gap.joint_rms_apart,
        };
        report.unexplained.share = 1.0 - of.closed;
    }
    report.sentence = format!("{} {}", report.sentence, sight.sentence);
    report.verdict = both(report.verdict, sight.verdict);
    let excludes_pose_delay = excludes_pose_delay(report);
    for cause in &sight.causes {
        let mut cause = cause.clone();
        // A late pose shows against the IMU; where it does not, only the camera's clock is left.
        cause.confusable_with.retain(|name| name != "pose_delay" || !excludes_pose_delay);
        report.causes.push(cause);
    }
    report.causes.sort_by(|a, b| b.score.total_cmp(&a.score));
    // One list for both, whose probabilities are those within the part of the gap that is theirs.
    report.ranking.iter_mut().for_each(|r| r.score *= 1.0 - share);
    let of_camera = sight.ranking.iter().filter(|r| r.effect != NONE);
    let total: f64 = of_camera.clone().map(|r| r.score).sum::<f64>().max(1.0);
    report.ranking.extend(of_camera.map(|r| RankedEffect { effect: r.effect.clone(), score: share * r.score / total }));
    report.ranking.sort_by(|a, b| b.score.total_cmp(&a.score));
    report.cannot_tell.extend(sight.cannot_tell.iter().cloned());
    if !sight.causes.is_empty() {
        report.next.push("Use `calibrated_camera.toml` as the camera, and diagnose again.".into());
    }
    report.visual = Some(sight);
}

/// Whether the rest of the robot could have shown a late pose, and did not.
fn excludes_pose_delay(report: &Report) -> bool {
    let judged = report.ranking.iter().any(|r| r.effect == "pose_delay");
    let accused = report.causes.iter().any(|c| c.effect == "pose_delay");
    judged && !accused && !report.cannot_show.iter().any(|effect| effect == "pose_delay")
}

fn sentence(verdict: Verdict, causes: &[Cause], gap: &VisualGap, photographs: usize) -> String {
    let names: Vec<String> = causes.iter().map(|c| c.effect.replace('_', " ")).collect();
    let closed = format!("closes {:.0} % of what {photographs} images and the scene are apart", 100.0 * gap.closed);
    match verdict {
        Verdict::NoGap => format!("In {photographs} images the camera sees what the scene shows."),
        Verdict::Unexplained => {
            "The camera does not see what the scene shows, and no effect of a camera explains it.".into()
        }
        Verdict::Explained => format!("Of the camera, {} {closed}.", names.join(" and ")),
        Verdict::PartlyExplained => {
            format!("Of the camera, {} {closed}; something else is there, too.", names.join(" and "))
        }
    }
}
