//! Motions of several sections, each from the stand and back to it.

use qv_core::random::SplitMix64;
use qv_go2::gait::{Chirp, Squat, Trot};
use qv_go2::model::STAND;
use std::f64::consts::TAU;

/// A standing robot settles this long before its recording starts \[s\].
pub const SETTLING: f64 = 1.0;

/// One part of a motion; figures in its own terms, time from its own start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Section {
    /// Stands still.
    Stand,
    /// Knee bends.
    Squat(Squat),
    /// The trunk swings sideways over the feet: `amplitude` of the hips \[rad\] at `frequency` \[Hz\].
    Sway {
        /// Hz
        frequency: f64,
        /// rad
        amplitude: f64,
    },
    /// The trunk pitches: front knees bend while rear ones stretch, by `amplitude` \[rad\] at `frequency` \[Hz\].
    Lean {
        /// Hz
        frequency: f64,
        /// rad
        amplitude: f64,
    },
    /// Small sines of rising frequency on every joint, feet on the ground.
    Chirp(Chirp),
    /// Walks; a positive `turn` gives the right legs the longer swing, and turns left.
    Trot {
        /// The gait of a straight walk.
        gait: Trot,
        /// Share by which the swing of the right legs is longer and of the left ones shorter.
        turn: f64,
    },
}

/// Time in which a section grows out of the stand, and fades into it \[s\].
const BLEND: f64 = 0.4;

fn smooth(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

impl Section {
    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Stand => "stand",
            Self::Squat(_) => "squat",
            Self::Sway { .. } => "sway",
            Self::Lean { .. } => "lean",
            Self::Chirp(_) => "chirp",
            Self::Trot { .. } => "trot",
        }
    }

    /// Target angles \[rad\] at `t` \[s\] of its own time, not yet faded.
    fn target(&self, t: f64) -> [f64; 12] {
        match self {
            Self::Stand => STAND,
            Self::Squat(squat) => squat.target(t),
            Self::Chirp(chirp) => chirp.target(t),
            Self::Sway { frequency, amplitude } => {
                let lean = amplitude * (TAU * frequency * t).sin();
                std::array::from_fn(|j| STAND[j] + if j % 3 == 0 { lean } else { 0.0 })
            }
            Self::Lean { frequency, amplitude } => {
                let bend = amplitude * (TAU * frequency * t).sin();
                let front_and_rear = |j: usize| if j < 6 { bend } else { -bend };
                std::array::from_fn(|j| match j % 3 {
                    0 => STAND[j],
                    // Half the knee's bend at the thigh keeps the leg's direction.
                    1 => STAND[j] + 0.5 * front_and_rear(j),
                    _ => STAND[j] - front_and_rear(j),
                })
            }
            Self::Trot { gait, turn } => {
                let side = |sign: f64| Trot { swing: gait.swing * (1.0 + sign * turn), ..*gait }.target(t);
                let (left, right) = (side(-1.0), side(1.0));
                std::array::from_fn(|j| if (j / 3) % 2 == 0 { left[j] } else { right[j] })
            }
        }
    }
}

/// What a robot does in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Motion {
    /// Everything: it stands, squats, sways or leans, chirps, and walks.
    Mixed,
    /// It walks, in one or two gaits.
    Trot,
    /// It turns on the spot, nearly.
    Spin,
    /// It walks under a restless stick: another speed and turn every one to three seconds.
    Stick,
    /// Knee bends of several depths.
    Squat,
    /// It sways and leans over its feet.
    Sway,
    /// It stands still.
    Stand,
}

impl Motion {
    /// All, in a fixed order.
    pub const ALL: [Self; 7] = [Self::Mixed, Self::Trot, Self::Spin, Self::Stick, Self::Squat, Self::Sway, Self::Stand];

    /// Whether an effect, or one that no library has, can show in it: limits of speed need joints that swing, a tether needs a robot that
    /// leaves.
    pub fn shows(self, effect: &str) -> bool {
        match effect {
            "torque_speed_limit" => matches!(self, Self::Mixed | Self::Trot | Self::Stick | Self::Spin),
            "tether" => matches!(self, Self::Mixed | Self::Trot | Self::Stick),
            _ => true,
        }
    }

