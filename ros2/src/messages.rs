//! The messages, field for field as in the packages `sensor_msgs`, `nav_msgs` and `geometry_msgs` of ROS 2.

use ros2_client::Message;
use serde::{Deserialize, Serialize};

/// `builtin_interfaces/Time`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds beyond them.
    pub nanosec: u32,
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// When it was.
    pub stamp: Time,
    /// Frame of the numbers.
    pub frame_id: String,
}

/// `sensor_msgs/Image`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Image {
    /// When it was taken.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// What a pixel is.
    pub encoding: String,
    /// Order of the bytes of a number.
    pub is_bigendian: u8,
    /// Bytes from one row to the next.
    pub step: u32,
    /// `step` x `height` bytes.
    pub data: Vec<u8>,
}

/// `geometry_msgs/Vector3`, and `geometry_msgs/Point`, which has the same fields.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// Forwards.
    pub x: f64,
    /// To the left.
    pub y: f64,
    /// Up.
    pub z: f64,
}

/// `geometry_msgs/Quaternion`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// First part of the vector.
    pub x: f64,
    /// Second part of the vector.
    pub y: f64,
    /// Third part of the vector.
    pub z: f64,
    /// The scalar.
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

/// `geometry_msgs/Pose`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// \[m\].
    pub position: Vector3,
    /// From the axes of the robot to those of the odometry.
    pub orientation: Quaternion,
}

/// A matrix of 6 x 6, as rows of nine: serde knows no longer arrays, and on the wire it is the same.
pub type Covariance = [[f64; 9]; 4];

/// `geometry_msgs/PoseWithCovariance`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseWithCovariance {
    /// Where it is.
    pub pose: Pose,
    /// How sure that is.
    pub covariance: Covariance,
}

/// `geometry_msgs/Twist`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Twist {
    /// \[m/s\].
    pub linear: Vector3,
    /// \[rad/s\].
    pub angular: Vector3,
}

/// `geometry_msgs/TwistWithCovariance`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct TwistWithCovariance {
    /// How it moves.
    pub twist: Twist,
    /// How sure that is.
    pub covariance: Covariance,
}

/// `nav_msgs/Odometry`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// When it was.
    pub header: Header,
    /// The robot's frame.
    pub child_frame_id: String,
    /// Where it is.
    pub pose: PoseWithCovariance,
    /// How it moves.
    pub twist: TwistWithCovariance,
}

impl Message for Image {}
impl Message for Odometry {}
impl Message for Twist {}
