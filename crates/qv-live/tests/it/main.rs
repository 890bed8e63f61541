//! Samples as a robot sends them, recorded and read again; and with the feature `dds` from a peer of another make.

#[cfg(feature = "dds")]
mod peer;
mod recorded;
#[cfg(feature = "dds")]
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
