//! Every number of the velocity task, readable and writable as TOML.

use crate::PolicyError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The task: follow a commanded velocity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TaskSettings {
    /// Decisions a second \[Hz\].
    pub rate: f32,
    /// Physics steps of a decision.
    pub substeps: usize,
    /// Most Newton iterations of the contact solver: few, because all lanes of a register wait for the slowest.
    pub iterations: usize,
    /// Length of an episode \[s\].
    pub episode: f32,
    /// Strides a second of the clock that the policy sees \[Hz\]; 0: it sees none.
    pub clock: f32,
    /// What is commanded.
    pub commands: Commands,
    /// What is rewarded.
    pub reward: Reward,
    /// When an episode ends early.
    pub ends: Ends,
    /// Half widths of the uniform noise on what the policy sees.
    pub noise: Noise,
    /// What differs from robot to robot.
    pub randomise: Randomise,
    /// Parameters of the simulator that hold for all robots, also where they are scored: what is known of the real one. By name, with at
    /// most one `*`.
    pub parameters: BTreeMap<String, f64>,
}

impl Default for TaskSettings {
    fn default() -> Self {
        Self {
            rate: 50.0,
            substeps: 4,
            iterations: 8,
            episode: 20.0,
            clock: 1.65,
            commands: Commands::default(),
            reward: Reward::default(),
            ends: Ends::default(),
            noise: Noise::default(),
            randomise: Randomise::default(),
            parameters: BTreeMap::new(),
        }
    }
}

/// Ranges of commands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Commands {
    /// Forwards \[m/s\].
    pub vx: [f32; 2],
    /// To the left \[m/s\].
    pub vy: [f32; 2],
    /// Turning to the left \[rad/s\].
    pub wz: [f32; 2],
    /// How long a command lasts \[s\].
    pub every: f32,
    /// Share of commands that say: stand.
    pub stand: f32,
    /// Commands whose size (m/s and rad/s alike) is below this are drawn anew: between standing and walking is a gap.
    pub gap: f32,
    /// Share of commands along one axis (ahead, aside or turning), from epoch `single_axis_from` of a training on: straight ahead from rest
    /// is a command of its own, which three even numbers never give.
    pub single_axis: f32,
    /// See `single_axis`.
    pub single_axis_from: u64,
}

impl Commands {
    /// The commands of an epoch of a training.
    pub(crate) fn in_epoch(&self, epoch: u64) -> Self {
        let single_axis = if epoch >= self.single_axis_from { self.single_axis } else { 0.0 };
        Self { single_axis, ..self.clone() }
    }
}

impl Default for Commands {
    fn default() -> Self {
        Self {
            vx: [-0.5, 1.0],
            vy: [-0.4, 0.4],
            wz: [-1.0, 1.0],
            every: 4.0,
            stand: 0.15,
            gap: 0.1,
            single_axis: 0.4,
            single_axis_from: 0,
        }
    }
}

