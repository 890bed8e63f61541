//! Hides something in the camera of recordings, diagnoses them, and scores the answers.
//!
//! ```text
//! cargo run --release -p quadverse-camera --example sealed_cameras -- yard 5 1000
//! cargo run --release -p quadverse-camera --example sealed_cameras -- rgbd ../shared/scenes/redkitchen 5 1000 [scene.ply|TRAINING_STEPS [SAVE.ply]]
//! ```
//! The numbers are recordings for each effect (and as many with none), and the seed. For an RGB-D folder the scene must have been
//! learned without every 2nd image from the first on (`--hold-out N` for every Nth); without a file it is learned here, at half the
//! size, and what its camera was found to be mounted by is saved beside it (SCENE.json). `--shared` shows what all images share,
//! `--width N` compares larger or smaller pictures.

#[path = "../tests/it/footage/mod.rs"]
mod footage;

use footage::{HiddenError, Truth, error, recording, through, yard};
use qv_camera::{Intrinsics, LookOptions, look};
use qv_core::Pose;
use qv_gap::decision::{Policy, decide_camera};
use qv_gap::report::Sight;
use qv_splat::captures::rgbd;
use qv_splat::files::{Format, points, read_any, write};
use qv_splat::train::{CpuEngine, Dataset, Engine, Model, ReadOptions, TrainOptions, of_points, train};
use std::fs;
use std::path::Path;
use std::time::Instant;
use yard::noise::Random;

const KINDS: usize = 6;

/// The number after a flag.
fn flag(name: &str, default: usize) -> usize {
    let mut arguments = std::env::args().skip_while(|a| a != name).skip(1);
    arguments.next().and_then(|a| a.parse().ok()).unwrap_or(default)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, default: u64| arguments.get(k).and_then(|a| a.parse().ok()).unwrap_or(default);
    match arguments.first().map(String::as_str) {
        Some("yard") => {
            let (count, seed) = (number(1, 2), number(2, 1000));
            let mut score = Score::default();
            let mut truth = None;
            for k in 0..count * KINDS as u64 {
                // A new yard for every sixth recording.
                if k % KINDS as u64 == 0 {
                    truth = Some(yard(36, 320, 240, 0.02, seed + k));
                }
                score.one(truth.as_ref().expect("made above"), k as usize % KINDS, seed + 7919 * k)?;
            }
            score.notify();
        }
        Some("rgbd") => {
            let folder = arguments.get(1).ok_or("expected a folder")?;
            let (count, seed) = (number(2, 2), number(3, 1000));
            let truth = kitchen(
                Path::new(folder),
                arguments.get(4).map(String::as_str),
                arguments.get(5).map(String::as_str).filter(|a| a.ends_with(".ply")),
            )?;
            let mut score = Score::default();
            for k in 0..count * KINDS as u64 {
                score.one(&truth, k as usize % KINDS, seed + 7919 * k)?;
            }
            score.notify();
        }
        _ => eprintln!("expected yard COUNT SEED, or rgbd FOLDER COUNT SEED [scene.ply|STEPS]"),
    }
    Ok(())
}

