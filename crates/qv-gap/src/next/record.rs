//! A motion as the simulator would record it: commands, and what the sensors of the recording at hand would say, with its noise and rates.

use super::motions::{Limits, Motion};
use crate::{GapError, Options};
use glam::{DQuat, DVec3};
use qv_core::JointSeries;
use qv_core::random::SplitMix64;
use qv_core::statistics::median;
use qv_recording::Run;
use qv_recording::run::{Commands, Measurements};
use qv_rollout::Numerics;
use qv_rollout::noise::{Noise, read};
use qv_rollout::{expand, stated_parameters};
use qv_sim::{BaseKind, Batch, JointCommand, Model, SensorReading, Shape, State, Terrain};

/// Time in which the simulated robot comes to rest in the first posture \[s\].
const SETTLE: f64 = 1.5;
/// How often a motion is made smaller before it is given up, and by what.
const TRIES: usize = 5;
const SMALLER: f64 = 0.7;
/// Share of a motor's torque that a motion may need: the true robot may need more.
const OF_TORQUE: f64 = 0.7;
/// Over what was shown, a joint may go so far \[share of its range\] and so fast.
const BEYOND: f64 = 0.1;
const FASTER: f64 = 1.3;
/// A trunk that leans farther \[rad\] is about to fall.
const LEANS: f64 = 0.5;
const SEED: u64 = 0x6e65_7874;

/// The motion, made smaller until the simulated robot stays within limits, and its recording; `None` where it never does.
pub(super) fn within_limits(
    run: &Run,
    model: &Model,
    terrain: &Terrain,
    options: &Options,
    limits: &Limits,
    mut motion: Motion,
) -> Result<Option<(Motion, Run)>, GapError> {
    for _ in 0..TRIES {
        if let Some(recording) = record(run, model, terrain, options, limits, &motion)? {
            return Ok(Some((motion, recording)));
        }
        motion = motion.smaller(SMALLER);
    }
    Ok(None)
}

/// What a motion is made of in the recording's terms.
struct Gains {
    kp: Vec<f64>,
    kd: Vec<f64>,
}

impl Gains {
    fn of(run: &Run, model: &Model, factor: f64) -> Self {
        let of = |series: &Option<JointSeries>, fixed: Option<f64>| {
            let one = |joint: &qv_sim::Joint| {
                let column = run.joint_names.iter().position(|n| *n == joint.name);
                let mut all: Vec<f64> = series
                    .as_ref()
                    .zip(column)
                    .map_or(Vec::new(), |(s, c)| s.column(c).filter(|x| x.is_finite() && *x > 0.0).collect());
                if all.is_empty() { fixed.unwrap_or(0.0) } else { median(&mut all) }
            };
            model.joints.iter().map(one).collect::<Vec<f64>>()
        };
        let mut kp = of(&run.commands.kp, run.actuator.kp);
        kp.iter_mut().for_each(|x| *x *= factor);
        Self { kp, kd: of(&run.commands.kd, run.actuator.kd) }
    }
}

fn record(
    run: &Run,
    model: &Model,
    terrain: &Terrain,
    options: &Options,
    limits: &Limits,
    motion: &Motion,
) -> Result<Option<Run>, GapError> {
    let numerics = Numerics::default();
    let mut batch = Batch::<f64>::new(model, terrain, &numerics.options(0.05), 1)?;
    let given = expand(model, terrain, &options.given)?;
    for (name, value) in stated_parameters(run, model).into_iter().chain(given) {
        batch.set_parameter(0, &name, value)?;
    }
    let first = &motion.position[0];
    let Some(state) = at_rest(run, model, first) else { return Ok(None) };
    batch.set_state(0, &state)?;
    let gains = Gains::of(run, model, motion.gain);
    let columns: Vec<usize> =
        model.joints.iter().filter_map(|j| run.joint_names.iter().position(|n| *n == j.name)).collect();
    let mut recorder = Recorder::new(run, model, Noise::of(run, &columns));
    let dt = numerics.timestep;
    let settle = (SETTLE / dt).round() as usize;
    let steps = (motion.position.len() as f64 * motion.interval / dt).floor() as usize;
    let zeros = vec![0.0; model.joints.len()];
    let mut remarks = usize::MAX;
    for k in 0..settle + steps {
        let time = (k as f64 - settle as f64) * dt;
        let row = ((time / motion.interval + 1e-9).floor().max(0.0) as usize).min(motion.position.len() - 1);
        if k == 0 || row != remarks {
            let q = &motion.position[row];
            batch.set_command(0, &JointCommand { q, dq: &zeros, kp: &gains.kp, kd: &gains.kd, tau: &zeros })?;
            remarks = row;
        }
        if k >= settle {
            let seen = batch.sensors(0)?;
            if !is_within(limits, model, &seen) {
                return Ok(None);
            }
            recorder.take(time, &seen);
        }
        batch.step();
    }
    if batch.is_faulty(0)? {
        return Ok(None);
    }
    Ok(Some(recorder.finish(run, model, motion, &gains)))
}

