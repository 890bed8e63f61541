//! How far the gap shrinks, in windows that no fit has seen.

use crate::GapError;
use crate::findings::{Gap, JointRmsApart};
use crate::inference::gaussian_evidence::Normal;
use crate::inference::level::mean;
use crate::inference::linearised::{LinearisedProblem, LinearisedWindow};
use crate::inference::search::held_out;
use qv_core::random::SplitMix64;
use qv_fit::linear::squared;
use qv_rollout::Channel;
use qv_rollout::Overrides;
use qv_rollout::Raw;
use qv_rollout::law;

/// Resamplings of the interval.
const RESAMPLINGS: usize = 400;

/// Losses per number of each window, before and under a setting.
pub struct Closure {
    /// Windows, as indices into the study.
    pub windows: Vec<usize>,
    /// Before.
    pub before: Vec<f64>,
    /// Residuals under the setting.
    pub after_raw: Vec<Raw>,
    /// After.
    pub after: Vec<f64>,
    /// What noise alone gives.
    pub floor: f64,
}

/// Simulates the windows that no fit has seen under a setting.
///
/// # Errors
/// When a value means nothing.
pub fn closure(study: &mut LinearisedProblem, setting: &Overrides) -> Result<Closure, GapError> {
    closure_in(study, setting, |seen| seen.window.held_out)
}

/// The same in all windows.
///
/// # Errors
/// When a value means nothing.
pub(crate) fn closure_everywhere(study: &mut LinearisedProblem, setting: &Overrides) -> Result<Closure, GapError> {
    closure_in(study, setting, |_| true)
}

/// Mean loss of the robot as it is in the windows that no fit has seen.
pub(crate) fn held_out_loss(study: &LinearisedProblem) -> f64 {
    let loss = |seen: &LinearisedWindow| {
        let residual = study.whitener(seen).residual(seen.index, &seen.raw);
        squared(&residual) / residual.len() as f64
    };
    let losses: Vec<f64> = study.seen.iter().filter(|s| s.window.held_out && !s.raw.is_empty()).map(loss).collect();
    mean(&losses)
}

/// Share that a setting closes in the windows of the fit.
///
/// # Errors
/// When a value means nothing.
pub fn closed_in_fit(study: &mut LinearisedProblem, setting: &Overrides) -> Result<f64, GapError> {
    Ok(closure_in(study, setting, |seen| !seen.window.held_out)?.closed())
}

/// Log of how much likelier a setting makes the windows that no fit has seen, tolerated deviations integrated out over them, in units of
/// what is left in them.
///
/// # Errors
/// When a value means nothing.
pub(crate) fn held_out_evidence(study: &mut LinearisedProblem, setting: &Overrides) -> Result<f64, GapError> {
    let windows: Vec<usize> = (0..study.seen.len()).filter(|&w| held_out(&study.seen[w]) > 0.0).collect();
    let marginal = study.marginal(held_out)?;
    let under = study.evaluate(std::slice::from_ref(setting), &windows)?.remove(0);
    let nominal: Vec<Option<Normal>> = windows
        .iter()
        .zip(&under)
        // What ran away is left out of both.
        .map(|(&w, n)| n.as_ref().map(|_| study.seen[w].nominal()))
        .collect();
    let [before, after] = [&nominal, &under].map(|n| study.sums(n, &windows, held_out));
    let level = marginal.loss(&after) / after.count.max(1.0);
    Ok(0.5 * (marginal.loss(&before) - marginal.loss(&after)) / level.max(1.0))
}

fn closure_in(
    study: &mut LinearisedProblem,
    setting: &Overrides,
    is_meant: fn(&LinearisedWindow) -> bool,
) -> Result<Closure, GapError> {
    let windows: Vec<usize> = (0..study.seen.len()).filter(|&w| is_meant(&study.seen[w])).collect();
    let after_raw = study.raw(std::slice::from_ref(setting), &windows)?.remove(0);
    let floor = study.floor;
    let (mut kept, mut before, mut after, mut raws) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (&w, raw) in windows.iter().zip(after_raw) {
        if raw.is_empty() {
            continue;
        }
        let seen = &study.seen[w];
        let of = |raw: &Raw| {
            let r = study.whitener(seen).residual(seen.index, raw);
            squared(&r) / r.len() as f64
        };
        kept.push(w);
        before.push(of(&seen.raw));
        after.push(of(&raw));
        raws.push(raw);
    }
    Ok(Closure { windows: kept, before, after, after_raw: raws, floor })
}

