//! `qv reconstruct` on a made-up capture, and what it says of bad ones.

use crate::facts::States;
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Scene, Settings, View, render};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const SIDE: u32 = 40;

/// Coloured balls around the origin.
fn cloud() -> GaussianCloud {
    let wave = |i: usize, k: f32| (k * (i as f32 + 1.0)).sin();
    let n = 40;
    GaussianCloud {
        means: (0..n).map(|i| [0.8 * wave(i, 1.1), 0.8 * wave(i, 2.3), 0.8 * wave(i, 3.7)]).collect(),
        log_scales: (0..n).map(|i| [-1.9 + 0.3 * wave(i, 0.7); 3]).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logits: vec![2.0; n],
        sh: (0..n).map(|i| [1.5 * wave(i, 5.1), 1.5 * wave(i, 0.9), 1.5 * wave(i, 7.7)]).collect(),
        ..Default::default()
    }
}

/// A folder with images, `transforms.json` and `points.ply`.
fn capture(name: &str, views: usize) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    capture_in(&folder, views);
    folder
}

/// The same in a folder that is made.
pub fn capture_in(folder: &Path, views: usize) {
    fs::create_dir_all(folder.join("images")).unwrap();
    let cloud = cloud();
    let mut frames = vec![];
    for k in 0..views {
        let turn = k as f64 / views as f64 * std::f64::consts::TAU;
        let (s, c) = turn.sin_cos();
        // Columns right, up and back of a camera at a distance of 3 m that looks at the origin, up along y.
        let matrix = json!([[c, 0.0, s, 3.0 * s], [0.0, 1.0, 0.0, 0.0], [-s, 0.0, c, 3.0 * c], [0.0, 0.0, 0.0, 1.0]]);
        let world_from_camera = Pose {
            position: glam::DVec3::new(3.0 * s, 0.0, 3.0 * c),
            rotation: glam::DQuat::from_rotation_y(turn) * glam::DQuat::from_rotation_x(std::f64::consts::PI),
        };
        let camera = Camera {
            fx: 44.0,
            fy: 44.0,
            cx: 20.0,
            cy: 20.0,
            width: SIDE,
            height: SIDE,
            camera_from_world: world_from_camera.inverse(),
        };
        let (images, _) = render(&Scene::still(&cloud), &[View::of(camera)], &Settings::default()).unwrap();
        let path = folder.join(format!("images/{k:02}.png"));
        image::save_buffer(&path, &images[0].colour_u8(), SIDE, SIDE, image::ExtendedColorType::Rgb8).unwrap();
        frames.push(json!({"file_path": format!("images/{k:02}.png"), "transform_matrix": matrix}));
    }
    let transforms = json!({"w": SIDE, "h": SIDE, "fl_x": 44.0, "frames": frames});
    fs::write(folder.join("transforms.json"), transforms.to_string()).unwrap();
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 40\nproperty float x\nproperty float y\nproperty float z\n\
        end_header\n"
        .to_vec();
    cloud.means.iter().flatten().for_each(|x| ply.extend((x + 0.02).to_le_bytes()));
    fs::write(folder.join("points.ply"), ply).unwrap();
}

