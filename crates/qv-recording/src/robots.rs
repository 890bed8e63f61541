//! Robots as files: what their messages mean, as a [`Mapping`]. The built-in ones lie in `robots/` of this crate; the format is
//! described in `docs/reference/formats.md`.

use crate::RecordingError;
use crate::mapping::{Channel, ChannelFields, Mapping, MessageMapping, StreamMapping};
use crate::plan::FieldSelection;
use serde::Deserialize;
use std::collections::BTreeMap;
use toml::Table;

/// Gives the text of a file beside a robot's, or says why it cannot.
pub type Beside<'a> = dyn Fn(&str) -> Result<String, String> + 'a;

include!(concat!(env!("OUT_DIR"), "/robots.rs"));

/// A robot as its file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotFile {
    /// What it is, in a line.
    pub about: String,
    /// Its model.
    pub model: ModelSource,
    /// Whether its messages show that it is this robot; others with the same messages are asked for by name.
    pub found_by_messages: bool,
    /// What its messages mean.
    pub mapping: Mapping,
}

/// Where the model of a robot comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ModelSource {
    /// The program has it, as that of the built-in robot of this name.
    BuiltIn(String),
    /// Nobody has said.
    Nowhere,
    /// A topic of the recording.
    Recorded,
    /// A URDF or MJCF file, beside the robot's.
    File(String),
}

/// Names of the built-in robots.
pub fn names() -> impl Iterator<Item = &'static str> {
    FILES.iter().map(|(name, _)| *name)
}

/// A built-in robot; `None` for a name that is none.
pub fn built_in(name: &str) -> Option<RobotFile> {
    let (name, text) = FILES.iter().find(|(known, _)| *known == name)?;
    // A test reads every one of them.
    Some(parse(name, text, &built_in_definition).unwrap_or_else(|e| unreachable!("{e}")))
}

/// The mappings that a recording is looked at with where nobody says which robot it is of.
pub fn found_by_messages() -> Vec<Mapping> {
    names().filter_map(built_in).filter(|robot| robot.found_by_messages).map(|robot| robot.mapping).collect()
}

/// A file that built-in robots name.
fn built_in_definition(path: &str) -> Result<String, String> {
    let is_it = |name: &&str| path.strip_prefix("messages/") == Some(*name);
    let found = DEFINITIONS.iter().find(|(name, _)| is_it(name)).map(|(_, text)| (*text).to_owned());
    found.ok_or_else(|| "no such file".to_owned())
}

/// The keys of a file. Those that are absent are those of the robot that it is `like`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    #[serde(default)]
    about: String,
    #[serde(default)]
    urdf: Option<String>,
    #[serde(default)]
    generic: bool,
    #[serde(default, alias = "found_by_messages")]
    found_by_messages: bool,
    #[serde(default)]
    joints: Vec<String>,
    #[serde(default)]
    on_wire: Vec<usize>,
    #[serde(default)]
    lower: Vec<f64>,
    #[serde(default)]
    upper: Vec<f64>,
    #[serde(default)]
    effort: Vec<f64>,
    #[serde(default)]
    kp: Option<Each>,
    #[serde(default)]
    kd: Option<Each>,
    #[serde(default)]
    feet: Vec<String>,
    #[serde(default)]
    feet_on_wire: Vec<usize>,
    #[serde(default)]
    imu_position: [f64; 3],
    #[serde(default)]
    imu_rotation: Option<[f64; 3]>,
    #[serde(default)]
    definitions: BTreeMap<String, String>,
    #[serde(default)]
    stream: Vec<Stream>,
}

