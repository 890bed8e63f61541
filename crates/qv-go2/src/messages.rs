//! The Go2's messages written: definitions as a bag carries them, and their CDR bytes. For fixtures, tests and the
//! replay of simulated robots through tools that expect the real one's topics.
//!
//! Source: unitree_ros2 (`unitree_go/msg`), nav_msgs. Arrays hold 20 motors, of which the Go2 has 12.

use crate::wire::{LEG_ON_WIRE, motor_on_wire};
use qv_recording::cdr::Writer;

/// Type name of [`LOW_CMD`].
pub const LOW_CMD_TYPE: &str = "unitree_go/msg/LowCmd";

/// Type name of [`LOW_STATE`].
pub const LOW_STATE_TYPE: &str = "unitree_go/msg/LowState";

/// Type name of [`ODOMETRY`].
pub const ODOMETRY_TYPE: &str = "nav_msgs/msg/Odometry";

/// Type name of [`SPORT_MODE_STATE`].
pub const SPORT_MODE_STATE_TYPE: &str = "unitree_go/msg/SportModeState";

/// Definition of `SportModeState`, which the robot's own walking controller sends.
pub const SPORT_MODE_STATE: &str = "TimeSpec stamp\nuint32 error_code\nIMUState imu_state\nuint8 mode\nfloat32 progress\n\
uint8 gait_type\nfloat32 foot_raise_height\nfloat32[3] position\nfloat32 body_height\nfloat32[3] velocity\n\
float32 yaw_speed\nfloat32[4] range_obstacle\nint16[4] foot_force\nfloat32[12] foot_position_body\n\
float32[12] foot_speed_body\nPathPoint[10] path_point\n\
================================================================================\nMSG: unitree_go/TimeSpec\n\
int32 sec\nuint32 nanosec\n\
================================================================================\nMSG: unitree_go/IMUState\n\
float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\nint8 temperature\n\
================================================================================\nMSG: unitree_go/PathPoint\n\
float32 t_from_start\nfloat32 x\nfloat32 y\nfloat32 yaw\nfloat32 vx\nfloat32 vy\nfloat32 vyaw\n";

/// Definition of `LowCmd`.
pub const LOW_CMD: &str = "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\n\
uint16 bandwidth\nMotorCmd[20] motor_cmd\nBmsCmd bms_cmd\nuint8[40] wireless_remote\nuint8[12] led\nuint8[2] fan\n\
uint8 gpio\nuint32 reserve\nuint32 crc\n\
================================================================================\nMSG: unitree_go/MotorCmd\n\
uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32[3] reserve\n\
================================================================================\nMSG: unitree_go/BmsCmd\n\
uint8 off\nuint8[3] reserve\n";

/// Definition of `LowState`.
pub const LOW_STATE: &str = "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\n\
uint16 bandwidth\nIMUState imu_state\nMotorState[20] motor_state\nBmsState bms_state\nint16[4] foot_force\n\
int16[4] foot_force_est\nuint32 tick\nuint8[40] wireless_remote\nuint8 bit_flag\nfloat32 adc_reel\n\
int8 temperature_ntc1\nint8 temperature_ntc2\nfloat32 power_v\nfloat32 power_a\nuint16[4] fan_frequency\n\
uint32 reserve\nuint32 crc\n\
================================================================================\nMSG: unitree_go/IMUState\n\
float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\nint8 temperature\n\
================================================================================\nMSG: unitree_go/MotorState\n\
uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nfloat32 q_raw\nfloat32 dq_raw\nfloat32 ddq_raw\n\
int8 temperature\nuint32 lost\nuint32[2] reserve\n\
================================================================================\nMSG: unitree_go/BmsState\n\
uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\nuint16 cycle\nint8[2] bq_ntc\n\
int8[2] mcu_ntc\nuint16[15] cell_vol\n";