/// Exit code, the line of JSON, and standard error.
fn reconstruct(capture: &Path, options: &[&str]) -> (i32, Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.arg("reconstruct").arg(capture).arg("--out").arg(capture.join("out")).arg("--json").args(options);
    // What is under the cache of whoever runs the tests makes no difference.
    command.env("QV_COLMAP_VENV", capture.join("none"));
    let output = command.output().unwrap();
    let line = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), line, String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_capture_becomes_a_scene_and_goes_on_from_its_checkpoint() {
    let folder = capture("reconstruct_good", 12);
    // The photographs are drawn over black.
    let black = ["--background", "black"];
    let of = |options: &[&str], more: &[&str]| reconstruct(&folder, &[options, more].concat());
    let (code, line, err) = of(&["--iterations", "1000", "--preview", "--cap", "60"], &black);
    assert_eq!(code, 0, "{err}");
    assert_eq!(
        (&line["format"], &line["finished"], &line["iterations"]),
        (&json!("qv-reconstruct/1"), &json!(true), &json!(1000))
    );
    // COLMAP is not there to check the poses: they stay, and how to ask for it is reported.
    assert_eq!((&line["poses"]["taken"], &line["poses"]["given_explain"]), (&json!("capture"), &Value::Null));
    let why = line["poses"]["why"].as_str().unwrap();
    assert!(why.states("--poses"), "{why}");
    let names: Vec<&str> = line["held_out"].as_array().unwrap().iter().filter_map(|one| one["name"].as_str()).collect();
    assert_eq!(names, ["00", "08"]);
    let psnr = line["mean"]["psnr"].as_f64().unwrap();
    assert!(psnr > 20.0, "{psnr}");
    assert!(line["gaussians"].as_u64().unwrap() > 40);
    for file in ["scene.ply", "checkpoint.qvt", "metrics.json", "previews/00_001000.png"] {
        assert!(folder.join("out").join(file).is_file(), "{file}");
    }
    let remarks = |line: &Value| {
        let file = qv_splat::files::ply::read(&fs::read(folder.join("out/scene.ply")).unwrap()).unwrap();
        let metrics = line["background"].as_array().unwrap().iter().map(|c| c.as_f64().unwrap() as f32);
        let background = file.background.unwrap();
        assert_eq!(metrics.collect::<Vec<_>>(), background);
        background
    };
    assert_eq!(remarks(&line), [0.0; 3]);
    let more = ["--iterations", "1010", "--resume", "--cap", "60", "--max-seconds", "100"];
    let (code, _, err) = of(&more, &[]);
    assert!(code == 1 && err.states("--background black mean"), "{err}");
    let (code, line, err) = of(&more, &black);
    assert_eq!((code, &line["iterations"]), (0, &json!(1010)), "{err}");
    let (code, line, err) = of(&["--max-seconds", "0"], &[]);
    assert_eq!((code, &line["iterations"], &line["finished"]), (0, &json!(1), &json!(false)), "{err}");
    let mean = remarks(&line);
    assert!(mean.iter().all(|c| (0.02..0.9).contains(c)), "{mean:?}");
}

#[test]
fn bad_captures_are_named() {
    let folder = capture("reconstruct_bad", 4);
    let fault = |options: &[&str]| {
        let (code, _, err) = reconstruct(&folder, options);
        assert_eq!(code, 1, "{err}");
        err
    };
    let err = fault(&["--hold-out", "2", "--cap", "30"]);
    assert!(err.states("cap 30 40"), "{err}");
    let err = fault(&["--hold-out", "1"]);
    assert!(err.states("images 2"), "{err}");
    let err = fault(&["--depth-prior=-1"]);
    assert!(err.states("weight"), "{err}");
    let err = fault(&["--depth-prior", "1", "--no-stereo"]);
    assert!(err.contains("--depth-prior: expected depth images"), "{err}");
    let err = fault(&["--labels", "1"]);
    assert!(err.states("images"), "{err}");
    assert!(!folder.join("out").exists(), "what failed made no folder");
    fs::create_dir_all(folder.join("out")).unwrap();
    fs::write(folder.join("out/checkpoint.qvt"), b"nonsense").unwrap();
    assert!(fault(&["--resume"]).contains("checkpoint"), "a checkpoint that is none");
    image::save_buffer(folder.join("images/01.png"), &[0; 30], 5, 2, image::ExtendedColorType::Rgb8).unwrap();
    // What is good goes on without it.
    let (code, line, err) = reconstruct(&folder, &["--iterations", "1", "--hold-out", "0"]);
    assert_eq!((code, &line["photographs"]), (3, &json!(3)), "{err}");
    assert!(err.states("images/01.png 40 40 5 2"), "{err}");
    fs::remove_file(folder.join("images/01.png")).unwrap();
    let (code, _, err) = reconstruct(&folder, &["--iterations", "1", "--hold-out", "0"]);
    assert!(code == 3 && err.states("images/01.png"), "{err}");
    fs::remove_file(folder.join("images/02.png")).unwrap();
    fs::remove_file(folder.join("images/03.png")).unwrap();
    let err = fault(&["--hold-out", "0"]);
    assert!(err.contains("3 lost; the first: ") && err.states("images 2"), "{err}");
    let (code, ..) = reconstruct(&folder, &["--downscale", "0"]);
    assert_eq!(code, 2);
    fs::remove_file(folder.join("transforms.json")).unwrap();
    assert!(fault(&[]).states("COLMAP"));
}

#[test]
fn stages_are_told_where_there_is_no_terminal_unless_it_is_to_be_quiet() {
    let folder = capture("reconstruct_told", 6);
    let remarks = |more: &[&str]| {
        let (code, _, err) = reconstruct(&folder, &[&["--iterations", "60", "--hold-out", "3"], more].concat());
        assert_eq!(code, 0, "{err}");
        err
    };
    let normal = remarks(&[]);
    let lines: Vec<&str> = normal.lines().filter(|l| l.contains(" of 4: ")).collect();
    assert_eq!(lines.len(), 4, "{normal}");
    assert!(lines[2].starts_with("qv: 3 of 4: training, 20 % done"), "{normal}");
    assert!(lines[3].states("scores 95"), "{normal}");
    assert!(remarks(&["--verbose"]).lines().any(|l| l.starts_with("qv: 3 of 4: training took ")));
    assert_eq!(remarks(&["-q"]), "");
}

