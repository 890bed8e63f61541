//! The catalogue: every way in which a simulated robot may differ from its model, by name.
//!
//! A parameter has a unit, a neutral value (the one that changes nothing) and a range worth searching. Effects in a
//! diagnosis are priors over these; no caller of the simulator needs a branch of its own.

use crate::SimError;
use crate::model::{JointKind, Model, Shape};
use crate::names::nearest;
use crate::terrain::Terrain;
use std::collections::HashMap;

/// One parameter of a model on a terrain.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterInfo {
    /// Name, such as `joint.FL_calf_joint.armature`.
    pub name: String,
    /// SI unit; `1` for ratios.
    pub unit: &'static str,
    /// Value that leaves the model as it is.
    pub neutral: f64,
    /// Range worth searching; values outside are accepted as long as they mean something.
    pub range: (f64, f64),
    /// What it does.
    pub description: &'static str,
    /// Smallest value that means something.
    pub(crate) least: f64,
    /// What it acts on, and which of that thing's parameters it is.
    pub acts_on: ActsOn,
}

impl ParameterInfo {
    /// The nearest value that means something.
    pub fn clamped(&self, value: f64) -> f64 {
        value.max(self.least)
    }
}

/// What a parameter acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ActsOn {
    /// A joint of the model, its motor or its encoder.
    Joint(usize, JointField),
    /// A link of the model.
    Link(usize, LinkField),
    /// A shape of the model.
    Geom(usize, GeomField),
    /// The friction of a material of the terrain.
    Material(usize),
    /// The ground, what pushes from outside, the sensors of the base, the supply.
    World(WorldField),
}

