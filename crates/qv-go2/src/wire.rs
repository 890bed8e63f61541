//! What the Go2 says on the wire, for whoever writes its messages. How they are read is data: the robot file `go2` of qv-recording.
//!
//! Motors and feet are numbered FR, FL, RR, RL on the wire; the channels come out FL, FR, RL, RR.

use crate::model;
use qv_recording::mapping::Mapping;
use qv_recording::robots;

/// Index on the wire of each leg of [`model::LEGS`].
pub const LEG_ON_WIRE: [usize; 4] = [1, 0, 3, 2];

/// Joint names in our order, such as `FL_hip_joint`.
pub fn joint_names() -> Vec<String> {
    model::JOINT_NAMES.map(String::from).to_vec()
}

/// Index on the wire of each of our joints, shape `[12]`.
pub fn motor_on_wire() -> Vec<usize> {
    LEG_ON_WIRE.iter().flat_map(|leg| (0..3).map(move |joint| 3 * leg + joint)).collect()
}

/// The mapping of the robot file. The pose is read from `pose_topic` alone when it is given, else from `/Odometry` or, without
/// that, from whichever topic carries poses.
pub fn mapping(pose_topic: Option<&str>) -> Mapping {
    let robot = robots::built_in("go2").expect("a test reads it");
    robot.mapping.with_pose_topic(pose_topic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{LOW_CMD, LOW_CMD_TYPE, LOW_STATE, LOW_STATE_TYPE};
    use qv_recording::mapping::Channel;

    #[test]
    fn motors_are_permuted_by_leg() {
        assert_eq!(motor_on_wire(), [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]);
        assert_eq!(joint_names()[8], "RL_calf_joint");
        assert_eq!(mapping(None).position_limits[7].1, 4.5379);
    }

    /// The robot file and the model are of one robot, to the last bit.
    #[test]
    fn the_file_is_that_of_the_model() {
        let mapping = mapping(Some("/pose"));
        assert_eq!(mapping.joint_names, joint_names());
        assert_eq!(mapping.position_limits, model::position_limits());
        assert_eq!(mapping.effort_limits, model::effort_limits());
        assert_eq!(mapping.foot_names, model::LEGS);
        assert_eq!(mapping.imu_position, model::IMU_IN_BASE);
        let fields = |channel: Channel| {
            let all = mapping.streams.iter().flat_map(|s| &s.messages).flat_map(|m| &m.fields);
            all.filter(move |f| f.channel == channel).map(|f| f.fields[0].elements.clone()).next().unwrap()
        };
        assert_eq!(fields(Channel::Position), motor_on_wire());
        assert_eq!(fields(Channel::CommandKd), motor_on_wire());
        assert_eq!(fields(Channel::FootForce), LEG_ON_WIRE);
        let definitions = [(LOW_CMD_TYPE, LOW_CMD), (LOW_STATE_TYPE, LOW_STATE)];
        assert_eq!(mapping.definitions, definitions.map(|(name, text)| (name.to_owned(), text.to_owned())));
        let pose = mapping.streams.last().unwrap();
        assert_eq!((pose.preferred_topic.as_str(), pose.exact_topic), ("/pose", true));
    }
}
