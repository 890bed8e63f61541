//! Tidy tables become runs: `run.csv` with one column per channel and joint, `run.toml` with what is known of the robot.

mod description;
mod dialect;

use crate::RecordingError;
use crate::bag::{slot, source};
use crate::clean::{Samples, columns, put_in_order};
use crate::faults;
use crate::imu;
use crate::mapping::{Channel, Mapping};
use crate::run::*;
use description::{parse_description, unknown_keys};
use dialect::{Cells, Unit};
use qv_core::Pose;
use qv_sim::{Model, ModelOptions};
use std::collections::BTreeMap;
use std::io::Read;

pub use description::{robot_of, states_imu};
pub(crate) use dialect::unit_of_time;

/// Reads a tidy table. `toml_text` is `run.toml`; `urdf` the text of the URDF that it names; `mapping` that of the
/// robot that it names, for the order and limits of its joints. Blank cells are "not measured". The text may be an MJCF's; how an
/// IMU is mounted is read from a URDF alone then, and left to the caller ([`states_imu`], [`imu::to_trunk`]).
///
/// Separators (`,` `;` tab `|`), decimal commas and the unit of time are found by looking, and reported.
///
/// # Errors
/// No `time` column, no position column, no row, an unknown word in `run.toml`. Bad cells and rows, and unknown
/// columns are named in the run instead.
pub fn read_table(
    csv: impl Read,
    toml_text: &str,
    urdf: Option<&str>,
    mapping: Option<&Mapping>,
) -> Result<Run, RecordingError> {
    let description = parse_description(toml_text)?;
    let base = description.base()?;
    let csv = dialect::in_utf8(csv).map_err(|e| RecordingError::file("run.csv", "a readable file", e))?;
    let (separator, separator_name, csv) = dialect::separator(csv);
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).delimiter(separator).from_reader(csv);
    let header = reader.headers().map_err(|e| RecordingError::file("run.csv", "a header line", e.to_string()))?.clone();
    let mut remarks = Vec::new();
    if separator != b',' {
        remarks.push(format!("run.csv: columns lie between {separator_name}"));
    }
    let mut lost: Vec<Loss> = unknown_keys(toml_text)
        .into_iter()
        .map(|key| Loss {
            file: "run.toml".into(),
            what: format!("key `{key}` ignored: it means nothing here"),
            span: None,
        })
        .collect();
    let layout = Layout::new(&header, mapping, &mut lost)?;
    let unit = description.time_unit()?.or(layout.unit);
    let (samples, unit) = read_rows(&mut reader, &layout, unit, &mut lost, &mut remarks)?;
    let mut faults = Vec::new();
    layout.report_names(mapping, &mut faults);
    if samples.time.len() == 1 {
        let detail = format!("expected rows at several times, found one ({unit})");
        faults.push(Fault {
            kind: FaultKind::Missing,
            channel: "run.csv".into(),
            time: samples.time[0],
            count: 1,
            detail,
        });
    }
    let mut samples = put_in_order(samples, "run.csv", true, &mut faults);
    let start = samples.time.first().copied().unwrap_or(0.0);
    samples.time.iter_mut().for_each(|t| *t -= start);
    faults.iter_mut().for_each(|f| f.time -= start);
    let source = source("run.csv", "tidy table", &samples.time, Clock::Column, true);
    let robot = match urdf {
        Some(text) => Robot::Urdf(text.to_string()),
        None => Robot::Named(description.robot.clone()),
    };
    let joint_parameters = description.joint_parameters(&layout.joints, &mut lost)?;
    let (actuator, gains) = description.actuator(&layout.joints)?;
    let [kp, kd] = gains.series(samples.time.first().copied().unwrap_or(0.0));
    let mut run = Run {
        robot,
        base: Base::Fixed,
        joint_names: layout.joints.clone(),
        foot_names: Vec::new(),
        imu_position: mapping.map_or([0.0; 3], |m| m.imu_position),
        actuator,
        joint_parameters,
        commands: Commands::default(),
        measured: Measurements::default(),
        epoch: 0,
        sources: vec![source],
        faults,
        lost,
        remarks,
    };
    let in_degrees = description.is_in_degrees()?;
    let places = description.columns(&layout.joints)?;
    for (channel, first, width) in &layout.groups {
        let mut series = columns(&samples, *first, *width);
        if let (Some(series), true) = (&mut series, in_degrees && OF_ANGLES.contains(channel)) {
            series.values.iter_mut().for_each(|x| *x = x.to_radians());
        }
        if let (Some(series), true) = (&mut series, channel.is_of_joints()) {
            place_joints(series, &places);
        }
        *slot(&mut run, *channel) = series;
    }
    if run.measured.position.is_none() {
        let dropped = run.faults.iter().find(|fault| fault.kind == FaultKind::NotFinite);
        let found = dropped.map_or("none", |fault| fault.detail.as_str());
        return Err(RecordingError::run("run.csv", "at least one row with a `pos.<joint>` value", found));
    }
    let m = &run.measured;
    let free = m.base_pose.is_some() || m.acceleration.is_some() || m.orientation.is_some();
    run.base = base.unwrap_or(if free { Base::Free } else { Base::Fixed });
    let has_commands = run.commands != Commands::default();
    (run.commands.kp, run.commands.kd) = (kp, kd);
    if !has_commands {
        let detail = "expected columns cmd_pos.<joint> or cmd_tau.<joint>, found none".into();
        run.faults.push(Fault { kind: FaultKind::Missing, channel: "commands".into(), time: 0.0, count: 1, detail });
    }
    description.command_reading(&layout.joints)?.apply(&mut run);
    faults::examine(&mut run, mapping);
    turn_imu(&mut run, description.imu_rotation(), urdf);
    run.note_uncommanded();
    Ok(run)
}

