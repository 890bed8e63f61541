//! What is read of an MJCF: `cargo run --release --example mjcf -p quadverse-sim -- FILE.xml [GOLDEN.json]`. With a golden that
//! `fixtures/mjcf/generate.py --file FILE.xml` wrote, also how far the model is from MuJoCo's.

#[path = "../tests/it/against_mujoco/mod.rs"]
mod against_mujoco;

use qv_sim::mjcf::MjcfModel;
use qv_sim::{BaseKind, ModelOptions};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let file = arguments.first().ok_or("expected FILE.xml [GOLDEN.json], found nothing")?;
    let beside = Path::new(file).parent().unwrap_or(Path::new(""));
    let include = |name: &str| std::fs::read_to_string(beside.join(name)).map_err(|e| format!("{name}: {e}"));
    let options = ModelOptions { base: BaseKind::Floating, ..Default::default() };
    let read = MjcfModel::read(&std::fs::read_to_string(file)?, &options, &include)?;
    let model = &read.model;
    println!("{}: {:?} base, {:.4} kg, {} shapes", model.name, model.base, model.mass(), model.geoms.len());
    for (joint, gains) in model.joints.iter().zip(&read.gains) {
        let gains = gains.map_or_else(|| "no actuator".into(), |g| format!("kp {} kd {}", g.kp, g.kd));
        println!("  {} [{}, {}] effort {}, {gains}", joint.name, joint.lower, joint.upper, joint.effort);
    }
    println!("stand: {:?}", read.stand);
    model.left_out.iter().for_each(|what| println!("left out: {what}"));
    model.remarks.iter().for_each(|what| println!("told: {what}"));
    if let Some(golden) = arguments.get(1) {
        let golden = serde_json::from_str(&std::fs::read_to_string(golden)?)?;
        println!("{:?}", against_mujoco::compare(&read, &golden));
    }
    Ok(())
}
