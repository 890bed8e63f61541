//! How much the motors of a recording had to do.

use crate::problem::Problem;
use qv_core::JointSeries;
use qv_replay::Run;
use qv_replay::replay::{Command, HeldCommands};

/// Rows of a recording that are looked at where torques were not measured.
const ROWS: usize = 4000;
/// The largest of this many is left out: a single outlier is no torque that a motor had.
const ONE_OF: usize = 500;

/// Largest torque of each joint: measured, or what its commands asked of it where torques were not measured \[N m\], shape `[joints]`; 0 where
/// nothing tells.
pub fn largest_torques(problem: &Problem, run: &Run) -> Vec<f64> {
    match &run.measured.torque {
        Some(torque) => problem.columns.iter().map(|&c| largest(torque.column(c))).collect(),
        None => asked(problem, run).into_iter().map(|all| largest(all.into_iter())).collect(),
    }
}

/// Largest measured speed of each joint \[rad/s\], shape `[joints]`; 0 where it was not measured.
pub fn largest_speeds(problem: &Problem, run: &Run) -> Vec<f64> {
    let speed = run.measured.velocity.as_ref();
    problem.columns.iter().map(|&c| speed.map_or(0.0, |s| largest(s.column(c)))).collect()
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = values.map(f64::abs).filter(|x| x.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len().saturating_sub(1 + all.len() / ONE_OF)).copied().unwrap_or(0.0)
}

/// Torques that the controller asked for at the stamps of the positions, limits aside \[N m\], shape `[joints][rows]`.
fn asked(problem: &Problem, run: &Run) -> Vec<Vec<f64>> {
    let nothing = vec![Vec::new(); problem.columns.len()];
    let Some(position) = run.measured.position.as_ref().filter(|p| !p.is_empty()) else { return nothing };
    let Ok(held) = HeldCommands::new(run, &problem.columns) else { return nothing };
    let (mut all, mut command) = (nothing, Command::default());
    for row in (0..position.len()).step_by(position.len().div_ceil(ROWS)) {
        let time = position.time[row];
        held.at(time, 0.0, &mut command);
        let told = command.view();
        for (joint, (of_joint, &column)) in all.iter_mut().zip(&problem.columns).enumerate() {
            let speed = match &run.measured.velocity {
                Some(velocity) if !velocity.is_empty() => velocity.hold(time)[column],
                _ => slope(position, column, row),
            };
            let p = told.kp[joint] * (told.q[joint] - position.row(row)[column]);
            of_joint.push(p + told.kd[joint] * (told.dq[joint] - speed) + told.tau[joint]);
        }
    }
    all
}

/// Slope of a column between two rows, from `row` on; 0 where there is one row only.
pub fn slope(series: &JointSeries, column: usize, row: usize) -> f64 {
    let first = row.min(series.len().saturating_sub(2));
    let last = (first + 1).min(series.len() - 1);
    let span = series.time[last] - series.time[first];
    if span > 0.0 { (series.row(last)[column] - series.row(first)[column]) / span } else { 0.0 }
}
