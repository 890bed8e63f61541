//! Recordings of other programs become tables, which [`crate::read_table`] makes runs of.
//!
//! | what | from |
//! |---|---|
//! | [`lerobot`] | LeRobot datasets, versions 2 and 3 (huggingface/lerobot, `meta/info.json` and Parquet files) |
//! | [`sage`] | folders of SAGE (isaac-sim2real/sage, *Data Format*): `control.csv`, `state_motor.csv`, `joint_list.txt` |
//! | [`motor_csv`] | CSV files with the fields of a robot's own messages as columns, in the spellings that loggers give them |
//!
//! What a table does not say, such as the robot, stands in `run.toml`; `[dataset]` in it says what the columns are ([`Settings`]).

pub mod lerobot;
pub mod motor_csv;
#[cfg(feature = "parquet")]
mod parquet;
pub mod sage;
mod settings;

pub use settings::Settings;

use crate::run::Loss;
use std::collections::HashMap;
use std::fmt::Write;

/// A table as [`crate::read_table`] takes it, and how it was made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// The text of `run.csv`.
    pub csv: String,
    /// How the recording was read where that is not as a matter of course, a sentence each.
    pub remarks: Vec<String>,
    /// What could not be read.
    pub lost: Vec<Loss>,
}

/// A channel of joints: the prefix of its columns, and a row of numbers for each stamp, NaN where there is none.
pub(crate) struct JointChannel {
    pub prefix: &'static str,
    pub time: Vec<f64>,
    /// Shape `[T, joints]`.
    pub values: Vec<f64>,
}

/// Joins channels, each on its own stamps \[s\], into one table. Joints without a name are left out.
pub(crate) fn join(joints: &[String], parts: &[JointChannel]) -> String {
    let named: Vec<usize> = (0..joints.len()).filter(|j| !joints[*j].is_empty()).collect();
    let mut csv = String::from("time_s");
    for part in parts {
        named.iter().for_each(|j| write!(csv, ",{}", quoted(&format!("{}{}", part.prefix, joints[*j]))).unwrap_or(()));
    }
    csv.push('\n');
    // Channels with the same stamp share a row; a stamp that a channel has again makes one more.
    let mut order: Vec<(f64, usize, usize, usize)> = Vec::new();
    for (p, part) in parts.iter().enumerate() {
        let mut again: HashMap<u64, usize> = HashMap::new();
        for (row, time) in part.time.iter().enumerate() {
            let turn = again.entry(time.to_bits()).or_default();
            order.push((*time, *turn, p, row));
            *turn += 1;
        }
    }
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    for rows in order.chunk_by(|a, b| a.0 == b.0 && a.1 == b.1) {
        write!(csv, "{}", rows[0].0).unwrap_or(());
        for (k, part) in parts.iter().enumerate() {
            let own = rows.iter().find(|one| one.2 == k).map(|one| one.3);
            for j in &named {
                csv.push(',');
                if let Some(x) = own.map(|row| part.values[row * joints.len() + j]).filter(|x| !x.is_nan()) {
                    write!(csv, "{x}").unwrap_or(());
                }
            }
        }
        csv.push('\n');
    }
    csv
}

/// A cell of a header.
pub(crate) fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slower_channel_shares_the_rows_of_its_stamps() {
        let part = |prefix, time: &[f64]| JointChannel { prefix, time: time.to_vec(), values: time.to_vec() };
        let csv = join(&["a".into()], &[part("pos.", &[0.0, 0.1, 0.2, 0.2]), part("cmd_pos.", &[0.0, 0.2])]);
        assert_eq!(csv, "time_s,pos.a,cmd_pos.a\n0,0,0\n0.1,0.1,\n0.2,0.2,0.2\n0.2,0.2,\n");
    }

    #[test]
    fn channels_are_joined_by_their_stamps() {
        let joints = ["a".to_string(), String::new(), "b,c".to_string()];
        let part = |prefix, time: &[f64], values: &[f64]| JointChannel {
            prefix,
            time: time.to_vec(),
            values: values.to_vec(),
        };
        let csv = join(
            &joints,
            &[
                part("pos.", &[0.0, 1.0], &[1.0, 9.0, 2.0, 3.0, 9.0, f64::NAN]),
                part("cmd_pos.", &[0.0, 0.5], &[0.25, 9.0, 5.0, 6.0, 9.0, 7.0]),
            ],
        );
        assert_eq!(csv, "time_s,pos.a,\"pos.b,c\",cmd_pos.a,\"cmd_pos.b,c\"\n0,1,2,0.25,5\n0.5,,,6,7\n1,3,,,\n");
    }
}