macro_rules! fields {
    ($(#[$doc:meta])* $name:ident { $($variant:ident),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[allow(missing_docs)]
        pub enum $name { $($variant),* }
        impl $name {
            pub(crate) const COUNT: usize = [$(Self::$variant),*].len();
        }
    };
}

impl ActsOn {
    /// Whether it delays what a sensor reports.
    pub fn is_sensor_latency(self) -> bool {
        matches!(self, Self::Joint(_, JointField::EncoderLatency) | Self::World(WorldField::PoseDelay))
    }
}

fields!(
/// Parameters of a joint; what each does stands in [`ParameterInfo::description`].
JointField {
    Armature,
    Viscous,
    Coulomb,
    Strength,
    KpScale,
    KdScale,
    TorqueLimit,
    PositionTorqueLimit,
    SpeedKnee,
    SpeedZero,
    Lag,
    CommandLatency,
    Backlash,
    EncoderBias,
    EncoderLatency,
    TorqueScale,
    ExternalTorque,
    StribeckFriction,
    StribeckSpeed,
    StribeckExponent,
    LoadMotor,
    LoadExternal,
    StribeckLoadMotor,
    StribeckLoadExternal,
    QuadraticLoadMotor,
    QuadraticLoadExternal,
    QuadraticDrag,
    ConstantTorque,
    SpringStiffness,
    SpringRest,
    SpringSlack,
    StrengthAsymmetry,
    SeriesCompliance,
    StrengthDrift,
});
fields!(
/// Parameters of a link.
LinkField {
    MassScale,
    ComX,
    ComY,
    ComZ,
    InertiaScale,
    LengthScale,
    PayloadMass,
    PayloadX,
    PayloadY,
    PayloadZ,
    PayloadMomentX,
    PayloadMomentY,
    PayloadMomentZ,
});
fields!(
/// Parameters of a shape.
GeomField { FrictionScale, RadiusOffset });
fields!(
/// Parameters of which there is one.
WorldField {
    Friction,
    TimeConstant,
    DampingRatio,
    Restitution,
    Torsional,
    Rolling,
    Height,
    SlopeX,
    SlopeY,
    PatchXMin,
    PatchXMax,
    PatchYMin,
    PatchYMax,
    PatchFriction,
    ForceX,
    ForceY,
    ForceZ,
    ForceStart,
    ForceDuration,
    TiltRoll,
    TiltPitch,
    GyroBiasX,
    GyroBiasY,
    GyroBiasZ,
    AccBiasX,
    AccBiasY,
    AccBiasZ,
    PoseDelay,
    FootForceScale,
    RunStart,
    SupplySag,
    FrictionDrop,
    FrictionSpeed,
    YieldForce,
    SinkRate,
});

/// Stand-in for "no limit" that stays finite in arithmetic of either precision.
pub(crate) const UNLIMITED: f64 = 1e9;
const ANY: f64 = f64::NEG_INFINITY;

/// All parameters of one model on one terrain, in a fixed order: joints, links, shapes, materials, world.
#[derive(Debug, Clone)]
pub(crate) struct Catalogue {
    pub infos: Vec<ParameterInfo>,
    index: HashMap<String, usize>,
    pub links_at: usize,
    pub geoms_at: usize,
    pub materials_at: usize,
    pub world_at: usize,
}

impl Catalogue {
    pub fn new(model: &Model, terrain: &Terrain) -> Self {
        let mut infos = Vec::new();
        for j in 0..model.joints.len() {
            joint_parameters(&mut infos, model, j);
        }
        let links_at = infos.len();
        for l in 0..model.links.len() {
            link_parameters(&mut infos, model, l);
        }
        let geoms_at = infos.len();
        for g in 0..model.geoms.len() {
            geom_parameters(&mut infos, model, g);
        }
        let materials_at = infos.len();
        for (m, (name, friction)) in terrain.materials().iter().enumerate() {
            infos.push(ParameterInfo {
                name: format!("material.{name}.friction"),
                unit: "1",
                neutral: *friction,
                range: (0.05, 1.5),
                description: "Coulomb friction of the terrain's triangles of this material",
                least: 0.0,
                acts_on: ActsOn::Material(m),
            });
        }
        let world_at = infos.len();
        world_parameters(&mut infos, terrain);
        let index = infos.iter().enumerate().map(|(i, p)| (p.name.clone(), i)).collect();
        Self { infos, index, links_at, geoms_at, materials_at, world_at }
    }

    pub fn find(&self, name: &str) -> Result<usize, SimError> {
        self.index.get(name).copied().ok_or_else(|| {
            let nearest = nearest(name, self.infos.iter().map(|p| p.name.as_str())).unwrap_or_default().to_owned();
            SimError::UnknownParameter { name: name.to_owned(), nearest }
        })
    }

    pub fn check(&self, id: usize, value: f64) -> Result<(), SimError> {
        let info = &self.infos[id];
        if value.is_finite() && value >= info.least {
            return Ok(());
        }
        let expected = if info.least == ANY { "a finite number".into() } else { format!("at least {}", info.least) };
        Err(SimError::Value { what: info.name.clone(), expected: format!("{expected} [{}]", info.unit), found: value })
    }

    /// Number of materials.
    pub fn materials(&self) -> usize {
        self.world_at - self.materials_at
    }

    pub fn neutral(&self) -> Vec<f64> {
        self.infos.iter().map(|p| p.neutral).collect()
    }
}

/// Name, unit, neutral, range, least, meaning.
type Row<F> = (F, &'static str, &'static str, f64, (f64, f64), f64, &'static str);

fn push<F: Copy>(infos: &mut Vec<ParameterInfo>, prefix: &str, rows: &[Row<F>], acts_on: impl Fn(F) -> ActsOn) {
    for &(field, name, unit, neutral, range, least, description) in rows {
        let name = if prefix.is_empty() { name.to_owned() } else { name.replace('*', prefix) };
        infos.push(ParameterInfo { name, unit, neutral, range, description, least, acts_on: acts_on(field) });
    }
}

fn joint_parameters(infos: &mut Vec<ParameterInfo>, model: &Model, index: usize) {
    use JointField::*;
    let joint = &model.joints[index];
    let effort = joint.effort.min(UNLIMITED);
    let stated = |value: f64, fallback: f64| if value < UNLIMITED { value } else { fallback };
    let e = stated(effort, 50.0);
    let rows: [Row<JointField>; JointField::COUNT] = [
        (Armature, "joint.*.armature", "kg m²", joint.armature, (0.005, 0.05), 0.0, "rotor inertia at the joint"),
        (
            Viscous,
            "joint.*.viscous_friction",
            "N m s/rad",
            joint.viscous_friction,
            (0.0, 0.6),
            0.0,
            "torque per speed against motion",
        ),
        (
            Coulomb,
            "joint.*.coulomb_friction",
            "N m",
            joint.coulomb_friction,
            (0.0, 1.0),
            0.0,
            "constant torque against motion, holds at rest",
        ),
        (Strength, "actuator.*.strength", "1", 1.0, (0.6, 1.25), 0.0, "delivered over demanded torque"),
        (KpScale, "actuator.*.kp_scale", "1", 1.0, (0.6, 1.25), 0.0, "true over commanded position gain"),
        (KdScale, "actuator.*.kd_scale", "1", 1.0, (0.6, 1.25), 0.0, "true over commanded velocity gain"),
        (
            TorqueLimit,
            "actuator.*.torque_limit",
            "N m",
            effort,
            (0.3 * e, e),
            0.0,
            "largest torque that the motor delivers",
        ),
        (
            PositionTorqueLimit,
            "actuator.*.position_torque_limit",
            "N m",
            UNLIMITED,
            (0.3 * e, e),
            0.0,
            "clips position and feed-forward part before damping",
        ),
        (
            SpeedKnee,
            "actuator.*.speed_knee",
            "rad/s",
            joint.velocity.min(UNLIMITED),
            (3.0, 30.0),
            0.0,
            "speed from which torque along the motion falls; neutral: the model's speed limit",
        ),
        (
            SpeedZero,
            "actuator.*.speed_zero",
            "rad/s",
            (1.1 * joint.velocity).min(2.0 * UNLIMITED),
            (6.0, 40.0),
            0.0,
            "speed at which torque along the motion reaches zero; neutral: a tenth above the limit",
        ),
        (Lag, "actuator.*.lag", "s", 0.0, (0.0, 0.025), 0.0, "time constant of a first-order lag of the torque"),
        (CommandLatency, "actuator.*.command_latency", "s", 0.0, (0.0, 0.06), 0.0, "delay of commands"),
        (
            Backlash,
            "actuator.*.backlash",
            "rad",
            0.0,
            (0.0, 0.02),
            0.0,
            "full width of the play between motor and joint",
        ),
        (
            EncoderBias,
            "sensor.*.encoder_bias",
            "rad",
            0.0,
            (-0.1, 0.1),
            ANY,
            "measured minus true position; the controller sees it",
        ),
        (EncoderLatency, "sensor.*.encoder_latency", "s", 0.0, (0.0, 0.06), 0.0, "age of reported position and speed"),
        (TorqueScale, "sensor.*.torque_scale", "1", 1.0, (0.6, 1.25), 0.0, "reported over delivered torque"),
        (
            ExternalTorque,
            "joint.*.external_torque",
            "N m",
            0.0,
            (-10.0, 10.0),
            ANY,
            "outside torque during external.start .. + duration",
        ),
        (
            StribeckFriction,
            "joint.*.stribeck_friction",
            "N m",
            0.0,
            (0.0, 1.0),
            0.0,
            "Coulomb friction beyond coulomb_friction at rest, gone at speed",
        ),
        (
            StribeckSpeed,
            "joint.*.stribeck_speed",
            "rad/s",
            0.2,
            (0.02, 3.0),
            1e-6,
            "speed at which friction at rest has fallen to 1/e of what it has beyond that at speed",
        ),
        (StribeckExponent, "joint.*.stribeck_exponent", "1", 2.0, (0.5, 6.0), 0.1, "how abruptly it falls there"),
        (
            LoadMotor,
            "joint.*.load_friction_motor",
            "1",
            0.0,
            (0.0, 0.6),
            0.0,
            "Coulomb friction per torque of the motor, as the teeth of a gear have it",
        ),
        (
            LoadExternal,
            "joint.*.load_friction_external",
            "1",
            0.0,
            (0.0, 0.6),
            0.0,
            "Coulomb friction per torque that comes from outside the motor",
        ),
        (
            StribeckLoadMotor,
            "joint.*.stribeck_load_friction_motor",
            "1",
            0.0,
            (0.0, 0.6),
            0.0,
            "load_friction_motor that is gone at speed",
        ),
        (
            StribeckLoadExternal,
            "joint.*.stribeck_load_friction_external",
            "1",
            0.0,
            (0.0, 0.6),
            0.0,
            "load_friction_external that is gone at speed",
        ),
        (
            QuadraticLoadMotor,
            "joint.*.quadratic_load_friction_motor",
            "1/(N m)",
            0.0,
            (0.0, 0.05),
            0.0,
            "Coulomb friction at rest per squared torque of a motor that is driven back",
        ),
        (
            QuadraticLoadExternal,
            "joint.*.quadratic_load_friction_external",
            "1/(N m)",
            0.0,
            (0.0, 0.05),
            0.0,
            "Coulomb friction at rest per squared outside torque against which the motor drives",
        ),
        (
            QuadraticDrag,
            "joint.*.quadratic_drag",
            "N m s²/rad²",
            0.0,
            (0.0, 0.1),
            0.0,
            "torque per squared speed against motion",
        ),
        (
            ConstantTorque,
            "joint.*.constant_torque",
            "N m",
            0.0,
            (-1.0, 1.0),
            ANY,
            "always there: friction of another size either way is Coulomb friction beside half of the difference",
        ),
        (
            SpringStiffness,
            "joint.*.spring_stiffness",
            "N m/rad",
            0.0,
            (0.0, 5.0),
            0.0,
            "spring between the joint's two links, as a cable is",
        ),
        (
            SpringRest,
            "joint.*.spring_rest",
            "rad",
            0.0,
            (-3.0, 3.0),
            ANY,
            "position in the middle of the spring's slack",
        ),
        (
            SpringSlack,
            "joint.*.spring_slack",
            "rad",
            0.0,
            (0.0, 3.0),
            0.0,
            "how far from spring_rest the spring does nothing",
        ),
        (
            StrengthAsymmetry,
            "actuator.*.strength_asymmetry",
            "1",
            0.0,
            (-0.3, 0.3),
            ANY,
            "delivered over demanded torque: more than strength where torque is positive, less where it is negative",
        ),
        (
            SeriesCompliance,
            "actuator.*.series_compliance",
            "rad/(N m)",
            0.0,
            (0.0, 0.02),
            0.0,
            "spring between motor and joint: the encoder, on the motor, is ahead of the joint by this times the torque",
        ),
        (
            StrengthDrift,
            "actuator.*.strength_drift",
            "1/s",
            0.0,
            (-0.02, 0.02),
            ANY,
            "change of the delivered torque per time since the run's start, as a share of it, down to none",
        ),
    ];
    let first = infos.len();
    push(infos, &joint.name, &rows, |f| ActsOn::Joint(index, f));
    if joint.kind == JointKind::Prismatic {
        for info in &mut infos[first..] {
            info.unit = sliding_unit(info.unit);
        }
    }
}

/// Unit of a sliding joint's quantity, from that of a turning one's.
fn sliding_unit(unit: &'static str) -> &'static str {
    match unit {
        "kg m²" => "kg",
        "N m s/rad" => "N s/m",
        "N m" => "N",
        "1/(N m)" => "1/N",
        "rad/(N m)" => "m/N",
        "N m/rad" => "N/m",
        "N m s²/rad²" => "N s²/m²",
        "rad/s" => "m/s",
        "rad" => "m",
        other => other,
    }
}

fn link_parameters(infos: &mut Vec<ParameterInfo>, model: &Model, index: usize) {
    use LinkField::*;
    let offset = (-0.1, 0.1);
    let moment = (-1.0, 1.0);
    let rows: [Row<LinkField>; LinkField::COUNT] = [
        (MassScale, "link.*.mass_scale", "1", 1.0, (0.7, 1.3), 1e-3, "true over modelled mass (inertia scales along)"),
        (ComX, "link.*.com_x", "m", 0.0, offset, ANY, "shift of the centre of mass, link frame"),
        (ComY, "link.*.com_y", "m", 0.0, offset, ANY, "shift of the centre of mass, link frame"),
        (ComZ, "link.*.com_z", "m", 0.0, offset, ANY, "shift of the centre of mass, link frame"),
        (InertiaScale, "link.*.inertia_scale", "1", 1.0, (0.7, 1.3), 1e-3, "true over modelled rotational inertia"),
        (
            LengthScale,
            "link.*.length_scale",
            "1",
            1.0,
            (0.9, 1.1),
            1e-3,
            "true over modelled distance of shapes, further joints and the centre of mass from the link's own joint",
        ),
        (
            PayloadMass,
            "link.*.payload_mass",
            "kg",
            0.0,
            // No more is taken away than half of the link, so that the whole range means something.
            ((-0.5 * model.links[index].mass).max(-1.0), 4.0),
            ANY,
            "point mass added at the modelled centre of mass plus payload_x, y, z",
        ),
        (
            PayloadX,
            "link.*.payload_x",
            "m",
            0.0,
            offset,
            ANY,
            "position of the payload from the modelled centre of mass",
        ),
        (
            PayloadY,
            "link.*.payload_y",
            "m",
            0.0,
            offset,
            ANY,
            "position of the payload from the modelled centre of mass",
        ),
        (
            PayloadZ,
            "link.*.payload_z",
            "m",
            0.0,
            offset,
            ANY,
            "position of the payload from the modelled centre of mass",
        ),
        (
            PayloadMomentX,
            "link.*.payload_moment_x",
            "kg m",
            0.0,
            moment,
            ANY,
            "first moment of the payload about its position",
        ),
        (
            PayloadMomentY,
            "link.*.payload_moment_y",
            "kg m",
            0.0,
            moment,
            ANY,
            "first moment of the payload about its position",
        ),
        (
            PayloadMomentZ,
            "link.*.payload_moment_z",
            "kg m",
            0.0,
            moment,
            ANY,
            "first moment of the payload about its position",
        ),
    ];
    push(infos, &model.links[index].name, &rows, |f| ActsOn::Link(index, f));
}

fn geom_parameters(infos: &mut Vec<ParameterInfo>, model: &Model, index: usize) {
    use GeomField::*;
    let radius = match model.geoms[index].shape {
        Shape::Sphere(r) | Shape::Capsule { radius: r, .. } => r,
        // A skin around shapes without a radius.
        _ => 0.025,
    };
    let rows: [Row<GeomField>; GeomField::COUNT] = [
        (
            FrictionScale,
            "geom.*.friction_scale",
            "1",
            1.0,
            (0.2, 1.5),
            0.0,
            "multiplies the friction of the ground under this shape",
        ),
        (
            RadiusOffset,
            "geom.*.radius_offset",
            "m",
            0.0,
            (-0.2 * radius, 0.2 * radius),
            -radius,
            "true minus modelled radius (spheres, capsules; skin of others)",
        ),
    ];
    push(infos, &model.geoms[index].name, &rows, |f| ActsOn::Geom(index, f));
}

fn world_parameters(infos: &mut Vec<ParameterInfo>, terrain: &Terrain) {
    use WorldField::*;
    let slope = (-0.07, 0.07);
    let tilt = (-0.0524, 0.0524);
    let rows: [Row<WorldField>; WorldField::COUNT] = [
        (
            Friction,
            "contact.friction",
            "1",
            terrain.friction(),
            (0.1, 1.2),
            0.0,
            "Coulomb friction of ground without a material",
        ),
        (
            TimeConstant,
            "contact.time_constant",
            "s",
            0.008,
            (0.002, 0.05),
            1e-6,
            "time constant of the soft contact (MuJoCo solref[0])",
        ),
        (
            DampingRatio,
            "contact.damping_ratio",
            "1",
            1.0,
            (0.1, 2.0),
            1e-3,
            "damping ratio of the soft contact (MuJoCo solref[1])",
        ),
        (
            Restitution,
            "contact.restitution",
            "1",
            0.0,
            (0.0, 0.8),
            0.0,
            "rebound over impact speed: sets the damping ratio; a critically damped contact already returns 0.135",
        ),
        (
            Torsional,
            "contact.torsional_friction",
            "m",
            0.005,
            (0.0, 0.02),
            0.0,
            "torsional friction length (contact dimension 4 and 6)",
        ),
        (
            Rolling,
            "contact.rolling_friction",
            "m",
            0.0001,
            (0.0, 0.005),
            0.0,
            "rolling friction length (contact dimension 6)",
        ),
        (Height, "terrain.height", "m", 0.0, (-0.1, 0.1), ANY, "raises the terrain"),
        (
            SlopeX,
            "terrain.slope_x",
            "rad",
            0.0,
            slope,
            ANY,
            "tilts the terrain about the origin so that it rises along x",
        ),
        (
            SlopeY,
            "terrain.slope_y",
            "rad",
            0.0,
            slope,
            ANY,
            "tilts the terrain about the origin so that it rises along y",
        ),
        (PatchXMin, "terrain.patch.x_min", "m", 0.0, (-5.0, 5.0), ANY, "rectangle of other friction"),
        (
            PatchXMax,
            "terrain.patch.x_max",
            "m",
            0.0,
            (-5.0, 5.0),
            ANY,
            "rectangle of other friction (empty while max <= min)",
        ),
        (PatchYMin, "terrain.patch.y_min", "m", 0.0, (-5.0, 5.0), ANY, "rectangle of other friction"),
        (
            PatchYMax,
            "terrain.patch.y_max",
            "m",
            0.0,
            (-5.0, 5.0),
            ANY,
            "rectangle of other friction (empty while max <= min)",
        ),
        (
            PatchFriction,
            "terrain.patch.friction",
            "1",
            terrain.friction(),
            (0.05, 1.5),
            0.0,
            "Coulomb friction inside the rectangle",
        ),
        (
            ForceX,
            "external.force_x",
            "N",
            0.0,
            (-30.0, 30.0),
            ANY,
            "outside force at the base's centre of mass, world frame",
        ),
        (
            ForceY,
            "external.force_y",
            "N",
            0.0,
            (-30.0, 30.0),
            ANY,
            "outside force at the base's centre of mass, world frame",
        ),
        (
            ForceZ,
            "external.force_z",
            "N",
            0.0,
            (-30.0, 30.0),
            ANY,
            "outside force at the base's centre of mass, world frame",
        ),
        (ForceStart, "external.start", "s", 0.0, (0.0, 60.0), ANY, "time at which outside force and torques begin"),
        (
            ForceDuration,
            "external.duration",
            "s",
            UNLIMITED,
            (0.0, 60.0),
            0.0,
            "how long outside force and torques last",
        ),
        (TiltRoll, "sensor.imu.tilt_roll", "rad", 0.0, tilt, ANY, "mounting error of the IMU about x"),
        (TiltPitch, "sensor.imu.tilt_pitch", "rad", 0.0, tilt, ANY, "mounting error of the IMU about y"),
        (GyroBiasX, "sensor.imu.gyro_bias_x", "rad/s", 0.0, (-0.1, 0.1), ANY, "constant error of the gyroscope"),
        (GyroBiasY, "sensor.imu.gyro_bias_y", "rad/s", 0.0, (-0.1, 0.1), ANY, "constant error of the gyroscope"),
        (GyroBiasZ, "sensor.imu.gyro_bias_z", "rad/s", 0.0, (-0.1, 0.1), ANY, "constant error of the gyroscope"),
        (AccBiasX, "sensor.imu.acc_bias_x", "m/s²", 0.0, (-0.5, 0.5), ANY, "constant error of the accelerometer"),
        (AccBiasY, "sensor.imu.acc_bias_y", "m/s²", 0.0, (-0.5, 0.5), ANY, "constant error of the accelerometer"),
        (AccBiasZ, "sensor.imu.acc_bias_z", "m/s²", 0.0, (-0.5, 0.5), ANY, "constant error of the accelerometer"),
        (PoseDelay, "sensor.pose.delay", "s", 0.0, (0.0, 0.1), 0.0, "age of the reported base pose"),
        (FootForceScale, "sensor.foot_force.scale", "1", 1.0, (0.5, 1.5), 0.0, "reported over true foot force"),
        (
            RunStart,
            "run.start",
            "s",
            0.0,
            (0.0, 600.0),
            ANY,
            "time since the run's start at which the simulation begins: strength_drift counts from there",
        ),
        (
            SupplySag,
            "supply.sag",
            "1/W",
            0.0,
            (0.0, 0.002),
            0.0,
            "share of all motors' torque that is lost per mechanical power that they gave in the step before",
        ),
        (
            FrictionDrop,
            "contact.friction_drop",
            "1",
            0.0,
            (0.0, 0.8),
            0.0,
            "share of the ground's friction that is gone at speed, of which there is 1 - exp(-slip / friction_speed); above 1 counts as 1",
        ),
        (
            FrictionSpeed,
            "contact.friction_speed",
            "m/s",
            0.1,
            (0.01, 1.0),
            1e-6,
            "slip at which friction has lost 63 % of what it loses at speed",
        ),
        (
            YieldForce,
            "contact.yield_force",
            "N",
            UNLIMITED,
            (5.0, 200.0),
            0.0,
            "normal force of a shape beyond which the ground under it gives way for good, until the shape is out of its print",
        ),
        (
            SinkRate,
            "contact.sink_rate",
            "m/(N s)",
            0.001,
            (0.0, 0.005),
            0.0,
            "speed at which a shape sinks in for good, per normal force beyond yield_force",
        ),
    ];
    push(infos, "", &rows, ActsOn::World);
}
