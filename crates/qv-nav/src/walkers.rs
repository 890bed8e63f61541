//! Legs that walk: the 50 Hz policy of a robot in the simulator, under the commands of the navigation. Robot, policy, ground, corrections and
//! compensator are the caller's.

use crate::NavError;
use crate::legs::{Legs, Motion, Past, Start, TICK, TICKS, check_starts};
use glam::{DQuat, DVec3};
use qv_core::Pose;
use qv_policy::env::{End, VectorEnv};
use qv_policy::score::Decide;
use qv_policy::velocity::{TaskRobot, VelocityTask};
use qv_sim::State;

/// Makes the mean velocity what is commanded. A walking policy stands when it is commanded to creep, and weak motors walk slower than reported: what is lacking
/// is summed up and added to the command. A robot has the measured velocity from its odometry; here it is the true one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Trim {
    /// Added now: forwards, to the left \[m/s\], turning \[rad/s\].
    added: [f64; 3],
}

impl Trim {
    /// Share of what is lacking that is added within a second.
    const RATE: f64 = 1.5;
    /// Most that is added.
    const MOST: [f64; 3] = [0.3, 0.2, 0.6];

    /// The command for the walking policy after a tick in which the robot moved as `measured` (heading axes), where `wanted` is to be followed. One that
    /// is to stand is left alone.
    pub fn command(&mut self, wanted: [f64; 3], measured: [f64; 3]) -> [f64; 3] {
        if wanted.iter().all(|x| x.abs() < 1e-3) {
            *self = Self::default();
            return wanted;
        }
        std::array::from_fn(|k| {
            let next = self.added[k] + TICK * Self::RATE * (wanted[k] - measured[k]);
            self.added[k] = next.clamp(-Self::MOST[k], Self::MOST[k]);
            wanted[k] + self.added[k]
        })
    }
}

/// Velocity of a base in its heading's axes, forwards and to the left \[m/s\], and its turning rate about the vertical \[rad/s\], from a velocity in the
/// world and one of turning in the base.
pub fn moving(base: &Pose, linear: DVec3, turning: DVec3) -> [f64; 3] {
    let ahead = glam::DVec2::from_angle(base.yaw());
    let linear = linear.truncate();
    [linear.dot(ahead), linear.dot(ahead.perp()), (base.rotation * turning).z]
}

/// Simulated robots that walk under a policy. Their bits do not depend on the number of threads.
pub struct Walkers<'a> {
    task: VelocityTask,
    policy: Box<dyn Decide + 'a>,
    robots: Vec<One>,
    observations: Vec<f32>,
    privileged: Vec<f32>,
    actions: Vec<f32>,
    rewards: Vec<f32>,
    ends: Vec<End>,
}

/// What is kept of one robot.
#[derive(Debug, Clone, Default)]
struct One {
    past: Past,
    gyro: [f64; 3],
    fell: bool,
    wanted: [f64; 3],
    measured: [f64; 3],
    trim: Trim,
}

impl<'a> Walkers<'a> {
    /// As many robots as `task` has, on its ground, with its parameters and its compensator. Nothing is drawn and nobody is pushed.
    ///
    /// # Errors
    /// When the policy does not decide 50 times a second.
    pub fn new(mut task: VelocityTask, policy: Box<dyn Decide + 'a>) -> Result<Self, NavError> {
        let rate = task.settings().rate;
        if (f64::from(rate) * TICK - 1.0).abs() > 1e-6 {
            return Err(NavError::value("rate of the walking policy", &format!("{} Hz", 1.0 / TICK), rate));
        }
        task.judged = true;
        task.varied = false;
        let count = task.count();
        Ok(Self {
            policy,
            robots: vec![One::default(); count],
            observations: vec![0.0; count * task.observations()],
            privileged: vec![0.0; count * task.privileged()],
            actions: vec![0.0; count * task.actions()],
            rewards: vec![0.0; count],
            ends: vec![End::No; count],
            task,
        })
    }

    /// One decision of the walking policy.
    fn tick(&mut self) -> Result<(), NavError> {
        let joints = self.task.actions();
        for (env, robot) in self.robots.iter_mut().enumerate() {
            let command = robot.trim.command(robot.wanted, robot.measured);
            self.task.command(env, command.map(|x| x as f32));
        }
        self.task.observe(&mut self.observations, &mut self.privileged);
        self.policy.decide(self.robots.len(), &self.observations, &mut self.actions)?;
        for (robot, actions) in self.robots.iter().zip(self.actions.chunks_exact_mut(joints)) {
            if robot.fell {
                actions.fill(0.0);
            }
        }
        self.task.step(&self.actions, &mut self.rewards, &mut self.ends)?;
        let (q, v, _) = self.task.motion();
        let rows = q.chunks_exact(7 + joints).zip(v.chunks_exact(6 + joints)).zip(&self.ends);
        for (robot, ((q, v), end)) in self.robots.iter_mut().zip(rows) {
            let base = pose(q);
            let v: [f64; 6] = std::array::from_fn(|k| f64::from(v[k]));
            robot.gyro = [v[3], v[4], v[5]];
            robot.measured = moving(&base, DVec3::new(v[0], v[1], v[2]), DVec3::from(robot.gyro));
            robot.past.push(base);
            robot.fell |= *end == End::Failed;
        }
        Ok(())
    }
}

