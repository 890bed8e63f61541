//! The robots, what they do, and their recordings: a walking Go2, an arm of six joints, a biped that hangs from a gantry.

use qv_core::JointSeries;
use qv_core::random::{SplitMix64, sub_seed};
use qv_go2::gait::Trot;
use qv_go2::model;
use qv_recording::Run;
use qv_recording::run::{Base, Robot};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimError, SimOptions, State, Terrain};
use std::f64::consts::TAU;
use std::fmt::Write;

/// A robot of the collection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotKind {
    /// Walks on a plane.
    Go2,
    /// Held at its foot.
    Arm,
    /// Held at its pelvis.
    Biped,
}

/// All of them.
pub const ROBOTS: [RobotKind; 3] = [RobotKind::Go2, RobotKind::Arm, RobotKind::Biped];

/// What the firmware makes of commanded positions before the motors see them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Firmware {
    /// Nothing.
    Plain,
    /// A low-pass of this time constant \[s\].
    LowPass(f64),
    /// A limit on their rate \[rad/s\].
    RateLimit(f64),
}

/// How the motors of one recording are driven.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motors {
    /// Factor on the usual velocity gain.
    pub damping: f64,
    /// What happens to commands on their way.
    pub firmware: Firmware,
    /// Whether half of the draws have a physical cause, such as a latency or weak motors.
    pub has_causes: bool,
}

impl Default for Motors {
    fn default() -> Self {
        Self { damping: 1.0, firmware: Firmware::Plain, has_causes: true }
    }
}

/// Time between two rows, and between two steps \[s\].
const ROW: f64 = 0.002;
const STEP: f64 = 0.001;
/// Length of a recording, and of what comes before it \[s\].
const LENGTH: f64 = 8.0;
const SETTLING: f64 = 0.5;

impl RobotKind {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Go2 => "Go2",
            Self::Arm => "arm",
            Self::Biped => "biped",
        }
    }

    /// Position and velocity gains \[N m/rad, N m s/rad\].
    pub fn gains(self) -> [f64; 2] {
        match self {
            Self::Go2 => [40.0, 1.0],
            Self::Arm => [60.0, 2.5],
            Self::Biped => [80.0, 2.0],
        }
    }

    /// Joints of one group, such as all calves.
    pub fn group(self) -> Vec<usize> {
        match self {
            Self::Go2 => vec![2, 5, 8, 11],
            Self::Arm => vec![1, 2],
            Self::Biped => vec![2, 7],
        }
    }

    /// Columns of two legs that can be exchanged; of the arm three joints that can be turned in a circle.
    pub fn legs(self) -> Vec<[usize; 2]> {
        match self {
            Self::Go2 => vec![[0, 3], [1, 4], [2, 5]],
            Self::Arm => vec![[0, 3], [1, 4]],
            Self::Biped => (0..5).map(|k| [k, k + 5]).collect(),
        }
    }

    fn model(self) -> Result<Model, SimError> {
        let (text, base) = match self {
            Self::Go2 => (model::urdf(), BaseKind::Floating),
            Self::Arm => (chain("arm", &[("", &ARM)]), BaseKind::Fixed),
            Self::Biped => (chain("biped", &[("left_", &LEG), ("right_", &LEG)]), BaseKind::Fixed),
        };
        let armature = if self == Self::Go2 { model::ARMATURE } else { 0.02 };
        Model::from_urdf(&text, &ModelOptions { base, armature, ..Default::default() })
    }
}

