//! `qv replay`: how far the simulator is from the robot.

use crate::open::{model_of, open_run};
use crate::{Outcome, RunArguments};
use qv_replay::replay::{ReplayOptions, parameters_from_toml};
use qv_replay::ReplayError;
use qv_sim::Terrain;
use std::fs;
use std::path::PathBuf;

pub const EXAMPLE: &str = "Example:\n  qv replay walk.mcap --out out/walk\n  qv replay walk.mcap --robot go2 --terrain yard.glb \
    --params out/diagnosis/calibrated.toml --out out/walk\n\n\
    Writes replay.json, replay.mcap and replay.html. A parameter file holds numbers under parameter names, such as\n\
    \"joint.*.coulomb_friction\" = 0.2.\n\n\
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done with part of the input lost (named).";

#[derive(clap::Args)]
pub struct Replay {
    #[command(flatten)]
    run: RunArguments,
    /// go2, or a URDF file; default: what the recording says
    #[arg(long, value_name = "go2|URDF")]
    robot: Option<String>,
    /// plane, or a mesh with a material per label
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb")]
    terrain: String,
    /// Parameters of the simulator, as `qv diagnose` writes them
    #[arg(long, value_name = "FILE.toml")]
    params: Option<PathBuf>,
    /// Directory for the results; made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Length of the windows that restart at the measured state [s]
    #[arg(long, default_value_t = 0.3, value_name = "SECONDS")]
    window: f64,
    /// One line of JSON at the end instead of the summary
    #[arg(long)]
    json: bool,
}

impl Replay {
    pub fn execute(&self) -> Result<Outcome, ReplayError> {
        let run = open_run(&self.run)?;
        let model = model_of(&run, self.robot.as_deref())?;
        let terrain = self.terrain()?;
        let parameters = match &self.params {
            None => Vec::new(),
            Some(path) => {
                let text = fs::read_to_string(path).map_err(|e| ReplayError::File {
                    file: path.display().to_string(),
                    expected: "a parameter file".into(),
                    found: e.to_string(),
                })?;
                parameters_from_toml(&text)?
            }
        };
        let options = ReplayOptions { window: self.window, parameters, ..Default::default() };
        let clock = std::time::Instant::now();
        let replay = qv_replay::replay::replay(&run, &model, &terrain, &options)?;
        let factor = replay.simulated / clock.elapsed().as_secs_f64();
        for (name, e) in replay.joint_names.iter().zip(replay.errors.joints.iter().zip(&replay.window_errors.joints)) {
            println!("{name:<16} {:9.2} {:9.2}  {:.3} {:.3}", 1e3 * e.0.position, 1e3 * e.1.position, e.1.velocity, e.1.torque);
        }
        println!("{:.3} {:.3} mrad, {} windows, x{factor:.0}", 1e3 * replay.errors.position_mean(), 1e3 * replay.window_errors.position_mean(), replay.windows.windows.len());
        println!("{:?} {:?} {:?}", replay.errors.base, replay.window_errors.phases, replay.lags.iter().map(|l| (1e3 * l.lag).round()).collect::<Vec<_>>());
        Ok(if run.is_partial() { Outcome::Partial } else { Outcome::Done })
    }

    fn terrain(&self) -> Result<Terrain, ReplayError> {
        if self.terrain == "plane" {
            return Ok(Terrain::plane());
        }
        unimplemented!()
    }
}
