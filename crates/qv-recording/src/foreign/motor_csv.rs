//! CSV files whose columns are fields of a robot's own messages, motor by motor, in whatever spelling their logger has: `motor_state[3].q`,
//! `/topic/motor_state/3/dq`, `q_3`, `FR_hip_tau_est`, `imu_state.quaternion[0]`, `imu_gyro_x`, `motor_cmd_3_q`.

use super::{Table, quoted};
use crate::RecordingError;
use crate::mapping::{Channel, Mapping};

/// Which motor of the wire each joint is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Motors {
    /// Names of the joints, in the model's order.
    pub joints: Vec<String>,
    /// Index of each on the wire, where it is known.
    pub wire: Option<Vec<usize>>,
    /// Number of the first motor in the file, where it is not 0.
    pub first: Option<usize>,
}

impl Motors {
    /// Those of a robot's messages.
    pub fn of(mapping: &Mapping) -> Self {
        let fields = mapping.streams.iter().flat_map(|stream| &stream.messages).flat_map(|message| &message.fields);
        let positions = fields.filter(|field| field.channel == Channel::Position);
        let wire =
            positions.flat_map(|field| &field.fields).find(|wanted| wanted.elements.len() == mapping.joint_names.len());
        Self { joints: mapping.joint_names.clone(), wire: wire.map(|wanted| wanted.elements.clone()), first: None }
    }

    /// The same for a file that counts its motors from 1: it has one with the number of motors, and none with 0.
    fn counted_in(&self, names: &[&str]) -> Self {
        let has = |index: usize| {
            let one = Self { joints: vec!["joint".into(); index + 1], ..Self::default() };
            let others = Self { joints: vec!["joint".into(); index], ..Self::default() };
            // It is known with a motor of that number, and is not without.
            names
                .iter()
                .any(|name| role(name, &one).is_some_and(|r| r.starts_with("pos.")) && role(name, &others).is_none())
        };
        let from_one = !has(0) && has(self.joints.len());
        Self { first: from_one.then_some(1), ..self.clone() }
    }

    fn at(&self, index: usize) -> Option<&str> {
        let index = index.checked_sub(self.first.unwrap_or(0))?;
        let joint = match &self.wire {
            Some(wire) => wire.iter().position(|one| *one == index)?,
            None => index,
        };
        self.joints.get(joint).map(String::as_str)
    }

    /// The joint that a column means by `FR_hip`, `fr_hip_joint` or the like.
    fn named(&self, name: &str) -> Option<&str> {
        let plain = |name: &str| name.to_lowercase().trim_end_matches("_joint").to_string();
        self.joints.iter().find(|joint| plain(joint) == plain(name)).map(String::as_str)
    }
}

/// Fields of a motor, and the prefixes of a table's columns for what was measured and what was commanded.
const FIELDS: [(&str, [&str; 2]); 10] = [
    ("tau_est", ["tau.", ""]),
    ("tauest", ["tau.", ""]),
    ("torque", ["tau.", "cmd_tau."]),
    ("tau", ["tau.", "cmd_tau."]),
    ("dq", ["vel.", "cmd_vel."]),
    ("velocity", ["vel.", "cmd_vel."]),
    ("qd", ["vel.", "cmd_vel."]),
    ("position", ["pos.", "cmd_pos."]),
    ("pos", ["pos.", "cmd_pos."]),
    ("q", ["pos.", "cmd_pos."]),
];
/// Words that say that a column is a command.
const COMMANDS: [&str; 6] = ["cmd", "target", "des", "desired", "ref", "command"];
/// Words of the IMU, with the group of columns that they are.
const IMU: [(&str, &str); 9] = [
    ("quaternion", "imu.q"),
    ("quat", "imu.q"),
    ("gyroscope", "gyro."),
    ("gyro", "gyro."),
    ("angular_velocity", "gyro."),
    ("accelerometer", "acc."),
    ("accel", "acc."),
    ("acc", "acc."),
    ("linear_acceleration", "acc."),
];
const TIMES: [&str; 12] = [
    "time",
    "time_s",
    "t",
    "timestamp",
    "ts",
    "stamp",
    "time_ms",
    "time_us",
    "time_ns",
    "timestamp_s",
    "timestamp_ns",
    "tick",
];

/// Whether a header has motors' positions in one of those spellings, and a time.
pub fn is_motor_csv(header: &str, motors: &Motors) -> bool {
    let bare = |name: &'_ str| name.trim().trim_matches('"').trim_start_matches(['#', ' ']).to_string();
    let names: Vec<String> = header.trim_start_matches('\u{feff}').split([',', ';', '\t']).map(bare).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let is_table = names.iter().any(|name| name.get(..4).is_some_and(|start| start.eq_ignore_ascii_case("pos.")));
    !is_table
        && time_of(&names).is_some()
        && names.iter().any(|name| role(name, motors).is_some_and(|r| r.starts_with("pos.")))
}

