//! Whether a robot stands under its own gains, before it is trained.

use crate::PolicyError;
use crate::env::{End, VectorEnv};
use crate::velocity::{Ground, TaskRobot, TaskSettings, VelocityTask};

/// Least torque reserve with which a robot is trained.
pub const RESERVE: f32 = 2.0;
/// Least height of the base after two seconds, as a share of that of the stand.
const HEIGHT: f32 = 0.6;

/// How a robot stands under its own gains.
#[derive(Debug, Clone, PartialEq)]
pub struct StandReport {
    /// Height of the base after two seconds, as a share of that of the stand.
    pub height: f32,
    /// Whether it fell.
    pub fell: bool,
    /// Least quotient of a joint's largest torque and what the stand takes; `None` where the model states no limits.
    pub reserve: Option<f32>,
}

impl StandReport {
    /// Lets a robot stand for two seconds.
    ///
    /// # Errors
    /// When the simulator refuses the robot.
    pub fn of(robot: &TaskRobot) -> Result<Self, PolicyError> {
        let mut task = VelocityTask::new(robot.clone(), Ground::plane(), TaskSettings::default(), 1)?;
        task.judged = true;
        task.restart(0, 0)?;
        let (mut reward, mut end) = ([0.0], [End::No]);
        let action = vec![0.0; robot.joints()];
        let mut fell = false;
        for _ in 0..100 {
            task.step(&action, &mut reward, &mut end)?;
            fell |= end[0] == End::Failed;
        }
        let (q, _, torques) = task.motion();
        let quotient = robot.model.joints.iter().zip(torques).filter(|(joint, _)| joint.effort.is_finite());
        let reserve = quotient.map(|(joint, torque)| joint.effort as f32 / torque.abs().max(1e-3));
        Ok(Self { height: q[2] / robot.height, fell, reserve: reserve.reduce(f32::min) })
    }

    /// # Errors
    /// Why a robot that stands like this is not trained, and what to change.
    pub fn check(&self) -> Result<(), PolicyError> {
        if self.fell || self.height < HEIGHT {
            let expected = "a stand that holds under its gains (raise `kp`, or change `stand`)";
            let found = format!("a base at {:.0} % of its height after 2 s", 100.0 * self.height);
            return Err(PolicyError::setting("robot", expected, found));
        }
        match self.reserve.filter(|reserve| *reserve < RESERVE) {
            Some(reserve) => {
                let expected =
                    format!("torque limits of at least {RESERVE} times what the stand takes (straighten `stand`)");
                Err(PolicyError::setting("robot", &expected, format!("{reserve:.2} times")))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::velocity::{RobotFile, known_robot};

    #[test]
    fn a_bare_model_stands_on_four_feet() {
        for name in ["go1", "a1", "a2", "anymal_c"] {
            let (_, text) = known_robot(name).unwrap();
            let robot = RobotFile::bare("x.urdf").robot(text).unwrap();
            assert_eq!(robot.feet.len(), 4, "{name}");
            let report = StandReport::of(&robot).unwrap();
            report.check().unwrap_or_else(|e| panic!("{name}: {e} {report:?}"));
            robot.mirror().unwrap_or_else(|e| panic!("{name}: {e}"));
        }
    }

    #[test]
    fn weak_gains_and_weak_motors_are_refused() {
        let file = RobotFile::parse(include_str!("../robots/go1.toml")).unwrap();
        let mut robot = file.robot(include_str!("../robots/go1.urdf")).unwrap();
        StandReport::of(&robot).unwrap().check().unwrap();
        robot.model.joints.iter_mut().for_each(|joint| joint.effort = 9.0);
        let error = StandReport::of(&robot).unwrap().check().unwrap_err().to_string();
        assert!(error.contains("torque limits"), "{error}");
        robot.kp.fill(2.0);
        assert!(StandReport::of(&robot).unwrap().check().unwrap_err().to_string().contains("kp"));
    }
}
