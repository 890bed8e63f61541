//! How far the simulator is from the robot: by joint, leg, phase and time.

use crate::engine::Windows;
use qv_rollout::{Feet, Trace};

/// A foot is loaded above this share of its own 95 % force.
const LOADED_SHARE: f64 = 0.15;

/// Impact lasts so long after a foot is first loaded \[s\].
const IMPACT: f64 = 0.03;

/// Bins of the error over time \[s\].
const TIME_BIN: f64 = 0.5;

/// What a leg is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// On the ground.
    Stance,
    /// In the air.
    Swing,
    /// Just come down.
    Impact,
}

impl Phase {
    /// All phases.
    pub const ALL: [Self; 3] = [Self::Stance, Self::Swing, Self::Impact];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stance => "stance",
            Self::Swing => "swing",
            Self::Impact => "impact",
        }
    }
}

/// Root mean square errors of one joint; NaN where it was not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointErrors {
    /// Position \[rad\].
    pub position: f64,
    /// Velocity \[rad/s\].
    pub velocity: f64,
    /// Torque \[N m\].
    pub torque: f64,
}

/// Error of the base over a whole run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseErrors {
    /// Mean distance \[m\].
    pub position_mean: f64,
    /// Distance at the end \[m\].
    pub position_final: f64,
    /// Difference of heading at the end \[rad\], simulated minus recorded, within a half turn.
    pub yaw_final: f64,
}

/// Position error of the joints of all legs in one phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseErrors {
    /// The phase.
    pub phase: Phase,
    /// Root mean square \[rad\].
    pub position: f64,
    /// Share of the samples.
    pub share: f64,
}

/// Position error of all joints in a stretch of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeErrors {
    /// Start \[s\].
    pub start: f64,
    /// End \[s\].
    pub end: f64,
    /// Root mean square \[rad\].
    pub position: f64,
}

/// All errors of a comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// By joint, in the model's order.
    pub joints: Vec<JointErrors>,
    /// By leg: name and root mean square position error \[rad\].
    pub legs: Vec<(String, f64)>,
    /// By phase; empty without feet.
    pub phases: Vec<PhaseErrors>,
    /// Over time.
    pub times: Vec<TimeErrors>,
    /// Of the base.
    pub base: Option<BaseErrors>,
}

impl Errors {
    /// Mean over the joints of their root mean square position errors \[rad\].
    pub fn position_mean(&self) -> f64 {
        let known: Vec<f64> = self.joints.iter().map(|j| j.position).filter(|x| x.is_finite()).collect();
        if known.is_empty() { f64::NAN } else { known.iter().sum::<f64>() / known.len() as f64 }
    }

    /// Joint with the largest position error.
    pub fn worst(&self) -> usize {
        let key = |j: &usize| if self.joints[*j].position.is_finite() { self.joints[*j].position } else { -1.0 };
        (0..self.joints.len()).max_by(|a, b| key(a).total_cmp(&key(b))).unwrap_or(0)
    }
}

#[derive(Clone, Copy, Default)]
struct Sum {
    square: f64,
    count: usize,
}

impl Sum {
    fn add(&mut self, difference: f64) {
        if difference.is_finite() {
            self.square += difference * difference;
            self.count += 1;
        }
    }

    fn rms(self) -> f64 {
        if self.count == 0 { f64::NAN } else { (self.square / self.count as f64).sqrt() }
    }
}

/// Sums over everything that is compared.
struct ErrorSums {
    position: Vec<Sum>,
    velocity: Vec<Sum>,
    torque: Vec<Sum>,
    legs: Vec<Sum>,
    phases: [Sum; 3],
    times: Vec<Sum>,
}

impl ErrorSums {
    fn new(joints: usize, legs: usize, duration: f64) -> Self {
        let sums = |n: usize| vec![Sum::default(); n];
        Self {
            position: sums(joints),
            velocity: sums(joints),
            torque: sums(joints),
            legs: sums(legs),
            phases: Default::default(),
            times: sums((duration / TIME_BIN).floor() as usize + 1),
        }
    }

    /// Compares sample `k` of `simulated` with sample `i` of `recorded`.
    fn add(&mut self, recorded: &Trace, i: usize, simulated: &Trace, k: usize, feet: &Feet, phases: &[Vec<Phase>]) {
        let n = recorded.joints;
        let bin = ((recorded.time[i] - recorded.time[0]) / TIME_BIN) as usize;
        for j in 0..n {
            let difference = simulated.position[k * n + j] - recorded.position[i * n + j];
            self.position[j].add(difference);
            self.times[bin].add(difference);
            if let Some(foot) = feet.of_joint.get(j).copied().flatten() {
                self.legs[foot].add(difference);
                if let Some(phase) = phases.get(foot).map(|p| p[i]) {
                    self.phases[phase as usize].add(difference);
                }
            }
            if !recorded.velocity.is_empty() {
                self.velocity[j].add(simulated.velocity[k * n + j] - recorded.velocity[i * n + j]);
            }
            if !recorded.torque.is_empty() {
                self.torque[j].add(simulated.torque[k * n + j] - recorded.torque[i * n + j]);
            }
        }
    }

