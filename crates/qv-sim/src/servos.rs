//! Friction of geared servos that others measured, by name, as values of parameters `joint.*.KEY`.
//!
//! Figures: Rhoban's BAM (<https://github.com/Rhoban/bam>, Apache-2.0; Duclusaud, Passault, Padois and Ly, arXiv:2410.08650), model M6 of each
//! servo, rounded to four figures; what is below 1e-4 is left out.

use crate::SimError;
use crate::names;

/// A value of `joint.*.KEY`.
pub type Value = (&'static str, f64);

/// A servo whose friction was published.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Servo {
    /// Name, such as `mx106`.
    pub name: &'static str,
    /// Keys and values, rotor inertia among them.
    pub values: &'static [Value],
}

/// Keys of friction beyond Coulomb's and viscous friction, and of springs, as the last part of `joint.*.KEY`.
pub const KEYS: [&str; 14] = [
    "stribeck_friction",
    "stribeck_speed",
    "stribeck_exponent",
    "load_friction_motor",
    "load_friction_external",
    "stribeck_load_friction_motor",
    "stribeck_load_friction_external",
    "quadratic_load_friction_motor",
    "quadratic_load_friction_external",
    "quadratic_drag",
    "constant_torque",
    "spring_stiffness",
    "spring_rest",
    "spring_slack",
];

/// The friction models of arXiv:2410.08650, and the keys that each has beside Coulomb and viscous friction. M3 and M4 differ from M5 in that both
/// sides of the gear have the same load friction.
const MODELS: [(&str, &[&str]); 6] = [
    ("m1", &[]),
    ("m2", &["stribeck_friction", "stribeck_speed", "stribeck_exponent"]),
    ("m3", &["load_friction_motor", "load_friction_external"]),
    ("m4", KEYS.split_at(7).0),
    ("m5", KEYS.split_at(7).0),
    ("m6", KEYS.split_at(9).0),
];

/// Servos with published friction.
pub const SERVOS: [Servo; 7] = [
    Servo {
        name: "mx64",
        values: &[
            ("armature", 0.01227),
            ("stribeck_friction", 0.1227),
            ("stribeck_speed", 2.575),
            ("stribeck_exponent", 0.8409),
            ("load_friction_motor", 0.3115),
            ("stribeck_load_friction_motor", 0.1877),
            ("stribeck_load_friction_external", 0.01407),
            ("quadratic_load_friction_motor", 0.006909),
            ("quadratic_load_friction_external", 0.01),
            ("viscous_friction", 0.02534),
        ],
    },
    Servo {
        name: "mx106",
        values: &[
            ("armature", 0.02602),
            ("stribeck_friction", 0.122),
            ("stribeck_speed", 1.746),
            ("stribeck_exponent", 1.143),
            ("load_friction_motor", 0.198),
            ("load_friction_external", 0.02222),
            ("stribeck_load_friction_motor", 0.1986),
            ("stribeck_load_friction_external", 0.0871),
            ("quadratic_load_friction_motor", 0.01),
            ("viscous_friction", 0.05072),
        ],
    },
    Servo {
        name: "xl320",
        values: &[
            ("armature", 0.001163),
            ("stribeck_friction", 0.01631),
            ("stribeck_speed", 2.301),
            ("stribeck_exponent", 1.707),
            ("load_friction_external", 0.1583),
            ("stribeck_load_friction_external", 0.2455),
            ("quadratic_load_friction_motor", 0.003616),
            ("quadratic_load_friction_external", 0.004711),
            ("viscous_friction", 0.007225),
        ],
    },
    Servo {
        name: "xl330",
        values: &[
            ("armature", 0.00257),
            ("coulomb_friction", 0.002326),
            ("stribeck_friction", 0.0001856),
            ("stribeck_speed", 0.1153),
            ("stribeck_exponent", 1.0),
            ("load_friction_motor", 0.2306),
            ("load_friction_external", 0.2608),
            ("stribeck_load_friction_external", 0.1516),
            ("quadratic_load_friction_motor", 0.005596),
            ("quadratic_load_friction_external", 0.003775),
            ("viscous_friction", 0.01854),
        ],
    },
    Servo {
        name: "sts3215",
        values: &[
            ("armature", 0.02156),
            ("coulomb_friction", 0.05331),
            ("stribeck_speed", 0.3711),
            ("stribeck_exponent", 9.931),
            ("load_friction_motor", 0.04491),
            ("load_friction_external", 0.2436),
            ("stribeck_load_friction_motor", 0.0001245),
            ("stribeck_load_friction_external", 0.1423),
            ("quadratic_load_friction_motor", 0.007595),
            ("quadratic_load_friction_external", 0.003404),
            ("viscous_friction", 0.02816),
        ],
    },
    Servo {
        name: "erob80_50",
        values: &[
            ("armature", 0.3617),
            ("coulomb_friction", 3.259),
            ("stribeck_friction", 0.3204),
            ("stribeck_speed", 2.83),
            ("stribeck_exponent", 1.786),
            ("load_friction_motor", 0.03566),
            ("load_friction_external", 0.0008432),
            ("stribeck_load_friction_motor", 0.003771),
            ("stribeck_load_friction_external", 0.04144),
            ("quadratic_load_friction_motor", 0.001872),
            ("quadratic_load_friction_external", 0.001599),
            ("viscous_friction", 1.403),
        ],
    },
    Servo {
        name: "erob80_100",
        values: &[
            ("armature", 1.135),
            ("coulomb_friction", 0.000478),
            ("stribeck_friction", 5.226),
            ("stribeck_speed", 2.033),
            ("stribeck_exponent", 3.0),
            ("load_friction_motor", 0.04889),
            ("stribeck_load_friction_external", 0.05117),
            ("quadratic_load_friction_motor", 0.002703),
            ("quadratic_load_friction_external", 0.002556),
            ("viscous_friction", 9.709),
        ],
    },
];

