//! Robots that no fit has seen: simulated with effects that are drawn and kept to themselves, in the second engine or ours at a finer step.
//! They record walks as a robot would, with noise, and show where a policy takes them.

mod drawn;

pub use drawn::{Engine, HiddenRobot, Outside};

use crate::ResidualError;
use crate::paths::{Path, PathScore, SETTLING, from_start, measured};
use qv_core::JointSeries;
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::policy::Policy;
use qv_policy::score::Decide;
use qv_policy::velocity::{Commands, Ground, TaskRobot, TaskSettings, clock_input};
use qv_recording::Run;
use qv_recording::run::{Base, Measurements, Robot};
#[cfg(feature = "rapier")]
use qv_sim::rapier::{RapierEngine, RapierOptions};
use qv_sim::{Batch, JointCommand, Model, SensorReading, SimOptions, State};
use rayon::prelude::*;

/// Physics step of hidden robots \[s\].
const STEP: f64 = 0.001;
/// Physics steps from sample to sample of a recording: 500 Hz.
const SAMPLE: usize = 2;
/// Standard deviations of a recording's noise: joint positions \[rad\], speeds \[rad/s\], gyroscope \[rad/s\], accelerometer \[m/s²\],
/// poses \[m\]. The first two are what a Go2 that stands shows.
const NOISE: [f32; 5] = [0.0004, 0.02, 0.01, 0.1, 0.001];

/// Added to seeds of the commands and the noise of scores, which are then not those of recordings.
pub const SCORED: u64 = 5000;

enum Plant {
    Ours(Box<Batch<f64>>),
    #[cfg(feature = "rapier")]
    Second(Box<RapierEngine>),
}

impl Plant {
    fn new(hidden: &HiddenRobot, model: &Model, ground: &Ground, state: &State) -> Result<Self, ResidualError> {
        let ours = || -> Result<Self, ResidualError> {
            let options = SimOptions { timestep: STEP, max_command_latency: 0.06, ..Default::default() };
            let mut batch = Batch::<f64>::new(model, &ground.terrain, &options, 1)?;
            hidden.parameters.iter().try_for_each(|(name, value)| batch.set_parameter(0, name, *value))?;
            batch.set_state(0, state)?;
            Ok(Self::Ours(Box::new(batch)))
        };
        match hidden.engine {
            #[cfg(feature = "rapier")]
            Engine::Second => {
                let mut sim =
                    RapierEngine::new(model, &ground.terrain, &RapierOptions { timestep: STEP, ..Default::default() })?;
                hidden.parameters.iter().try_for_each(|(name, value)| sim.set_parameter(name, *value))?;
                sim.set_state(state)?;
                Ok(Self::Second(Box::new(sim)))
            }
            _ => ours(),
        }
    }

    fn command(&mut self, command: &JointCommand) -> Result<(), ResidualError> {
        match self {
            Self::Ours(batch) => batch.set_command(0, command)?,
            #[cfg(feature = "rapier")]
            Self::Second(sim) => sim.set_command(command)?,
        }
        Ok(())
    }

    fn add_torques(&mut self, ids: &[usize], torques: &[f64]) -> Result<(), ResidualError> {
        match self {
            Self::Ours(batch) => {
                let narrow: Vec<f32> = torques.iter().map(|&x| x as f32).collect();
                batch.set_added_torques(&narrow)?;
            }
            #[cfg(feature = "rapier")]
            Self::Second(sim) => ids.iter().zip(torques).try_for_each(|(&id, &x)| sim.set_parameter_at(id, x))?,
        }
        let _ = ids;
        Ok(())
    }

    fn step(&mut self) -> Result<(), ResidualError> {
        match self {
            Self::Ours(batch) => batch.step(),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => sim.step()?,
        }
        Ok(())
    }

    fn state(&self) -> Result<State, ResidualError> {
        match self {
            Self::Ours(batch) => Ok(batch.state(0)?),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => Ok(sim.state()),
        }
    }

