//! `run.toml`: what is known of the robot.

use super::dialect::{Unit, stated_unit};
use crate::RecordingError;
use crate::commanded::{CommandReading, Shape};
use crate::run::{Actuator, ActuatorKind, Base, GainSource, JointParameters, Loss};
use qv_core::JointSeries;
use serde::Deserialize;
use std::collections::BTreeMap;

/// `run.toml`.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Description {
    pub robot: String,
    base: Option<String>,
    /// `s`, `ms`, `us` or `ns`; found by the size of stamps where it is not stated.
    time_unit: Option<String>,
    /// `rad` or `deg`, of all joints.
    position_unit: Option<String>,
    actuator: Option<ActuatorTable>,
    imu: Option<ImuTable>,
    commands: Option<CommandTable>,
    #[serde(default)]
    joint: BTreeMap<String, JointTable>,
}

/// The word for a number that is not known.
#[derive(Debug, Clone, Copy, Deserialize)]
enum Word {
    #[serde(rename = "unknown")]
    Unknown,
}

/// A number for all joints, one for each in the order of the columns, or one by name.
#[derive(Debug, Clone, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, numbers in the order of the columns, numbers by joint, or \"unknown\""
)]
enum Each {
    Unknown(Word),
    All(f64),
    InOrder(Vec<f64>),
    ByName(BTreeMap<String, f64>),
}

#[derive(Debug, Clone, Deserialize)]
struct ActuatorTable {
    kind: String,
    kp: Option<Each>,
    kd: Option<Each>,
    tau_max: Option<Each>,
    /// A servo of `qv_sim::servos`, of all joints.
    servo: Option<String>,
    friction_model: Option<String>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct ImuTable {
    /// Roll, pitch, yaw \[rad\].
    rotation: Option<[f64; 3]>,
}

/// How the commands of all joints are read.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
struct CommandTable {
    /// Added to their stamps \[s\].
    delay: Option<f64>,
    kp_scale: Option<f64>,
    kd_scale: Option<f64>,
    /// In place of those logged \[N m s/rad\].
    kd: Option<f64>,
    feed_forward: Option<bool>,
    low_pass: Option<f64>,
    ramp: Option<f64>,
    hold: Option<f64>,
    rate_limit: Option<f64>,
}

const OF_COMMANDS: [&str; 9] =
    ["delay", "kp_scale", "kd_scale", "kd", "feed_forward", "low_pass", "ramp", "hold", "rate_limit"];

#[derive(Debug, Clone, Default, Deserialize)]
struct JointTable {
    /// -1 where the joint's axis is the other way round in all channels.
    sign: Option<f64>,
    /// The joint in whose columns this one stands, in all channels.
    columns_of: Option<String>,
    /// The joint whose columns hold its commands.
    command_of: Option<String>,
    command_scale: Option<f64>,
    command_offset: Option<f64>,
    armature: Option<f64>,
    coulomb_friction: Option<f64>,
    viscous_friction: Option<f64>,
    position_offset: Option<f64>,
    kp: Option<f64>,
    kd: Option<f64>,
    tau_max: Option<f64>,
    servo: Option<String>,
    friction_model: Option<String>,
    /// Those of `qv_sim::servos::KEYS`; others are reported as unknown.
    #[serde(flatten)]
    more: BTreeMap<String, toml::Value>,
}

const OF_ACTUATORS: [&str; 6] = ["kind", "kp", "kd", "tau_max", "servo", "friction_model"];
const OF_JOINTS: [&str; 14] = [
    "sign",
    "columns_of",
    "command_of",
    "command_scale",
    "command_offset",
    "armature",
    "coulomb_friction",
    "viscous_friction",
    "position_offset",
    "kp",
    "kd",
    "tau_max",
    "servo",
    "friction_model",
];

/// The name that `run.toml` gives for the robot: a name such as `go2`, or the file of a URDF or MJCF.
///
/// # Errors
/// When the text is not TOML of the stated form.
pub fn robot_of(toml_text: &str) -> Result<String, RecordingError> {
    Ok(parse_description(toml_text)?.robot)
}

/// Whether `run.toml` says how the IMU is mounted.
///
/// # Errors
/// When the text is not TOML of the stated form.
pub fn states_imu(toml_text: &str) -> Result<bool, RecordingError> {
    Ok(parse_description(toml_text)?.imu_rotation().is_some())
}

impl Each {
    fn numbers(&self) -> Vec<f64> {
        match self {
            Self::Unknown(_) => Vec::new(),
            Self::All(x) => vec![*x],
            Self::InOrder(list) => list.clone(),
            Self::ByName(map) => map.values().copied().collect(),
        }
    }

