//! What brings the numbers of the task to the size of one, and what they are in the mirror.

use super::mirror::RobotMirror;
use super::robot::TaskRobot;
use crate::symmetry::{MirrorMap, Symmetry};

/// Points ahead and aside of the base at which the critic knows the height of the ground \[m\].
pub(super) const SCAN: [[f32; 2]; 9] =
    [[0.4, 0.2], [0.4, 0.0], [0.4, -0.2], [0.2, 0.0], [-0.2, 0.0], [-0.4, 0.2], [-0.4, -0.2], [0.0, 0.2], [0.0, -0.2]];

/// Offset and scale of what the policy sees, see [`super::OBSERVATION`], with so many numbers of a clock.
pub(super) fn observation(robot: &TaskRobot, clock: usize) -> (Vec<f32>, Vec<f32>) {
    let joints = robot.joints();
    let mut offset = vec![0.0; 9];
    // Turning rates of one, speeds of twenty are usual: legged_gym's scales. Commands are larger, so that zero is not nearly zero.
    let mut scale = vec![0.25, 0.25, 0.25, 1.0, 1.0, 1.0, 4.0, 4.0, 2.0];
    offset.extend(&robot.stand);
    scale.extend(vec![1.0; joints]);
    offset.extend(vec![0.0; joints]);
    scale.extend(vec![0.05; joints]);
    offset.extend(&robot.stand);
    scale.extend(robot.action_scale.iter().map(|s| 1.0 / s));
    offset.extend(vec![0.0; clock]);
    scale.extend(vec![1.0; clock]);
    (offset, scale)
}

/// Offset and scale of what the critic sees: the observation, the base's velocity and height, for the feet touch, times in the air and on the
/// ground and duty factors, heights of the ground.
pub(super) fn privileged(robot: &TaskRobot, clock: usize) -> (Vec<f32>, Vec<f32>) {
    let (mut offset, mut scale) = observation(robot, clock);
    offset.extend([0.0, 0.0, 0.0, robot.height]);
    scale.extend([2.0, 2.0, 2.0, 5.0]);
    offset.extend(vec![0.0; 4 * robot.feet.len()]);
    scale.extend([1.0, 2.0, 2.0, 2.0].map(|scale| vec![scale; robot.feet.len()]).concat());
    offset.extend(SCAN.map(|_| 0.0));
    scale.extend(SCAN.map(|_| 5.0));
    (offset, scale)
}

/// Mirror images, where the robot is its own.
pub(super) fn symmetry(robot: &TaskRobot, clock: usize) -> Option<Symmetry> {
    let RobotMirror { joints, feet } = robot.mirror().ok()?;
    // Roll, yaw, what is to the left and turning change their signs.
    let mut observation = MirrorMap::in_place(&[-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0]);
    (0..3).for_each(|_| observation.append(&joints));
    // The clock is half a stride on, which changes the signs of sine and cosine.
    observation.append(&MirrorMap::in_place(&vec![-1.0; clock]));
    let mut privileged = observation.clone();
    privileged.append(&MirrorMap::in_place(&[1.0, -1.0, 1.0, 1.0]));
    (0..4).for_each(|_| privileged.append(&MirrorMap::permuted(&feet)));
    let image = |[ahead, aside]: [f32; 2]| SCAN.iter().position(|p| *p == [ahead, -aside]).unwrap_or(0);
    privileged.append(&MirrorMap::permuted(&SCAN.map(image)));
    Some(Symmetry { observation, privileged, action: joints })
}
