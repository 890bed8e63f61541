//! Little-endian numbers from bytes, with the place in every error.

use crate::SplatError;

/// A place in bytes that are read from front to back.
#[derive(Debug, Clone)]
pub struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    /// What is being read, for errors.
    place: &'a str,
}

impl<'a> Cursor<'a> {
    /// At the front.
    pub fn new(bytes: &'a [u8], place: &'a str) -> Self {
        Self { bytes, at: 0, place }
    }

    /// Index of the next byte.
    pub fn at(&self) -> usize {
        self.at
    }

    /// Bytes that are left.
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// The next bytes.
    ///
    /// # Errors
    /// There are not so many; says how many and where.
    pub fn take(&mut self, count: u64, what: &str) -> Result<&'a [u8], SplatError> {
        if count > self.left() as u64 {
            let place = format!("{}, {what}", self.place);
            return Err(SplatError::CutOff { place, byte: self.at as u64, expected: count, found: self.left() as u64 });
        }
        let taken = &self.bytes[self.at..self.at + count as usize];
        self.at += count as usize;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], SplatError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N as u64, what)?);
        Ok(out)
    }

    /// An unsigned byte.
    ///
    /// # Errors
    /// As [`Self::take`]; so are those below.
    pub fn u8(&mut self, what: &str) -> Result<u8, SplatError> {
        Ok(self.array::<1>(what)?[0])
    }

    /// Four bytes, unsigned.
    pub fn u32(&mut self, what: &str) -> Result<u32, SplatError> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    /// Eight bytes, unsigned.
    pub fn u64(&mut self, what: &str) -> Result<u64, SplatError> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    /// Eight bytes, a floating-point number.
    pub fn f64(&mut self, what: &str) -> Result<f64, SplatError> {
        Ok(f64::from_le_bytes(self.array(what)?))
    }
}

/// Four bytes of a slice that is known to hold them.
pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Four bytes of a slice that is known to hold them, as a floating-point number.
pub fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}
