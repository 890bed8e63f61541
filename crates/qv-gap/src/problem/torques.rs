//! How much the motors of a recording had to do.

use qv_recording::Run;
use qv_rollout::Rollout;
use qv_rollout::law::slope;
use qv_rollout::{Command, HeldCommands};

/// Rows of a recording that are looked at where torques were not measured.
const ROWS: usize = 4000;
/// The largest of this many is left out: a single outlier is no torque that a motor had.
const ONE_OF: usize = 500;

/// Largest torque of each joint: measured, or what its commands asked of it where torques were not measured \[N m\], shape `[joints]`; 0 where
/// nothing shows.
pub fn largest_torques(rollout: &Rollout, run: &Run) -> Vec<f64> {
    match &run.measured.torque {
        Some(torque) => rollout.columns.iter().map(|&c| largest(torque.column(c))).collect(),
        None => asked(rollout, run).into_iter().map(|all| largest(all.into_iter())).collect(),
    }
}

/// Largest measured speed of each joint \[rad/s\], shape `[joints]`; 0 where it was not measured.
pub fn largest_speeds(rollout: &Rollout, run: &Run) -> Vec<f64> {
    let speed = run.measured.velocity.as_ref();
    rollout.columns.iter().map(|&c| speed.map_or(0.0, |s| largest(s.column(c)))).collect()
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = values.map(f64::abs).filter(|x| x.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len().saturating_sub(1 + all.len() / ONE_OF)).copied().unwrap_or(0.0)
}

/// Torques that the controller asked for at the stamps of the positions, limits aside \[N m\], shape `[joints][rows]`.
fn asked(rollout: &Rollout, run: &Run) -> Vec<Vec<f64>> {
    let nothing = vec![Vec::new(); rollout.columns.len()];
    let Some(position) = run.measured.position.as_ref().filter(|p| !p.is_empty()) else { return nothing };
    let Ok(held) = HeldCommands::new(run, &rollout.columns) else { return nothing };
    let (mut all, mut command) = (nothing, Command::default());
    for row in (0..position.len()).step_by(position.len().div_ceil(ROWS)) {
        let time = position.time[row];
        held.at(time, 0.0, &mut command);
        let remarks = command.view();
        for (joint, (of_joint, &column)) in all.iter_mut().zip(&rollout.columns).enumerate() {
            let speed = match &run.measured.velocity {
                Some(velocity) if !velocity.is_empty() => velocity.hold(time)[column],
                _ => slope(position, column, row),
            };
            let p = remarks.kp[joint] * (remarks.q[joint] - position.row(row)[column]);
            of_joint.push(p + remarks.kd[joint] * (remarks.dq[joint] - speed) + remarks.tau[joint]);
        }
    }
    all
}