/// At rest in a posture; a free base where it was first measured, or with its lowest sphere on the plane z = 0.
fn at_rest(run: &Run, model: &Model, posture: &[f64]) -> Option<State> {
    let mut q = posture.to_vec();
    if model.base == BaseKind::Floating {
        let pose = run.measured.base_pose.as_ref();
        let measured = pose.and_then(|s| (0..s.len()).map(|i| s.row(i)).find(|r| r.iter().all(|x| x.is_finite())));
        let base = match measured {
            Some(row) => row[..7].to_vec(),
            None => {
                let mut standing = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
                standing.extend(posture);
                vec![0.0, 0.0, -lowest(model, &standing)?, 1.0, 0.0, 0.0, 0.0]
            }
        };
        q.splice(..0, base);
    }
    let free = if model.base == BaseKind::Floating { 6 } else { 0 };
    Some(State { v: vec![0.0; free + posture.len()], q })
}

/// Height of the lowest point of all spheres.
fn lowest(model: &Model, q: &[f64]) -> Option<f64> {
    let poses = model.world_from_links(q);
    let of = |geom: &qv_sim::Geom| match geom.shape {
        Shape::Sphere(radius) => Some(poses[geom.link].transform_point(geom.link_from_geom.position).z - radius),
        _ => None,
    };
    model.geoms.iter().filter_map(of).min_by(f64::total_cmp)
}

fn is_within(limits: &Limits, model: &Model, seen: &SensorReading) -> bool {
    let upright = DQuat::from_xyzw(
        seen.base_orientation[1],
        seen.base_orientation[2],
        seen.base_orientation[3],
        seen.base_orientation[0],
    );
    let leans = (upright * DVec3::Z).angle_between(DVec3::Z);
    let of_joint = |j: usize| {
        let [low, high] = limits.position[j];
        let beyond = if limits.on_feet { 1.0 } else { BEYOND * (high - low) };
        let is_there = seen.q[j] > low - beyond && seen.q[j] < high + beyond;
        let is_slow = seen.dq[j].abs() <= FASTER * limits.speed[j];
        is_there && is_slow && seen.tau[j].abs() <= OF_TORQUE * limits.torque[j]
    };
    (model.base == BaseKind::Fixed || leans < LEANS) && (0..model.joints.len()).all(of_joint)
}

/// Writes what sensors say at the rates of the recording.
struct Recorder {
    noise: Noise,
    random: SplitMix64,
    measured: Measurements,
    /// Interval of joint states and of poses \[s\], and when the next ones are due.
    every: [f64; 2],
    due: [f64; 2],
}

