//! Which joints move fast enough to show what acts with speed.
//!
//! The law of an actuator (`law`) is fed with measured positions and speeds, and with their noise. Whatever smooths that noise, a lag or a
//! weaker kd, lowers what the law leaves of a joint at rest, the more surely the longer it rests: 12 s of standing give a lag of 12 ms a
//! log evidence of 105. Where a joint moves, its motion refutes what noise asks for.

use crate::problem::columns::{Columns, Group};
use crate::problem::library::Scope;
use qv_rollout::features::line_through;
use qv_rollout::{Rollout, Window};

/// Root mean square of a joint's speed below which it counts as at rest \[rad/s\]: within 10 ms it moves by less than an encoder's noise.
const AT_REST: f64 = 0.03;

/// Joints that are at rest in all windows, on average.
pub fn at_rest<'w>(rollout: &Rollout, windows: impl Iterator<Item = &'w Window> + Clone) -> Vec<usize> {
    let speed = |joint: usize| {
        let (mut sum, mut count) = (0.0, 0.0);
        for window in windows.clone() {
            for v in speeds(rollout, window, joint).filter(|v| v.is_finite()) {
                sum += v * v;
                count += 1.0;
            }
        }
        (count > 0.0).then(|| f64::sqrt(sum / count))
    };
    (0..rollout.columns.len()).filter(|&j| speed(j).is_some_and(|v| v < AT_REST)).collect()
}

/// Speeds of a joint between the bins of a window, by its positions \[rad/s\].
fn speeds(rollout: &Rollout, window: &Window, joint: usize) -> impl Iterator<Item = f64> {
    let (bin, bins, column) = (rollout.cut.bin, rollout.cut.bins(), rollout.columns[joint]);
    let at = move |b: usize| match &window.view.measured.position {
        Some(position) => line_through(position, column, window.start + b as f64 * bin, bin),
        None => f64::NAN,
    };
    let middles: Vec<f64> = (0..bins).map(at).collect();
    (1..bins).map(move |b| (middles[b] - middles[b - 1]) / bin)
}

/// Whether nothing of a group could show its effect: it [needs motion](crate::problem::library::Effect::needs_motion), and all its joints are `at_rest`, all of the robot's
/// `joints` if it is none of joints.
pub(crate) fn is_unshown(columns: &Columns, group: &Group, at_rest: &[usize], joints: usize) -> bool {
    let effect = &columns.effects[group.effect];
    let rests = match effect.scope {
        Scope::Joints => group.members.iter().all(|joint| at_rest.contains(joint)),
        _ => at_rest.len() == joints,
    };
    rests && effect.needs_motion
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::library::built_in;

    #[test]
    fn what_acts_with_speed_is_not_shown_by_joints_at_rest() {
        let columns = |name: &str| {
            let effects = built_in().into_iter().filter(|e| e.name == name).collect();
            Columns { effects, units: Vec::new(), columns: Vec::new(), tolerated: 0, groups: Vec::new() }
        };
        let hips = Group { effect: 0, members: vec![0, 3, 6, 9], names: Vec::new() };
        let unshown = |name: &str, at_rest: &[usize]| is_unshown(&columns(name), &hips, at_rest, 12);
        assert!(unshown("actuator_lag", &[0, 1, 3, 6, 9]));
        assert!(!unshown("actuator_lag", &[0, 3, 6]), "one of them moves");
        let all_rest: Vec<usize> = (0..12).collect();
        assert!(!unshown("pose_delay", &all_rest[1..]) && unshown("pose_delay", &all_rest));
        let with_speed = |e: &&crate::problem::library::Effect| unshown(&e.name, &[0, 3, 6, 9]);
        let all: Vec<String> = built_in().iter().filter(with_speed).map(|e| e.name.clone()).collect();
        let known = [
            "command_latency",
            "observation_latency",
            "actuator_lag",
            "joint_viscous_friction",
            "joint_armature",
            "motor_gain_kd",
        ];
        assert_eq!(all, known);
    }
}
