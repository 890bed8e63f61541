//! What the Go2 says on the wire: `LowCmd`, `LowState`, and a pose stream, as a [`Mapping`].
//!
//! Source: the published message definitions of unitree_ros2. Motors and feet are numbered FR, FL, RR, RL there; the
//! channels come out FL, FR, RL, RR. Quaternions are w, x, y, z in `LowState` and x, y, z, w in poses.

use crate::messages::{LOW_CMD, LOW_CMD_TYPE, LOW_STATE, LOW_STATE_TYPE};
use crate::model;
use qv_replay::mapping::{Channel, ChannelFields, Mapping, StreamMapping};
use qv_replay::plan::Wanted;

/// Index on the wire of each leg of [`model::LEGS`].
pub const LEG_ON_WIRE: [usize; 4] = [1, 0, 3, 2];

/// Topic of FAST-LIO's pose.
pub const POSE_TOPIC: &str = "/Odometry";

/// Joint names in our order, such as `FL_hip_joint`.
pub fn joint_names() -> Vec<String> {
    model::JOINT_NAMES.map(String::from).to_vec()
}

/// Index on the wire of each of our joints, shape `[12]`.
pub fn motor_on_wire() -> Vec<usize> {
    LEG_ON_WIRE.iter().flat_map(|leg| (0..3).map(move |joint| 3 * leg + joint)).collect()
}

/// The mapping. The pose is read from `pose_topic` alone when it is given, else from [`POSE_TOPIC`] or, without that,
/// from whichever topic carries poses.
pub fn mapping(pose_topic: Option<&str>) -> Mapping {
    Mapping {
        robot: "go2".into(),
        joint_names: joint_names(),
        position_limits: model::position_limits().to_vec(),
        effort_limits: model::effort_limits().to_vec(),
        foot_names: model::LEGS.map(String::from).to_vec(),
        imu_position: model::IMU_IN_BASE,
        definitions: [(LOW_CMD_TYPE, LOW_CMD), (LOW_STATE_TYPE, LOW_STATE)]
            .map(|(name, text)| (name.to_owned(), text.to_owned()))
            .to_vec(),
        streams: vec![commands(), states(), poses(pose_topic)],
    }
}

fn one(path: &str) -> Wanted {
    Wanted { path: path.into(), elements: vec![0] }
}

fn motors(channel: Channel, path: &str) -> ChannelFields {
    ChannelFields { channel, fields: vec![Wanted { path: path.into(), elements: motor_on_wire() }] }
}

fn array(channel: Channel, path: &str, elements: &[usize]) -> ChannelFields {
    ChannelFields { channel, fields: vec![Wanted { path: path.into(), elements: elements.to_vec() }] }
}

fn commands() -> StreamMapping {
    let fields = vec![
        motors(Channel::CommandPosition, "motor_cmd[].q"),
        motors(Channel::CommandVelocity, "motor_cmd[].dq"),
        motors(Channel::CommandTorque, "motor_cmd[].tau"),
        motors(Channel::CommandKp, "motor_cmd[].kp"),
        motors(Channel::CommandKd, "motor_cmd[].kd"),
    ];
    StreamMapping {
        role: "commands",
        preferred_topic: "/lowcmd".into(),
        exact_topic: false,
        types: vec![("unitree_go/msg/LowCmd".into(), fields)],
    }
}

fn states() -> StreamMapping {
    let fields = vec![
        motors(Channel::Position, "motor_state[].q"),
        motors(Channel::Velocity, "motor_state[].dq"),
        motors(Channel::Torque, "motor_state[].tau_est"),
        array(Channel::Gyro, "imu_state.gyroscope", &[0, 1, 2]),
        array(Channel::Acceleration, "imu_state.accelerometer", &[0, 1, 2]),
        array(Channel::Orientation, "imu_state.quaternion", &[0, 1, 2, 3]),
        array(Channel::FootForce, "foot_force", &LEG_ON_WIRE),
    ];
    StreamMapping {
        role: "joint states",
        preferred_topic: "/lowstate".into(),
        exact_topic: false,
        types: vec![("unitree_go/msg/LowState".into(), fields)],
    }
}

fn poses(topic: Option<&str>) -> StreamMapping {
    let pose = |prefix: &str| {
        let names = ["position.x", "position.y", "position.z"];
        let turn = ["orientation.w", "orientation.x", "orientation.y", "orientation.z"];
        let fields = names.iter().chain(&turn).map(|name| one(&format!("{prefix}{name}"))).collect();
        vec![ChannelFields { channel: Channel::BasePose, fields }]
    };
    StreamMapping {
        role: "base pose",
        preferred_topic: topic.unwrap_or(POSE_TOPIC).into(),
        exact_topic: topic.is_some(),
        types: vec![
            ("nav_msgs/msg/Odometry".into(), pose("pose.pose.")),
            ("geometry_msgs/msg/PoseStamped".into(), pose("pose.")),
            ("geometry_msgs/msg/PoseWithCovarianceStamped".into(), pose("pose.pose.")),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motors_are_permuted_by_leg() {
        assert_eq!(motor_on_wire(), [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]);
        assert_eq!(joint_names()[8], "RL_calf_joint");
        assert_eq!(mapping(None).position_limits[7].1, 4.5379);
    }
}