    fn is_faulty(&self) -> Result<bool, ResidualError> {
        match self {
            Self::Ours(batch) => Ok(batch.is_faulty(0)?),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => Ok(sim.is_faulty()),
        }
    }

    fn sensors(&self) -> Result<SensorReading, ResidualError> {
        match self {
            Self::Ours(batch) => Ok(batch.sensors(0)?),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => Ok(sim.sensors()),
        }
    }
}

/// A walk of a hidden robot.
pub struct Walk {
    /// Where it went, at each decision until a fall.
    pub path: Path,
    /// What its sensors recorded.
    pub run: Run,
}

/// What a walk is reported.
#[derive(Clone, Copy)]
pub struct Order<'a> {
    /// Commands with the times at which they begin \[s\].
    pub commands: &'a [(f32, [f32; 3])],
    /// How long it lasts \[s\].
    pub seconds: f32,
    /// Where it begins: x, y \[m\].
    pub place: [f32; 2],
    /// Seed of its noise.
    pub seed: u64,
}

/// Commands of a recording: drawn anew every `commands.every` seconds from the ranges.
pub fn wander(ranges: &Commands, seconds: f32, seed: u64) -> Vec<(f32, [f32; 3])> {
    let mut random = Xoshiro256PlusPlus::of(seed, 43, 0);
    let count = (seconds / ranges.every).ceil() as usize;
    (0..count.max(1))
        .map(|k| (k as f32 * ranges.every, [ranges.vx, ranges.vy, ranges.wz].map(|[a, b]| random.between(a, b))))
        .collect()
}

impl HiddenRobot {
    /// Walks, side by side on all threads.
    ///
    /// # Errors
    /// When an engine refuses a number.
    pub fn walks(
        &self,
        robot: &TaskRobot,
        ground: &Ground,
        policy: &Policy,
        task: &TaskSettings,
        orders: &[Order],
    ) -> Result<Vec<Walk>, ResidualError> {
        orders.par_iter().map(|order| self.walk(robot, ground, policy, task, order)).collect()
    }

    /// How far a policy strays from the paths of commands over `seconds`, one walk each; the seed draws noise.
    ///
    /// # Errors
    /// When an engine refuses a number.
    pub fn score(
        &self,
        robot: &TaskRobot,
        ground: &Ground,
        policy: &Policy,
        task: &TaskSettings,
        wanted: &[[f32; 3]],
        seconds: f32,
        seed: u64,
    ) -> Result<PathScore, ResidualError> {
        let timed: Vec<[(f32, [f32; 3]); 1]> = wanted.iter().map(|c| [(0.0, *c)]).collect();
        let places = &ground.places[0];
        let order = |(k, commands)| Order {
            commands,
            seconds: seconds + SETTLING,
            place: places[k % places.len()],
            seed: (SCORED + seed) * 1000 + k as u64,
        };
        let orders: Vec<Order> = timed.iter().map(|c| c as &[_]).enumerate().map(order).collect();
        let walks = self.walks(robot, ground, policy, task, &orders)?;
        let errors = walks.iter().zip(wanted).map(|(w, c)| measured(&w.path, *c, seconds, task.rate).1);
        Ok(PathScore::of(&errors.collect::<Vec<_>>()))
    }

