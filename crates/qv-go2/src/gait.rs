//! Open-loop motions in joint space, each a closed formula of time: target angles \[rad\] in joint order at time `t`
//! \[s\] after the start, at which every motion is at the stand and at rest.
//!
//! The same formulas are in `fixtures/mujoco/motions.py`, so that another engine can be given the same commands.

use crate::model::STAND;
use std::f64::consts::TAU;

/// Smooth rise from 0 at `t = 0` to 1 at `t = length` \[s\], flat at both ends.
fn smooth_ramp(t: f64, length: f64) -> f64 {
    let u = (t / length).clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

/// A trot: diagonal legs move together, each swinging forward while it is bent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trot {
    /// Strides per second \[Hz\].
    pub frequency: f64,
    /// Time from standing still to full amplitude \[s\].
    pub ramp: f64,
    /// Amplitude of the thigh's swing \[rad\].
    pub swing: f64,
    /// Amplitude of the knee's bend \[rad\].
    pub lift: f64,
    /// How much the bend trails the swing \[rad of phase\].
    pub lift_delay: f64,
    /// Start of each leg in the stride, 0..1, in leg order.
    pub phases: [f64; 4],
}

impl Default for Trot {
    /// 2 Hz; walks at about 0.17 m/s on friction 0.8 with gains 40 / 1.
    fn default() -> Self {
        Self { frequency: 2.0, ramp: 0.5, swing: 0.2, lift: 0.6, lift_delay: 0.4, phases: [0.0, 0.5, 0.5, 0.0] }
    }
}

impl Trot {
    /// Target angles \[rad\] at time `t` \[s\].
    pub fn target(&self, t: f64) -> [f64; 12] {
        let ramp = smooth_ramp(t, self.ramp);
        let mut target = STAND;
        for leg in 0..4 {
            let phase = TAU * (self.frequency * t + self.phases[leg]);
            let bend = self.lift * (phase - self.lift_delay).sin().max(0.0).powi(2);
            target[3 * leg + 1] += ramp * (self.swing * phase.cos() + 0.5 * bend);
            target[3 * leg + 2] -= ramp * bend;
        }
        target
    }
}

/// A sine of linearly rising frequency on every joint about the stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chirp {
    /// Frequency at the start \[Hz\].
    pub start: f64,
    /// Frequency at the end \[Hz\].
    pub end: f64,
    /// Length of the sweep \[s\].
    pub duration: f64,
    /// Time to full amplitude \[s\].
    pub ramp: f64,
    /// Amplitude \[rad\].
    pub amplitude: f64,
    /// Phase of each joint after the one before it \[rad\].
    pub phase_step: f64,
}

impl Default for Chirp {
    /// 0.5 to 8 Hz in 8 s, 0.2 rad.
    fn default() -> Self {
        Self { start: 0.5, end: 8.0, duration: 8.0, ramp: 0.5, amplitude: 0.2, phase_step: 0.5 }
    }
}

impl Chirp {
    /// Target angles \[rad\] at time `t` \[s\].
    pub fn target(&self, t: f64) -> [f64; 12] {
        let ramp = smooth_ramp(t, self.ramp);
        let phase = TAU * (self.start * t + 0.5 * (self.end - self.start) / self.duration * t * t);
        std::array::from_fn(|joint| {
            STAND[joint] + ramp * self.amplitude * (phase + self.phase_step * joint as f64).sin()
        })
    }
}

/// Knee bends: all legs shorten and lengthen together, each foot moving along the line to its thigh's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Squat {
    /// Squats per second \[Hz\].
    pub frequency: f64,
    /// Largest bend of the knee beyond the stand \[rad\].
    pub depth: f64,
}

impl Default for Squat {
    /// 0.5 Hz, 0.5 rad.
    fn default() -> Self {
        Self { frequency: 0.5, depth: 0.5 }
    }
}

impl Squat {
    /// Target angles \[rad\] at time `t` \[s\].
    pub fn target(&self, t: f64) -> [f64; 12] {
        let bend = 0.5 * self.depth * (1.0 - (TAU * self.frequency * t).cos());
        let mut target = STAND;
        for leg in 0..4 {
            // Thigh and calf are equally long: half the knee's bend at the thigh keeps the leg's direction.
            target[3 * leg + 1] += 0.5 * bend;
            target[3 * leg + 2] -= bend;
        }
        target
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::foot_positions;

    #[test]
    fn motions_start_at_the_stand() {
        assert_eq!(Trot::default().target(0.0), STAND);
        assert_eq!(Chirp::default().target(0.0), STAND);
        assert_eq!(Squat::default().target(0.0), STAND);
    }

    #[test]
    fn trot_repeats_and_moves_diagonals_together() {
        let trot = Trot::default();
        for step in 0..100 {
            let t = 0.6 + 0.01 * f64::from(step);
            let (now, next) = (trot.target(t), trot.target(t + 0.5));
            for joint in 0..12 {
                assert!((now[joint] - next[joint]).abs() < 1e-12);
            }
            let offset = |leg: usize| now[3 * leg + 2] - STAND[3 * leg + 2];
            assert!((offset(0) - offset(3)).abs() < 1e-12 && (offset(1) - offset(2)).abs() < 1e-12);
            assert!(offset(0) == 0.0 || offset(1) == 0.0, "both diagonals in the air at {t}");
        }
    }

    #[test]
    fn a_trotting_foot_lifts_and_comes_forward() {
        let trot = Trot::default();
        let feet: Vec<_> = (0..500).map(|i| foot_positions(&trot.target(1.0 + 0.001 * f64::from(i)))[0]).collect();
        let highest = feet.iter().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
        let lowest = feet.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        assert!(highest.z - lowest > 0.03);
        let top = feet.iter().position(|p| p == highest).unwrap();
        assert!(feet[(top + 20) % 500].x > feet[(top + 480) % 500].x, "the highest foot moves forward");
    }

    #[test]
    fn chirp_reaches_its_end_frequency() {
        let chirp = Chirp::default();
        let zero_crossings = |from: f64| {
            let value = |i: usize| chirp.target(from + 0.5 * i as f64 / 1000.0)[0] - STAND[0];
            (0..1000).filter(|&i| (value(i) > 0.0) != (value(i + 1) > 0.0)).count()
        };
        // Half a second: frequency 7.53..8 Hz crosses zero 7.8 times, 0.97..1.44 Hz once.
        assert!((7..=8).contains(&zero_crossings(7.5)), "{}", zero_crossings(7.5));
        assert!((1..=2).contains(&zero_crossings(0.5)), "{}", zero_crossings(0.5));
    }

    #[test]
    fn a_squat_goes_down() {
        let (stand, low) = (foot_positions(&STAND), foot_positions(&Squat::default().target(1.0)));
        for leg in 0..4 {
            assert!(low[leg].z - stand[leg].z > 0.04);
            assert!((low[leg].x - stand[leg].x).abs() < 0.03);
        }
    }
}
