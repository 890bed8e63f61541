//! The Go2 as a robot that learns to walk.

use crate::model::{ARMATURE, LEGS, STAND, urdf_with_shapes};
use qv_policy::PolicyError;
use qv_policy::velocity::TaskRobot;
use qv_sim::{BaseKind, Model, ModelOptions};

/// Position gain that walking policies use \[N m/rad\]: softer than a stand's, as in legged_gym's and Unitree's tasks.
pub const KP: f32 = 30.0;
/// Velocity gain \[N m s/rad\].
pub const KD: f32 = 0.75;
/// Radians for an action of one (legged_gym).
pub const ACTION_SCALE: f32 = 0.25;

/// The Go2 with shapes on all links, its stand and gains.
///
/// # Errors
/// Never, unless the model of this crate is broken.
pub fn robot() -> Result<TaskRobot, PolicyError> {
    let options = ModelOptions { base: BaseKind::Floating, armature: ARMATURE, ..Default::default() };
    let model = Model::from_urdf(&urdf_with_shapes(), &options)?;
    let shape = |name: String| model.geoms.iter().position(|g| g.name == name);
    let feet: Vec<usize> = LEGS.iter().filter_map(|leg| shape(format!("{leg}_foot"))).collect();
    let others = (0..model.geoms.len()).filter(|g| !feet.contains(g));
    let (trunk, limbs) = others.partition(|&g: &usize| model.geoms[g].link == 0);
    let all = |value: f32| vec![value; STAND.len()];
    let numbers = [STAND.map(|x| x as f32).to_vec(), all(KP), all(KD), all(ACTION_SCALE)];
    let sideways = (0..STAND.len()).map(|j| j % 3 == 0).collect();
    TaskRobot::new("go2", model, numbers, [feet, trunk, limbs], sideways)
}

#[cfg(test)]
mod tests {
    #[test]
    fn four_feet_a_trunk_and_a_stand() {
        let robot = super::robot().unwrap();
        assert_eq!((robot.feet.len(), robot.trunk.is_empty(), robot.joints()), (4, false, 12));
        assert!((robot.height - 0.32).abs() < 0.01, "{}", robot.height);
        assert!(robot.limbs.len() >= 8);
    }
}
