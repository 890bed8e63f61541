//! Tidy tables become runs: `run.csv` with one column per channel and joint, `run.toml` with what is known of the robot.

use crate::ReplayError;
use crate::bag::{slot, source};
use crate::clean::{Samples, columns, put_in_order};
use crate::faults;
use crate::mapping::{Channel, Mapping};
use crate::run::*;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io::Read;

/// `run.toml`.
#[derive(Debug, Clone, Deserialize)]
struct Description {
    robot: String,
    base: Option<String>,
    actuator: Option<ActuatorTable>,
    #[serde(default)]
    joint: BTreeMap<String, JointTable>,
}

#[derive(Debug, Clone, Deserialize)]
struct ActuatorTable {
    kind: String,
    kp: Option<f64>,
    kd: Option<f64>,
    tau_max: Option<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct JointTable {
    armature: Option<f64>,
    coulomb_friction: Option<f64>,
    viscous_friction: Option<f64>,
    position_offset: Option<f64>,
}

/// The name that `run.toml` gives for the robot: a name such as `go2`, or a file name ending in `.urdf`.
///
/// # Errors
/// When the text is not TOML of the stated form.
pub fn robot_of(toml_text: &str) -> Result<String, ReplayError> {
    Ok(parse_description(toml_text)?.robot)
}

fn parse_description(text: &str) -> Result<Description, ReplayError> {
    let found = |e: toml::de::Error| e.to_string().trim().replace('\n', " / ");
    let description: Description =
        toml::from_str(text).map_err(|e| ReplayError::file("run.toml", "a run description", found(e)))?;
    let numbers = description.joint.iter().flat_map(|(name, j)| {
        let all = [j.armature, j.coulomb_friction, j.viscous_friction, j.position_offset];
        all.into_iter().flatten().map(move |x| (name.clone(), x))
    });
    let actuator = description.actuator.iter().flat_map(|a| [a.kp, a.kd, a.tau_max].into_iter().flatten());
    for (name, x) in numbers.chain(actuator.map(|x| ("actuator".to_string(), x))) {
        if !x.is_finite() {
            return Err(ReplayError::file("run.toml", format!("finite numbers in `{name}`"), x.to_string()));
        }
    }
    Ok(description)
}

/// Keys of `run.toml` that mean nothing here, such as misspelt ones.
fn unknown_keys(text: &str) -> Vec<String> {
    let Ok(table) = text.parse::<toml::Table>() else { return Vec::new() };
    let mut unknown = Vec::new();
    let mut check = |at: &str, table: &toml::Table, known: &[&str]| {
        unknown.extend(table.keys().filter(|k| !known.contains(&k.as_str())).map(|k| format!("{at}{k}")));
    };
    check("", &table, &["robot", "base", "actuator", "joint"]);
    if let Some(actuator) = table.get("actuator").and_then(toml::Value::as_table) {
        check("actuator.", actuator, &["kind", "kp", "kd", "tau_max"]);
    }
    for (name, joint) in table.get("joint").and_then(toml::Value::as_table).into_iter().flatten() {
        if let Some(joint) = joint.as_table() {
            let known = ["armature", "coulomb_friction", "viscous_friction", "position_offset"];
            check(&format!("joint.{name}."), joint, &known);
        }
    }
    unknown
}

/// Reads a tidy table. `toml_text` is `run.toml`; `urdf` the text of the URDF that it names; `mapping` that of the
/// robot that it names, for the order and limits of its joints. Blank cells are "not measured".
///
/// # Errors
/// No `time` column, no position column, no row, an unknown word in `run.toml`. Bad cells and rows, and unknown
/// columns are named in the run instead.
pub fn read_table(
    csv: impl Read,
    toml_text: &str,
    urdf: Option<&str>,
    mapping: Option<&Mapping>,
) -> Result<Run, ReplayError> {
    let description = parse_description(toml_text)?;
    let base = match description.base.as_deref() {
        Some("fixed") => Some(Base::Fixed),
        Some("free") => Some(Base::Free),
        None => None,
        Some(other) => return Err(ReplayError::file("run.toml", "base = \"fixed\" or \"free\"", format!("`{other}`"))),
    };
    let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(csv);
    let header = reader.headers().map_err(|e| ReplayError::file("run.csv", "a header line", e.to_string()))?.clone();
    let mut lost: Vec<Loss> = unknown_keys(toml_text)
        .into_iter()
        .map(|key| Loss {
            file: "run.toml".into(),
            what: format!("key `{key}` ignored: it means nothing here"),
            span: None,
        })
        .collect();
    let layout = Layout::new(&header, mapping, &mut lost)?;
    let samples = read_rows(&mut reader, &layout, &mut lost)?;
    let mut faults = Vec::new();
    layout.report_names(mapping, &mut faults);
    let mut samples = put_in_order(samples, "run.csv", true, &mut faults);
    let start = samples.time.first().copied().unwrap_or(0.0);
    samples.time.iter_mut().for_each(|t| *t -= start);
    faults.iter_mut().for_each(|f| f.time -= start);
    let source = source("run.csv", "tidy table", &samples.time, Clock::Column, true);
    let robot = match urdf {
        Some(text) => Robot::Urdf(text.to_string()),
        None => Robot::Named(description.robot.clone()),
    };
    let joint_parameters = joint_parameters(&description, &layout.joints, &mut lost);
    let mut run = Run {
        robot,
        base: Base::Fixed,
        joint_names: layout.joints.clone(),
        foot_names: Vec::new(),
        imu_position: mapping.map_or([0.0; 3], |m| m.imu_position),
        actuator: actuator(&description)?,
        joint_parameters,
        commands: Commands::default(),
        measured: Measurements::default(),
        epoch: 0,
        sources: vec![source],
        faults,
        lost,
        told: Vec::new(),
    };
    for (channel, first, width) in &layout.groups {
        *slot(&mut run, *channel) = columns(&samples, *first, *width);
    }
    if run.measured.position.is_none() {
        return Err(ReplayError::run("run.csv", "at least one row with a `pos.<joint>` value", "none"));
    }
    let m = &run.measured;
    let free = m.base_pose.is_some() || m.acceleration.is_some() || m.orientation.is_some();
    run.base = base.unwrap_or(if free { Base::Free } else { Base::Fixed });
    if run.commands == Commands::default() {
        let detail = "expected columns cmd_pos.<joint> or cmd_tau.<joint>, found none".into();
        run.faults.push(Fault { kind: FaultKind::Missing, channel: "commands".into(), time: 0.0, count: 1, detail });
    }
    faults::examine(&mut run, mapping);
    Ok(run)
}

fn actuator(description: &Description) -> Result<Actuator, ReplayError> {
    let Some(table) = &description.actuator else {
        return Ok(Actuator { kind: ActuatorKind::Pd, kp: None, kd: None, tau_max: None });
    };
    let kind = match table.kind.as_str() {
        "pd" => ActuatorKind::Pd,
        "torque" => ActuatorKind::Torque,
        other => {
            return Err(ReplayError::file("run.toml", "actuator kind \"pd\" or \"torque\"", format!("`{other}`")));
        }
    };
    Ok(Actuator { kind, kp: table.kp, kd: table.kd, tau_max: table.tau_max })
}

fn joint_parameters(description: &Description, joints: &[String], lost: &mut Vec<Loss>) -> Vec<JointParameters> {
    for name in description.joint.keys().filter(|name| !joints.contains(name)) {
        lost.push(Loss {
            file: "run.toml".into(),
            what: format!("[joint.{name}]: no such joint in run.csv"),
            span: None,
        });
    }
    let one = |name: &String| match description.joint.get(name) {
        None => JointParameters::default(),
        Some(j) => JointParameters {
            armature: j.armature,
            coulomb_friction: j.coulomb_friction,
            viscous_friction: j.viscous_friction,
            position_offset: j.position_offset,
            tau_max: None,
        },
    };
    joints.iter().map(one).collect()
}

/// Which column of the file goes where.
struct Layout {
    joints: Vec<String>,
    /// Names found that the robot does not have, and names that it has but were not found.
    strange: Vec<String>,
    absent: Vec<String>,
    time: usize,
    /// Target of each file column.
    target: Vec<Option<usize>>,
    /// Channel, first target column, width.
    groups: Vec<(Channel, usize, usize)>,
    width: usize,
    names: Vec<String>,
}

const JOINT_CHANNELS: [(&str, Channel); 6] = [
    ("cmd_pos.", Channel::CommandPosition),
    ("cmd_vel.", Channel::CommandVelocity),
    ("cmd_tau.", Channel::CommandTorque),
    ("pos.", Channel::Position),
    ("vel.", Channel::Velocity),
    ("tau.", Channel::Torque),
];

const VECTOR_CHANNELS: [(&str, Channel, &[&str]); 4] = [
    ("base.", Channel::BasePose, &["x", "y", "z", "qw", "qx", "qy", "qz"]),
    ("imu.", Channel::Orientation, &["qw", "qx", "qy", "qz"]),
    ("gyro.", Channel::Gyro, &["x", "y", "z"]),
    ("acc.", Channel::Acceleration, &["x", "y", "z"]),
];

impl Layout {
    fn new(header: &csv::StringRecord, mapping: Option<&Mapping>, lost: &mut Vec<Loss>) -> Result<Self, ReplayError> {
        let names: Vec<String> = header.iter().map(|h| h.trim_start_matches('\u{feff}').trim().to_string()).collect();
        let found = || names.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
        let Some(time) = names.iter().position(|n| n == "time") else {
            return Err(ReplayError::file("run.csv", "a column `time`", format!("columns {}", found())));
        };
        let mut seen: Vec<String> = Vec::new();
        for name in &names {
            let joint = JOINT_CHANNELS.iter().find_map(|(prefix, _)| name.strip_prefix(prefix));
            if let Some(joint) = joint.filter(|j| !j.is_empty() && !seen.iter().any(|s| s == j)) {
                seen.push(joint.to_string());
            }
        }
        if !names.iter().any(|n| n.starts_with("pos.")) {
            return Err(ReplayError::file("run.csv", "columns `pos.<joint>`", format!("columns {}", found())));
        }
        if seen.is_empty() {
            return Err(ReplayError::file(
                "run.csv",
                "joint names in columns `pos.<joint>`",
                format!("columns {}", found()),
            ));
        }
        let joints = mapping.map_or(seen.clone(), |m| m.joint_names.clone());
        let strange: Vec<String> = seen.iter().filter(|s| !joints.contains(s)).cloned().collect();
        let absent: Vec<String> = joints.iter().filter(|j| !seen.contains(j)).cloned().collect();
        if seen.iter().all(|s| strange.contains(s)) {
            let expected = format!("joints such as {}", joints[0]);
            return Err(ReplayError::file("run.csv", expected, format!("joints {}", seen.join(", "))));
        }
        let mut layout =
            Self { joints, strange, absent, time, target: Vec::new(), groups: Vec::new(), width: 0, names };
        layout.assign(lost);
        Ok(layout)
    }

