//! A diagnosis that nobody made, as one of a trotting Go2 with slow motors and a slick patch would look.
#![allow(dead_code)]

use qv_gap::report::*;
use qv_rollout::Trace;
use qv_sim::{BaseKind, Model, ModelOptions};

pub fn go2() -> Model {
    let options =
        ModelOptions { base: BaseKind::Floating, armature: qv_go2::model::ARMATURE, mesh_reader: None, held: &[] };
    Model::from_urdf(&qv_go2::model::urdf(), &options).unwrap()
}

pub fn correction(parameter: &str, value: f64, nominal: f64, unit: &str) -> Correction {
    Correction { parameter: parameter.into(), value, nominal, unit: unit.into() }
}

fn share(name: &str, share: f64) -> Share {
    Share { name: name.into(), share }
}

fn estimate(name: &str, value: f64, ci95: [f64; 2], unit: &str) -> ParameterEstimate {
    ParameterEstimate { name: name.into(), value, ci95, unit: unit.into() }
}

/// Something between 0 and 1 that looks like chance.
fn chance(k: usize) -> f64 {
    let x = (k as f64 * 12.9898).sin() * 43758.5453;
    x - x.floor()
}

/// Nothing was found, since nothing is there.
pub fn empty() -> Report {
    Report {
        format: FORMAT.into(),
        verdict: Verdict::NoGap,
        sentence: "Simulator and robot agree as well as noise lets them.".into(),
        gap: Gap {
            before: 1.0,
            after: 1.0,
            floor: 1.0,
            closed: f64::NAN,
            closed_ci95: [f64::NAN; 2],
            closed_in_fit: None,
            unit: String::new(),
            heldout: false,
            joint_rms: [f64::NAN; 2],
            joint_rms_apart: None,
        },
        place: Where::default(),
        causes: Vec::new(),
        ranking: Vec::new(),
        leads: Vec::new(),
        together: None,
        rounds: Vec::new(),
        visual: None,
        torque_balance: None,
        unexplained: Remainder::default(),
        cannot_tell: Vec::new(),
        next: Vec::new(),
        corrections: Vec::new(),
        heat_map: HeatMap::default(),
        floor_plan: Vec::new(),
        curves: Vec::new(),
        traces: Traces::default(),
        stages: Vec::new(),
        policy: Default::default(),
        provenance: None,
        corrections_apply: true,
        cannot_show: vec![],
        can_tell: vec![],
        timing: Default::default(),
    }
}

pub fn report() -> Report {
    Report {
        verdict: Verdict::Explained,
        sentence:
            "The motors answer 10.1 ms late (first-order lag, all joints), and a patch of floor near x = 1.4 m is \
                   slick (friction 0.21): together they close 91 % of the gap."
                .into(),
        gap: Gap {
            before: 38.2,
            after: 4.43,
            floor: 1.06,
            closed: 0.909,
            closed_ci95: [0.871, 0.934],
            closed_in_fit: Some(0.915),
            unit: "mean square of whitened residuals".into(),
            heldout: true,
            joint_rms: [0.0142, 0.0031],
            joint_rms_apart: None,
        },
        place: place(),
        causes: causes(),
        ranking: ranking(),
        visual: None,
        torque_balance: None,
        unexplained: Remainder {
            share: 0.091,
            depends_on: vec![
                Factor { factor: "load on the leg, |tau| of calf joints".into(), r2_heldout: 0.31 },
                Factor { factor: "sign of joint velocity".into(), r2_heldout: 0.12 },
                Factor { factor: "place on the floor".into(), r2_heldout: 0.04 },
            ],
        },
        cannot_tell: vec![
            "Torque limits: the largest torque in this recording is 17 N m, far below the limit of 23.7 N m.".into(),
            "Pose delay from gyroscope bias about z: the robot never turned.".into(),
        ],
        next: vec![
            "Put calibrated.toml to use: qv replay RUN --params calibrated.toml.".into(),
            "Record 20 s of 1 to 10 Hz chirps in the air at kp 20 and 40: that splits lag from command latency.".into(),
            "Walk over the patch near x = 1.4 m once more, at half the speed.".into(),
        ],
        corrections: corrections(),
        heat_map: heat_map(),
        floor_plan: (0..64).map(floor_point).collect(),
        curves: ["FL_calf_joint", "RR_thigh_joint"].iter().enumerate().map(|(k, joint)| curve(joint, k)).collect(),
        traces: traces(),
        stages: [("read and cut windows", 0), ("sensitivities", 350_000), ("null", 210_000)]
            .into_iter()
            .chain([("search", 1_120_000), ("held out and where", 160_000)])
            .map(|(name, steps)| Stage { name: name.into(), steps })
            .collect(),
        policy: Default::default(),
        provenance: None,
        corrections_apply: true,
        cannot_show: vec![],
        can_tell: vec![],
        timing: Timing { runtime_s: 17.1, stages_s: vec![0.4, 3.1, 2.2, 9.8, 1.6] },
        ..empty()
    }
}

