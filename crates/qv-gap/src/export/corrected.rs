//! Corrections sorted by what they act on, for formats that speak of joints, bodies and floors and not of parameters.

use crate::report::Correction;
use glam::{DMat3, DVec3};
use qv_core::Pose;
use qv_sim::{MassProperties, Model, Payload};

/// What a correction acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CorrectionTarget<'a> {
    /// Index in the model.
    Joint(usize),
    /// Index in the model.
    Link(usize),
    /// Index in the model.
    Geom(usize),
    /// Name of a material of the ground.
    Material(&'a str),
    /// Ground, outside forces, sensors of the base, what feeds the motors.
    World,
    /// Nothing that this model has.
    Nothing,
}

/// A correction and what it acts on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry<'a> {
    pub part: CorrectionTarget<'a>,
    /// Last word of a parameter of a joint, link, shape or material, such as `lag`; else the full name.
    pub field: &'a str,
    pub correction: &'a Correction,
}

/// Mass properties of a link in its own frame: mass \[kg\], centre \[m\], inertia about the centre along the link's axes
/// \[kg m²\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Body {
    pub mass: f64,
    pub com: DVec3,
    pub inertia: DMat3,
}

/// The corrections of one model. Of two corrections of one parameter, the later holds.
#[derive(Debug, Clone)]
pub(super) struct ModelCorrections<'a> {
    pub model: &'a Model,
    pub entries: Vec<Entry<'a>>,
}

impl<'a> ModelCorrections<'a> {
    pub fn new(model: &'a Model, corrections: &'a [Correction]) -> Self {
        let mut entries: Vec<Entry> = Vec::new();
        for correction in corrections {
            // A value that is no number corrects nothing.
            if !correction.value.is_finite() {
                continue;
            }
            entries.retain(|e| e.correction.parameter != correction.parameter);
            let (part, field) = part(model, &correction.parameter);
            entries.push(Entry { part, field, correction });
        }
        Self { model, entries }
    }

    fn value(&self, part: CorrectionTarget, field: &str) -> Option<f64> {
        self.entries.iter().find(|e| e.part == part && e.field == field).map(|e| e.correction.value)
    }

    /// Corrected value of a joint's, its motor's or its sensor's parameter, by its last word.
    pub fn joint(&self, joint: usize, field: &str) -> Option<f64> {
        self.value(CorrectionTarget::Joint(joint), field)
    }

    /// Corrected value of a shape's parameter, by its last word.
    pub fn geom(&self, geom: usize, field: &str) -> Option<f64> {
        self.value(CorrectionTarget::Geom(geom), field)
    }

    /// Corrected value of a parameter of the world, by its full name.
    pub fn world(&self, name: &str) -> Option<f64> {
        self.value(CorrectionTarget::World, name)
    }

    /// Whether any correction changes the mass properties of a link. Another length moves shapes and joints as well: it is reported as a whole, in words.
    pub fn changes_link(&self, link: usize) -> bool {
        self.entries.iter().any(|e| e.part == CorrectionTarget::Link(link) && e.field != "length_scale")
    }

    /// The link with its corrections: scaled and shifted, then welded to its payload, as the simulator does it. `None` when
    /// no mass would be left.
    pub fn body(&self, link: usize) -> Option<Body> {
        let get = |field: &str, neutral: f64| self.value(CorrectionTarget::Link(link), field).unwrap_or(neutral);
        let vector = |names: [&str; 3]| DVec3::from_array(names.map(|name| get(name, 0.0)));
        let nominal = &self.model.links[link];
        let scale = get("mass_scale", 1.0);
        let own = MassProperties {
            mass: nominal.mass * scale,
            com: nominal.com + vector(["com_x", "com_y", "com_z"]),
            inertia: nominal.inertia * (scale * get("inertia_scale", 1.0)),
        };
        let payload = Payload {
            mass: get("payload_mass", 0.0),
            // From the modelled centre of mass, wherever the true one is.
            at: nominal.com + vector(["payload_x", "payload_y", "payload_z"]),
            moment: vector(["payload_moment_x", "payload_moment_y", "payload_moment_z"]),
        };
        let MassProperties { mass, com, inertia } = payload.on(&own);
        (mass > 0.0).then_some(Body { mass, com, inertia })
    }
}