/// Columns of joints where `run.toml` says that they stand, with their signs.
fn place_joints(series: &mut qv_core::JointSeries, places: &[(usize, f64)]) {
    if places.iter().enumerate().all(|(k, place)| *place == (k, 1.0)) {
        return;
    }
    for row in series.values.chunks_exact_mut(series.joints) {
        let read = row.to_vec();
        row.iter_mut().zip(places).for_each(|(x, (from, sign))| *x = sign * read[*from]);
    }
}

/// Turns the channels of an IMU that is mounted at an angle, as `run.toml` or the URDF's link says.
fn turn_imu(run: &mut Run, stated: Option<[f64; 3]>, urdf: Option<&str>) {
    // What is wrong with a URDF is said where it is used.
    let of_urdf = || Model::from_urdf(urdf?, &ModelOptions::default()).ok().as_ref().and_then(imu::mount_of);
    let mount = stated.map(|rpy| Pose::from_xyz_rpy([0.0; 3], rpy).rotation);
    if let Some(rotation) = mount.or_else(of_urdf).filter(|_| run.base == Base::Free) {
        let remarks = imu::to_trunk(run, rotation, stated.is_some());
        run.remarks.extend(remarks);
    }
}

/// Which column of the file goes where.
struct Layout {
    joints: Vec<String>,
    /// Names found that the robot does not have, and names that it has but were not found.
    strange: Vec<String>,
    absent: Vec<String>,
    time: usize,
    /// Unit of time, where the column's name says it.
    unit: Option<Unit>,
    /// Target of each file column.
    target: Vec<Option<usize>>,
    /// Channel, first target column, width.
    groups: Vec<(Channel, usize, usize)>,
    width: usize,
    names: Vec<String>,
}

/// Joints that a table may have: no robot comes near it.
const MOST_JOINTS: usize = 1000;

const JOINT_CHANNELS: [(&str, Channel); 6] = [
    ("cmd_pos.", Channel::CommandPosition),
    ("cmd_vel.", Channel::CommandVelocity),
    ("cmd_tau.", Channel::CommandTorque),
    ("pos.", Channel::Position),
    ("vel.", Channel::Velocity),
    ("tau.", Channel::Torque),
];

/// Channels that `position_unit` is of.
const OF_ANGLES: [Channel; 4] =
    [Channel::Position, Channel::Velocity, Channel::CommandPosition, Channel::CommandVelocity];

const VECTOR_CHANNELS: [(&str, Channel, &[&str]); 4] = [
    ("base.", Channel::BasePose, &["x", "y", "z", "qw", "qx", "qy", "qz"]),
    ("imu.", Channel::Orientation, &["qw", "qx", "qy", "qz"]),
    ("gyro.", Channel::Gyro, &["x", "y", "z"]),
    ("acc.", Channel::Acceleration, &["x", "y", "z"]),
];

