//! What `cargo xtask bench reconstruct` needs of a capture: `bench_reconstruct export CAPTURE FILE` writes the photographs to learn from, without
//! distortion and with masks, as `fixtures/gsplat/train.py` reads them; `bench_reconstruct score CAPTURE SCENE.ply` draws a scene at the
//! photographs that are held out and scores it. The last line of both is JSON. CAPTURE is a folder with `transforms.json`, or of RGB-D
//! frames as 7-Scenes has them.

mod captured;

use captured::capture;
use qv_raster::{Scene, Settings, View, render};
use qv_splat::files::{Points, ply, points};
use qv_splat::train::{Dataset, ReadOptions, Score, score};
use serde_json::json;
use std::error::Error;
use std::fs;
use std::path::Path;

type Fallible<T> = Result<T, Box<dyn Error>>;

fn main() -> Fallible<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["export", capture, file] => export(Path::new(capture), Path::new(file)),
        ["score", capture, scene] => score_scene(Path::new(capture), Path::new(scene)),
        _ => Err(format!("expected export CAPTURE FILE or score CAPTURE SCENE.ply, found {words:?}").into()),
    }
}

fn open(folder: &Path) -> Fallible<Dataset> {
    let capture = capture(folder)?;
    let read = |path: &str| fs::read(folder.join(path)).map_err(|e| format!("{path}: {e}"));
    Ok(Dataset::new(&capture, &read, &ReadOptions::default())?)
}

fn points_of(folder: &Path) -> Fallible<Points> {
    let file = folder.join("points.ply");
    let bytes = fs::read(&file).map_err(|e| format!("{}: expected points to begin at, found {e}", file.display()))?;
    Ok(points::read(&bytes)?)
}

/// All little-endian and without gaps: the eight bytes `QVPHOTO1`; u32: photographs, points; f32: extent, background (3); the points' places
/// and colours (3 and 3 f32 each, all places first); then of each photograph u32 width, height, f32 fx, fy, cx, cy, `camera_from_world` by
/// rows (16 f32), and its pixels, red, green, blue, 255 or 0 where it is masked, by rows.
fn export(folder: &Path, file: &Path) -> Fallible<()> {
    let (dataset, points) = (open(folder)?, points_of(folder)?);
    let mut out = b"QVPHOTO1".to_vec();
    let count = |n: usize| u32::try_from(n).map(u32::to_le_bytes);
    out.extend(count(dataset.training.len())?);
    out.extend(count(points.places.len())?);
    let floats = |out: &mut Vec<u8>, some: &[f32]| out.extend(some.iter().flat_map(|x| x.to_le_bytes()));
    floats(&mut out, &[dataset.extent]);
    floats(&mut out, &dataset.background);
    floats(&mut out, points.places.as_flattened());
    floats(&mut out, points.colours.as_flattened());
    for one in &dataset.training {
        let camera = &one.camera;
        out.extend(camera.width.to_le_bytes());
        out.extend(camera.height.to_le_bytes());
        floats(&mut out, &[camera.fx, camera.fy, camera.cx, camera.cy].map(|x| x as f32));
        let (rotation, place) = (camera.camera_from_world.matrix(), camera.camera_from_world.position);
        for row in 0..3 {
            let r = rotation.row(row);
            floats(&mut out, &[r.x, r.y, r.z, place[row]].map(|x| x as f32));
        }
        floats(&mut out, &[0.0, 0.0, 0.0, 1.0]);
        out.extend(one.pixels.rgba.as_flattened());
    }
    fs::write(file, out)?;
    println!("{}", json!({"photographs": dataset.training.len(), "points": points.places.len()}));
    Ok(())
}

fn score_scene(folder: &Path, scene: &Path) -> Fallible<()> {
    let (dataset, file) = (open(folder)?, ply::read(&fs::read(scene)?)?);
    let background = file.background.unwrap_or(dataset.background);
    let settings = Settings { background, antialias: file.antialias, ..Default::default() };
    let of = |one: &qv_splat::train::Photograph| -> Fallible<Score> {
        let (images, _) = render(&Scene::still(&file.cloud), &[View::of(one.camera)], &settings)?;
        Ok(score(&images[0].colour, one))
    };
    let all = dataset.held_out.iter().map(of).collect::<Fallible<Vec<_>>>()?;
    let mean = Score::mean(&all).ok_or("expected photographs that are held out, found none")?;
    println!("{}", json!({"images": all.len(), "gaussians": file.cloud.len(), "psnr": mean.psnr, "ssim": mean.ssim}));
    Ok(())
}
