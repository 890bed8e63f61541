//! Folders of SAGE (isaac-sim2real/sage): `state_motor.csv` and `control.csv` with lists in their cells, radians; `joint_list.txt`.

use super::{JointChannel, Settings, Table, join};
use crate::RecordingError;
use crate::run::Loss;
use crate::table::unit_of_time;

/// Rows of one of the files.
#[derive(Default)]
struct Rows {
    time: Vec<f64>,
    /// Positions, velocities, torques, where there are columns of them; shape `[T, width]` each.
    lists: [Vec<f64>; 3],
    width: usize,
    lost: Vec<String>,
}

const LISTS: [&str; 3] = ["positions", "velocities", "torques"];

/// A table of the texts of `state_motor.csv`, `control.csv` and `joint_list.txt`, where the last two are there. The unit of stamps is found by
/// their size, for each file; that both are on one clock is looked at.
///
/// # Errors
/// A column is missing, no row has as many numbers as the first, or nothing names the joints.
pub fn table(
    state: &str,
    control: Option<&str>,
    joint_list: Option<&str>,
    settings: &Settings,
) -> Result<Table, RecordingError> {
    let mut state = rows("state_motor.csv", state, None)?;
    let own = joint_list.map(|text| {
        let lines = text.trim_start_matches('\u{feff}').split(['\n', ',']).map(|name| name.trim().to_string());
        lines.filter(|name| !name.is_empty()).collect()
    });
    let joints = settings.names(state.width, own, "joint_list.txt")?;
    let mut table = Table::default();
    in_seconds("state_motor.csv", &mut state.time, &mut table.remarks);
    table.remarks.extend(settings.unit.as_ref().map(|unit| format!("positions are read as {unit}")));
    let lose = |file: &str, lines: &[String]| {
        lines.iter().map(|what| Loss { file: file.into(), what: what.clone(), span: None }).collect::<Vec<_>>()
    };
    table.lost = lose("state_motor.csv", &state.lost);
    let mut parts = vec![];
    for (k, prefix) in ["pos.", "vel.", "tau."].into_iter().enumerate() {
        let mut values = std::mem::take(&mut state.lists[k]);
        if values.is_empty() {
            continue;
        }
        if k < 2 {
            settings.convert(&joints, &mut values, k == 1);
        }
        parts.push(JointChannel { prefix, time: state.time.clone(), values });
    }
    if let Some(text) = control {
        let mut control = rows("control.csv", text, Some(joints.len()))?;
        table.lost.extend(lose("control.csv", &control.lost));
        in_seconds("control.csv", &mut control.time, &mut table.remarks);
        let mut values = std::mem::take(&mut control.lists[0]);
        settings.convert(&joints, &mut values, false);
        match apart(&state.time, &control.time) {
            Some(what) => table.lost.push(Loss { file: "control.csv".into(), what, span: None }),
            None => parts.push(JointChannel { prefix: "cmd_pos.", time: control.time, values }),
        }
    }
    table.csv = join(&joints, &parts);
    Ok(table)
}

/// Stamps in seconds, and a sentence where they were written in another unit.
fn in_seconds(file: &str, time: &mut [f64], remarks: &mut Vec<String>) {
    let (seconds, unit) = unit_of_time(time[0], time);
    if seconds != 1.0 {
        remarks.push(format!("{file}: stamps are {unit}, by their size"));
        time.iter_mut().for_each(|t| *t *= seconds);
    }
}

/// Why commands are not those of the states: no stamp of theirs lies in the time of the states.
fn apart(states: &[f64], commands: &[f64]) -> Option<String> {
    let span = |time: &[f64]| {
        let least = time.iter().copied().fold(f64::INFINITY, f64::min);
        [least, time.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
    };
    let ([from, until], [first, last]) = (span(states), span(commands));
    (first > until || last < from).then(|| {
        format!(
            "expected stamps on the clock of state_motor.csv, {from:.3} to {until:.3} s, found {first:.3} to {last:.3} s: its commands are left out"
        )
    })
}

/// Rows with `width` numbers in each list, or as many as the first has.
fn rows(file: &str, text: &str, width: Option<usize>) -> Result<Rows, RecordingError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| RecordingError::file(file, "a header line", e.to_string()))?.clone();
    let column = |name: &str| header.iter().position(|known| known.eq_ignore_ascii_case(name));
    let missing = |name: &str| {
        let found = header.iter().take(8).collect::<Vec<_>>().join(", ");
        RecordingError::file(file, format!("a column `{name}`"), format!("columns {found}"))
    };
    let time = column("timestamp").or_else(|| column("time")).ok_or_else(|| missing("timestamp"))?;
    let lists = LISTS.map(column);
    if lists[0].is_none() {
        return Err(missing(LISTS[0]));
    }
    let mut out = Rows { width: width.unwrap_or(0), ..Rows::default() };
    let (mut bad, mut first_bad) = (0, None);
    for (at, record) in reader.records().enumerate() {
        let line = at + 2;
        let record = record.map_err(|e| RecordingError::file(file, "rows of a table", e.to_string()))?;
        let stamp = record.get(time).and_then(|cell| cell.parse::<f64>().ok()).filter(|t| t.is_finite());
        let numbers = lists.map(|list| list.map(|list| record.get(list).and_then(list_of).unwrap_or_default()));
        let positions = numbers[0].as_ref().map_or(0, Vec::len);
        if out.width == 0 && stamp.is_some() {
            out.width = positions;
        }
        let (Some(stamp), true) = (stamp, positions == out.width && positions > 0) else {
            bad += 1;
            first_bad.get_or_insert((line, positions));
            continue;
        };
        out.time.push(stamp);
        for (values, numbers) in out.lists.iter_mut().zip(numbers) {
            let Some(mut numbers) = numbers else { continue };
            // Of velocities and torques an empty list is "not measured".
            if numbers.len() != out.width {
                numbers = vec![f64::NAN; out.width];
            }
            values.append(&mut numbers);
        }
    }
    if let Some((line, found)) = first_bad {
        let expected = format!("a timestamp and {} positions", out.width);
        out.lost.push(format!("line {line}: expected {expected}, found {found} ({bad} such rows)"));
    }
    match (out.time.is_empty(), out.lost.first()) {
        (true, why) => Err(RecordingError::file(file, "rows with positions", why.map_or("none", String::as_str))),
        (false, _) => Ok(out),
    }
}

