//! Seconds that steps of many Go2 take, for `cargo xtask bench python`: `bench_batch ENVIRONMENTS STEPS ROUNDS MODEL`. Prints the
//! fastest round as JSON; `fixtures/python/bench.py` does the same from Python, `fixtures/mujoco/many.py` with MuJoCo.

use qv_open::robot_model;
use qv_sim::{BaseKind, Batch, BatchCommand, SimOptions, State, Terrain};
use std::time::Instant;

const STAND: [f32; 12] = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let numbers: Vec<usize> = words.iter().take(3).map(|a| a.parse()).collect::<Result<_, _>>()?;
    let [count, steps, rounds] = numbers.try_into().unwrap_or([64, 20, 1]);
    let model = robot_model(words.get(3).map_or("go2", String::as_str), BaseKind::Floating)?;
    let mut batch = Batch::<f32>::new(&model, &Terrain::plane(), &SimOptions::default(), count)?;
    let mut q = vec![0.0, 0.0, 0.34, 1.0, 0.0, 0.0, 0.0];
    q.extend(STAND.map(f64::from));
    let state = State { q, v: vec![0.0; 18] };
    batch.reset(&vec![true; count], |_| state.clone())?;
    let (commands, kp, kd) = (STAND.repeat(count), [40.0; 12], [1.0; 12]);
    let (mut positions, mut velocities) = (vec![0.0; count * 19], vec![0.0; count * 18]);
    let start = batch.snapshot();
    let mut fastest = f64::INFINITY;
    for _ in 0..rounds {
        batch.restore(&start)?;
        let clock = Instant::now();
        batch.set_commands(&BatchCommand { q: &commands, dq: None, kp: &kp, kd: &kd, tau: None })?;
        batch.step_many_parallel(steps);
        batch.read_positions(&mut positions)?;
        batch.read_velocities(&mut velocities)?;
        fastest = fastest.min(clock.elapsed().as_secs_f64());
    }
    println!("{{\"seconds\": {fastest}}}");
    Ok(())
}
