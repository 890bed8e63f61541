//! A run ahead without effects in our engine: which torques, speeds and places a motion really uses.

/// What a motion uses when nothing is wrong, at 500 Hz.
pub(crate) struct Scout {
    /// Torques \[N m\] in joint order.
    pub torque: Vec<[f64; 12]>,
    /// Speeds \[rad/s\] in joint order.
    pub speed: Vec<[f64; 12]>,
    /// Where the base is, x and y \[m\].
    pub path: Vec<[f64; 2]>,
}

impl Scout {
    /// The value that this share of the samples of these joints stays below.
    pub fn quantile(&self, of: &[[f64; 12]], joints: &[usize], share: f64) -> f64 {
        let mut all: Vec<f64> = of.iter().flat_map(|row| joints.iter().map(|&j| row[j].abs())).collect();
        all.sort_unstable_by(f64::total_cmp);
        let at = (share * all.len() as f64) as usize;
        all.get(at.min(all.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }

    /// Share of the samples of these joints whose torque along the motion is above what a motor gives whose torque of
    /// `effort` \[N m\] falls from `knee` to `zero` \[rad/s\].
    pub(crate) fn over_speed_limit(&self, joints: &[usize], effort: &[f64; 12], knee: f64, zero: f64) -> f64 {
        let mut over = 0;
        for (torque, speed) in self.torque.iter().zip(&self.speed) {
            for &j in joints {
                let left = effort[j] * ((zero - speed[j].abs()) / (zero - knee)).clamp(0.0, 1.0);
                over += usize::from(torque[j] * speed[j] > 0.0 && torque[j].abs() > left + 0.3);
            }
        }
        over as f64 / (self.torque.len() * joints.len()).max(1) as f64
    }

    /// Farthest from the start that the base ever is \[m\].
    pub fn reach(&self) -> f64 {
        let Some([x, y]) = self.path.first().copied() else { return 0.0 };
        self.path.iter().map(|p| (p[0] - x).hypot(p[1] - y)).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_a_made_up_run() {
        let rows = |values: [f64; 4]| values.map(|x| [x; 12]).to_vec();
        let scout = Scout {
            torque: rows([1.0, -2.0, 3.0, 4.0]),
            speed: rows([1.0, -2.0, 5.0, -5.0]),
            path: vec![[1.0, 1.0], [4.0, 5.0], [1.0, 2.0]],
        };
        assert_eq!(scout.quantile(&scout.torque, &[0, 1], 0.5), 3.0);
        assert_eq!(scout.quantile(&scout.torque, &[0], 1.0), 4.0);
        assert_eq!(scout.reach(), 5.0);
        // At 5 rad/s of 4..6 half of 5 N m is left: 3 N m along the motion is over it, 4 N m against it is braking.
        assert_eq!(scout.over_speed_limit(&[0], &[5.0; 12], 4.0, 6.0), 0.25);
    }
}
