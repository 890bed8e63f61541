//! What nets see of a robot: how many numbers, and what brings them to the size of one.

use qv_policy::velocity::TaskRobot;

/// Parts of the input that have one number for each joint: angle from the stand, speed, target less angle, the last target less this, the
/// one before less the last, the last correction.
pub(super) const OF_JOINTS: usize = 6;

/// Numbers of the input of a net of positions.
pub(super) fn position_inputs(robot: &TaskRobot) -> usize {
    OF_JOINTS * robot.joints() + 6 + robot.feet.len()
}

/// Offset and scale that bring the input to the size of one, `[inputs]` each: differences of angles by 0.25 rad, speeds by 5 rad/s, corrections
/// by [`super::UNIT`], turning by 2 rad/s; gravity is that of a robot that stands.
pub(super) fn position_scaling(robot: &TaskRobot) -> (Vec<f32>, Vec<f32>) {
    let (joints, count) = (robot.joints(), position_inputs(robot));
    let (mut offset, mut scale) = (vec![0.0; count], vec![4.0; count]);
    scale[joints..2 * joints].fill(0.2);
    scale[5 * joints..6 * joints].fill(1.0 / super::UNIT);
    let at = OF_JOINTS * joints;
    offset[at + 2] = -1.0;
    scale[at + 3..at + 6].fill(0.5);
    scale[at + 6..].fill(1.0);
    (offset, scale)
}

/// Instants of the input: now, one decision ago, two decisions ago.
pub(super) const INSTANTS: usize = 3;

/// Target less angle, speed, the motor's torque.
pub(super) const OF_INSTANT: usize = 3;

/// Kinds of joints: names without what stands before the first underline (`FL_hip_joint` and `RR_hip_joint` are of one kind).
pub(super) fn kinds(robot: &TaskRobot) -> (Vec<usize>, usize) {
    let mut known: Vec<&str> = Vec::new();
    let mut of = Vec::new();
    for name in robot.model.joint_names() {
        let end = name.split_once('_').map_or(name.as_str(), |(_, end)| end);
        let at = known.iter().position(|k| *k == end).unwrap_or(known.len());
        if at == known.len() {
            known.push(end);
        }
        of.push(at);
    }
    let count = known.len();
    (of, count)
}

/// Numbers of the input of one joint.
pub(super) fn torque_inputs(robot: &TaskRobot) -> usize {
    INSTANTS * OF_INSTANT + kinds(robot).1
}

/// What brings an instant's numbers to the size of one: 0.25 rad, 5 rad/s, and the torque of 0.25 rad over the position gain.
pub(super) const SCALE: [f32; OF_INSTANT] = [4.0, 0.2, 4.0];

/// Offset and scale of the input of one joint.
pub(super) fn torque_scaling(robot: &TaskRobot) -> (Vec<f32>, Vec<f32>) {
    let mut scale: Vec<f32> = SCALE.repeat(INSTANTS);
    scale.resize(torque_inputs(robot), 1.0);
    (vec![0.0; scale.len()], scale)
}
