//! How well a policy follows fixed commands: no noise, the mean action, every robot on its own seeded command.

use crate::PolicyError;
use crate::env::{End, VectorEnv};
use crate::gait::{Gait, GaitMeter, GaitSample, GaitScale};
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
    /// How it walks ahead and stands, see [`judge_gait`]; `None` where nobody looked.
    #[serde(default)]
    pub gait: Option<Gait>,
}

/// What figures of the gait that are outside of their bounds by all of it cost, in m/s of error.
const GAIT_COST: f32 = 0.1;
/// Cost of a gait that nobody looked at: more than of any that was.
const UNKNOWN_GAIT: f32 = 20.0;

impl Score {
    /// One number to compare policies by, less is better: errors in m/s and rad/s, a tenth of [`Gait::cost`], and one for each robot in a
    /// hundred that fell.
    pub fn cost(&self) -> f32 {
        let gait = self.gait.as_ref().map_or(UNKNOWN_GAIT, Gait::cost);
        let errors = self.velocity_error + self.turning_error;
        errors + GAIT_COST * gait + 100.0 * self.fell as f32 / self.robots.max(1) as f32
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
        gait: None,
    })
}

/// Robots that [`judge_gait`] wants.
pub const GAIT_ROBOTS: usize = 16;

/// What robots are commanded to do in the first and in the second half of the time, from rest: six ahead at 0.4 to 0.6 m/s, two of which stop;
/// two that stand; the others along one axis or turning as they go.
fn programme(commands: &Commands) -> [[[f32; 3]; 2]; GAIT_ROBOTS] {
    let [ahead, still] = [0.5, 0.0].map(|vx| [vx, 0.0, 0.0]);
    let half = |[low, high]: [f32; 2], share: f32| if share > 0.0 { share * high } else { -share * low };
    let mut out = [[still; 2]; GAIT_ROBOTS];
    let paths = [
        [[0.4, 0.0, 0.0]; 2],
        [ahead; 2],
        [[0.6, 0.0, 0.0]; 2],
        [ahead; 2],
        [ahead, still],
        [[0.6, 0.0, 0.0], still],
        [still, ahead],
        [still; 2],
        [[half(commands.vx, 0.8), 0.0, 0.0]; 2],
        [[half(commands.vx, -0.8), 0.0, 0.0]; 2],
        [[0.0, half(commands.vy, 0.8), 0.0]; 2],
        [[0.0, half(commands.vy, -0.8), 0.0]; 2],
        [[0.0, 0.0, half(commands.wz, 0.8)]; 2],
        [[0.0, 0.0, half(commands.wz, -0.8)], still],
        [[half(commands.vx, 0.5), 0.0, half(commands.wz, 0.5)]; 2],
        [[half(commands.vx, 0.5), 0.0, half(commands.wz, -0.5)]; 2],
    ];
    let within = |x: f32, [low, high]: [f32; 2]| x.clamp(low.min(0.0), high.max(0.0));
    for (out, path) in out.iter_mut().zip(paths) {
        *out = path.map(|[vx, vy, wz]| [within(vx, commands.vx), within(vy, commands.vy), within(wz, commands.wz)]);
    }
    out
}

/// How a policy walks ahead and stands: [`GAIT_ROBOTS`] robots from rest under commands of one axis within `commands`, for `seconds`. Feet,
/// power and reserve are those of robots that go ahead at about 0.5 m/s; errors and falls are those of all.
///
/// # Errors
/// When the task has fewer robots, or a number is not finite.
pub fn judge_gait(
    mut policy: impl Decide,
    task: &mut VelocityTask,
    commands: &Commands,
    seconds: f32,
    seed: u64,
) -> Result<Gait, PolicyError> {
    let (count, joints) = (task.count(), task.actions());
    if count < GAIT_ROBOTS {
        return Err(PolicyError::setting("robots of a judgement of gait", &format!("at least {GAIT_ROBOTS}"), count));
    }
    task.judged = true;
    task.restart(seed, 0)?;
    let scale = gait_scale(task);
    let mut meters = vec![GaitMeter::new(&scale, task.robot().feet.len()); GAIT_ROBOTS];
    let steps = (seconds * task.settings().rate) as usize;
    let (mut observations, mut privileged) =
        (vec![0.0; count * task.observations()], vec![0.0; count * task.privileged()]);
    let (mut actions, mut rewards, mut ends) = (vec![0.0; count * joints], vec![0.0; count], vec![End::No; count]);
    let mut fallen = [false; GAIT_ROBOTS];
    let programme = programme(commands);
    for step in 0..steps {
        for (env, path) in programme.iter().enumerate() {
            task.command(env, path[usize::from(2 * step >= steps)]);
        }
        task.observe(&mut observations, &mut privileged);
        policy.decide(count, &observations, &mut actions)?;
        (0..GAIT_ROBOTS).filter(|&e| fallen[e]).for_each(|env| actions[env * joints..][..joints].fill(0.0));
        task.step(&actions, &mut rewards, &mut ends)?;
        for (env, meter) in meters.iter_mut().enumerate() {
            if fallen[env] {
                continue;
            }
            fallen[env] = ends[env] == End::Failed;
            if fallen[env] {
                meter.note_fall();
            } else {
                measure(task, env, meter);
            }
        }
    }
    let mut meters = meters.into_iter();
    let mut all = meters.next().unwrap_or_else(|| GaitMeter::new(&scale, 0));
    meters.enumerate().for_each(|(k, meter)| if k < 7 { all.join(meter) } else { all.join_errors(&meter) });
    Ok(all.gait())
}

/// What a meter must know of a task's robot.
pub fn gait_scale(task: &VelocityTask) -> GaitScale {
    let robot = task.robot();
    GaitScale {
        dt: task.settings().dt(),
        mass: robot.model.mass() as f32,
        height: robot.height,
        efforts: robot.model.joints.iter().map(|j| Some(j.effort as f32).filter(|x| x.is_finite())).collect(),
    }
}

/// Gives a meter what one robot of a task did in the last step.
fn measure(task: &VelocityTask, env: usize, meter: &mut GaitMeter) {
    let (joints, feet) = (task.robot().joints(), task.robot().feet.len());
    let (q, v, torques) = task.motion();
    let q = &q[env * (7 + joints)..][..7];
    let v = &v[env * (6 + joints)..][..6 + joints];
    let [ahead, aside, _] = in_heading([q[3], q[4], q[5], q[6]], [v[0], v[1], v[2]]);
    let walker = &task.walkers()[env];
    let touching: Vec<bool> = walker.air.iter().map(|air| *air == 0.0).collect();
    meter.add(&GaitSample {
        command: walker.command,
        velocity: [ahead, aside, v[5]],
        peaks: &task.peaks()[env * feet..][..feet],
        touching: &touching,
        torques: &torques[env * joints..][..joints],
        speeds: &v[6..],
    });
}

/// Mean and its standard error, both zero of no values.
pub fn mean_with_error(values: &[f64]) -> [f64; 2] {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    [mean, (variance / count).sqrt()]
}