impl Legs for Walkers<'_> {
    fn count(&self) -> usize {
        self.robots.len()
    }

    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError> {
        check_starts(starts, self.robots.len())?;
        self.task.restart(0, 0)?;
        for (env, start) in starts.iter().enumerate() {
            let ground = &self.task.ground();
            let height = |x: f64, y: f64| ground.height(x as f32, y as f32, f32::MAX).map(f64::from);
            let state = standing(self.task.robot(), start, height)?;
            self.task.batch_mut().set_state(env, &state)?;
            let q: Vec<f32> = state.q.iter().map(|&x| x as f32).collect();
            let mut robot = One::default();
            robot.past.begin(pose(&q));
            self.robots[env] = robot;
        }
        self.robots[starts.len()..].fill(One::default());
        Ok(())
    }

    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError> {
        for (robot, (command, active)) in self.robots.iter_mut().zip(commands.iter().zip(active)) {
            robot.wanted = if *active { *command } else { [0.0; 3] };
        }
        (0..TICKS).try_for_each(|_| self.tick())
    }

    fn motion(&self, env: usize) -> Motion {
        let robot = &self.robots[env];
        Motion { world_from_base: robot.past.ago(0.0), gyro: robot.gyro, fell: robot.fell }
    }

    fn past(&self, env: usize, ago: f64) -> Pose {
        self.robots[env].past.ago(ago)
    }
}

/// A robot in its stand on the highest ground under it; `height` is that of the ground at (x, y) \[m\], none where there is none.
///
/// # Errors
/// When there is no ground.
pub(crate) fn standing(
    robot: &TaskRobot,
    start: &Start,
    height: impl Fn(f64, f64) -> Option<f64>,
) -> Result<State, NavError> {
    let [x, y] = start.place;
    let reach = f64::from(robot.height);
    let around = (0..25).map(|k| (f64::from(k % 5) * 0.25 - 0.5, f64::from(k / 5) * 0.25 - 0.5));
    let under =
        around.filter_map(|(i, j)| height(x + 2.0 * i * reach, y + j * reach)).fold(f64::NEG_INFINITY, f64::max);
    if !under.is_finite() {
        return Err(NavError::value("ground under a start", "a height", format!("none at {x:.2}, {y:.2} m")));
    }
    let mut q = vec![x, y, under + reach, (0.5 * start.yaw).cos(), 0.0, 0.0, (0.5 * start.yaw).sin()];
    q.extend(robot.stand.iter().map(|&angle| f64::from(angle)));
    Ok(State { v: vec![0.0; q.len() - 1], q })
}

/// The base of positions as simulators have them: place, then w, x, y, z.
pub fn pose(q: &[f32]) -> Pose {
    let [x, y, z, a, b, c, d] = std::array::from_fn(|k| f64::from(q[k]));
    Pose { position: DVec3::new(x, y, z), rotation: DQuat::from_xyzw(b, c, d, a).normalize() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_lacking_is_added_up_to_a_limit() {
        let mut trim = Trim::default();
        // A policy that stands when it is reported less than 0.15 m/s, and goes at three quarters of the rest.
        let (mut speed, mut way) = (0.0, 0.0);
        for tick in 0..500 {
            let command = trim.command([0.1, 0.0, 0.0], [speed, 0.0, 0.0]);
            speed = 0.75 * (command[0] - 0.15f64).max(0.0);
            way += if tick >= 250 { TICK * speed } else { 0.0 };
        }
        assert!((way / 5.0 - 0.1).abs() < 0.01, "{way} m in 5 s at 0.1 m/s");
        // One that cannot go: no more than the limit is added, and nothing once it is to stand.
        let last = (0..500).map(|_| trim.command([0.5, 0.0, 0.0], [0.0; 3])).last().unwrap();
        assert!((last[0] - 0.8).abs() < 1e-12, "{last:?}");
        assert_eq!(trim.command([0.0; 3], [0.2; 3]), [0.0; 3]);
        assert_eq!(trim, Trim::default());
    }

    #[test]
    fn velocities_are_in_the_headings_axes() {
        let base = Pose::from_xyz_rpy([0.0; 3], [0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let found = moving(&base, DVec3::new(-0.2, 0.5, 0.1), DVec3::new(0.0, 0.0, 0.7));
        assert!(found.iter().zip([0.5, 0.2, 0.7]).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }
}
