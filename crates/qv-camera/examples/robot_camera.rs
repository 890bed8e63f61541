//! A robot's camera that nobody knows, and what a diagnosis finds of it: `robot_camera SEED OUT`.
//!
//! Exposure, delay, mounting, focal length and blur are drawn at once, 36 images of the yard are taken on a walk, and the camera is looked for in
//! them. `OUT/report.json` is what was found, as `qv diagnose --scene` writes it; `OUT/truth.json` is the same with the numbers that were drawn, and
//! intervals without width. Both are cameras for `learn_in_the_yard camera=FILE` and `two_worlds camera=FILE` of `quadverse-nav`.

#[path = "../tests/it/footage/mod.rs"]
mod footage;

use footage::{HiddenError, recording_of_all, yard};
use qv_camera::{LookOptions, look};
use qv_gap::decision::decide_camera;
use qv_gap::report::Sight;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use yard::noise::Random;

/// Size of the images \[px\].
const SIZE: [u32; 2] = [320, 240];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [seed, out] = &arguments[..] else { return Err("expected SEED OUT".into()) };
    let (seed, out) = (seed.parse::<u64>()?, PathBuf::from(out));
    let mut random = Random::new(seed, 6);
    // All kinds but "nothing".
    let hidden: Vec<HiddenError> = (1..=5).map(|kind| HiddenError::draw(kind, &mut random)).collect();
    let place = yard(36, SIZE[0], SIZE[1], 0.02, seed);
    let recording = recording_of_all(&place, &hidden, seed);
    let options = LookOptions::default();
    let found = look(&recording.footage(&place.cloud), &options)?;
    let decided = decide_camera(&found.evidence, &options.policy);
    let report = json!({ "visual": Sight::new(&found.evidence, &decided) });
    let mut shared = report["visual"]["shared"].clone();
    println!("{hidden:?}");
    for one in shared.as_array_mut().into_iter().flatten() {
        let name = one["name"].as_str().unwrap_or_default().to_string();
        let drawn = hidden.iter().find_map(|hidden| number(*hidden, &name));
        println!("    {name}: drawn {drawn:?}, found {} {}", one["value"], one["ci95"]);
        if let Some(drawn) = drawn {
            one["value"] = json!(drawn);
            one["ci95"] = json!([drawn, drawn]);
        }
    }
    let still = json!({"rotation": 0.0, "translation": 0.0, "gain": 0.0, "focal": 0.0});
    let truth = json!({"visual": {"shared": shared, "noise": still, "size": report["visual"]["size"]}});
    std::fs::create_dir_all(&out)?;
    write(&out.join("report.json"), &report)?;
    write(&out.join("truth.json"), &truth)
}

/// The number of that name in what is hidden.
fn number(hidden: HiddenError, name: &str) -> Option<f64> {
    let axis = ["x", "y", "z"].iter().position(|axis| name.ends_with(&format!("_{axis}")));
    match hidden {
        // Displayed values follow light to the power of 1 / 2.2, nearly.
        HiddenError::Exposure(stops) if name == "gain" => Some((stops / 2.2).exp2()),
        HiddenError::Exposure(stops) if name == "stops" => Some(stops),
        HiddenError::Delay(delay) if name == "delay" => Some(delay),
        HiddenError::Focal(scale) if name == "focal_scale" => Some(scale),
        HiddenError::Blur(deviation) if name == "blur" => Some(deviation),
        HiddenError::Extrinsics(twist) if name.starts_with("translation_") => axis.map(|k| twist[k]),
        HiddenError::Extrinsics(twist) if name.starts_with("rotation_") => axis.map(|k| twist[3 + k]),
        _ => None,
    }
}

fn write(file: &Path, value: &Value) -> Result<(), Box<dyn std::error::Error>> {
    let part = file.with_extension("part");
    std::fs::write(&part, serde_json::to_vec_pretty(value)?)?;
    Ok(std::fs::rename(part, file)?)
}
