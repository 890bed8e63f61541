//! Messages, and the bag that they are written to.

use crate::messages;
use qv_recording::RecordingError;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

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

/// Writes the messages as a ROS 2 bag in MCAP, zstd-compressed.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_bag(messages: &[Message], out: impl Write + Seek) -> Result<(), RecordingError> {
    let failed = |e: mcap::McapError| RecordingError::Write { what: "a bag".into(), reason: e.to_string() };
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
        let expected =
            || qv_core::Mismatch::new("topic of a message", "/lowcmd, /lowstate or /Odometry", message.topic);
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
