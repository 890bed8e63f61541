//! What a robot's topics mean: plain data that a robot's own crate fills in.

use crate::plan::Wanted;

/// A channel of a run that message fields go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs)]
pub enum Channel {
    CommandPosition,
    CommandVelocity,
    CommandTorque,
    CommandKp,
    CommandKd,
    Position,
    Velocity,
    Torque,
    Gyro,
    Acceleration,
    /// w, x, y, z
    Orientation,
    FootForce,
    /// x, y, z, then w, x, y, z
    BasePose,
}

impl Channel {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::CommandPosition => "command position",
            Self::CommandVelocity => "command velocity",
            Self::CommandTorque => "command torque",
            Self::CommandKp => "command kp",
            Self::CommandKd => "command kd",
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Torque => "torque",
            Self::Gyro => "gyro",
            Self::Acceleration => "acceleration",
            Self::Orientation => "orientation",
            Self::FootForce => "foot force",
            Self::BasePose => "base pose",
        }
    }
}

/// Message fields that make one channel, column after column.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFields {
    /// The channel.
    pub channel: Channel,
    /// Fields, put out one after the other; together as many numbers as the channel has columns.
    pub fields: Vec<Wanted>,
}

/// A stream of messages that a run is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamMapping {
    /// What it is, in words, such as `joint states`.
    pub role: &'static str,
    /// Topic taken when several carry a fitting type; otherwise the one with most messages is.
    pub preferred_topic: String,
    /// Whether no other topic will do.
    pub exact_topic: bool,
    /// Message types and, for each, its fields.
    pub types: Vec<(String, Vec<ChannelFields>)>,
}

/// How the messages of one robot become a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Mapping {
    /// Name of the robot, such as `go2`.
    pub robot: String,
    /// Joint names in the model's order.
    pub joint_names: Vec<String>,
    /// Position limits \[rad\], in the same order; used to suspect units and robots.
    pub position_limits: Vec<(f64, f64)>,
    /// Effort limits \[N m\], in the same order.
    pub effort_limits: Vec<f64>,
    /// Feet in the order of the foot force columns.
    pub foot_names: Vec<String>,
    /// IMU in the trunk frame \[m\].
    pub imu_position: [f64; 3],
    /// Definitions of the robot's own message types, for bags that carry none: name and text.
    pub definitions: Vec<(String, String)>,
    /// Streams; the one with [`Channel::Position`] gives time 0.
    pub streams: Vec<StreamMapping>,
}
