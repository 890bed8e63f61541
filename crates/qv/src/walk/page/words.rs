//! The verdict in plain words.

use super::measures::{Measures, mean};
use qv_policy::gait::{Check, verdict as fitness};
use qv_policy::play::WalkTrace;
use qv_policy::score::Score;

/// What a foot must clear on a lawn or over a door sill \[m\].
const CLEARANCE: f32 = 0.04;
/// Share of zigzag targets from which a motor shakes: a quarter of what noise alone gives, see [`super::measures`].
const ZIGZAG: f32 = 0.1;
/// Errors below this share of the commands are close to them.
const CLOSE: f32 = 0.2;
/// Errors above it are not following.
const ROUGH: f32 = 0.5;

/// What is said about a policy.
#[derive(Debug)]
pub struct Verdict {
    /// One sentence.
    pub headline: String,
    /// Sentences with numbers.
    pub sentences: Vec<String>,
    /// What speaks against a robot, a sentence each.
    pub against: Vec<String>,
}

/// Says how well the policy of `robot` walks.
pub fn verdict(
    robot: &str,
    score: Option<&Score>,
    played: &WalkTrace,
    measures: &Measures,
    checks: &[Check],
) -> Verdict {
    let sentences = score.map(scored).into_iter().chain(gait(measures)).chain([fitness_sentence(checks)]).collect();
    Verdict { headline: headline(robot, played, measures), sentences, against: against(score, measures, checks) }
}

fn fitness_sentence(checks: &[Check]) -> String {
    let text = fitness(checks);
    text[..1].to_uppercase() + &text[1..] + "."
}

fn headline(robot: &str, played: &WalkTrace, measures: &Measures) -> String {
    let seconds = |steps: usize| steps as f32 / played.rate.max(1e-3);
    if let Some(step) = played.fell {
        return format!("{robot} falls after {:.1} s.", seconds(step + 1));
    }
    if played.q.is_empty() {
        return "Nothing was played.".into();
    }
    let walks = measures.walks();
    let how = match measures.off {
        Some(off) if off < CLOSE => "follows its commands closely",
        Some(off) if off < ROUGH => "follows its commands roughly",
        Some(_) => "hardly follows its commands",
        None => return format!("{robot} was commanded to stand, and does not fall."),
    };
    let does = if walks { "walks" } else { "does not step with all its feet" };
    format!("{robot} {does} and {how}.")
}

fn scored(score: &Score) -> String {
    let fell = match score.fell {
        0 => "none fell".into(),
        1 => "one fell".into(),
        n => format!("{n} fell"),
    };
    format!(
        "Of {} robots under commands drawn at random {fell}. Velocity is off by {:.3} ± {:.3} m/s, turning by {:.3} ± {:.3} rad/s (mean and \
         standard error over robots).",
        score.robots, score.velocity_error, score.velocity_error_se, score.turning_error, score.turning_error_se
    )
}

fn gait(measures: &Measures) -> Option<String> {
    let time = mean(measures.swings().map(|s| s.time))?;
    let height = mean(measures.swings().map(|s| s.height))?;
    Some(format!("In the play below a swing lasts {time:.2} s and lifts a foot by {:.1} cm.", 100.0 * height))
}

/// Swing time and clearance: of the score, which saw more robots and commands, else of the play.
fn swing(score: Option<&Score>, measures: &Measures) -> Option<[f32; 2]> {
    let scored = score.filter(|s| s.swing_time > 0.0).map(|s| [s.swing_time, s.swing_height]);
    let seen = mean(measures.swings().map(|s| s.time)).zip(mean(measures.swings().map(|s| s.height)));
    scored.or(seen.map(|(time, height)| [time, height]))
}

fn against(score: Option<&Score>, measures: &Measures, checks: &[Check]) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(s) = score.filter(|s| s.fell > 0) {
        out.push(format!("{} of {} robots fell.", s.fell, s.robots));
    }
    for check in checks.iter().filter(|check| !check.passes()) {
        let value = check.value.map_or("not measured".into(), |x| format!("{x:.2} {}", check.unit));
        out.push(format!("{}: {}, wanted {}.", check.quantity, value.trim_end(), check.bound_text()));
    }
    if let Some([_, height]) = swing(score, measures).filter(|[_, height]| *height < CLEARANCE) {
        let [found, wanted] = [height, CLEARANCE].map(|h| 100.0 * h);
        out.push(format!("Feet are lifted too little: {found:.1} cm, wanted at least {wanted:.0} cm."));
    }
    if measures.zigzag > ZIGZAG {
        let percent = 100.0 * measures.zigzag;
        out.push(format!("Joints shake: {percent:.0} % of the targets turn back again and again (noise alone: 42 %)."));
    }
    out
}

/// What an empty list of objections means.
pub fn in_favour() -> String {
    format!(
        "Nothing here speaks against it: all figures of the gait are within their bounds, feet clear {:.0} cm, joints do not shake.",
        100.0 * CLEARANCE
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::walk::example::made_up;

    #[test]
    fn a_limp_and_a_fall_are_objections() {
        let played = made_up(500);
        let measures = Measures::new(&played);
        let names = played.feet.clone();
        let checks: Vec<Check> = measures.gait.checks(&names).into_iter().filter(Check::passes).collect();
        let said = verdict("go2", None, &played, &measures, &checks);
        assert_eq!(said.headline, "go2 walks and follows its commands closely.");
        assert!(said.against.is_empty(), "{:?}", said.against);
        assert!(said.sentences.iter().any(|s| s == "Fit to try on hardware: yes."), "{:?}", said.sentences);
        let score = Score { robots: 64, fell: 2, swing_time: 0.1, swing_height: 0.01, ..Default::default() };
        let mut limp = measures.gait.clone();
        limp.feet[0].duty = 0.2;
        limp.duty_spread = Some(0.4);
        let checks: Vec<Check> = limp.checks(&names);
        let said = verdict("go2", Some(&score), &played, &measures, &checks);
        assert!(said.sentences[0].states("fell 2") && said.against.iter().any(|s| s.states("duty 0.20")), "{said:?}");
        assert!(said.sentences.iter().any(|s| s.starts_with("Fit to try on hardware: no, because ")));
    }

    #[test]
    fn shaking_and_a_fall_are_reported() {
        let mut played = made_up(200);
        played.targets.iter_mut().enumerate().for_each(|(k, t)| t.fill(if k % 2 == 0 { 0.1 } else { -0.1 }));
        played.fell = Some(199);
        let said = verdict("go2", None, &played, &Measures::new(&played), &[]);
        assert_eq!(said.headline, "go2 falls after 4.0 s.");
        assert!(said.against[0].states("Joints 100"), "{:?}", said.against);
    }
}
