//! The law of motors against recorded torques, where a setting of the simulator says what was recorded, and what a diagnosis makes of it.

use crate::two_links::{ARM, SETTINGS, model};
use qv_core::random::SplitMix64;
use qv_gap::inference::linearised::NullOptions;
use qv_gap::report::Cause;
use qv_gap::{Options, diagnose};
use qv_recording::Run;
use qv_recording::faults::examine;
use qv_recording::run::FaultKind;
use qv_rollout::compare;
use qv_rollout::law::{Alignment, concerns, residual};
use qv_rollout::{Overrides, Rollout, WindowOptions};
use qv_sim::{Batch, JointCommand, SimOptions, Terrain};
use std::fmt::Write;

/// When the clock of the recorder stood as the run began \[s\].
const BEGINS: f64 = 100.0;

/// Twelve seconds of positions, speeds and torques at 500 Hz, with so many times the noise of good sensors.
fn recorded(set: &[(&str, f64)], noise: f64) -> Run {
    let mut random = SplitMix64::of(7, 0);
    let mut batch = Batch::<f64>::new(&model(), &Terrain::none(), &SimOptions::default(), 1).unwrap();
    set.iter().for_each(|(name, value)| batch.set_parameter(0, name, *value).unwrap());
    let mut csv =
        "time,cmd_pos.shoulder,cmd_pos.elbow,pos.shoulder,pos.elbow,vel.shoulder,vel.elbow,tau.shoulder,tau.elbow\n"
            .to_string();
    for tick in 0..12_000 {
        let time = f64::from(tick) * 1e-3;
        // Held for a row's two steps.
        let remarks = f64::from(tick / 2) * 2e-3;
        let command = [0.9 * (4.1 * remarks).sin() + 0.2 * (9.3 * remarks).sin(), 0.8 * (7.1 * remarks).sin()];
        if tick % 2 == 0 {
            let mut seen = batch.sensors(0).unwrap();
            for (channel, deviation) in [(&mut seen.q, 1e-4), (&mut seen.dq, 5e-3), (&mut seen.tau, 0.01)] {
                channel.iter_mut().for_each(|x| *x += random.normal(noise * deviation));
            }
            let row = command.iter().chain(&seen.q).chain(&seen.dq).chain(&seen.tau);
            let row: Vec<String> = row.map(|x| format!("{x:.8}")).collect();
            writeln!(csv, "{:.4},{}", BEGINS + time, row.join(",")).unwrap();
        }
        let (zero, kp, kd) = ([0.0; 2], [12.0; 2], [0.4; 2]);
        batch.set_command(0, &JointCommand { q: &command, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        batch.step();
    }
    qv_recording::read_table(csv.as_bytes(), SETTINGS, Some(ARM), None).unwrap()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), x| (sum + x * x, count + 1.0));
    f64::sqrt(sum / count)
}

/// What the laws, and the positions of simulated windows, leave without and with the setting that was recorded \[N m, rad\].
fn left(set: &[(&str, f64)]) -> [[f64; 2]; 2] {
    let (run, robot) = (recorded(set, 0.0), model());
    let rollout = Rollout::new(&run, &robot, &Terrain::none(), &[], WindowOptions::default()).unwrap();
    assert_eq!(rollout.law_joints, [0, 1]);
    let windows = rollout.windows(&run).unwrap();
    let mut truth: Overrides = set.iter().map(|(name, x)| (rollout.parameter(name).unwrap(), *x)).collect();
    truth.sort_by_key(|s| s.0);
    // A row shows the torque of the step before.
    let alignment = Alignment { command: 1e-3, state: 1e-3 };
    let law = |setting: &Overrides| rms(windows.iter().flat_map(|w| residual(&rollout, w, setting, alignment)));
    let all: Vec<_> = windows.iter().collect();
    let settings = [Overrides::new(), truth];
    let motion = compare(&rollout, &rollout.numerics, &all, &settings).unwrap();
    let positions = 2 * rollout.cut.bins();
    let of = |k: usize| rms(motion.values[k].iter().flat_map(|features| features[..positions].iter().copied()));
    [[law(&settings[0]), law(&settings[1])], [of(0), of(1)]]
}

