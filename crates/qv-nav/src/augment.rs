//! Changes of pictures that leave the right answer as it is: drawn anew each time that an episode is learnt from, so that a network does not learn
//! the camera of an episode by heart.

use crate::NavError;
use crate::net::WIDTH;
use qv_core::random::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

/// How much pictures are changed: deviations, and the greatest shift.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Changes {
    /// Logarithm of the factor on shown colours.
    pub gain: f32,
    /// Logarithm of the same of single colours.
    pub balance: f32,
    /// Logarithm of the exponent.
    pub gamma: f32,
    /// Greatest shift along rows and columns, in pixels of the network's picture.
    pub shift: usize,
}

impl Default for Changes {
    fn default() -> Self {
        Self { gain: 0.15, balance: 0.05, gamma: 0.15, shift: 1 }
    }
}

impl Changes {
    /// None.
    pub fn none() -> Self {
        Self { gain: 0.0, balance: 0.0, gamma: 0.0, shift: 0 }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the first that means nothing.
    pub fn check(&self) -> Result<(), NavError> {
        for (what, x) in [("gain", self.gain), ("balance", self.balance), ("gamma", self.gamma)] {
            if !(0.0..=2.0).contains(&x) {
                return Err(NavError::value(&format!("changes, {what}"), "0 to 2", x));
            }
        }
        if self.shift > 8 {
            return Err(NavError::value("changes, shift", "0 to 8 pixels", self.shift));
        }
        Ok(())
    }

    /// That of one episode.
    pub fn draw(&self, random: &mut Xoshiro256PlusPlus) -> Change {
        let gain = self.gain * random.normal();
        let gamma = (self.gamma * random.normal()).exp();
        let curves = [0; 3].map(|_| {
            let factor = (gain + self.balance * random.normal()).exp();
            let shown = |byte: usize| 255.0 * factor * (byte as f32 / 255.0).powf(gamma);
            (0..256).map(|byte| shown(byte).round().clamp(0.0, 255.0) as u8).collect()
        });
        let span = 2 * self.shift + 1;
        let shift = [0; 2].map(|_| random.below(span) as isize - self.shift as isize);
        Change { curves, shift }
    }
}

/// The change of one episode.
#[derive(Debug, Clone)]
pub struct Change {
    /// What each byte of each colour becomes.
    curves: [Vec<u8>; 3],
    /// Rows down and columns to the right.
    shift: [isize; 2],
}

impl Change {
    /// Adds a picture, changed, to `out`; at its edges, a shifted picture repeats its last pixels.
    pub fn add(&self, picture: &[u8], out: &mut Vec<u8>) {
        let height = picture.len() / (3 * WIDTH);
        for y in 0..height {
            let from = y.saturating_add_signed(-self.shift[0]).min(height - 1) * WIDTH;
            for x in 0..WIDTH {
                let at = 3 * (from + x.saturating_add_signed(-self.shift[1]).min(WIDTH - 1));
                out.extend([0, 1, 2].map(|k| self.curves[k][usize::from(picture[at + k])]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::HEIGHT;

    #[test]
    fn pictures_are_shifted_and_shown_otherwise() {
        let mut picture = vec![100; WIDTH * HEIGHT * 3];
        picture[3 * (20 * WIDTH + 30)..][..3].fill(200);
        let mut random = Xoshiro256PlusPlus::new(5);
        let mut same = Vec::new();
        Changes::none().draw(&mut random).add(&picture, &mut same);
        assert_eq!(same, picture);
        let change = Change { shift: [2, -3], ..Changes { shift: 0, ..Changes::default() }.draw(&mut random) };
        let mut out = Vec::new();
        change.add(&picture, &mut out);
        assert_eq!(out.len(), picture.len());
        let bright: Vec<usize> = (0..WIDTH * HEIGHT).filter(|&p| out[3 * p] > out[0]).collect();
        assert_eq!(bright, [22 * WIDTH + 27]);
        assert!(out[0] != 100 || out[1] != 100, "the curve moves colours");
        assert!(Changes { gain: f32::NAN, ..Changes::default() }.check().unwrap_err().to_string().contains("gain"));
    }
}
