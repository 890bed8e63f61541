//! What a look at the commands gives: findings, a line of a table for each question, and how the commands are read with all findings mended.

use super::reading::CommandReading;

/// One look at the commands, found or not: a line of the table of `qv inspect`.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Check {
    /// What was looked at, such as `sign and unit of commands`.
    pub name: String,
    /// What was found, with figures.
    pub found: String,
    /// Whether it is this crate's convention; `None` where nothing shows it.
    pub is_ours: Option<bool>,
}

/// What is another convention in the commands.
pub(crate) struct Finding {
    /// `commands NAME`, or `commands` of all joints.
    pub channel: String,
    pub what: String,
    /// What to write into `run.toml`; empty where no setting mends it.
    pub line: String,
}

/// All that the commands of a run show of their conventions.
pub(crate) struct Analysis {
    pub findings: Vec<Finding>,
    pub checks: Vec<Check>,
    /// How the commands are read with all findings mended.
    pub reading: CommandReading,
}

/// A factor in as few digits as show it.
pub(super) fn number(x: f64) -> String {
    if (x - x.round()).abs() < 1e-9 {
        format!("{x:.0}")
    } else if x.abs() < 0.1 {
        format!("{x:.8}")
    } else {
        format!("{x:.3}")
    }
}

/// Only what is exchanged in whole cycles.
pub(super) fn cycles(mut follows: Vec<Option<usize>>) -> Vec<Option<usize>> {
    let joints = follows.len();
    for _ in 0..joints {
        for joint in 0..joints {
            let is_followed = follows.iter().filter(|other| **other == Some(joint)).count() == 1;
            if follows[joint].is_some() && !is_followed {
                follows[joint] = None;
            }
        }
    }
    let open = |joint: &usize| follows[*joint].is_some_and(|other| follows[other].is_none());
    let lost: Vec<usize> = (0..joints).filter(open).collect();
    lost.into_iter().for_each(|joint| follows[joint] = None);
    follows
}