/// A joint with the link that it moves: name, axis, length \[m\], mass \[kg\].
type Segment = (&'static str, [i8; 3], f64, f64);

const ARM: [Segment; 6] = [
    ("base_yaw", [0, 0, 1], 0.1, 3.0),
    ("shoulder", [0, 1, 0], 0.4, 3.0),
    ("elbow", [0, 1, 0], 0.35, 2.0),
    ("forearm_roll", [0, 0, 1], 0.1, 1.0),
    ("wrist_pitch", [0, 1, 0], 0.1, 0.8),
    ("wrist_roll", [0, 0, 1], 0.08, 0.4),
];
const LEG: [Segment; 5] = [
    ("hip_roll", [1, 0, 0], 0.08, 1.5),
    ("hip_yaw", [0, 0, 1], 0.08, 1.5),
    ("hip_pitch", [0, 1, 0], 0.35, 4.0),
    ("knee", [0, 1, 0], 0.35, 3.0),
    ("ankle", [0, 1, 0], 0.1, 0.8),
];

/// A URDF of chains that hang from a held base.
fn chain(name: &str, limbs: &[(&str, &[Segment])]) -> String {
    let mut urdf = format!("<robot name=\"{name}\"><link name=\"base\"/>");
    for (k, (side, segments)) in limbs.iter().enumerate() {
        let (mut parent, mut down) = ("base".to_string(), 0.0);
        for (joint, [x, y, z], length, mass) in segments.iter() {
            let (link, inertia) = (format!("{side}{joint}_link"), mass * length * length / 12.0 + 1e-3);
            let aside = if parent == "base" { 0.2 * k as f64 } else { 0.0 };
            // Writing to a string cannot fail.
            _ = write!(
                urdf,
                "<link name=\"{link}\"><inertial><origin xyz=\"0.02 0 {}\"/><mass value=\"{mass}\"/><inertia ixx=\"{inertia}\" \
                 iyy=\"{inertia}\" izz=\"{inertia}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link><joint name=\"{side}{joint}\" \
                 type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{link}\"/><origin xyz=\"0 {aside} {down}\"/><axis xyz=\"{x} \
                 {y} {z}\"/><limit lower=\"-3\" upper=\"3\" effort=\"150\" velocity=\"30\"/></joint>",
                -0.5 * length
            );
            (parent, down) = (link, -length);
        }
    }
    urdf + "</robot>"
}

/// Target angles \[rad\] over time, drawn.
struct Motion {
    kind: RobotKind,
    trot: Trot,
    /// Mean, and amplitude, rate \[Hz\] and phase of two waves, of each joint.
    waves: Vec<[f64; 7]>,
}

impl Motion {
    fn draw(kind: RobotKind, joints: usize, draws: &mut SplitMix64) -> Self {
        let trot = Trot {
            frequency: draws.between(1.6, 2.4),
            swing: draws.between(0.15, 0.25),
            lift: draws.between(0.4, 0.7),
            ..Trot::default()
        };
        let mut wave = || {
            let (mean, size, turn) = (draws.between(-0.5, 0.5), draws.between(0.15, 0.5), draws.between(0.0, TAU));
            let rate = draws.between(0.2, 0.7);
            [mean, size, rate, turn, 0.3 * size, draws.between(1.0, 2.0), draws.between(0.0, TAU)]
        };
        Self { kind, trot, waves: (0..joints).map(|_| wave()).collect() }
    }

    fn at(&self, time: f64) -> Vec<f64> {
        if self.kind == RobotKind::Go2 {
            return self.trot.target(time).to_vec();
        }
        // From rest.
        let ramp = (time / SETTLING).clamp(0.0, 1.0);
        let one =
            |w: &[f64; 7]| w[0] + w[1] * (TAU * w[2] * time + w[3]).sin() + w[4] * (TAU * w[5] * time + w[6]).sin();
        self.waves.iter().map(|w| ramp * one(w)).collect()
    }
}

/// The small ways in which a robot differs from its model, and in half of the draws a physical cause that a diagnosis would name: neither is a
/// mistake.
fn parameters(names: &[String], has_causes: bool, draws: &mut SplitMix64) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for joint in names {
        all.push((format!("actuator.{joint}.kp_scale"), 1.0 + draws.normal(0.015)));
        all.push((format!("actuator.{joint}.kd_scale"), 1.0 + draws.normal(0.03)));
        all.push((format!("joint.{joint}.coulomb_friction"), draws.normal(0.05).abs()));
        all.push((format!("sensor.{joint}.encoder_bias"), draws.normal(0.001)));
    }
    let cause = if has_causes { draws.index(12) } else { 12 };
    let size = draws.uniform();
    let mut of_all = |name: &str, value: f64| {
        all.retain(|(n, _)| !n.ends_with(name));
        let (kind, key) = name.split_once('.').expect("a kind of parameter and its name");
        all.extend(names.iter().map(|joint| (format!("{kind}.{joint}.{key}"), value)));
    };
    match cause {
        0 => of_all("actuator.command_latency", 0.002 + 0.018 * size),
        1 => of_all("actuator.strength", 0.7 + 0.2 * size),
        2 => of_all("joint.coulomb_friction", 0.2 + 0.5 * size),
        3 => of_all("actuator.lag", 0.003 + 0.012 * size),
        4 => of_all("sensor.encoder_bias", 0.02 + 0.04 * size),
        5 => of_all("actuator.kp_scale", 0.7 + 0.2 * size),
        _ => {}
    }
    all
}

