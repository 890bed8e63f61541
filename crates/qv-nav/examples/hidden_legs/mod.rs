//! Legs of a robot with hidden effects, for students of navigation.

use glam::DVec3;
use qv_core::Pose;
use qv_nav::NavError;
use qv_nav::legs::{self, Legs, Motion, Past, TICK};
use qv_nav::task::PERIOD;
use qv_nav::walkers::{Trim, moving, pose};
use qv_policy::policy::Policy;
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings};
use qv_residual::ResidualError;
use qv_residual::hidden::{HiddenRobot, HiddenWalker, Start};
use rayon::prelude::*;

/// Robots of one kind, each in an engine of its own, under one walking policy.
pub struct HiddenLegs<'a> {
    hidden: &'a HiddenRobot,
    robot: &'a TaskRobot,
    ground: &'a Ground,
    policy: &'a Policy,
    /// Of the policy's training.
    task: &'a TaskSettings,
    walkers: Vec<Walker<'a>>,
    count: usize,
}

/// One robot.
struct Walker<'a> {
    body: HiddenWalker<'a>,
    past: Past,
    gyro: [f64; 3],
    /// Velocity in heading axes, forwards and to the left \[m/s\], and turning rate \[rad/s\].
    measured: [f64; 3],
    trim: Trim,
}

impl<'a> HiddenLegs<'a> {
    /// At most `count` robots at once.
    ///
    /// # Errors
    /// When the policy does not decide 50 times a second.
    pub fn new(
        hidden: &'a HiddenRobot,
        (robot, ground): (&'a TaskRobot, &'a Ground),
        (policy, task): (&'a Policy, &'a TaskSettings),
        count: usize,
    ) -> Result<Self, NavError> {
        if (f64::from(task.rate) * TICK - 1.0).abs() > 1e-6 {
            return Err(NavError::value("rate of the walking policy", &format!("{} Hz", 1.0 / TICK), task.rate));
        }
        Ok(Self { hidden, robot, ground, policy, task, walkers: Vec::new(), count })
    }

    fn start(&self, start: &legs::Start) -> Result<Walker<'a>, ResidualError> {
        let start = Start { place: start.place.map(|x| x as f32), yaw: start.yaw, seed: start.seed };
        let body = self.hidden.start(self.robot, self.ground, self.policy, self.task, start)?;
        let mut walker =
            Walker { body, past: Past::default(), gyro: [0.0; 3], measured: [0.0; 3], trim: Trim::default() };
        walker.read()?;
        Ok(walker)
    }
}

impl Walker<'_> {
    /// One decision of the walking policy; one that fell lies.
    fn tick(&mut self, wanted: [f64; 3]) -> Result<(), ResidualError> {
        if self.body.fell() {
            return Ok(());
        }
        let command = self.trim.command(wanted, self.measured);
        self.body.step(command.map(|x| x as f32))?;
        self.read()
    }

    fn read(&mut self) -> Result<(), ResidualError> {
        let state = self.body.state()?;
        let base = pose(&state.q[..7].iter().map(|&x| x as f32).collect::<Vec<_>>());
        let [linear, turning] = [0, 3].map(|at| DVec3::from_slice(&state.v[at..]));
        self.gyro = turning.to_array();
        self.measured = moving(&base, linear, turning);
        self.past.push(base);
        Ok(())
    }
}

fn failure(error: ResidualError) -> NavError {
    match error {
        ResidualError::Sim(error) => error.into(),
        ResidualError::Policy(error) => error.into(),
        ResidualError::Input(error) => error.into(),
        ResidualError::Rollout(error) => NavError::value("hidden robot", "a walk", error),
    }
}

impl Legs for HiddenLegs<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn begin(&mut self, starts: &[legs::Start]) -> Result<(), NavError> {
        if starts.len() > self.count {
            return Err(NavError::value("starts", &format!("at most {}", self.count), starts.len()));
        }
        self.walkers = starts.par_iter().map(|start| self.start(start)).collect::<Result<_, _>>().map_err(failure)?;
        Ok(())
    }

    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError> {
        let ticks = (PERIOD / TICK).round() as usize;
        let work = self.walkers.par_iter_mut().zip(commands).zip(active).filter(|(_, active)| **active);
        work.try_for_each(|((walker, command), _)| (0..ticks).try_for_each(|_| walker.tick(*command))).map_err(failure)
    }

    fn are_apart(&self) -> bool {
        true
    }

    fn motion(&self, env: usize) -> Motion {
        self.walkers.get(env).map_or(
            Motion { world_from_base: Pose::IDENTITY, gyro: [0.0; 3], fell: false },
            |walker| Motion { world_from_base: walker.past.ago(0.0), gyro: walker.gyro, fell: walker.body.fell() },
        )
    }

    fn past(&self, env: usize, ago: f64) -> Pose {
        self.walkers.get(env).map_or(Pose::IDENTITY, |walker| walker.past.ago(ago))
    }
}
