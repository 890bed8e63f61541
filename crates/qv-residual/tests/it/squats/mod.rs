//! A Go2 that stands and moves all its joints, recorded from the simulator itself.

use qv_core::JointSeries;
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::velocity::{TaskRobot, TaskSettings};
use qv_recording::Run;
use qv_recording::run::{Base, Measurements, Robot};
use qv_residual::log::{Log, Stretch};
use qv_residual::windows::Replayer;
use qv_sim::{Batch, BatchCommand, JointCommand, SimOptions, State, Terrain};

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

/// Seconds of a recording, and commands a second.
const SECONDS: usize = 4;
const COMMANDS: usize = 50;

/// The same as recordings of each step, of which there are `rate` a second: noise of encoders \[rad\], and of all else in the same proportion as
/// a Go2's.
pub fn recordings(robot: &TaskRobot, parameters: &[(&str, f64)], count: usize, (rate, noise): (usize, f64)) -> Log {
    let mut log = Log::new(robot, &TaskSettings::default());
    for k in 0..count {
        log.add(&format!("squats {k}"), &recording(robot, parameters, k as u64, (rate, noise)), robot).unwrap();
    }
    log
}

fn recording(robot: &TaskRobot, parameters: &[(&str, f64)], k: u64, (rate, noise): (usize, f64)) -> Run {
    let mut random = Xoshiro256PlusPlus::of(3, 1, k);
    let joints = robot.joints();
    let phases: Vec<f64> = (0..joints).map(|_| f64::from(random.between(0.0, 6.0))).collect();
    let speed = f64::from(random.between(6.0, 14.0));
    let options = SimOptions { timestep: 1.0 / rate as f64, max_command_latency: 0.06, ..Default::default() };
    let mut batch = Batch::<f64>::new(&robot.model, &Terrain::plane(), &options, 1).unwrap();
    for (name, value) in parameters {
        let each = robot.model.joint_names().iter().map(|joint| name.replace('*', joint));
        each.for_each(|name| batch.set_parameter(0, &name, *value).unwrap());
    }
    let wide = |list: &[f32]| list.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
    let (stand, kp, kd, zero) = (wide(&robot.stand), wide(&robot.kp), wide(&robot.kd), vec![0.0; joints]);
    let q = [&[0.0, 0.0, f64::from(robot.height), 1.0, 0.0, 0.0, 0.0][..], &stand].concat();
    batch.set_state(0, &State { q, v: vec![0.0; 6 + joints] }).unwrap();
    let series = |joints: usize| JointSeries { joints, ..Default::default() };
    let [mut position, mut velocity, mut command] = [joints; 3].map(series);
    let [mut gyro, mut orientation, mut pose] = [3, 4, 7].map(series);
    for step in 0..SECONDS * rate {
        let time = step as f64 / rate as f64;
        if step % (rate / COMMANDS) == 0 {
            let q: Vec<f64> = (0..joints).map(|j| stand[j] + 0.12 * (speed * time + phases[j]).sin()).collect();
            batch.set_command(0, &JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
            command.time.push(time);
            command.values.extend(q);
        }
        let seen = batch.sensors(0).unwrap();
        let mut put = |series: &mut JointSeries, values: &[f64], noise: f64| {
            series.time.push(time);
            series.values.extend(values.iter().map(|x| x + noise * f64::from(random.normal())));
        };
        put(&mut position, &seen.q, noise);
        put(&mut velocity, &seen.dq, 50.0 * noise);
        put(&mut gyro, &seen.gyro, 25.0 * noise);
        put(&mut orientation, &seen.base_orientation, 0.0);
        put(&mut pose, &[&seen.base_position[..], &seen.base_orientation].concat(), 0.0);
        batch.step();
    }
    let constant = |values: Vec<f64>| Some(JointSeries { time: vec![0.0], values, joints });
    Run {
        commands: qv_recording::run::Commands {
            position: Some(command),
            kp: constant(kp),
            kd: constant(kd),
            ..Default::default()
        },
        measured: Measurements {
            position: Some(position),
            velocity: Some(velocity),
            gyro: Some(gyro),
            orientation: Some(orientation),
            base_pose: Some(pose),
            ..Default::default()
        },
        ..Run::empty(Robot::Named(robot.name.clone()), Base::Free, robot.model.joint_names().to_vec())
    }
}