    /// The number of each joint; `None` where it is not stated.
    fn of(&self, key: &str, joints: &[String]) -> Result<Vec<Option<f64>>, RecordingError> {
        match self {
            Self::Unknown(_) => {
                let expected = format!("numbers as actuator `{key}`; one that is unknown is that of all joints");
                Err(RecordingError::file("run.toml", expected, "`unknown`"))
            }
            Self::All(x) => Ok(vec![Some(*x); joints.len()]),
            Self::InOrder(list) if list.len() == joints.len() => Ok(list.iter().copied().map(Some).collect()),
            Self::InOrder(list) => {
                let expected = format!("a number or {} of them as actuator `{key}`, one for each joint", joints.len());
                Err(RecordingError::file("run.toml", expected, list.len().to_string()))
            }
            Self::ByName(map) => match map.keys().find(|name| !joints.contains(name)) {
                Some(name) => {
                    let expected = format!("joints of run.csv in actuator `{key}`");
                    Err(RecordingError::file("run.toml", expected, format!("`{name}`")))
                }
                None => Ok(joints.iter().map(|j| map.get(j).copied()).collect()),
            },
        }
    }
}

pub(super) fn parse_description(text: &str) -> Result<Description, RecordingError> {
    let found = |e: toml::de::Error| e.to_string().trim().replace('\n', " / ");
    let text = text.trim_start_matches('\u{feff}');
    let description: Description =
        toml::from_str(text).map_err(|e| RecordingError::file("run.toml", "a run description", found(e)))?;
    let numbers = description.joint.iter().flat_map(|(name, j)| {
        let all = [j.armature, j.coulomb_friction, j.viscous_friction, j.position_offset, j.kp, j.kd, j.tau_max];
        all.into_iter().flatten().map(move |x| (name.clone(), x))
    });
    let actuator = description.actuator.iter().flat_map(|a| [&a.kp, &a.kd, &a.tau_max].into_iter().flatten());
    let actuator = actuator.flat_map(Each::numbers);
    let imu = description.imu_rotation().into_iter().flatten().map(|x| ("imu".to_string(), x));
    for (name, x) in numbers.chain(actuator.map(|x| ("actuator".to_string(), x))).chain(imu) {
        if !x.is_finite() {
            return Err(RecordingError::file("run.toml", format!("finite numbers in `{name}`"), x.to_string()));
        }
    }
    description.check_signs()?;
    Ok(description)
}

/// Keys of `run.toml` that mean nothing here, such as misspelt ones.
pub(super) fn unknown_keys(text: &str) -> Vec<String> {
    let Ok(table) = text.trim_start_matches('\u{feff}').parse::<toml::Table>() else { return Vec::new() };
    let mut unknown = Vec::new();
    let mut check = |at: &str, table: &toml::Table, known: &[&str]| {
        unknown.extend(table.keys().filter(|k| !known.contains(&k.as_str())).map(|k| format!("{at}{k}")));
    };
    check(
        "",
        &table,
        &["robot", "base", "time_unit", "position_unit", "actuator", "imu", "commands", "joint", "dataset"],
    );
    if let Some(commands) = table.get("commands").and_then(toml::Value::as_table) {
        check("commands.", commands, &OF_COMMANDS);
    }
    if let Some(imu) = table.get("imu").and_then(toml::Value::as_table) {
        check("imu.", imu, &["rotation"]);
    }
    if let Some(actuator) = table.get("actuator").and_then(toml::Value::as_table) {
        check("actuator.", actuator, &OF_ACTUATORS);
    }
    for (name, joint) in table.get("joint").and_then(toml::Value::as_table).into_iter().flatten() {
        if let Some(joint) = joint.as_table() {
            let known: Vec<&str> = OF_JOINTS.into_iter().chain(qv_sim::servos::KEYS).collect();
            check(&format!("joint.{name}."), joint, &known);
        }
    }
    unknown
}

/// Gains of the joints where they are not the same for all \[N m/rad and N m s/rad\], shape `[n]`.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Gains {
    kp: Option<Vec<f64>>,
    kd: Option<Vec<f64>>,
}

