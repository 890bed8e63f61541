//! Where the lags of motors stand when a window begins: commands and states before it brought them there.
//!
//! A lag that began settled on what is asked for at the start would show in the first few time constants only, and its size would come
//! out too small.

use super::{ActuatorModel, Between, Lag, State};
use crate::problem::torques::slope;
use crate::problem::{Overrides, Problem, Window};
use qv_core::JointSeries;
use qv_replay::replay::Command;
use qv_sim::{JointCommand, MotorCommand};

/// Time constants of a lag after which nothing is left of what was before.
const REMEMBERED: f64 = 6.0;

/// Torques behind the lags at the start of a window, before the motors' limits \[N m\], shape `[joints]`; `None` where no motor lags, or
/// neither commands nor positions say where its lag stood. Steps are `timestep` \[s\] long.
pub fn lagged(problem: &Problem, window: &Window, setting: &Overrides, timestep: f64) -> Option<Vec<f64>> {
    let joints = problem.columns.len();
    let lags = (0..joints).filter(|&j| problem.joint_value(setting, "actuator.*.lag", j) > 0.0);
    let motors: Vec<ActuatorModel> = lags.map(|j| ActuatorModel::new(problem, setting, j)).collect();
    let longest = motors.iter().map(|m| m.lag).fold(0.0, f64::max);
    if longest <= 0.0 {
        return None;
    }
    let held = window.told.held(problem, window).ok()?;
    let position = window.view.measured.position.as_ref().filter(|p| !p.is_empty())?;
    let velocity = window.view.measured.velocity.as_ref().filter(|v| !v.is_empty());
    let mut lags: Vec<(Lag, Option<f64>)> =
        motors.iter().map(|m| (Lag { time_constant: m.lag, state: None }, None)).collect();
    let (mut command, mut rows) = (Command::default(), [0; 2]);
    let mut torques = vec![0.0; joints];
    for age in (1..=(REMEMBERED * longest / timestep).ceil() as usize).rev() {
        let time = window.start - age as f64 * timestep;
        // Most motors are late by the same time: they are told the same.
        let mut told = f64::NAN;
        for (motor, (lag, play)) in motors.iter().zip(&mut lags) {
            if told != motor.latency {
                told = motor.latency;
                held.at(time - told, timestep, &mut command);
            }
            let state = state_at(position, velocity, problem.columns[motor.joint], time + motor.seen_late, &mut rows);
            let demand = motor.demand(&asked(&command, motor.joint), &state, play) * motor.share(problem, window, time);
            // What was not measured there is waited for.
            if demand.is_finite() {
                torques[motor.joint] = lag.next(time, demand);
            }
        }
    }
    Some(torques)
}

/// How far the encoders of motors behind springs are ahead of their joints at a `time` near a window \[rad\], shape `[joints]`; `None` where there
/// are no springs, or nothing says what the motors were asked for. `seen` is the state there, as the encoders tell it but for their bias: what a
/// motor gives is told by what its own encoder says. A lag is taken to have settled.
pub fn leads(
    problem: &Problem,
    window: &Window,
    setting: &Overrides,
    seen: &qv_sim::State,
    time: f64,
) -> Option<Vec<f64>> {
    let compliances = problem.compliances(setting)?;
    let held = window.told.held(problem, window).ok()?;
    let errors = problem.sensor_errors(setting);
    let (mut command, joints) = (Command::default(), compliances.len());
    let (q, v) = (&seen.q[seen.q.len() - joints..], &seen.v[seen.v.len() - joints..]);
    let lead = |joint: usize| {
        if compliances[joint] <= 0.0 {
            return 0.0;
        }
        let motor = ActuatorModel::new(problem, setting, joint);
        held.at(time - motor.latency, 0.0, &mut command);
        let state = State { q: q[joint] + errors.encoder_bias[joint], dq: v[joint] };
        let demand = motor.demand(&asked(&command, joint), &state, &mut None) * motor.share(problem, window, time);
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
    let place = Between::new(position, time, rows[0]);
    rows[0] = place.row;
    let dq = match velocity {
        Some(velocity) => {
            let place = Between::new(velocity, time, rows[1]);
            rows[1] = place.row;
            place.of(velocity, column)
        }
        None => slope(position, column, place.row),
    };
    State { q: place.of(position, column), dq }
}