    /// Name in answers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mixed => "mixed",
            Self::Trot => "trot",
            Self::Spin => "spin",
            Self::Stick => "stick",
            Self::Squat => "squat",
            Self::Sway => "sway",
            Self::Stand => "stand",
        }
    }
}

/// Sections one after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Each with its length \[s\].
    pub sections: Vec<(Section, f64)>,
}

impl Plan {
    /// Length \[s\].
    pub fn duration(&self) -> f64 {
        self.sections.iter().map(|(_, length)| length).sum()
    }

    /// Start \[s\] of the first section that walks, and end of the last one; the whole plan if none does.
    pub fn walking(&self) -> [f64; 2] {
        let (mut span, mut start) = ([f64::INFINITY, 0.0], 0.0_f64);
        for (section, length) in &self.sections {
            if matches!(section, Section::Trot { .. }) {
                span = [start.min(span[0]), start + length];
            }
            start += length;
        }
        if span[0].is_finite() { span } else { [0.0, start] }
    }

    /// Target angles \[rad\] in joint order at `t` \[s\]; the stand before the start and after the end.
    pub fn target(&self, t: f64) -> [f64; 12] {
        let mut start = 0.0;
        for (section, length) in &self.sections {
            if (start..start + length).contains(&t) {
                let own = t - start;
                let weight = smooth(own / BLEND) * smooth((length - own) / BLEND);
                let target = section.target(own);
                return std::array::from_fn(|j| STAND[j] + weight * (target[j] - STAND[j]));
            }
            start += length;
        }
        STAND
    }

    /// A plan of 20 s of one motion, between stands.
    pub fn of(motion: Motion, draws: &mut SplitMix64) -> Self {
        const LENGTH: f64 = 20.0;
        const STANDING: f64 = 0.6;
        if motion == Motion::Mixed {
            return Self::drawn(draws);
        }
        let mut sections = vec![(Section::Stand, STANDING)];
        let mut left = LENGTH - 2.0 * STANDING;
        while left > 0.0 {
            let (section, length) = match motion {
                Motion::Mixed | Motion::Stand => (Section::Stand, left),
                Motion::Trot => (trot(draws), draws.between(9.0, LENGTH)),
                Motion::Spin => (spin(draws), draws.between(4.0, 8.0)),
                Motion::Stick => (trot(draws), draws.between(1.0, 3.0)),
                Motion::Squat => squat(draws),
                Motion::Sway => swaying(draws),
            };
            // No section is shorter than its own fading in and out.
            let length = if left - length < 2.0 * BLEND { left } else { length };
            sections.push((section, length));
            left -= length;
        }
        sections.push((Section::Stand, STANDING));
        Self { sections }
    }

    /// A plan of 20 s: it stands, then squats, chirps and sways or leans in a drawn order, and walks for the rest of the
    /// time, in half of the plans in two gaits.
    pub fn drawn(draws: &mut SplitMix64) -> Self {
        const LENGTH: f64 = 20.0;
        const STANDING: [f64; 2] = [1.2, 0.6];
        let mut still = vec![squat(draws), chirp(draws), swaying(draws)];
        let mut sections = vec![(Section::Stand, STANDING[0])];
        let left = LENGTH - STANDING[0] - STANDING[1] - still.iter().map(|(_, length)| length).sum::<f64>();
        let gaits = if draws.chance(0.5) { 2 } else { 1 };
        let walks: Vec<_> = (0..gaits).map(|_| (trot(draws), left / f64::from(gaits))).collect();
        still.rotate_left(draws.index(3));
        let after = draws.index(still.len() + 1);
        let last = still.split_off(after);
        sections.extend(still);
        sections.extend(walks);
        sections.extend(last);
        sections.push((Section::Stand, STANDING[1]));
        Self { sections }
    }
}

fn squat(draws: &mut SplitMix64) -> (Section, f64) {
    let (frequency, count) = (draws.between(0.4, 0.8), 1 + draws.index(2));
    let squat = Squat { frequency, depth: draws.between(0.3, 0.6) };
    (Section::Squat(squat), count as f64 / frequency)
}

