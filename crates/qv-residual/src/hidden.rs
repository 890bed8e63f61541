//! Robots that no fit has seen: simulated with effects that are drawn and kept to themselves, in the second engine or ours at a finer step.
//! They record walks as a robot would, with noise, and show where a policy takes them.

mod drawn;

pub use drawn::{Engine, HiddenRobot, Outside};

use crate::ResidualError;
use crate::log::Log;
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

    /// Its recordings of so many walks of so many seconds under commands drawn by `seed`. Walks of which nothing can be used are remarks.
    ///
    /// # Errors
    /// When an engine refuses a number.
    pub fn record(
        &self,
        robot: &TaskRobot,
        ground: &Ground,
        policy: &Policy,
        task: &TaskSettings,
        (walks, seconds): (u64, f32),
        seed: u64,
    ) -> Result<Log, ResidualError> {
        let drawn: Vec<_> = (0..walks).map(|k| wander(&task.commands, seconds, seed * 100 + k)).collect();
        let places = &ground.places[0];
        let orders: Vec<Order> = (0..walks)
            .zip(&drawn)
            .map(|(k, commands)| Order {
                commands,
                seconds,
                place: places[k as usize % places.len()],
                seed: seed * 1000 + k,
            })
            .collect();
        let mut log = Log::new(robot, task);
        for (k, walk) in self.walks(robot, ground, policy, task, &orders)?.iter().enumerate() {
            // A walk that ended in a fall at once has nothing to show.
            if let Err(error) = log.add(&format!("walk {k}"), &walk.run, robot) {
                log.remarks.push(error.to_string());
            }
        }
        Ok(log)
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
        let start = Start { place: order.place, yaw: 0.0, seed: order.seed };
        let mut walker = self.start(robot, ground, policy, task, start)?;
        let first: Vec<f32> = standing(robot, ground, &start).q.iter().map(|&x| x as f32).collect();
        let mut record = Recorder::new(robot.joints());
        let mut path = Path::new();
        for k in 0..(order.seconds * task.rate) as usize {
            let time = k as f32 / task.rate;
            let command = order.commands.iter().rev().find(|(from, _)| *from <= time).map_or([0.0; 3], |(_, c)| *c);
            walker.advance(command, Some(&mut record))?;
            if walker.fell() {
                break;
            }
            let now: Vec<f32> = walker.state()?.q[..7].iter().map(|&x| x as f32).collect();
            path.push(from_start(&first, &now));
        }
        Ok(Walk { path, run: record.run(robot) })
    }

    /// Puts it onto its feet, to walk decision by decision under `policy`, which was trained under `task`.
    ///
    /// # Errors
    /// When an engine refuses a number.
    pub fn start<'a>(
        &'a self,
        robot: &'a TaskRobot,
        ground: &'a Ground,
        policy: &'a Policy,
        task: &TaskSettings,
        start: Start,
    ) -> Result<HiddenWalker<'a>, ResidualError> {
        let probe = Batch::<f32>::new(&robot.model, &qv_sim::Terrain::none(), &SimOptions::default(), 1)?;
        let names = robot.model.joint_names().iter().map(|n| format!("joint.{n}.external_torque"));
        let ids = names.map(|n| probe.parameter_index(&n)).collect::<Result<_, _>>()?;
        Ok(HiddenWalker {
            robot,
            ground,
            policy,
            plant: Plant::new(self, &robot.model, ground, &standing(robot, ground, &start))?,
            acting: self.acting(robot.joints()),
            random: Xoshiro256PlusPlus::of(start.seed, 47, 0),
            targets: robot.stand.clone(),
            ids,
            rate: task.rate,
            clock: task.clock,
            decisions: 0,
            fell: false,
        })
    }
}

/// Where a hidden robot starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Base from above: x, y \[m\].
    pub place: [f32; 2],
    /// Its heading \[rad\].
    pub yaw: f64,
    /// Seed of its noise.
    pub seed: u64,
}

/// A hidden robot that walks. The same start and commands give the same bits.
pub struct HiddenWalker<'a> {
    robot: &'a TaskRobot,
    ground: &'a Ground,
    policy: &'a Policy,
    plant: Plant,
    acting: drawn::Acting<'a>,
    random: Xoshiro256PlusPlus,
    /// Joint targets of the last decision \[rad\].
    targets: Vec<f32>,
    /// Parameters of the external torques, by joint.
    ids: Vec<usize>,
    /// Decisions a second \[Hz\].
    rate: f32,
    /// Clock that the policy sees \[Hz\]; 0 = none.
    clock: f32,
    decisions: usize,
    fell: bool,
}

