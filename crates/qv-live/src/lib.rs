//! What a robot says right now: topics received over DDS, checked, counted, and recorded as `ros2 bag record` does, without ROS.
//!
//! A [`Subscription`] is data: a topic, a type and its definition, as robot files name them. A [`Sample`] is one message as it came. A
//! [`Recorder`] writes samples into an MCAP file whose every second is on the disk; [`Health`] counts what came, what was lost on the way and
//! what was no message of its type. Samples come from a [`Receiver`] (feature `dds`) or from anywhere else. Nothing here publishes: there is no
//! writer of any topic, so that no robot moves by it.
//!
//! An example, which records what it makes itself:
#![doc = concat!("```\n", include_str!("../examples/record.rs"), "```")]

pub use qv_recording;

#[cfg(feature = "dds")]
mod dds;
mod error;
mod health;
mod recorder;
mod subscription;
mod window;

#[cfg(feature = "dds")]
pub use dds::{Receiver, address_of};
pub use error::LiveError;
pub use health::{Health, TopicHealth};
pub use recorder::Recorder;
pub use subscription::{Sample, Subscription, subscriptions};
pub use window::Recent;