/// Numbers of `[1, 2, 3]`, with commas or as NumPy prints them.
fn list_of(cell: &str) -> Option<Vec<f64>> {
    let inside = cell.trim().trim_start_matches(['[', '(']).trim_end_matches([']', ')']);
    let words = inside.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty());
    words.map(|word| word.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::read_table;

    const STATE: &str = "type,timestamp,positions,velocities,torques,temperatures\n\
        StateMotor,0,\"[0.1, 0.2]\",\"[1, 2]\",\"[3 4]\",\"[30, 30]\"\nStateMotor,20000.0,\"[0.3, 0.4]\",\"[]\",\"[5, 6]\",\nStateMotor,40000,\"[0.5]\",,,\n";
    const CONTROL: &str = "type,timestamp,positions\nControl,100,\"[0.5, 0.6]\"\nControl,20000,\"[0.7, 0.8]\"\n";

    #[test]
    fn a_folder_becomes_a_run() {
        let table = table(STATE, Some(CONTROL), Some("hip\nknee\n"), &Settings::default()).unwrap();
        assert!(table.remarks[0].states("stamps"), "{:?}", table.remarks);
        assert!(table.lost[0].what.states("timestamp 4 2 1"));
        let run = read_table(table.csv.as_bytes(), "robot = \"r.urdf\"", Some("<robot/>"), None).unwrap();
        assert_eq!(run.joint_names, ["hip", "knee"]);
        let position = run.measured.position.unwrap();
        assert_eq!((position.time, position.values), (vec![0.0, 0.02], vec![0.1, 0.2, 0.3, 0.4]));
        assert_eq!(run.measured.velocity.unwrap().values, [1.0, 2.0]);
        assert_eq!(run.measured.torque.unwrap().values, [3.0, 4.0, 5.0, 6.0]);
        let command = run.commands.position.unwrap();
        assert_eq!((command.time, command.values), (vec![100.0 * 1e-6, 0.02], vec![0.5, 0.6, 0.7, 0.8]));
    }

    #[test]
    fn each_fault_is_named() {
        let fault = |state: &str, joints: Option<&str>| {
            table(state, None, joints, &Settings::default()).unwrap_err().to_string()
        };
        assert!(fault(STATE, None).states("joint_list.txt 2"));
        assert!(fault(STATE, Some("a\nb\nc")).states("names 3"));
        assert!(fault("type,positions\n", None).states("state_motor.csv `timestamp`"));
        assert!(fault("type,timestamp\n", None).states("`positions`"));
        assert!(fault("timestamp,positions\n", None).states("positions"));
        assert!(fault("timestamp,positions\n1,\"[x]\"\n", None).states("line 2"));
        let error =
            table(STATE, Some("timestamp,positions\n1,\"[1]\"\n"), Some("a,b"), &Settings::default()).unwrap_err();
        assert!(error.to_string().states("control.csv"), "{error}");
    }

    #[test]
    fn commands_on_another_clock_are_told_and_left_out() {
        let state = "timestamp,positions\n0.0,[1]\n0.01,[1]\n0.02,[2]\n";
        let read = |control: &str| table(state, Some(control), Some("a"), &Settings::default()).unwrap();
        let good = read("timestamp,positions\n0.0,[3]\n0.02,[3]\n");
        assert_eq!((good.lost.len(), good.csv.as_str()), (0, "time_s,pos.a,cmd_pos.a\n0,1,3\n0.01,1,\n0.02,2,3\n"));
        // The same in microseconds.
        assert_eq!(read("timestamp,positions\n0,[3]\n20000,[3]\n").csv, good.csv);
        let other = read("timestamp,positions\n1000.0,[3]\n1000.02,[3]\n");
        assert!(other.lost[0].what.states("1000.000 1000.000 1000.020"), "{other:?}");
        assert!(!other.csv.contains("cmd_pos"));
    }
}