/// One number for all joints, or one each.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected a number for all joints, or one for each in a list")]
enum Each {
    All(f64),
    InOrder(Vec<f64>),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stream {
    role: String,
    topic: String,
    #[serde(default)]
    exact_topic: bool,
    #[serde(default)]
    endings: Vec<String>,
    #[serde(default)]
    only_endings: bool,
    #[serde(default)]
    copies: Vec<String>,
    #[serde(default)]
    optional: bool,
    messages: Vec<BTreeMap<String, Paths>>,
}

/// A field, or several that are put out one after the other.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected a field, or a list of them")]
enum Paths {
    One(String),
    Several(Vec<String>),
}

/// Channels by their keys in a file, in the order in which they are read.
const CHANNELS: [(&str, Channel); 13] = [
    ("command_position", Channel::CommandPosition),
    ("command_velocity", Channel::CommandVelocity),
    ("command_torque", Channel::CommandTorque),
    ("command_kp", Channel::CommandKp),
    ("command_kd", Channel::CommandKd),
    ("position", Channel::Position),
    ("velocity", Channel::Velocity),
    ("torque", Channel::Torque),
    ("gyro", Channel::Gyro),
    ("acceleration", Channel::Acceleration),
    ("orientation", Channel::Orientation),
    ("foot_force", Channel::FootForce),
    ("base_pose", Channel::BasePose),
];

impl Channel {
    /// Whether it is a command.
    pub(crate) fn is_command(self) -> bool {
        matches!(
            self,
            Self::CommandPosition | Self::CommandVelocity | Self::CommandTorque | Self::CommandKp | Self::CommandKd
        )
    }

    /// Whether it has a column for each joint.
    pub fn is_of_joints(self) -> bool {
        !matches!(self, Self::Gyro | Self::Acceleration | Self::Orientation | Self::FootForce | Self::BasePose)
    }
}

/// Reads the text of a robot file; `file` names it in messages, `beside` gives the files that it names.
///
/// # Errors
/// [`RecordingError::File`]: no TOML of the form, a key that is none, lists of different lengths or with an entry twice, gains
/// below 0 or not finite, a robot to be like that is not built in, a file that is not there.
pub fn parse(file: &str, text: &str, beside: &Beside) -> Result<RobotFile, RecordingError> {
    let wrong = |expected: &str, found: String| RecordingError::file(file, expected, found);
    let mut table: Table = toml::from_str(text.trim_start_matches('\u{feff}'))
        .map_err(|e| wrong("a robot in TOML", e.to_string().trim().replace('\n', " / ")))?;
    let like = table.remove("like");
    let mut owner = like.as_ref().and_then(|v| v.as_str()).map(str::to_owned);
    let own_definitions = table.contains_key("definitions");
    let mut whole = match &like {
        None => Table::new(),
        Some(like) => {
            let known = like.as_str().and_then(|name| FILES.iter().find(|(known, _)| *known == name));
            let names = || names().collect::<Vec<_>>().join(", ");
            let (_, text) =
                known.ok_or_else(|| wrong(&format!("a built-in robot as `like` ({})", names()), like.to_string()))?;
            toml::from_str(text).unwrap_or_else(|e| unreachable!("{e}"))
        }
    };
    // A built-in robot may be like another one itself.
    if let Some(base) = whole.remove("like").and_then(|v| v.as_str().map(str::to_owned)) {
        let text = FILES.iter().find(|(known, _)| *known == base).map_or("", |(_, text)| text);
        let mut below: Table = toml::from_str(text).unwrap_or_else(|e| unreachable!("{e}"));
        if !whole.contains_key("urdf") {
            owner = Some(base);
        }
        below.extend(whole);
        whole = below;
    }
    // Being like a robot that messages show is not being reported by them.
    whole.remove("found_by_messages");
    whole.extend(table);
    let own: File = whole
        .try_into()
        .map_err(|e: toml::de::Error| wrong("the keys of a robot file", e.to_string().trim().replace('\n', " / ")))?;
    let texts: &Beside = if own_definitions { beside } else { &built_in_definition };
    own.robot(file, owner, texts)
}

impl File {
    /// `owner` is the built-in robot below it, whose model it may have.
    fn robot(self, file: &str, owner: Option<String>, beside: &Beside) -> Result<RobotFile, RecordingError> {
        self.check(file)?;
        let wrong = |expected: String, found: String| RecordingError::file(file, expected, found);
        let mut definitions = Vec::new();
        for (name, path) in &self.definitions {
            let text = beside(path).map_err(|e| wrong(format!("the definition of {name} in `{path}`"), e))?;
            definitions.push((name.clone(), text));
        }
        let streams = self.stream.iter().map(|s| self.stream(file, s)).collect::<Result<_, _>>()?;
        // Where the messages have the names, one number stands for all.
        let n = self.joints.len().max(1);
        let spread = |each: &Each| match each {
            Each::All(x) => vec![*x; n],
            Each::InOrder(list) => list.clone(),
        };
        let gains = match (&self.kp, &self.kd) {
            (None, None) => None,
            (kp, kd) => Some([kp, kd].map(|each| each.as_ref().map_or(vec![0.0; n], spread))),
        };
        let (model, description_topic) = match self.urdf.as_deref() {
            None | Some("none") => (ModelSource::Nowhere, None),
            Some("built in") => (ModelSource::BuiltIn(owner.unwrap_or_else(|| self.name.clone())), None),
            Some(topic) if topic.starts_with('/') && !topic.contains('.') => {
                (ModelSource::Recorded, Some(topic.to_owned()))
            }
            Some(path) => (ModelSource::File(path.to_owned()), None),
        };
        let mapping = Mapping {
            robot: self.name,
            generic: self.generic,
            joint_names: self.joints,
            position_limits: self.lower.into_iter().zip(self.upper).collect(),
            effort_limits: self.effort,
            foot_names: self.feet,
            imu_position: self.imu_position,
            imu_rotation: self.imu_rotation,
            gains,
            description_topic,
            definitions,
            streams,
        };
        Ok(RobotFile { about: self.about, model, found_by_messages: self.found_by_messages, mapping })
    }

