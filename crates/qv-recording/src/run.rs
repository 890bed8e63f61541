//! A run: what a robot recorded, on one clock, as plain data.

use qv_core::JointSeries;
use std::collections::BTreeMap;
use std::fmt;

/// Which robot the recording is of.
#[derive(Debug, Clone, PartialEq)]
pub enum Robot {
    /// A robot that the program knows by name, such as `go2`.
    Named(String),
    /// The text of a URDF.
    Urdf(String),
}

/// Whether the base was held or free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {
    /// Held in place.
    Fixed,
    /// Free to move.
    Free,
}

/// What the motors do with a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActuatorKind {
    /// `kp (q_des - q) + kd (dq_des - dq) + tau_ff`.
    Pd,
    /// The commanded torque alone.
    Torque,
}

/// How a gain of all joints is known.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum GainSource {
    /// By what is stated, of all joints or with each command.
    #[default]
    Stated,
    /// Not at all: as of a servo whose gain is a number of its register.
    Unknown,
    /// By `qv_replay::find_gains`, with this standard deviation as a share of it.
    Found(f64),
}

/// The actuator law, where the recording states it; `None` = per command or not stated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Actuator {
    /// The law.
    pub kind: ActuatorKind,
    /// Position gain of all joints \[N m / rad\].
    pub kp: Option<f64>,
    /// Velocity gain of all joints \[N m s / rad\].
    pub kd: Option<f64>,
    /// Clips the position and feed-forward part \[N m\].
    pub tau_max: Option<f64>,
    /// How the position gain is known, and the velocity gain.
    pub gains: [GainSource; 2],
}

/// What the recording states about one joint; `None` = not stated, the model's own value holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointParameters {
    /// Reflected rotor inertia \[kg m²\].
    pub armature: Option<f64>,
    /// Coulomb friction \[N m\].
    pub coulomb_friction: Option<f64>,
    /// Viscous friction \[N m s / rad\].
    pub viscous_friction: Option<f64>,
    /// Added to the model's angle to give the measured one \[rad\].
    pub position_offset: Option<f64>,
    /// Friction of a geared servo and springs: values of `joint.*.KEY` by [`qv_sim::servos::KEYS`].
    pub servo: BTreeMap<String, f64>,
    /// Clips the position and feed-forward part of its torque \[N m\], before [`Actuator::tau_max`].
    pub tau_max: Option<f64>,
}

/// Commands, each on its own stamps, columns in the order of the joints; held until the next stamp.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Commands {
    /// Desired positions \[rad\].
    pub position: Option<JointSeries>,
    /// Desired velocities \[rad/s\].
    pub velocity: Option<JointSeries>,
    /// Feed-forward torques \[N m\].
    pub torque: Option<JointSeries>,
    /// Position gains \[N m / rad\].
    pub kp: Option<JointSeries>,
    /// Velocity gains \[N m s / rad\].
    pub kd: Option<JointSeries>,
}

/// Measured channels; `None` = not measured. NaN within a series = not measured then.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measurements {
    /// Joint positions \[rad\], columns = joints.
    pub position: Option<JointSeries>,
    /// Joint velocities \[rad/s\], columns = joints.
    pub velocity: Option<JointSeries>,
    /// Joint torques \[N m\], columns = joints.
    pub torque: Option<JointSeries>,
    /// Angular velocity of the trunk in its own frame \[rad/s\], 3 columns.
    pub gyro: Option<JointSeries>,
    /// Specific force at the IMU in the trunk frame \[m/s²\], 3 columns; (0, 0, 9.81) at rest.
    pub acceleration: Option<JointSeries>,
    /// Orientation by the IMU, `world_from_base` as w, x, y, z, 4 columns; its yaw has an origin of its own.
    pub orientation: Option<JointSeries>,
    /// Foot force sensors in the robot's own unit (N on a Go2), columns = feet.
    pub foot_force: Option<JointSeries>,
    /// Pose `world_from_base` as x, y, z \[m\], w, x, y, z, 7 columns.
    pub base_pose: Option<JointSeries>,
}

