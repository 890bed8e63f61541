//! `replay.json`, as the project's format page fixes it, and what more a reader may want.

use crate::{Errors, Replay, verdict};
use serde_json::{Value, json};

/// The report. `real_time_factor` is simulated over elapsed time, which the caller measures. Numbers that are not known
/// (a torque that was not measured) are null.
pub fn to_json(replay: &Replay, real_time_factor: f64) -> Value {
    let joint = |(name, e): (&String, &crate::JointErrors)| json!({"name": name, "pos_rms": e.position, "vel_rms": e.velocity, "tau_rms": e.torque});
    let joints = |errors: &Errors| replay.joint_names.iter().zip(&errors.joints).map(joint).collect::<Vec<_>>();
    let time = &replay.recorded.time;
    json!({
        "format": "qv-replay/1",
        "verdict": verdict(replay),
        "duration": time[time.len() - 1] - time[0],
        "joints": joints(&replay.errors),
        "pos_rms_mean": replay.errors.position_mean(),
        "base": replay.errors.base.map(|b| json!({
            "pos_mean": b.position_mean, "pos_final": b.position_final, "yaw_final": b.yaw_final})),
        "windows": {
            "length": replay.windows.length,
            "count": replay.windows.windows.len(),
            "skipped": replay.windows.skipped,
            "ran_away": replay.windows.ran_away,
            "pos_rms_mean": replay.window_errors.position_mean(),
            "joints": joints(&replay.window_errors),
            "legs": legs(&replay.window_errors),
            "phases": phases(&replay.window_errors),
            "times": times(&replay.window_errors),
        },
        "legs": legs(&replay.errors),
        "phases": phases(&replay.errors),
        "times": times(&replay.errors),
        "lags": {"behind_command": lags(&replay.command_lags), "behind_simulation": lags(&replay.model_lags)},
        "ran_away": replay.ran_away,
        "timing": { "real_time_factor": real_time_factor },
    })
}

fn legs(errors: &Errors) -> Value {
    errors.legs.iter().map(|(name, rms)| json!({"name": name, "pos_rms": rms})).collect()
}

fn phases(errors: &Errors) -> Value {
    let one = |p: &crate::PhaseErrors| json!({"name": p.phase.name(), "pos_rms": p.position, "share": p.share});
    errors.phases.iter().map(one).collect()
}

fn times(errors: &Errors) -> Value {
    errors.times.iter().map(|t| json!({"start": t.start, "end": t.end, "pos_rms": t.position})).collect()
}

fn lags(lags: &[qv_recording::lag::Lag]) -> Value {
    let one = |l: &qv_recording::lag::Lag| json!({"name": l.joint, "lag": l.lag, "rms_without": l.before, "rms_with": l.after, "correlation": l.correlation});
    lags.iter().map(one).collect()
}
