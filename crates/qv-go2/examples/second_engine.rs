//! The Go2's trot in qv-sim and in the second engine, and how far they are apart:
//! `cargo run --release -p quadverse-go2 --features rapier --example second_engine`.

use qv_go2::gait::Trot;
use qv_go2::model::{self, ARMATURE, DEFAULT_KD, DEFAULT_KP, STAND};
use qv_sim::rapier::{Motion, compare_engines};
use qv_sim::{BaseKind, Model, ModelOptions, SimError, SimOptions, State, Terrain};

fn main() -> Result<(), SimError> {
    let options = ModelOptions { base: BaseKind::Floating, armature: ARMATURE, ..Default::default() };
    let go2 = Model::from_urdf(&model::urdf(), &options)?;
    let mut q = vec![0.0, 0.0, model::touching_height(&STAND), 1.0, 0.0, 0.0, 0.0];
    q.extend(STAND);
    let start = State { q, v: vec![0.0; go2.nv()] };
    let trot = Trot::default();
    let target = |t: f64| trot.target(t).to_vec();
    for (friction, time_constant) in [(0.8, 0.008), (0.2, 0.008), (0.8, 0.004), (0.8, 0.002)] {
        let ground = Terrain::plane().with_friction(friction)?;
        let parameters = [("contact.time_constant", time_constant)];
        let (kp, kd) = (DEFAULT_KP, DEFAULT_KD);
        let motion = Motion { start: &start, duration: 4.0, kp, kd, target: &target, parameters: &parameters };
        let found = compare_engines(&go2, &ground, &SimOptions::default(), &motion)?;
        println!("friction {friction}, time constant of contacts {time_constant} s: {found}");
        for (engine, end) in [("qv-sim", &found.first), ("second", &found.second)] {
            println!("  {engine} ends at x {:.4} y {:.4} z {:.4} m", end.q[0], end.q[1], end.q[2]);
        }
    }
    Ok(())
}