impl Body {
    /// Both as one body; `other` may have a negative mass, which takes it away. `None` when no mass is left.
    pub fn welded(&self, other: &Self) -> Option<Self> {
        let mass = self.mass + other.mass;
        if mass <= 0.0 {
            return None;
        }
        // What is added at the centre leaves it there, to the last digit.
        let com = if self.com == other.com { self.com } else { (self.com * self.mass + other.com * other.mass) / mass };
        let about = |b: &Self| b.inertia + point_inertia(b.mass, b.com - com);
        Some(Self { mass, com, inertia: about(self) + about(other) })
    }

    /// The same body seen from frame `a`.
    pub fn transformed(&self, a_from_b: &Pose) -> Self {
        let rotation = a_from_b.matrix();
        let inertia = rotation * self.inertia * rotation.transpose();
        Self { mass: self.mass, com: a_from_b.transform_point(self.com), inertia }
    }

    /// The same with everything negative: what to weld on to take it away.
    pub fn negated(&self) -> Self {
        Self { mass: -self.mass, com: self.com, inertia: -self.inertia }
    }

    /// Whether a rigid body can have this: positive mass and definite inertia, no principal moment above the sum of
    /// the others by more than 2 %, which is what the reader of URDF files puts down to rounding.
    pub fn is_physical(&self) -> bool {
        let i = &self.inertia;
        let trace = i.x_axis.x + i.y_axis.y + i.z_axis.z;
        self.mass > 0.0 && is_positive_definite(i) && is_positive_definite(&(DMat3::IDENTITY * (0.51 * trace) - *i))
    }

    /// ixx, iyy, izz, ixy, ixz, iyz: entries of the matrix, not of its negative.
    pub fn moments(&self) -> [f64; 6] {
        let i = &self.inertia;
        [i.x_axis.x, i.y_axis.y, i.z_axis.z, i.x_axis.y, i.x_axis.z, i.y_axis.z]
    }
}

/// Inertia of a point mass at `d` from the reference point: m (|d|² 1 - d dᵀ).
fn point_inertia(mass: f64, d: DVec3) -> DMat3 {
    (DMat3::IDENTITY * d.length_squared() - DMat3::from_cols(d * d.x, d * d.y, d * d.z)) * mass
}

/// By its leading minors (Sylvester).
fn is_positive_definite(m: &DMat3) -> bool {
    let minor = m.x_axis.x * m.y_axis.y - m.x_axis.y * m.y_axis.x;
    m.x_axis.x > 0.0 && minor > 0.0 && m.determinant() > 0.0
}

/// What a parameter of this name acts on, and what is left of the name. Names of joints and links may have dots.
fn part<'a>(model: &Model, parameter: &'a str) -> (CorrectionTarget<'a>, &'a str) {
    const WORLD: [&str; 7] = ["contact.", "terrain.", "external.", "sensor.imu.", "sensor.pose.", "supply.", "run."];
    let inner = parameter.split_once('.').and_then(|(kind, rest)| {
        let (name, field) = rest.rsplit_once('.')?;
        Some((kind, name, field))
    });
    let found = match inner {
        Some(("joint" | "actuator" | "sensor", name, field)) => {
            model.joint_index(name).map(|j| (CorrectionTarget::Joint(j), field))
        }
        Some(("link", name, field)) => {
            model.links.iter().position(|l| l.name == name).map(|l| (CorrectionTarget::Link(l), field))
        }
        Some(("geom", name, field)) => {
            model.geoms.iter().position(|g| g.name == name).map(|g| (CorrectionTarget::Geom(g), field))
        }
        Some(("material", name, field)) => Some((CorrectionTarget::Material(name), field)),
        _ => None,
    };
    let world = parameter == "sensor.foot_force.scale" || WORLD.iter().any(|start| parameter.starts_with(start));
    found.unwrap_or((if world { CorrectionTarget::World } else { CorrectionTarget::Nothing }, parameter))
}

