//! A node for ROS 2 that drives a robot to a coloured cone. In: a camera's pictures and odometry. Out: velocities, five times a second.
//! [`messages`] are what goes over the wire, [`driver`] decides and knows no ROS, [`node`] joins both. It was
//! not run on a robot.

pub mod driver;
pub mod messages;
pub mod node;
