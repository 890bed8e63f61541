//! `qv render`: images, depths, normals and labels of made-up scenes, and what it says of bad input.

use crate::facts::States;
#[cfg(feature = "gpu")]
use crate::skipped::skipped;
use qv_core::GaussianCloud;
use qv_splat::files::{Format, ply, write};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn directory(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// Two opaque balls at a distance of 2 m along z, red to the left with feature 0, green to the right with feature 1.
fn balls() -> GaussianCloud {
    let colour = |rgb: [f32; 3]| rgb.map(|c| (c - 0.5) / 0.282_094_79);
    GaussianCloud {
        means: vec![[-0.5, 0.0, 2.0], [0.5, 0.0, 2.0]],
        log_scales: vec![[-2.0, -2.0, -6.0]; 2],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        opacity_logits: vec![8.0; 2],
        sh: vec![colour([1.0, 0.0, 0.0]), colour([0.0, 1.0, 0.0])],
        feature_count: 2,
        features: vec![1.0, 0.0, 0.0, 1.0],
        ..Default::default()
    }
}

fn camera(name: &str) -> Value {
    json!({"name": name, "width": 64, "height": 48, "fx": 50, "position": [0, 0, 0], "rotation": [1, 0, 0, 0]})
}

/// A directory with a scene and our own cameras.
fn set_up(name: &str, cameras: Value) -> (PathBuf, PathBuf, PathBuf) {
    let folder = directory(name);
    let (scene, file) = (folder.join("scene.ply"), folder.join("cameras.json"));
    fs::write(&scene, write(&balls(), Format::Ply).unwrap()).unwrap();
    fs::write(&file, json!({"format": "qv-cameras/1", "cameras": cameras}).to_string()).unwrap();
    (scene, file, folder.join("out"))
}

/// Exit code, the line of JSON, and standard error.
fn render(scene: &Path, cameras: &Path, out: &Path, options: &[&str]) -> (i32, Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.arg("render").arg(scene).arg("--cameras").arg(cameras).arg("--out").arg(out).arg("--json").args(options);
    let output = command.output().unwrap();
    let line = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), line, String::from_utf8_lossy(&output.stderr).into_owned())
}

fn pixel(path: &Path, x: u32, y: u32) -> [u8; 3] {
    image::open(path).unwrap().to_rgb8().get_pixel(x, y).0
}

#[test]
fn images_depths_normals_and_labels() {
    let (scene, cameras, out) = set_up("render_all", json!([camera("front")]));
    let (code, line, err) = render(&scene, &cameras, &out, &["--depth", "--normals", "--semantics"]);
    assert_eq!(code, 0, "{err}");
    assert_eq!(line["format"], "qv-render/1");
    let files = json!(["front.png", "front_depth.npy", "front_normal.png", "front_labels.png"]);
    assert_eq!((&line["images"][0]["files"], &line["gaussians"]), (&files, &json!(2)));
    // The centres are 12.5 px to the sides of the middle.
    let (left, right) = (pixel(&out.join("front.png"), 19, 24), pixel(&out.join("front.png"), 44, 24));
    assert!(left[0] > 240 && left[1] < 10 && right[1] > 240 && right[0] < 10, "{left:?} {right:?}");
    assert_eq!(pixel(&out.join("front.png"), 0, 0), [0, 0, 0]);
    let normal = pixel(&out.join("front_normal.png"), 19, 24);
    assert!(normal[0].abs_diff(128) < 4 && normal[1].abs_diff(128) < 4 && normal[2] < 4, "towards us: {normal:?}");
    let label = |x: u32| pixel(&out.join("front_labels.png"), x, 24)[0];
    assert_eq!((label(19), label(44), label(63)), (1, 2, 0));
    let depth = fs::read(out.join("front_depth.npy")).unwrap();
    let first = depth.len() - 4 * 64 * 48;
    let at = |x: usize, y: usize| {
        let start = first + 4 * (64 * y + x);
        f32::from_le_bytes(depth[start..start + 4].try_into().unwrap())
    };
    assert!((at(19, 24) - 2.0).abs() < 1e-4 && at(0, 0) == 0.0, "{}", at(19, 24));
}