/// A number with six digits that count, which is more than any estimate has and short enough to read.
pub(super) fn short(x: f64) -> f64 {
    // A decimal written and read again is that decimal, so that it prints without a tail.
    format!("{x:.5e}").parse::<f64>().unwrap_or(x) + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_sim::{BaseKind, Batch, ModelOptions, SimOptions, State, Terrain};

    fn go2() -> Model {
        let options = ModelOptions { base: BaseKind::Floating, armature: 0.01, mesh_reader: None, held: &[] };
        Model::from_urdf(&qv_go2::model::urdf(), &options).unwrap()
    }

    fn correction(parameter: &str, value: f64) -> Correction {
        Correction { parameter: parameter.into(), value, nominal: 0.0, unit: "1".into() }
    }

    #[test]
    fn names_find_what_they_act_on() {
        let model = go2();
        for (name, expected, field) in [
            ("joint.FL_calf_joint.armature", CorrectionTarget::Joint(2), "armature"),
            ("actuator.FL_hip_joint.lag", CorrectionTarget::Joint(0), "lag"),
            ("sensor.RR_calf_joint.encoder_bias", CorrectionTarget::Joint(11), "encoder_bias"),
            ("link.base.payload_mass", CorrectionTarget::Link(0), "payload_mass"),
            ("geom.FL_calf.radius_offset", CorrectionTarget::Geom(0), "radius_offset"),
            ("material.wet.grass.friction", CorrectionTarget::Material("wet.grass"), "friction"),
            ("terrain.patch.friction", CorrectionTarget::World, "terrain.patch.friction"),
            ("sensor.imu.tilt_roll", CorrectionTarget::World, "sensor.imu.tilt_roll"),
            ("sensor.foot_force.scale", CorrectionTarget::World, "sensor.foot_force.scale"),
            ("joint.tail.armature", CorrectionTarget::Nothing, "joint.tail.armature"),
            ("nonsense", CorrectionTarget::Nothing, "nonsense"),
        ] {
            assert_eq!(part(&model, name), (expected, field), "{name}");
        }
    }

    #[test]
    fn the_later_of_two_holds_and_what_is_no_number_does_not() {
        let model = go2();
        let all = [
            correction("actuator.FL_hip_joint.lag", 0.01),
            correction("actuator.FL_hip_joint.lag", 0.02),
            correction("actuator.FL_hip_joint.lag", f64::NAN),
        ];
        assert_eq!(ModelCorrections::new(&model, &all).joint(0, "lag"), Some(0.02));
    }

    #[test]
    fn a_corrected_body_moves_as_the_simulator_moves_it() {
        let model = go2();
        let all = [
            correction("link.base.mass_scale", 1.1),
            correction("link.base.inertia_scale", 0.8),
            correction("link.base.com_x", 0.03),
            correction("link.base.payload_mass", 1.5),
            correction("link.base.payload_y", -0.07),
            correction("link.base.payload_z", 0.09),
            correction("link.base.payload_moment_x", 0.2),
            correction("link.FL_thigh.com_z", -0.02),
            correction("link.FL_thigh.payload_mass", -0.2),
            correction("link.FL_thigh.payload_x", 0.01),
        ];
        let corrected = ModelCorrections::new(&model, &all);
        let mut rebuilt = model.clone();
        for (l, link) in rebuilt.links.iter_mut().enumerate() {
            if corrected.changes_link(l) {
                let body = corrected.body(l).unwrap();
                assert!(body.is_physical());
                (link.mass, link.com, link.inertia) = (body.mass, body.com, body.inertia);
            }
        }
        let fly = |model: &Model, parameters: &[Correction]| {
            let mut batch = Batch::<f64>::new(model, &Terrain::none(), &SimOptions::default(), 1).unwrap();
            for c in parameters {
                batch.set_parameter(0, &c.parameter, c.value).unwrap();
            }
            let mut q = vec![0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0];
            q.extend(qv_go2::model::STAND);
            let v: Vec<f64> = (0..18).map(|i| (i as f64).sin()).collect();
            batch.set_state(0, &State { q, v }).unwrap();
            batch.step_many(100);
            batch.state(0).unwrap()
        };
        let (by_parameters, by_bodies, neutral) = (fly(&model, &all), fly(&rebuilt, &[]), fly(&model, &[]));
        let apart = |a: &State, b: &State| a.v.iter().zip(&b.v).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(apart(&by_parameters, &by_bodies) < 1e-10, "{}", apart(&by_parameters, &by_bodies));
        assert!(apart(&by_parameters, &neutral) > 0.01, "{}", apart(&by_parameters, &neutral));
    }

    #[test]
    fn no_body_without_mass() {
        let model = go2();
        let all = [correction("link.base.payload_mass", -6.921)];
        assert_eq!(ModelCorrections::new(&model, &all).body(0), None);
        let flat = Body { mass: 1.0, com: DVec3::ZERO, inertia: DMat3::from_diagonal(DVec3::new(1.0, 1.0, 3.0)) };
        assert!(!flat.is_physical());
    }

    #[test]
    fn short_numbers() {
        assert_eq!(short(0.1 + 0.2).to_string(), "0.3");
        assert_eq!(short(-12345.678).to_string(), "-12345.7");
        assert_eq!(short(-0.0).to_string(), "0");
        assert_eq!(short(1.234567e-7), 1.23457e-7);
    }
}
