//! What firmware does between a command and the motor: low-pass, ramp to each new command, hold at a lower rate, limit on the rate.

use qv_core::JointSeries;

/// A way in which commands are shaped before the motors follow them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A low-pass of first order with this time constant \[s\].
    LowPass(f64),
    /// The mean of the commands of this long \[s\]: a ramp to each new command.
    Ramp(f64),
    /// A new command is taken once in this long \[s\].
    Hold(f64),
    /// Commands change by at most this much \[rad/s\].
    RateLimit(f64),
}

/// Time constants and periods that are tried \[s\].
const TIMES: [f64; 8] = [0.007, 0.01, 0.015, 0.02, 0.03, 0.045, 0.07, 0.1];
/// Step of the grid on which commands are shaped \[s\].
const STEP: f64 = 0.002;

impl Shape {
    /// All that are tried for commands whose speeds are up to `fastest` \[rad/s\].
    pub(super) fn tried(fastest: f64) -> Vec<Self> {
        let mut all: Vec<Self> = TIMES.iter().map(|t| Self::LowPass(*t)).collect();
        all.extend(TIMES.iter().skip(1).map(|t| Self::Ramp(*t)));
        all.extend(TIMES.iter().skip(1).map(|t| Self::Hold(*t)));
        all.extend((1..10).map(|k| Self::RateLimit(fastest * 0.1 * f64::from(k))));
        all
    }

    /// Sizes around this one, for a finer search.
    pub(super) fn around(self) -> Vec<Self> {
        let sizes = [0.8, 0.9, 1.1, 1.25];
        sizes.iter().map(|by| self.sized(self.size() * by)).collect()
    }

    /// Time \[s\], or rate \[rad/s\].
    pub fn size(self) -> f64 {
        match self {
            Self::LowPass(x) | Self::Ramp(x) | Self::Hold(x) | Self::RateLimit(x) => x,
        }
    }

    /// Time constant or period \[s\]; a limit on the rate has none.
    pub(super) fn time(self) -> Option<f64> {
        match self {
            Self::RateLimit(_) => None,
            Self::LowPass(x) | Self::Ramp(x) | Self::Hold(x) => Some(x),
        }
    }

    fn sized(self, size: f64) -> Self {
        match self {
            Self::LowPass(_) => Self::LowPass(size),
            Self::Ramp(_) => Self::Ramp(size),
            Self::Hold(_) => Self::Hold(size),
            Self::RateLimit(_) => Self::RateLimit(size),
        }
    }

    /// What it is, in words.
    pub(super) fn words(self) -> String {
        match self {
            Self::LowPass(t) => format!("a low-pass with a time constant of {:.0} ms", 1e3 * t),
            Self::Ramp(t) => format!("a ramp of {:.0} ms to each command", 1e3 * t),
            Self::Hold(t) => format!("a new command is taken every {:.0} ms", 1e3 * t),
            Self::RateLimit(r) => format!("a limit of {r:.2} rad/s on their rate"),
        }
    }

    /// Its key in `[commands]` of run.toml, and its value.
    pub(super) fn setting(self) -> String {
        match self {
            Self::LowPass(t) => format!("low_pass = {t:.4}"),
            Self::Ramp(t) => format!("ramp = {t:.4}"),
            Self::Hold(t) => format!("hold = {t:.4}"),
            Self::RateLimit(r) => format!("rate_limit = {r:.3}"),
        }
    }

    /// Commands so shaped, on an even grid of 2 ms.
    pub(super) fn of(self, commands: &JointSeries) -> JointSeries {
        let (joints, start) = (commands.joints, commands.time[0]);
        let count = ((commands.time[commands.len() - 1] - start) / STEP) as usize + 1;
        let time: Vec<f64> = (0..count).map(|i| start + STEP * i as f64).collect();
        let mut values: Vec<f64> = time.iter().flat_map(|t| commands.hold(*t + 1e-9)).copied().collect();
        for joint in 0..joints {
            let mut column: Vec<f64> = values.iter().skip(joint).step_by(joints).copied().collect();
            self.shape(&mut column);
            values.iter_mut().skip(joint).step_by(joints).zip(column).for_each(|(value, shaped)| *value = shaped);
        }
        JointSeries { time, values, joints }
    }

    fn shape(self, column: &mut [f64]) {
        let samples = |t: f64| ((t / STEP).round() as usize).max(1);
        let original = column.to_vec();
        match self {
            Self::LowPass(t) => {
                let share = 1.0 - (-STEP / t).exp();
                for i in 1..column.len() {
                    column[i] = column[i - 1] + share * (original[i] - column[i - 1]);
                }
            }
            Self::Ramp(t) => {
                let length = samples(t);
                let mut sum = original[0] * length as f64;
                for i in 0..column.len() {
                    sum += original[i] - original[i.saturating_sub(length)];
                    column[i] = sum / length as f64;
                }
            }
            Self::Hold(t) => {
                let length = samples(t);
                (0..column.len()).for_each(|i| column[i] = original[i - i % length]);
            }
            Self::RateLimit(r) => {
                for i in 1..column.len() {
                    column[i] = column[i - 1] + (original[i] - column[i - 1]).clamp(-r * STEP, r * STEP);
                }
            }
        }
    }
}