/// Held-out images of an RGB-D folder, with poses of the camera as those of the base, 20 frames of 30 Hz apart.
fn kitchen(folder: &Path, scene: Option<&str>, save: Option<&str>) -> Result<Truth, Box<dyn std::error::Error>> {
    let names: Vec<String> =
        fs::read_dir(folder)?.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let mut text = |name: &str| {
        fs::read_to_string(folder.join(name)).map_err(|e| qv_splat::error_at(name, "text", &e.to_string()))
    };
    let capture = rgbd::read(&names, &mut text)?;
    let files = |name: &str| fs::read(folder.join(name)).map_err(|e| e.to_string());
    let dataset = Dataset::new(&capture, &files, &ReadOptions { downscale: 2, hold_out: flag("--hold-out", 2) })?;
    // Cameras are judged over black.
    let dataset = Dataset { background: [0.0; 3], ..dataset };
    let (cloud, base_from_camera) = match scene {
        Some(path) if path.ends_with(".ply") => {
            let text = fs::read_to_string(Path::new(path).with_extension("json"))?;
            let [x, y, z, w, i, j, k]: [f64; 7] = serde_json::from_str(&text)?;
            let mounting = Pose::from_position_wxyz([x, y, z], [w, i, j, k]);
            let mounting = mounting.ok_or("expected a pose, found no rotation")?;
            (read_any(&fs::read(path)?)?.cloud, mounting)
        }
        steps => {
            let options = TrainOptions {
                iterations: steps.and_then(|s| s.parse().ok()).unwrap_or(2000),
                poses: std::env::args().any(|a| a == "--poses"),
                ..Default::default()
            };
            let start = of_points(&points::read(&fs::read(folder.join("points.ply"))?)?, &options)?;
            let mut engine = CpuEngine::new(&dataset, &options, Model::new(start, &dataset))?;
            let clock = Instant::now();
            train(&mut engine, dataset.training.len(), options.iterations, options.seed, 100, &mut |_, progress| {
                if progress.iteration % 100 == 0 {
                    eprintln!("{} steps, {:.0} s ", progress.iteration, clock.elapsed().as_secs_f64());
                }
                Ok(true)
            })?;
            let model = engine.model()?;
            // Poses may turn out to be of something that the camera is mounted on.
            let mounting = model.shared[model.groups[0]].motion.inverse();
            if let Some(path) = save {
                fs::write(path, write(&model.cloud, Format::Ply)?)?;
                let numbers = [&mounting.position.to_array()[..], &mounting.wxyz()].concat();
                fs::write(Path::new(path).with_extension("json"), serde_json::to_string(&numbers)?)?;
            }
            (model.cloud, mounting)
        }
    };
    let time = |name: &str| {
        let digits: String = name.chars().filter(char::is_ascii_digit).collect();
        digits.parse::<f64>().unwrap_or(0.0) / 30.0
    };
    let mut frames: Vec<(f64, Pose)> = dataset
        .training
        .iter()
        .chain(&dataset.held_out)
        .map(|p| (time(&p.name), p.camera.camera_from_world.inverse()))
        .collect();
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let c = dataset.held_out[0].camera;
    let intrinsics = Intrinsics { fx: c.fx, fy: c.fy, cx: c.cx, cy: c.cy, width: c.width, height: c.height };
    let images = dataset.held_out.iter().map(|p| (time(&p.name), p.pixels.rgba.clone())).collect();
    let span = [frames[0].0 - 0.3, frames[frames.len() - 1].0 + 0.3];
    let (times, poses) = frames.into_iter().unzip();
    Ok(Truth { intrinsics, base_from_camera, path: through(times, poses), span, images, cloud })
}

#[derive(Default)]
struct Score {
    rows: Vec<(HiddenError, String, f64)>,
}

impl Score {
    fn one(&mut self, truth: &Truth, kind: usize, seed: u64) -> Result<(), Box<dyn std::error::Error>> {
        let hidden = HiddenError::draw(kind, &mut Random::new(seed, 5));
        let recording = recording(truth, hidden, seed);
        let clock = Instant::now();
        let look =
            look(&recording.footage(&truth.cloud), &LookOptions { width: flag("--width", 160), ..Default::default() })?;
        let sight = Sight::new(&look.evidence, &decide_camera(&look.evidence, &Policy::default()));
        let first = sight.causes.first();
        let name = first.map_or("none".to_string(), |c| c.effect.clone());
        let off = first.filter(|c| c.effect == hidden.name()).map_or(f64::NAN, |c| error(hidden, c));
        println!(
            "{hidden:?}\n  {:?} {name}{} off {off:.4} level {:.2} {:.2} closed {:.2} rms {:.4} {:.4} {:.4} noise rot {:.4} pos {:.4} gain {:.3} {:?} {:.1} s",
            sight.verdict,
            if sight.causes.len() > 1 { " and more" } else { "" },
            sight.level[0],
            sight.level[1],
            sight.gap.closed,
            sight.gap.before,
            sight.gap.after,
            sight.gap.floor,
            sight.noise.rotation,
            sight.noise.translation,
            sight.noise.gain,
            sight.evidence.iter().map(|(n, e)| format!("{} {e:.0}", &n[7..])).collect::<Vec<_>>(),
            clock.elapsed().as_secs_f64()
        );
        if std::env::args().any(|a| a == "--shared") {
            for p in &sight.shared {
                println!("    {} {:.4} [{:.4} {:.4}] {}", p.name, p.value, p.ci95[0], p.ci95[1], p.unit);
            }
        }
        self.rows.push((hidden, name, off));
        Ok(())
    }

    fn notify(&self) {
        for kind in ["none", "camera_exposure", "camera_delay", "camera_extrinsics", "camera_focal", "camera_blur"] {
            let of: Vec<&(HiddenError, String, f64)> = self.rows.iter().filter(|r| r.0.name() == kind).collect();
            let right = of.iter().filter(|r| r.1 == kind).count();
            let mut errors: Vec<f64> = of.iter().map(|r| r.2).filter(|e| e.is_finite()).collect();
            errors.sort_by(f64::total_cmp);
            let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
            let most = errors.last().copied().unwrap_or(f64::NAN);
            println!("{kind:>18}: {right} of {} right; error median {median:.4}, most {most:.4}", of.len());
        }
    }
}
