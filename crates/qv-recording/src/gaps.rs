//! Single values that are missing: a message that was lost, a cell that is blank.

use crate::run::{FaultKind, Run};
use qv_core::JointSeries;

/// Most values on end that are filled.
const MOST: usize = 5;
/// Longest time between the known ones beside them \[s\]: over that a joint that walks goes some milliradians off a straight line, and over the
/// longer one a trunk some millimetres.
const OF_JOINTS: f64 = 0.025;
const OF_POSES: f64 = 0.05;
/// Parts of a quaternion that differ by more than this are of two signs of it.
const ONE_SIGN: f64 = 0.5;

/// The run with commands held where they are blank, and measured values in between where up to five on end are missing; and in words how many those
/// are of each channel. Where a joint's position jumped its values were taken out as wrong, and what was recorded with them may be: holes stay
/// there. Torques are left: nothing foretells them from those beside them.
pub fn without_gaps(mut run: Run) -> (Run, Vec<String>) {
    let c = &mut run.commands;
    [&mut c.position, &mut c.velocity, &mut c.torque, &mut c.kp, &mut c.kd].into_iter().flatten().for_each(hold);
    let jumps = run.faults.iter().filter(|f| f.kind == FaultKind::Jump);
    let jumps: Vec<&str> = jumps.filter_map(|f| f.channel.strip_prefix("position ")).collect();
    let is_sound = |name: &str, column: usize| {
        name != "positions" || run.joint_names.get(column).is_none_or(|joint| !jumps.contains(&joint.as_str()))
    };
    let m = &mut run.measured;
    let channels = [
        ("positions", &mut m.position, [OF_JOINTS, f64::INFINITY]),
        ("velocities", &mut m.velocity, [OF_JOINTS, f64::INFINITY]),
        ("gyro", &mut m.gyro, [OF_JOINTS, f64::INFINITY]),
        ("acceleration", &mut m.acceleration, [OF_JOINTS, f64::INFINITY]),
        ("orientation", &mut m.orientation, [OF_JOINTS, ONE_SIGN]),
        ("base pose", &mut m.base_pose, [OF_POSES, ONE_SIGN]),
    ];
    let mut remarks = Vec::new();
    for (name, series, apart) in channels {
        let filled = series.as_mut().map_or(0, |series| {
            (0..series.joints).filter(|&c| is_sound(name, c)).map(|c| fill(series, c, apart)).sum()
        });
        if filled > 0 {
            remarks.push(format!(
                "{filled} single values of {name} are missing: they are taken to lie between those beside them"
            ));
        }
    }
    (run, remarks)
}

/// Blank cells hold the value before, those before the first value the first.
pub fn hold(series: &mut JointSeries) {
    if series.values.iter().all(|x| x.is_finite()) {
        return;
    }
    for column in 0..series.joints {
        let Some(mut before) = series.column(column).find(|x| x.is_finite()) else { continue };
        for x in series.values.iter_mut().skip(column).step_by(series.joints) {
            if x.is_finite() { before = *x } else { *x = before }
        }
    }
}

/// Fills the holes of a column that are short, and lie between values that are no farther apart than this in time \[s\] and in size; returns how many
/// values that were.
fn fill(series: &mut JointSeries, column: usize, [longest, farthest]: [f64; 2]) -> usize {
    let joints = series.joints;
    let known: Vec<usize> = (0..series.len()).filter(|i| series.values[i * joints + column].is_finite()).collect();
    let mut filled = 0;
    for pair in known.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        let [from, to] = [a, b].map(|i| (series.time[i], series.values[i * joints + column]));
        let is_short = b - a - 1 <= MOST && to.0 - from.0 <= longest && (to.1 - from.1).abs() <= farthest;
        if !is_short {
            continue;
        }
        for i in a + 1..b {
            let share = (series.time[i] - from.0) / (to.0 - from.0);
            series.values[i * joints + column] = from.1 + share * (to.1 - from.1);
            filled += 1;
        }
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(missing: &[usize], step: f64) -> JointSeries {
        let time: Vec<f64> = (0..40).map(|k| step * f64::from(k)).collect();
        let value = |k: usize| if missing.contains(&k) { f64::NAN } else { 3.0 * k as f64 };
        JointSeries { time, values: (0..40).flat_map(|k| [value(k), 1.0]).collect(), joints: 2 }
    }

    #[test]
    fn short_holes_are_filled_and_long_ones_stay() {
        let mut series = line(&[0, 4, 10, 11, 12, 13, 14, 20, 21, 22, 23, 24, 25, 39], 0.002);
        assert_eq!(fill(&mut series, 0, [0.025, f64::INFINITY]), 6);
        assert_eq!(fill(&mut series, 1, [0.025, f64::INFINITY]), 0);
        for k in [4, 10, 12, 14] {
            assert!((series.row(k)[0] - 3.0 * k as f64).abs() < 1e-9);
        }
        assert!([0, 20, 25, 39].iter().all(|&k| series.row(k)[0].is_nan()));
        assert_eq!(fill(&mut line(&[4], 0.02), 0, [0.025, f64::INFINITY]), 0, "too far apart in time");
        assert_eq!(fill(&mut line(&[4], 0.002), 0, [0.025, 0.5]), 0, "too far apart");
    }

    #[test]
    fn blank_commands_hold_the_one_before() {
        let mut series = line(&[0, 1, 7, 8, 39], 0.002);
        hold(&mut series);
        assert_eq!([0, 1, 2, 7, 8, 9, 39].map(|k| series.row(k)[0]), [6.0, 6.0, 6.0, 18.0, 18.0, 27.0, 114.0]);
        let mut nothing = line(&(0..40).collect::<Vec<_>>(), 0.002);
        hold(&mut nothing);
        assert!(nothing.row(3)[0].is_nan() && nothing.row(3)[1] == 1.0);
    }
}
