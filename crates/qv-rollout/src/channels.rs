//! What of a recording can be compared, and parts of a recording.

use qv_core::JointSeries;
use qv_recording::Run;
use qv_recording::run::{ActuatorKind, Commands, FaultKind, Measurements};

/// A channel that is compared; `usize` is the joint or the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Position of a joint \[rad\].
    Position(usize),
    /// Velocity of a joint \[rad/s\].
    Velocity(usize),
    /// Angular velocity of the base about one of its axes \[rad/s\].
    Gyro(usize),
    /// Turn of the base by the IMU about an axis of the world \[rad\], yaw from where the window starts.
    Attitude(usize),
    /// Position of the base in the world \[m\].
    Base(usize),
    /// Turn from the IMU's attitude to that of the pose about an axis of the world \[rad\]: nothing is simulated for it.
    PoseAgainstImu(usize),
    /// Height at which the ground touches the feet at the start \[m\]: one number in a window, not in a bin.
    Ground,
}

impl Channel {
    /// Its joint.
    pub fn joint(self) -> Option<usize> {
        match self {
            Self::Position(j) | Self::Velocity(j) => Some(j),
            _ => None,
        }
    }
}

/// Channels that `run` has; those of columns that stood still are left out.
pub fn channels(run: &Run, columns: &[usize], free: bool) -> Vec<Channel> {
    let m = &run.measured;
    let joints = 0..columns.len();
    let mut all = Vec::new();
    let alive = |channel: &'static str| joints.clone().filter(move |&j| is_alive(run, channel, j, columns));
    let frozen = |name: &str| run.faults.iter().any(|f| f.kind == FaultKind::Frozen && f.channel.starts_with(name));
    all.extend(alive("position").filter(|_| m.position.is_some()).map(Channel::Position));
    let moving = alive("velocity").filter(|&j| is_alive(run, "position", j, columns));
    all.extend(moving.filter(|_| m.velocity.is_some()).map(Channel::Velocity));
    if !free {
        return all;
    }
    let pose = m.base_pose.is_some() && !frozen("base pose");
    if m.gyro.is_some() && !frozen("gyro") {
        all.extend((0..3).map(Channel::Gyro));
    }
    if m.orientation.is_some() && !frozen("orientation") {
        all.extend((0..3).map(Channel::Attitude));
        all.extend((0..3).filter(|_| pose).map(Channel::PoseAgainstImu));
    } else if pose {
        all.extend((0..3).map(Channel::Attitude));
    }
    if pose {
        all.extend((0..3).map(Channel::Base));
        all.push(Channel::Ground);
    }
    all
}

/// Number of features of a channel.
pub fn width(channel: Channel, bins: usize) -> usize {
    if channel == Channel::Ground { 1 } else { bins }
}

/// The rows of `run` from `from` to `to` \[s\], and what is said about it.
pub fn snippet(run: &Run, from: f64, to: f64) -> Run {
    let cut = |series: &Option<JointSeries>, before: usize| {
        series.as_ref().map(|s| {
            let first = s.time.partition_point(|&t| t < from).saturating_sub(before);
            let last = s.time.partition_point(|&t| t <= to).max(first);
            JointSeries {
                time: s.time[first..last].to_vec(),
                values: s.values[first * s.joints..last * s.joints].to_vec(),
                joints: s.joints,
            }
        })
    };
    let (c, m) = (&run.commands, &run.measured);
    // A command is held: the one before the first stamp counts.
    let commands = Commands {
        position: cut(&c.position, 1),
        velocity: cut(&c.velocity, 1),
        torque: cut(&c.torque, 1),
        kp: cut(&c.kp, 1),
        kd: cut(&c.kd, 1),
    };
    let measured = Measurements {
        position: cut(&m.position, 0),
        velocity: cut(&m.velocity, 0),
        torque: cut(&m.torque, 0),
        gyro: cut(&m.gyro, 0),
        acceleration: cut(&m.acceleration, 0),
        orientation: cut(&m.orientation, 0),
        foot_force: cut(&m.foot_force, 0),
        base_pose: cut(&m.base_pose, 0),
    };
    Run { commands, measured, sources: Vec::new(), faults: Vec::new(), lost: Vec::new(), ..shell(run) }
}

/// All of a run but its data.
fn shell(run: &Run) -> Run {
    Run {
        robot: qv_recording::run::Robot::Named(String::new()),
        base: run.base,
        joint_names: run.joint_names.clone(),
        foot_names: run.foot_names.clone(),
        imu_position: run.imu_position,
        actuator: run.actuator,
        joint_parameters: run.joint_parameters.clone(),
        commands: Commands::default(),
        measured: Measurements::default(),
        epoch: run.epoch,
        sources: Vec::new(),
        faults: Vec::new(),
        lost: Vec::new(),
        remarks: Vec::new(),
    }
}

/// Whether no fault says that a channel of a joint stood still, or that its torque is of another convention (velocities that are have been replaced).
pub fn is_alive(run: &Run, channel: &str, joint: usize, columns: &[usize]) -> bool {
    let name = format!("{channel} {}", run.joint_names[columns[joint]]);
    let is_dead = |kind: FaultKind| kind == FaultKind::Frozen || (kind == FaultKind::Convention && channel == "torque");
    !run.faults.iter().any(|f| is_dead(f.kind) && f.channel == name)
}

/// Joints with measured torque, speed and a controller's law to compare them with.
pub(crate) fn law_joints(run: &Run, columns: &[usize]) -> Vec<usize> {
    let m = &run.measured;
    let (Some(torque), Some(_), Some(_)) = (&m.torque, &m.velocity, &m.position) else { return Vec::new() };
    if run.actuator.kind != ActuatorKind::Pd || run.commands.position.is_none() {
        return Vec::new();
    }
    (0..columns.len())
        .filter(|&j| torque.column(columns[j]).any(|x| x != 0.0) && is_alive(run, "torque", j, columns))
        .collect()
}
