//! Rounds with sealed effects: an arm is recorded and diagnosed, `next` proposes a motion, the arm with the same effect makes it, and the two
//! recordings together are diagnosed. Prints how often the effect was named first before and after.
//!
//! `cargo run --release -p quadverse-gap --example next_rounds -- ROUNDS SEED`

use qv_core::random::SplitMix64;
use qv_gap::next::{Proposal, hypotheses, next};
use qv_gap::{Options, diagnose};
use qv_recording::Run;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};
use std::fmt::Write;

const ARM: &str = r#"<robot name="arm">
<link name="bench"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/><inertia ixx="0.004" iyy="0.004" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.12"/><mass value="0.4"/><inertia ixx="0.002" iyy="0.002" izz="0.0003" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="30" velocity="12"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="30" velocity="12"/></joint>
</robot>"#;
const SETTINGS: &str =
    "robot = \"arm.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 12.0\nkd = 0.4\ntau_max = 20.0\n";
/// Effect, parameter of each joint (`{}`), least and largest size.
const EFFECTS: [(&str, &str, f64, f64); 7] = [
    ("motor_gain_kp", "actuator.{}.kp_scale", 0.7, 0.85),
    ("motor_strength", "actuator.{}.strength", 0.7, 0.85),
    ("motor_gain_kd", "actuator.{}.kd_scale", 1.3, 1.6),
    ("joint_viscous_friction", "joint.{}.viscous_friction", 0.08, 0.15),
    ("joint_coulomb_friction", "joint.{}.coulomb_friction", 0.06, 0.12),
    ("command_latency", "actuator.{}.command_latency", 0.008, 0.02),
    ("joint_armature", "joint.{}.armature", 0.006, 0.015),
];
const JOINTS: [&str; 2] = ["shoulder", "elbow"];

/// The arm with an effect follows commands `[T][joints]` of an interval \[s\]; positions with noise, at 200 Hz.
fn record(
    model: &Model,
    effect: &[(String, f64)],
    commands: &[Vec<f64>],
    interval: f64,
    random: &mut SplitMix64,
) -> Result<Run, Box<dyn std::error::Error>> {
    let options = SimOptions { timestep: 0.0005, max_command_latency: 0.05, ..Default::default() };
    let mut batch = Batch::<f64>::new(model, &Terrain::none(), &options, 1)?;
    // What any arm is off by, besides.
    for joint in JOINTS {
        batch.set_parameter(0, &format!("joint.{joint}.coulomb_friction"), 0.005 + 0.005 * random.uniform())?;
        batch.set_parameter(0, &format!("joint.{joint}.stribeck_friction"), 0.004 * random.uniform())?;
        batch.set_parameter(0, &format!("actuator.{joint}.strength"), 1.0 + 0.01 * (random.uniform() - 0.5))?;
    }
    for (name, value) in effect {
        batch.set_parameter(0, name, *value)?;
    }
    let mut csv = "time,cmd_pos.shoulder,cmd_pos.elbow,pos.shoulder,pos.elbow\n".to_string();
    let steps = (commands.len() as f64 * interval / options.timestep) as usize;
    for step in 0..steps {
        let time = step as f64 * options.timestep;
        let target = &commands[((time / interval + 1e-9) as usize).min(commands.len() - 1)];
        batch.set_command(
            0,
            &JointCommand { q: target, dq: &[0.0; 2], kp: &[12.0; 2], kd: &[0.4; 2], tau: &[0.0; 2] },
        )?;
        if step % 10 == 0 {
            let q = batch.state(0)?.q;
            let [a, b] = [0, 1].map(|j| q[j] + random.normal(3e-4));
            writeln!(csv, "{time:.4},{:.6},{:.6},{a:.7},{b:.7}", target[0], target[1])?;
        }
        batch.step();
    }
    Ok(qv_recording::read_table(csv.as_bytes(), SETTINGS, Some(ARM), None)?)
}

/// A recording as people make it: one slow motion of six seconds.
fn plain(random: &mut SplitMix64) -> Vec<Vec<f64>> {
    let [a, b] = [0.3 + 0.3 * random.uniform(), 0.3 + 0.3 * random.uniform()];
    let [f, g] = [0.25 + 0.15 * random.uniform(), 0.3 + 0.15 * random.uniform()];
    let row = |k: usize| {
        let t = 0.005 * k as f64;
        let turn = std::f64::consts::TAU;
        vec![a * (turn * f * t).sin(), b * (turn * g * t).sin()]
    };
    (0..1200).map(row).collect()
}

fn first_of(runs: &[Run], model: &Model) -> Result<(String, qv_gap::Diagnosis), Box<dyn std::error::Error>> {
    let found = diagnose(runs, model, &Terrain::none(), &Options::default(), 0)?;
    let first = found.report.causes.first().map_or_else(|| "nothing".to_owned(), |c| c.effect.clone());
    Ok((first, found))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(|a| a.parse::<u64>());
    let (rounds, seed) = (arguments.next().transpose()?.unwrap_or(7), arguments.next().transpose()?.unwrap_or(1));
    let model = Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() })?;
    let (mut before, mut after, mut predicted) = (0, 0, 0.0);
    for round in 0..rounds {
        let mut random = SplitMix64::of(seed, round);
        let (truth, pattern, least, most) = EFFECTS[round as usize % EFFECTS.len()];
        let size = least + (most - least) * random.uniform();
        let effect: Vec<(String, f64)> = JOINTS.iter().map(|j| (pattern.replace("{}", j), size)).collect();
        let recording = record(&model, &effect, &plain(&mut random), 0.005, &mut random)?;
        let (first, found) = first_of(std::slice::from_ref(&recording), &model)?;
        let open = hypotheses(&found.evidence, 3);
        let proposals: Vec<Proposal> =
            next(&recording, &model, &Terrain::none(), &Options::default(), &open, &|_, _| {})?;
        let best = &proposals[0];
        let second = record(&model, &effect, &best.motion.position, best.motion.interval, &mut random)?;
        let (then, _) = first_of(&[recording, second], &model)?;
        before += u64::from(first == truth);
        after += u64::from(then == truth);
        predicted += best.worth.decides;
        println!(
            "{truth:<24} {size:.4}  first {first:<24} next {} ({:.0} %), then {then}",
            best.motion.name,
            100.0 * best.worth.decides
        );
    }
    println!("{before} of {rounds} named by the first recording, {after} with the second; foretold {:.1}", predicted);
    Ok(())
}