    fn walk(
        &self,
        robot: &TaskRobot,
        ground: &Ground,
        policy: &Policy,
        task: &TaskSettings,
        order: &Order,
    ) -> Result<Walk, ResidualError> {
        let (joints, rate) = (robot.joints(), task.rate);
        let mut random = Xoshiro256PlusPlus::of(order.seed, 47, 0);
        let start = self.standing(robot, ground, order.place);
        let mut plant = Plant::new(self, &robot.model, ground, &start)?;
        let wide = |list: &[f32]| list.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        let (kp, kd, zero) = (wide(&robot.kp), wide(&robot.kd), vec![0.0; joints]);
        let ids: Vec<usize> = {
            let probe = Batch::<f32>::new(&robot.model, &qv_sim::Terrain::none(), &SimOptions::default(), 1)?;
            let names = robot.model.joint_names().iter().map(|n| format!("joint.{n}.external_torque"));
            names.map(|n| probe.parameter_index(&n)).collect::<Result<_, _>>()?
        };
        let (decisions, substeps) =
            ((order.seconds * rate) as usize, (1.0 / (f64::from(rate) * STEP)).round() as usize);
        let mut record = Recorder::new(joints);
        let mut targets = robot.stand.clone();
        let (mut path, mut acting) = (Path::new(), self.acting(joints));
        let first: Vec<f32> = start.q.iter().map(|&x| x as f32).collect();
        let mut deciding = policy;
        for k in 0..decisions {
            let sensed = acting.seen(plant.sensors()?);
            let time = k as f32 / rate;
            let command = order.commands.iter().rev().find(|(from, _)| *from <= time).map_or([0.0; 3], |(_, c)| *c);
            let mut observation = observation(robot, &sensed, command, &targets, &mut random);
            observation.extend(clock_input(task.clock, rate, k, command));
            let mut action = vec![0.0; joints];
            deciding.decide(1, &observation, &mut action)?;
            for j in 0..joints {
                let (low, high) = robot.limits(j);
                targets[j] = (robot.stand[j] + robot.action_scale[j] * action[j]).clamp(low, high);
            }
            let q = wide(&targets);
            plant.command(&JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero })?;
            record.command(k as f64 / f64::from(rate), &q);
            for step in 0..substeps {
                if step % SAMPLE == 0 {
                    record.sample(
                        (k * substeps + step) as f64 * STEP,
                        &acting.seen(plant.sensors()?),
                        robot,
                        &mut random,
                    );
                }
                if acting.is_any() {
                    let state = plant.state()?;
                    let motor = plant.sensors()?.tau;
                    plant.add_torques(&ids, acting.torques(&state, &motor, &kp, STEP))?;
                }
                plant.step()?;
            }
            let state = plant.state()?;
            let up = 1.0 - 2.0 * (state.q[4].powi(2) + state.q[5].powi(2));
            let under = ground.terrain.height_below(state.q[0], state.q[1], state.q[2]).unwrap_or(0.0);
            if plant.is_faulty()? || up < 0.5 || state.q[2] - under < 0.45 * f64::from(robot.height) {
                break;
            }
            let now: Vec<f32> = state.q[..7].iter().map(|&x| x as f32).collect();
            path.push(from_start(&first, &now));
        }
        Ok(Walk { path, run: record.run(robot) })
    }

    fn standing(&self, robot: &TaskRobot, ground: &Ground, [x, y]: [f32; 2]) -> State {
        let highest = (0..25).filter_map(|k| {
            let reach = f64::from(robot.height);
            let (i, j) = (f64::from(k % 5) * 0.5 - 1.0, f64::from(k / 5) * 0.5 - 1.0);
            ground.terrain.height_below(f64::from(x) + i * reach, f64::from(y) + j * reach, 1e3)
        });
        let height = highest.fold(f64::NEG_INFINITY, f64::max).max(-1e3) + f64::from(robot.height);
        let mut q = vec![f64::from(x), f64::from(y), height, 1.0, 0.0, 0.0, 0.0];
        q.extend(robot.stand.iter().map(|&a| f64::from(a)));
        State { v: vec![0.0; q.len() - 1], q }
    }
}

/// What a policy sees of sensors, with noise as in training.
fn observation(
    robot: &TaskRobot,
    sensed: &SensorReading,
    command: [f32; 3],
    targets: &[f32],
    random: &mut Xoshiro256PlusPlus,
) -> Vec<f32> {
    let mount = mount(robot);
    let [w, x, y, z] = sensed.imu_orientation;
    let gravity = turned(mount, [2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0]);
    let mut all: Vec<f32> = turned(mount, sensed.gyro).map(|g| g as f32 + NOISE[2] * random.normal()).to_vec();
    all.extend(gravity.map(|g| g as f32));
    all.extend(command);
    all.extend(sensed.q.iter().map(|&q| q as f32 + NOISE[0] * random.normal()));
    all.extend(sensed.dq.iter().map(|&q| q as f32 + NOISE[1] * random.normal()));
    all.extend(targets);
    all
}

