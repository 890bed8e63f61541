//! An arm of two links that carries half a kilogram, beside three recordings of it without the load: `cargo run -p quadverse-held --example weigh`.

use qv_held::{Outcome, Policy, Request, decide, measure};
use qv_recording::Run;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};
use std::fmt::Write;

/// The arm as a URDF.
pub const ARM: &str = r#"<robot name="arm"><link name="base"/>
  <link name="upper"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
    <inertia ixx="0.002" iyy="0.016" izz="0.016" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.12 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.006" izz="0.006" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="60" velocity="20"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="40" velocity="20"/></joint></robot>"#;
const SETTINGS: &str = "robot = \"arm.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = [120.0, 80.0]\nkd = [6.0, 3.0]\n\
    [joint.shoulder]\narmature = 0.05\ncoulomb_friction = 0.3\nviscous_friction = 0.2\n\
    [joint.elbow]\narmature = 0.03\ncoulomb_friction = 0.2\nviscous_friction = 0.1\n";

/// Ten seconds at 200 Hz under some parameters; motions differ by `phase`.
pub fn recorded(model: &Model, parameters: &[(&str, f64)], phase: f64) -> Result<Run, Box<dyn std::error::Error>> {
    let mut arm = Batch::<f64>::new(model, &Terrain::none(), &SimOptions::default(), 1)?;
    let stated = [("shoulder", [0.05, 0.3, 0.2]), ("elbow", [0.03, 0.2, 0.1])];
    for (joint, values) in stated {
        for (key, value) in ["armature", "coulomb_friction", "viscous_friction"].iter().zip(values) {
            arm.set_parameter(0, &format!("joint.{joint}.{key}"), value)?;
        }
    }
    parameters.iter().try_for_each(|(name, value)| arm.set_parameter(0, name, *value))?;
    let names = ["cmd_pos", "pos", "tau"].map(|c| format!("{c}.shoulder,{c}.elbow"));
    let mut csv = format!("time,{}\n", names.join(","));
    for tick in 0..10_000 {
        let time = 1e-3 * f64::from(tick);
        let command =
            [0.7 * (2.1 * time + phase).sin() + 0.2 * (5.3 * time).sin(), 0.6 * (3.1 * time + 2.0 * phase).sin()];
        let q = arm.sensors(0)?.q;
        arm.set_command(
            0,
            &JointCommand { q: &command, dq: &[0.0; 2], kp: &[120.0, 80.0], kd: &[6.0, 3.0], tau: &[0.0; 2] },
        )?;
        arm.step();
        if tick % 5 == 0 {
            let tau = arm.sensors(0)?.tau;
            writeln!(csv, "{time},{},{},{},{},{},{}", command[0], command[1], q[0], q[1], tau[0], tau[1])?;
        }
    }
    Ok(qv_recording::read_table(csv.as_bytes(), SETTINGS, Some(ARM), None)?)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let model = Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() })?;
    let references = [0.0, 1.0, 2.0].map(|phase| recorded(&model, &[], phase));
    let references = references.into_iter().collect::<Result<Vec<Run>, _>>()?;
    let runs = [recorded(&model, &[("link.lower.payload_mass", 0.5)], 3.0)?];
    let policy = Policy::default();
    let request = Request {
        runs: &runs,
        references: &references,
        model: &model,
        given: &[],
        without: &[],
        seed: 1,
        policy: &policy,
    };
    let evidence = measure(&request)?;
    let decision = decide(&evidence, &policy);
    if let Outcome::Cause(k, _) = decision.outcome {
        let (tested, judged) = (&evidence.tested[k], &decision.judged[k]);
        let hypothesis = &tested.hypothesis;
        println!("{} of {}: {:.3} kg", hypothesis.effect, hypothesis.scope.join(", "), tested.size[0]);
        println!("interval {:.3} to {:.3} kg", judged.ci95[0][0], judged.ci95[0][1]);
    }
    Ok(())
}
