//! The camera model: what stands between what an eye draws and the bytes that a network sees.

use crate::NavError;
use crate::net::{HEIGHT, WIDTH};
use crate::sight::Rig;
use qv_core::random::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

/// How cameras differ from episode to episode. All are standard deviations about `middle`'s values unless they say otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LensSpread {
    /// Logarithm of the factor on shown colours, mean and deviation.
    pub gain: [f64; 2],
    /// Logarithm of the same of single colours.
    pub balance: f64,
    /// Logarithm of the exponent.
    pub gamma: f64,
    /// Added to shown colours.
    pub bias: f64,
    /// Noise of a pixel of the network's picture: least and greatest.
    pub noise: [f64; 2],
    /// Age of a picture when it is used: least and greatest \[s\], at most 0.3.
    pub delay: [f64; 2],
    /// Place of the camera \[m\].
    pub place: f64,
    /// Roll, pitch, yaw of the camera \[rad\].
    pub turn: f64,
    /// Logarithm of the focal length.
    pub focal: f64,
    /// Blur, deviation in pixels of the network's picture: least and greatest.
    pub blur: [f64; 2],
    /// Time that light is gathered \[s\], least and greatest: a camera that turns meanwhile smears along the turning.
    pub exposure: [f64; 2],
}

impl Default for LensSpread {
    fn default() -> Self {
        Self::none()
    }
}

impl LensSpread {
    /// A perfect camera.
    pub fn none() -> Self {
        Self {
            gain: [0.0; 2],
            balance: 0.0,
            gamma: 0.0,
            bias: 0.0,
            noise: [0.0; 2],
            delay: [0.0; 2],
            place: 0.0,
            turn: 0.0,
            focal: 0.0,
            blur: [0.0; 2],
            exposure: [0.0; 2],
        }
    }

    /// Wide ranges, for when nothing was measured.
    pub fn wide() -> Self {
        Self {
            gain: [0.0, 0.2],
            balance: 0.04,
            gamma: 0.1,
            bias: 0.02,
            noise: [0.0, 0.016],
            delay: [0.02, 0.14],
            place: 0.01,
            turn: 0.03,
            focal: 0.03,
            blur: [0.0, 0.8],
            exposure: [0.0, 0.015],
        }
    }

