//! Gains that are not known, from the motion alone: a servo's register holds a number whose unit its maker does not show.
//!
//! Those are taken with which the simulator follows the recording best in windows (output error method; Ljung, System Identification,
//! 1999, section 7.3). One value for all joints, since servos of one kind have one law.

use crate::ReplayError;
use crate::engine::{ReplayOptions, ReplayTrace, simulate};
use qv_recording::run::{Actuator, ActuatorKind, Base, GainSource, Run};
use qv_sim::{Model, Terrain};

/// Position gains that a search begins from \[N m/rad\], lowest and highest: a finger's servo, a leg of a large machine. Each is four
/// times the one before.
const POSITION: [f64; 2] = [0.02, 20_000.0];
/// Velocity gains that it begins from, as times kd / kp \[s\].
const DAMPING: [f64; 5] = [0.0, 0.003, 0.01, 0.03, 0.1];
/// Length of windows of a robot that is held \[s\]: a gain shows in whole motions, and in a short window that starts where the robot is,
/// friction that holds a joint looks like a gain without end. One that walks strays soon: it has the usual windows.
const HELD_WINDOW: f64 = 2.0;
/// Factor of the first step in the neighbourhood of the best, and below which one a search ends.
const STEPS: [f64; 2] = [2.0, 1.01];
/// A velocity gain below this share of the position gain \[s\] is none.
const NO_DAMPING: f64 = 1e-4;
/// 95 % quantile of the chi-squared distribution with one degree of freedom, and the normal deviation that it is of.
const CHI_SQUARED: f64 = 3.841;
const DEVIATIONS: f64 = 1.96;

/// Gains that are tried: position gain \[N m/rad\] and velocity gain \[N m s/rad\].
type Gains = [f64; 2];

/// Finds gains that `run.toml` calls unknown, one value for all joints and all `runs`, which are of one robot, and makes them the runs'. Reports
/// what was found. Does nothing where all gains are stated.
///
/// # Errors
/// The runs cannot be replayed, have no commanded positions, or no gain lets the simulator follow them.
pub fn find_gains(
    runs: &mut [Run],
    model: &Model,
    terrain: &Terrain,
    parameters: &[(String, f64)],
) -> Result<(), ReplayError> {
    let Some(first) = runs.first() else { return Ok(()) };
    let law = first.actuator;
    let wanted = law.gains.map(|known| known == GainSource::Unknown);
    if wanted == [false; 2] || law.kind != ActuatorKind::Pd {
        return Ok(());
    }
    if runs.iter().any(|run| run.commands.position.is_none()) {
        return Err(ReplayError::run("unknown gains", "commanded positions (cmd_pos)", "none"));
    }
    let usual = ReplayOptions { parameters: parameters.to_vec(), ..Default::default() };
    let window = if first.base == Base::Fixed { HELD_WINDOW } else { usual.window };
    let options = ReplayOptions { window, ..usual };
    let search = Search { runs, model, terrain, options: &options, wanted };
    let found = search.best()?;
    let deviations = [0, 1].map(|k| search.deviation(found, k));
    for run in runs {
        for k in (0..2).filter(|k| wanted[*k]) {
            run.actuator.gains[k] = GainSource::Found(deviations[k]);
            let (name, unit) = [("kp", "N m/rad"), ("kd", "N m s/rad")][k];
            let [low, high] = [-1.0, 1.0].map(|s| found.gains[k] * (1.0 + s * DEVIATIONS * deviations[k]).max(0.0));
            run.remarks.push(format!(
                "{name} is stated as unknown: {:.4} {unit} of all joints ({low:.4} to {high:.4}) lets the simulator follow best, and no gain is \
                 identified as an effect",
                found.gains[k]
            ));
        }
        set(&mut run.actuator, found.gains, wanted);
    }
    Ok(())
}

fn set(law: &mut Actuator, gains: Gains, wanted: [bool; 2]) {
    law.kp = if wanted[0] { Some(gains[0]) } else { law.kp };
    law.kd = if wanted[1] { Some(gains[1]) } else { law.kd };
}

/// Gains, and how far the simulator is off with them.
#[derive(Debug, Clone, Copy)]
struct GainTrial {
    gains: Gains,
    /// Squared errors of positions over the variance of each joint's motion, summed over joints, mean over windows.
    loss: f64,
}

struct Search<'a> {
    runs: &'a [Run],
    model: &'a Model,
    terrain: &'a Terrain,
    options: &'a ReplayOptions,
    wanted: [bool; 2],
}

