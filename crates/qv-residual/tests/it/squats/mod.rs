//! A Go2 that stands and moves all its joints, recorded from the simulator itself.

use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::velocity::{TaskRobot, TaskSettings};
use qv_residual::log::{Log, Stretch};
use qv_residual::windows::Replayer;
use qv_sim::{BatchCommand, State, Terrain};

/// Stretches of 4 s with parameters in the simulator and noise of the encoders \[rad\].
pub fn log(robot: &TaskRobot, parameters: &[(&str, f64)], stretches: usize, noise: f32) -> Log {
    let task = TaskSettings::default();
    let mut log = Log::new(robot, &task);
    let (joints, decisions, terrain) = (robot.joints(), 200, Terrain::plane());
    for k in 0..stretches {
        let mut random = Xoshiro256PlusPlus::of(3, 1, k as u64);
        let phases: Vec<f32> = (0..joints).map(|_| random.between(0.0, 6.0)).collect();
        let speed = random.between(6.0, 14.0);
        let mut stretch =
            Stretch { recording: format!("squats {k}"), start: 0.0, targets: Vec::new(), states: Vec::new() };
        let mut batch = Replayer::new(&log, robot, &terrain, &task).batch(1).unwrap();
        for (name, value) in parameters {
            for joint in robot.model.joint_names() {
                batch.set_parameter(0, &name.replace('*', joint), *value).unwrap();
            }
        }
        let mut q = vec![0.0, 0.0, f64::from(robot.height), 1.0, 0.0, 0.0, 0.0];
        q.extend(robot.stand.iter().map(|&x| f64::from(x)));
        batch.set_state(0, &State { q, v: vec![0.0; 6 + joints] }).unwrap();
        let (mut q, mut v) = (vec![0.0; 7 + joints], vec![0.0; 6 + joints]);
        for decision in 0..=decisions {
            batch.read_positions(&mut q).unwrap();
            batch.read_velocities(&mut v).unwrap();
            stretch
                .states
                .extend(q.iter().enumerate().map(|(i, x)| if i < 7 { *x } else { x + noise * random.normal() }));
            stretch.states.extend(&v);
            if decision == decisions {
                break;
            }
            let time = decision as f32 / log.rate;
            let targets: Vec<f32> =
                (0..joints).map(|j| robot.stand[j] + 0.12 * (speed * time + phases[j]).sin()).collect();
            batch
                .set_commands(&BatchCommand { q: &targets, dq: None, kp: &robot.kp, kd: &robot.kd, tau: None })
                .unwrap();
            (0..log.substeps).for_each(|_| stretch.targets.extend(&targets));
            batch.step_many(log.substeps);
        }
        log.stretches.push(stretch);
    }
    log
}
