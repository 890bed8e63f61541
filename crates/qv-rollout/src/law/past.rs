//! Where the lags of motors stand when a window begins: commands and states before it brought them there.
//!
//! A lag that began settled on what is asked for at the start would show in the first few time constants only, and its size would come
//! out too small.

use super::{ActuatorModel, Clock, Lag, RowInterpolation, State};
use crate::commands::Command;
use crate::parameters::Overrides;
use crate::robot::Rollout;
use crate::window::Start;
use qv_core::JointSeries;
use qv_sim::{ActsOn, JointCommand, JointField, MotorCommand};

/// Time constants of a lag after which nothing is left of what was before.
const REMEMBERED: f64 = 6.0;

/// Torques behind the lags at the start of a window, before the motors' limits \[N m\], shape `[joints]`; `None` where no motor lags, or
/// neither commands nor positions say where its lag stood. Steps are `timestep` \[s\] long.
pub fn lagged(rollout: &Rollout, start: &Start, setting: &Overrides, timestep: f64) -> Option<Vec<f64>> {
    let joints = rollout.columns.len();
    let lags = (0..joints).filter(|&j| rollout.value_of(setting, ActsOn::Joint(j, JointField::Lag)) > 0.0);
    let motors: Vec<ActuatorModel> = lags.map(|j| ActuatorModel::new(rollout, setting, j)).collect();
    let longest = motors.iter().map(|m| m.lag).fold(0.0, f64::max);
    if longest <= 0.0 {
        return None;
    }
    let position = start.view.measured.position.as_ref().filter(|p| !p.is_empty())?;
    let velocity = start.view.measured.velocity.as_ref().filter(|v| !v.is_empty());
    let mut lags: Vec<(Lag, Option<f64>)> =
        motors.iter().map(|m| (Lag { time_constant: m.lag, state: None }, None)).collect();
    let (mut command, mut rows) = (Command::default(), [0; 2]);
    let mut torques = vec![0.0; joints];
    for age in (1..=(REMEMBERED * longest / timestep).ceil() as usize).rev() {
        let time = start.time - age as f64 * timestep;
        // Most motors are late by the same time: they are reported the same.
        let mut remarks = f64::NAN;
        for (motor, (lag, play)) in motors.iter().zip(&mut lags) {
            if remarks != motor.latency {
                remarks = motor.latency;
                start.held.at(time - remarks, timestep, &mut command);
            }
            let state = state_at(position, velocity, rollout.columns[motor.joint], time + motor.seen_late, &mut rows);
            let demand = motor.demand(&asked(&command, motor.joint), &state, play)
                * motor.share(rollout, (start.view, Clock::of(start)), time);
            // What was not measured there is waited for.
            if demand.is_finite() {
                torques[motor.joint] = lag.next(time, demand);
            }
        }
    }
    Some(torques)
}

/// How far the encoders of motors behind springs are ahead of their joints at a `time` near a window \[rad\], shape `[joints]`; `None` where there
/// are no springs, or nothing says what the motors were asked for. `seen` is the state there, as the encoders show it but for their bias: what a
/// motor gives is given by what its own encoder says. A lag is taken to have settled.
pub fn leads(
    rollout: &Rollout,
    start: &Start,
    setting: &Overrides,
    seen: &qv_sim::State,
    time: f64,
) -> Option<Vec<f64>> {
    let compliances = rollout.compliances(setting)?;
    let errors = rollout.sensor_errors(setting);
    let (mut command, joints) = (Command::default(), compliances.len());
    let (q, v) = (&seen.q[seen.q.len() - joints..], &seen.v[seen.v.len() - joints..]);
    let lead = |joint: usize| {
        if compliances[joint] <= 0.0 {
            return 0.0;
        }
        let motor = ActuatorModel::new(rollout, setting, joint);
        start.held.at(time - motor.latency, 0.0, &mut command);
        let state = State { q: q[joint] + errors.encoder_bias[joint], dq: v[joint] };
        let demand = motor.demand(&asked(&command, joint), &state, &mut None)
            * motor.share(rollout, (start.view, Clock::of(start)), time);
        compliances[joint] * motor.motor.limited(demand, state.dq)
    };
    Some((0..joints).map(lead).collect())
}

fn asked(command: &Command, joint: usize) -> MotorCommand {
    let JointCommand { q, dq, kp, kd, tau } = command.view();
    MotorCommand { q: q[joint], dq: dq[joint], tau: tau[joint], kp: kp[joint], kd: kd[joint] }
}

/// The measured state at a time, looked for near `rows`, which are moved there. Where speeds were not measured they are the slope between
/// two positions.
fn state_at(
    position: &JointSeries,
    velocity: Option<&JointSeries>,
    column: usize,
    time: f64,
    rows: &mut [usize; 2],
) -> State {
    let place = RowInterpolation::new(position, time, rows[0]);
    rows[0] = place.row;
    let dq = match velocity {
        Some(velocity) => {
            let place = RowInterpolation::new(velocity, time, rows[1]);
            rows[1] = place.row;
            place.of(velocity, column)
        }
        None => slope(position, column, place.row),
    };
    State { q: place.of(position, column), dq }
}

/// Slope of a column between two rows, from `row` on; 0 where there is one row only.
pub fn slope(series: &JointSeries, column: usize, row: usize) -> f64 {
    let first = row.min(series.len().saturating_sub(2));
    let last = (first + 1).min(series.len() - 1);
    let span = series.time[last] - series.time[first];
    if span > 0.0 { (series.row(last)[column] - series.row(first)[column]) / span } else { 0.0 }
}