/// Definition of `Odometry`.
pub const ODOMETRY: &str = "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
geometry_msgs/TwistWithCovariance twist\n\
================================================================================\nMSG: std_msgs/Header\n\
builtin_interfaces/Time stamp\nstring frame_id\n\
================================================================================\nMSG: builtin_interfaces/Time\n\
int32 sec\nuint32 nanosec\n\
================================================================================\n\
MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance\n\
================================================================================\nMSG: geometry_msgs/Pose\n\
geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n\
================================================================================\nMSG: geometry_msgs/Point\n\
float64 x\nfloat64 y\nfloat64 z\n\
================================================================================\nMSG: geometry_msgs/Quaternion\n\
float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n\
================================================================================\n\
MSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance\n\
================================================================================\nMSG: geometry_msgs/Twist\n\
geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n\
================================================================================\nMSG: geometry_msgs/Vector3\n\
float64 x\nfloat64 y\nfloat64 z\n";

/// Motors in a message.
const MOTORS: usize = 20;

/// A command to the 12 motors, in our joint order, SI units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LowCmd {
    /// Desired position \[rad\].
    pub q: [f64; 12],
    /// Desired velocity \[rad/s\].
    pub dq: [f64; 12],
    /// Feed-forward torque \[N m\].
    pub tau: [f64; 12],
    /// Position gain \[N m / rad\].
    pub kp: [f64; 12],
    /// Velocity gain \[N m s / rad\].
    pub kd: [f64; 12],
}

/// A state of the 12 motors, in our joint order, and of the trunk, SI units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LowState {
    /// Position \[rad\].
    pub q: [f64; 12],
    /// Velocity \[rad/s\].
    pub dq: [f64; 12],
    /// Estimated torque \[N m\].
    pub tau: [f64; 12],
    /// Orientation, w, x, y, z.
    pub quaternion: [f64; 4],
    /// Angular velocity in the trunk frame \[rad/s\].
    pub gyroscope: [f64; 3],
    /// Specific force in the trunk frame \[m/s²\].
    pub accelerometer: [f64; 3],
    /// Force on the feet FL, FR, RL, RR \[N\].
    pub foot_force: [f64; 4],
    /// Milliseconds since the start.
    pub tick: u32,
}

/// Our joint for each motor of a message, where the motor has one.
fn joint_of_motor() -> [Option<usize>; MOTORS] {
    let mut joints = [None; MOTORS];
    for (joint, motor) in motor_on_wire().into_iter().enumerate() {
        joints[motor] = Some(joint);
    }
    joints
}

fn head(w: &mut Writer) {
    w.u8(0xfe).u8(0xef).u8(0).u8(0);
    for _ in 0..4 {
        w.u32(0);
    }
    w.u16(0);
}

/// Bytes of a `LowCmd`.
pub fn encode_low_cmd(command: &LowCmd) -> Vec<u8> {
    let mut w = Writer::new();
    head(&mut w);
    for joint in joint_of_motor() {
        w.u8(u8::from(joint.is_some()));
        for values in [&command.q, &command.dq, &command.tau, &command.kp, &command.kd] {
            w.f32(joint.map_or(0.0, |j| values[j] as f32));
        }
        w.u32(0).u32(0).u32(0);
    }
    for _ in 0..4 + 40 + 12 + 2 + 1 {
        w.u8(0);
    }
    w.u32(0).u32(0);
    w.finish()
}

