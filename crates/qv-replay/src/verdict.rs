//! What a replay found, in one or two sentences.

use crate::Replay;
use qv_core::statistics::median;
use qv_recording::lag::Lag;

/// The finding in words, plain text: error in windows, the worst joint, the lag that the model does not explain, and the
/// error of the whole run.
pub fn verdict(replay: &Replay) -> String {
    let windows = replay.windows.windows.len();
    if windows == 0 {
        let (skipped, lost) = (replay.windows.skipped, replay.windows.ran_away);
        return format!(
            "No window could be compared: in {skipped} something is missing (samples further apart than a window, or no \
             seconds?), in {lost} the simulation ran away."
        );
    }
    let worst = replay.window_errors.worst();
    let name = replay.joint_names.get(worst).map_or("", |n| n);
    let error = replay.window_errors.joints.get(worst).map_or(f64::NAN, |j| j.position);
    let mut text = format!(
        "Started from the measured state, the simulator is {} from the robot within {} s (rms, mean of joints); worst is \
         {name} with {}.",
        milliradians(replay.window_errors.position_mean()),
        replay.windows.length,
        milliradians(error),
    );
    // Less is the spread of the estimate from joint to joint.
    if let Some(lag) = median_lag(&replay.model_lags).filter(|lag| lag.abs() >= 0.001) {
        let side = if lag < 0.0 { "ahead of" } else { "behind" };
        text += &format!(" The robot's joints are {:.1} ms {side} the simulated ones.", 1e3 * lag.abs());
    }
    if let Some(time) = replay.ran_away {
        return text + &format!(" Open loop, the simulation ran away at {time:.3} s.");
    }
    text += &format!(" Open loop over the whole run: {}", milliradians(replay.errors.position_mean()));
    match replay.errors.base {
        Some(b) if b.position_final.is_finite() => text += &format!(", base {:.2} m off at the end.", b.position_final),
        _ => text.push('.'),
    }
    text
}

/// Of which joints no lag can be stated, and why; `None` where all have both.
pub fn lag_remark(replay: &Replay) -> Option<String> {
    let without =
        |lags: &[Lag]| replay.joint_names.iter().filter(|name| lags.iter().all(|l| l.joint != **name)).count();
    let joints = replay.joint_names.len();
    let [command, simulation] = [without(&replay.command_lags), without(&replay.model_lags)];
    let part =
        |count: usize, what: &str| (count > 0).then(|| format!("behind the {what} for {count} of {joints} joints"));
    let parts: Vec<String> = [part(command, "command"), part(simulation, "simulation")].into_iter().flatten().collect();
    (!parts.is_empty()).then(|| {
        format!(
            "No lag can be stated {}: the joint stands still, or the two motions correlate by less than {}.",
            parts.join(", "),
            Lag::LEAST_CORRELATION
        )
    })
}

/// Median over the joints for which a lag was found \[s\].
fn median_lag(lags: &[Lag]) -> Option<f64> {
    let mut found: Vec<f64> = lags.iter().map(|l| l.lag).filter(|x| x.is_finite()).collect();
    (!found.is_empty()).then(|| median(&mut found))
}

fn milliradians(x: f64) -> String {
    if x.is_finite() { format!("{:.1} mrad", 1e3 * x) } else { "an unknown distance".into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_ignores_what_is_unknown() {
        let lag = |lag: f64| Lag { joint: "a".into(), lag, before: 0.0, after: 0.0, correlation: 1.0 };
        assert_eq!(median_lag(&[]), None);
        assert_eq!(median_lag(&[lag(f64::NAN), lag(0.003), lag(0.001), lag(0.002)]), Some(0.002));
    }
}
