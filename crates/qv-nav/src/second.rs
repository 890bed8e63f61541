//! Legs in the second engine, for a world that no training knew. See [`crate::walkers`]; here every robot has an engine of its own, and its
//! policy sees the true state.

use crate::NavError;
use crate::legs::{Legs, Motion, Past, Start, TICK, TICKS, check_starts};
use crate::walkers::{Trim, moving, pose, standing};
use glam::DVec3;
use qv_core::Pose;
use qv_policy::score::Decide;
use qv_policy::velocity::{TaskRobot, clock_input};
use qv_sim::rapier::{RapierEngine, RapierOptions};
use qv_sim::{JointCommand, SimError, State, Terrain};
use rayon::prelude::*;

/// Robots that lean by more have fallen \[rad\].
const MOST_TILT: f64 = 1.0;

/// Robots in the second engine.
pub struct SecondWalkers<'a> {
    robot: TaskRobot,
    policy: Box<dyn Decide + 'a>,
    robots: Vec<One>,
    /// Physics steps of a decision of the walking policy.
    steps: usize,
    /// Strides a second of the clock that the walking policy sees \[Hz\]; 0: none.
    clock: f32,
}

/// One robot.
struct One {
    engine: RapierEngine,
    past: Past,
    targets: Vec<f32>,
    state: State,
    fell: bool,
    trim: Trim,
    /// Decisions of the walking policy since the start.
    decisions: usize,
}

impl<'a> SecondWalkers<'a> {
    /// `count` robots on `terrain`, whose parameters differ from the model by `effects`: names of the catalogue, with at most one `*`.
    ///
    /// # Errors
    /// When the engine refuses robot, ground or an effect, when no parameter has a name, or a step is no part of 20 ms.
    pub fn new(
        robot: &TaskRobot,
        policy: Box<dyn Decide + 'a>,
        (terrain, options): (&Terrain, &RapierOptions),
        effects: &[(String, f64)],
        count: usize,
    ) -> Result<Self, NavError> {
        let steps = TICK / options.timestep;
        if (steps - steps.round()).abs() > 1e-6 || steps < 1.0 {
            return Err(NavError::value("time step", "a whole part of 0.02 s", options.timestep));
        }
        let one = |_| -> Result<One, NavError> {
            let mut engine = RapierEngine::new(&robot.model, terrain, options)?;
            for (name, value) in effects {
                suffer(&mut engine, name, *value)?;
            }
            let state = engine.state();
            Ok(One {
                engine,
                past: Past::default(),
                targets: robot.stand.clone(),
                state,
                fell: false,
                trim: Trim::default(),
                decisions: 0,
            })
        };
        let robots = (0..count).map(one).collect::<Result<_, _>>()?;
        Ok(Self { robot: robot.clone(), policy, robots, steps: steps.round() as usize, clock: 0.0 })
    }

    /// For a walking policy that sees a clock of so many strides a second \[Hz\]; 0: it sees none.
    pub fn with_clock(self, clock: f32) -> Self {
        Self { clock, ..self }
    }

