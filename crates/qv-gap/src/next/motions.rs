//! Motions that a robot could make next: from the postures and the speeds that it has shown, so that it can.

use crate::GapError;
use qv_core::JointSeries;
use qv_core::statistics::median;
use qv_recording::Run;
use qv_sim::Model;

/// How long each motion takes \[s\].
const SECONDS: f64 = 12.0;
/// Still at the beginning and at the end of each, and time in which amplitudes rise \[s\].
const STILL: f64 = 0.5;
const RISE: f64 = 0.5;
/// Swing of each joint of a robot on its feet \[rad\]: feet must not lift.
const ON_FEET: f64 = 0.06;
/// Interval of commands where the recording does not show one \[s\].
const INTERVAL: f64 = 0.01;

/// What a motion must stay within.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Least and greatest position of each joint \[rad\]: what was shown, within the model's limits.
    pub position: Vec<[f64; 2]>,
    /// Largest speed \[rad/s\]: what was shown, or the model's limit where that is less.
    pub speed: Vec<f64>,
    /// Largest torque \[N m\] of the model.
    pub torque: Vec<f64>,
    /// Where each joint mostly is \[rad\].
    pub middle: Vec<f64>,
    /// Whether the robot stands on its feet.
    pub on_feet: bool,
}

impl Limits {
    /// Those of a robot that has moved as in `run`.
    ///
    /// # Errors
    /// When joints of the model have no measured positions.
    pub fn of(run: &Run, model: &Model) -> Result<Self, GapError> {
        let measured = run.measured.position.as_ref();
        let series = measured.ok_or_else(|| GapError::run("run", "joint positions", "none"))?;
        let on_feet = matches!(run.base, qv_recording::run::Base::Free);
        let mut limits =
            Self { position: Vec::new(), speed: Vec::new(), torque: Vec::new(), middle: Vec::new(), on_feet };
        for joint in &model.joints {
            let column = run.joint_names.iter().position(|n| *n == joint.name);
            let missing = || GapError::run("run", format!("positions of joint `{}`", joint.name), "none");
            let column = column.ok_or_else(missing)?;
            let mut shown: Vec<f64> = series.column(column).filter(|x| x.is_finite()).collect();
            if shown.is_empty() {
                return Err(missing());
            }
            let mut speeds = speeds(run, series, column);
            let speed = if speeds.is_empty() { joint.velocity } else { quantile(&mut speeds, 0.99) };
            let [low, high] = [0.002, 0.998].map(|share| quantile(&mut shown, share));
            limits.middle.push(median(&mut shown));
            limits.position.push([low.max(joint.lower), high.min(joint.upper)]);
            limits.speed.push(speed.min(joint.velocity));
            limits.torque.push(joint.effort);
        }
        Ok(limits)
    }

    /// Half of the swing that a joint may make, \[rad\].
    fn swing(&self, joint: usize) -> f64 {
        let [low, high] = self.position[joint];
        let room = (high - self.middle[joint]).min(self.middle[joint] - low).max(0.25 * (high - low)).max(0.0);
        if self.on_feet { room.min(ON_FEET) } else { room }
    }
}

/// Sizes of the speeds of a joint, measured or by differences \[rad/s\].
fn speeds(run: &Run, position: &JointSeries, column: usize) -> Vec<f64> {
    let own = run.measured.velocity.as_ref().map(|v| v.column(column).map(f64::abs));
    let mut all: Vec<f64> = own.into_iter().flatten().filter(|x| x.is_finite()).collect();
    if all.is_empty() {
        let places: Vec<f64> = position.column(column).collect();
        let slope = |k: usize| ((places[k + 5] - places[k]) / (position.time[k + 5] - position.time[k])).abs();
        all = (0..places.len().saturating_sub(5)).map(slope).filter(|x| x.is_finite()).collect();
    }
    all
}

/// Commands of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// A word for it.
    pub name: String,
    /// What the robot does, for people.
    pub about: String,
    /// Seconds between commands.
    pub interval: f64,
    /// Commanded positions \[rad\], shape `[T][joints]`, in the model's order.
    pub position: Vec<Vec<f64>>,
    /// Factor of the recording's position gain; 1 where gains cannot be commanded.
    pub gain: f64,
}