fn place() -> Where {
    let joint = |(j, name): (usize, &&str)| {
        let weight = if name.contains("calf") {
            0.16
        } else if name.contains("thigh") {
            0.065
        } else {
            0.025
        };
        JointShare { name: (*name).into(), share: weight, pos_rms: 0.004 + 0.06 * weight + 0.002 * chance(j) }
    };
    let time = |k: usize| TimeShare {
        start: 0.3 * k as f64,
        end: 0.3 * (k + 1) as f64,
        share: 0.01 + 0.01 * chance(k) + if (30..38).contains(&k) { 0.03 } else { 0.0 },
    };
    Where {
        interfaces: vec![
            share("actuator", 0.68),
            share("contact", 0.24),
            share("inertial", 0.05),
            share("sensing", 0.03),
        ],
        joints: qv_go2::model::JOINT_NAMES.iter().enumerate().map(joint).collect(),
        legs: vec![share("FL", 0.27), share("FR", 0.24), share("RL", 0.25), share("RR", 0.24)],
        phases: vec![share("stance", 0.46), share("swing", 0.37), share("impact", 0.17)],
        times: (0..64).map(time).collect(),
        regions: vec![RegionShare { name: "patch".into(), x: [1.1, 1.75], y: [-0.35, 0.4], share: 0.22 }],
    }
}

fn causes() -> Vec<Cause> {
    let lag = Cause {
        effect: "actuator_lag".into(),
        score: 0.962,
        scope: vec!["all".into()],
        parameters: vec![estimate("lag", 0.010_12, [0.0096, 0.0106], "s")],
        closed_alone: 0.71,
        confusable_with: vec!["command_latency".into(), "motor_gain_kd".into()],
        separating_experiment: "command steps of torque: a lag rounds them off, a latency only moves them".into(),
        by_recording: Vec::new(),
    };
    let patch = Cause {
        effect: "ground_friction".into(),
        score: 0.884,
        scope: vec!["patch".into()],
        parameters: vec![
            estimate("patch.friction", 0.214, [0.17, 0.26], "1"),
            estimate("x_min", 1.12, [1.05, 1.2], "m"),
            estimate("x_max", 1.74, [1.66, 1.8], "m"),
        ],
        closed_alone: 0.19,
        confusable_with: Vec::new(),
        separating_experiment: "pull the standing robot sideways with a spring balance until it slips".into(),
        by_recording: Vec::new(),
    };
    vec![lag, patch]
}

fn ranking() -> Vec<RankedEffect> {
    [
        ("actuator_lag", 0.962),
        ("ground_friction", 0.884),
        ("command_latency", 0.031),
        ("unknown", 0.012),
        ("motor_gain_kd", 0.004),
        ("contact_compliance", 0.003),
        ("joint_viscous_friction", 0.002),
        ("payload_mass", 0.001),
        ("imu_tilt", 0.0004),
        ("backlash", 0.0001),
    ]
    .into_iter()
    .map(|(effect, score)| RankedEffect { effect: effect.into(), score })
    .collect()
}

fn corrections() -> Vec<Correction> {
    let lag = |joint: &&str| correction(&format!("actuator.{joint}.lag"), 0.010_123_456_789, 0.0, "s");
    let mut all: Vec<Correction> = qv_go2::model::JOINT_NAMES.iter().map(lag).collect();
    for (name, value) in [("x_min", 1.12), ("x_max", 1.74), ("y_min", -0.35), ("y_max", 0.4)] {
        all.push(correction(&format!("terrain.patch.{name}"), value, 0.0, "m"));
    }
    all.push(correction("terrain.patch.friction", 0.214, 0.8, "1"));
    all
}

fn heat_map() -> HeatMap {
    let joints: Vec<String> = qv_go2::model::JOINT_NAMES.iter().map(|n| (*n).to_string()).collect();
    let windows = 64;
    let cell = |j: usize, k: usize| {
        let kind = [0.35, 0.7, 1.2][j % 3];
        let patch = if (30..38).contains(&k) { 0.012 * chance(j + 3) } else { 0.0 };
        kind * (0.008 + 0.008 * chance(31 * j + k)) + patch
    };
    let rows = |scale: f64| -> Vec<Vec<f64>> {
        (0..12).map(|j| (0..windows).map(|k| if k == 50 { f64::NAN } else { scale * cell(j, k) }).collect()).collect()
    };
    HeatMap { joints, times: (0..windows).map(|k| 0.3 * k as f64).collect(), before: rows(1.0), after: rows(0.22) }
}

