//! Recordings of a simulated arm whose cause is known, through the whole diagnosis.

use crate::facts::States;
use crate::two_links::{ARM, SETTINGS, model};
use qv_gap::decision::evidence::Evidence;
use qv_gap::decision::{HeldWindows, Policy};
use qv_gap::export::{to_html, to_json};
use qv_gap::inference::linearised::NullOptions;
use qv_gap::report::{Report, Verdict, report as rendered};
use qv_gap::{Diagnosis, Options, diagnose};
use qv_recording::Run;
use qv_recording::run::GainSource;
use qv_replay::find_gains;
use qv_sim::{Batch, JointCommand, SimOptions, Terrain};
use std::fmt::Write;

/// From, until \[s\], and torque on the elbow \[N m\].
type Push = (f64, f64, f64);

/// Twelve seconds at 500 Hz of slow swings, positions with an encoder's noise.
fn recorded(parameters: &[(&str, f64)], pushes: &[Push], seed: u64) -> Run {
    read(&table(parameters, pushes, seed), SETTINGS)
}

fn table(parameters: &[(&str, f64)], pushes: &[Push], seed: u64) -> String {
    let options = SimOptions { timestep: 0.001, max_command_latency: 0.05, ..Default::default() };
    let mut batch = Batch::<f64>::new(&model(), &Terrain::none(), &options, 1).unwrap();
    parameters.iter().for_each(|(name, value)| batch.set_parameter(0, name, *value).unwrap());
    let mut csv = "time,cmd_pos.shoulder,cmd_pos.elbow,pos.shoulder,pos.elbow\n".to_string();
    let mut state = seed;
    let mut noise = || {
        // A sum of uniform numbers is near enough to a normal one.
        let mut uniform = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        1e-4 * (0..12).map(|_| uniform()).sum::<f64>()
    };
    for tick in 0..12_000 {
        let time = f64::from(tick) * 1e-3;
        let command = [0.6 * (2.1 * time).sin() + 0.2 * (5.3 * time).sin(), 0.5 * (3.1 * time).sin()];
        if tick % 2 == 0 {
            let q = batch.sensors(0).unwrap().q;
            let (a, b) = (q[0] + noise(), q[1] + noise());
            writeln!(csv, "{time:.4},{:.6},{:.6},{a:.7},{b:.7}", command[0], command[1]).unwrap();
        }
        let push = pushes.iter().find(|p| (p.0..p.1).contains(&time)).map_or(0.0, |p| p.2);
        batch.set_parameter(0, "joint.elbow.external_torque", push).unwrap();
        let (zero, kp, kd) = ([0.0; 2], [12.0; 2], [0.4; 2]);
        batch.set_command(0, &JointCommand { q: &command, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        batch.step();
    }
    csv
}

fn read(csv: &str, settings: &str) -> Run {
    qv_recording::read_table(csv.as_bytes(), settings, Some(ARM), None).unwrap()
}

/// Fewer simulated recordings than by default: these tests are run often.
fn quick() -> Options<'static> {
    Options { effort: NullOptions { replicates: 6, ..Default::default() }, ..Default::default() }
}

fn of(runs: &[Run], reference: Vec<Run>) -> Report {
    let options = Options { reference, ..quick() };
    diagnose(runs, &model(), &Terrain::none(), &options, 0).unwrap().report
}

/// The same arm, whose torques were recorded, too.
fn with_torques(parameters: &[(&str, f64)]) -> Run {
    let options = SimOptions { timestep: 0.001, ..Default::default() };
    let mut batch = Batch::<f64>::new(&model(), &Terrain::none(), &options, 1).unwrap();
    parameters.iter().for_each(|(name, value)| batch.set_parameter(0, name, *value).unwrap());
    let names = ["cmd_pos", "pos", "tau"].map(|c| format!("{c}.shoulder,{c}.elbow"));
    let mut csv = format!("time,{}\n", names.join(","));
    for tick in 0..12_000 {
        let time = f64::from(tick) * 1e-3;
        let command = [0.6 * (2.1 * time).sin() + 0.2 * (5.3 * time).sin(), 0.5 * (3.1 * time).sin()];
        let q = batch.sensors(0).unwrap().q;
        let (zero, kp, kd) = ([0.0; 2], [12.0; 2], [0.4; 2]);
        batch.set_command(0, &JointCommand { q: &command, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        batch.step();
        if tick % 5 == 0 {
            let tau = batch.sensors(0).unwrap().tau;
            let [a, b] = command;
            writeln!(csv, "{time:.4},{a:.6},{b:.6},{:.7},{:.7},{:.6},{:.6}", q[0], q[1], tau[0], tau[1]).unwrap();
        }
    }
    read(&csv, SETTINGS)
}

#[test]
fn torques_without_references_are_judged_by_simulated_robots() {
    let calm = of(&[with_torques(&[])], Vec::new());
    assert_eq!((calm.verdict, calm.causes.len()), (Verdict::NoGap, 0), "{}", calm.sentence);
    assert!(calm.sentence.contains("simulated robots within the tolerances"), "{}", calm.sentence);
    let viscous = of(&[with_torques(&[("joint.elbow.viscous_friction", 1.0)])], Vec::new());
    assert_eq!(viscous.causes[0].effect, "joint_viscous_friction", "{}", viscous.sentence);
    let least = viscous.can_tell.iter().find(|c| c.effect == "joint_viscous_friction" && c.scope == ["elbow"]).unwrap();
    assert!(least.least_size.is_some_and(|size| size > 0.0 && size < 1.0), "{least:?}");
    let page = to_html(&viscous, None, "arm", &[], &[]);
    assert!(page.contains("<h2>Torques</h2>") && page.contains("Friction over speed"));
    assert!(page.contains("false alarms of these tests") && page.contains("eight of ten"));
    assert!(!page.contains("mrad") && !page.contains("by probability"), "positions are not compared");
}

#[test]
fn two_pushes_are_told_with_their_times_and_torques() {
    let pushes = [(3.05, 3.35, 1.5), (7.3, 7.6, -1.2)];
    let report = of(&[recorded(&[], &pushes, 5)], Vec::new());
    let found: Vec<_> = report.causes.iter().filter(|c| c.effect == "external_torque").collect();
    assert_eq!(found.len(), 2, "{} {:?} {:?}", report.sentence, report.causes, report.next);
    // One window of four is held out: the fit does not see where in it a push begins or ends.
    const WINDOW: f64 = 0.15;
    for push in pushes {
        let near = found.iter().find(|c| (c.parameters[1].value - push.0).abs() < WINDOW + 0.01);
        let cause = near.unwrap_or_else(|| panic!("nothing at {} s: {found:?}", push.0));
        assert_eq!(cause.scope, ["elbow"]);
        assert!((cause.parameters[0].value - push.2).abs() < 0.2 * push.2.abs(), "{:?}", cause.parameters);
        assert!((cause.parameters[2].value - push.1).abs() < WINDOW + 0.01, "{:?}", cause.parameters);
    }
    assert!(matches!(report.verdict, Verdict::Explained | Verdict::PartlyExplained), "{}", report.sentence);
}

/// What was measured says all that the report does, whatever came of it.
#[test]
fn stored_evidence_gives_the_report_of_its_diagnosis() {
    let load = [("link.lower.payload_mass", 0.3)];
    let nothing =
        Policy { held_windows: HeldWindows { least_evidence: 1e9, ..Default::default() }, ..Policy::default() };
    for (parameters, policy) in [(&load[..], Policy::default()), (&load[..], nothing), (&[][..], Policy::default())] {
        let options = Options { policy, ..quick() };
        let runs = [recorded(parameters, &[], 17)];
        let Diagnosis { report, evidence, .. } = diagnose(&runs, &model(), &Terrain::none(), &options, 0).unwrap();
        let stored = String::from_utf8(evidence.to_json()).unwrap();
        let again = rendered(&Evidence::read(&stored, "evidence.json").unwrap(), &options.policy).unwrap();
        // How long it took is not evidence.
        let report = Report { timing: again.timing.clone(), ..report };
        assert_eq!(to_json(&again), to_json(&report));
        assert_eq!(to_html(&again, None, "arm", &[], &[]), to_html(&report, None, "arm", &[], &[]));
    }
}

#[test]
fn an_arm_that_nothing_pushes_is_not_pushed() {
    let report = of(&[recorded(&[], &[], 6)], Vec::new());
    assert_eq!(report.verdict, Verdict::NoGap, "{}", report.sentence);
    assert!(report.causes.is_empty() && report.leads.is_empty());
}

/// Joints that rub and answer late, in a way that the simulator does not know, and then a load at the end.
#[test]
fn against_a_reference_the_load_is_named_and_not_what_was_there_before() {
    let before =
        [("actuator.shoulder.lag", 0.012), ("actuator.elbow.lag", 0.009), ("joint.elbow.coulomb_friction", 0.05)];
    let after = [&before[..], &[("link.lower.payload_mass", 0.25)]].concat();
    let loaded = recorded(&after, &[], 8);
    let report = of(std::slice::from_ref(&loaded), vec![recorded(&before, &[], 9)]);
    assert_eq!(report.causes.first().map(|c| c.effect.as_str()), Some("payload_mass"), "{}", report.sentence);
    let lag = report.corrections.iter().find(|c| c.parameter == "actuator.shoulder.lag").map(|c| c.value);
    assert!(lag.is_some_and(|lag| (lag - 0.012).abs() < 0.004), "{:?}", report.corrections);
    let same = of(&[recorded(&before, &[], 10)], vec![recorded(&before, &[], 9)]);
    assert_eq!(same.verdict, Verdict::NoGap, "{}", same.sentence);
}

/// A load beyond the end of the last link: where it is, and how heavy.
#[test]
fn a_load_is_found_where_it_hangs() {
    let run = recorded(&[("link.lower.payload_mass", 0.3), ("link.lower.payload_z", -0.2)], &[], 11);
    let report = of(&[run], Vec::new());
    let cause = report.causes.first().unwrap_or_else(|| panic!("{} {:?}", report.sentence, report.next));
    assert_eq!(
        (cause.effect.as_str(), cause.scope[0].as_str()),
        ("payload_off_centre", "lower"),
        "{}",
        report.sentence
    );
    let of = |name: &str| cause.parameters.iter().find(|p| p.name == name).unwrap();
    let (mass, moment) = (of("payload_mass"), of("payload_moment_z"));
    assert!((mass.ci95[0]..mass.ci95[1]).contains(&0.3), "{mass:?}");
    assert!((moment.ci95[0]..moment.ci95[1]).contains(&-0.06) && moment.unit == "kg m", "{moment:?}");
}

/// Motors of three fifths of the stated gain, in joints that rub: taken one by one the first that fits takes over what belongs to the others.
#[test]
fn several_faults_at_once_are_sized_together() {
    let both = |field: &str, value: f64| ["shoulder", "elbow"].map(|j| (field.replace('*', j), value));
    let faults = [
        both("actuator.*.kp_scale", 0.6),
        both("joint.*.viscous_friction", 0.15),
        both("joint.*.coulomb_friction", 0.08),
    ]
    .concat();
    let faults: Vec<(&str, f64)> = faults.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    // Nothing is accused under this policy.
    let policy =
        Policy { held_windows: HeldWindows { least_evidence: 1e9, ..Default::default() }, ..Policy::default() };
    let options = Options { policy, ..Default::default() };
    let report = diagnose(&[recorded(&faults, &[], 12)], &model(), &Terrain::none(), &options, 0).unwrap().report;
    let together = report.together.as_ref().unwrap_or_else(|| panic!("{}", report.sentence));
    for (effect, truth) in [("motor_gain_kp", -0.4), ("joint_viscous_friction", 0.15), ("joint_coulomb_friction", 0.08)]
    {
        let found = together.effects.iter().find(|e| e.effect == effect);
        let found = found.unwrap_or_else(|| panic!("no {effect} in {together:?}"));
        let [low, high] = found.parameters[0].ci95;
        assert!((low..high).contains(&truth), "{effect}: {found:?}");
    }
    assert!(together.closed > 0.95, "{together:?}");
}

/// Two recordings without a load and two with one.
#[test]
fn recordings_that_disagree_are_told_apart() {
    let load = [("link.lower.payload_mass", 0.3)];
    let runs = [recorded(&[], &[], 13), recorded(&[], &[], 14), recorded(&load, &[], 15), recorded(&load, &[], 16)];
    let report = of(&runs, Vec::new());
    assert!(report.sentence.states("recordings 1 2"), "{}", report.sentence);
    assert!(report.sentence.states("recordings 3 4"), "{}", report.sentence);
}

/// Gains of a servo whose register nobody can read are found from the motion, and accused of nothing; what hides beside them is.
#[test]
fn unknown_gains_are_found_and_no_cause() {
    let settings = SETTINGS.replace("kp = 12.0", "kp = \"unknown\"").replace("kd = 0.4", "kd = \"unknown\"");
    let with_gains = |parameters: &[(&str, f64)], seed| {
        let mut runs = [read(&table(parameters, &[], seed), &settings)];
        assert!(diagnose(&runs, &model(), &Terrain::none(), &Options::default(), 0).is_err(), "no gain is guessed");
        find_gains(&mut runs, &model(), &Terrain::none(), &[]).unwrap();
        let [run] = runs;
        run
    };
    let run = with_gains(&[], 21);
    let gains = [run.actuator.kp.unwrap(), run.actuator.kd.unwrap()];
    for (gain, (truth, known)) in gains.into_iter().zip([12.0, 0.4].into_iter().zip(run.actuator.gains)) {
        let GainSource::Found(deviation) = known else { panic!("{known:?}") };
        assert!((gain / truth - 1.0).abs() < 0.03 && deviation < 0.1, "{gain} {deviation}");
    }
    assert!(run.remarks.iter().any(|t| t.states("kp unknown")), "{:?}", run.remarks);
    let report = of(&[run], Vec::new());
    assert_eq!(report.verdict, Verdict::NoGap, "{}", report.sentence);

    let payload = [("link.lower.payload_mass", 0.25)];
    let report = of(&[with_gains(&payload, 22)], Vec::new());
    let named = report.ranking.iter().find(|r| r.effect.starts_with("motor_gain"));
    assert!(named.is_none(), "{named:?}");
    let cause =
        report.causes.first().unwrap_or_else(|| panic!("{} {:?} {:?}", report.sentence, report.leads, report.next));
    assert!(cause.effect.starts_with("payload"), "{}", report.sentence);
}