    /// Gains are one number, or a list that goes by `joints`, of numbers that gains can be.
    fn check_gains(&self, file: &str) -> Result<(), RecordingError> {
        for (key, each) in [("kp", &self.kp), ("kd", &self.kd)] {
            let numbers = match each {
                Some(Each::All(x)) => std::slice::from_ref(x),
                Some(Each::InOrder(list)) if self.joints.is_empty() => {
                    let expected = format!("one number as `{key}`, or `joints` that a list goes by");
                    return Err(RecordingError::file(file, expected, format!("a list of {}", list.len())));
                }
                Some(Each::InOrder(list)) => list,
                None => continue,
            };
            if let Some(odd) = numbers.iter().find(|x| !x.is_finite() || **x < 0.0) {
                return Err(RecordingError::file(
                    file,
                    format!("finite numbers of at least 0 as `{key}`"),
                    odd.to_string(),
                ));
            }
        }
        Ok(())
    }

    /// Lists that belong together are as long as each other.
    fn check(&self, file: &str) -> Result<(), RecordingError> {
        self.check_gains(file)?;
        let n = self.joints.len();
        let of = |each: &Option<Each>| match each {
            Some(Each::InOrder(list)) => list.len(),
            Some(Each::All(_)) | None => n,
        };
        let lists = [
            ("on_wire", self.on_wire.len(), false),
            ("lower", self.lower.len(), false),
            ("upper", self.upper.len(), self.lower.len() != self.upper.len()),
            ("effort", self.effort.len(), false),
            ("kp", of(&self.kp), false),
            ("kd", of(&self.kd), false),
        ];
        for (name, length, alone) in lists {
            if (length != 0 && length != n) || alone {
                let expected = format!("{n} numbers as `{name}`, one for each of `joints`");
                return Err(RecordingError::file(file, expected, length.to_string()));
            }
        }
        if !self.feet_on_wire.is_empty() && self.feet_on_wire.len() != self.feet.len() {
            let expected = format!("{} numbers as `feet_on_wire`, one for each of `feet`", self.feet.len());
            return Err(RecordingError::file(file, expected, self.feet_on_wire.len().to_string()));
        }
        for (key, list) in [("on_wire", &self.on_wire), ("feet_on_wire", &self.feet_on_wire)] {
            if let Some((_, twice)) = list.iter().enumerate().find(|(i, x)| list[..*i].contains(x)) {
                return Err(RecordingError::file(file, format!("each of `{key}` once"), format!("{twice} twice")));
            }
        }
        for (what, list) in [("joints", &self.joints), ("feet", &self.feet)] {
            if let Some(twice) = list.iter().enumerate().find(|(i, x)| list[..*i].contains(x)) {
                return Err(RecordingError::file(
                    file,
                    format!("each of `{what}` once"),
                    format!("`{}` twice", twice.1),
                ));
            }
        }
        Ok(())
    }