/// What is wrong somewhere in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// No sample for more than five periods.
    Gap,
    /// Single samples missing.
    Drop,
    /// A sample that repeats the one before, bit by bit, in all columns.
    Repeat,
    /// A value that moved farther in one sample than the robot can.
    Jump,
    /// Stamps out of order; the samples were sorted.
    OutOfOrder,
    /// Two samples with one stamp; the first was kept.
    RepeatedStamp,
    /// The clock was set; the stretches were joined.
    ClockJump,
    /// Values that are not finite; kept as gaps.
    NotFinite,
    /// A column that stood still while others moved.
    Frozen,
    /// Positions too large for radians.
    DegreesSuspected,
    /// Positions beyond the joint's limits.
    BeyondLimits,
    /// Torques beyond the joint's limits.
    BeyondEffort,
    /// Joints or names that are not this robot's.
    WrongRobot,
    /// A sign, unit or order that is another convention's.
    Convention,
    /// A channel that is expected but was not recorded.
    Missing,
    /// Quaternions that are no rotation; those far from one are gaps, the others are read as the rotation nearest to them.
    NoRotation,
    /// A channel that lacks more values than it has.
    Sparse,
}

impl FaultKind {
    /// Whether part of the input could not be used as it is: the command line ends with 3 then.
    pub fn is_partial(self) -> bool {
        !matches!(
            self,
            Self::Drop
                | Self::Gap
                | Self::Repeat
                | Self::Jump
                | Self::BeyondEffort
                | Self::BeyondLimits
                | Self::Frozen
                | Self::Sparse
        )
    }
}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Gap => "gap",
            Self::Drop => "dropped samples",
            Self::Repeat => "repeated samples",
            Self::Jump => "jump",
            Self::OutOfOrder => "stamps out of order",
            Self::RepeatedStamp => "repeated stamps",
            Self::ClockJump => "clock jump",
            Self::NotFinite => "values not finite",
            Self::Frozen => "frozen",
            Self::DegreesSuspected => "degrees suspected",
            Self::BeyondLimits => "beyond joint limits",
            Self::BeyondEffort => "beyond effort limits",
            Self::WrongRobot => "wrong robot",
            Self::Convention => "another convention",
            Self::Missing => "not recorded",
            Self::NoRotation => "no rotation",
            Self::Sparse => "mostly missing",
        })
    }
}

/// One finding.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Fault {
    /// What kind of fault.
    pub kind: FaultKind,
    /// Channel, such as `/lowstate` or `position FL_hip_joint`.
    pub channel: String,
    /// Time of the first one \[s, on the run's clock\].
    pub time: f64,
    /// How many samples.
    pub count: usize,
    /// The figures, in words.
    pub detail: String,
}

/// A part of the input that could not be read.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Loss {
    /// File or table.
    pub file: String,
    /// What was lost and why.
    pub what: String,
    /// Nanoseconds since the epoch of the first and last message lost, where the file says so.
    pub span: Option<[u64; 2]>,
}

/// Where stamps come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// The stamp in the message's header.
    Header,
    /// When the recorder logged the message.
    Log,
    /// When the sender published the message by the file (MCAP's `publish_time`): messages were logged in bursts.
    Published,
    /// The sender's own count of milliseconds (`tick`): messages were logged in bursts.
    Tick,
    /// The `time` column of a table.
    Column,
}

impl Clock {
    /// Whether it is the sender's, by which messages may be logged in another order than they were sent in.
    pub fn is_of_sender(self) -> bool {
        matches!(self, Self::Published | Self::Tick)
    }
}

/// A stream of the recording, used or not.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Source {
    /// Topic, or group of columns.
    pub name: String,
    /// Message type.
    pub type_name: String,
    /// Number of messages.
    pub count: usize,
    /// Median rate \[Hz\]; NaN with fewer than two messages.
    pub rate: f64,
    /// Root mean square of (interval - median interval) \[s\], gaps and drops left out.
    pub jitter: f64,
    /// First and last stamp \[s, on the run's clock\].
    pub span: [f64; 2],
    /// Where its stamps come from.
    pub clock: Clock,
    /// Whether the run uses it.
    pub used: bool,
}