/// Bytes of a `LowState`.
pub fn encode_low_state(state: &LowState) -> Vec<u8> {
    let mut w = Writer::new();
    head(&mut w);
    for x in state.quaternion.iter().chain(&state.gyroscope).chain(&state.accelerometer).chain(&[0.0; 3]) {
        w.f32(*x as f32);
    }
    w.u8(0);
    for joint in joint_of_motor() {
        let of = |values: &[f64; 12]| joint.map_or(0.0, |j| values[j] as f32);
        w.u8(u8::from(joint.is_some()));
        w.f32(of(&state.q))
            .f32(of(&state.dq))
            .f32(0.0)
            .f32(of(&state.tau))
            .f32(of(&state.q))
            .f32(of(&state.dq))
            .f32(0.0);
        w.u8(0).u32(0).u32(0).u32(0);
    }
    w.u8(0).u8(0).u8(0).u8(100).i32(0).u16(0).u8(0).u8(0).u8(0).u8(0);
    for _ in 0..15 {
        w.u16(0);
    }
    let mut on_wire = [0i16; 4];
    for (foot, &place) in LEG_ON_WIRE.iter().enumerate() {
        on_wire[place] = state.foot_force[foot].round().clamp(-32768.0, 32767.0) as i16;
    }
    for force in on_wire.iter().chain(&on_wire) {
        w.i16(*force);
    }
    w.u32(state.tick);
    for _ in 0..41 {
        w.u8(0);
    }
    w.f32(0.0).u8(0).u8(0).f32(0.0).f32(0.0);
    for _ in 0..4 {
        w.u16(0);
    }
    w.u32(0).u32(0);
    w.finish()
}

/// Bytes of an `Odometry` with a pose `odom_from_base` (position \[m\], quaternion w, x, y, z) and no twist.
pub fn encode_odometry(stamp_ns: u64, position: [f64; 3], wxyz: [f64; 4]) -> Vec<u8> {
    let mut w = Writer::new();
    w.time(stamp_ns).string("odom").string("base_link");
    for x in position {
        w.f64(x);
    }
    let [qw, x, y, z] = wxyz;
    w.f64(x).f64(y).f64(z).f64(qw);
    for _ in 0..36 + 6 + 36 {
        w.f64(0.0);
    }
    w.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_recording::cdr::{Value, decode};
    use qv_recording::schema::Schema;

    /// What is written decodes by the definition, to the last byte, with joints on their motors.
    #[test]
    fn written_messages_decode() {
        let q = std::array::from_fn(|j| j as f64);
        let state = LowState { q, foot_force: [1.0, 2.0, 3.0, 4.0], tick: 77, ..Default::default() };
        let tree = decode(&Schema::parse(LOW_STATE_TYPE, LOW_STATE).unwrap(), &encode_low_state(&state)).unwrap();
        let Some(Value::Array(motors)) = tree.get("motor_state") else { panic!("motors are an array") };
        assert_eq!(motors[0].get("q").and_then(Value::as_f64), Some(3.0), "motor 0 is FR hip");
        assert_eq!(tree.get("tick"), Some(&Value::Unsigned(77)));
        let Some(Value::Array(feet)) = tree.get("foot_force") else { panic!("feet are an array") };
        assert_eq!(feet[0], Value::Signed(2), "foot 0 is FR");
        assert!(tree.get("crc").is_some());
        let command = LowCmd { kp: [40.0; 12], ..Default::default() };
        let bytes = encode_low_cmd(&command);
        assert_eq!(bytes.len(), 812, "as recorded on a robot");
        assert_eq!(encode_low_state(&state).len(), 1180, "as recorded on a robot");
        let tree = decode(&Schema::parse(LOW_CMD_TYPE, LOW_CMD).unwrap(), &bytes).unwrap();
        let Some(Value::Array(motors)) = tree.get("motor_cmd") else { panic!("motors are an array") };
        assert_eq!(motors[11].get("kp").and_then(Value::as_f64), Some(40.0));
        let bytes = encode_odometry(5_000_000_007, [1.0, 2.0, 3.0], [0.5, 0.1, 0.2, 0.3]);
        let tree = decode(&Schema::parse(ODOMETRY_TYPE, ODOMETRY).unwrap(), &bytes).unwrap();
        assert_eq!(tree.get("pose.pose.orientation.w").and_then(Value::as_f64), Some(0.5));
        assert_eq!(tree.get("header.stamp.nanosec"), Some(&Value::Unsigned(7)));
    }
}