impl Closure {
    /// Closed share of all windows.
    pub fn closed(&self) -> f64 {
        share(mean(&self.before), mean(&self.after), self.floor)
    }

    /// How much lower the loss is, and the standard error of that over windows; of its logarithm if `robust`.
    pub fn fall(&self, robust: bool) -> (f64, f64) {
        let of = |(b, a): (&f64, &f64)| if robust { (b / a).ln() } else { b - a };
        let falls: Vec<f64> = self.before.iter().zip(&self.after).map(of).collect();
        let n = falls.len().max(1) as f64;
        let m = mean(&falls);
        let variance = falls.iter().map(|f| (f - m).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        (m, (variance / n).sqrt())
    }

    /// What the law of those actuators leaves that a setting changes, in units of the null, before and under it.
    pub(crate) fn actuator_residual(&self, study: &LinearisedProblem, setting: &Overrides) -> [f64; 2] {
        let joints = &study.rollout.law_joints;
        let concerned: Vec<bool> = joints.iter().map(|&j| law::concerns(&study.rollout, setting, j)).collect();
        let bins = law::bins(&study.rollout);
        let squares = |w: usize, raw: &Raw| {
            let seen = &study.seen[w];
            let all = study.whitener(seen).separate(seen.index, raw).law.into_iter().enumerate();
            all.filter(|(i, _)| concerned[i / bins]).map(|(_, x)| x * x).collect::<Vec<f64>>()
        };
        let before: Vec<f64> = self.windows.iter().flat_map(|&w| squares(w, &study.seen[w].raw)).collect();
        let after: Vec<f64> = self.windows.iter().zip(&self.after_raw).flat_map(|(&w, r)| squares(w, r)).collect();
        [mean(&before), mean(&after)]
    }

    /// The figures of a report.
    pub fn gap(&self, study: &LinearisedProblem, seed: u64) -> Gap {
        let mut random = SplitMix64::of(seed, 77);
        let count = self.before.len();
        let mut shares: Vec<f64> = (0..RESAMPLINGS)
            .map(|_| {
                let (mut before, mut after) = (0.0, 0.0);
                for _ in 0..count {
                    let k = ((random.uniform() * count as f64) as usize).min(count.saturating_sub(1));
                    before += self.before[k] / count as f64;
                    after += self.after[k] / count as f64;
                }
                share(before, after, self.floor)
            })
            .collect();
        shares.sort_by(f64::total_cmp);
        let at = |q: f64| shares[((q * RESAMPLINGS as f64) as usize).min(RESAMPLINGS - 1)];
        let rms = |raws: &mut dyn Iterator<Item = &Raw>| joint_rms(study, raws);
        let windows = self.windows.iter().zip(&self.after_raw);
        let by_window: Vec<[f64; 2]> =
            windows.map(|(&w, after)| [&study.seen[w].raw, after].map(|raw| rms(&mut std::iter::once(raw)))).collect();
        Gap {
            before: mean(&self.before),
            after: mean(&self.after),
            floor: self.floor,
            closed: self.closed(),
            closed_ci95: [at(0.025), at(0.975)],
            closed_in_fit: None,
            unit: "mean squared normalized residual (1 = robot without a fault)".into(),
            heldout: true,
            joint_rms: [rms(&mut self.windows.iter().map(|&w| &study.seen[w].raw)), rms(&mut self.after_raw.iter())],
            joint_rms_apart: JointRmsApart::of(&by_window),
        }
    }
}

/// Below 0 where the loss rises; 0 where there is nothing to close.
fn share(before: f64, after: f64, floor: f64) -> f64 {
    if before <= floor * 1.02 { 0.0 } else { ((before - after) / (before - floor)).min(1.0) }
}

/// Root mean square of the positions' residuals \[rad\].
fn joint_rms(study: &LinearisedProblem, raws: &mut dyn Iterator<Item = &Raw>) -> f64 {
    let bins = study.rollout.cut.bins();
    let (mut sum, mut count) = (0.0, 0usize);
    for raw in raws {
        let mut first = 0;
        for &channel in &study.rollout.channels {
            let width = qv_rollout::channels::width(channel, bins);
            if matches!(channel, Channel::Position(_)) {
                sum += raw.motion[first..first + width].iter().map(|x| x * x).sum::<f64>();
                count += width;
            }
            first += width;
        }
    }
    (sum / count.max(1) as f64).sqrt()
}
