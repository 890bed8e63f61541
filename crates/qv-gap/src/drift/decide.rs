//! Which parameters changed: tests of all, corrected for their number, the strongest first and the others beside it.

use super::contrast::{Along, Contrast};
use super::moments::Line;
use super::normal::{quantile, two_sided};
use super::policy::DriftPolicy;
use serde::{Deserialize, Serialize};

/// Standard normal quantile of 0.95: a change that is visible is found so often.
const POWER: f64 = 1.644_853_626_95;
/// Deviations to either side of a 95 % interval.
const CI95: f64 = 1.959_963_984_54;
/// Deviations by which a value may lie where the simulator has none, such as a friction below 0.
const OUTSIDE: f64 = 1.0;

/// Whether a robot has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// No parameter changed by what the recordings show.
    Same,
    /// At least one did.
    Changed,
    /// None did, but the recording shows less than the calibration did.
    Inconclusive,
}

/// One parameter of one part of the robot, then and now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// Effect, such as `motor_strength`.
    pub effect: String,
    /// `all`, or names of joints, legs, links.
    pub scope: Vec<String>,
    /// Axis of the effect.
    pub parameter: String,
    /// Unit of all values of this one.
    pub unit: String,
    /// Value in the calibrated simulator.
    pub then: f64,
    /// Value today.
    pub now: f64,
    /// `now` less `then`.
    pub difference: f64,
    /// 95 % interval of the difference.
    pub ci95: [f64; 2],
    /// Probability of a difference as large without a change.
    pub p: f64,
    /// The same, corrected for the number of parameters that are tested.
    pub p_corrected: f64,
    /// Size of a change that is found in 95 % of recordings like these; `None` where that is beyond the effect's range.
    pub visible: Option<f64>,
    /// What robots of one kind differ by (1 sigma); 0 where they have none of it.
    pub tolerance: f64,
    /// Whether it changed.
    pub changed: bool,
    /// Whether the difference is larger than what robots of one kind differ by, which a policy trained for the kind has to bear.
    pub matters: bool,
}

/// See the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// The answer.
    pub answer: Answer,
    /// The answer in a sentence.
    pub sentence: String,
    /// Parameters that changed, the strongest evidence first, then all others in the order of the library; the others with the changes
    /// taken into account.
    pub parameters: Vec<Difference>,
    /// Parameters that are tested.
    pub tests: usize,
    /// Probability of any false alarm that the tests are made for.
    pub alarm: f64,
    /// Effects that the calibration showed and the recording of today does not.
    pub not_shown: Vec<String>,
    /// Mean squared normalized residual, then and now (1 = noise alone).
    pub levels: [f64; 2],
}

impl Drift {
    /// The parameters that changed.
    pub fn changes(&self) -> impl Iterator<Item = &Difference> {
        self.parameters.iter().filter(|p| p.changed)
    }
}

/// `itself` is the calibration compared with itself, which says what it can show.
pub(super) fn decide(itself: &Contrast, both: &Contrast, policy: &DriftPolicy) -> Drift {
    let tests = both.along.iter().filter(|a| a.curvature > 0.0).count();
    let least = |contrast: &Contrast, k: usize| visible(&contrast.along[k], &contrast.lines[k], policy.alarm, tests);
    let changed = select(both, policy, tests);
    let (sizes, variances, left) = both.beside(&changed).unwrap_or_else(|| (vec![], vec![], both.along.clone()));
    let difference = |k: usize, [size, variance, p, p_corrected]: [f64; 4], is_changed: bool| {
        let line = &both.lines[k];
        let (amount, deviation) = (size * line.step, variance.sqrt() * line.step.abs());
        Difference {
            effect: line.effect.clone(),
            scope: line.scope.clone(),
            parameter: line.parameter.clone(),
            unit: line.unit.clone(),
            then: line.value,
            now: line.value + amount,
            difference: amount,
            ci95: [amount - CI95 * deviation, amount + CI95 * deviation],
            p,
            p_corrected,
            visible: least(both, k),
            tolerance: line.tolerance,
            changed: is_changed,
            matters: is_changed && amount.abs() > line.tolerance,
        }
    };
    let mut parameters = Vec::new();
    for (rank, &k) in changed.iter().enumerate() {
        let p = two_sided(sizes[rank] / variances[rank].sqrt());
        parameters.push(difference(k, [sizes[rank], variances[rank], p, corrected(p, tests, rank)], true));
    }
    let others = (0..both.lines.len()).filter(|k| !changed.contains(k) && left[*k].curvature > 0.0);
    for k in others {
        let along = &left[k];
        let [size, variance] = [along.force / along.curvature, along.spread / along.curvature];
        let p = two_sided(size / variance.sqrt());
        parameters.push(difference(k, [size, variance, p, corrected(p, tests, changed.len())], false));
    }
    let not_shown = not_shown(itself, both, &least, policy.blunter);
    let shows = (0..both.lines.len()).any(|k| least(both, k).is_some());
    let answer = match (changed.is_empty(), not_shown.is_empty() && shows) {
        (false, _) => Answer::Changed,
        (true, true) => Answer::Same,
        (true, false) => Answer::Inconclusive,
    };
    let sentence = sentence(answer, &parameters, &not_shown, tests);
    Drift { answer, sentence, parameters, tests, alarm: policy.alarm, not_shown, levels: both.levels }
}

