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
    /// Greatest share by which squares of one, two or four pixels are darker or brighter: texture that a small scene lacks.
    pub texture: f32,
    /// Greatest factor on what a pixel has over its neighbours: pictures that are sharper than those of a small scene.
    pub sharpen: f32,
}

impl Default for Changes {
    fn default() -> Self {
        Self { gain: 0.15, balance: 0.05, gamma: 0.15, shift: 1, texture: 0.4, sharpen: 1.0 }
    }
}

impl Changes {
    /// None.
    pub fn none() -> Self {
        Self { gain: 0.0, balance: 0.0, gamma: 0.0, shift: 0, texture: 0.0, sharpen: 0.0 }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the first that means nothing.
    pub fn check(&self) -> Result<(), NavError> {
        for (what, x) in [
            ("gain", self.gain),
            ("balance", self.balance),
            ("gamma", self.gamma),
            ("texture", self.texture),
            ("sharpen", self.sharpen),
        ] {
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
            std::array::from_fn(|byte| shown(byte).round().clamp(0.0, 255.0) as u8)
        });
        let span = 2 * self.shift + 1;
        let shift = [0; 2].map(|_| random.below(span) as isize - self.shift as isize);
        // Half of the episodes keep their texture.
        let mut share = || random.between(-1.0, 1.0).max(0.0);
        let (texture, sharpen) = (self.texture * share(), self.sharpen * share());
        let square = 1 << random.below(3);
        Change { curves, shift, texture, square, sharpen, random: Xoshiro256PlusPlus::new(random.bits()) }
    }
}

/// Numbers for textures from each draw of 64 bits.
const NUMBERS: usize = 8;

/// The change of one episode.
#[derive(Debug, Clone)]
pub struct Change {
    /// What each byte of each colour becomes.
    curves: [[u8; 256]; 3],
    /// Rows down and columns to the right.
    shift: [isize; 2],
    texture: f32,
    /// Pixels of a square's side.
    square: usize,
    sharpen: f32,
    random: Xoshiro256PlusPlus,
}

impl Change {
    /// Adds a picture, changed, to `out`; at its edges, a shifted picture repeats its last pixels. Its texture is another one each time.
    pub fn add(&mut self, picture: &[u8], out: &mut Vec<u8>) {
        let first = out.len();
        out.resize(first + picture.len(), 0);
        self.put(picture, &mut out[first..]);
    }

    /// The same into a place of the picture's size.
    pub fn put(&mut self, picture: &[u8], out: &mut [u8]) {
        debug_assert_eq!(picture.len(), out.len());
        let height = picture.len() / (3 * WIDTH);
        for (y, row) in out.chunks_exact_mut(3 * WIDTH).enumerate() {
            let from = y.saturating_add_signed(-self.shift[0]).min(height - 1);
            let from = &picture[from * 3 * WIDTH..][..3 * WIDTH];
            for (x, to) in row.chunks_exact_mut(3).enumerate() {
                let at = 3 * x.saturating_add_signed(-self.shift[1]).min(WIDTH - 1);
                for ((to, curve), byte) in to.iter_mut().zip(&self.curves).zip(&from[at..at + 3]) {
                    *to = curve[usize::from(*byte)];
                }
            }
        }
        if self.sharpen > 0.05 {
            sharpen(out, self.sharpen);
        }
        if self.is_rough() {
            self.roughen(out);
        }
    }

    /// This change as it is for the next picture, of so many rows. Afterwards it is as if that picture had been changed, so that pictures of an
    /// episode can be changed at the same time.
    pub fn take_next(&mut self, height: usize) -> Self {
        let now = self.clone();
        if self.is_rough() {
            for _ in 0..height.div_ceil(self.square) * self.across().div_ceil(NUMBERS) {
                self.random.bits();
            }
        }
        now
    }

    fn is_rough(&self) -> bool {
        self.texture > 0.02
    }

    /// Squares in a row.
    fn across(&self) -> usize {
        WIDTH.div_ceil(self.square)
    }

    fn roughen(&mut self, picture: &mut [u8]) {
        let (mut factors, mut bits) = (vec![1.0; self.across()], 0);
        for (y, row) in picture.chunks_exact_mut(3 * WIDTH).enumerate() {
            if y % self.square == 0 {
                for (k, factor) in factors.iter_mut().enumerate() {
                    bits = if k % NUMBERS == 0 { self.random.bits() } else { bits >> 8 };
                    *factor = 1.0 + self.texture * ((bits & 0xff) as f32 / 127.5 - 1.0);
                }
            }
            for (square, factor) in row.chunks_mut(3 * self.square).zip(&factors) {
                square.iter_mut().for_each(|c| *c = (f32::from(*c) * factor).min(255.0) as u8);
            }
        }
    }
}

/// Adds to each pixel but those at the edges a share of its difference from the mean of its four neighbours.
fn sharpen(picture: &mut [u8], share: f32) {
    const ROW: usize = 3 * WIDTH;
    let before = picture.to_vec();
    for y in 1..(picture.len() / ROW).saturating_sub(1) {
        let [above, here, below] = [y - 1, y, y + 1].map(|y| &before[y * ROW..][..ROW]);
        let row = &mut picture[y * ROW..][..ROW];
        for k in 3..ROW - 3 {
            let around = [here[k - 3], here[k + 3], above[k], below[k]].map(f32::from).iter().sum::<f32>();
            let middle = f32::from(here[k]);
            row[k] = (middle + share * (middle - 0.25 * around) + 0.5).clamp(0.0, 255.0) as u8;
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
        let plain = Changes { shift: 0, texture: 0.0, sharpen: 0.0, ..Changes::default() };
        let mut change = Change { shift: [2, -3], ..plain.draw(&mut random) };
        let mut out = Vec::new();
        change.add(&picture, &mut out);
        assert_eq!(out.len(), picture.len());
        let bright: Vec<usize> = (0..WIDTH * HEIGHT).filter(|&p| out[3 * p] > out[0]).collect();
        assert_eq!(bright, [22 * WIDTH + 27]);
        assert!(out[0] != 100 || out[1] != 100, "the curve moves colours");
        let mut rough = Change { texture: 0.3, square: 2, sharpen: 1.0, ..Changes::none().draw(&mut random) };
        let (mut a, mut b) = (Vec::new(), Vec::new());
        rough.add(&picture, &mut a);
        rough.add(&picture, &mut b);
        assert!(a != b && a.len() == picture.len(), "another texture each time");
        for square in [1, 2, 4] {
            let mut one = Change { square, ..rough.clone() };
            let (mut other, mut out) = (one.clone(), vec![vec![0; picture.len()]; 4]);
            one.put(&picture, &mut out[0]);
            one.put(&picture, &mut out[1]);
            let mut first = other.take_next(HEIGHT);
            other.put(&picture, &mut out[3]);
            first.put(&picture, &mut out[2]);
            assert!(out[0] == out[2] && out[1] == out[3] && out[0] != out[1], "in any order");
        }
        assert!(a[..6].iter().all(|c| *c == a[0]) && a.iter().any(|c| *c < 80) && a.iter().any(|c| *c > 120));
        let at = 3 * (20 * WIDTH + 30);
        let mut sharp = Change { texture: 0.0, sharpen: 0.5, ..rough };
        let mut out = Vec::new();
        sharp.add(&picture, &mut out);
        assert_eq!((out[at], out[at - 3], out[0]), (250, 88, 100));
        assert!(Changes { gain: f32::NAN, ..Changes::default() }.check().unwrap_err().to_string().contains("gain"));
    }
}