fn floor_point(k: usize) -> FloorPoint {
    let t = k as f64 / 63.0;
    let (x, y) = (2.6 * t, 0.25 * (3.0 * t).sin() + 0.02 * chance(k));
    let inside = (1.1..1.75).contains(&x);
    let before = 6.0 + 10.0 * chance(k + 7) + if inside { 90.0 } else { 0.0 };
    FloorPoint { x, y, before, after: 1.0 + 0.08 * before * chance(k + 9) }
}

fn curve(joint: &str, k: usize) -> Curve {
    let time: Vec<f64> = (0..150).map(|i| 6.0 + 0.002 * i as f64).collect();
    let at = |t: f64, late: f64| -1.5 + 0.25 * (12.0 * (t - late) + k as f64).sin() + 0.05 * (30.0 * (t - late)).cos();
    Curve {
        joint: joint.into(),
        measured: time.iter().enumerate().map(|(i, &t)| at(t, 0.01) + 0.0006 * (chance(i) - 0.5)).collect(),
        before: time.iter().map(|&t| at(t, 0.01 - 0.06 * (t - 6.0).min(0.1))).collect(),
        after: time.iter().map(|&t| at(t, 0.01 - 0.006 * (t - 6.0).min(0.1))).collect(),
        time,
    }
}

/// Twelve joints in four windows of 0.3 s at 500 Hz; torques were not recorded.
fn traces() -> Traces {
    let joints: Vec<String> = qv_go2::model::JOINT_NAMES.iter().map(|n| (*n).to_string()).collect();
    let window = |w: usize| {
        let start = 6.0 + 1.2 * w as f64;
        let trace = |late: f64, noise: f64| {
            let time: Vec<f64> = (0..150).map(|i| start + 0.002 * i as f64).collect();
            let at = |(i, t): (usize, f64), j: usize| {
                let late = late * (t - start).min(0.1) / 0.1;
                -1.5 + 0.25 * (12.0 * (t - late) + j as f64).sin() + noise * (chance(i + 7 * j) - 0.5)
            };
            let rows = || time.iter().copied().enumerate().flat_map(|row| (0..12).map(move |j| (row, j)));
            Trace {
                position: rows().map(|(row, j)| at(row, j)).collect(),
                velocity: rows().map(|((i, t), j)| (at((i, t + 0.001), j) - at((i, t), j)) / 0.001).collect(),
                joints: 12,
                time,
                ..Trace::default()
            }
        };
        let [measured, before, after] = [(0.01, 0.0006), (0.004, 0.0), (0.0095, 0.0)].map(|(l, n)| trace(l, n));
        TracedWindow { run: 0, measured, before, after }
    };
    Traces { joints, windows: (0..4).map(window).collect() }
}

/// An arm of two links with friction in both joints, decided by its torque balance.
pub fn held() -> Report {
    let friction = |value: f64| estimate("coulomb_friction", value, [value - 0.02, value + 0.02], "N m");
    let cause = Cause {
        effect: "joint_coulomb_friction".into(),
        score: 0.95,
        scope: vec!["shoulder".into(), "elbow".into()],
        parameters: vec![friction(0.12), friction(0.08)],
        closed_alone: 0.8,
        confusable_with: vec!["load_friction".into()],
        separating_experiment: "move slowly with and without a load".into(),
        by_recording: Vec::new(),
    };
    let row = |joint: &str| qv_held::JointRow {
        joint: joint.into(),
        coulomb: [0.12, 0.01, 0.0],
        viscous: [0.01, 0.002, 0.0],
        armature: [0.002, 0.0001, 0.002],
        excitation: [1.2, 3.0],
        torque: [0.8, 0.1, 0.03],
    };
    let series = |scale: f64| (0..200).map(|k| scale * (0.1 * f64::from(k)).sin()).collect::<Vec<f64>>();
    let trace = |joint: &str| qv_held::TorqueTrace {
        joint: joint.into(),
        run: vec![0; 200],
        time: (0..200).map(|k| 0.04 * f64::from(k)).collect(),
        speed: series(1.5),
        measured: series(1.0),
        predicted: series(0.8),
        corrected: series(0.98),
        friction: series(0.2),
    };
    let balance = TorqueBalance {
        references: 3,
        p_gap: Some(0.001),
        joints: vec![row("shoulder"), row("elbow")],
        traces: vec![trace("shoulder"), trace("elbow")],
        ..TorqueBalance::default()
    };
    Report {
        verdict: Verdict::Explained,
        sentence: "Cause: joint coulomb friction of shoulder, elbow.".into(),
        gap: Gap {
            before: 4.2,
            after: 1.1,
            closed: 0.97,
            closed_ci95: [0.9, 1.0],
            heldout: true,
            unit: "mean square".into(),
            ..empty().gap
        },
        causes: vec![cause],
        torque_balance: Some(balance),
        next: vec![
            "Check the correction: `qv replay NEW_RUN --params out/why/calibrated.toml --out out/replay`.".into(),
        ],
        corrections_apply: true,
        ..empty()
    }
}