    fn stream(&self, file: &str, stream: &Stream) -> Result<StreamMapping, RecordingError> {
        let messages = stream.messages.iter().map(|m| self.message(file, &stream.role, m)).collect::<Result<_, _>>()?;
        Ok(StreamMapping {
            role: stream.role.clone(),
            preferred_topic: stream.topic.clone(),
            exact_topic: stream.exact_topic,
            endings: stream.endings.clone(),
            only_endings: stream.only_endings,
            copies: stream.copies.clone(),
            optional: stream.optional,
            messages,
        })
    }

    fn message(
        &self,
        file: &str,
        role: &str,
        keys: &BTreeMap<String, Paths>,
    ) -> Result<MessageMapping, RecordingError> {
        let wrong = |expected: String, found: String| {
            Err(RecordingError::file(file, format!("{expected} in a message of the stream `{role}`"), found))
        };
        let text = |key: &str| match keys.get(key) {
            Some(Paths::One(text)) => Some(text.clone()),
            _ => None,
        };
        let Some(name) = text("name") else { return wrong("a `name`".into(), "none".into()) };
        let names = text("names");
        let is_known =
            |key: &&String| ["name", "names"].contains(&key.as_str()) || CHANNELS.iter().any(|(known, _)| known == key);
        if let Some(odd) = keys.keys().find(|key| !is_known(key)) {
            let known = CHANNELS.map(|(key, _)| key).join(", ");
            return wrong(format!("keys among name, names, {known}"), format!("`{odd}`"));
        }
        let mut fields = Vec::new();
        for (key, channel) in CHANNELS {
            let paths = match keys.get(key) {
                None => continue,
                Some(Paths::One(path)) => std::slice::from_ref(path),
                Some(Paths::Several(paths)) => paths,
            };
            fields.push(self.channel(channel, paths, names.is_some()));
        }
        Ok(MessageMapping { name, names, fields })
    }