/// The servo of a name.
///
/// # Errors
/// Names the nearest one where there is none.
pub fn servo(name: &str) -> Result<&'static Servo, SimError> {
    SERVOS.iter().find(|s| s.name == name).ok_or_else(|| SimError::UnknownParameter {
        name: name.to_owned(),
        nearest: names::nearest(name, SERVOS.iter().map(|s| s.name)).unwrap_or_default().to_owned(),
    })
}

/// Keys beside Coulomb and viscous friction that a friction model has, `m1` to `m6`; `None` for any other word.
pub fn keys_of_model(model: &str) -> Option<&'static [&'static str]> {
    MODELS.iter().find(|(name, _)| *name == model).map(|(_, keys)| *keys)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BaseKind, Batch, Model, ModelOptions, SimOptions, Terrain};

    #[test]
    fn every_value_is_a_parameter_of_the_simulator() {
        let urdf = r#"<robot name="p"><link name="bench"/><link name="arm"><inertial><mass value="1"/>
            <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="axle" type="continuous"><parent link="bench"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
        let model = Model::from_urdf(urdf, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap();
        let mut sim = Batch::<f64>::new(&model, &Terrain::none(), &SimOptions::default(), 1).unwrap();
        for servo in SERVOS {
            let beyond = keys_of_model("m6").unwrap();
            for (key, value) in servo.values {
                sim.set_parameter(0, &format!("joint.axle.{key}"), *value).unwrap();
                assert!(beyond.contains(key) || ["armature", "coulomb_friction", "viscous_friction"].contains(key));
            }
        }
        for key in KEYS {
            sim.parameter(0, &format!("joint.axle.{key}")).unwrap();
        }
    }

    #[test]
    fn names_are_found_or_the_nearest_is_told() {
        assert_eq!(servo("xl330").unwrap().name, "xl330");
        assert!(servo("mx107").unwrap_err().to_string().contains("mx106"));
        assert_eq!(keys_of_model("m3").unwrap().len(), 2);
        assert_eq!(keys_of_model("m7"), None);
    }
}