/// Base from IMU, w, x, y, z.
fn mount(robot: &TaskRobot) -> [f64; 4] {
    let frame = ["imu", "imu_link"].iter().find_map(|name| robot.model.frame(name)).filter(|f| f.link == Some(0));
    frame.map_or([1.0, 0.0, 0.0, 0.0], |f| f.link_from_frame.wxyz())
}

fn turned([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let t = [2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])];
    [
        v[0] + w * t[0] + y * t[2] - z * t[1],
        v[1] + w * t[1] + z * t[0] - x * t[2],
        v[2] + w * t[2] + x * t[1] - y * t[0],
    ]
}

/// Gathers a recording.
#[derive(Default)]
struct Recorder {
    commands: JointSeries,
    position: JointSeries,
    velocity: JointSeries,
    gyro: JointSeries,
    acceleration: JointSeries,
    orientation: JointSeries,
    pose: JointSeries,
}

impl Recorder {
    fn new(joints: usize) -> Self {
        let of = |joints: usize| JointSeries { joints, ..Default::default() };
        Self {
            commands: of(joints),
            position: of(joints),
            velocity: of(joints),
            gyro: of(3),
            acceleration: of(3),
            orientation: of(4),
            pose: of(7),
        }
    }

    fn command(&mut self, time: f64, q: &[f64]) {
        self.commands.time.push(time);
        self.commands.values.extend(q);
    }

    fn sample(&mut self, time: f64, sensed: &SensorReading, robot: &TaskRobot, random: &mut Xoshiro256PlusPlus) {
        let mut put = |series: &mut JointSeries, values: &[f64], noise: f32| {
            series.time.push(time);
            series.values.extend(values.iter().map(|x| x + f64::from(noise * random.normal())));
        };
        put(&mut self.position, &sensed.q, NOISE[0]);
        put(&mut self.velocity, &sensed.dq, NOISE[1]);
        put(&mut self.gyro, &turned(mount(robot), sensed.gyro), NOISE[2]);
        put(&mut self.acceleration, &turned(mount(robot), sensed.acc), NOISE[3]);
        put(&mut self.orientation, &sensed.base_orientation, 0.0);
        if self.pose.time.len() * 5 <= self.position.time.len() {
            let [x, y, z] = sensed.base_position;
            let mut row = [x, y, z].map(|p| p + f64::from(NOISE[4] * random.normal())).to_vec();
            row.extend(sensed.base_orientation);
            self.pose.time.push(time);
            self.pose.values.extend(row);
        }
    }

    fn run(self, robot: &TaskRobot) -> Run {
        let frame = ["imu", "imu_link"].iter().find_map(|name| robot.model.frame(name)).filter(|f| f.link == Some(0));
        let kept = |series: JointSeries| (!series.time.is_empty()).then_some(series);
        let constant = |list: &[f32]| JointSeries {
            time: vec![0.0],
            values: list.iter().map(|&x| f64::from(x)).collect(),
            joints: list.len(),
        };
        Run {
            imu_position: frame.map_or([0.0; 3], |f| f.link_from_frame.position.to_array()),
            commands: qv_recording::run::Commands {
                position: kept(self.commands),
                kp: Some(constant(&robot.kp)),
                kd: Some(constant(&robot.kd)),
                ..Default::default()
            },
            measured: Measurements {
                position: kept(self.position),
                velocity: kept(self.velocity),
                gyro: kept(self.gyro),
                acceleration: kept(self.acceleration),
                orientation: kept(self.orientation),
                base_pose: kept(self.pose),
                ..Default::default()
            },
            ..Run::empty(Robot::Named(robot.name.clone()), Base::Free, robot.model.joint_names().to_vec())
        }
    }
}