impl HiddenWalker<'_> {
    /// One decision of the policy under a command: forwards, to the left \[m/s\], turning \[rad/s\]. One that fell stays as it is.
    ///
    /// # Errors
    /// When an engine refuses a number.
    pub fn step(&mut self, command: [f32; 3]) -> Result<(), ResidualError> {
        if self.fell { Ok(()) } else { self.advance(command, None) }
    }

    /// Whether it fell: it leans by more than 60 degrees, its trunk is below 0.45 of its height, or the engine failed.
    pub fn fell(&self) -> bool {
        self.fell
    }

    /// True positions and velocities.
    ///
    /// # Errors
    /// When the engine has none.
    pub fn state(&self) -> Result<State, ResidualError> {
        self.plant.state()
    }

    fn advance(&mut self, command: [f32; 3], mut record: Option<&mut Recorder>) -> Result<(), ResidualError> {
        let wide = |list: &[f32]| list.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        self.decide(command)?;
        let (q, kp, kd) = (wide(&self.targets), wide(&self.robot.kp), wide(&self.robot.kd));
        let zero = vec![0.0; q.len()];
        self.plant.command(&JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero })?;
        if let Some(record) = record.as_deref_mut() {
            record.command(self.decisions as f64 / f64::from(self.rate), &q);
        }
        let substeps = (1.0 / (f64::from(self.rate) * STEP)).round() as usize;
        for step in 0..substeps {
            if let Some(record) = record.as_deref_mut().filter(|_| step % SAMPLE == 0) {
                let time = (self.decisions * substeps + step) as f64 * STEP;
                let sensed = self.acting.seen(self.plant.sensors()?);
                record.sample(time, &sensed, self.robot, &mut self.random);
            }
            if self.acting.is_any() {
                let (state, motor) = (self.plant.state()?, self.plant.sensors()?.tau);
                self.plant.add_torques(&self.ids, self.acting.torques(&state, &motor, &kp, STEP))?;
            }
            self.plant.step()?;
        }
        self.decisions += 1;
        self.fell = self.lies()?;
        Ok(())
    }

    /// Asks the policy for new targets.
    fn decide(&mut self, command: [f32; 3]) -> Result<(), ResidualError> {
        let robot = self.robot;
        let sensed = self.acting.seen(self.plant.sensors()?);
        let mut seen = observation(robot, &sensed, command, &self.targets, &mut self.random);
        seen.extend(clock_input(self.clock, self.rate, self.decisions, command));
        let (mut action, mut deciding) = (vec![0.0; robot.joints()], self.policy);
        deciding.decide(1, &seen, &mut action)?;
        for (j, target) in self.targets.iter_mut().enumerate() {
            let (low, high) = robot.limits(j);
            *target = (robot.stand[j] + robot.action_scale[j] * action[j]).clamp(low, high);
        }
        Ok(())
    }

    fn lies(&self) -> Result<bool, ResidualError> {
        let q = self.plant.state()?.q;
        let up = 1.0 - 2.0 * (q[4].powi(2) + q[5].powi(2));
        let under = self.ground.terrain.height_below(q[0], q[1], q[2]).unwrap_or(0.0);
        Ok(self.plant.is_faulty()? || up < 0.5 || q[2] - under < 0.45 * f64::from(self.robot.height))
    }
}

/// The robot in its stand on the highest ground under it.
fn standing(robot: &TaskRobot, ground: &Ground, start: &Start) -> State {
    let [x, y] = start.place;
    let highest = (0..25).filter_map(|k| {
        let reach = f64::from(robot.height);
        let (i, j) = (f64::from(k % 5) * 0.5 - 1.0, f64::from(k / 5) * 0.5 - 1.0);
        ground.terrain.height_below(f64::from(x) + i * reach, f64::from(y) + j * reach, 1e3)
    });
    let height = highest.fold(f64::NEG_INFINITY, f64::max).max(-1e3) + f64::from(robot.height);
    let mut q = vec![f64::from(x), f64::from(y), height, (0.5 * start.yaw).cos(), 0.0, 0.0, (0.5 * start.yaw).sin()];
    q.extend(robot.stand.iter().map(|&a| f64::from(a)));
    State { v: vec![0.0; q.len() - 1], q }
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