impl Search<'_> {
    fn best(&self) -> Result<GainTrial, ReplayError> {
        let law = self.runs[0].actuator;
        let grown = std::iter::successors(Some(POSITION[0]), |kp| Some(4.0 * kp).filter(|kp| *kp <= POSITION[1]));
        let positions: Vec<f64> = if self.wanted[0] { grown.collect() } else { vec![law.kp.unwrap_or(0.0)] };
        let start = |kp: &f64| -> Vec<Gains> {
            match self.wanted[1] {
                true => DAMPING.iter().map(|time| [*kp, time * kp]).collect(),
                false => vec![[*kp, law.kd.unwrap_or(0.0)]],
            }
        };
        let starts: Vec<Gains> = positions.iter().flat_map(start).collect();
        let mut best = self.lowest(&starts)?;
        let mut factor = STEPS[0];
        while factor > STEPS[1] {
            let next = self.lowest(&self.neighbours(best.gains, factor))?;
            if next.loss < best.loss {
                best = next;
            } else {
                factor = factor.sqrt();
            }
        }
        Ok(best)
    }

    /// Gains a factor away, each alone.
    fn neighbours(&self, gains: Gains, factor: f64) -> Vec<Gains> {
        let mut all = Vec::new();
        for k in (0..2).filter(|k| self.wanted[*k]) {
            for factor in [factor, 1.0 / factor] {
                let mut next = gains;
                next[k] *= factor;
                if k == 1 && next[1] < NO_DAMPING * next[0] {
                    next[1] = if factor > 1.0 { NO_DAMPING * next[0] } else { 0.0 };
                }
                all.push(next);
            }
        }
        all
    }

    fn lowest(&self, all: &[Gains]) -> Result<GainTrial, ReplayError> {
        let tried: Vec<GainTrial> = all.iter().map(|gains| self.tried(*gains)).collect::<Result<_, _>>()?;
        let best = tried.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss)).filter(|t| t.loss.is_finite());
        best.ok_or_else(|| {
            let expected = format!("a gain from {} to {} with which the simulator follows", POSITION[0], POSITION[1]);
            ReplayError::run("unknown gains", expected, "none: it runs away, or no window is whole")
        })
    }

    fn tried(&self, gains: Gains) -> Result<GainTrial, ReplayError> {
        let (mut sum, mut count) = (0.0, 0);
        for run in self.runs {
            let mut run = run.clone();
            run.actuator.gains = [GainSource::Stated; 2];
            set(&mut run.actuator, gains, self.wanted);
            let simulated = simulate(&run, self.model, self.terrain, self.options)?;
            if simulated.windows.ran_away > 0 {
                return Ok(GainTrial { gains, loss: f64::INFINITY });
            }
            let losses = window_losses(&simulated);
            count += losses.len();
            sum += losses.iter().sum::<f64>();
        }
        Ok(GainTrial { gains, loss: if count > 0 { sum / count as f64 } else { f64::INFINITY } })
    }

    /// Standard deviation of a gain as a share of it, the other one held: from how far it may go before the likelihood ratio, windows taken
    /// for independent, says so (profile likelihood; Pawitan, In All Likelihood, 2001, section 3.4).
    fn deviation(&self, best: GainTrial, k: usize) -> f64 {
        if !self.wanted[k] || best.gains[k] == 0.0 {
            return 0.0;
        }
        let windows: usize = self.runs.iter().map(|run| self.windows(run)).sum();
        let joints = self.model.joints.len();
        let is_within = |share: f64| {
            let mut gains = best.gains;
            gains[k] *= 1.0 + share;
            let loss = self.tried(gains).map_or(f64::INFINITY, |t| t.loss);
            ((windows * joints) as f64) * (loss / best.loss).ln() < CHI_SQUARED
        };
        // Doubled until it is too far: within a factor of two is enough of what is itself an estimate.
        let mut share = 0.01;
        while share < 1.0 && is_within(share) {
            share *= 1.4;
        }
        share / DEVIATIONS
    }

    fn windows(&self, run: &Run) -> usize {
        let [first, last] = run.span();
        ((last - first) / self.options.window).floor().max(1.0) as usize
    }
}

/// Of each window. Joints that hardly move, by the whole run, count by the middle joint's motion.
fn window_losses(simulated: &ReplayTrace) -> Vec<f64> {
    let joints = simulated.columns.len();
    let recorded = &simulated.recorded.position;
    let variances: Vec<f64> = (0..joints).map(|j| variance(recorded.iter().skip(j).step_by(joints))).collect();
    let mut sorted = variances.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted[joints / 2].max(f64::MIN_POSITIVE);
    let loss = |window: &super::Window| {
        let first = window.first * joints;
        let pairs = window.trace.position.iter().zip(&recorded[first..]).enumerate();
        let squares = pairs
            .filter(|(_, (_, there))| there.is_finite())
            .map(|(i, (here, there))| (here - there).powi(2) / variances[i % joints].max(middle));
        let steps = window.trace.time.len().max(1) as f64;
        squares.sum::<f64>() / steps
    };
    simulated.windows.windows.iter().map(loss).collect()
}

fn variance<'a>(values: impl Iterator<Item = &'a f64> + Clone) -> f64 {
    let finite = values.filter(|x| x.is_finite());
    let (sum, count) = finite.clone().fold((0.0, 0usize), |(sum, n), x| (sum + x, n + 1));
    let mean = sum / count.max(1) as f64;
    finite.map(|x| (x - mean).powi(2)).sum::<f64>() / count.max(1) as f64
}
