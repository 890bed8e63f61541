//! A node for ROS 2 that drives a robot to a coloured cone. In: a camera's pictures and odometry. Out: velocities, five times a second.
//! [`messages`] are what goes over the wire, [`driver`] decides and knows no ROS, [`node`] joins both. The same as
//! `python/examples/go2_cone.py`; a test compares both. It was not run on a robot.

pub mod driver;
pub mod messages;
pub mod node;