    /// Wider ones, for many places: cameras and light differ more than in one.
    pub fn of_many_places() -> Self {
        Self {
            gain: [0.0, 0.3],
            balance: 0.07,
            gamma: 0.15,
            bias: 0.03,
            noise: [0.0, 0.03],
            place: 0.02,
            turn: 0.04,
            focal: 0.05,
            blur: [0.0, 1.1],
            ..Self::wide()
        }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the first that means nothing.
    pub fn check(&self) -> Result<(), NavError> {
        let lists: [(&str, &[f64]); 6] = [
            ("exposure", &self.exposure),
            ("gain", &self.gain[1..]),
            ("noise", &self.noise),
            ("delay", &self.delay),
            ("blur", &self.blur),
            ("deviations", &[self.balance, self.gamma, self.bias, self.place, self.turn, self.focal]),
        ];
        for (what, numbers) in lists {
            let most = if ["delay", "exposure"].contains(&what) { 0.3 } else { 10.0 };
            if let Some(bad) = numbers.iter().find(|x| !(0.0..=most).contains(*x)) {
                return Err(NavError::value(&format!("camera, {what}"), &format!("0 to {most}"), bad));
            }
        }
        if !(-3.0..=3.0).contains(&self.gain[0]) {
            return Err(NavError::value("camera, gain", "-3 to 3", self.gain[0]));
        }
        Ok(())
    }

    /// One camera.
    pub fn draw(&self, rig: &Rig, seed: u64) -> Lens {
        let mut random = Xoshiro256PlusPlus::of(seed, 85, 0);
        let gain = self.gain[0] + self.gain[1] * f64::from(random.normal());
        let mut normal = |deviation: f64| deviation * f64::from(random.normal());
        let balance = [0; 3].map(|_| (gain + normal(self.balance)).exp());
        let gamma = normal(self.gamma).exp();
        let bias = normal(self.bias);
        let place = rig.place.map(|x| x + normal(self.place));
        let turn = rig.turn.map(|x| x + normal(self.turn));
        let focal = rig.focal * normal(self.focal).exp();
        let mut between = |[low, high]: [f64; 2]| f64::from(random.between(low as f32, high as f32));
        let (noise, delay, blur) = (between(self.noise), between(self.delay), between(self.blur));
        // Drawn last: what was drawn before it stays what it was.
        let exposure = between(self.exposure);
        let curve = Box::new(balance.map(|balance| curve(balance, gamma, bias)));
        Lens { rig: Rig { place, turn, focal, ..*rig }, curve, noise, delay, blur, exposure, random }
    }
}

/// The camera of one episode.
#[derive(Debug, Clone)]
pub struct Lens {
    /// How it sits.
    pub rig: Rig,
    /// That of red, green and blue.
    curve: Box<[[f32; STEPS + 1]; 3]>,
    noise: f64,
    /// Age of its pictures \[s\].
    pub delay: f64,
    blur: f64,
    exposure: f64,
    random: Xoshiro256PlusPlus,
}

impl Lens {
    /// Bytes of a picture of 0 to 1 that was taken while the base turned with `gyro` (base axes \[rad/s\]).
    pub fn bytes(&mut self, picture: &[f32], gyro: [f64; 3]) -> Vec<u8> {
        let variances = self.variances(gyro);
        let is_sharp = variances.iter().all(|x| *x < 0.0025);
        let blurred = if is_sharp { None } else { Some(blur(picture, variances)) };
        let picture = blurred.as_deref().unwrap_or(picture);
        let noise = (255.0 * self.noise) as f32;
        let mut out = vec![0; picture.len()];
        for (shown, pixel) in out.chunks_exact_mut(3).zip(picture.chunks_exact(3)) {
            for ((shown, x), row) in shown.iter_mut().zip(pixel).zip(self.curve.iter()) {
                let at = x.clamp(0.0, 1.0) * STEPS as f32;
                let below = (at as usize).min(STEPS - 1);
                let sharp = row[below] + (at - below as f32) * (row[below + 1] - row[below]);
                let noisy = if noise > 0.0 { sharp + noise * about_normal(&mut self.random) } else { sharp };
                *shown = (noisy + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
        out
    }

    /// Variance of the blur along rows and along columns \[px²\]: that of the lens, and that of an even smear over the way of a pixel. About the
    /// vertical all moves along rows, about the axis to the left along columns; a roll moves the middle nowhere.
    fn variances(&self, [_, nod, turning]: [f64; 3]) -> [f64; 2] {
        let focal = self.rig.focal * WIDTH as f64 / 640.0;
        [turning, nod].map(|rate| self.blur * self.blur + (focal * rate * self.exposure).powi(2) / 12.0)
    }
}

/// Steps of a lens' curve.
const STEPS: usize = 255;

/// What values in steps of 0 to 1 are shown as, 0 to 255 without noise: powers are dear.
fn curve(balance: f64, gamma: f64, bias: f64) -> [f32; STEPS + 1] {
    let shown = |k: usize| (k as f64 / STEPS as f64).powf(gamma) * balance + bias;
    std::array::from_fn(|k| (255.0 * shown(k)) as f32)
}

/// A number of mean 0 and deviation 1, of four uniform ones (Irwin and Hall): a pixel's noise needs no tails.
fn about_normal(random: &mut Xoshiro256PlusPlus) -> f32 {
    let bits = random.bits();
    let sum: u64 = (0..4).map(|k| bits >> (16 * k) & 0xffff).sum();
    // Each has a variance of 65536^2 / 12.
    (sum as f32 - 131_070.0) * (1.732_050_8 / 65_536.0)
}

/// Three taps along rows and along columns, whose variances are as stated \[px²\] as far as three taps can have them. The outermost pixels go on
/// beyond the edges.
fn blur(picture: &[f32], variances: [f64; 2]) -> Vec<f32> {
    let [across, down] = variances.map(|variance| (0.5 * variance).min(1.0 / 3.0) as f32);
    let mixed = |side: f32, before: f32, x: f32, after: f32| x + side * (before + after - 2.0 * x);
    let long = 3 * WIDTH;
    let mut rows = vec![0.0; picture.len()];
    for (out, row) in rows.chunks_exact_mut(long).zip(picture.chunks_exact(long)) {
        for k in 0..3 {
            out[k] = mixed(across, row[k], row[k], row[k + 3]);
            out[long - 3 + k] = mixed(across, row[long - 6 + k], row[long - 3 + k], row[long - 3 + k]);
        }
        let inner = row.iter().zip(&row[3..]).zip(&row[6..]);
        out[3..]
            .iter_mut()
            .zip(inner)
            .for_each(|(out, ((before, x), after))| *out = mixed(across, *before, *x, *after));
    }
    let row = |y: usize| &rows[y * long..][..long];
    let mut out = Vec::with_capacity(picture.len());
    for y in 0..HEIGHT {
        let around = row(y.saturating_sub(1)).iter().zip(row(y)).zip(row((y + 1).min(HEIGHT - 1)));
        out.extend(around.map(|((before, x), after)| mixed(down, *before, *x, *after)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_perfect_camera_changes_nothing() {
        let picture: Vec<f32> = (0..WIDTH * HEIGHT * 3).map(|k| (k % 256) as f32 / 255.0).collect();
        let mut lens = LensSpread::none().draw(&Rig::default(), 3);
        let bytes = lens.bytes(&picture, [1.0; 3]);
        assert!(bytes.iter().enumerate().all(|(k, &b)| usize::from(b) == k % 256));
        assert_eq!((lens.rig, lens.delay), (Rig::default(), 0.0));
    }

    #[test]
    fn noise_has_its_deviation() {
        let mut lens = LensSpread { noise: [0.016, 0.016], ..LensSpread::none() }.draw(&Rig::default(), 3);
        let bytes = lens.bytes(&[0.5; WIDTH * HEIGHT * 3], [0.0; 3]);
        let count = bytes.len() as f64;
        let mean = bytes.iter().map(|&b| f64::from(b)).sum::<f64>() / count;
        let deviation = (bytes.iter().map(|&b| (f64::from(b) - mean).powi(2)).sum::<f64>() / count).sqrt();
        // Rounding to bytes adds a variance of 1/12.
        let expected = ((0.016f64 * 255.0).powi(2) + 1.0 / 12.0).sqrt();
        assert!((mean - 127.5).abs() < 0.2 && (deviation / expected - 1.0).abs() < 0.02, "{mean} {deviation}");
    }

    #[test]
    fn turning_smears_along_rows() {
        let mut lens = LensSpread { exposure: [0.015; 2], ..LensSpread::none() }.draw(&Rig::default(), 3);
        let mut dot = vec![0.0; WIDTH * HEIGHT * 3];
        let (at, row) = (3 * (20 * WIDTH + 30), 3 * WIDTH);
        dot[at] = 1.0;
        let still = lens.bytes(&dot, [0.0; 3]);
        let turning = lens.bytes(&dot, [0.0, 0.0, 1.0]);
        let nodding = lens.bytes(&dot, [0.0, -1.0, 0.0]);
        // 76.9 px/rad * 1 rad/s * 15 ms = 1.15 px, whose even smear has a variance of 0.11 px²: a side has half of it.
        assert_eq!((still[at], still[at + 3]), (255, 0));
        assert_eq!((turning[at - 3], turning[at + 3], turning[at + row]), (14, 14, 0));
        assert_eq!((nodding[at - row], nodding[at + row], nodding[at + 3]), (14, 14, 0));
    }

    /// Each number as the formula has it, one after the other.
    #[test]
    fn a_blur_mixes_neighbours_and_repeats_the_edges() {
        let mut random = Xoshiro256PlusPlus::new(2);
        let picture: Vec<f32> = (0..WIDTH * HEIGHT * 3).map(|_| random.unit()).collect();
        let plain = |from: &[f32], step: usize, count: usize, variance: f64| -> Vec<f32> {
            let side = (0.5 * variance).min(1.0 / 3.0) as f32;
            let at = |k: usize| k / step % count;
            let before = |k: usize| from[if at(k) > 0 { k - step } else { k }];
            let after = |k: usize| from[if at(k) + 1 < count { k + step } else { k }];
            (0..from.len()).map(|k| from[k] + side * (before(k) + after(k) - 2.0 * from[k])).collect()
        };
        let expected = plain(&plain(&picture, 3, WIDTH, 0.3), 3 * WIDTH, HEIGHT, 0.1);
        assert!(blur(&picture, [0.3, 0.1]) == expected);
    }

    #[test]
    fn wide_cameras_differ_and_a_blur_keeps_the_sum() {
        let spread = LensSpread::wide();
        spread.check().unwrap();
        let (a, b) = (spread.draw(&Rig::default(), 1), spread.draw(&Rig::default(), 2));
        assert!(a.rig != b.rig && a.delay != b.delay && (0.02..=0.14).contains(&a.delay));
        let mut dot = vec![0.0; WIDTH * HEIGHT * 3];
        dot[3 * (20 * WIDTH + 30)] = 1.0;
        let out = blur(&dot, [0.36; 2]);
        assert!((out.iter().sum::<f32>() - 1.0).abs() < 1e-6 && out[3 * (20 * WIDTH + 30)] < 0.5);
        assert!(LensSpread { delay: [0.0, 9.0], ..spread }.check().unwrap_err().to_string().contains("delay"));
    }
}