impl Layout {
    fn new(
        header: &csv::StringRecord,
        mapping: Option<&Mapping>,
        lost: &mut Vec<Loss>,
    ) -> Result<Self, RecordingError> {
        let names: Vec<String> = header.iter().map(plain).collect();
        let found = || names.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
        let with_unit = || {
            let unit = |n: &String| dialect::stated_unit(n.strip_prefix("time_")?);
            names.iter().enumerate().find_map(|(column, name)| Some((column, unit(name)?)))
        };
        let plain_time = names.iter().position(|n| n == "time").map(|column| (column, None));
        let Some((time, unit)) = plain_time.or_else(|| with_unit().map(|(column, unit)| (column, Some(unit)))) else {
            return Err(RecordingError::file("run.csv", "a column `time`", format!("columns {}", found())));
        };
        let mut seen: Vec<String> = Vec::new();
        for name in &names {
            let joint = JOINT_CHANNELS.iter().find_map(|(prefix, _)| name.strip_prefix(prefix));
            if let Some(joint) = joint.filter(|j| !j.is_empty() && !seen.iter().any(|s| s == j)) {
                seen.push(joint.to_string());
            }
            if seen.len() > MOST_JOINTS {
                return Err(RecordingError::file("run.csv", format!("at most {MOST_JOINTS} joints"), "more"));
            }
        }
        if !names.iter().any(|n| n.starts_with("pos.")) {
            return Err(RecordingError::file("run.csv", "columns `pos.<joint>`", format!("columns {}", found())));
        }
        if seen.is_empty() {
            return Err(RecordingError::file(
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
            return Err(RecordingError::file("run.csv", expected, format!("joints {}", seen.join(", "))));
        }
        let mut layout =
            Self { joints, strange, absent, time, unit, target: Vec::new(), groups: Vec::new(), width: 0, names };
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
            if place.is_none() && column != self.time && !is_index(name) {
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

/// The name of a column as it is looked for: without what programs put before a header, channels in lower case.
fn plain(name: &str) -> String {
    let name = name.trim_start_matches('\u{feff}').trim();
    // NumPy writes headers as comments.
    let name = name.strip_prefix('#').map_or(name, str::trim);
    let lower = name.to_ascii_lowercase();
    let is_whole = |n: &str| {
        let of_vector = |(prefix, _, parts): &(&str, Channel, &[&str])| {
            n.strip_prefix(prefix).is_some_and(|part| parts.contains(&part))
        };
        n == "time" || VECTOR_CHANNELS.iter().any(of_vector)
    };
    if is_whole(&lower) {
        return lower;
    }
    match JOINT_CHANNELS.iter().find(|(prefix, _)| lower.starts_with(prefix)) {
        Some((prefix, _)) => format!("{prefix}{}", &name[prefix.len()..]),
        None => name.to_string(),
    }
}

/// Whether a column holds the numbers of rows, or nothing: without a name, or with one that programs give to such columns.
fn is_index(name: &str) -> bool {
    name.is_empty() || name.starts_with("Unnamed:") || ["index", "level_0"].contains(&name)
}

/// The rows, with stamps in seconds, and the unit of time that they are written in.
fn read_rows(
    reader: &mut csv::Reader<impl Read>,
    layout: &Layout,
    stated: Option<Unit>,
    lost: &mut Vec<Loss>,
    remarks: &mut Vec<String>,
) -> Result<(Samples, &'static str), RecordingError> {
    let mut cells = Cells::default();
    let indices: Vec<usize> =
        (0..layout.names.len()).filter(|&c| c != layout.time && is_index(&layout.names[c])).collect();
    let mut used = vec![false; indices.len()];
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
        let is_first = samples.time.is_empty();
        let Some(time) = record.get(layout.time).and_then(|cell| cells.stamp(cell, is_first)) else {
            bad.rows
                .get_or_insert((line, String::from_utf8_lossy(record.get(layout.time).unwrap_or(b"")).into_owned()));
            bad.row_count += 1;
            continue;
        };
        // What follows a separator at the end of a line is no cell.
        let width = record.len() - record.iter().rev().take_while(|cell| cell.is_empty()).count();
        if record.len() < layout.names.len() || width > layout.names.len() {
            bad.short.get_or_insert((line, record.len()));
            bad.short_count += 1;
        }
        samples.time.push(time);
        let base = samples.rows.len();
        samples.rows.resize(base + layout.width, f64::NAN);
        for (column, target) in layout.target.iter().enumerate() {
            let (Some(target), Some(cell)) = (target, record.get(column)) else { continue };
            match cells.number(cell) {
                Some(x) => samples.rows[base + target] = x,
                None if cell.is_empty() => {}
                None => bad.cell(line, &layout.names[column], cell),
            }
        }
        for (used, &column) in used.iter_mut().zip(&indices) {
            *used |= record.get(column).is_some_and(|cell| !cell.is_empty());
        }
    }
    bad.report(layout, lost);
    for (_, column) in used.iter().zip(&indices).filter(|(used, _)| **used) {
        let name = if layout.names[*column].is_empty() { "no name" } else { &layout.names[*column] };
        remarks.push(format!("run.csv: column {} ({name}) counts rows: it is not used", column + 1));
    }
    if cells.commas > 0 {
        remarks.push(format!("run.csv: decimal commas, in {} cells", cells.commas));
    }
    if samples.time.is_empty() {
        let found = match &bad.rows {
            Some((line, cell)) => format!("{} rows, none with a time (`{cell}` in line {line})", bad.row_count),
            None => "none".into(),
        };
        return Err(RecordingError::file("run.csv", "at least one row", found));
    }
    let by_size = || unit_of_time(cells.first_stamp(&samples.time), &samples.time);
    let (seconds, unit) = stated.unwrap_or_else(by_size);
    if seconds != 1.0 {
        if stated.is_none() {
            remarks.push(format!("run.csv: stamps are {unit}, by their size (time_unit in run.toml says otherwise)"));
        }
        samples.time.iter_mut().for_each(|t| *t *= seconds);
    }
    Ok((samples, unit))
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
