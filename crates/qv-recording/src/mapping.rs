//! What a robot's topics mean: plain data that a robot's file fills in ([`crate::robots`]).

use crate::RecordingError;
use crate::plan::FieldSelection;

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

/// Message fields that make one channel, column after column.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFields {
    /// The channel.
    pub channel: Channel,
    /// Fields, put out one after the other; together as many numbers as the channel has columns. Where the message names its
    /// joints, one path of a list as long as that of the names, and no elements.
    pub fields: Vec<FieldSelection>,
}

/// A type of message that a stream may have.
#[derive(Debug, Clone, PartialEq)]
pub struct MessageMapping {
    /// Its name, such as `sensor_msgs/msg/JointState`.
    pub name: String,
    /// Field with the names of the joints, where the message has them.
    pub names: Option<String>,
    /// What is read of it.
    pub fields: Vec<ChannelFields>,
}

/// A stream of messages that a run is made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StreamMapping {
    /// What it is, in words, such as `joint states`.
    pub role: String,
    /// Topic taken when several carry a fitting type; otherwise the one with most messages is.
    pub preferred_topic: String,
    /// Whether no other topic will do.
    pub exact_topic: bool,
    /// How else the names of its topics may end; with the preferred one they show a robot's namespace.
    pub endings: Vec<String>,
    /// Whether topics with other endings are no such stream.
    pub only_endings: bool,
    /// Topics that repeat it, so that they are no second robot.
    pub copies: Vec<String>,
    /// Whether a recording without it lacks nothing.
    pub optional: bool,
    /// Message types.
    pub messages: Vec<MessageMapping>,
}

/// How the messages of one robot become a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mapping {
    /// Name of the robot, such as `go2`.
    pub robot: String,
    /// Whether it fits any robot, so that a mapping of a certain robot is preferred.
    pub generic: bool,
    /// Joint names in the model's order; none where the messages name them.
    pub joint_names: Vec<String>,
    /// Position limits \[rad\], in the same order; used to suspect units and robots.
    pub position_limits: Vec<(f64, f64)>,
    /// Effort limits \[N m\], in the same order.
    pub effort_limits: Vec<f64>,
    /// Feet in the order of the foot force columns.
    pub foot_names: Vec<String>,
    /// IMU in the trunk frame \[m\].
    pub imu_position: [f64; 3],
    /// Roll, pitch, yaw of the IMU on the trunk \[rad\], whose channels are in the sensor's axes then.
    pub imu_rotation: Option<[f64; 3]>,
    /// Gains of each joint, where no message has them: position \[N m/rad\] and velocity \[N m s/rad\]. One of each holds for all
    /// joints where the messages name them.
    pub gains: Option<[Vec<f64>; 2]>,
    /// Topic with the text of the robot's URDF.
    pub description_topic: Option<String>,
    /// Definitions of the robot's own message types, for bags that carry none: name and text.
    pub definitions: Vec<(String, String)>,
    /// Streams; the one with [`Channel::Position`] gives time 0.
    pub streams: Vec<StreamMapping>,
}

impl Mapping {
    /// The same with the base pose from `topic` alone, where one is given.
    pub fn with_pose_topic(mut self, topic: Option<&str>) -> Self {
        let has_pose =
            |s: &StreamMapping| s.messages.iter().any(|m| m.fields.iter().any(|f| f.channel == Channel::BasePose));
        if let (Some(topic), Some(stream)) = (topic, self.streams.iter_mut().find(|s| has_pose(s))) {
            topic.clone_into(&mut stream.preferred_topic);
            stream.exact_topic = true;
        }
        self
    }
}

/// The stream that a topic could be, and which of the stream's messages it has: one whose ending it has before others.
pub(crate) fn stream_of(mapping: &Mapping, topic: &str, type_name: &str) -> Option<(usize, usize)> {
    let message = |stream: &StreamMapping| stream.messages.iter().position(|m| m.name == type_name);
    let fits = |stream: &StreamMapping| match (stream.exact_topic, stream.only_endings) {
        (true, _) => stream.preferred_topic == topic,
        (false, true) => namespace_of(stream, topic).is_some(),
        (false, false) => true,
    };
    let all = mapping.streams.iter().enumerate().filter(|(_, s)| fits(s));
    let all = all.filter_map(|(s, stream)| Some((s, message(stream)?, namespace_of(stream, topic).is_some())));
    let all: Vec<(usize, usize, bool)> = all.collect();
    let own = all.iter().find(|(_, _, has_ending)| *has_ending).or(all.first());
    own.map(|(s, m, _)| (*s, *m))
}

/// What comes before one of a stream's endings in the name of a topic, up to a slash.
pub(crate) fn namespace_of<'a>(stream: &StreamMapping, topic: &'a str) -> Option<&'a str> {
    let endings = std::iter::once(&stream.preferred_topic).chain(&stream.endings);
    endings.filter_map(|ending| topic.strip_suffix(ending.as_str()).map(|before| (ending, before))).find_map(
        |(ending, before)| {
            let end = if ending.starts_with('/') { before.len() } else { before.rfind('/')? };
            Some(&before[..end]).filter(|ns| ns.is_empty() || ns.starts_with('/'))
        },
    )
}

/// Index of the stream with the joint states.
///
/// # Errors
/// The mapping has none.
pub(crate) fn state_stream(mapping: &Mapping) -> Result<usize, RecordingError> {
    let has = |s: &StreamMapping| s.messages.iter().any(|m| m.fields.iter().any(|f| f.channel == Channel::Position));
    let found = mapping.streams.iter().position(has);
    found.ok_or_else(|| RecordingError::run("mapping", "a stream with joint positions", "none"))
}
