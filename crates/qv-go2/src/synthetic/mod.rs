//! Recordings of a simulated Go2, as a robot's own computer would make them: for fixtures, for tests, and for runs whose
//! cause is known. Commands and states at 500 Hz, poses at 50 Hz, with sensor noise; the same seed gives the same bytes.

mod bag;
mod noise;

pub use bag::{Message, write_bag};
pub use noise::Deviations;

use crate::gait::{Squat, Trot};
use crate::messages::{self, LowCmd, LowState};
use crate::model;
use qv_core::Mismatch;
use qv_core::random::SplitMix64;
use qv_recording::RecordingError;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SensorReading, SimError, SimOptions, State, Terrain};

/// Length of [`motion`] \[s\].
pub const DURATION: f64 = 18.0;
/// Start of a recording, nanoseconds since the epoch.
pub const START: u64 = 1_700_000_000_000_000_000;
/// A standing robot settles this long before the recording starts \[s\].
const SETTLING: f64 = 0.5;
/// Two simulation steps of 1 ms between states \[ns\].
pub const INTERVAL: u64 = 2_000_000;
/// States between two poses.
pub const STATES_PER_POSE: u64 = 10;
/// A command leaves this long after the state that it answers \[ns\].
pub const COMMAND_DELAY: u64 = 50_000;

/// What the recorded robot is: its departures from the model, and the seed of its noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Parameters of the simulator by name.
    pub parameters: Vec<(String, f64)>,
    /// Seed of the sensor noise.
    pub seed: u64,
    /// Where it stands at first: x, y \[m\], and the direction that it faces, turned about z \[rad\].
    pub start: [f64; 3],
}

/// Target angles \[rad\] in joint order: stand 2 s, two squats until 6 s, trot until 16 s, stand until [`DURATION`].
pub fn motion(t: f64) -> [f64; 12] {
    const SQUAT: [f64; 2] = [2.0, 6.0];
    const TROT: [f64; 2] = [6.0, 16.0];
    if (SQUAT[0]..SQUAT[1]).contains(&t) {
        return Squat::default().target(t - SQUAT[0]);
    }
    if !(TROT[0]..TROT[1]).contains(&t) {
        return model::STAND;
    }
    // The gait has a smooth start but no end of its own.
    let u = (TROT[1] - t).clamp(0.0, 0.5) / 0.5;
    let weight = u * u * (3.0 - 2.0 * u);
    let trot = Trot::default().target(t - TROT[0]);
    std::array::from_fn(|j| model::STAND[j] + weight * (trot[j] - model::STAND[j]))
}

/// The small ways in which any robot differs from its model and that nobody names: a few per cent of mass, gains and
/// friction of the ground, millimetres of its centre of mass.
pub fn small_differences(seed: u64) -> Vec<(String, f64)> {
    let mut draws = SplitMix64::new(seed);
    let mut drawn = Vec::new();
    drawn.push(("link.base.mass_scale".to_string(), 1.0 + draws.normal(0.01)));
    for axis in ["x", "y", "z"] {
        drawn.push((format!("link.base.com_{axis}"), draws.normal(0.002)));
    }
    for joint in model::JOINT_NAMES {
        drawn.push((format!("actuator.{joint}.kp_scale"), 1.0 + draws.normal(0.015)));
        drawn.push((format!("actuator.{joint}.kd_scale"), 1.0 + draws.normal(0.03)));
        drawn.push((format!("joint.{joint}.armature"), model::ARMATURE * (1.0 + draws.normal(0.05))));
        drawn.push((format!("joint.{joint}.coulomb_friction"), draws.normal(0.02).abs()));
    }
    drawn
}

/// A command latency \[s\] of all joints.
pub fn command_latency(seconds: f64) -> Vec<(String, f64)> {
    model::JOINT_NAMES.iter().map(|joint| (format!("actuator.{joint}.command_latency"), seconds)).collect()
}

/// What a simulator says, as the error of a recording.
pub fn simulator(error: SimError) -> RecordingError {
    Mismatch::new("synthetic robot", "a simulation", error).into()
}

/// Records [`motion`] by `robot` on `terrain`, which must be at height 0 where it stands at first.
///
/// # Errors
/// When a parameter means nothing, or the simulation runs away.
pub fn record(terrain: &Terrain, robot: &Robot) -> Result<Vec<Message>, RecordingError> {
    let mut sim = simulation(terrain, robot).map_err(simulator)?;
    let mut draws = SplitMix64::new(robot.seed);
    let deviations = Deviations::NOMINAL;
    let mut recorded = Vec::new();
    send(&mut sim, &command_at(0.0)).map_err(simulator)?;
    sim.step_many((SETTLING * 1000.0) as usize);
    for k in 0..(DURATION * 500.0) as u64 {
        let time = START + INTERVAL * k;
        let seen = sim.sensors(0).map_err(simulator)?;
        let state = low_state(&seen, sim.model(), 2 * k as u32, &deviations, &mut draws);
        recorded.push(Message { topic: "/lowstate", time, data: messages::encode_low_state(&state) });
        if k % STATES_PER_POSE == 0 {
            recorded.push(pose(&seen, time, &deviations, &mut draws));
        }
        let command = command_at(k as f64 * 0.002);
        let data = messages::encode_low_cmd(&command);
        recorded.push(Message { topic: "/lowcmd", time: time + COMMAND_DELAY, data });
        send(&mut sim, &command).map_err(simulator)?;
        sim.step_many(2);
        if sim.is_faulty(0).map_err(simulator)? {
            let found = format!("one that ran away after {} s", k as f64 * 0.002);
            return Err(Mismatch::new("synthetic robot", "a finite state", found).into());
        }
    }
    Ok(recorded)
}

