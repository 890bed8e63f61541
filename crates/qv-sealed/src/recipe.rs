//! All that one recording is made of.

use crate::effects::Cause;
use crate::engine::Engine;
use crate::sections::Plan;
use crate::withheld::Withheld;
use qv_core::TriangleMesh;
use qv_core::random::{SplitMix64, sub_seed};
use qv_go2::model;
use qv_go2::synthetic::{self, Deviations};
use std::collections::BTreeMap;

/// One recording, to the last digit.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// Seed of the sensor noise.
    pub seed: u64,
    /// The engine.
    pub engine: Engine,
    /// The motion.
    pub plan: Plan,
    /// Position gain of all joints \[N m/rad\].
    pub kp: f64,
    /// Velocity gain of all joints \[N m s/rad\].
    pub kd: f64,
    /// The small ways in which this robot differs from its model and that nobody names: parameters of the simulator.
    pub differences: Vec<(String, f64)>,
    /// Noise of the sensors.
    pub deviations: Deviations,
    /// What a diagnosis should name: nothing, one effect, or two.
    pub causes: Vec<Cause>,
    /// What it should find no name for.
    pub withheld: Option<Withheld>,
    /// Ground with a friction per label; `None` for the nominal floor.
    pub ground: Option<TriangleMesh>,
}

impl Recipe {
    /// The same recording without what departs: same engine, motion, gains, differences and noise.
    pub fn without_effects(&self) -> Self {
        Self { causes: Vec::new(), withheld: None, ..self.clone() }
    }

    /// Parameters of the simulator: differences, and effects on top of them.
    pub fn parameters(&self) -> Vec<(String, f64)> {
        let mut out: BTreeMap<String, f64> = BTreeMap::new();
        if let Engine::Ours { time_constant, .. } = self.engine {
            out.insert("contact.time_constant".into(), time_constant);
        }
        let settings = self.causes.iter().flat_map(|cause| &cause.settings);
        for (name, value) in self.differences.iter().chain(settings) {
            let before = out.get(name).copied();
            out.insert(name.clone(), before.map_or(*value, |before| together(name, before, *value)));
        }
        out.into_iter().collect()
    }
}

/// A difference and an effect on the same parameter: ratios multiply, what is neutral at zero adds up, and what has a
/// size of its own is the effect's.
fn together(name: &str, before: f64, value: f64) -> f64 {
    if name.ends_with("_scale") || name.ends_with(".strength") {
        before * value
    } else if name.ends_with(".armature") || name.starts_with("contact.") || name.ends_with("_limit") {
        value
    } else {
        before + value
    }
}

/// [`synthetic::small_differences`] and as small ones of friction, inertia, mounting and floor.
pub(crate) fn small_differences(seed: u64) -> Vec<(String, f64)> {
    let mut drawn = synthetic::small_differences(seed);
    let mut draws = SplitMix64::new(sub_seed(seed, 1));
    for joint in model::JOINT_NAMES {
        drawn.push((format!("joint.{joint}.viscous_friction"), draws.normal(0.01).abs()));
        drawn.push((format!("sensor.{joint}.encoder_bias"), draws.normal(0.001)));
    }
    drawn.push(("link.base.inertia_scale".into(), 1.0 + draws.normal(0.02)));
    drawn.push(("contact.friction".into(), model::FLOOR_FRICTION + draws.normal(0.02)));
    for axis in ["roll", "pitch"] {
        drawn.push((format!("sensor.imu.tilt_{axis}"), draws.normal(0.001)));
    }
    for axis in ["x", "y", "z"] {
        drawn.push((format!("sensor.imu.gyro_bias_{axis}"), draws.normal(0.001)));
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_and_effects_combine_by_kind() {
        assert_eq!(together("actuator.FL_hip_joint.kp_scale", 1.01, 0.5), 0.505);
        assert_eq!(together("joint.FL_hip_joint.coulomb_friction", 0.02, 0.5), 0.52);
        assert_eq!(together("contact.friction", 0.81, 0.3), 0.3);
        assert_eq!(together("joint.FL_hip_joint.armature", 0.0101, 0.03), 0.03);
    }

    #[test]
    fn differences_repeat_and_are_small() {
        let drawn = small_differences(4);
        assert_eq!(drawn, small_differences(4));
        assert_ne!(drawn, small_differences(5));
        let largest = |end: &str| {
            drawn.iter().filter(|(name, _)| name.ends_with(end)).map(|(_, value)| value.abs()).fold(0.0, f64::max)
        };
        assert!(largest("encoder_bias") < 0.005 && largest("viscous_friction") < 0.05);
    }
}