#[test]
fn depth_is_measured_from_the_photographs_where_they_have_none() {
    let folder = capture("reconstruct_stereo", 24);
    let (code, line, err) = reconstruct(&folder, &["--iterations", "3"]);
    assert_eq!((code, &line["stereo"]["photographs"], &line["stereo"]["given"]), (0, &json!(21), &json!(0)), "{err}");
    let share = line["stereo"]["share"].as_f64().unwrap();
    assert!(share > 0.02 && share < 1.0, "{share}");
    // Gaussians begin there, beside the 40 points.
    assert!(line["gaussians"].as_u64().unwrap() > 100, "{}", line["gaussians"]);
    let stages: Vec<&str> = err.lines().filter(|line| line.contains(" of 4: ")).collect();
    assert!(stages.len() == 4 && stages[1].states("images 2 4"), "{err}");
    let (code, line, err) = reconstruct(&folder, &["--iterations", "3", "--no-stereo"]);
    assert_eq!((code, &line["stereo"]["photographs"], &line["gaussians"]), (0, &Value::Null, &json!(40)), "{err}");
    // Two photographs to learn from are too few for depth, not for a scene.
    let two = capture("reconstruct_two", 3);
    let (code, line, err) = reconstruct(&two, &["--iterations", "3", "--hold-out", "3"]);
    assert_eq!((code, &line["stereo"]["photographs"]), (0, &Value::Null), "{err}");
    assert!(err.states("no depth images 3 2"), "{err}");
}

#[test]
fn depth_of_the_capture_is_told_and_not_measured_again() {
    let folder = capture("reconstruct_depth_folder", 4);
    let mut transforms: Value = serde_json::from_slice(&fs::read(folder.join("transforms.json")).unwrap()).unwrap();
    for (k, frame) in transforms["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
        let depth = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(SIDE, SIDE, image::Luma([2000]));
        depth.save(folder.join(format!("images/depth{k}.png"))).unwrap();
        frame["depth_file_path"] = json!(format!("images/depth{k}.png"));
    }
    fs::write(folder.join("transforms.json"), transforms.to_string()).unwrap();
    let (code, line, err) = reconstruct(&folder, &["--iterations", "3", "--hold-out", "0"]);
    assert_eq!((code, &line["stereo"]), (0, &json!({"given": 4})), "{err}");
    assert!(err.states("depth of all 4 images --depth-prior"), "{err}");
}

#[test]
fn what_passes_is_told_and_shown() {
    let folder = capture("reconstruct_transients", 12);
    let path = folder.join("images/05.png");
    let mut photograph = image::open(&path).unwrap().into_rgb8();
    for (x, y) in (12..28).flat_map(|x| (10..30).map(move |y| (x, y))) {
        photograph.put_pixel(x, y, image::Rgb([250, 10, 240]));
    }
    photograph.save(&path).unwrap();
    let options = ["--iterations", "300", "--transients", "--background", "black", "--no-stereo"];
    let (code, line, err) = reconstruct(&folder, &options);
    assert_eq!(code, 0, "{err}");
    let share = line["transients"]["share"].as_f64().unwrap();
    assert!(share > 0.005 && share < 0.1, "{}", line["transients"]);
    assert!(folder.join("out/masks/05.png").is_file() && !folder.join("out/masks/06.png").exists());
    let (code, _, err) =
        reconstruct(&folder, &["--iterations", "310", "--resume", "--background", "black", "--no-stereo"]);
    assert!(code == 1 && err.contains("--transients"), "{err}");
}

#[test]
fn options_that_are_gone_are_refused() {
    let folder = capture("reconstruct_gone", 4);
    for gone in ["--guide=views", "--settle=0.1", "--vignetting", "--stereo", "--drop=0.3", "--strategy=classic"] {
        let (code, _, err) = reconstruct(&folder, &[gone]);
        assert!(code == 2 && err.contains(gone.split('=').next().unwrap()), "{err}");
    }
}