impl Recorder {
    fn new(run: &Run, model: &Model, noise: Noise) -> Self {
        let m = &run.measured;
        let like = |s: &Option<JointSeries>, joints: usize| {
            s.as_ref().map(|_| JointSeries { time: Vec::new(), values: Vec::new(), joints })
        };
        let n = model.joints.len();
        let measured = Measurements {
            position: like(&m.position, n),
            velocity: like(&m.velocity, n),
            torque: like(&m.torque, n),
            gyro: like(&m.gyro, 3),
            acceleration: like(&m.acceleration, 3),
            orientation: like(&m.orientation, 4),
            base_pose: like(&m.base_pose, 7),
            ..Measurements::default()
        };
        let interval = |s: &Option<JointSeries>| {
            let stamps = s.as_ref().map_or(0.01, |s| qv_recording::median_interval(&s.time));
            // A whole number of steps.
            if stamps.is_finite() { (stamps / 0.001).round().max(1.0) * 0.001 } else { 0.01 }
        };
        let every = [interval(&m.position), interval(&m.base_pose)];
        Self { noise, random: SplitMix64::of(SEED, 0), measured, every, due: [0.0; 2] }
    }

    fn take(&mut self, time: f64, seen: &SensorReading) {
        let is_due = [0, 1].map(|k| time >= self.due[k] - 1e-9);
        let (noise, random, m) = (&self.noise, &mut self.random, &mut self.measured);
        let of = |all: &[f64], j: usize| all.get(j).copied().unwrap_or(0.0);
        let mut joints = |series: &mut Option<JointSeries>, values: &[f64], deviations: &[f64], steps: &[f64]| {
            if let Some(series) = series {
                series.time.push(time);
                let one = |(j, x): (usize, &f64)| read(x + random.normal(of(deviations, j)), of(steps, j));
                series.values.extend(values.iter().enumerate().map(one));
            }
        };
        let [q, dq, tau] = &noise.steps;
        if is_due[0] {
            joints(&mut m.position, &seen.q, &noise.position, q);
            joints(&mut m.velocity, &seen.dq, &noise.velocity, dq);
            joints(&mut m.torque, &seen.tau, &noise.torque, tau);
        }
        let mut write = |series: &mut Option<JointSeries>, values: &[f64], deviation: &dyn Fn(usize) -> f64| {
            if let Some(series) = series {
                series.time.push(time);
                series.values.extend(values.iter().enumerate().map(|(j, x)| x + random.normal(deviation(j))));
            }
        };
        if is_due[0] {
            self.due[0] += self.every[0];
            write(&mut m.gyro, &seen.gyro, &|_| noise.gyro);
            write(&mut m.acceleration, &seen.acc, &|_| noise.acceleration);
            write(&mut m.orientation, &seen.imu_orientation, &|_| 0.5 * noise.orientation);
        }
        if is_due[1] {
            self.due[1] += self.every[1];
            let pose = [&seen.base_position[..], &seen.base_orientation[..]].concat();
            write(&mut m.base_pose, &pose, &|k| if k < 3 { noise.place } else { 0.5 * noise.pose });
        }
    }

    fn finish(self, run: &Run, model: &Model, motion: &Motion, gains: &Gains) -> Run {
        let joints = model.joints.len();
        let time: Vec<f64> = (0..motion.position.len()).map(|k| k as f64 * motion.interval).collect();
        let constant = |row: &[f64]| JointSeries { values: row.repeat(time.len()), time: time.clone(), joints };
        let commands = Commands {
            position: Some(JointSeries { values: motion.position.concat(), time: time.clone(), joints }),
            velocity: run.commands.velocity.as_ref().map(|_| constant(&vec![0.0; joints])),
            torque: run.commands.torque.as_ref().map(|_| constant(&vec![0.0; joints])),
            kp: run.commands.kp.as_ref().map(|_| constant(&gains.kp)),
            kd: run.commands.kd.as_ref().map(|_| constant(&gains.kd)),
        };
        let parameters = |joint: &qv_sim::Joint| {
            let column = run.joint_names.iter().position(|n| *n == joint.name);
            column.and_then(|c| run.joint_parameters.get(c).cloned()).unwrap_or_default()
        };
        Run {
            joint_names: model.joint_names().to_vec(),
            joint_parameters: model.joints.iter().map(parameters).collect(),
            commands,
            measured: self.measured,
            epoch: 0,
            sources: Vec::new(),
            faults: Vec::new(),
            lost: Vec::new(),
            remarks: Vec::new(),
            robot: run.robot.clone(),
            base: run.base,
            foot_names: run.foot_names.clone(),
            imu_position: run.imu_position,
            actuator: run.actuator,
        }
    }
}