impl Gains {
    /// As commands that hold from `time` on.
    pub(super) fn series(self, time: f64) -> [Option<JointSeries>; 2] {
        [self.kp, self.kd]
            .map(|gains| gains.map(|values| JointSeries { time: vec![time], joints: values.len(), values }))
    }
}

impl Description {
    /// Gains, limits, friction and rotor inertias are at least 0; an offset may be less.
    fn check_signs(&self) -> Result<(), RecordingError> {
        let of_all = self.actuator.iter().flat_map(|a| [("kp", &a.kp), ("kd", &a.kd), ("tau_max", &a.tau_max)]);
        let of_all = of_all.flat_map(|(key, each)| {
            each.iter().flat_map(Each::numbers).map(move |x| (format!("`{key}` of [actuator]"), x))
        });
        let of_joints = self.joint.iter().flat_map(|(name, j)| {
            let own = [
                ("armature", j.armature),
                ("coulomb_friction", j.coulomb_friction),
                ("viscous_friction", j.viscous_friction),
                ("kp", j.kp),
                ("kd", j.kd),
                ("tau_max", j.tau_max),
            ];
            let may_be_less = ["constant_torque", "spring_rest"];
            let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|x| x as f64));
            let more = j.more.iter().filter(move |(key, _)| !may_be_less.contains(&key.as_str()));
            let more = more.map(move |(key, v)| (key.as_str(), number(v)));
            own.into_iter().chain(more).filter_map(move |(key, x)| Some((format!("`{key}` of [joint.{name}]"), x?)))
        });
        match of_all.chain(of_joints).find(|(_, x)| *x < 0.0) {
            Some((key, x)) => Err(RecordingError::file("run.toml", format!("{key} of at least 0"), x.to_string())),
            None => Ok(()),
        }
    }

    /// Roll, pitch and yaw of the IMU on the base \[rad\], where they are stated.
    pub(super) fn imu_rotation(&self) -> Option<[f64; 3]> {
        self.imu.and_then(|imu| imu.rotation)
    }

    /// For each of `joints` the column that it stands in, in all channels, and its sign there.
    pub(super) fn columns(&self, joints: &[String]) -> Result<Vec<(usize, f64)>, RecordingError> {
        let one = |(k, name): (usize, &String)| {
            let Some(own) = self.joint.get(name) else { return Ok((k, 1.0)) };
            let sign = own.sign.unwrap_or(1.0);
            if sign.abs() != 1.0 {
                let expected = format!("1 or -1 as `sign` of [joint.{name}]");
                return Err(RecordingError::file("run.toml", expected, sign.to_string()));
            }
            let Some(other) = &own.columns_of else { return Ok((k, sign)) };
            let expected = || format!("a joint as `columns_of` of [joint.{name}]");
            let place = joints.iter().position(|j| j == other);
            let wrong = || RecordingError::file("run.toml", expected(), format!("`{other}`"));
            Ok((place.ok_or_else(wrong)?, sign))
        };
        joints.iter().enumerate().map(one).collect()
    }

    /// How the commands of `joints` are read.
    pub(super) fn command_reading(&self, joints: &[String]) -> Result<CommandReading, RecordingError> {
        let mut reading = CommandReading::plain(joints.len());
        for (k, name) in joints.iter().enumerate() {
            let Some(own) = self.joint.get(name) else { continue };
            let of = &mut reading.joints[k];
            (of.scale, of.offset) = (own.command_scale.unwrap_or(1.0), own.command_offset.unwrap_or(0.0));
            if let Some(other) = &own.command_of {
                let place = joints.iter().position(|j| j == other);
                let wrong = || {
                    RecordingError::file(
                        "run.toml",
                        format!("a joint as `command_of` of [joint.{name}]"),
                        format!("`{other}`"),
                    )
                };
                of.of = place.ok_or_else(wrong)?;
            }
        }
        let all = self.commands.unwrap_or_default();
        reading.delay = all.delay.unwrap_or(0.0);
        reading.gain_scale = [all.kp_scale.unwrap_or(1.0), all.kd_scale.unwrap_or(1.0)];
        reading.damping = all.kd;
        reading.uses_feed_forward = all.feed_forward.unwrap_or(true);
        let shapes = [
            all.low_pass.map(Shape::LowPass),
            all.ramp.map(Shape::Ramp),
            all.hold.map(Shape::Hold),
            all.rate_limit.map(Shape::RateLimit),
        ];
        reading.shape = shapes.into_iter().flatten().next();
        let is_positive = reading.shape.is_none_or(|s| s.size() > 0.0 && s.size().is_finite());
        match is_positive {
            true => Ok(reading),
            false => Err(RecordingError::file("run.toml", "a size above 0 in [commands]", "another")),
        }
    }

    /// Whether positions, speeds and their commands are in degrees.
    pub(super) fn is_in_degrees(&self) -> Result<bool, RecordingError> {
        match self.position_unit.as_deref() {
            None | Some("rad") => Ok(false),
            Some("deg") => Ok(true),
            Some(word) => Err(RecordingError::file("run.toml", "position_unit rad or deg", format!("`{word}`"))),
        }
    }

    /// The unit of time, where it is stated.
    pub(super) fn time_unit(&self) -> Result<Option<Unit>, RecordingError> {
        let Some(word) = &self.time_unit else { return Ok(None) };
        let unit = stated_unit(word);
        let wrong = || RecordingError::file("run.toml", "time_unit s, ms, us or ns", format!("`{word}`"));
        unit.map(Some).ok_or_else(wrong)
    }

    pub(super) fn base(&self) -> Result<Option<Base>, RecordingError> {
        match self.base.as_deref() {
            Some("fixed") => Ok(Some(Base::Fixed)),
            Some("free") => Ok(Some(Base::Free)),
            None => Ok(None),
            Some(other) => Err(RecordingError::file("run.toml", "base = \"fixed\" or \"free\"", format!("`{other}`"))),
        }
    }

    /// The law of all joints, and the gains of each where those differ.
    pub(super) fn actuator(&self, joints: &[String]) -> Result<(Actuator, Gains), RecordingError> {
        let own = |of: fn(&JointTable) -> Option<f64>| {
            joints.iter().map(|j| self.joint.get(j).and_then(of)).collect::<Vec<_>>()
        };
        let (kp, kd, kind) = match &self.actuator {
            None => (None, None, ActuatorKind::Pd),
            Some(table) => {
                let kind = match table.kind.as_str() {
                    "pd" => ActuatorKind::Pd,
                    "torque" => ActuatorKind::Torque,
                    other => {
                        let found = format!("`{other}`");
                        return Err(RecordingError::file("run.toml", "actuator kind \"pd\" or \"torque\"", found));
                    }
                };
                (table.kp.as_ref(), table.kd.as_ref(), kind)
            }
        };
        let (kp, each_kp) = gain("kp", kp, &own(|j| j.kp), joints)?;
        let (kd, each_kd) = gain("kd", kd, &own(|j| j.kd), joints)?;
        let tau_max = match self.actuator.as_ref().and_then(|a| a.tau_max.as_ref()) {
            Some(Each::All(x)) => Some(*x),
            _ => None,
        };
        let gains = [(kp, &each_kp), (kd, &each_kd)].map(|(of_all, each)| match (of_all, each) {
            (Some(Gain::Unknown), None) => GainSource::Unknown,
            _ => GainSource::Stated,
        });
        let number = |of_all: Option<Gain>| of_all.and_then(Gain::number);
        let actuator = Actuator { kind, kp: number(kp), kd: number(kd), tau_max, gains };
        Ok((actuator, Gains { kp: each_kp, kd: each_kd }))
    }

    /// What is stated of each joint. Tables of joints that are not there are lost.
    pub(super) fn joint_parameters(
        &self,
        joints: &[String],
        lost: &mut Vec<Loss>,
    ) -> Result<Vec<JointParameters>, RecordingError> {
        for name in self.joint.keys().filter(|name| !joints.contains(name)) {
            lost.push(Loss {
                file: "run.toml".into(),
                what: format!(
                    "[joint.{name}]: no such joint in run.csv: {}",
                    qv_sim::names::unknown("joint", name, joints.iter().map(String::as_str))
                ),
                span: None,
            });
        }
        let tau_max = match self.actuator.as_ref().and_then(|a| a.tau_max.as_ref()) {
            // One for all stands in the actuator's law.
            Some(Each::All(_)) | None => vec![None; joints.len()],
            Some(each) => each.of("tau_max", joints)?,
        };
        let one = |(name, tau_max): (&String, Option<f64>)| {
            let own = JointTable::default();
            let j = self.joint.get(name).unwrap_or(&own);
            let mut servo = self.servo(name, j)?;
            let mut of_servo = |key: &str| servo.remove(key);
            Ok(JointParameters {
                armature: j.armature.or(of_servo("armature")),
                coulomb_friction: j.coulomb_friction.or(of_servo("coulomb_friction")),
                viscous_friction: j.viscous_friction.or(of_servo("viscous_friction")),
                position_offset: j.position_offset,
                tau_max: j.tau_max.or(tau_max),
                servo,
            })
        };
        joints.iter().zip(tau_max).map(one).collect()
    }

    /// Friction of a joint by the servo it is said to be, then by its own keys; what its friction model does not have is left out.
    fn servo(&self, name: &str, own: &JointTable) -> Result<BTreeMap<String, f64>, RecordingError> {
        let general = self.actuator.as_ref();
        let servo = own.servo.as_ref().or(general.and_then(|a| a.servo.as_ref()));
        let model = own.friction_model.as_ref().or(general.and_then(|a| a.friction_model.as_ref()));
        let mut all = BTreeMap::new();
        if let Some(servo) = servo {
            let names = qv_sim::servos::SERVOS.map(|s| s.name);
            let unknown = |_| {
                let found = qv_sim::names::unknown("servo", servo, names);
                RecordingError::file("run.toml", format!("a servo of {}", names.join(", ")), found)
            };
            let known = qv_sim::servos::servo(servo).map_err(unknown)?;
            all.extend(known.values.iter().map(|(key, value)| (key.to_string(), *value)));
        }
        for (key, value) in own.more.iter().filter(|(key, _)| qv_sim::servos::KEYS.contains(&key.as_str())) {
            let number = value.as_float().or(value.as_integer().map(|x| x as f64)).filter(|x| x.is_finite());
            let expected = || format!("a number as `{key}` of [joint.{name}]");
            let wrong = || RecordingError::file("run.toml", expected(), value.to_string());
            all.insert(key.clone(), number.ok_or_else(wrong)?);
        }
        if let Some(model) = model {
            let wrong =
                || RecordingError::file("run.toml", "friction_model m1, m2, m3, m4, m5 or m6", format!("`{model}`"));
            let keys = qv_sim::servos::keys_of_model(model).ok_or_else(wrong)?;
            let of_friction = qv_sim::servos::keys_of_model("m6").unwrap_or_default();
            all.retain(|key, _| keys.contains(&key.as_str()) || !of_friction.contains(&key.as_str()));
        }
        Ok(all)
    }
}