    fn assign(&mut self, lost: &mut Vec<Loss>) {
        let mut places: BTreeMap<String, usize> = BTreeMap::new();
        for (prefix, channel) in JOINT_CHANNELS {
            if self.names.iter().any(|n| n.strip_prefix(prefix).is_some_and(|j| self.joints.iter().any(|k| k == j))) {
                self.groups.push((channel, self.width, self.joints.len()));
                for (k, joint) in self.joints.iter().enumerate() {
                    places.insert(format!("{prefix}{joint}"), self.width + k);
                }
                self.width += self.joints.len();
            }
        }
        for (prefix, channel, parts) in VECTOR_CHANNELS {
            if parts.iter().all(|p| self.names.contains(&format!("{prefix}{p}"))) {
                self.groups.push((channel, self.width, parts.len()));
                for (k, part) in parts.iter().enumerate() {
                    places.insert(format!("{prefix}{part}"), self.width + k);
                }
                self.width += parts.len();
            }
        }
        let mut taken = vec![false; self.width];
        let mut ignored = Vec::new();
        for (column, name) in self.names.iter().enumerate() {
            let place = places.get(name).copied().filter(|&p| !std::mem::replace(&mut taken[p], true));
            if place.is_none() && column != self.time {
                ignored.push(name.as_str());
            }
            self.target.push(place);
        }
        if !ignored.is_empty() {
            let what = format!("columns ignored: {}", ignored.join(", "));
            lost.push(Loss { file: "run.csv".into(), what, span: None });
        }
    }