#[test]
fn what_no_gaussian_covers_is_the_background() {
    let (scene, cameras, out) = set_up("render_background", json!([camera("front")]));
    let corner = |options: &[&str]| {
        let (code, _, err) = render(&scene, &cameras, &out, options);
        assert_eq!(code, 0, "{err}");
        assert!(pixel(&out.join("front.png"), 19, 24)[0] > 240);
        pixel(&out.join("front.png"), 0, 0)
    };
    assert_eq!(corner(&["--background", "0.2,0.4,0.6"]), [51, 102, 153]);
    fs::write(&scene, ply::write_over(&balls(), Some([0.4, 0.2, 0.0])).unwrap()).unwrap();
    assert_eq!(corner(&[]), [102, 51, 0], "the one that the scene was made over");
    assert_eq!(corner(&["--background", "0,0,0"]), [0, 0, 0]);
    for odd in ["0.2,0.4", "0.2,0.4,1.6", "0.2,0.4,nan", "grey"] {
        let (code, _, err) = render(&scene, &cameras, &out, &["--background", odd]);
        assert!(code == 2 && err.contains("expected") && err.contains("R,G,B"), "{odd}: {err}");
    }
}

#[cfg(feature = "gpu")]
#[test]
fn the_card_draws_what_the_cpu_draws() {
    let (scene, cameras, out) = set_up("render_card", json!([camera("a")]));
    let (code, _, err) = render(&scene, &cameras, &out, &["--gpu", "--normals"]);
    if err.states("graphics") {
        skipped(&err);
        assert_eq!(code, 1);
        return;
    }
    assert_eq!(code, 0, "{err}");
    let read = |name: &str| image::open(out.join(name)).unwrap().to_rgb8().into_raw();
    let card = ["a.png", "a_normal.png"].map(read);
    assert_eq!(render(&scene, &cameras, &out, &["--normals"]).0, 0);
    let cpu = ["a.png", "a_normal.png"].map(read);
    for (card, cpu) in card.iter().zip(&cpu) {
        assert!(card.iter().zip(cpu).all(|(a, b)| a.abs_diff(*b) <= 1) && card.iter().any(|&c| c > 120));
    }
}

#[test]
fn every_kind_of_cameras_gives_the_same_image() {
    let (scene, ours, out) = set_up("render_cameras", json!([camera("a")]));
    let folder = scene.parent().unwrap();
    let nerfstudio = folder.join("transforms.json");
    let frame = json!({"file_path": "images/a.jpg", "transform_matrix": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]});
    let text = json!({"w": 64, "h": 48, "fl_x": 50, "cx": 32, "cy": 24, "frames": [frame]}).to_string();
    fs::write(&nerfstudio, text).unwrap();
    let colmap = folder.join("model");
    fs::create_dir_all(colmap.join("sparse/0")).unwrap();
    fs::write(colmap.join("sparse/0/cameras.txt"), "1 SIMPLE_PINHOLE 64 48 50 32 24\n").unwrap();
    fs::write(colmap.join("sparse/0/images.txt"), "1 1 0 0 0 0 0 0 1 a.jpg\n\n").unwrap();
    let image = |cameras: &Path| {
        let (code, _, err) = render(&scene, cameras, &out, &[]);
        assert_eq!(code, 0, "{err}");
        fs::read(out.join("a.png")).unwrap()
    };
    let first = image(&ours);
    assert_eq!(first, image(&nerfstudio));
    assert_eq!(first, image(&colmap));
}

#[test]
fn a_distorted_camera_moves_what_it_shows() {
    let mut bent = camera("bent");
    bent["distortion"] = json!({"k1": 0.8});
    let (scene, cameras, out) = set_up("render_bent", json!([bent, camera("straight")]));
    let (code, _, err) = render(&scene, &cameras, &out, &[]);
    assert_eq!(code, 0, "{err}");
    let reddest = |name: &str| {
        let image = image::open(out.join(name)).unwrap().to_rgb8();
        let sum = |f: &dyn Fn(u32, u32) -> f64| -> f64 {
            image.enumerate_pixels().map(|(x, y, p)| f64::from(p.0[0]) * f(x, y)).sum()
        };
        sum(&|x, _| f64::from(x) + 0.5) / sum(&|_, _| 1.0)
    };
    // x/z = -0.25 is shown at -0.25 (1 + 0.8 * 0.0625) = -0.2625.
    assert!((reddest("straight.png") - 19.5).abs() < 0.2, "{}", reddest("straight.png"));
    // The ball's outer side is stretched more than its inner one, which draws the middle outwards by half a pixel again.
    let moved = reddest("bent.png") - (32.0 - 50.0 * 0.2625);
    assert!((-0.8..0.1).contains(&moved), "{moved}");
}

