//! The numbers of a network as a file: a line that says what it is, then little-endian f32.

use crate::NavError;
use crate::net::Net;
use serde::{Deserialize, Serialize};

const MAGIC: &[u8] = b"quadverse navigation weights 1\n";
/// The same for a network that is commanded by the goal's colour.
const MAGIC_COLOUR: &[u8] = b"quadverse navigation weights 1, goals by colour\n";

/// How a network is commanded which goal is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GoalInput {
    /// By one of three names, see [`crate::sight::COLOURS`].
    Name,
    /// By any colour: hues of its pictures are turned, see [`crate::goals::turn_hues`].
    Colour,
}

/// The file of a network's numbers.
pub fn to_bytes(parameters: &[f32]) -> Vec<u8> {
    to_bytes_for(parameters, GoalInput::Name)
}

/// The same of a network that is commanded in some way.
pub fn to_bytes_for(parameters: &[f32], input: GoalInput) -> Vec<u8> {
    let magic = match input {
        GoalInput::Name => MAGIC,
        GoalInput::Colour => MAGIC_COLOUR,
    };
    let mut out = magic.to_vec();
    parameters.iter().for_each(|x| out.extend(x.to_le_bytes()));
    out
}

/// The numbers of a file, for `net`, which is commanded by names.
///
/// # Errors
/// When it is no such file, is of another length, or holds a number that is not finite.
pub fn from_bytes(bytes: &[u8], net: &Net) -> Result<Vec<f32>, NavError> {
    match read(bytes, net)? {
        (numbers, GoalInput::Name) => Ok(numbers),
        (_, GoalInput::Colour) => {
            Err(NavError::value("weights", "a network whose goals have names", "one whose goals are colours"))
        }
    }
}

/// The numbers of a file, for `net`, and how it is commanded.
///
/// # Errors
/// When it is no such file, is of another length, or holds a number that is not finite.
pub fn read(bytes: &[u8], net: &Net) -> Result<(Vec<f32>, GoalInput), NavError> {
    let named = bytes.strip_prefix(MAGIC).map(|body| (body, GoalInput::Name));
    let Some((body, input)) = named.or_else(|| bytes.strip_prefix(MAGIC_COLOUR).map(|b| (b, GoalInput::Colour))) else {
        return Err(NavError::value("weights", "a file of `qv navigate train`", "another beginning"));
    };
    if body.len() != 4 * net.len() {
        return Err(NavError::value("weights", &format!("{} bytes of numbers", 4 * net.len()), body.len()));
    }
    let numbers: Vec<f32> = body.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(at) => Err(NavError::value(&format!("number {at} of the weights"), "a finite number", numbers[at])),
        None => Ok((numbers, input)),
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
        let coloured = to_bytes_for(&numbers, GoalInput::Colour);
        assert_eq!(read(&coloured, &net).unwrap(), (numbers, GoalInput::Colour));
        assert!(from_bytes(&coloured, &net).unwrap_err().to_string().contains("colours"));
        for bad in [&b"else"[..], &bytes[..bytes.len() - 1], &to_bytes(&vec![f32::NAN; net.len()])] {
            assert!(from_bytes(bad, &net).unwrap_err().to_string().contains("weights"));
        }
    }
}
