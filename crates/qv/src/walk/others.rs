//! `qv walk score --description`: policies of others, judged by the measures of ours.

use super::roll::{check_joints, opened, standing};
use crate::Failure;
use qv_policy::gait::{Gait, GaitMeter, GaitScale};
use qv_policy::roll::{RollError, roll};
use qv_policy::velocity::{Ground, TaskRobot};
use qv_sim::{Batch, SimOptions};
use std::path::Path;

/// Commands from rest: forwards, to the left \[m/s\], turning \[rad/s\]. The first five, ahead at about 0.5 m/s and standing, give the gait; errors
/// and falls are those of all.
const COMMANDS: [[f64; 3]; 11] = [
    [0.5, 0.0, 0.0],
    [0.4, 0.0, 0.0],
    [0.45, 0.0, 0.0],
    [0.6, 0.0, 0.0],
    [0.0, 0.0, 0.0],
    [-0.4, 0.0, 0.0],
    [0.0, 0.3, 0.0],
    [0.0, -0.3, 0.0],
    [0.0, 0.0, 0.8],
    [0.0, 0.0, -0.8],
    [0.4, 0.0, 0.5],
];
/// Of these, those that give the gait.
const AHEAD: usize = 5;

/// The gait of a policy that a description goes with, on a robot with these parameters, for `seconds` under each command. One whose numbers run away has fallen.
pub fn judge(
    files: [&Path; 2],
    robot: &TaskRobot,
    ground: &Ground,
    parameters: &[(String, f64)],
    seconds: f64,
) -> Result<Gait, Failure> {
    let (mut policy, description) = opened(files[0], files[1])?;
    check_joints(&description, files[1], &robot.model)?;
    let late = |ending: &str| {
        parameters.iter().filter(|(name, _)| name.ends_with(ending)).map(|(_, value)| *value).fold(0.0, f64::max)
    };
    let options = SimOptions {
        timestep: description.simulation.timestep,
        max_command_latency: late(".command_latency"),
        max_sensor_latency: late(".encoder_latency").max(late(".delay")),
        ..Default::default()
    };
    let effort = |joint: &String| robot.model.joint_index(joint).map(|j| robot.model.joints[j].effort as f32);
    let scale = GaitScale {
        dt: 1.0 / description.rate as f32,
        mass: robot.model.mass() as f32,
        height: robot.height,
        efforts: description.joints.iter().map(|joint| effort(joint).filter(|x| x.is_finite())).collect(),
    };
    let height = ground.terrain.height_below(0.0, 0.0, 1e6).unwrap_or(0.0);
    let start = standing(&robot.model, &description, height);
    let mut all = GaitMeter::new(&scale, robot.feet.len());
    for (k, command) in COMMANDS.into_iter().enumerate() {
        let mut batch = Batch::<f64>::new(&robot.model, &ground.terrain, &options, 1)?;
        let rolled = roll(&mut batch, &description, &start, (command, seconds), parameters, |observation| {
            let mut action = Vec::new();
            policy.run(observation, &mut action).map(|()| action)
        });
        let mut meter = GaitMeter::new(&scale, robot.feet.len());
        match rolled {
            Ok(rolled) => rolled.measure(command, &robot.feet, &mut meter),
            Err(RollError::RanAway { .. }) => meter.note_fall(),
            Err(error) => return Err(error.into()),
        }
        if k < AHEAD {
            all.join(meter);
        } else {
            all.join_errors(&meter);
        }
    }
    Ok(all.gait())
}
