//! A thousand balls on a plane, each with its own restitution: `cargo run --release -p quadverse-sim --example drop`.

use qv_sim::{BaseKind, Batch, Model, ModelOptions, SimError, SimOptions, State, Terrain};

const BALL: &str = r#"<robot name="ball"><link name="ball">
  <inertial><mass value="0.5"/><inertia ixx="0.002" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><sphere radius="0.1"/></geometry></collision></link></robot>"#;

fn main() -> Result<(), SimError> {
    let ball = Model::from_urdf(BALL, &ModelOptions { base: BaseKind::Floating, ..Default::default() })?;
    let mut sim = Batch::<f32>::new(&ball, &Terrain::plane(), &SimOptions::default(), 1000)?;
    for env in 0..sim.len() {
        sim.set_parameter(env, "contact.restitution", env as f64 / 1250.0)?;
        sim.set_state(env, &State { q: vec![0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], v: vec![0.0; 6] })?;
    }
    println!("{} lanes, {} bytes per ball", sim.lanes(), sim.bytes_per_environment());
    for tenth in 0..10 {
        sim.step_many_parallel(100);
        let height = |env: usize| sim.state(env).map(|s| s.q[2]);
        println!(
            "{:.1} s: height {:.3} m at restitution 0, {:.3} m at 0.4, {:.3} m at 0.8",
            0.1 * f64::from(tenth + 1),
            height(0)?,
            height(500)?,
            height(999)?
        );
    }
    Ok(())
}
