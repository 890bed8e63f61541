//! What can go wrong while a robot is listened to.

use qv_recording::RecordingError;

/// See the module.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// There is no such interface, or it has no address.
    #[error("cannot listen on '{interface}': {reason}")]
    Interface {
        /// Name or address.
        interface: String,
        /// What is there instead.
        reason: String,
    },
    /// DDS refused.
    #[error("cannot subscribe to '{what}': {reason}")]
    Dds {
        /// Topic, or what of the participant.
        what: String,
        /// In the words of the library.
        reason: String,
    },
    /// The recording cannot be written.
    #[error("cannot write the recording: {0}")]
    Write(#[from] mcap::McapError),
    /// A definition, or a recording made from samples.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}