/// Weights of the terms, per second, and their shapes. Terms of torque and length are measured in the robot's own size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Reward {
    /// `exp(-|v error|² / velocity_width)` (legged_gym, Rudin et al. 2021).
    pub velocity: f32,
    /// \[m²/s²\].
    pub velocity_width: f32,
    /// `exp(-wz error² / turning_width)`.
    pub turning: f32,
    /// \[rad²/s²\].
    pub turning_width: f32,
    /// Squared vertical speed of the base.
    pub bounce: f32,
    /// Squared roll and pitch rates.
    pub sway: f32,
    /// Squared tilt (horizontal part of gravity's direction).
    pub tilt: f32,
    /// Squared difference from the height of the stand, in heights.
    pub height: f32,
    /// Squared torques, in the robot's own measure ([`super::TaskRobot::torque_scale`]).
    pub torque: f32,
    /// Squared joint accelerations \[rad²/s⁴\].
    pub acceleration: f32,
    /// Squared change of the action from step to step.
    pub action_rate: f32,
    /// Squared second difference of the action.
    pub action_jerk: f32,
    /// Squared distance from the stand: joints that move legs sideways in full, others a fifth.
    pub pose: f32,
    /// While the command says move, for each foot: time of a swing outside `swing` and of a stance outside `stance`, paid as it passes the
    /// longest and, for what is missing to the shortest, at landing and lifting. Rises with `gait_epochs`.
    pub air_time: f32,
    /// Shortest and longest swing \[s\].
    pub swing: [f32; 2],
    /// Shortest and longest stance \[s\].
    pub stance: [f32; 2],
    /// Variance over the feet of their duty factors, running means over `duty_time`.
    pub duty_variance: f32,
    /// \[s\]
    pub duty_time: f32,
    /// For each foot that lands: its speed downwards a step before \[m/s\]. Rises with `soft_epochs`.
    pub landing: f32,
    /// For each foot: peak force of a step beyond `max_contact_force`, in body weights (legged_gym's `feet_contact_forces`). Rises with
    /// `soft_epochs`.
    pub contact_forces: f32,
    /// In body weights.
    pub max_contact_force: f32,
    /// Sum of |torque x speed| of the joints, in body weights times 1 m/s. Rises with `soft_epochs`.
    pub power: f32,
    /// Epochs from the first to the last of which `air_time`, `duty_variance`, `still` and `fall` rise from an eighth to the whole.
    pub gait_epochs: [u64; 2],
    /// Epochs from the first to the last of which the widths of the tracking terms narrow to `velocity_width` and `turning_width`.
    pub narrow_epochs: [u64; 2],
    /// Epochs from the first to the last of which `landing`, `contact_forces` and `power` rise from nothing to the whole: from the start they
    /// keep a robot from walking at all.
    pub soft_epochs: [u64; 2],
    /// For each foot in the air: squared distance from `clearance_height`, in heights, times its horizontal speed \[m/s\].
    pub clearance: f32,
    /// Height of the foot's lowest point to swing at, as a share of the robot's height.
    pub clearance_height: f32,
    /// Squared horizontal speed of feet on the ground.
    pub slip: f32,
    /// For each pair of feet across (first and last leg, second and third) that are not together on or off the ground; what the clock says, too.
    pub pairs: f32,
    /// While the command says move, for each foot: that it is on the ground where the clock has it swing, or off it where it has it stand
    /// (Siekmann et al. 2021, with an indicator of contact instead of forces and speeds). Feet across are together, the two pairs half a
    /// stride apart. Without effect where there is no clock.
    pub clock: f32,
    /// Share of a stride that the clock has a foot stand.
    pub clock_duty: f32,
    /// For each limb that touches the ground.
    pub limbs: f32,
    /// While the command says stand: for each foot off the ground, and squared speed of the joints (times 0.02).
    pub still: f32,
    /// `1 / (1 + |mean v error|² / steady_width²)` and the same of the turning rate, where means are over the last `steady_time`: the sway of
    /// a gait leaves them, and a drift off the commanded path does not.
    pub steady: f32,
    /// \[m/s, rad/s\]
    pub steady_width: f32,
    /// About two strides \[s\].
    pub steady_time: f32,
    /// Once, for a fall.
    pub fall: f32,
}

/// Widths of the tracking terms at the beginning of a training, in those of its end: a robot that stands is rewarded for a little, the gait
/// is formed before what is exact costs it, and one that walks evenly is rewarded for being exact.
const WIDE: f32 = 2.5;
/// Share of the terms of the gait that a training begins with: in full they keep a robot that cannot walk from trying.
const FIRST: f32 = 0.125;

impl Reward {
    /// The weights in an epoch of a training.
    pub(crate) fn in_epoch(&self, epoch: u64) -> Self {
        let gait = FIRST + (1.0 - FIRST) * risen(self.gait_epochs, epoch);
        let soft = risen(self.soft_epochs, epoch);
        let wide = 1.0 + (WIDE - 1.0) * (1.0 - self.narrowed(epoch));
        Self {
            velocity_width: self.velocity_width * wide,
            turning_width: self.turning_width * wide,
            air_time: self.air_time * gait,
            duty_variance: self.duty_variance * gait,
            still: self.still * gait,
            fall: self.fall * gait,
            landing: self.landing * soft,
            contact_forces: self.contact_forces * soft,
            power: self.power * soft,
            ..self.clone()
        }
    }