impl Motion {
    /// The same motion about its first posture, smaller.
    pub(super) fn smaller(mut self, factor: f64) -> Self {
        let first = self.position.first().cloned().unwrap_or_default();
        for row in &mut self.position {
            row.iter_mut().zip(&first).for_each(|(x, middle)| *x = middle + factor * (*x - middle));
        }
        self
    }
}

/// All motions that come into question. Those that need another gain are there where the recording's commands have gains.
pub fn motions(run: &Run, limits: &Limits) -> Vec<Motion> {
    let stamps = run.commands.position.as_ref().map(|s| qv_recording::median_interval(&s.time));
    let interval = stamps.filter(|x| x.is_finite() && *x > 0.0).unwrap_or(INTERVAL);
    let joints = limits.middle.len();
    let make = |name: &str, about: &str, angle: &dyn Fn(usize, f64) -> f64| {
        let rows = (SECONDS / interval).round() as usize;
        let row = |k: usize| {
            let t = k as f64 * interval;
            let fade = ramp((t - STILL) / RISE) * ramp((SECONDS - STILL - t) / RISE);
            let of = |j: usize| limits.middle[j] + fade * angle(j, (t - STILL).max(0.0));
            (0..joints).map(of).collect()
        };
        let position = (0..rows).map(row).collect();
        Motion { name: name.into(), about: about.into(), interval, position, gain: 1.0 }
    };
    // Swings whose speed stays below a share of what was shown.
    let size = |j: usize, speed_per_size: f64| limits.swing(j).min(0.8 * limits.speed[j] / speed_per_size);
    let turn = std::f64::consts::TAU;
    let mut all = vec![
        make("slow_sweep", "each joint slowly back and forth, one after the other", &|j, t| {
            let own = (SECONDS - 2.0 * STILL) / joints as f64;
            let phase = (t - j as f64 * own) / own;
            if (0.0..1.0).contains(&phase) { size(j, turn / own) * (turn * phase).sin() } else { 0.0 }
        }),
        make("slow_together", "all joints slowly back and forth, each at its own rate", &|j, t| {
            let rate = turn * (0.12 + 0.05 * (j % 4) as f64);
            size(j, rate) * (rate * t + 0.7 * j as f64).sin()
        }),
        make("chirp", "all joints swing from slow to fast, 0.3 to 5 Hz", &|j, t| {
            let (low, high) = (0.3, 5.0);
            let now = low + (high - low) * t / SECONDS;
            let phase = turn * (low * t + 0.5 * (high - low) * t * t / SECONDS) + 0.9 * j as f64;
            size(j, turn * now) * phase.sin()
        }),
        make("holds", "six postures, two seconds each", &|j, t| {
            let at = (t / 2.0).floor() as i64;
            let level = |k: i64| 2.0 * (((k * (5 + 2 * j as i64)).rem_euclid(7)) as f64 / 6.0) - 1.0;
            let share = ramp((t - 2.0 * at as f64) / 0.5);
            size(j, 6.0) * (level(at) * (1.0 - share) + level(at + 1) * share)
        }),
        make("fast", "all joints fast, several rates at once", &|j, t| {
            let rates = [0.7 + 0.11 * (j % 5) as f64, 1.6 + 0.13 * (j % 3) as f64];
            size(j, 2.0 * turn * rates[1]) * rates.iter().map(|f| (turn * f * t + j as f64).sin()).sum::<f64>()
        }),
    ];
    if run.commands.kp.is_some() {
        for name in ["holds", "fast", "slow_together"] {
            let Some(same) = all.iter().find(|m| m.name == name).cloned() else { continue };
            all.push(Motion {
                name: format!("{name}_soft"),
                about: format!("{}, at half of the position gain", same.about),
                gain: 0.5,
                ..same
            });
        }
    }
    all
}

/// The value below which a share of `values` lies. Reorders them.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    let at = ((values.len().max(1) - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// From 0 to 1, smoothly.
fn ramp(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}
