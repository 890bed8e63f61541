//! `replay.mcap`: simulated beside recorded, as a ROS 2 bag that Foxglove and the `mcap` tools of other languages open.

use crate::ReplayError;
use crate::cdr::Writer;
use crate::replay::{Replay, Trace};
use mcap::records::MessageHeader;
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

/// Writes joint states, base poses and transforms of the recording and of the whole simulated run, on topics below
/// `/recorded` and `/simulated`. `epoch` \[ns\] is the instant of time 0.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_mcap(replay: &Replay, epoch: u64, out: impl Write + Seek) -> Result<(), ReplayError> {
    write(replay, epoch, out).map_err(|e| ReplayError::Write { what: "replay.mcap".into(), reason: e.to_string() })
}

struct Channels {
    joints: u16,
    pose: u16,
    transform: u16,
}

fn write(replay: &Replay, epoch: u64, out: impl Write + Seek) -> Result<(), mcap::McapError> {
    // Single-threaded and without a library stamp of its own: the same replay gives the same bytes.
    let options = mcap::WriteOptions::new().profile("ros2").compression(Some(mcap::Compression::Zstd));
    let options = options.compression_level(1).compression_threads(0);
    let mut writer = options.create(out)?;
    let mut schema = |name: &str, text: &str| writer.add_schema(name, "ros2msg", format!("{text}{HEADER}").as_bytes());
    let joint_state = schema("sensor_msgs/msg/JointState", JOINT_STATE)?;
    let pose = schema("geometry_msgs/msg/PoseStamped", POSE_STAMPED)?;
    let transform = schema("tf2_msgs/msg/TFMessage", TF_MESSAGE)?;
    let none = BTreeMap::new();
    let transform = writer.add_channel(transform, "/tf", "cdr", &none)?;
    let mut sides = Vec::new();
    for (side, trace) in [("recorded", &replay.recorded), ("simulated", &replay.whole)] {
        let joints = writer.add_channel(joint_state, &format!("/{side}/joint_states"), "cdr", &none)?;
        let pose = writer.add_channel(pose, &format!("/{side}/base_pose"), "cdr", &none)?;
        sides.push((side, trace, Channels { joints, pose, transform }));
    }
    let mut sequence = 0;
    for (i, &t) in replay.recorded.time.iter().enumerate() {
        let stamp = epoch.saturating_add_signed((t * 1e9).round() as i64);
        for (side, trace, channels) in &sides {
            let mut put = |channel: u16, data: Vec<u8>| {
                sequence += 1;
                let header = MessageHeader { channel_id: channel, sequence, log_time: stamp, publish_time: stamp };
                writer.write_to_known_channel(&header, &data)
            };
            put(channels.joints, joint_state_bytes(stamp, &replay.joint_names, trace, i))?;
            if let Some(base) = trace.base.get(i).filter(|b| b.iter().all(|x| x.is_finite())) {
                put(channels.pose, pose_bytes(stamp, base))?;
                put(channels.transform, transform_bytes(stamp, &format!("{side}_base"), base))?;
            }
        }
    }
    writer.finish()?;
    Ok(())
}

fn row(values: &[f64], i: usize, n: usize) -> &[f64] {
    values.get(i * n..(i + 1) * n).unwrap_or(&[])
}

fn joint_state_bytes(stamp: u64, names: &[String], trace: &Trace, i: usize) -> Vec<u8> {
    let mut w = Writer::new();
    w.time(stamp).string("").u32(names.len() as u32);
    names.iter().for_each(|n| {
        w.string(n);
    });
    for values in [&trace.position, &trace.velocity, &trace.torque] {
        w.f64_sequence(row(values, i, trace.joints));
    }
    w.finish()
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

fn transform_bytes(stamp: u64, child: &str, base: &[f64; 7]) -> Vec<u8> {
    let mut w = Writer::new();
    w.u32(1).time(stamp).string("world").string(child);
    quaternion(&mut w, base);
    w.finish()
}