fn chirp(draws: &mut SplitMix64) -> (Section, f64) {
    let length = draws.between(3.0, 4.0);
    let chirp = Chirp {
        start: draws.between(0.5, 1.0),
        end: draws.between(5.0, 9.0),
        duration: length,
        amplitude: draws.between(0.03, 0.06),
        phase_step: draws.between(0.3, 1.5),
        ..Default::default()
    };
    (Section::Chirp(chirp), length)
}

fn swaying(draws: &mut SplitMix64) -> (Section, f64) {
    let (frequency, amplitude) = (draws.between(0.4, 1.0), draws.between(0.06, 0.12));
    let length = draws.between(2.5, 3.5);
    let section = if draws.chance(0.5) {
        Section::Sway { frequency, amplitude }
    } else {
        Section::Lean { frequency, amplitude: 2.0 * amplitude }
    };
    (section, length)
}

fn trot(draws: &mut SplitMix64) -> Section {
    let gait = Trot {
        frequency: draws.between(1.5, 2.8),
        swing: draws.between(0.14, 0.26),
        lift: draws.between(0.45, 0.7),
        lift_delay: draws.between(0.3, 0.5),
        ..Default::default()
    };
    Section::Trot { gait, turn: draws.between(-0.35, 0.35) }
}

/// Swings forwards on one side and backwards on the other.
fn spin(draws: &mut SplitMix64) -> Section {
    let gait = Trot { swing: draws.between(0.03, 0.06), frequency: draws.between(1.5, 2.8), ..Default::default() };
    Section::Trot { gait, turn: draws.sign() * draws.between(3.0, 5.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_motion_lasts_twenty_seconds_without_jumps() {
        for motion in Motion::ALL {
            for seed in 0..5 {
                let plan = Plan::of(motion, &mut SplitMix64::new(seed));
                assert!((plan.duration() - 20.0).abs() < 1e-9, "{motion:?}: {}", plan.duration());
                let largest = (0..20_000).map(|k| {
                    let (now, next) = (plan.target(0.001 * f64::from(k)), plan.target(0.001 * f64::from(k + 1)));
                    now.iter().zip(&next).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
                });
                assert!(largest.fold(0.0, f64::max) < 0.04, "{motion:?} {seed}");
            }
        }
    }

    #[test]
    fn plans_repeat_last_twenty_seconds_and_have_no_jumps() {
        for seed in 0..20 {
            let plan = Plan::drawn(&mut SplitMix64::new(seed));
            assert_eq!(plan, Plan::drawn(&mut SplitMix64::new(seed)));
            assert!((plan.duration() - 20.0).abs() < 1e-9, "{}", plan.duration());
            let names: Vec<_> = plan.sections.iter().map(|(section, _)| section.name()).collect();
            for name in ["stand", "squat", "chirp", "trot"] {
                assert!(names.contains(&name), "{names:?}");
            }
            let [start, end] = plan.walking();
            assert!(end - start > 5.0, "{start} {end}");
            let largest = (0..20_100).map(|k| {
                let (now, next) = (plan.target(0.001 * f64::from(k)), plan.target(0.001 * f64::from(k + 1)));
                now.iter().zip(&next).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            });
            let largest = largest.fold(0.0, f64::max);
            assert!(largest < 0.03, "seed {seed}: {largest} rad within a millisecond");
        }
        assert_ne!(Plan::drawn(&mut SplitMix64::new(1)), Plan::drawn(&mut SplitMix64::new(2)));
    }

    #[test]
    fn a_turn_lengthens_the_right_swing() {
        // How far back the foot pushes: there the knee is straight and does not blur the thigh's swing.
        let reach = |turn: f64, joint: usize| {
            let section = Section::Trot { gait: Trot::default(), turn };
            (0..500).map(|k| -section.target(1.0 + 0.001 * f64::from(k))[joint]).fold(f64::NEG_INFINITY, f64::max)
        };
        assert!(reach(0.3, 4) > reach(0.0, 4) && reach(0.3, 1) < reach(0.0, 1));
    }

    #[test]
    fn before_and_after_it_stands() {
        let plan = Plan::drawn(&mut SplitMix64::new(5));
        assert_eq!(plan.target(-1.0), STAND);
        assert_eq!(plan.target(plan.duration() + 1.0), STAND);
        assert_eq!(Plan { sections: vec![(Section::Stand, 2.0)] }.walking(), [0.0, 2.0]);
    }
}
