//! `replay.mcap`: simulated beside recorded, as a ROS 2 bag that Foxglove and the `mcap` tools of other languages open.

use crate::joint_state::{joint_state_bytes, row};
use crate::scene_out::{self, RobotDrawing};
use crate::{Replay, ReplayError};
use mcap::records::MessageHeader;
use qv_recording::cdr::Writer;
use qv_rollout::Trace;
use qv_sim::Model;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

const HEADER: &str = "================================================================================\n\
MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
================================================================================\n\
MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const JOINT_STATE: &str =
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n";
const POSE_STAMPED: &str = "std_msgs/Header header\ngeometry_msgs/Pose pose\n\
================================================================================\n\
MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n\
================================================================================\n\
MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n\
================================================================================\n\
MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";
const TF_MESSAGE: &str = "geometry_msgs/TransformStamped[] transforms\n\
================================================================================\n\
MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n\
geometry_msgs/Transform transform\n\
================================================================================\n\
MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n\
================================================================================\n\
MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n\
================================================================================\n\
MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";

const TWIST: &str = "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n\
================================================================================\n\
MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";

/// One robot of a recording, on topics below `/<name>`. What is empty is not written.
#[derive(Debug, Clone, Copy)]
pub struct BagRobot<'a> {
    /// Name of the topics' first part.
    pub name: &'a str,
    /// Joint names, `[n]`.
    pub joints: &'a [String],
    /// Times, joints, base, and the force on each foot. The times of the first robot are those of all.
    pub trace: &'a Trace,
    /// Joint targets \[rad\], `[T, n]`, each in force until its time: `/<name>/joint_targets`, a `JointState` with the stamp of the
    /// time before, from which on it holds.
    pub targets: &'a [f64],
    /// Commanded velocity: forwards, to the left \[m/s\], turning \[rad/s\], `[T]`: `/<name>/cmd_vel`, a `Twist`.
    pub commands: &'a [[f64; 3]],
    /// Names of the feet: with them `/<name>/foot_forces` holds the trace's forces as efforts of a `JointState`.
    pub feet: &'a [String],
    /// Frames in `/tf`; where there are none, the base is the frame `<name>_base`.
    pub frames: &'a [FrameTrace],
    /// Text of the URDF, once, on `/robot_description`.
    pub urdf: Option<&'a str>,
}

/// A frame that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTrace {
    /// The frame's name.
    pub name: String,
    /// The frame that its poses are in.
    pub parent: String,
    /// `parent_from_frame` as x, y, z \[m\], w, x, y, z, shape `[T]`.
    pub poses: Vec<[f64; 7]>,
}

impl<'a> BagRobot<'a> {
    /// Joint states and base alone.
    pub fn new(name: &'a str, joints: &'a [String], trace: &'a Trace) -> Self {
        Self { name, joints, trace, targets: &[], commands: &[], feet: &[], frames: &[], urdf: None }
    }
}

/// Colours of what is drawn of the recorded and of the simulated robot.
const COLOURS: [[f64; 3]; 2] = [[0.95, 0.45, 0.1], [0.15, 0.5, 0.95]];

/// What is written beside robots: topics, and the messages of a sample as the index of the topic and its bytes.
struct Beside<'a> {
    topics: Vec<(String, [&'static str; 2])>,
    at: &'a dyn Fn(usize, u64) -> Vec<(usize, Vec<u8>)>,
}

/// Writes joint states, base poses and transforms of the recording and of the whole simulated run of `model`, on topics below
/// `/recorded` and `/simulated`; below these also `scene`, forces on feet and slips as `foxglove.SceneUpdate`. `/error/whole` and
/// `/error/windows` are simulated minus recorded, joint by joint. `epoch` \[ns\] is the instant of time 0.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_mcap(replay: &Replay, model: &Model, epoch: u64, out: impl Write + Seek) -> Result<(), ReplayError> {
    let side = |name, trace| BagRobot { feet: &replay.feet.names, ..BagRobot::new(name, &replay.joint_names, trace) };
    let robots = [side("recorded", &replay.recorded), side("simulated", &replay.whole)].map(|robot| {
        let is_known = robot.trace.foot_force.len() == robot.feet.len() * robot.trace.time.len();
        if is_known { robot } else { BagRobot { feet: &[], ..robot } }
    });
    let drawn = [0, 1].map(|k| RobotDrawing::new(NAMES[k], COLOURS[k], robots[k].trace, &replay.feet, model));
    let mut topics: Vec<(String, [&str; 2])> = ["/error/whole", "/error/windows"]
        .map(|topic| (topic.into(), ["sensor_msgs/msg/JointState", JOINT_STATE]))
        .into();
    topics.extend(drawn.iter().flatten().map(|one| (one.topic(), [scene_out::NAME, scene_out::DEFINITION])));
    let at = |i: usize, stamp: u64| {
        let errors = [scene_out::whole_error(replay, i, stamp), scene_out::window_error(replay, i, stamp)];
        let shown = drawn.iter().zip(&robots).filter_map(|(one, robot)| one.as_ref().map(|one| (one, robot)));
        let scenes = shown.map(|(one, robot)| one.at(robot.trace, &replay.feet, i, stamp));
        errors.into_iter().chain(scenes).enumerate().filter_map(|(topic, data)| Some((topic, data?))).collect()
    };
    finished(write(&robots, &Beside { topics, at: &at }, epoch, out))
}