/// A gain of all joints.
#[derive(Debug, Clone, Copy)]
enum Gain {
    Number(f64),
    Unknown,
}

impl Gain {
    fn number(self) -> Option<f64> {
        match self {
            Self::Number(x) => Some(x),
            Self::Unknown => None,
        }
    }
}

/// One gain for all joints, or one for each: a joint's own holds before the actuator's.
type OneOrEach = (Option<Gain>, Option<Vec<f64>>);

fn gain(key: &str, stated: Option<&Each>, own: &[Option<f64>], joints: &[String]) -> Result<OneOrEach, RecordingError> {
    let is_one = own.iter().all(Option::is_none);
    match stated {
        Some(Each::All(x)) if is_one => return Ok((Some(Gain::Number(*x)), None)),
        Some(Each::Unknown(_)) if is_one => return Ok((Some(Gain::Unknown), None)),
        None if is_one => return Ok((None, None)),
        _ => {}
    }
    let general = stated.map_or_else(|| Ok(vec![None; joints.len()]), |each| each.of(key, joints))?;
    let each: Vec<Option<f64>> = own.iter().zip(&general).map(|(own, general)| own.or(*general)).collect();
    // Gains of zero are a decision to be written down, not what a forgotten line means.
    if let Some(j) = each.iter().position(Option::is_none) {
        let expected = format!("`{key}` of every joint, or of none");
        return Err(RecordingError::file("run.toml", expected, format!("none of `{}`", joints[j])));
    }
    Ok((None, Some(each.into_iter().flatten().collect())))
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOINTS: [&str; 2] = ["hip", "a.b/c d"];

    fn gains(toml: &str) -> Result<(Actuator, Gains), String> {
        let joints = JOINTS.map(String::from);
        let text = format!("robot = \"r.urdf\"\n{toml}");
        parse_description(&text).and_then(|d| d.actuator(&joints)).map_err(|e| e.to_string())
    }

    #[test]
    fn gains_of_all_and_of_each() {
        let (law, each) = gains("[actuator]\nkind = \"pd\"\nkp = 20\nkd = 0.5").unwrap();
        assert_eq!((law.kp, law.kd, each), (Some(20.0), Some(0.5), Gains::default()));
        let (law, each) = gains("[actuator]\nkind = \"pd\"\nkp = [20, 30]\nkd = 1").unwrap();
        assert_eq!((law.kp, law.kd, each.kp), (None, Some(1.0), Some(vec![20.0, 30.0])));
        let by_name = "[actuator]\nkind = \"pd\"\nkp = { \"a.b/c d\" = 3, hip = 2 }";
        assert_eq!(gains(by_name).unwrap().1.kp, Some(vec![2.0, 3.0]));
        let own = "[actuator]\nkind = \"pd\"\nkp = 20\n[joint.hip]\nkp = 7\n[joint.\"a.b/c d\"]\ntau_max = 3";
        assert_eq!(gains(own).unwrap().1.kp, Some(vec![7.0, 20.0]));
    }

    fn of_hip(toml: &str) -> Result<JointParameters, String> {
        let text = format!("robot = \"r.urdf\"\n{toml}");
        let of = |d: Description| d.joint_parameters(&JOINTS.map(String::from), &mut Vec::new());
        parse_description(&text).and_then(of).map(|all| all[0].clone()).map_err(|e| e.to_string())
    }

    #[test]
    fn friction_of_a_servo_is_its_own_or_a_published_one() {
        let own = of_hip("[joint.hip]\nstribeck_friction = 0.2\nconstant_torque = -1").unwrap();
        assert_eq!((own.servo["stribeck_friction"], own.servo["constant_torque"]), (0.2, -1.0));
        let published = of_hip("[actuator]\nkind = \"pd\"\nservo = \"mx106\"\n[joint.hip]\narmature = 0.5").unwrap();
        assert_eq!((published.armature, published.viscous_friction), (Some(0.5), Some(0.05072)));
        assert_eq!(published.servo["load_friction_motor"], 0.198);
        let m2 = of_hip("[joint.hip]\nservo = \"mx106\"\nfriction_model = \"m2\"").unwrap();
        assert_eq!(m2.servo.keys().collect::<Vec<_>>(), ["stribeck_exponent", "stribeck_friction", "stribeck_speed"]);
        for (toml, word) in [
            ("[joint.hip]\nservo = \"mx107\"", "mx106"),
            ("[joint.hip]\nfriction_model = \"m9\"", "m6"),
            ("[joint.hip]\nstribeck_speed = \"slow\"", "stribeck_speed"),
            ("[joint.hip]\nquadratic_drag = -1", "quadratic_drag"),
        ] {
            let error = of_hip(toml).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn gains_that_fit_no_joints_are_errors() {
        for (toml, word) in [
            ("[actuator]\nkind = \"pd\"\nkp = [20, 30, 40]", "2 of them"),
            ("[actuator]\nkind = \"pd\"\nkp = { knee = 2 }", "`knee`"),
            ("[actuator]\nkind = \"pd\"\nkp = { hip = 2 }", "none of `a.b/c d`"),
            ("[joint.hip]\nkd = 2", "`kd` of every joint"),
            ("[actuator]\nkind = \"pd\"\nkp = [20, inf]", "finite"),
            ("[actuator]\nkind = \"pd\"\nkp = \"20\"", "run description"),
            ("[actuator]\nkind = \"pd\"\nkp = -20", "`kp` of [actuator] of at least 0, found -20"),
            ("[actuator]\nkind = \"pd\"\nkd = { hip = -1 }", "`kd` of [actuator]"),
            ("[joint.hip]\nkp = -2", "`kp` of [joint.hip] of at least 0, found -2"),
        ] {
            let error = gains(toml).unwrap_err();
            assert!(error.contains(word), "{toml}: expected `{word}` in `{error}`");
        }
    }
}
