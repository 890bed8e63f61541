//! The effect that a made-up robot hides.

use qv_core::random::SplitMix64;
use qv_gap::problem::library::{self, Effect};
use qv_go2::model::{JOINT_NAMES, LEGS};
use qv_go2::synthetic::small_differences;
use serde_json::{Value, json};

/// What can be hidden: the effect's name in the library, the parameter that it moves, what that is where nothing is hidden,
/// and the least and the greatest size that is drawn.
struct Kind {
    effect: &'static str,
    parameter: &'static str,
    neutral: f64,
    sizes: [f64; 2],
}

/// Effects of joints that a robot shows while it stands, squats and trots on a plane. Sizes are such as motors and gearboxes of that size
/// have, and several times what noise of the sensors hides.
const KINDS: [Kind; 5] = [
    Kind {
        effect: "command_latency",
        parameter: "actuator.{joint}.command_latency",
        neutral: 0.0,
        sizes: [0.006, 0.014],
    },
    Kind { effect: "actuator_lag", parameter: "actuator.{joint}.lag", neutral: 0.0, sizes: [0.006, 0.014] },
    Kind { effect: "motor_gain_kp", parameter: "actuator.{joint}.kp_scale", neutral: 1.0, sizes: [-0.3, -0.15] },
    Kind {
        effect: "joint_viscous_friction",
        parameter: "joint.{joint}.viscous_friction",
        neutral: 0.0,
        sizes: [0.2, 0.4],
    },
    Kind {
        effect: "joint_coulomb_friction",
        parameter: "joint.{joint}.coulomb_friction",
        neutral: 0.0,
        sizes: [0.4, 0.8],
    },
];

/// Stream of the draw of an effect: noise and small differences draw from the seed itself.
const STREAM: u64 = 0x6465_6d6f;

/// An effect with its size and the joints that have it.
pub struct HiddenEffect {
    pub effect: Effect,
    pub size: f64,
    /// `all`, a leg, or a joint, as reports say it.
    pub scope: Vec<String>,
    joints: Vec<&'static str>,
    parameter: &'static str,
    neutral: f64,
}

impl HiddenEffect {
    /// Draws one: a kind, a size, and whether all joints have it, those of a leg, or one.
    pub fn drawn(seed: u64) -> Self {
        let mut draws = SplitMix64::of(seed, STREAM);
        let kind = &KINDS[draws.index(KINDS.len())];
        let size = draws.between(kind.sizes[0], kind.sizes[1]);
        let (extent, leg, joint) = (draws.index(3), LEGS[draws.index(LEGS.len())], draws.index(JOINT_NAMES.len()));
        let of_leg = || JOINT_NAMES.into_iter().filter(|name| name.starts_with(leg)).collect();
        let (scope, joints) = match extent {
            0 => ("all", JOINT_NAMES.to_vec()),
            1 => (leg, of_leg()),
            _ => (JOINT_NAMES[joint], vec![JOINT_NAMES[joint]]),
        };
        let library = library::built_in();
        let effect = library.into_iter().find(|e| e.name == kind.effect).expect("the library has what a demo hides");
        Self { effect, size, scope: vec![scope.into()], joints, parameter: kind.parameter, neutral: kind.neutral }
    }

    /// Parameters of the robot: the small differences that any robot has, and the hidden effect on top of them.
    pub fn parameters(&self, seed: u64) -> Vec<(String, f64)> {
        let mut all = small_differences(seed);
        for joint in &self.joints {
            let name = self.parameter.replace("{joint}", joint);
            match all.iter_mut().find(|(known, _)| *known == name) {
                Some((_, value)) => *value += self.size,
                None => all.push((name, self.neutral + self.size)),
            }
        }
        all
    }

    pub fn to_json(&self) -> Value {
        json!({ "effect": self.effect.name, "scope": self.scope, "value": self.size, "unit": self.effect.unit })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_effect_and_extent_is_drawn_within_its_range() {
        let drawn: Vec<HiddenEffect> = (0..200).map(HiddenEffect::drawn).collect();
        let names: BTreeSet<&str> = drawn.iter().map(|h| h.effect.name.as_str()).collect();
        assert_eq!(names.len(), KINDS.len(), "{names:?}");
        let extents: BTreeSet<usize> = drawn.iter().map(|h| h.joints.len()).collect();
        assert_eq!(extents, BTreeSet::from([1, 3, 12]));
        assert!(drawn.iter().all(|h| (h.effect.range[0]..=h.effect.range[1]).contains(&h.size)));
        assert_eq!(HiddenEffect::drawn(5).to_json(), HiddenEffect::drawn(5).to_json(), "a seed draws the same");
    }

    #[test]
    fn it_adds_to_the_small_differences() {
        let hidden =
            (0..).map(HiddenEffect::drawn).find(|h| h.effect.name == "motor_gain_kp" && h.joints.len() == 1).unwrap();
        let name = hidden.parameter.replace("{joint}", hidden.joints[0]);
        let of = |list: Vec<(String, f64)>| list.into_iter().find(|(n, _)| *n == name).unwrap().1;
        let (with, without) = (of(hidden.parameters(3)), of(small_differences(3)));
        assert!((with - without - hidden.size).abs() < 1e-12 && without != 1.0);
        assert_eq!(hidden.parameters(3).len(), small_differences(3).len());
    }
}
