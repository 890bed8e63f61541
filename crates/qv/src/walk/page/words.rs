//! The verdict in plain words.

use super::measures::{Measures, mean};
use qv_policy::play::WalkTrace;
use qv_policy::score::Score;

/// Swings of quadrupeds that walk on real ground \[s\]: shorter ones are a tremble, longer ones fall from foot to foot.
const SWING: [f32; 2] = [0.2, 0.35];
/// What a foot must clear on a lawn or over a door sill \[m\].
const CLEARANCE: f32 = 0.04;
/// Share of a torque limit above which nothing is left for a stumble.
const TORQUE: f32 = 0.9;
/// Share of zigzag targets from which a motor shakes: a quarter of what noise alone gives, see [`super::measures`].
const ZIGZAG: f32 = 0.1;
/// Share of the time with all feet on the ground that is a stand: what is left allows for steps that correct it.
const STAND: f32 = 0.9;
/// Errors below this share of the commands are close to them.
const CLOSE: f32 = 0.2;
/// Errors above it are not following.
const ROUGH: f32 = 0.5;

/// What is said about a policy.
pub struct Verdict {
    /// One sentence.
    pub headline: String,
    /// Sentences with numbers.
    pub sentences: Vec<String>,
    /// What speaks against a robot, a sentence each.
    pub against: Vec<String>,
}

/// Says how well the policy of `robot` walks.
pub fn verdict(robot: &str, score: Option<&Score>, played: &WalkTrace, measures: &Measures) -> Verdict {
    let sentences = score.map(scored).into_iter().chain(gait(measures)).collect();
    Verdict { headline: headline(robot, played, measures), sentences, against: against(score, played, measures) }
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
        None => return format!("{robot} was told to stand, and does not fall."),
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

fn against(score: Option<&Score>, played: &WalkTrace, measures: &Measures) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(s) = score.filter(|s| s.fell > 0) {
        out.push(format!("{} of {} robots fell.", s.fell, s.robots));
    }
    if let Some([time, height]) = swing(score, measures) {
        let [low, high] = SWING;
        if time < low || time > high {
            let how = if time < low { "short" } else { "long" };
            out.push(format!("Swings are too {how}: {time:.2} s, wanted {low} to {high} s."));
        }
        if height < CLEARANCE {
            let [found, wanted] = [height, CLEARANCE].map(|h| 100.0 * h);
            out.push(format!("Feet are lifted too little: {found:.1} cm, wanted at least {wanted:.0} cm."));
        }
    }
    if let Some(stands) = measures.stands.filter(|stands| *stands < STAND) {
        let percent = 100.0 * stands;
        out.push(format!("Told to stand, it steps: all feet are on the ground for {percent:.0} % of that time."));
    }
    let share = |joint: usize| measures.joints[joint].limit.map(|limit| measures.joints[joint].high / limit);
    let worst = (0..measures.joints.len()).filter_map(|j| Some((share(j)?, j))).max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((share, joint)) = worst.filter(|(share, _)| *share > TORQUE) {
        let (name, percent) = (&played.joints[joint], 100.0 * share);
        out.push(format!(
            "Torque comes to its limit: one percent of the time {name} has more than {percent:.0} % of it."
        ));
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
        "Nothing here speaks against it: swings last {} to {} s, feet clear {:.0} cm, torques stay below {:.0} % of their limits, joints do not shake.",
        SWING[0],
        SWING[1],
        100.0 * CLEARANCE,
        100.0 * TORQUE
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::walk::example::made_up;

    #[test]
    fn a_good_gait_is_praised_and_a_bad_one_is_not() {
        let played = made_up(500);
        let measures = Measures::new(&played);
        let said = verdict("go2", None, &played, &measures);
        assert_eq!(said.headline, "go2 walks and follows its commands closely.");
        assert!(said.against.is_empty(), "{:?}", said.against);
        let score = Score { robots: 64, fell: 2, swing_time: 0.1, swing_height: 0.01, ..Default::default() };
        let said = verdict("go2", Some(&score), &played, &measures);
        assert_eq!(said.against.len(), 3, "{:?}", said.against);
        assert!(said.sentences[0].states("fell 2") && said.against[1].states("short 0.10"));
    }

    #[test]
    fn torque_at_its_limit_a_fall_and_shaking_are_told() {
        let mut played = made_up(200);
        played.torques.iter_mut().for_each(|t| t[3] = 23.0);
        played.targets.iter_mut().enumerate().for_each(|(k, t)| t.fill(if k % 2 == 0 { 0.1 } else { -0.1 }));
        played.commands.iter_mut().skip(100).for_each(|command| *command = [0.0; 3]);
        played.fell = Some(199);
        let said = verdict("go2", None, &played, &Measures::new(&played));
        assert_eq!(said.headline, "go2 falls after 4.0 s.");
        assert!(said.against[0].starts_with("Told to stand, it steps: all feet are on the ground for "));
        assert!(said.against[1].states("FR_hip_joint 97"), "{:?}", said.against);
        assert!(said.against[2].states("Joints 100"));
    }
}
