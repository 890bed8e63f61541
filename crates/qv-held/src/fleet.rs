//! Faultless robots that differ within the tolerances, simulated in closed loop with the controller and the commands of a recording: references
//! where there are none.

use crate::HeldError;
use crate::balance::Robot;
use crate::hypothesis::{Tolerances, reach};
use crate::request::Request;
use crate::signal::quantile;
use crate::slices::cut;
use qv_core::JointSeries;
use qv_core::random::SplitMix64;
use qv_recording::Run;
use qv_recording::run::ActuatorKind;
use qv_rollout::{Command, HeldCommands};
use qv_sim::{Batch, SimOptions, State, Terrain};

/// Robots.
const COUNT: usize = 20;
/// Fewest that must not run away.
const FEWEST: usize = 12;
/// Longest recording that is simulated \[s\].
const LONGEST: f64 = 60.0;
/// Longest step \[s\].
const STEP: f64 = 0.001;
/// Usual error of an encoder's zero \[rad\].
const BIAS: f64 = 0.002;
/// Variance of third differences of white noise, and the median of the size of a standard normal number.
const THIRD: f64 = 20.0;
const MEDIAN: f64 = 0.674_5;

/// Whether a recording has what a fleet is simulated with: a position controller with its commands and gains.
pub(crate) fn can_follow(run: &Run) -> bool {
    let has_gains = run.commands.kp.is_some() || run.actuator.kp.is_some();
    run.actuator.kind == ActuatorKind::Pd && run.commands.position.is_some() && has_gains
}

/// Recordings of the fleet; `usual` are root mean square torques of the joints \[N m\].
pub(crate) fn simulate(request: &Request, robot: &Robot, usual: &[f64]) -> Result<Vec<Run>, HeldError> {
    let run = &request.runs[0];
    let [from, until] = run.span();
    let run = cut(run, [from, until.min(from + LONGEST)]);
    let position = run.measured.position.as_ref().ok_or_else(|| HeldError::recording("recording", "no positions"))?;
    let period = qv_recording::median_interval(&position.time);
    let substeps = (period / STEP).ceil().max(1.0);
    let options =
        SimOptions { timestep: period / substeps, max_command_latency: (2.0 * period).min(1.0), ..Default::default() };
    let mut sim = Batch::<f64>::new(robot.model, &Terrain::none(), &options, COUNT)?;
    for env in 0..COUNT {
        let mut random = SplitMix64::of(request.seed, 0xf1ee + env as u64);
        place(&mut sim, env, robot, &run)?;
        draw(&mut sim, env, robot, (usual, period, &request.policy.tolerances), &mut random)?;
    }
    let recorded = record(&mut sim, robot, &run, substeps as usize)?;
    let mut all = Vec::new();
    for (env, [q, v, tau]) in recorded.into_iter().enumerate() {
        if !sim.is_faulty(env)? {
            let random = SplitMix64::of(request.seed, 0x5e45 + env as u64);
            all.push(as_run(&run, robot, [q, v, tau], (period * request.policy.tolerances.samples, random)));
        }
    }
    if all.len() < FEWEST {
        return Err(HeldError::Fleet(COUNT - all.len(), COUNT));
    }
    Ok(all)
}

/// Starts as the recording does.
fn place(sim: &mut Batch<f64>, env: usize, robot: &Robot, run: &Run) -> Result<(), HeldError> {
    for &(id, value) in &robot.stated {
        sim.set_parameter_at(env, id, value)?;
    }
    let first = |series: &Option<JointSeries>, j: usize| {
        let all = series.as_ref().and_then(|s| s.column(robot.columns[j]).find(|x| x.is_finite()));
        all.unwrap_or(0.0)
    };
    let joints = 0..robot.joints();
    let q = joints.clone().map(|j| first(&run.measured.position, j) - robot.bias[j]).collect();
    let v = joints.map(|j| first(&run.measured.velocity, j)).collect();
    Ok(sim.set_state(env, &State { q, v })?)
}