fn time_of(names: &[&str]) -> Option<usize> {
    TIMES.iter().find_map(|time| names.iter().position(|name| spelled(name) == *time))
}

/// Lower case, words joined by `_`.
fn spelled(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.map(str::to_lowercase).collect::<Vec<_>>().join("_")
}

/// The column of a table that a column of the file is.
fn role(name: &str, motors: &Motors) -> Option<String> {
    let name = spelled(name);
    // A logger's own words, such as the topic, come before those of the message.
    let name = ["motor", "imu"].iter().find_map(|word| name.find(word).map(|at| &name[at..])).unwrap_or(&name);
    if let Some(found) = imu(name) {
        return Some(found);
    }
    // `q3` is `q_3`.
    let mut words: Vec<String> = vec![];
    for word in name.split('_') {
        let letters = word.trim_end_matches(|c: char| c.is_ascii_digit());
        let splits = letters.len() < word.len() && FIELDS.iter().any(|(field, _)| *field == letters);
        match splits {
            true => words.extend([letters.to_string(), word[letters.len()..].to_string()]),
            false => words.push(word.to_string()),
        }
    }
    let is_command = words.iter().any(|word| COMMANDS.contains(&word.as_str()));
    words.retain(|word| {
        !COMMANDS.contains(&word.as_str()) && !["motor", "state", "motorstate"].contains(&word.as_str())
    });
    let indices: Vec<usize> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let rest =
        words.iter().filter(|word| word.parse::<usize>().is_err()).map(String::as_str).collect::<Vec<_>>().join("_");
    let (prefixes, joint) = match indices[..] {
        [index] => {
            let rest = rest.trim_start_matches("joint_");
            let prefixes = FIELDS.iter().find(|(field, _)| *field == rest).map(|(_, prefixes)| prefixes);
            (prefixes?, motors.at(index)?)
        }
        [] => FIELDS.iter().find_map(|(field, prefixes)| {
            let before = rest.strip_suffix(field).and_then(|head| head.strip_suffix('_'));
            let behind = rest.strip_prefix(field).and_then(|tail| tail.strip_prefix('_'));
            before.or(behind).and_then(|joint| motors.named(joint)).map(|joint| (prefixes, joint))
        })?,
        _ => return None,
    };
    let prefix = prefixes[usize::from(is_command)];
    (!prefix.is_empty()).then(|| format!("{prefix}{joint}"))
}

fn imu(name: &str) -> Option<String> {
    let rest = name.strip_prefix("imu_").unwrap_or(name);
    let rest = rest.strip_prefix("state_").unwrap_or(rest);
    if let Some(axis) = ["qw", "qx", "qy", "qz"].iter().find(|axis| rest == **axis) {
        return Some(format!("imu.{axis}"));
    }
    let (group, axis) =
        IMU.iter().find_map(|(word, group)| Some((*group, rest.strip_prefix(word)?.strip_prefix('_')?)))?;
    let axes: &[&str] = if group == "imu.q" { &["w", "x", "y", "z"] } else { &["x", "y", "z"] };
    let axis =
        axes.iter().enumerate().find(|(k, known)| axis == **known || axis == k.to_string()).map(|(_, axis)| axis)?;
    Some(format!("{group}{axis}"))
}

