//! `replay.mcap` and `robot.urdf` of a walk: what Foxglove and ROS 2 tools open.

use crate::Failure;
use crate::output::write_whole;
use qv_core::Pose;
use qv_policy::play::WalkTrace;
use qv_replay::{BagRobot, FrameTrace, write_traces};

use qv_rollout::Trace;
use qv_sim::{BaseKind, Model, ModelOptions};
use std::io::Cursor;
use std::path::Path;

/// First part of the topics.
const NAME: &str = "policy";

/// Writes what a robot did to `path`, and its URDF to `robot.urdf` beside it.
///
/// Topics: `/policy/joint_states`, `/policy/joint_targets`, `/policy/base_pose`, `/policy/cmd_vel`, `/policy/foot_forces`, `/tf` of all
/// links, `/robot_description`. Time 0 is the start of the walk, the first message comes after the first decision.
///
/// # Errors
/// When the URDF is not that of the robot, or a file cannot be written.
pub fn write_recording(path: &Path, played: &WalkTrace, urdf: &str) -> Result<(), Failure> {
    write_whole(path, &recording(played, urdf)?)?;
    write_whole(&path.with_file_name("robot.urdf"), urdf.as_bytes())
}

/// The bytes of the recording.
fn recording(played: &WalkTrace, urdf: &str) -> Result<Vec<u8>, Failure> {
    let options = ModelOptions { base: BaseKind::Floating, ..Default::default() };
    let model = Model::from_urdf(urdf, &options)?;
    if model.joint_names() != played.joints {
        let [expected, found] = [&played.joints, model.joint_names()].map(|names| names.join(" "));
        return Err(format!("URDF of the recording: expected joints {expected}, found {found}").into());
    }
    let (trace, frames) = (trace(played), frames(&model, played));
    let targets: Vec<f64> = wide(&played.targets);
    let commands: Vec<[f64; 3]> = played.commands.iter().map(|c| [c[0], c[1], c[2]].map(f64::from)).collect();
    let robot = BagRobot {
        targets: &targets,
        commands: &commands,
        feet: &played.feet,
        frames: &frames,
        urdf: Some(urdf),
        ..BagRobot::new(NAME, &played.joints, &trace)
    };
    let mut bytes = Cursor::new(Vec::new());
    write_traces(&[robot], 0, &mut bytes)?;
    Ok(bytes.into_inner())
}

fn wide(rows: &[Vec<f32>]) -> Vec<f64> {
    rows.iter().flatten().map(|&x| f64::from(x)).collect()
}

fn trace(played: &WalkTrace) -> Trace {
    let base = |q: &Vec<f32>| std::array::from_fn(|k| q.get(k).map_or(f64::NAN, |&x| f64::from(x)));
    Trace {
        time: (1..=played.q.len()).map(|k| k as f64 / f64::from(played.rate)).collect(),
        position: played.q.iter().flat_map(|q| q.iter().skip(7)).map(|&x| f64::from(x)).collect(),
        velocity: wide(&played.dq),
        torque: wide(&played.torques),
        foot_force: wide(&played.foot_forces),
        base: played.q.iter().map(base).collect(),
        joints: played.joints.len(),
    }
}

/// Every link below its parent, then every frame that is fixed to a link, so that all names of the URDF are there.
fn frames(model: &Model, played: &WalkTrace) -> Vec<FrameTrace> {
    let steps: Vec<Vec<Pose>> = played.q.iter().map(|q| model.world_from_links(&padded(q, model.nq()))).collect();
    let links = model.links.iter().enumerate().map(|(l, link)| {
        let pose = |links: &Vec<Pose>| match link.parent {
            Some(parent) => numbers(&(links[parent].inverse() * links[l])),
            None => numbers(&links[l]),
        };
        let parent = link.parent.map_or("world", |parent| &model.links[parent].name);
        FrameTrace { name: link.name.clone(), parent: parent.into(), poses: steps.iter().map(pose).collect() }
    });
    let fixed = model.frames.iter().filter_map(|frame| {
        let parent = &model.links[frame.link?].name;
        let poses = vec![numbers(&frame.link_from_frame); steps.len()];
        (frame.name != *parent).then(|| FrameTrace { name: frame.name.clone(), parent: parent.clone(), poses })
    });
    links.chain(fixed).collect()
}

/// Positions as wide as the model wants them.
fn padded(q: &[f32], length: usize) -> Vec<f64> {
    let mut q: Vec<f64> = q.iter().map(|&x| f64::from(x)).collect();
    q.resize(length, 0.0);
    q
}