/// Draws what a faultless robot differs in, evenly within the tolerances.
fn draw(
    sim: &mut Batch<f64>,
    env: usize,
    robot: &Robot,
    (usual, period, tolerances): (&[f64], f64, &Tolerances),
    random: &mut SplitMix64,
) -> Result<(), HeldError> {
    let mut set = |name: String, value: f64| sim.set_parameter(env, &name, value);
    for (l, link) in robot.model.links.iter().enumerate() {
        let com = tolerances.com.min(0.1 * reach(robot, l));
        set(format!("link.{}.mass_scale", link.name), 1.0 + random.between(-tolerances.mass, tolerances.mass))?;
        for axis in ["com_x", "com_y", "com_z"] {
            set(format!("link.{}.{axis}", link.name), random.between(-com, com))?;
        }
        set(
            format!("link.{}.inertia_scale", link.name),
            1.0 + random.between(-tolerances.inertia, tolerances.inertia),
        )?;
    }
    let latency = random.between(0.0, tolerances.samples * period);
    for (j, name) in robot.model.joint_names().iter().enumerate() {
        let torque = tolerances.torque * usual[j];
        let about = |random: &mut SplitMix64, value: f64, share: f64| value * (1.0 + random.between(-share, share));
        set(format!("joint.{name}.coulomb_friction"), about(random, robot.coulomb[j], tolerances.friction))?;
        set(format!("joint.{name}.viscous_friction"), about(random, robot.viscous[j], tolerances.friction))?;
        set(format!("joint.{name}.armature"), about(random, robot.armature[j], tolerances.armature))?;
        let stribeck = random.between(0.0, tolerances.friction * robot.coulomb[j]) + random.between(0.0, torque);
        set(format!("joint.{name}.stribeck_friction"), stribeck)?;
        let load = random.between(0.0, tolerances.torque);
        set(format!("joint.{name}.load_friction_motor"), load)?;
        set(format!("joint.{name}.load_friction_external"), load)?;
        set(format!("joint.{name}.constant_torque"), random.between(-torque, torque))?;
        for key in ["kp_scale", "kd_scale"] {
            set(format!("actuator.{name}.{key}"), 1.0 + random.between(-tolerances.gain, tolerances.gain))?;
        }
        set(format!("actuator.{name}.command_latency"), latency)?;
        set(format!("sensor.{name}.torque_scale"), 1.0 + random.between(-tolerances.torque, tolerances.torque))?;
        set(format!("sensor.{name}.encoder_bias"), robot.bias[j] + random.between(-BIAS, BIAS))?;
    }
    Ok(())
}

/// Lets all robots follow the commands; positions, speeds and torques at the stamps of the recording, shape `[robots][3][stamps * joints]`.
fn record(sim: &mut Batch<f64>, robot: &Robot, run: &Run, substeps: usize) -> Result<Vec<[Vec<f64>; 3]>, HeldError> {
    let commands = HeldCommands::new(run, &robot.columns)?;
    let step = sim.options().timestep;
    let mut command = Command::default();
    let mut all: Vec<[Vec<f64>; 3]> = vec![Default::default(); COUNT];
    let position = run.measured.position.as_ref();
    let (start, stamps) = position
        .map_or((0.0, 0), |p| (p.time[0], ((p.time[p.len() - 1] - p.time[0]) / (step * substeps as f64)) as usize));
    for stamp in 0..=stamps {
        for (env, own) in all.iter_mut().enumerate() {
            let sensors = sim.sensors(env)?;
            own[0].extend(sensors.q);
            own[1].extend(sensors.dq);
        }
        for k in 0..substeps {
            commands.at(start + step * (stamp * substeps + k) as f64, step, &mut command);
            sim.set_command_for_all(&command.view())?;
            sim.step_parallel();
            if k == 0 {
                // The torque that is given from the stamp on.
                for (env, own) in all.iter_mut().enumerate() {
                    own[2].extend(sim.sensors(env)?.tau);
                }
            }
        }
    }
    Ok(all)
}

/// A robot's recording with the noise of the one that it stands beside; torques are stamped within half a sample.
fn as_run(run: &Run, robot: &Robot, [q, v, tau]: [Vec<f64>; 3], (shift, mut random): (f64, SplitMix64)) -> Run {
    let joints = robot.joints();
    let width = run.joint_names.len();
    let count = q.len() / joints;
    let position = run.measured.position.as_ref();
    let start = position.map_or(0.0, |p| p.time[0]);
    let period = position.map_or(0.01, |p| qv_recording::median_interval(&p.time));
    let moved = random.between(-shift, shift);
    let mut series = |values: &[f64], like: &Option<JointSeries>, late: f64| -> Option<JointSeries> {
        let like = like.as_ref()?;
        let noise: Vec<f64> = robot.columns.iter().map(|&c| noise_of(like, c)).collect();
        let mut all = vec![0.0; count * width];
        for k in 0..count {
            for j in 0..joints {
                all[k * width + robot.columns[j]] = values[k * joints + j] + random.normal(noise[j]);
            }
        }
        let time = (0..count).map(|k| start + late + period * k as f64).collect();
        Some(JointSeries { time, values: all, joints: width })
    };
    let mut out = run.clone();
    out.measured.position = series(&q, &run.measured.position, 0.0);
    out.measured.velocity = series(&v, &run.measured.velocity, 0.0);
    out.measured.torque = series(&tau, &run.measured.torque, moved);
    out
}

/// Deviation of what is white in a column: by its third differences, which smooth motions hardly have.
fn noise_of(series: &JointSeries, column: usize) -> f64 {
    let values: Vec<f64> = series.column(column).filter(|x| x.is_finite()).collect();
    let third = values.windows(4).map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs()).collect();
    quantile(third, 0.5) / (MEDIAN * THIRD.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_on_a_smooth_motion_is_found() {
        let mut random = SplitMix64::of(8, 2);
        let time: Vec<f64> = (0..4000).map(|k| 0.005 * f64::from(k)).collect();
        let values = time.iter().map(|t| (2.0 * t).sin() + random.normal(3e-4)).collect();
        let found = noise_of(&JointSeries { time, values, joints: 1 }, 0);
        assert!((found / 3e-4 - 1.0).abs() < 0.05, "{found}");
    }
}