/// Records a robot: the same seed gives the same run. Commands, gains, positions, speeds and torques are those that a robot's log has.
///
/// # Errors
/// The simulation cannot be made.
pub fn record(kind: RobotKind, motors: Motors, seed: u64) -> Result<Run, SimError> {
    let robot = kind.model()?;
    let names = robot.joint_names().to_vec();
    let joints = names.len();
    let mut draws = SplitMix64::new(seed);
    let motion = Motion::draw(kind, joints, &mut draws);
    let parameters = parameters(&names, motors.has_causes, &mut draws);
    let terrain = if kind == RobotKind::Go2 { Terrain::plane() } else { Terrain::none() };
    let options = SimOptions { timestep: STEP, max_command_latency: 0.03, ..Default::default() };
    let mut batch = Batch::<f64>::new(&robot, &terrain, &options, 1)?;
    for (name, value) in &parameters {
        batch.set_parameter(0, name, *value)?;
    }
    if kind == RobotKind::Go2 {
        let mut q = vec![0.0, 0.0, model::touching_height(&model::STAND), 1.0, 0.0, 0.0, 0.0];
        q.extend(model::STAND);
        batch.set_state(0, &State { q, v: vec![0.0; 6 + joints] })?;
    }
    let [kp, kd] = [kind.gains()[0], kind.gains()[1] * motors.damping];
    let mut run = Run::empty(Robot::Named(kind.name().into()), Base::Fixed, names);
    let mut noise = SplitMix64::new(sub_seed(seed, 9));
    let mut rows = Rows::default();
    let mut shaped: Vec<f64> = motion.at(0.0);
    for k in 0..((SETTLING + LENGTH) / ROW) as usize {
        let time = ROW * k as f64;
        let target = motion.at(time);
        if time >= SETTLING {
            rows.push(time - SETTLING, &batch.sensors(0)?, &target, &mut noise);
        }
        for (x, wanted) in shaped.iter_mut().zip(&target) {
            *x = match motors.firmware {
                Firmware::Plain => *wanted,
                Firmware::LowPass(t) => *x + (1.0 - (-ROW / t).exp()) * (wanted - *x),
                Firmware::RateLimit(r) => *x + (wanted - *x).clamp(-r * ROW, r * ROW),
            };
        }
        let (zero, kp, kd) = (vec![0.0; joints], vec![kp; joints], vec![kd; joints]);
        batch.set_command(0, &JointCommand { q: &shaped, dq: &zero, kp: &kp, kd: &kd, tau: &zero })?;
        batch.step_many((ROW / STEP).round() as usize);
    }
    rows.put_into(&mut run, [kp, kd]);
    Ok(run)
}

/// Rows of the log.
#[derive(Default)]
struct Rows {
    time: Vec<f64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    torque: Vec<f64>,
    command: Vec<f64>,
}

impl Rows {
    fn push(&mut self, time: f64, seen: &qv_sim::SensorReading, target: &[f64], noise: &mut SplitMix64) {
        self.time.push(time);
        self.position.extend(seen.q.iter().map(|x| x + noise.normal(2e-4)));
        self.velocity.extend(seen.dq.iter().map(|x| x + noise.normal(0.02)));
        self.torque.extend(seen.tau.iter().map(|x| x + noise.normal(0.05)));
        self.command.extend_from_slice(target);
    }

    fn put_into(self, run: &mut Run, [kp, kd]: [f64; 2]) {
        let joints = run.joint_names.len();
        let count = self.time.len();
        let series = |time: &[f64], values: Vec<f64>| Some(JointSeries { time: time.to_vec(), values, joints });
        let sent: Vec<f64> = self.time.iter().map(|t| t + 5e-5).collect();
        run.commands.position = series(&sent, self.command);
        run.commands.kp = series(&sent, vec![kp; count * joints]);
        run.commands.kd = series(&sent, vec![kd; count * joints]);
        run.measured.position = series(&self.time, self.position);
        run.measured.velocity = series(&self.time, self.velocity);
        run.measured.torque = series(&self.time, self.torque);
    }
}