fn corrected(p: f64, tests: usize, rank: usize) -> f64 {
    (p * tests.saturating_sub(rank).max(1) as f64).min(1.0)
}

/// Lines that changed, each beside those before it: the one that explains most, if it is no chance.
fn select(both: &Contrast, policy: &DriftPolicy, tests: usize) -> Vec<usize> {
    let mut changed: Vec<usize> = Vec::new();
    let mut first = 0.0;
    while changed.len() < policy.most {
        let Some((_, _, left)) = both.beside(&changed) else { break };
        let gain = |k: usize| left[k].force.powi(2) / left[k].curvature;
        let is_sure = |k: usize| {
            let z = (gain(k) / left[k].spread).sqrt();
            is_possible(&both.lines[k], &left[k]) && corrected(two_sided(z), tests, changed.len()) < policy.alarm
        };
        let sure = (0..both.lines.len()).filter(|&k| is_sure(k));
        let Some(best) = sure.max_by(|&a, &b| gain(a).total_cmp(&gain(b)).then(b.cmp(&a))) else { break };
        if changed.is_empty() {
            first = gain(best);
        }
        // A large change is no straight line: what its bend leaves looks like small ones beside it.
        if gain(best) < policy.beside * first {
            break;
        }
        changed.push(best);
    }
    changed
}

/// Whether the simulator has the value that a line changes to.
fn is_possible(line: &Line, along: &Along) -> bool {
    if along.curvature <= 0.0 {
        return false;
    }
    let now = line.value + line.step * along.force / along.curvature;
    let margin = OUTSIDE * line.step.abs() * (along.spread / along.curvature).sqrt();
    (line.bounds[0] - margin..=line.bounds[1] + margin).contains(&now)
}

/// The least change that is found with a probability of 95 %.
fn visible(along: &Along, line: &Line, alarm: f64, tests: usize) -> Option<f64> {
    if along.curvature <= 0.0 {
        return None;
    }
    let deviation = line.step.abs() * (along.spread / along.curvature).sqrt();
    let size = (quantile(alarm / tests.max(1) as f64) + POWER) * deviation;
    (size <= line.furthest).then_some(size)
}

/// Effects, by the part of the robot that shows them best, that are shown by the calibration and by today's recording no longer.
fn not_shown(
    itself: &Contrast,
    both: &Contrast,
    least: &dyn Fn(&Contrast, usize) -> Option<f64>,
    blunter: f64,
) -> Vec<String> {
    let best = |contrast: &Contrast, of: &Line| {
        let same = |k: &usize| contrast.lines[*k].effect == of.effect && contrast.lines[*k].parameter == of.parameter;
        (0..contrast.lines.len()).filter(same).filter_map(|k| least(contrast, k)).min_by(f64::total_cmp)
    };
    let mut names: Vec<String> = Vec::new();
    for line in &itself.lines {
        let Some(then) = best(itself, line) else { continue };
        let is_blunt = best(both, line).is_none_or(|now| now > blunter * then);
        if is_blunt && !names.contains(&line.effect) {
            names.push(line.effect.clone());
        }
    }
    names
}

fn sentence(answer: Answer, parameters: &[Difference], not_shown: &[String], tests: usize) -> String {
    match answer {
        Answer::Same => format!("No change: none of {tests} tested parameters differs from the calibration."),
        Answer::Inconclusive if not_shown.is_empty() => {
            "Inconclusive: no change of any parameter would be visible in these recordings.".into()
        }
        Answer::Inconclusive => {
            format!("Inconclusive: no change was found, but this recording no longer shows {}.", not_shown.join(", "))
        }
        Answer::Changed => {
            let named = parameters.iter().filter(|p| p.changed).map(|p| {
                let (on, unit) = (p.scope.join(", "), if p.unit == "1" { "" } else { p.unit.as_str() });
                let what = format!("{} ({on}): {} {:+.3}", p.effect, p.parameter, p.difference);
                let [low, high] = p.ci95;
                format!("{what} {unit}").trim_end().to_string() + &format!(" (95 % CI {low:+.3} to {high:+.3})")
            });
            format!("Changed: {}.", named.collect::<Vec<_>>().join("; "))
        }
    }
}
