//! Lets the rivals of the diagnosis judge a recording, and writes `DIR/baselines.json`:
//! `cargo run --release -p qv-baselines --example rivals -- RUN --terrain plane --out DIR [--robot FILE]`.

mod open;

use clap::Parser;
use qv_baselines::{CMA_ES_STEPS, baselines};
use qv_gap::inference::linearised::NullOptions;
use qv_gap::{Options, problem::library};
use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;

#[derive(Parser)]
struct Arguments {
    /// A bag (.mcap), or a folder with run.csv and run.toml
    run: PathBuf,
    /// plane, or a mesh with a material per label, z up, in the frame of the poses
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb")]
    terrain: String,
    /// URDF or MJCF of the robot; default: what the recording says. Meshes beside it are left out
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Seed of the simulated recordings without an effect, and of the rivals
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Folder for baselines.json; made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let run = open::run(&arguments.run)?;
    let model = open::model(&run, &arguments.run, arguments.robot.as_deref())?;
    let terrain = open::terrain(&arguments.terrain)?;
    // A mesh may be off under a foot, as for `qv diagnose`.
    let ground_error = if terrain.is_plane() { 0.0 } else { open::GROUND_ERROR };
    let clock = Instant::now();
    let seconds = || clock.elapsed().as_secs_f64();
    let told = |at: &qv_gap::Progress| eprintln!("{} of {}: {}", at.stage, at.stages, at.name);
    let options = Options {
        library: library::built_in(),
        effort: NullOptions { seed: arguments.seed, ground_error, ..Default::default() },
        clock: Some(&seconds),
        progress: Some(&told),
        ..Default::default()
    };
    let found = baselines(&[run], &model, &terrain, &options, CMA_ES_STEPS)?;
    fs::create_dir_all(&arguments.out)?;
    fs::write(arguments.out.join("baselines.json"), serde_json::to_string_pretty(&found)? + "\n")?;
    Ok(())
}