    fn report_names(&self, mapping: Option<&Mapping>, faults: &mut Vec<Fault>) {
        let Some(mapping) = mapping else { return };
        if self.absent.is_empty() && self.strange.is_empty() {
            return;
        }
        let mut detail = format!(
            "expected the {} joints of {}, found {}",
            self.joints.len(),
            mapping.robot,
            self.joints.len() - self.absent.len() + self.strange.len()
        );
        for (word, names) in [("without", &self.absent), ("with unknown", &self.strange)] {
            if !names.is_empty() {
                detail += &format!("; {word} {}", names.join(", "));
            }
        }
        let count = self.absent.len() + self.strange.len();
        faults.push(Fault { kind: FaultKind::WrongRobot, channel: "joints".into(), time: 0.0, count, detail });
    }
}

fn read_rows(
    reader: &mut csv::Reader<impl Read>,
    layout: &Layout,
    lost: &mut Vec<Loss>,
) -> Result<Samples, ReplayError> {
    let mut samples = Samples { width: layout.width, ..Default::default() };
    let mut record = csv::ByteRecord::new();
    let mut bad = BadCells::default();
    // The reader stands before the second half of a line's end where that has two: one line behind.
    let behind = 2_u64.saturating_sub(reader.position().line());
    loop {
        match reader.read_byte_record(&mut record) {
            Ok(false) => break,
            Ok(true) => {}
            Err(error) => {
                let what = format!("after line {}: {error}: the rest is missing", reader.position().line() + behind);
                lost.push(Loss { file: "run.csv".into(), what, span: None });
                break;
            }
        }
        // The record's own is that of a blank line before it, the reader's the next one's unless the last has no end.
        let own = record.position().map_or(0, |p| p.line());
        let line = own.max(reader.position().line().saturating_sub(1)) + behind;
        if record.len() == 1 && record[0].is_empty() {
            continue;
        }
        let Some(time) = record.get(layout.time).and_then(number).filter(|t| t.is_finite()) else {
            bad.rows
                .get_or_insert((line, String::from_utf8_lossy(record.get(layout.time).unwrap_or(b"")).into_owned()));
            bad.row_count += 1;
            continue;
        };
        if record.len() != layout.names.len() {
            bad.short.get_or_insert((line, record.len()));
            bad.short_count += 1;
        }
        samples.time.push(time);
        let base = samples.rows.len();
        samples.rows.resize(base + layout.width, f64::NAN);
        for (column, target) in layout.target.iter().enumerate() {
            let (Some(target), Some(cell)) = (target, record.get(column)) else { continue };
            match number(cell) {
                Some(x) => samples.rows[base + target] = x,
                None if cell.is_empty() => {}
                None => bad.cell(line, &layout.names[column], cell),
            }
        }
    }
    bad.report(layout, lost);
    if samples.time.is_empty() {
        let found = if bad.row_count > 0 { format!("{} rows, none with a time", bad.row_count) } else { "none".into() };
        return Err(ReplayError::file("run.csv", "at least one row", found));
    }
    Ok(samples)
}

fn number(cell: &[u8]) -> Option<f64> {
    std::str::from_utf8(cell).ok()?.trim().parse().ok()
}

#[derive(Default)]
struct BadCells {
    rows: Option<(u64, String)>,
    row_count: usize,
    short: Option<(u64, usize)>,
    short_count: usize,
    cell: Option<(u64, String, String)>,
    cell_count: usize,
}

impl BadCells {
    fn cell(&mut self, line: u64, column: &str, cell: &[u8]) {
        self.cell.get_or_insert_with(|| (line, column.to_string(), String::from_utf8_lossy(cell).into_owned()));
        self.cell_count += 1;
    }

    fn report(&self, layout: &Layout, lost: &mut Vec<Loss>) {
        let mut lose = |what: String| lost.push(Loss { file: "run.csv".into(), what, span: None });
        if let Some((line, found)) = &self.rows {
            lose(format!("line {line}: expected a time, found `{found}` ({} such rows skipped)", self.row_count));
        }
        if let Some((line, found)) = self.short {
            let (expected, count) = (layout.names.len(), self.short_count);
            lose(format!("line {line}: expected {expected} cells, found {found} ({count} such rows)"));
        }
        if let Some((line, column, found)) = &self.cell {
            let count = self.cell_count;
            lose(format!("line {line}, column {column}: expected a number, found `{found}` ({count} such cells)"));
        }
    }
}