    /// How far the widths of the tracking terms have narrowed in an epoch: 0 to 1.
    pub(crate) fn narrowed(&self, epoch: u64) -> f32 {
        risen(self.narrow_epochs, epoch)
    }

    /// The weights of the end of a training, for all epochs: for policies that walk.
    pub fn risen(self) -> Self {
        Self { gait_epochs: [0, 0], narrow_epochs: [0, 0], soft_epochs: [0, 0], ..self }
    }
}

/// Share of a weight that rises between two epochs.
fn risen([from, to]: [u64; 2], epoch: u64) -> f32 {
    if epoch >= to { 1.0 } else { epoch.saturating_sub(from) as f32 / (to - from) as f32 }
}

impl Default for Reward {
    fn default() -> Self {
        Self {
            velocity: 6.0,
            velocity_width: 0.08,
            turning: 3.0,
            turning_width: 0.08,
            bounce: 2.0,
            sway: 0.05,
            tilt: 2.5,
            height: 1.8,
            torque: 0.025,
            acceleration: 2.5e-7,
            action_rate: 0.02,
            action_jerk: 0.01,
            pose: 0.3,
            air_time: 24.0,
            swing: [0.28, 0.36],
            stance: [0.3, 0.5],
            duty_variance: 80.0,
            duty_time: 2.0,
            landing: 4.0,
            contact_forces: 3.0,
            max_contact_force: 0.8,
            power: 1.0,
            gait_epochs: [0, 3],
            narrow_epochs: [3, 5],
            soft_epochs: [1, 4],
            clearance: 3.0,
            clearance_height: 0.25,
            slip: 0.1,
            pairs: 0.0,
            clock: 1.5,
            clock_duty: 0.54,
            limbs: 0.5,
            still: 2.0,
            steady: 1.0,
            steady_width: 0.05,
            steady_time: 0.8,
            fall: 10.0,
        }
    }
}

/// When an episode ends early.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ends {
    /// Tilt of the base \[rad\].
    pub tilt: f32,
    /// Height of the base over the ground, as a share of that of the stand.
    pub height: f32,
    /// Whether the trunk must not touch.
    pub trunk: bool,
}

impl Default for Ends {
    fn default() -> Self {
        Self { tilt: 1.05, height: 0.5, trunk: true }
    }
}

/// Half widths of uniform noise (those of unitree_rl_lab's Go2).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Noise {
    /// \[rad/s\]
    pub gyro: f32,
    /// Of each component of gravity's direction.
    pub gravity: f32,
    /// \[rad\]
    pub position: f32,
    /// \[rad/s\]
    pub speed: f32,
}

impl Default for Noise {
    fn default() -> Self {
        Self { gyro: 0.2, gravity: 0.05, position: 0.01, speed: 1.5 }
    }
}

/// What differs from robot to robot, drawn anew with each episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Randomise {
    /// Parameters of the simulator by name, `*` for any joint, link, shape or material: least and greatest value. Each one that a `*`
    /// names is drawn by itself.
    pub parameters: BTreeMap<String, [f64; 2]>,
    /// The same, but all that a `*` names get one value.
    pub together: BTreeMap<String, [f64; 2]>,
    /// Greatest sudden change of the base's horizontal velocity \[m/s\].
    pub push: f32,
    /// Time from push to push, on average \[s\].
    pub push_every: f32,
    /// Half width of the joint angles at the start \[rad\].
    pub start_angle: f32,
    /// Half width of the base's horizontal velocity at the start \[m/s\].
    pub start_speed: f32,
}

impl Default for Randomise {
    fn default() -> Self {
        Self {
            parameters: BTreeMap::new(),
            together: BTreeMap::new(),
            push: 0.0,
            push_every: 7.0,
            start_angle: 0.1,
            start_speed: 0.2,
        }
    }
}

