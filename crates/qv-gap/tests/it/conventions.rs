//! Recordings of a simulated Go2 in which a channel has another sign, unit or order than this project's.

use crate::recorded::{go2, recorded};
use qv_core::JointSeries;
use qv_gap::inference::linearised::NullOptions;
use qv_gap::report::Verdict;
use qv_gap::{Options, diagnose};
use qv_recording::Run;
use qv_recording::faults::examine;
use qv_recording::run::FaultKind;
use qv_rollout::WindowOptions;
use qv_sim::Terrain;

fn scale(series: &mut Option<JointSeries>, columns: std::ops::Range<usize>, by: f64) {
    let series = series.as_mut().unwrap();
    for row in series.values.chunks_exact_mut(series.joints) {
        row[columns.clone()].iter_mut().for_each(|x| *x *= by);
    }
}

/// w, x, y, z to x, y, z, w.
fn reorder(series: &mut Option<JointSeries>, first: usize) {
    let series = series.as_mut().unwrap();
    series.values.chunks_exact_mut(series.joints).for_each(|row| row[first..first + 4].rotate_left(1));
}

fn remarks(run: &mut Run) -> Vec<(String, String)> {
    run.faults.clear();
    examine(run, None);
    let foreign = run.faults.iter().filter(|f| f.kind == FaultKind::Convention);
    foreign.map(|f| (f.channel.clone(), f.detail.clone())).collect()
}

/// Channel, what is reported for it, and how it comes to be so.
type Case = (&'static str, &'static str, fn(&mut Run));

#[test]
fn each_is_told_by_name() {
    let good = recorded(Vec::new(), 4);
    assert_eq!(remarks(&mut good.clone()), []);
    let cases: [Case; 13] = [
        ("torque FL_calf_joint", "sign", |r| scale(&mut r.measured.torque, 2..3, -1.0)),
        ("torque RR_hip_joint", "thousandths", |r| scale(&mut r.measured.torque, 9..10, 1e3)),
        ("torque FL_thigh_joint", "another unit", |r| scale(&mut r.measured.torque, 1..2, 1.0 / 6.33)),
        ("velocity FR_calf_joint", "sign", |r| scale(&mut r.measured.velocity, 5..6, -1.0)),
        ("gyro y", "sign", |r| scale(&mut r.measured.gyro, 1..2, -1.0)),
        ("gyro x", "sign", |r| scale(&mut r.measured.gyro, 0..1, -1.0)),
        ("base pose", "taken for x, y, z, w", |r| {
            let pose = r.measured.base_pose.as_mut().unwrap();
            pose.values.chunks_exact_mut(7).for_each(|row| row[3..].rotate_right(1));
        }),
        ("base pose", "centimetres", |r| scale(&mut r.measured.base_pose, 0..3, 1e2)),
        ("orientation", "x, y, z, w", |r| reorder(&mut r.measured.orientation, 0)),
        ("orientation", "view of the world", |r| scale(&mut r.measured.orientation, 1..4, -1.0)),
        ("base pose", "x, y, z, w", |r| reorder(&mut r.measured.base_pose, 3)),
        ("base pose", "millimetres", |r| scale(&mut r.measured.base_pose, 0..3, 1e3)),
        ("acceleration", "g", |r| scale(&mut r.measured.acceleration, 0..3, 1.0 / 9.81)),
    ];
    for (channel, what, spoil) in cases {
        let mut run = good.clone();
        spoil(&mut run);
        let remarks = remarks(&mut run);
        assert!(matches!(&remarks[..], [(c, d)] if c == channel && d.contains(what)), "{channel}, {what}: {remarks:?}");
    }
    // An IMU that takes gravity away is no IMU that counts in g.
    let mut run = good.clone();
    let acceleration = run.measured.acceleration.as_mut().unwrap();
    acceleration.values.iter_mut().skip(2).step_by(3).for_each(|z| *z -= 9.81);
    let found = remarks(&mut run);
    assert!(matches!(&found[..], [(c, d)] if c == "acceleration" && d.contains("gravity was taken away")), "{found:?}");
    // Half of a channel is worth having, a quarter is not.
    let stop = |share: f64| {
        let mut run = good.clone();
        let gyro = run.measured.gyro.as_mut().unwrap();
        let first = (share * gyro.len() as f64) as usize;
        gyro.values.iter_mut().skip(3 * first + 1).step_by(3).for_each(|y| *y = f64::NAN);
        remarks(&mut run)
    };
    assert_eq!(stop(0.7), []);
    assert_eq!(stop(0.25), [("gyro y".into(), "no values in 75 % of the recording".into())]);
    let mut run = good.clone();
    scale(&mut run.measured.gyro, 0..1, -1.0);
    reorder(&mut run.measured.orientation, 0);
    let both: Vec<String> = remarks(&mut run).into_iter().map(|t| t.0).collect();
    assert_eq!(both, ["orientation", "gyro x"]);
    let mut run = good.clone();
    scale(&mut run.measured.velocity, 0..12, 180.0 / std::f64::consts::PI);
    scale(&mut run.measured.gyro, 0..3, 180.0 / std::f64::consts::PI);
    let remarks = remarks(&mut run);
    assert_eq!(
        remarks.iter().filter(|t| t.0.starts_with("velocity") && t.1.contains("degrees")).count(),
        12,
        "{remarks:?}"
    );
    assert_eq!(remarks.iter().filter(|t| t.0.starts_with("gyro") && t.1.contains("degrees")).count(), 3, "{remarks:?}");
}

#[test]
fn nothing_is_accused_on_a_channel_of_another_convention() {
    let mut run = recorded(Vec::new(), 4);
    scale(&mut run.measured.torque, 2..3, -1.0);
    scale(&mut run.measured.velocity, 0..12, 180.0 / std::f64::consts::PI);
    reorder(&mut run.measured.base_pose, 3);
    run.faults.clear();
    examine(&mut run, None);
    let options = Options {
        cut: WindowOptions { most: 32, ..Default::default() },
        effort: NullOptions { replicates: 6, ..Default::default() },
        ..Default::default()
    };
    let report = diagnose(std::slice::from_ref(&run), &go2(), &Terrain::plane(), &options, 0).unwrap().report;
    assert_eq!(report.verdict, Verdict::NoGap, "{}", report.sentence);
    for channel in ["torque FL_calf_joint", "velocity RR_calf_joint", "base pose"] {
        assert!(
            report.cannot_tell.iter().any(|line| line.starts_with(channel)),
            "{channel} in {:?}",
            report.cannot_tell
        );
    }
}