fn simulation(terrain: &Terrain, robot: &Robot) -> Result<Batch<f64>, SimError> {
    let options = ModelOptions { base: BaseKind::Floating, armature: model::ARMATURE, ..Default::default() };
    let go2 = Model::from_urdf(&model::urdf(), &options)?;
    let longest = |name: &str| {
        let fits = robot.parameters.iter().filter(|(n, _)| n.ends_with(name));
        fits.map(|(_, value)| *value).fold(0.0, f64::max)
    };
    let options = SimOptions {
        max_command_latency: longest(".command_latency"),
        max_sensor_latency: longest(".encoder_latency").max(longest("pose.delay")),
        ..Default::default()
    };
    let mut sim = Batch::new(&go2, terrain, &options, 1)?;
    for (name, value) in &robot.parameters {
        sim.set_parameter(0, name, *value)?;
    }
    let [x, y, yaw] = robot.start;
    let (sin, cos) = (0.5 * yaw).sin_cos();
    let mut q = vec![x, y, model::touching_height(&model::STAND), cos, 0.0, 0.0, sin];
    q.extend(model::STAND);
    sim.set_state(0, &State { q, v: vec![0.0; 18] })?;
    Ok(sim)
}

fn command_at(t: f64) -> LowCmd {
    LowCmd { q: motion(t), kp: [model::DEFAULT_KP; 12], kd: [model::DEFAULT_KD; 12], ..Default::default() }
}

fn send(sim: &mut Batch<f64>, command: &LowCmd) -> Result<(), SimError> {
    as_sent(command, |command| sim.set_command(0, command))
}

/// Hands on the command as its 32-bit message has it.
pub fn as_sent<T>(command: &LowCmd, to: impl FnOnce(&JointCommand) -> T) -> T {
    let narrow = |values: &[f64; 12]| values.map(|x| f64::from(x as f32));
    let (q, dq, tau) = (narrow(&command.q), narrow(&command.dq), narrow(&command.tau));
    let (kp, kd) = (narrow(&command.kp), narrow(&command.kd));
    to(&JointCommand { q: &q, dq: &dq, kp: &kp, kd: &kd, tau: &tau })
}

/// What the robot's computer hears of a reading, with noise.
pub fn low_state(
    seen: &SensorReading,
    go2: &Model,
    tick: u32,
    deviations: &Deviations,
    draws: &mut SplitMix64,
) -> LowState {
    let joints = |values: &[f64]| std::array::from_fn(|j| values[j]);
    let foot = |link: &str| {
        let of_link = go2.geoms.iter().zip(&seen.foot_force).filter(|(g, _)| go2.links[g.link].name == link);
        of_link.map(|(_, force)| force).sum::<f64>()
    };
    LowState {
        q: draws.add(joints(&seen.q), deviations.position),
        dq: draws.add(joints(&seen.dq), deviations.velocity),
        tau: draws.add(joints(&seen.tau), deviations.torque),
        quaternion: turned(seen.imu_orientation, draws.add([0.0; 3], deviations.orientation)),
        gyroscope: draws.add(seen.gyro, deviations.gyro),
        accelerometer: draws.add(seen.acc, deviations.acceleration),
        foot_force: draws.add(model::FOOT_LINKS.map(foot), deviations.force),
        tick,
    }
}

/// The message of the base's pose at `time` \[ns\], with noise.
pub fn pose(seen: &SensorReading, time: u64, deviations: &Deviations, draws: &mut SplitMix64) -> Message {
    let position = draws.add(seen.base_position, deviations.pose_position);
    let orientation = turned(seen.base_orientation, draws.add([0.0; 3], deviations.pose_orientation));
    Message { topic: "/Odometry", time, data: messages::encode_odometry(time, position, orientation) }
}

/// A quaternion w, x, y, z turned by a small rotation vector \[rad\] of its own frame.
fn turned(wxyz: [f64; 4], by: [f64; 3]) -> [f64; 4] {
    let [w, x, y, z] = wxyz;
    let r = glam::DQuat::from_xyzw(x, y, z, w) * glam::DQuat::from_scaled_axis(by.into());
    [r.w, r.x, r.y, r.z]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_motion_has_no_jumps() {
        let largest = (0..18_000).map(|k| {
            let (now, next) = (motion(0.001 * f64::from(k)), motion(0.001 * f64::from(k + 1)));
            now.iter().zip(&next).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        });
        let largest = largest.fold(0.0, f64::max);
        assert!(largest < 0.02, "{largest} rad within a millisecond");
    }

    #[test]
    fn differences_are_parameters_of_the_robot() {
        let robot =
            Robot { parameters: [small_differences(3), command_latency(0.008)].concat(), seed: 3, start: [0.0; 3] };
        let sim = simulation(&Terrain::plane(), &robot).unwrap();
        assert_eq!(sim.parameter(0, "actuator.RR_calf_joint.command_latency").unwrap(), 0.008);
        let wrong = Robot { parameters: vec![("link.nose.mass_scale".into(), 1.0)], seed: 3, start: [0.0; 3] };
        assert!(record(&Terrain::plane(), &wrong).unwrap_err().to_string().contains("link.nose.mass_scale"));
    }
}