/// A table of the text of such a file.
///
/// # Errors
/// No column is a time or a motor's position, or a row cannot be parsed as CSV.
pub fn table(text: &str, motors: &Motors) -> Result<Table, RecordingError> {
    let fault = |expected: &str, found: String| RecordingError::file("CSV of motors", expected, found);
    let text = text.trim_start_matches('\u{feff}');
    let header_line = text.lines().next().unwrap_or_default();
    let separator =
        [b',', b';', b'\t'].into_iter().max_by_key(|s| (header_line.bytes().filter(|b| b == s).count(), *s == b','));
    let mut reader = csv::ReaderBuilder::new();
    let reader = reader.flexible(true).trim(csv::Trim::All).delimiter(separator.unwrap_or(b','));
    let mut reader = reader.from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| fault("a header line", e.to_string()))?.clone();
    let names: Vec<&str> = header.iter().collect();
    let shown = || format!("columns {}", names.iter().take(8).copied().collect::<Vec<_>>().join(", "));
    let time = time_of(&names).ok_or_else(|| fault("a column with the time (time, timestamp, t, tick)", shown()))?;
    // A unit in the name holds.
    let unit = ["_s", "_ms", "_us", "_ns"].into_iter().find(|unit| spelled(names[time]).ends_with(unit));
    let motors = &motors.counted_in(&names);
    let (mut kept, mut unused) = (vec![(time, format!("time{}", unit.unwrap_or_default()))], vec![]);
    for (column, name) in names.iter().enumerate().filter(|(column, _)| *column != time) {
        match role(name, motors).filter(|role| !kept.iter().any(|(_, known)| known == role)) {
            Some(role) => kept.push((column, role)),
            None => unused.push(*name),
        }
    }
    if !kept.iter().any(|(_, role)| role.starts_with("pos.")) {
        return Err(fault("a column with the position of a motor, such as motor_state[0].q or q_0", shown()));
    }
    let mut csv = kept.iter().map(|(_, role)| quoted(role)).collect::<Vec<_>>().join(",");
    csv.push('\n');
    for record in reader.records() {
        let record = record.map_err(|e| fault("rows of a table", e.to_string()))?;
        let cells: Vec<String> =
            kept.iter().map(|(column, _)| quoted(record.get(*column).unwrap_or_default())).collect();
        csv.push_str(&cells.join(","));
        csv.push('\n');
    }
    let mut remarks: Vec<String> =
        motors.first.iter().map(|first| format!("motors are counted from {first}")).collect();
    remarks.push(format!("columns are fields of motors: {} of {} are channels of a run", kept.len(), names.len()));
    if !unused.is_empty() {
        let some = unused.iter().take(6).copied().collect::<Vec<_>>().join(", ");
        remarks.push(format!("not used: {some}{}", if unused.len() > 6 { ", ..." } else { "" }));
    }
    Ok(Table { csv, remarks, lost: vec![] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    fn motors() -> Motors {
        let joints = ["FL_hip_joint", "FL_thigh_joint", "FR_hip_joint", "FR_thigh_joint"].map(String::from).to_vec();
        Motors { joints, wire: Some(vec![2, 3, 0, 1]), first: None }
    }

    #[test]
    fn columns_are_known_in_many_spellings() {
        for (name, expected) in [
            ("motor_state[0].q", "pos.FR_hip_joint"),
            ("/topic/motor_state[3]/dq", "vel.FL_thigh_joint"),
            ("motorState.2.tauEst", "tau.FL_hip_joint"),
            ("q_1", "pos.FR_thigh_joint"),
            ("q1", "pos.FR_thigh_joint"),
            ("tau_est_2", "tau.FL_hip_joint"),
            ("FR_hip_q", "pos.FR_hip_joint"),
            ("FL_thigh_tau_est", "tau.FL_thigh_joint"),
            ("dq_FL_hip_joint", "vel.FL_hip_joint"),
            ("motor_cmd[0].q", "cmd_pos.FR_hip_joint"),
            ("q_des_3", "cmd_pos.FL_thigh_joint"),
            ("low.motor_cmd[1].tau", "cmd_tau.FR_thigh_joint"),
            ("imu_state.quaternion[0]", "imu.qw"),
            ("imu_qz", "imu.qz"),
            ("imu_gyro_x", "gyro.x"),
            ("gyroscope_2", "gyro.z"),
            ("imu_state.accelerometer[1]", "acc.y"),
        ] {
            assert_eq!(role(name, &motors()).as_deref(), Some(expected), "{name}");
        }
        for name in [
            "FR_hip_mode",
            "bms_soc",
            "q_9",
            "imu_temp",
            "imu_rpy_x",
            "foot_FL",
            "wireless_remote_3",
            "FR_hip_ddq",
            "q_1_2",
            "",
        ] {
            assert_eq!(role(name, &motors()), None, "{name}");
        }
    }

    #[test]
    fn motors_may_be_counted_from_one() {
        let table = table("time,q_1,q_2,q_3,q_4\n0,1,2,3,4\n", &motors()).unwrap();
        let header = "time,pos.FR_hip_joint,pos.FR_thigh_joint,pos.FL_hip_joint,pos.FL_thigh_joint";
        assert_eq!(
            (table.csv.as_str(), table.remarks[0].as_str()),
            (&*format!("{header}\n0,1,2,3,4\n"), "motors are counted from 1")
        );
    }

    #[test]
    fn a_file_becomes_a_table() {
        let text = "\u{feff}time_s;q_0;q_1;q_2;q_3;temp_0\n0;1;2;3;4;30\n0.1;1;2;3;\"5\";31\n";
        assert!(is_motor_csv(text.lines().next().unwrap(), &motors()));
        let table = table(text, &motors()).unwrap();
        let header = "time_s,pos.FR_hip_joint,pos.FR_thigh_joint,pos.FL_hip_joint,pos.FL_thigh_joint";
        assert_eq!(table.csv, format!("{header}\n0,1,2,3,4\n0.1,1,2,3,5\n"));
        assert_eq!(table.remarks[1], "not used: temp_0");
        assert!(!is_motor_csv("\"time\",\"POS.a\",\"q_0\"", &motors()), "a table in quotes is a table");
        assert!(!is_motor_csv("time,pos.a,q_0", &motors()) && !is_motor_csv("q_0,q_1", &motors()));
        let error = |text: &str| super::table(text, &motors()).unwrap_err().to_string();
        assert!(error("q_0\n1\n").states("column"));
        assert!(error("t,x\n1,2\n").states("position"));
    }
}