    /// One decision of the walking policy for robots that are active and stand.
    fn tick(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError> {
        let walking: Vec<usize> =
            (0..commands.len().min(active.len())).filter(|&env| active[env] && !self.robots[env].fell).collect();
        if walking.is_empty() {
            return Ok(());
        }
        let joints = self.robot.joints();
        let (robots, clock) = (&mut self.robots, self.clock);
        let observations: Vec<f32> =
            walking.iter().flat_map(|&env| robots[env].observation(commands[env], clock)).collect();
        let mut actions = vec![0.0; walking.len() * joints];
        self.policy.decide(walking.len(), &observations, &mut actions)?;
        let mut of_env: Vec<Option<&[f32]>> = vec![None; self.robots.len()];
        walking.iter().zip(actions.chunks_exact(joints)).for_each(|(&env, action)| of_env[env] = Some(action));
        let (robot, steps) = (&self.robot, self.steps);
        self.robots.par_iter_mut().zip(of_env).try_for_each(|(one, action)| match action {
            Some(action) => one.walk(robot, action, steps),
            None => Ok(()),
        })?;
        Ok(())
    }
}

/// Sets all parameters that a name fits.
fn suffer(engine: &mut RapierEngine, name: &str, value: f64) -> Result<(), NavError> {
    let (before, after) = name.split_once('*').unwrap_or((name, ""));
    let fits = |found: &str| match name.contains('*') {
        true => found.len() + 1 >= name.len() && found.starts_with(before) && found.ends_with(after),
        false => found == name,
    };
    let known = engine.catalogue().iter().enumerate();
    let ids: Vec<usize> = known.filter(|(_, info)| fits(&info.name)).map(|(id, _)| id).collect();
    if ids.is_empty() {
        return Err(NavError::value("effect", "the name of a parameter", name));
    }
    Ok(ids.into_iter().try_for_each(|id| engine.set_parameter_at(id, value))?)
}

impl One {
    /// What the walking policy sees: see [`qv_policy::velocity::OBSERVATION`].
    fn observation(&mut self, wanted: [f64; 3], clock: f32) -> Vec<f32> {
        let State { q, v } = &self.state;
        let (linear, turning) = (DVec3::new(v[0], v[1], v[2]), DVec3::new(v[3], v[4], v[5]));
        let command = self.trim.command(wanted, moving(&self.past.ago(0.0), linear, turning));
        let gravity = (self.past.ago(0.0).rotation.conjugate() * DVec3::NEG_Z).to_array();
        let numbers = v[3..6].iter().chain(&gravity).chain(&command).chain(&q[7..]).chain(&v[6..]).copied();
        let clock = clock_input(clock, (1.0 / TICK) as f32, self.decisions, command.map(|x| x as f32));
        self.decisions += 1;
        numbers.map(|x| x as f32).chain(self.targets.iter().copied()).chain(clock).collect()
    }

    fn walk(&mut self, robot: &TaskRobot, action: &[f32], steps: usize) -> Result<(), SimError> {
        for (j, target) in self.targets.iter_mut().enumerate() {
            let (low, high) = robot.limits(j);
            *target = (robot.stand[j] + robot.action_scale[j] * action[j]).clamp(low, high);
        }
        let wide = |list: &[f32]| list.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        let (q, kp, kd, zero) = (wide(&self.targets), wide(&robot.kp), wide(&robot.kd), vec![0.0; action.len()]);
        self.engine.set_command(&JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero })?;
        (0..steps).try_for_each(|_| self.engine.step())?;
        if self.engine.is_faulty() {
            self.fell = true;
            return Ok(());
        }
        self.state = self.engine.state();
        let base = pose_of(&self.state);
        self.fell = (base.rotation * DVec3::Z).z < MOST_TILT.cos();
        self.past.push(base);
        Ok(())
    }
}

fn pose_of(state: &State) -> Pose {
    pose(&state.q[..7].iter().map(|&x| x as f32).collect::<Vec<_>>())
}

impl Legs for SecondWalkers<'_> {
    fn count(&self) -> usize {
        self.robots.len()
    }

    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError> {
        check_starts(starts, self.robots.len())?;
        for (one, start) in self.robots.iter_mut().zip(starts) {
            let terrain = one.engine.terrain();
            let plane = terrain.is_plane();
            let height = |x: f64, y: f64| if plane { Some(0.0) } else { terrain.height_below(x, y, 1e6) };
            one.state = standing(&self.robot, start, height)?;
            one.engine.set_state(&one.state)?;
            one.past.begin(pose_of(&one.state));
            one.targets.clone_from(&self.robot.stand);
            one.fell = false;
            one.trim = Trim::default();
            one.decisions = 0;
        }
        Ok(())
    }

    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError> {
        (0..TICKS).try_for_each(|_| self.tick(commands, active))
    }

    fn are_apart(&self) -> bool {
        true
    }

    fn motion(&self, env: usize) -> Motion {
        let one = &self.robots[env];
        let gyro = std::array::from_fn(|k| one.state.v[3 + k]);
        Motion { world_from_base: one.past.ago(0.0), gyro, fell: one.fell }
    }

    fn past(&self, env: usize, ago: f64) -> Pose {
        self.robots[env].past.ago(ago)
    }
}
