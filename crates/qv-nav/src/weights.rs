//! The numbers of a network as a file: a line that says what it is, then little-endian f32.

use crate::NavError;
use crate::net::Net;

const MAGIC: &[u8] = b"quadverse navigation weights 1\n";

/// The file of a network's numbers.
pub fn to_bytes(parameters: &[f32]) -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    parameters.iter().for_each(|x| out.extend(x.to_le_bytes()));
    out
}

/// The numbers of a file, for `net`.
///
/// # Errors
/// When it is no such file, is of another length, or holds a number that is not finite.
pub fn from_bytes(bytes: &[u8], net: &Net) -> Result<Vec<f32>, NavError> {
    let Some(body) = bytes.strip_prefix(MAGIC) else {
        return Err(NavError::value("weights", "a file of `qv navigate train`", "another beginning"));
    };
    if body.len() != 4 * net.len() {
        return Err(NavError::value("weights", &format!("{} bytes of numbers", 4 * net.len()), body.len()));
    }
    let numbers: Vec<f32> = body.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(at) => Err(NavError::value(&format!("number {at} of the weights"), "a finite number", numbers[at])),
        None => Ok(numbers),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_back_and_bad_ones_are_named() {
        let net = Net::of_size(20, 28);
        let numbers: Vec<f32> = (0..net.len()).map(|k| k as f32 * 0.5).collect();
        let bytes = to_bytes(&numbers);
        assert_eq!(from_bytes(&bytes, &net).unwrap(), numbers);
        for bad in [&b"else"[..], &bytes[..bytes.len() - 1], &to_bytes(&vec![f32::NAN; net.len()])] {
            assert!(from_bytes(bad, &net).unwrap_err().to_string().contains("weights"));
        }
    }
}