/// What a robot recorded. Times are seconds from the first joint state.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// The robot.
    pub robot: Robot,
    /// Whether its base was free.
    pub base: Base,
    /// Names of the joints, in the model's order; `n` of them.
    pub joint_names: Vec<String>,
    /// Names of the feet, in the order of the foot force columns.
    pub foot_names: Vec<String>,
    /// Where the IMU sits in the trunk frame \[m\].
    pub imu_position: [f64; 3],
    /// The actuator law.
    pub actuator: Actuator,
    /// What is stated about each joint, shape `[n]`.
    pub joint_parameters: Vec<JointParameters>,
    /// What was commanded.
    pub commands: Commands,
    /// What was measured.
    pub measured: Measurements,
    /// The instant of time 0 \[ns since the epoch\]; 0 for a table.
    pub epoch: u64,
    /// All streams of the recording.
    pub sources: Vec<Source>,
    /// What is wrong with the data.
    pub faults: Vec<Fault>,
    /// What could not be read.
    pub lost: Vec<Loss>,
    /// How the recording was read where that is not as a matter of course, such as its unit of time; a sentence each.
    pub remarks: Vec<String>,
}

impl Run {
    /// A run in which nothing is recorded yet, of PD actuators whose gains stand in the commands.
    pub fn empty(robot: Robot, base: Base, joint_names: Vec<String>) -> Self {
        Self {
            robot,
            base,
            foot_names: Vec::new(),
            imu_position: [0.0; 3],
            actuator: Actuator {
                kind: ActuatorKind::Pd,
                kp: None,
                kd: None,
                tau_max: None,
                gains: [GainSource::Stated; 2],
            },
            joint_parameters: vec![JointParameters::default(); joint_names.len()],
            joint_names,
            commands: Commands::default(),
            measured: Measurements::default(),
            epoch: 0,
            sources: Vec::new(),
            faults: Vec::new(),
            lost: Vec::new(),
            remarks: Vec::new(),
        }
    }

    /// Number of joints `n`.
    pub fn joints(&self) -> usize {
        self.joint_names.len()
    }

    /// First and last joint state \[s\]; zeros when there is none.
    pub fn span(&self) -> [f64; 2] {
        match self.measured.position.as_ref() {
            Some(s) if !s.is_empty() => [s.time[0], s.time[s.len() - 1]],
            _ => [0.0, 0.0],
        }
    }

    /// Whether part of the input was lost or could not be used as it is.
    pub fn is_partial(&self) -> bool {
        !self.lost.is_empty() || self.faults.iter().any(|f| f.kind.is_partial())
    }

    /// Joints of which no command was recorded, while there are commands of others: a name that is written in two ways makes some.
    pub fn uncommanded(&self) -> Vec<&str> {
        let recorded: Vec<&JointSeries> =
            [&self.commands.position, &self.commands.torque].into_iter().flatten().filter(|s| !s.is_empty()).collect();
        let has_none = |k: &usize| recorded.iter().all(|s| !s.column(*k).any(f64::is_finite));
        let none: Vec<usize> = (0..self.joints()).filter(has_none).collect();
        if none.len() == self.joints() { vec![] } else { none.iter().map(|&k| self.joint_names[k].as_str()).collect() }
    }

    /// Says which they are, in a line.
    pub(crate) fn note_uncommanded(&mut self) {
        let names = self.uncommanded().join(", ");
        if !names.is_empty() {
            self.remarks.push(format!("no commands were recorded of {names}: they are taken for 0"));
        }
    }

    /// Size of the decoded series \[bytes\].
    pub fn bytes(&self) -> usize {
        let (c, m) = (&self.commands, &self.measured);
        let all = [&c.position, &c.velocity, &c.torque, &c.kp, &c.kd, &m.position, &m.velocity, &m.torque];
        let rest = [&m.gyro, &m.acceleration, &m.orientation, &m.foot_force, &m.base_pose];
        let size = |s: &&Option<JointSeries>| s.as_ref().map_or(0, |s| 8 * (s.time.len() + s.values.len()));
        all.iter().map(size).sum::<usize>() + rest.iter().map(size).sum::<usize>()
    }
}