    /// The fields of a channel: a list whose elements are the joints, feet or axes, or fields of one number each.
    fn channel(&self, channel: Channel, paths: &[String], is_named: bool) -> ChannelFields {
        let (n, feet) = (self.joints.len(), self.feet.len());
        let or_all = |order: &[usize], n: usize| if order.is_empty() { (0..n).collect() } else { order.to_vec() };
        let elements: Vec<usize> = match channel {
            _ if is_named => Vec::new(),
            Channel::FootForce => or_all(&self.feet_on_wire, feet),
            Channel::Gyro | Channel::Acceleration => vec![0, 1, 2],
            Channel::Orientation => vec![0, 1, 2, 3],
            Channel::BasePose => (0..7).collect(),
            _ => or_all(&self.on_wire, n),
        };
        let single = paths.len() > 1;
        let fields = paths.iter().map(|path| FieldSelection {
            path: path.clone(),
            elements: if single { vec![0] } else { elements.clone() },
        });
        ChannelFields { channel, fields: fields.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::schema::Schema;

    #[test]
    fn every_built_in_robot_is_read_and_its_messages_have_its_fields() {
        for name in names() {
            let robot = built_in(name).unwrap();
            assert_eq!((robot.mapping.robot.as_str(), robot.about.is_empty()), (name, false));
            let mut compiled = 0;
            for message in robot.mapping.streams.iter().flat_map(|s| &s.messages) {
                let own = robot.mapping.definitions.iter().find(|(known, _)| *known == message.name);
                let text = own.map(|(_, text)| text.clone()).or_else(|| crate::definitions::standard(&message.name));
                let text = text.unwrap_or_else(|| panic!("{name}: no definition of {}", message.name));
                let schema = Schema::parse(&message.name, &text).unwrap();
                let wanted: Vec<FieldSelection> = message.fields.iter().flat_map(|f| f.fields.clone()).collect();
                if message.names.is_none() && wanted.iter().all(|w| !w.elements.is_empty()) {
                    Plan::compile(&schema, &wanted).unwrap_or_else(|e| panic!("{name}: {e}"));
                    compiled += 1;
                }
            }
            assert!(compiled >= 4, "{name}: {compiled}");
            let mut wires: Vec<usize> = robot
                .mapping
                .streams
                .iter()
                .flat_map(|s| &s.messages)
                .flat_map(|m| &m.fields)
                .find(|f| f.channel == Channel::Position)
                .unwrap()
                .fields[0]
                .elements
                .clone();
            wires.sort_unstable();
            assert_eq!(wires, (0..robot.mapping.joint_names.len()).collect::<Vec<_>>(), "{name}");
        }
        assert_eq!(found_by_messages().len(), 3);
        assert!(built_in("nobody").is_none());
    }

    #[test]
    fn a_file_may_be_like_a_built_in_one() {
        let none = |_: &str| Err("there is none".to_owned());
        let robot = parse(
            "mine.toml",
            "like = \"b2\"\nname = \"mine\"\nurdf = \"b2.xml\"\nkp = 200.0\nkd = [1,1,1,1,1,1,1,1,1,1,1,1]",
            &none,
        )
        .unwrap();
        let b2 = built_in("b2").unwrap();
        assert_eq!(robot.model, ModelSource::File("b2.xml".into()));
        assert_eq!(robot.mapping.gains, Some([vec![200.0; 12], vec![1.0; 12]]));
        let mut same = robot.mapping;
        (same.robot, same.gains) = ("b2".into(), None);
        assert_eq!(same, b2.mapping);
    }

    #[test]
    fn a_model_and_gains_go_with_a_new_name() {
        let none = |_: &str| Err("there is none".to_owned());
        let read = |text: &str| parse("mine.toml", text, &none).unwrap();
        assert_eq!(built_in("go2").unwrap().model, ModelSource::BuiltIn("go2".into()));
        assert_eq!(read("like = \"go2\"\nname = \"x\"").model, ModelSource::BuiltIn("go2".into()));
        assert_eq!(read("like = \"b2\"\nname = \"x\"").model, ModelSource::Nowhere);
        assert_eq!(read("like = \"b2\"\nname = \"x\"\nurdf = \"built in\"").model, ModelSource::BuiltIn("b2".into()));
        let arm = read("like = \"ros2_control\"\nname = \"arm\"\nkp = 50");
        assert_eq!(arm.mapping.gains, Some([vec![50.0], vec![0.0]]));
    }

    #[test]
    fn what_is_wrong_with_a_file_is_named() {
        let none = |_: &str| Err("there is none".to_owned());
        let cases: [(&str, &[&str]); 16] = [
            ("name = ", &["mine.toml", "TOML"]),
            ("like = \"spot\"\nname = \"x\"", &["`like`", "go2", "spot"]),
            ("about = \"x\"", &["`name`"]),
            ("name = \"x\"\ncolour = 1", &["`colour`"]),
            ("name = \"x\"\njoints = [\"a\", \"b\"]\non_wire = [0]", &["2 numbers as `on_wire`", "found 1"]),
            ("name = \"x\"\njoints = [\"a\", \"a\"]", &["`joints` once", "`a` twice"]),
            ("name = \"x\"\nkp = [3.0]", &["one number as `kp`", "`joints`", "a list of 1"]),
            ("name = \"x\"\nkp = -3", &["`kp`", "at least 0", "found -3"]),
            ("like = \"go2\"\nname = \"x\"\nkd = nan", &["`kd`", "finite", "found NaN"]),
            ("name = \"x\"\njoints = [\"a\", \"b\"]\nkp = [1, inf]", &["`kp`", "found inf"]),
            ("name = \"x\"\njoints = [\"a\", \"b\"]\non_wire = [1, 1]", &["`on_wire` once", "1 twice"]),
            ("name = \"x\"\nfeet = [\"a\", \"b\"]\nfeet_on_wire = [0, 0]", &["`feet_on_wire` once", "0 twice"]),
            ("name = \"x\"\nlower = [1]\njoints = [\"a\"]", &["`upper`", "found 0"]),
            ("name = \"x\"\nfeet = [\"a\"]\nfeet_on_wire = [0, 1]", &["`feet_on_wire`", "found 2"]),
            ("name = \"x\"\n[definitions]\n\"a/msg/B\" = \"b.msg\"", &["a/msg/B", "`b.msg`", "there is none"]),
            (
                "name = \"x\"\n[[stream]]\nrole = \"r\"\ntopic = \"/t\"\nmessages = [{ name = \"a\", speed = \"v\" }]",
                &["`r`", "`speed`", "velocity"],
            ),
        ];
        for (text, words) in cases {
            let error = parse("mine.toml", text, &none).unwrap_err().to_string();
            for word in words {
                assert!(error.contains(word), "{text}: expected `{word}` in `{error}`");
            }
        }
    }
}
