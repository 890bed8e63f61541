//! Samples into an MCAP file as rosbag2 writes it.

use crate::LiveError;
use crate::subscription::{Sample, Subscription};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::io::{Seek, Write};

/// A chunk is closed and handed to the system after so long \[ns\]: whatever ends the process, no more is lost.
const FLUSH: u64 = 1_000_000_000;
/// A chunk is closed from this size on \[bytes\].
const CHUNK: u64 = 1 << 20;

/// Writes one file.
pub struct Recorder<W: Write + Seek> {
    writer: Writer<W>,
    channels: Vec<u16>,
    flushed: u64,
    sequence: u32,
}

impl<W: Write + Seek> Recorder<W> {
    /// Begins a file with a channel for each subscription.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(out: W, subscriptions: &[Subscription]) -> Result<Self, LiveError> {
        // Without threads of its own: it shares a core with what it records.
        let options = WriteOptions::new().profile("ros2").compression(Some(Compression::Zstd)).chunk_size(Some(CHUNK));
        let mut writer = options.compression_level(1).compression_threads(0).create(out)?;
        let mut channels = Vec::new();
        for subscription in subscriptions {
            let schema =
                writer.add_schema(&subscription.message_type, "ros2msg", subscription.definition.as_bytes())?;
            let metadata = BTreeMap::from([("offered_qos_profiles".to_string(), String::new())]);
            channels.push(writer.add_channel(schema, &subscription.topic, "cdr", &metadata)?);
        }
        Ok(Self { writer, channels, flushed: 0, sequence: 0 })
    }

    /// Writes a sample. Both times of a message are those of its arrival, as rosbag2 has it.
    ///
    /// # Errors
    /// When it cannot be written, such as on a full disk.
    pub fn write(&mut self, sample: &Sample) -> Result<(), LiveError> {
        let Some(&channel_id) = self.channels.get(sample.subscription) else { return Ok(()) };
        let (log_time, sequence) = (sample.received, self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.writer.write_to_known_channel(&header, &sample.data)?;
        if sample.received >= self.flushed + FLUSH {
            self.flushed = sample.received;
            self.writer.flush()?;
        }
        Ok(())
    }

    /// Ends the file with its index, and gives it back.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(mut self) -> Result<W, LiveError> {
        self.writer.finish()?;
        Ok(self.writer.into_inner())
    }
}
