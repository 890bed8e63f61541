//! Someone's policy on a robot in the simulator, level ground:
//! `roll_policy DESCRIPTION.toml POLICY.onnx ROBOT OUT.json [forward left turn seconds]`, where ROBOT is `go2` or a URDF.
//!
//! OUT.json holds `base` (x y z, w x y z) and `joints` per action, as `fixtures/mujoco/roll.py` writes them from MuJoCo.

use qv_policy::onnx::OnnxPolicy;
use qv_policy::roll::{Description, roll};
use qv_sim::{Batch, Model, ModelOptions, SimOptions, State, Terrain};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [description, policy, robot, out, numbers @ ..] = arguments.as_slice() else {
        return Err("expected DESCRIPTION.toml POLICY.onnx ROBOT OUT.json [forward left turn seconds]".into());
    };
    let mut settings = [0.5, 0.0, 0.0, 4.0];
    for (setting, text) in settings.iter_mut().zip(numbers) {
        *setting = text.parse()?;
    }
    let [forward, left, turn, seconds] = settings;
    let description = Description::from_toml(&std::fs::read_to_string(description)?)?;
    let urdf = if robot == "go2" { qv_go2::model::urdf() } else { std::fs::read_to_string(robot)? };
    let model =
        Model::from_urdf(&urdf, &ModelOptions { armature: description.simulation.armature, ..Default::default() })?;
    let terrain = Terrain::plane().with_friction(description.simulation.friction)?;
    // Tolerance and motors as in the reference: solved to the end, and torque that does not fall with speed.
    let options =
        SimOptions { timestep: description.simulation.timestep, tolerance: Some(1e-12), ..Default::default() };
    let mut batch = Batch::<f64>::new(&model, &terrain, &options, 1)?;
    for joint in &description.joints {
        batch.set_parameter(0, &format!("actuator.{joint}.speed_knee"), 1e6)?;
        batch.set_parameter(0, &format!("actuator.{joint}.speed_zero"), 2e6)?;
    }
    let start = standing(&model, &description);
    let mut policy = OnnxPolicy::from_bytes(&std::fs::read(policy)?)?;
    let rolled = roll(&mut batch, &description, &start, ([forward, left, turn], seconds), &[], |observation| {
        let mut action = Vec::new();
        policy.run(observation, &mut action).map(|()| action)
    })?;
    let json = serde_json::json!({ "base": rolled.base, "joints": rolled.joints, "observations": rolled.observations });
    std::fs::write(out, json.to_string())?;
    let end = rolled.base.last().ok_or("no sample")?;
    println!("{}: end at x {:.3} y {:.3} z {:.3} m after {seconds} s", description.name, end[0], end[1], end[2]);
    Ok(())
}

/// At rest in the description's stand, level, the lowest sphere 1 mm above the ground: whether one that just
/// touches is a contact in the first step hangs on rounding.
fn standing(model: &Model, description: &Description) -> State {
    let mut q = vec![0.0; model.nq()];
    q[3] = 1.0;
    for (name, angle) in description.joints.iter().zip(&description.stand) {
        if let Some(joint) = model.joint_index(name) {
            q[7 + joint] = *angle;
        }
    }
    let poses = model.world_from_links(&q);
    let lowest = model.geoms.iter().filter_map(|geom| match geom.shape {
        qv_sim::Shape::Sphere(radius) => Some((poses[geom.link] * geom.link_from_geom).position.z - radius),
        _ => None,
    });
    q[2] = 0.001 - lowest.fold(f64::INFINITY, f64::min);
    State { q, v: vec![0.0; model.nv()] }
}
