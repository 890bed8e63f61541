//! Policies of others, here and in MuJoCo, from the same start. They are not in the repository: the test wants their files
//! in the folder that `QV_POLICIES` names, and says that it skips.

use crate::skipped::skipped;
use qv_policy::onnx::OnnxPolicy;
use qv_policy::roll::{Description, roll};
use qv_sim::{Batch, Model, ModelOptions, Shape, SimOptions, State, Terrain};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Description, policy, URDF (without one: the Go2).
const POLICIES: [(&str, &str, Option<&str>); 3] = [
    ("rl_sar_go2", "rl_sar_robot_lab_go2", None),
    ("dls_go2", "dls_go2", None),
    ("playground_go1", "playground_go1", Some("go1")),
];
/// Forward, left \[m/s\], counter-clockwise \[rad/s\]; and how long \[s\].
const COMMAND: [f64; 3] = [0.5, 0.0, 0.0];
const DURATION: f64 = 4.0;

fn python() -> Option<PathBuf> {
    let candidate = std::env::var_os("QV_PYTHON_ONNX").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let works = Command::new(&candidate).args(["-c", "import mujoco, onnxruntime"]).output();
    works.ok().filter(|output| output.status.success()).map(|_| candidate)
}

/// As MuJoCo runs: solved to the end, and motors whose torque does not fall with speed.
fn batch(model: &Model, description: &Description) -> Batch<f64> {
    let terrain = Terrain::plane().with_friction(description.simulation.friction).unwrap();
    let options =
        SimOptions { timestep: description.simulation.timestep, tolerance: Some(1e-12), ..Default::default() };
    let mut batch = Batch::<f64>::new(model, &terrain, &options, 1).unwrap();
    for joint in &description.joints {
        batch.set_parameter(0, &format!("actuator.{joint}.speed_knee"), 1e6).unwrap();
        batch.set_parameter(0, &format!("actuator.{joint}.speed_zero"), 2e6).unwrap();
    }
    batch
}

/// Level, at rest, in the stand, the lowest sphere 1 mm above the ground: whether one that just
/// touches is a contact in the first step hangs on rounding.
fn standing(model: &Model, description: &Description) -> State {
    let mut q = vec![0.0; model.nq()];
    q[3] = 1.0;
    for (joint, angle) in description.joints.iter().zip(&description.stand) {
        q[7 + model.joint_index(joint).unwrap()] = *angle;
    }
    let poses = model.world_from_links(&q);
    let lowest = model.geoms.iter().filter_map(|geom| match geom.shape {
        Shape::Sphere(radius) => Some((poses[geom.link] * geom.link_from_geom).position.z - radius),
        _ => None,
    });
    q[2] = 0.001 - lowest.fold(f64::INFINITY, f64::min);
    State { q, v: vec![0.0; model.nv()] }
}

#[test]
fn they_walk_here_as_in_mujoco() {
    let Some(folder) = std::env::var_os("QV_POLICIES").map(PathBuf::from) else {
        skipped("QV_POLICIES does not name a folder with policies of others");
        return;
    };
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (name, policy, robot) in POLICIES {
        let file = folder.join(format!("{policy}.onnx"));
        let description_file = crate_folder.join("descriptions").join(format!("{name}.toml"));
        let description = Description::from_toml(&std::fs::read_to_string(&description_file).unwrap()).unwrap();
        let urdf_file = robot.map(|robot| crate_folder.join("robots").join(format!("{robot}.urdf")));
        let urdf = urdf_file.as_ref().map_or_else(qv_go2::model::urdf, |file| std::fs::read_to_string(file).unwrap());
        let model =
            Model::from_urdf(&urdf, &ModelOptions { armature: description.simulation.armature, ..Default::default() })
                .unwrap();
        let mut batch = batch(&model, &description);
        let mut policy = OnnxPolicy::from_bytes(&std::fs::read(&file).unwrap()).unwrap();
        let rolled =
            roll(&mut batch, &description, &standing(&model, &description), (COMMAND, DURATION), &[], |observation| {
                let mut action = Vec::new();
                policy.run(observation, &mut action).map(|()| action)
            })
            .unwrap();
        let end = rolled.base.last().unwrap();
        let forward = end[0] / (COMMAND[0] * DURATION);
        assert!((0.85..1.15).contains(&forward), "{name}: walked {} m of {}", end[0], COMMAND[0] * DURATION);
        assert!(rolled.base.iter().all(|base| base[2] > 0.25), "{name} stays up");
        let Some(python) = python() else {
            println!("{name}: not compared: no Python with mujoco and onnxruntime (cargo xtask test makes one)");
            continue;
        };
        let ours = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.json"));
        let json = serde_json::json!({ "base": rolled.base, "joints": rolled.joints });
        std::fs::write(&ours, json.to_string()).unwrap();
        let script = crate_folder.join("../../fixtures/mujoco/roll.py");
        let robot = urdf_file.unwrap_or_else(|| PathBuf::from("go2"));
        let mut command = Command::new(python);
        command.arg(script).args([&description_file, &file, &robot]).arg("--compare").arg(&ours);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        println!("{name}: {found}");
        let apart = found["ours"]["path_m"].as_f64().unwrap();
        assert!(apart < 0.05, "{name}: base paths {apart} m apart");
    }
}
