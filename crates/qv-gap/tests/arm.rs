//! Recordings of a simulated arm whose cause is known, through the whole diagnosis.

use qv_gap::report::{Report, Verdict};
use qv_gap::{Options, diagnose};
use qv_replay::Run;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};
use std::fmt::Write;

const ARM: &str = r#"<robot name="arm">
<link name="bench"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/><inertia ixx="0.004" iyy="0.004" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.12"/><mass value="0.4"/><inertia ixx="0.002" iyy="0.002" izz="0.0003" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"#;

const SETTINGS: &str =
    "robot = \"arm.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 12.0\nkd = 0.4\ntau_max = 20.0\n";

/// From, until \[s\], and torque on the elbow \[N m\].
type Push = (f64, f64, f64);

fn model() -> Model {
    Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap()
}

/// Twelve seconds at 500 Hz of slow swings, positions with an encoder's noise.
fn recorded(parameters: &[(&str, f64)], pushes: &[Push], seed: u64) -> Run {
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
            let q = batch.state(0).unwrap().q;
            let (a, b) = (q[0] + noise(), q[1] + noise());
            writeln!(csv, "{time:.4},{:.6},{:.6},{a:.7},{b:.7}", command[0], command[1]).unwrap();
        }
        let push = pushes.iter().find(|p| (p.0..p.1).contains(&time)).map_or(0.0, |p| p.2);
        batch.set_parameter(0, "joint.elbow.external_torque", push).unwrap();
        let (zero, kp, kd) = ([0.0; 2], [12.0; 2], [0.4; 2]);
        batch.set_command(0, &JointCommand { q: &command, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        batch.step();
    }
    qv_replay::read_table(csv.as_bytes(), SETTINGS, Some(ARM), None).unwrap()
}

fn of(runs: &[Run], reference: Vec<Run>) -> Report {
    let options = Options { reference, ..Default::default() };
    diagnose(runs, &model(), &Terrain::none(), &options, 0).unwrap().report
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