/// First parts of the topics of a replay.
const NAMES: [&str; 2] = ["recorded", "simulated"];

fn finished(written: Result<(), mcap::McapError>) -> Result<(), ReplayError> {
    written.map_err(|e| ReplayError::Write { what: "replay.mcap".into(), reason: e.to_string() })
}

/// Writes robots beside each other, see [`BagRobot`]. `epoch` \[ns\] is the instant of time 0. Same robots, same bytes.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_traces(robots: &[BagRobot], epoch: u64, out: impl Write + Seek) -> Result<(), ReplayError> {
    finished(write(robots, &Beside { topics: vec![], at: &|_, _| vec![] }, epoch, out))
}

/// Channels of one robot; those of what it does not have are not there.
struct Channels {
    joints: u16,
    pose: u16,
    targets: Option<u16>,
    commands: Option<u16>,
    feet: Option<u16>,
}

impl Channels {
    fn new<W: Write + Seek>(writer: &mut mcap::Writer<W>, robot: &BagRobot) -> Result<Self, mcap::McapError> {
        let [joint_state, pose] =
            [("sensor_msgs/msg/JointState", JOINT_STATE), ("geometry_msgs/msg/PoseStamped", POSE_STAMPED)]
                .map(|(name, text)| writer.add_schema(name, "ros2msg", format!("{text}{HEADER}").as_bytes()));
        let (joint_state, pose) = (joint_state?, pose?);
        let none = BTreeMap::new();
        let mut add =
            |schema: u16, what: &str| writer.add_channel(schema, &format!("/{}/{what}", robot.name), "cdr", &none);
        let (joints, pose) = (add(joint_state, "joint_states")?, add(pose, "base_pose")?);
        let mut states_of = |there: bool, what: &str| there.then(|| add(joint_state, what)).transpose();
        let targets = states_of(!robot.targets.is_empty(), "joint_targets")?;
        let feet = states_of(!robot.feet.is_empty(), "foot_forces")?;
        let commands = match robot.commands.is_empty() {
            true => None,
            false => {
                let twist = writer.add_schema("geometry_msgs/msg/Twist", "ros2msg", TWIST.as_bytes())?;
                Some(writer.add_channel(twist, &format!("/{}/cmd_vel", robot.name), "cdr", &none)?)
            }
        };
        Ok(Self { joints, pose, targets, commands, feet })
    }
}

fn write(robots: &[BagRobot], beside: &Beside, epoch: u64, out: impl Write + Seek) -> Result<(), mcap::McapError> {
    // Single-threaded and without a library stamp of its own: the same robots give the same bytes.
    let options = mcap::WriteOptions::new().profile("ros2").compression(Some(mcap::Compression::Zstd));
    let options = options.compression_level(1).compression_threads(0);
    let mut writer = options.create(out)?;
    let none = BTreeMap::new();
    let schema = writer.add_schema("tf2_msgs/msg/TFMessage", "ros2msg", format!("{TF_MESSAGE}{HEADER}").as_bytes())?;
    let transform = writer.add_channel(schema, "/tf", "cdr", &none)?;
    let channels: Vec<Channels> = robots.iter().map(|r| Channels::new(&mut writer, r)).collect::<Result<_, _>>()?;
    let mut others = Vec::new();
    for (topic, [name, definition]) in &beside.topics {
        // Definitions of messages with a header end with that of the header.
        let ending = if *name == scene_out::NAME { "" } else { HEADER };
        let schema = writer.add_schema(name, "ros2msg", format!("{definition}{ending}").as_bytes())?;
        others.push(writer.add_channel(schema, topic, "cdr", &none)?);
    }
    let times = robots.first().map_or(&[][..], |r| &r.trace.time);
    let stamp_of = |t: f64| epoch.saturating_add_signed((t * 1e9).round() as i64);
    let mut sequence = 0;
    let mut put = |writer: &mut mcap::Writer<_>, channel: u16, stamp: u64, data: Vec<u8>| {
        sequence += 1;
        let header = MessageHeader { channel_id: channel, sequence, log_time: stamp, publish_time: stamp };
        writer.write_to_known_channel(&header, &data)
    };
    if let (Some(&first), Some(&second)) = (times.first(), times.get(1)) {
        let stamp = stamp_of(first - (second - first));
        for (robot, channels) in robots.iter().zip(&channels) {
            if let Some((channel, data)) = targets(robot, channels, stamp, 0) {
                put(&mut writer, channel, stamp, data)?;
            }
        }
    }
    if let (Some(urdf), Some(&t)) = (robots.iter().find_map(|r| r.urdf), times.first()) {
        let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data\n")?;
        let channel = writer.add_channel(schema, "/robot_description", "cdr", &none)?;
        let mut text = Writer::new();
        text.string(urdf);
        put(&mut writer, channel, stamp_of(t), text.finish())?;
    }
    for (i, &t) in times.iter().enumerate() {
        let stamp = stamp_of(t);
        for (robot, channels) in robots.iter().zip(&channels) {
            for (channel, data) in messages(robot, channels, stamp, i) {
                put(&mut writer, channel, stamp, data)?;
            }
            let frames = transforms(robot, i);
            if !frames.is_empty() {
                put(&mut writer, transform, stamp, transform_bytes(stamp, &frames))?;
            }
        }
        for (topic, data) in (beside.at)(i, stamp) {
            put(&mut writer, others[topic], stamp, data)?;
        }
    }
    writer.finish()?;
    Ok(())
}

