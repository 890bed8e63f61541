//! Joints in windows that no fit has seen: measured at their recorded instants, and simulated before and after beside it.

use crate::inference::linearised::{LinearisedProblem, LinearisedWindow};
use crate::report::{TracedWindow, Traces};
use qv_core::JointSeries;
use qv_rollout::Overrides;
use qv_rollout::{SensorErrors, Trace};

/// The traces of a study; `after` are those under the corrections, by window. Nothing is simulated here.
pub fn traces(study: &LinearisedProblem, setting: &Overrides, after: &[Option<Trace>]) -> Traces {
    let errors = [Overrides::new(), setting.clone()].map(|setting| study.rollout.sensor_errors(&setting));
    let held_out = study.seen.iter().zip(after).filter(|(seen, _)| seen.window.held_out);
    Traces {
        joints: study.rollout.model.joint_names().to_vec(),
        windows: held_out.filter_map(|(seen, after)| window(study, seen, after.as_ref(), &errors)).collect(),
    }
}

fn window(
    study: &LinearisedProblem,
    seen: &LinearisedWindow,
    after: Option<&Trace>,
    errors: &[SensorErrors; 2],
) -> Option<TracedWindow> {
    let view = &seen.window.view.measured;
    let position = view.position.as_ref()?;
    let end = seen.window.start + study.rollout.cut.window + 1e-9;
    let is_in = |t: &f64| (seen.window.start - 1e-9..=end).contains(t);
    let time: Vec<f64> = position.time.iter().copied().filter(is_in).collect();
    let columns = &study.rollout.columns;
    let measured = Trace {
        position: at(Some(position), &time, columns),
        velocity: at(view.velocity.as_ref(), &time, columns),
        torque: at(view.torque.as_ref(), &time, columns),
        joints: columns.len(),
        time,
        ..Trace::default()
    };
    let beside = |trace: Option<&Trace>, errors: &SensorErrors| match trace {
        Some(trace) => beside(&measured, trace, &errors.encoder_latency),
        None => Trace { time: measured.time.clone(), joints: columns.len(), ..Trace::default() },
    };
    let (before, after) = (beside(seen.trace.as_ref(), &errors[0]), beside(after, &errors[1]));
    Some(TracedWindow {
        run: seen.window.run,
        measured: rounded(measured),
        before: rounded(before),
        after: rounded(after),
    })
}

/// As far as a page can show: evidence holds all of these numbers.
fn rounded(mut trace: Trace) -> Trace {
    let values = [&mut trace.time, &mut trace.position, &mut trace.velocity, &mut trace.torque];
    values.into_iter().flatten().for_each(|x| *x = (*x * 1e6).round() / 1e6);
    trace
}

/// Columns of a measured series at some times, shape `[times, joints]`; empty where it was not recorded.
fn at(series: Option<&JointSeries>, time: &[f64], columns: &[usize]) -> Vec<f64> {
    let Some(series) = series.filter(|s| !s.is_empty()) else { return Vec::new() };
    let mut row = vec![0.0; series.joints];
    let mut values = Vec::with_capacity(time.len() * columns.len());
    for &t in time {
        series.interpolate(t, &mut row);
        values.extend(columns.iter().map(|&c| row[c]));
    }
    values
}

/// What encoders and motors of the simulation would have reported at the measured instants, of the channels that were measured. An encoder
/// shows what was `latency` \[s\] ago; torques are taken as they are.
fn beside(measured: &Trace, simulated: &Trace, latency: &[f64]) -> Trace {
    let joints = measured.joints;
    let channel = |measured_of: &[f64], values: &[f64], late: bool| -> Vec<f64> {
        if measured_of.is_empty() {
            return Vec::new();
        }
        let delay = |j: usize| if late { latency.get(j).copied().unwrap_or(0.0) } else { 0.0 };
        let all = measured.time.iter().flat_map(|t| (0..joints).map(move |j| (*t, j)));
        all.map(|(t, j)| value_at(simulated, values, j, t - delay(j))).collect()
    };
    Trace {
        time: measured.time.clone(),
        position: channel(&measured.position, &simulated.position, true),
        velocity: channel(&measured.velocity, &simulated.velocity, true),
        torque: channel(&measured.torque, &simulated.torque, false),
        joints,
        ..Trace::default()
    }
}

/// Between two steps; NaN outside of the simulation.
fn value_at(trace: &Trace, values: &[f64], joint: usize, time: f64) -> f64 {
    let value = |i: usize| values.get(i * trace.joints + joint).copied().unwrap_or(f64::NAN);
    let next = trace.time.partition_point(|&t| t < time - 1e-9);
    let Some(&after) = trace.time.get(next) else { return f64::NAN };
    if after - time <= 1e-9 {
        return value(next);
    }
    let Some(last) = next.checked_sub(1) else { return f64::NAN };
    let share = (time - trace.time[last]) / (after - trace.time[last]);
    value(last) + share * (value(next) - value(last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoders_tell_what_was_and_nothing_is_known_outside_the_simulation() {
        let time: Vec<f64> = (0..=10).map(|k| 1.0 + 0.1 * f64::from(k)).collect();
        let ramp = |slope: f64| time.iter().flat_map(|t| [slope * t, -slope * t]).collect::<Vec<f64>>();
        let simulated =
            Trace { position: ramp(1.0), velocity: ramp(2.0), torque: ramp(3.0), joints: 2, time, ..Trace::default() };
        let measured = Trace {
            time: vec![0.95, 1.0, 1.25, 2.0, 2.05],
            position: vec![0.0; 10],
            torque: vec![0.0; 10],
            joints: 2,
            ..Trace::default()
        };
        let found = beside(&measured, &simulated, &[0.0, 0.2]);
        let column = |values: &[f64], j: usize| values.iter().skip(j).step_by(2).copied().collect::<Vec<f64>>();
        let (first, late) = (column(&found.position, 0), column(&found.position, 1));
        assert!(first[0].is_nan() && first[4].is_nan() && late[1].is_nan());
        assert!((first[1] - 1.0).abs() < 1e-12 && (first[2] - 1.25).abs() < 1e-12 && (first[3] - 2.0).abs() < 1e-12);
        assert!((late[2] + 1.05).abs() < 1e-12 && (late[4] + 1.85).abs() < 1e-12);
        assert!(found.velocity.is_empty(), "it was not measured");
        assert!((column(&found.torque, 1)[2] + 3.75).abs() < 1e-12, "torques have no latency");
    }
}
