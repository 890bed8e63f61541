//! The camera's part of a report.

use crate::Sight;
use qv_gap::report::{Gap, Part, Ranked, Report, Share, Verdict};

/// Adds what the camera says to what the rest of the robot says.
///
/// The two are independent evidence: images say nothing of motors, and joints nothing of a camera. Each keeps its causes and their
/// probabilities; the verdict is that of both, and `where` has the camera's share of what both exceed their null by. The gap
/// that is told is that of the robot, or the camera's when the robot has none.
pub fn join(report: &mut Report, sight: &Sight) {
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
    report.causes.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    // One list for both, whose probabilities are those within the part of the gap that is theirs.
    report.ranking.iter_mut().for_each(|r| r.probability *= 1.0 - share);
    let of_camera = sight.ranking.iter().filter(|r| r.effect != "none");
    let total: f64 = of_camera.clone().map(|r| r.probability).sum::<f64>().max(1.0);
    report
        .ranking
        .extend(of_camera.map(|r| Ranked { effect: r.effect.clone(), probability: share * r.probability / total }));
    report.ranking.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    report.cannot_tell.extend(sight.cannot_tell.iter().cloned());
    if !sight.causes.is_empty() {
        report.next.push("Use `calibrated_camera.toml` as the camera, and diagnose again.".into());
    }
    report.visual = Some(Part::new(sight));
}

/// Whether the rest of the robot could have shown a late pose, and did not.
fn excludes_pose_delay(report: &Report) -> bool {
    let judged = report.ranking.iter().any(|r| r.effect == "pose_delay");
    let accused = report.causes.iter().any(|c| c.effect == "pose_delay");
    judged && !accused && !report.cannot_show.iter().any(|effect| effect == "pose_delay")
}

fn both(robot: Verdict, camera: Verdict) -> Verdict {
    match (robot, camera) {
        (Verdict::NoGap, other) | (other, Verdict::NoGap) => other,
        (a, b) if a == b => a,
        _ => Verdict::PartlyExplained,
    }
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
