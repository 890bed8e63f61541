//! How much the packed bytes of a recording may unpack to. A small file must not ask for all memory, or for hours.

use std::cell::Cell;
use std::io::{Error, Read, Result};
use std::rc::Rc;

/// Bytes that any file may unpack to.
const ANY: u64 = 32 << 20;
/// Unpacked bytes for each packed one. Recordings of robots have 2 to 20.
const RATIO: u64 = 100;
/// Bytes of definitions of message types in one file, counted anew for each topic that has them.
const DEFINITIONS: u64 = 64 << 20;

/// Counts the bytes of a file, and what they unpack to; clones count together.
#[derive(Debug, Default, Clone)]
pub(crate) struct Bounds(Rc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    packed: Cell<u64>,
    unpacked: Cell<u64>,
    definitions: Cell<u64>,
}

impl Bounds {
    /// Of a file of so many bytes, which are all there.
    #[cfg(feature = "parquet")]
    pub fn of(packed: usize) -> Self {
        let bounds = Self::default();
        bounds.0.packed.set(packed as u64);
        bounds
    }

    /// The source of a file, whose bytes are counted.
    pub fn count<R: Read>(&self, source: R) -> PackedReader<R> {
        PackedReader { source, bounds: self.clone() }
    }

    /// What a decoder makes of packed bytes, counted and ended with an error where it is too much.
    pub fn limit<R: Read>(&self, decoder: R) -> UnpackedReader<R> {
        UnpackedReader { decoder, bounds: self.clone() }
    }

    /// Bytes that may still come out of what was read so far.
    fn left(&self) -> u64 {
        (ANY + RATIO.saturating_mul(self.0.packed.get())).saturating_sub(self.0.unpacked.get())
    }

    /// Takes `bytes` that a part of the file claims to unpack to.
    ///
    /// # Errors
    /// Says how many were expected at most.
    pub fn take(&self, bytes: u64) -> std::result::Result<(), String> {
        let left = self.left();
        self.0.unpacked.set(self.0.unpacked.get().saturating_add(bytes));
        if bytes <= left {
            return Ok(());
        }
        let packed = self.0.packed.get();
        Err(format!("expected at most {RATIO} unpacked bytes for each of {packed} packed ones, found more"))
    }

    /// Takes the definition of one topic's messages; false where there were too many bytes of them.
    pub fn define(&self, bytes: usize) -> bool {
        self.0.definitions.set(self.0.definitions.get().saturating_add(bytes as u64));
        self.0.definitions.get() <= DEFINITIONS
    }
}

/// A reader that counts packed bytes.
pub(crate) struct PackedReader<R> {
    source: R,
    bounds: Bounds,
}

impl<R: Read> Read for PackedReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let n = self.source.read(buffer)?;
        let packed = &self.bounds.0.packed;
        packed.set(packed.get() + n as u64);
        Ok(n)
    }
}

/// A reader that counts unpacked bytes.
pub(crate) struct UnpackedReader<R> {
    decoder: R,
    bounds: Bounds,
}

impl<R: Read> Read for UnpackedReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let n = self.decoder.read(buffer)?;
        self.bounds.take(n as u64).map_err(Error::other)?;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unpacked_bytes_are_bounded_by_packed_ones() {
        let bounds = Bounds::default();
        assert!(bounds.take(ANY).is_ok() && bounds.take(1).is_err());
        let bounds = Bounds::default();
        bounds.count(&[0u8; 1000][..]).read_to_end(&mut Vec::new()).unwrap();
        assert!(bounds.take(ANY + 1000 * RATIO).is_ok() && bounds.take(1).is_err());
        let bounds = Bounds::default();
        let mut out = Vec::new();
        assert!(bounds.limit(std::io::repeat(0)).read_to_end(&mut out).is_err());
        assert!(out.len() as u64 <= ANY);
        assert!(bounds.define(DEFINITIONS as usize) && !bounds.define(1));
    }
}
