//! How depth from several photographs compares with depth that was measured: `stereo_depth CAPTURE [CAMERAS.json] [OPTION=VALUE ...]` forgets the depth
//! of a capture, measures it from the photographs, and shows how far both are from each other. CAPTURE is a folder with `transforms.json` or of
//! RGB-D frames as 7-Scenes has them; CAMERAS.json, as `qv reconstruct --poses colmap` writes it, has other poses, for photographs whose lens does
//! not distort.
//! OPTION is a field of `StereoOptions`, `hold_out=N`, or `depths=DIR`: a capture with the measured depths is written there.

mod captured;

use captured::capture;
use qv_splat::captures::{CaptureCamera, cameras_json};
use qv_splat::files::{Points, points};
use qv_splat::stereo::{StereoOptions, measure};
use qv_splat::train::{Dataset, ReadOptions};
use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::Path;

type Fallible<T> = Result<T, Box<dyn Error>>;

fn main() -> Fallible<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(words.first().ok_or("expected CAPTURE [CAMERAS.json] [SIDE], found nothing")?);
    let given: BTreeMap<&str, &str> = words.iter().filter_map(|word| word.split_once('=')).collect();
    let hold_out = given.get("hold_out").map_or(Ok(0), |word| word.parse())?;
    let mut dataset = open(folder, words.get(1).filter(|word| word.ends_with(".json")).map(Path::new), hold_out)?;
    let points = points_of(folder)?;
    let truth: Vec<Vec<f32>> = dataset.training.iter_mut().map(|one| std::mem::take(&mut one.depth)).collect();
    let mut options = StereoOptions::default();
    for (key, value) in &given {
        change(&mut options, key, value)?;
    }
    let clock = std::time::Instant::now();
    let remarks = measure(&mut dataset, points.as_ref(), &options, &|_, _| ())?;
    println!("{remarks:?}, {:.1} s", clock.elapsed().as_secs_f64());
    if let Some(dir) = given.get("depths") {
        write_depths(Path::new(dir), folder, &dataset)?;
    }
    let mut all = vec![];
    for (one, truth) in dataset.training.iter().zip(&truth) {
        let own = compared(&one.depth, truth);
        let share = own.len() as f64 / truth.iter().filter(|z| **z > 0.0).count().max(1) as f64;
        println!("{}: {:.2} measured; {}", one.name, share, in_words(&own));
        all.extend(own);
    }
    let known: usize = truth.iter().flatten().filter(|z| **z > 0.0).count();
    println!("all: {:.3} of what was measured; {}", all.len() as f64 / known.max(1) as f64, in_words(&all));
    Ok(())
}

/// Sets an option by its name.
fn change(options: &mut StereoOptions, key: &str, value: &str) -> Fallible<()> {
    match key {
        "side" => options.side = value.parse()?,
        "neighbours" => options.neighbours = value.parse()?,
        "radius" => options.radius = value.parse()?,
        "noise" => options.noise = value.parse()?,
        "plane_px" => options.plane_px = value.parse()?,
        "small_jump" => options.small_jump = value.parse()?,
        "large_jump" => options.large_jump = value.parse()?,
        "edge" => options.edge = value.parse()?,
        "least_ncc" => options.least_ncc = value.parse()?,
        "agreeing" => options.agreeing = value.parse()?,
        "within" => options.within = value.parse()?,
        "depths" | "hold_out" => (),
        _ => return Err(format!("expected an option of StereoOptions, found {key}").into()),
    }
    Ok(())
}

/// Differences \[m\], and the depth, of pixels that have both.
fn compared(found: &[f32], truth: &[f32]) -> Vec<[f32; 2]> {
    let both = found.iter().zip(truth).filter(|(a, b)| **a > 0.0 && **b > 0.0);
    both.map(|(a, b)| [a - b, *b]).collect()
}

fn in_words(some: &[[f32; 2]]) -> String {
    let within = |m: f32| some.iter().filter(|e| e[0].abs() < m).count() as f64 / some.len().max(1) as f64;
    let median = |of: &dyn Fn(&[f32; 2]) -> f32| {
        let mut values: Vec<f32> = some.iter().map(of).collect();
        values.sort_by(f32::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f32::NAN)
    };
    let [off, bias, share] = [median(&|e| e[0].abs()), median(&|e| e[0]), median(&|e| e[0].abs() / e[1])];
    format!(
        "{:.3} within 5 cm, {:.3} within 2 cm, median {:.1} mm ({:.2} %), bias {:.1} mm",
        within(0.05),
        within(0.02),
        1e3 * off,
        1e2 * share,
        1e3 * bias
    )
}

fn open(folder: &Path, cameras: Option<&Path>, hold_out: usize) -> Fallible<Dataset> {
    let mut capture = capture(folder)?;
    if let Some(path) = cameras {
        let found = cameras_json::read(&fs::read_to_string(path)?)?.cameras;
        let found: BTreeMap<String, CaptureCamera> = found.into_iter().map(|one| (one.name.clone(), one)).collect();
        capture.cameras.retain_mut(|one| {
            found.get(&one.name).map(|again| (one.camera, one.distortion) = (again.camera, again.distortion)).is_some()
        });
    }
    let read = |path: &str| fs::read(folder.join(path)).map_err(|e| format!("{path}: {e}"));
    Ok(Dataset::new(&capture, &read, &ReadOptions { hold_out, downscale: 1 })?)
}

fn points_of(folder: &Path) -> Fallible<Option<Points>> {
    let file = folder.join("points.ply");
    Ok(if file.is_file() { Some(points::read(&fs::read(file)?)?) } else { None })
}

/// The capture with the measured depths in `dir`.
fn write_depths(dir: &Path, from: &Path, dataset: &Dataset) -> Fallible<()> {
    let transforms = from.join("transforms.json");
    let is_nerfstudio = transforms.is_file();
    let name = |stem: &str| if is_nerfstudio { format!("depth/{stem}.png") } else { format!("{stem}.depth.png") };
    fs::create_dir_all(dir.join("depth"))?;
    for one in &dataset.training {
        let c = one.camera;
        let stem = one.name.replace(".color", "");
        let mm: Vec<u16> = one.depth.iter().map(|z| (z * 1000.0 + 0.5) as u16).collect();
        let image = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(c.width, c.height, mm).ok_or("size")?;
        image.save(dir.join(name(&stem)))?;
        for ending in ["color.jpg", "pose.txt"].iter().filter(|_| !is_nerfstudio) {
            let name = format!("{stem}.{ending}");
            fs::copy(from.join(&name), dir.join(&name))?;
        }
        for name in ["camera-intrinsics.txt", "color-intrinsics.txt"].iter().filter(|_| !is_nerfstudio) {
            fs::write(dir.join(name), format!("{} 0 {}\n0 {} {}\n0 0 1\n", c.fx, c.cx, c.fy, c.cy))?;
        }
    }
    if is_nerfstudio {
        let mut document: serde_json::Value = serde_json::from_str(&fs::read_to_string(transforms)?)?;
        document["depth_unit_scale_factor"] = 1e-3.into();
        for frame in document["frames"].as_array_mut().into_iter().flatten() {
            let path = frame["file_path"].as_str().unwrap_or_default().to_string();
            let stem = Path::new(&path).file_stem().unwrap_or_default().to_string_lossy().into_owned();
            if dir.join(name(&stem)).is_file() {
                frame["depth_file_path"] = name(&stem).into();
            } else if let Some(frame) = frame.as_object_mut() {
                frame.remove("depth_file_path");
            }
        }
        fs::write(dir.join("transforms.json"), document.to_string())?;
    }
    Ok(())
}
