//! Recordings of a simulated Go2, as a robot's own computer would make them: for fixtures, for tests, and for runs whose
//! cause is known. Commands and states at 500 Hz, poses at 50 Hz, with sensor noise; the same seed gives the same bytes.

use crate::gait::{Squat, Trot};
use crate::messages::{self, LowCmd, LowState};
use crate::model;
use qv_replay::ReplayError;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SensorReading, SimError, SimOptions, State, Terrain};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::io::{Seek, Write};

/// Length of [`motion`] \[s\].
pub const DURATION: f64 = 18.0;
/// Start of a recording, nanoseconds since the epoch.
pub const START: u64 = 1_700_000_000_000_000_000;
/// A standing robot settles this long before the recording starts \[s\].
const SETTLING: f64 = 0.5;
/// Two simulation steps of 1 ms between states.
const INTERVAL: u64 = 2_000_000;
/// States between two poses.
const STATES_PER_POSE: u64 = 10;
/// A command leaves this long after the state that it answers \[ns\].
const COMMAND_DELAY: u64 = 50_000;

/// What the recorded robot is: its departures from the model, and the seed of its noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Parameters of the simulator by name.
    pub parameters: Vec<(String, f64)>,
    /// Seed of the sensor noise.
    pub seed: u64,
}

/// One message of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// Topic, as on the robot.
    pub topic: &'static str,
    /// Time of logging \[ns since the epoch\].
    pub time: u64,
    /// CDR bytes.
    pub data: Vec<u8>,
}

/// Standard deviations of the noise on each sensor.
mod noise {
    pub const POSITION: f64 = 0.0008;
    pub const VELOCITY: f64 = 0.03;
    pub const TORQUE: f64 = 0.2;
    pub const GYRO: f64 = 0.01;
    pub const ACCELERATION: f64 = 0.1;
    pub const ORIENTATION: f64 = 0.001;
    pub const FORCE: f64 = 2.0;
    pub const POSE_POSITION: f64 = 0.002;
    pub const POSE_ORIENTATION: f64 = 0.002;
}

/// Independent normal deviates from a seed: SplitMix64 (Steele, Lea, Flood 2014) and the transform of Box and Muller.
#[derive(Debug, Clone)]
struct Normal(u64);

impl Normal {
    /// Uniform in (0, 1].
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        ((z >> 11) + 1) as f64 / (1u64 << 53) as f64
    }

    fn next(&mut self, deviation: f64) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        deviation * (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
    }

    fn add<const N: usize>(&mut self, values: [f64; N], deviation: f64) -> [f64; N] {
        values.map(|x| x + self.next(deviation))
    }
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
    let mut normal = Normal(seed);
    let mut drawn = Vec::new();
    drawn.push(("link.base.mass_scale".to_string(), 1.0 + normal.next(0.01)));
    for axis in ["x", "y", "z"] {
        drawn.push((format!("link.base.com_{axis}"), normal.next(0.002)));
    }
    for joint in model::JOINT_NAMES {
        drawn.push((format!("actuator.{joint}.kp_scale"), 1.0 + normal.next(0.015)));
        drawn.push((format!("actuator.{joint}.kd_scale"), 1.0 + normal.next(0.03)));
        drawn.push((format!("joint.{joint}.armature"), model::ARMATURE * (1.0 + normal.next(0.05))));
        drawn.push((format!("joint.{joint}.coulomb_friction"), normal.next(0.02).abs()));
    }
    drawn
}

/// A command latency \[s\] of all joints.
pub fn command_latency(seconds: f64) -> Vec<(String, f64)> {
    model::JOINT_NAMES.iter().map(|joint| (format!("actuator.{joint}.command_latency"), seconds)).collect()
}

fn simulator(error: SimError) -> ReplayError {
    ReplayError::Run { what: "synthetic robot".into(), expected: "a simulation".into(), found: error.to_string() }
}