fn numbers(pose: &Pose) -> [f64; 7] {
    let ([x, y, z], [qw, qx, qy, qz]) = (pose.position.to_array(), pose.wxyz());
    [x, y, z, qw, qx, qy, qz]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::walk::example::made_up;
    use qv_recording::cdr::decode;
    use qv_recording::schema::Schema;
    use std::collections::BTreeMap;

    #[test]
    fn what_is_written_is_read_back() {
        let (played, urdf) = (made_up(100), qv_go2::model::urdf_with_shapes());
        let bytes = recording(&played, &urdf).unwrap();
        assert_eq!(bytes, recording(&played, &urdf).unwrap(), "same inputs, same bytes");
        let (mut counts, mut last) = (BTreeMap::<String, usize>::new(), 0);
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            assert!(message.log_time >= last, "times run forwards");
            last = message.log_time;
            let topic = message.channel.topic.clone();
            let count = counts.entry(topic.clone()).or_default();
            *count += 1;
            let schema = message.channel.schema.as_ref().unwrap();
            let definition = std::str::from_utf8(&schema.data).unwrap();
            let value = decode(&Schema::parse(&schema.name, definition).unwrap(), &message.data).unwrap();
            let number = |path: &str| value.get(path).and_then(|v| v.as_f64());
            if *count == 10 && topic == "/policy/base_pose" {
                assert_eq!(message.log_time, 200_000_000);
                assert_eq!(number("pose.position.x"), Some(f64::from(played.q[9][0])));
            }
            if *count == 10 && topic == "/policy/cmd_vel" {
                assert_eq!(number("angular.z"), Some(f64::from(played.commands[9][2])));
            }
        }
        let robot =
            ["joint_states", "joint_targets", "base_pose", "cmd_vel", "foot_forces"].map(|t| format!("/policy/{t}"));
        let topics = robot.into_iter().chain(["/tf".into()]).map(|topic| (topic, 100));
        let wanted: BTreeMap<String, usize> = topics.chain([("/robot_description".into(), 1)]).collect();
        assert_eq!(counts, wanted);
        assert_eq!(last, 2_000_000_000);
    }

    #[test]
    fn all_links_are_frames_and_lead_to_the_world() {
        let urdf = qv_go2::model::urdf_with_shapes();
        let options = ModelOptions { base: BaseKind::Floating, ..Default::default() };
        let model = Model::from_urdf(&urdf, &options).unwrap();
        let played = made_up(3);
        let frames = frames(&model, &played);
        assert_eq!(frames.len(), model.frames.len());
        for frame in &frames {
            let mut at = frame;
            let mut world = Pose::from_position_wxyz([0.0; 3], [1.0, 0.0, 0.0, 0.0]).unwrap();
            loop {
                let [x, y, z, a, b, c, d] = at.poses[2];
                world = Pose::from_position_wxyz([x, y, z], [a, b, c, d]).unwrap() * world;
                match frames.iter().find(|f| f.name == at.parent) {
                    Some(parent) => at = parent,
                    None => break,
                }
            }
            assert_eq!(at.parent, "world");
            if let Some(l) = model.links.iter().position(|l| l.name == frame.name) {
                let wanted = model.world_from_links(&padded(&played.q[2], model.nq()))[l].position;
                assert!((world.position - wanted).length() < 1e-9, "{}", frame.name);
            }
        }
    }

    /// `qv inspect` and `qv replay` open it as any robot's, with targets from where they hold.
    #[test]
    fn what_is_written_is_a_run() {
        let (played, urdf) = (made_up(100), qv_go2::model::urdf_with_shapes());
        let bytes = recording(&played, &urdf).unwrap();
        let file = qv_recording::BagFile { name: "replay.mcap".into(), source: &bytes[..] };
        let run = qv_recording::read_bag_of([file], &qv_recording::robots::found_by_messages(), None).unwrap();
        assert_eq!(run.robot, qv_recording::run::Robot::Urdf(urdf));
        assert_eq!((run.joint_names.clone(), run.base), (played.joints.clone(), qv_recording::run::Base::Free));
        let (position, target) = (run.measured.position.unwrap(), run.commands.position.unwrap());
        assert_eq!((position.len(), target.len(), run.measured.base_pose.unwrap().len()), (100, 100, 100));
        for k in [0, 42, 99] {
            assert_eq!(position.row(k), wide(&[played.q[k][7..].to_vec()]), "sample {k}");
            assert_eq!(target.row(k), wide(&[played.targets[k].clone()]), "sample {k}");
            assert!((position.time[k] - target.time[k] - 0.02).abs() < 1e-9, "a target holds until its sample");
        }
        assert!(run.remarks.iter().any(|t| t.states("torques")), "{:?}", run.remarks);
    }

    #[test]
    fn another_robots_urdf_is_told() {
        let mut played = made_up(3);
        played.joints.swap(0, 1);
        let error = recording(&played, &qv_go2::model::urdf_with_shapes()).unwrap_err().to_string();
        assert!(error.states("FL_thigh_joint FL_hip_joint"), "{error}");
    }
}
