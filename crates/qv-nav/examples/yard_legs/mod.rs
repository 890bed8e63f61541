//! A Go2 that walks in the yard of `fixtures/yard` with boxes.

use qv_nav::map::Map;
use qv_nav::walkers::Walkers;
use qv_policy::score::Decide;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings, VelocityTask};
use qv_sim::Terrain;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// The policy of a checkpoint.bin of `qv walk train`, and its clock \[Hz\].
pub fn walking(file: &str, robot: &TaskRobot) -> Fallible<(Box<dyn Decide>, f32)> {
    let checkpoint = Checkpoint::from_bytes(&std::fs::read(file)?)?;
    Ok((Box::new(checkpoint.best_policy(robot)?), checkpoint.settings.task.clock))
}

/// So many of them in the simulator, which has parameters of these values.
pub fn simulated(
    robot: &TaskRobot,
    (policy, clock): (Box<dyn Decide>, f32),
    (map, terrain): (&Map, &Terrain),
    parameters: &[(String, f64)],
    count: usize,
) -> Fallible<Walkers<'static>> {
    let [low, high] = map.bounds().map(|p| p.to_array());
    let ground = Ground::of_terrain(terrain.clone(), [low, high], 0.3, 1)?;
    let settings = TaskSettings { clock, parameters: parameters.iter().cloned().collect(), ..Default::default() };
    Ok(Walkers::new(VelocityTask::new(robot.clone(), ground, settings, count)?, policy)?)
}
