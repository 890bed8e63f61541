//! How well a policy follows fixed commands: no noise, the mean action, every robot on its own seeded command.

use crate::PolicyError;
use crate::env::{End, VectorEnv};
use crate::velocity::{Commands, VelocityTask, in_heading};
use qv_core::random::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

/// Means over robots of means over time, from one second after the start on, until a robot falls. One that falls before counts as one that
/// lies still.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Robots.
    pub robots: usize,
    /// Robots that fell.
    pub fell: usize,
    /// Length of the difference between velocity and command in the horizontal plane \[m/s\].
    pub velocity_error: f32,
    /// Its standard error over robots.
    pub velocity_error_se: f32,
    /// Size of the difference of the turning rate \[rad/s\].
    pub turning_error: f32,
    /// Its standard error over robots.
    pub turning_error_se: f32,
    /// Mean time of a swing \[s\].
    pub swing_time: f32,
    /// Mean highest point of a swing \[m\].
    pub swing_height: f32,
}

impl Score {
    /// One number to compare policies by, less is better: errors in m/s and rad/s, and one for each robot in a hundred that fell.
    pub fn cost(&self) -> f32 {
        self.velocity_error + self.turning_error + 100.0 * self.fell as f32 / self.robots.max(1) as f32
    }
}

/// What decides: targets for all robots from their observations.
pub trait Decide {
    /// Actions `[rows][actions]` for observations `[rows][observations]`, unscaled.
    ///
    /// # Errors
    /// When an output is not finite.
    fn decide(&mut self, rows: usize, observations: &[f32], actions: &mut [f32]) -> Result<(), PolicyError>;
}

/// Runs all robots of `task` for `seconds` under commands drawn with `seed` from `commands`.
///
/// # Errors
/// When a number is not finite or the simulator refuses something.
pub fn score(
    mut policy: impl Decide,
    task: &mut VelocityTask,
    commands: &Commands,
    seconds: f32,
    seed: u64,
) -> Result<Score, PolicyError> {
    let settle = task.settings().rate as usize;
    if !((seconds * task.settings().rate) as usize > settle && seconds <= 1e4) {
        return Err(PolicyError::setting("seconds of a score", "more than 1, at most 10000", seconds));
    }
    for (what, range) in [("vx", commands.vx), ("vy", commands.vy), ("wz", commands.wz)] {
        if !range.iter().all(|x| x.abs() <= 100.0) {
            return Err(PolicyError::setting(what, "-100 to 100", format!("{range:?}")));
        }
    }
    task.judged = true;
    task.restart(seed, 0)?;
    let (count, joints) = (task.count(), task.actions());
    let mut random = Xoshiro256PlusPlus::of(seed, 21, 0);
    for env in 0..count {
        let command = [commands.vx, commands.vy, commands.wz].map(|[low, high]| random.between(low, high));
        task.command(env, command);
    }
    let steps = (seconds * task.settings().rate) as usize;
    let (mut observations, mut privileged) =
        (vec![0.0; count * task.observations()], vec![0.0; count * task.privileged()]);
    let (mut actions, mut rewards, mut ends) = (vec![0.0; count * joints], vec![0.0; count], vec![End::No; count]);
    let mut fallen = vec![false; count];
    let mut errors = vec![[0.0f64; 3]; count];
    task.figures();
    for step in 0..steps {
        task.observe(&mut observations, &mut privileged);
        policy.decide(count, &observations, &mut actions)?;
        // Who fell lies still.
        fallen.iter().enumerate().filter(|(_, f)| **f).for_each(|(env, _)| actions[env * joints..][..joints].fill(0.0));
        task.step(&actions, &mut rewards, &mut ends)?;
        for env in 0..count {
            fallen[env] |= ends[env] == End::Failed;
            if step < settle || fallen[env] {
                continue;
            }
            let (q, v, _) = task.motion();
            let q = &q[env * (7 + joints)..][..7];
            let v = &v[env * (6 + joints)..][..6];
            let [ahead, aside, _] = in_heading([q[3], q[4], q[5], q[6]], [v[0], v[1], v[2]]);
            let [vx, vy, wz] = task.walkers()[env].command;
            let off = (ahead - vx).hypot(aside - vy);
            let sums = &mut errors[env];
            *sums = [sums[0] + 1.0, sums[1] + f64::from(off), sums[2] + f64::from((v[5] - wz).abs())];
        }
    }
    let figures = task.figures();
    let figure = |name: &str| figures.iter().find(|(n, _)| *n == name).map_or(0.0, |(_, x)| *x);
    // Who fell within the first second counts as one that lies still.
    let lying = |env: usize, k: usize| {
        let [vx, vy, wz] = task.walkers()[env].command;
        f64::from(if k == 1 { vx.hypot(vy) } else { wz.abs() })
    };
    let of = |(env, e): (usize, &[f64; 3]), k: usize| if e[0] > 0.0 { e[k] / e[0] } else { lying(env, k) };
    let each = |k: usize| -> Vec<f64> { errors.iter().enumerate().map(|pair| of(pair, k)).collect() };
    let narrow = |k: usize| mean_with_error(&each(k)).map(|x| x as f32);
    let ([velocity_error, velocity_error_se], [turning_error, turning_error_se]) = (narrow(1), narrow(2));
    let fell = fallen.iter().filter(|f| **f).count();
    let (swing_time, swing_height) = (figure("swing_time"), figure("swing_height"));
    Ok(Score {
        robots: count,
        fell,
        velocity_error,
        velocity_error_se,
        turning_error,
        turning_error_se,
        swing_time,
        swing_height,
    })
}

/// Mean and its standard error, both zero of no values.
pub fn mean_with_error(values: &[f64]) -> [f64; 2] {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    [mean, (variance / count).sqrt()]
}