/// All but transforms of one robot at one instant.
fn messages(robot: &BagRobot, channels: &Channels, stamp: u64, i: usize) -> Vec<(u16, Vec<u8>)> {
    let (trace, n) = (robot.trace, robot.trace.joints);
    let states = [&trace.position, &trace.velocity, &trace.torque].map(|values| row(values, i, n));
    let mut out = vec![(channels.joints, joint_state_bytes(stamp, robot.joints, states))];
    if let Some(base) = finite(trace.base.get(i)) {
        out.push((channels.pose, pose_bytes(stamp, base)));
    }
    out.extend(targets(robot, channels, stamp, i + 1));
    if let Some(channel) = channels.feet {
        let forces = row(&trace.foot_force, i, robot.feet.len());
        out.push((channel, joint_state_bytes(stamp, robot.feet, [&[], &[], forces])));
    }
    if let (Some(channel), Some([vx, vy, wz])) = (channels.commands, robot.commands.get(i)) {
        let mut w = Writer::new();
        [*vx, *vy, 0.0, 0.0, 0.0, *wz].iter().for_each(|&x| {
            w.f64(x);
        });
        out.push((channel, w.finish()));
    }
    out
}

/// The targets of row `i`, where there is one.
fn targets(robot: &BagRobot, channels: &Channels, stamp: u64, i: usize) -> Option<(u16, Vec<u8>)> {
    let row = row(robot.targets, i, robot.trace.joints);
    let data = || joint_state_bytes(stamp, robot.joints, [row, &[], &[]]);
    channels.targets.filter(|_| !row.is_empty()).map(|channel| (channel, data()))
}

/// Parent, child and pose of each frame of a robot at one instant.
fn transforms<'a>(robot: &'a BagRobot, i: usize) -> Vec<(String, String, &'a [f64; 7])> {
    if robot.frames.is_empty() {
        let base = finite(robot.trace.base.get(i));
        return base.map(|base| ("world".into(), format!("{}_base", robot.name), base)).into_iter().collect();
    }
    let frame = |f: &'a FrameTrace| Some((f.parent.clone(), f.name.clone(), finite(f.poses.get(i))?));
    robot.frames.iter().filter_map(frame).collect()
}

fn finite(pose: Option<&[f64; 7]>) -> Option<&[f64; 7]> {
    pose.filter(|p| p.iter().all(|x| x.is_finite()))
}

fn quaternion(w: &mut Writer, base: &[f64; 7]) {
    let [x, y, z, qw, qx, qy, qz] = *base;
    w.f64(x).f64(y).f64(z).f64(qx).f64(qy).f64(qz).f64(qw);
}

fn pose_bytes(stamp: u64, base: &[f64; 7]) -> Vec<u8> {
    let mut w = Writer::new();
    w.time(stamp).string("world");
    quaternion(&mut w, base);
    w.finish()
}

fn transform_bytes(stamp: u64, frames: &[(String, String, &[f64; 7])]) -> Vec<u8> {
    let mut w = Writer::new();
    w.u32(frames.len() as u32);
    for (parent, child, pose) in frames {
        w.time(stamp).string(parent).string(child);
        quaternion(&mut w, pose);
    }
    w.finish()
}