#[test]
fn without_recorded_velocities_the_law_has_its_damping() {
    let mut run = recorded(&[], 1.0);
    run.measured.velocity = None;
    run.faults.clear();
    examine(&mut run, None);
    assert!(run.faults.iter().all(|fault| fault.kind != FaultKind::Convention), "{:?}", run.faults);
}

#[test]
fn a_strength_that_drifts_is_that_of_the_time_in_the_run() {
    let [law, motion] = left(&[("actuator.shoulder.strength_drift", -0.02), ("actuator.elbow.strength_drift", 0.01)]);
    assert!(law[1] < 0.1 * law[0], "{law:?} N m");
    assert!(motion[1] < 0.1 * motion[0], "{motion:?} rad");
}

#[test]
fn a_supply_sags_under_the_power_of_all_motors() {
    let [law, motion] = left(&[("supply.sag", 0.02)]);
    assert!(law[1] < 0.1 * law[0], "{law:?} N m");
    assert!(motion[1] < 0.1 * motion[0], "{motion:?} rad");
}

/// The encoder sits on the motor: it agrees with the torque, and not with where the load is.
#[test]
fn a_spring_in_series_is_in_the_motion_and_not_in_the_law() {
    let [law, motion] =
        left(&[("actuator.shoulder.series_compliance", 0.03), ("actuator.elbow.series_compliance", 0.05)]);
    assert!(law[0] < 0.02 && law[1] == law[0], "{law:?} N m");
    assert!(motion[1] < 0.1 * motion[0], "{motion:?} rad");
}

#[test]
fn what_changes_a_law_is_known() {
    let (run, robot) = (recorded(&[], 0.0), model());
    let rollout = Rollout::new(&run, &robot, &Terrain::none(), &[], WindowOptions::default()).unwrap();
    let changes = |name: &str, joint| concerns(&rollout, &vec![(rollout.parameter(name).unwrap(), 0.01)], joint);
    for (name, of) in [
        ("actuator.elbow.strength_drift", [false, true]),
        ("actuator.elbow.series_compliance", [false, false]),
        ("supply.sag", [true, true]),
        ("joint.elbow.armature", [false, false]),
    ] {
        assert_eq!([changes(name, 0), changes(name, 1)], of, "{name}");
    }
}

/// The first cause of a recording with the noise of good sensors, and whether it is an effect or one that looks like it in this recording.
fn first_cause(set: &[(&str, f64)], effect: &str) -> (Cause, bool) {
    let cut = WindowOptions { most: 24, ..Default::default() };
    let options = Options { cut, effort: NullOptions { replicates: 6, ..Default::default() }, ..Default::default() };
    let report = diagnose(&[recorded(set, 1.0)], &model(), &Terrain::none(), &options, 0).unwrap().report;
    let first = report.causes.first();
    let cause = first.unwrap_or_else(|| panic!("{} {:?} {:?}", report.sentence, report.leads, report.next)).clone();
    let is_named = cause.effect == effect || cause.confusable_with.iter().any(|e| e == effect);
    (cause, is_named)
}

fn holds(cause: &Cause, truth: f64, unit: &str) -> bool {
    let size = &cause.parameters[0];
    (size.ci95[0]..size.ci95[1]).contains(&truth) && size.unit == unit
}

/// The motor does as it is reported, and its encoder says so; what hangs on it does not follow.
#[test]
fn a_spring_between_motor_and_joint_is_named() {
    let (cause, is_named) = first_cause(&[("actuator.elbow.series_compliance", 0.05)], "series_compliance");
    assert!(is_named, "{cause:?}");
    let is_it = cause.effect == "series_compliance";
    assert!(!is_it || (cause.scope == ["elbow"] && holds(&cause, 0.05, "rad/(N m)")), "{cause:?}");
}

/// A battery that runs down, and no motor of another strength, which would be off from the first second on.
#[test]
fn motors_that_fade_while_they_are_recorded_are_named() {
    let fading = [("actuator.shoulder.strength_drift", -0.02), ("actuator.elbow.strength_drift", -0.02)];
    let (cause, is_named) = first_cause(&fading, "strength_drift");
    assert!(is_named, "{cause:?}");
    assert!(cause.effect != "strength_drift" || holds(&cause, -0.02, "1/s"), "{cause:?}");
}