#[test]
fn odd_gaussians_are_named_and_the_rest_is_drawn() {
    let (scene, cameras, out) = set_up("render_odd", json!([camera("front")]));
    let mut bytes = fs::read(&scene).unwrap();
    let first = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    bytes[first..first + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(&scene, bytes).unwrap();
    let (code, line, err) = render(&scene, &cameras, &out, &[]);
    assert_eq!((code, &line["left_out"], &line["gaussians"]), (3, &json!(1), &json!(1)), "{err}");
    assert!(err.states("1 Gaussians"), "{err}");
    assert!(pixel(&out.join("front.png"), 44, 24)[1] > 240);
    assert_eq!(pixel(&out.join("front.png"), 19, 24), [0, 0, 0]);
}

#[test]
fn bad_input_is_named() {
    let (scene, cameras, out) = set_up("render_bad", json!([camera("front")]));
    let folder = scene.parent().unwrap();
    let fault = |scene: &Path, cameras: &Path, options: &[&str]| {
        let (code, _, err) = render(scene, cameras, &out, options);
        assert_eq!(code, 1, "{err}");
        assert!(err.contains("error: cannot ") && err.contains("\nhint: "), "{err}");
        err
    };
    let other = |name: &str, content: &[u8]| {
        let path = folder.join(name);
        fs::write(&path, content).unwrap();
        path
    };
    assert!(fault(&folder.join("none.ply"), &cameras, &[]).contains("none.ply"));
    assert!(fault(&other("noise.ply", b"noise"), &cameras, &[]).states("PLY SPZ GLB glTF"));
    let cut = fs::read(&scene).unwrap();
    assert!(fault(&other("cut.ply", &cut[..cut.len() - 9]), &cameras, &[]).states("PLY 2"));
    assert!(fault(&scene, &folder.join("none.json"), &[]).contains("none.json"));
    assert!(fault(&scene, &other("text.json", b"{"), &[]).states("JSON"));
    assert!(fault(&scene, &other("empty.json", b"{\"frames\": []}"), &[]).states("cameras"));
    assert!(fault(&scene, &directory("render_bad_empty"), &[]).states("COLMAP"));
    let mut folded = camera("folded");
    folded["distortion"] = json!({"k1": -5.0});
    let folded = json!({"format": "qv-cameras/1", "cameras": [folded]}).to_string();
    let err = fault(&scene, &other("folded.json", folded.as_bytes()), &[]);
    assert!(err.states("distortion"), "{err}");
    let mut misspelt = camera("front");
    misspelt["distortion"] = json!({"k4": 0.1});
    let misspelt = json!({"format": "qv-cameras/1", "cameras": [misspelt]}).to_string();
    let err = fault(&scene, &other("misspelt.json", misspelt.as_bytes()), &[]);
    assert!(err.states("0 k1 k2 k3 p1 p2 k4"), "{err}");
    let clash = json!({"format": "qv-cameras/1", "cameras": [camera("a"), camera("a_normal")]}).to_string();
    let err = fault(&scene, &other("clash.json", clash.as_bytes()), &["--normals"]);
    assert!(err.states("a_normal a_normal.png"), "{err}");
    let plain = other("plain.spz", &write(&balls(), Format::Spz).unwrap());
    assert!(fault(&plain, &cameras, &["--semantics"]).states("--semantics"));
    let usage = Command::new(env!("CARGO_BIN_EXE_qv")).args(["render", "scene.ply"]).output().unwrap();
    assert_eq!(usage.status.code(), Some(2));
}