impl Randomise {
    /// What a robot outdoors should bear: friction 0.3 to 1.2, a trunk that is lighter or heavier, motors 15 % off, a late command,
    /// encoders 20 mrad off, pushes of 0.5 m/s (ranges of unitree_rl_lab's Go2, and the mission of this project).
    pub fn robust(base_link: &str) -> Self {
        let mut parameters = BTreeMap::new();
        let mut add = |name: &str, low: f64, high: f64| parameters.insert(name.to_owned(), [low, high]);
        add("contact.friction", 0.3, 1.2);
        add("material.*.friction", 0.3, 1.2);
        add(&format!("link.{base_link}.mass_scale"), 0.85, 1.4);
        add(&format!("link.{base_link}.com_x"), -0.03, 0.03);
        add(&format!("link.{base_link}.com_y"), -0.03, 0.03);
        add("actuator.*.kp_scale", 0.85, 1.15);
        add("actuator.*.kd_scale", 0.85, 1.15);
        add("actuator.*.strength", 0.85, 1.15);
        add("sensor.*.encoder_bias", -0.02, 0.02);
        let together = [("actuator.*.command_latency".to_owned(), [0.0, 0.015])].into();
        Self { parameters, together, push: 0.5, ..Self::default() }
    }
}

impl TaskSettings {
    /// Time between decisions \[s\].
    pub fn dt(&self) -> f32 {
        1.0 / self.rate
    }

    /// Physics time step \[s\].
    pub fn timestep(&self) -> f64 {
        1.0 / (f64::from(self.rate) * self.substeps as f64)
    }

    /// # Errors
    /// Names the first setting that means nothing.
    pub fn check(&self) -> Result<(), PolicyError> {
        let within = |what: &str, x: f32, low: f32, high: f32| {
            let expected = format!("{low} to {high}");
            if x >= low && x <= high { Ok(()) } else { Err(PolicyError::setting(what, &expected, x)) }
        };
        within("rate", self.rate, 1.0, 1000.0)?;
        within("substeps", self.substeps as f32, 1.0, 1000.0)?;
        within("iterations", self.iterations as f32, 1.0, 1000.0)?;
        within("clock", self.clock, 0.0, 0.5 * self.rate)?;
        within("reward.clock_duty", self.reward.clock_duty, 0.0, 1.0)?;
        within("episode", self.episode, 2.0 / self.rate, 1e4)?;
        within("commands.every", self.commands.every, 1.0 / self.rate, 1e4)?;
        within("commands.stand", self.commands.stand, 0.0, 1.0)?;
        for (what, [low, high]) in
            [("commands.vx", self.commands.vx), ("commands.vy", self.commands.vy), ("commands.wz", self.commands.wz)]
        {
            within(what, low, -100.0, high)?;
            within(what, high, low, 100.0)?;
        }
        let Reward { velocity_width, turning_width, .. } = self.reward;
        within("reward.velocity_width", velocity_width, 1e-6, 1e6)?;
        within("reward.turning_width", turning_width, 1e-6, 1e6)?;
        within("reward.duty_time", self.reward.duty_time, 1e-3, 1e4)?;
        within("commands.single_axis", self.commands.single_axis, 0.0, 1.0)?;
        within("commands.gap", self.commands.gap, 0.0, 100.0)?;
        let Noise { gyro, gravity, position, speed } = self.noise;
        let Randomise { start_angle, start_speed, .. } = self.randomise;
        let widths = [gyro, gravity, position, speed, start_angle, start_speed];
        within("half widths of noise and of starts", widths.into_iter().fold(f32::INFINITY, f32::min), 0.0, 1e3)?;
        within("randomise.push", self.randomise.push, 0.0, 100.0)?;
        within("randomise.push_every", self.randomise.push_every, 1.0 / self.rate, 1e6)?;
        let named = self.randomise.parameters.iter().chain(&self.randomise.together);
        for (name, [low, high]) in named {
            if !(low.is_finite() && high.is_finite() && low <= high) {
                let what = format!("randomise `{name}`");
                return Err(PolicyError::setting(&what, "a least and a greatest value", format!("{low} to {high}")));
            }
        }
        Ok(())
    }
}
