//! What commands a robot takes.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// From the base's origin to the tail \[m\].
pub const TAIL: f64 = 0.30;

/// Limits of commands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Least and greatest speed forwards \[m/s\].
    pub forwards: [f64; 2],
    /// Greatest speed to either side \[m/s\].
    pub sideways: f64,
    /// Greatest turning rate \[rad/s\].
    pub turning: f64,
    /// Greatest changes of a command from one decision to the next: \[m/s\], \[m/s\], \[rad/s\].
    pub change: [f64; 3],
}

impl Default for Limits {
    fn default() -> Self {
        Self { forwards: [-0.2, 0.6], sideways: 0.3, turning: 1.0, change: [0.3, 0.3, 1.0] }
    }
}

impl Limits {
    /// A command as shares of its limits, -1 to 1: what the network puts out.
    pub fn shares(&self, command: [f64; 3]) -> [f32; 3] {
        let [low, high] = self.forwards;
        let ahead = (2.0 * command[0] - low - high) / (high - low);
        [ahead, command[1] / self.sideways, command[2] / self.turning].map(|x| x.clamp(-1.0, 1.0) as f32)
    }

    /// The command of such shares.
    pub fn command(&self, shares: [f32; 3]) -> [f64; 3] {
        let [low, high] = self.forwards;
        let [a, b, c] = shares.map(|x| f64::from(x).clamp(-1.0, 1.0));
        [0.5 * (low + high + a * (high - low)), b * self.sideways, c * self.turning]
    }

    /// The nearest command within them.
    pub fn clamped(&self, [ahead, aside, turning]: [f64; 3]) -> [f64; 3] {
        [
            ahead.clamp(self.forwards[0], self.forwards[1]),
            aside.clamp(-self.sideways, self.sideways),
            turning.clamp(-self.turning, self.turning),
        ]
    }

    /// The command that follows `last` when `wanted` is asked for.
    pub fn limited(&self, last: [f64; 3], wanted: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| wanted[k].clamp(last[k] - self.change[k], last[k] + self.change[k]))
    }
}

/// A command (forwards, to the left \[m/s\], turning \[rad/s\]) under which a point `along` before the base \[m\] goes at `least` \[m/s\] along `out`, a
/// unit vector in base axes. What is lacking is made up along `out`, sideways by turning where there is a lever.
pub(crate) fn give_way([ahead, aside, turning]: [f64; 3], along: f64, out: DVec2, least: f64) -> [f64; 3] {
    let lack = least - DVec2::new(ahead, aside + turning * along).dot(out);
    if lack <= 0.0 {
        return [ahead, aside, turning];
    }
    let (ahead, sideways) = (ahead + lack * out.x, lack * out.y);
    if along == 0.0 {
        [ahead, aside + sideways, turning]
    } else {
        [ahead, aside + 0.5 * sideways, turning + 0.5 * sideways / along]
    }
}