    fn finish(self, start: f64, feet: &Feet, base: Option<BaseErrors>) -> Errors {
        let joint = |j: usize| JointErrors {
            position: self.position[j].rms(),
            velocity: self.velocity[j].rms(),
            torque: self.torque[j].rms(),
        };
        let total: usize = self.phases.iter().map(|s| s.count).sum();
        let phase = |phase: Phase| {
            let sum = self.phases[phase as usize];
            PhaseErrors { phase, position: sum.rms(), share: sum.count as f64 / total as f64 }
        };
        let time = |(bin, sum): (usize, &Sum)| TimeErrors {
            start: start + bin as f64 * TIME_BIN,
            end: start + (bin + 1) as f64 * TIME_BIN,
            position: sum.rms(),
        };
        Errors {
            joints: (0..self.position.len()).map(joint).collect(),
            legs: feet.names.iter().cloned().zip(self.legs.iter().map(|s| s.rms())).collect(),
            phases: if total == 0 { Vec::new() } else { Phase::ALL.map(phase).to_vec() },
            times: self.times.iter().enumerate().filter(|(_, s)| s.count > 0).map(time).collect(),
            base,
        }
    }
}

/// Phase of each foot at each sample, from the recorded foot forces, else those of `simulated` on the same times.
fn phases(recorded: &Trace, simulated: Option<&Trace>, feet: usize) -> Vec<Vec<Phase>> {
    let forces = match simulated {
        _ if !recorded.foot_force.is_empty() => &recorded.foot_force,
        Some(trace) => &trace.foot_force,
        None => return Vec::new(),
    };
    if feet == 0 || forces.len() != recorded.time.len() * feet {
        return Vec::new();
    }
    (0..feet).map(|foot| foot_phases(&recorded.time, forces, foot, feet)).collect()
}

/// Phase of one of `feet` feet at each sample.
pub(super) fn foot_phases(time: &[f64], forces: &[f64], foot: usize, feet: usize) -> Vec<Phase> {
    let mut sorted: Vec<f64> = forces.iter().skip(foot).step_by(feet).copied().filter(|f| f.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let high = sorted.get(sorted.len() * 95 / 100).copied().unwrap_or(0.0);
    let threshold = LOADED_SHARE * high;
    let mut since: Option<f64> = None;
    let mut loaded_before = true;
    (0..time.len())
        .map(|i| {
            let loaded = threshold > 0.0 && forces[i * feet + foot] > threshold;
            if loaded && !loaded_before {
                since = Some(time[i]);
            }
            loaded_before = loaded;
            match since {
                Some(start) if loaded && time[i] - start < IMPACT => Phase::Impact,
                _ if loaded => Phase::Stance,
                _ => Phase::Swing,
            }
        })
        .collect()
}

/// Errors of a trace on the same times as `recorded`.
pub(crate) fn of_trace(recorded: &Trace, simulated: &Trace, feet: &Feet) -> Errors {
    let phases = phases(recorded, Some(simulated), feet.names.len());
    let mut sums = ErrorSums::new(recorded.joints, feet.names.len(), duration(recorded));
    for i in 0..recorded.time.len() {
        sums.add(recorded, i, simulated, i, feet, &phases);
    }
    sums.finish(recorded.time[0], feet, base_errors(recorded, simulated))
}

/// Errors of all windows together.
pub(crate) fn of_windows(recorded: &Trace, windows: &Windows, feet: &Feet) -> Errors {
    let phases = phases(recorded, None, feet.names.len());
    let mut sums = ErrorSums::new(recorded.joints, feet.names.len(), duration(recorded));
    for window in &windows.windows {
        for k in 0..window.trace.time.len() {
            sums.add(recorded, window.first + k, &window.trace, k, feet, &phases);
        }
    }
    sums.finish(recorded.time[0], feet, None)
}

fn duration(trace: &Trace) -> f64 {
    trace.time[trace.time.len() - 1] - trace.time[0]
}

fn base_errors(recorded: &Trace, simulated: &Trace) -> Option<BaseErrors> {
    let both = recorded.base.iter().zip(&simulated.base);
    let distance = |a: &[f64; 7], b: &[f64; 7]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let known: Vec<(&[f64; 7], &[f64; 7])> = both.filter(|(a, b)| distance(a, b).is_finite()).collect();
    let (a, b) = known.last()?;
    let mean = known.iter().map(|(a, b)| distance(a, b)).sum::<f64>() / known.len() as f64;
    let turn = yaw(b) - yaw(a);
    let yaw_final = turn.sin().atan2(turn.cos());
    Some(BaseErrors { position_mean: mean, position_final: distance(a, b), yaw_final })
}

/// Heading of a pose \[rad\].
pub(crate) fn yaw(pose: &[f64; 7]) -> f64 {
    let [_, _, _, w, x, y, z] = *pose;
    (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z))
}