#[test]
fn photographs_of_several_exposures_are_scored_as_drawn() {
    let folder = capture("reconstruct_exposed", 12);
    // Two of the photographs to learn from are much darker than all others.
    for name in ["03", "09"] {
        let path = folder.join(format!("images/{name}.png"));
        let mut photograph = image::open(&path).unwrap().into_rgb8();
        photograph.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|byte| byte / 3));
        photograph.save(&path).unwrap();
    }
    let options = ["--iterations", "1000", "--exposure", "--background", "black", "--no-stereo", "--cap", "60"];
    let (code, line, err) = reconstruct(&folder, &options);
    assert_eq!(code, 0, "{err}");
    let drawn = line["mean"]["psnr"].as_f64().unwrap();
    assert!(drawn > 20.0, "{drawn}");
}

#[test]
fn an_antialiased_scene_tells_it_and_goes_on_only_as_one() {
    let folder = capture("reconstruct_antialias", 12);
    let (code, line, err) = reconstruct(&folder, &["--iterations", "300", "--antialias", "--background", "black"]);
    assert_eq!((code, &line["antialias"], &line["aside"]), (0, &json!(true), &Value::Null), "{err}");
    assert!(line["mean"]["psnr"].as_f64().unwrap() > 15.0, "{line}");
    let file = qv_splat::files::ply::read(&fs::read(folder.join("out/scene.ply")).unwrap()).unwrap();
    assert!(file.antialias && file.remarks.iter().any(|what| what.contains("filter_3D")), "{:?}", file.remarks);
    let (code, _, err) = reconstruct(&folder, &["--iterations", "310", "--resume", "--background", "black"]);
    assert!(code == 1 && err.states("--antialias"), "{err}");
}

#[test]
fn with_more_steps_than_usual_it_is_found_how_many_help() {
    let folder = capture("reconstruct_aside", 5);
    let (code, line, err) = reconstruct(&folder, &["--iterations", "7010", "--cap", "41"]);
    assert_eq!(code, 0, "{err}");
    let (aside, asked) = (&line["aside"], &line["aside"]["asked"]);
    assert_eq!((&aside["photographs"], asked, &aside["psnr"][0][0]), (&json!(2), &json!(7010), &json!(7000)), "{line}");
    // One number of steps was looked at before training ended.
    assert_eq!((&aside["steps"], &line["iterations"]), (&json!(7000), &json!(7000)));
    // Going on keeps to it.
    let (code, line, err) = reconstruct(&folder, &["--iterations", "7010", "--cap", "41", "--resume"]);
    assert_eq!((code, &line["aside"]["steps"], &line["iterations"]), (0, &json!(7000), &json!(7000)), "{err}");
}

/// Waits until a child has said so on standard error; the rest of what it says comes from the thread.
#[cfg(unix)]
fn said(child: &mut std::process::Child, what: &str) -> std::thread::JoinHandle<String> {
    use std::io::{BufRead, BufReader};
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains(what)), "{what}");
    std::thread::spawn(move || lines.collect::<Vec<_>>().join("\n"))
}

#[cfg(unix)]
#[test]
fn a_folder_has_one_writer_and_who_is_stopped_says_how_to_go_on() {
    use std::process::Stdio;
    let folder = capture("reconstruct stopped", 6);
    let qv = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
        command.arg("reconstruct").arg(&folder).arg("--out").arg(folder.join("out")).args(["--hold-out", "0"]);
        command
    };
    let mut first =
        qv().args(["--iterations", "1000000"]).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let rest = said(&mut first, "3 of 4: training");
    let second = qv().output().unwrap();
    let err = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(second.status.code() == Some(1) && err.contains(&format!("found process {} on ", first.id())), "{err}");
    let killed = Command::new("kill").args(["-INT", &first.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let (status, err) = (first.wait().unwrap(), rest.join().unwrap());
    assert_eq!(status.code(), Some(130), "{err}");
    let line = err.lines().last().unwrap();
    assert!(
        line.starts_with("qv: stopped at step ") && line.contains(" of 1000000; to go on: qv reconstruct '"),
        "{err}"
    );
    assert!(line.ends_with("--iterations 1000000 --resume"), "{err}");
    let stood: u32 = line["qv: stopped at step ".len()..].split(' ').next().unwrap().parse().unwrap();
    let more = (stood + 5).to_string();
    let on = qv().args(["--iterations", &more, "--resume", "--json"]).output().unwrap();
    let metrics: Value = serde_json::from_slice(&on.stdout).unwrap();
    assert_eq!((on.status.code(), &metrics["iterations"]), (Some(0), &json!(stood + 5)));
    assert!(!folder.join("out/qv.lock").exists());
}
