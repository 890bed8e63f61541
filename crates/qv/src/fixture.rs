//! `qv fixture`: the made-up recording on which `cargo xtask pipeline` runs, so that it needs no robot and no download.

use crate::ground::{mesh_at, set_friction, terrain_at};
use crate::numbers::{not_negative, three, within};
use crate::open::{file_error, write_error};
use crate::output::{make_folder, put, staged, stream};
use crate::{Outcome, say};
use glam::DVec3;
use qv_core::{Material, TriangleMesh};
use qv_go2::synthetic::{self, Message, Robot};
use qv_mesh::files::glb;
use qv_recording::RecordingError;
use std::path::{Path, PathBuf};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv fixture --out out/fixture\n\
     \x20 qv replay out/fixture/run.mcap --terrain out/fixture/terrain.glb --out out/replay\n\
     \n\
     Results: run.mcap (stand, squat, trot), terrain.glb (two materials, a small ramp), truth.json (the hidden values)."
);

#[derive(clap::Args)]
pub struct Fixture {
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Set the random seed
    #[arg(long, default_value_t = 1, value_name = "N", help_heading = "Advanced")]
    seed: u64,
    /// Walk on this labelled mesh [flat at height 0 at the start]
    #[arg(long = "terrain", value_name = "FILE.glb", alias = "ground", help_heading = "Input")]
    ground: Option<PathBuf>,
    /// Override the friction of a label (repeatable)
    #[arg(long, value_name = "LABEL=VALUE", value_parser = label_and_value, help_heading = "Input")]
    friction: Vec<(String, f64)>,
    /// Set the start pose: x (m), y (m), yaw (rad)
    #[arg(long, value_name = "X,Y,YAW", default_value = "0,0,0", allow_hyphen_values = true, value_parser = place, help_heading = "Input")]
    start: [f64; 3],
    /// Set the hidden command latency
    #[arg(long, default_value_t = 0.008, value_name = "SECONDS", value_parser = latency, help_heading = "What to test")]
    latency: f64,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Fixture {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let in_out = |name: &str| self.out.join(name);
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let file = self.ground.clone().unwrap_or_else(|| in_out("terrain.glb"));
        if self.ground.is_none() {
            write(&file, &glb::write(&ground()))?;
        }
        // Read back, so that the robot walks on what the file says in its 32-bit numbers.
        let mut mesh = mesh_at(&staged(&file), "a mesh in GLB")?;
        set_friction(&mut mesh, &self.friction, &file)?;
        let terrain = terrain_at(&file, &mesh)?;
        let mut parameters = synthetic::small_differences(self.seed);
        parameters.extend(synthetic::command_latency(self.latency));
        let robot = Robot { parameters, seed: self.seed, start: self.start };
        let messages = synthetic::record(&terrain, &robot)?;
        let bag = in_out("run.mcap");
        write_recording(&bag, &messages)?;
        write(&in_out("truth.json"), format!("{:#}\n", self.truth(&robot)).as_bytes())?;
        if self.json {
            let line = serde_json::json!({
                "format": "qv-fixture/1", "messages": messages.len(), "seconds": synthetic::DURATION, "out": self.out,
            });
            say(&format!("{line}\n"))?;
            return Ok(Outcome::Done);
        }
        say(&format!("{} messages, {} s, written to {}\n", messages.len(), synthetic::DURATION, self.out.display()))?;
        Ok(Outcome::Done)
    }

    fn truth(&self, robot: &Robot) -> serde_json::Value {
        let parameters: serde_json::Map<_, _> =
            robot.parameters.iter().map(|(name, value)| (name.clone(), (*value).into())).collect();
        serde_json::json!({
            "effect": "command_latency", "value": self.latency, "unit": "s",
            "friction": self.friction.iter().cloned().collect::<std::collections::BTreeMap<_, _>>(),
            "seed": self.seed, "start": self.start, "parameters": parameters,
        })
    }
}

/// Writes a recording.
///
/// # Errors
/// There is no room for the whole of it, or it cannot be written there.
pub fn write_recording(path: &Path, messages: &[Message]) -> Result<(), RecordingError> {
    let remarks = |e: RecordingError| file_error(path, "room for the whole of it", &e.to_string());
    stream(path, |e| write_error(path, &e), |file| synthetic::write_bag(messages, file).map_err(remarks))
}

fn place(text: &str) -> Result<[f64; 3], String> {
    three(text, "X,Y,YAW")
}

/// Longest latency of commands with which the robot is let walk \[s\].
const LATEST: f64 = 0.2;

fn latency(text: &str) -> Result<f64, String> {
    within(text, 0.0, LATEST)
}

pub fn label_and_value(text: &str) -> Result<(String, f64), String> {
    let (label, value) = text.split_once('=').ok_or("expected LABEL=VALUE")?;
    Ok((label.into(), not_negative(value)?))
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), RecordingError> {
    put(path, bytes).map_err(|e| write_error(path, &e))
}

/// The ground: concrete, from x = 0.6 m on tiles, which rise from x = 0.9 to 1.4 m by 3 cm and stay there.
fn ground() -> TriangleMesh {
    const WIDTH: f64 = 2.5;
    let mut mesh = TriangleMesh {
        materials: vec![
            Material { name: "concrete".into(), friction: Some(0.8) },
            Material { name: "tile".into(), friction: Some(0.6) },
        ],
        ..Default::default()
    };
    let strips =
        [(-2.0, 0.6, 0.0, 0.0, 0), (0.6, 0.9, 0.0, 0.0, 1), (0.9, 1.4, 0.0, 0.03, 1), (1.4, 5.0, 0.03, 0.03, 1)];
    for (x0, x1, z0, z1, label) in strips {
        let first = mesh.vertices.len() as u32;
        for (x, y, z) in [(x0, -WIDTH, z0), (x1, -WIDTH, z1), (x1, WIDTH, z1), (x0, WIDTH, z0)] {
            mesh.vertices.push(DVec3::new(x, y, z));
        }
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.labels.extend([label; 2]);
    }
    mesh
}