/// Records [`motion`] by `robot` on `terrain`, which must be at height 0 around the origin.
///
/// # Errors
/// When a parameter means nothing, or the simulation runs away.
pub fn record(terrain: &Terrain, robot: &Robot) -> Result<Vec<Message>, ReplayError> {
    let mut sim = simulation(terrain, robot).map_err(simulator)?;
    let mut normal = Normal(robot.seed);
    let mut recorded = Vec::new();
    send(&mut sim, &command_at(0.0)).map_err(simulator)?;
    sim.step_many((SETTLING * 1000.0) as usize);
    for k in 0..(DURATION * 500.0) as u64 {
        let time = START + INTERVAL * k;
        let seen = sim.sensors(0).map_err(simulator)?;
        let state = low_state(&seen, sim.model(), 2 * k as u32, &mut normal);
        recorded.push(Message { topic: "/lowstate", time, data: messages::encode_low_state(&state) });
        if k % STATES_PER_POSE == 0 {
            let position = normal.add(seen.base_position, noise::POSE_POSITION);
            let orientation = turned(seen.base_orientation, normal.add([0.0; 3], noise::POSE_ORIENTATION));
            let data = messages::encode_odometry(time, position, orientation);
            recorded.push(Message { topic: "/Odometry", time, data });
        }
        let command = command_at(k as f64 * 0.002);
        let data = messages::encode_low_cmd(&command);
        recorded.push(Message { topic: "/lowcmd", time: time + COMMAND_DELAY, data });
        send(&mut sim, &command).map_err(simulator)?;
        sim.step_many(2);
        if sim.is_faulty(0).map_err(simulator)? {
            let (what, found) = ("synthetic robot".into(), format!("one that ran away after {} s", k as f64 * 0.002));
            return Err(ReplayError::Run { what, expected: "a finite state".into(), found });
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
    let mut q = vec![0.0, 0.0, model::touching_height(&model::STAND), 1.0, 0.0, 0.0, 0.0];
    q.extend(model::STAND);
    sim.set_state(0, &State { q, v: vec![0.0; 18] })?;
    Ok(sim)
}

fn command_at(t: f64) -> LowCmd {
    LowCmd { q: motion(t), kp: [model::DEFAULT_KP; 12], kd: [model::DEFAULT_KD; 12], ..Default::default() }
}

/// The command as its 32-bit message has it.
fn send(sim: &mut Batch<f64>, command: &LowCmd) -> Result<(), SimError> {
    let narrow = |values: &[f64; 12]| values.map(|x| f64::from(x as f32));
    let (q, dq, tau) = (narrow(&command.q), narrow(&command.dq), narrow(&command.tau));
    let (kp, kd) = (narrow(&command.kp), narrow(&command.kd));
    sim.set_command(0, &JointCommand { q: &q, dq: &dq, kp: &kp, kd: &kd, tau: &tau })
}

fn low_state(seen: &SensorReading, go2: &Model, tick: u32, normal: &mut Normal) -> LowState {
    let joints = |values: &[f64]| std::array::from_fn(|j| values[j]);
    let foot = |link: &str| {
        let of_link = go2.geoms.iter().zip(&seen.foot_force).filter(|(g, _)| go2.links[g.link].name == link);
        of_link.map(|(_, force)| force).sum::<f64>()
    };
    LowState {
        q: normal.add(joints(&seen.q), noise::POSITION),
        dq: normal.add(joints(&seen.dq), noise::VELOCITY),
        tau: normal.add(joints(&seen.tau), noise::TORQUE),
        quaternion: turned(seen.imu_orientation, normal.add([0.0; 3], noise::ORIENTATION)),
        gyroscope: normal.add(seen.gyro, noise::GYRO),
        accelerometer: normal.add(seen.acc, noise::ACCELERATION),
        foot_force: normal.add(model::FOOT_LINKS.map(foot), noise::FORCE),
        tick,
    }
}

/// A quaternion w, x, y, z turned by a small rotation vector \[rad\] of its own frame.
fn turned(wxyz: [f64; 4], by: [f64; 3]) -> [f64; 4] {
    let [w, x, y, z] = wxyz;
    let r = glam::DQuat::from_xyzw(x, y, z, w) * glam::DQuat::from_scaled_axis(by.into());
    [r.w, r.x, r.y, r.z]
}

/// Writes the messages as a ROS 2 bag in MCAP, zstd-compressed.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_bag(messages: &[Message], out: impl Write + Seek) -> Result<(), ReplayError> {
    let failed = |e: mcap::McapError| ReplayError::Write { what: "a bag".into(), reason: e.to_string() };
    // One thread and one level, so that the same messages are the same bytes.
    let options = mcap::WriteOptions::new().profile("ros2").compression(Some(mcap::Compression::Zstd));
    let mut writer = options.compression_level(1).compression_threads(0).create(out).map_err(failed)?;
    let topics = [
        ("/lowcmd", messages::LOW_CMD_TYPE, messages::LOW_CMD),
        ("/lowstate", messages::LOW_STATE_TYPE, messages::LOW_STATE),
        ("/Odometry", messages::ODOMETRY_TYPE, messages::ODOMETRY),
    ];
    let mut channels = BTreeMap::new();
    for (topic, name, text) in topics {
        let schema = writer.add_schema(name, "ros2msg", text.as_bytes()).map_err(failed)?;
        let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).map_err(failed)?;
        channels.insert(topic, channel);
    }
    for (sequence, message) in messages.iter().enumerate() {
        let expected = || ReplayError::Run {
            what: "topic of a message".into(),
            expected: "/lowcmd, /lowstate or /Odometry".into(),
            found: message.topic.into(),
        };
        let header = mcap::records::MessageHeader {
            channel_id: *channels.get(message.topic).ok_or_else(expected)?,
            sequence: sequence as u32,
            log_time: message.time,
            publish_time: message.time,
        };
        writer.write_to_known_channel(&header, &message.data).map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_its_deviation_and_repeats() {
        let mut normal = Normal(7);
        let drawn: Vec<f64> = (0..20_000).map(|_| normal.next(2.0)).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.05 && (variance.sqrt() - 2.0).abs() < 0.04, "{mean} {variance}");
        assert_eq!(Normal(7).next(2.0), drawn[0]);
        assert_ne!(Normal(8).next(2.0), drawn[0]);
    }

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
        let robot = Robot { parameters: [small_differences(3), command_latency(0.008)].concat(), seed: 3 };
        let sim = simulation(&Terrain::plane(), &robot).unwrap();
        assert_eq!(sim.parameter(0, "actuator.RR_calf_joint.command_latency").unwrap(), 0.008);
        let wrong = Robot { parameters: vec![("link.nose.mass_scale".into(), 1.0)], seed: 3 };
        assert!(record(&Terrain::plane(), &wrong).unwrap_err().to_string().contains("link.nose.mass_scale"));
    }
}
