//! Captures and scenes as people bring them: one picture set in many guises, read as the plain one; RGB-D folders of three layouts.

use crate::facts::States;
use image::{ExtendedColorType, GrayImage, ImageBuffer, Luma, RgbImage};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const SIZE: [u32; 2] = [24, 16];
const VIEWS: usize = 6;

fn directory(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(path.join("images")).unwrap();
    path
}

/// World from camera with OpenGL's axes: a step to the side for each view, all looking along -z.
fn matrix(k: usize) -> Value {
    json!([[1.0, 0.0, 0.0, 0.2 * k as f64], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 4.0], [0.0, 0.0, 0.0, 1.0]])
}

fn picture(k: usize) -> RgbImage {
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| image::Rgb([(10 * x) as u8, (14 * y) as u8, (40 * k) as u8]))
}

/// A folder with pictures and `transforms.json`.
fn plain(name: &str) -> (PathBuf, Value) {
    let folder = directory(name);
    let frames: Vec<Value> = (0..VIEWS)
        .map(|k| {
            picture(k).save(folder.join(format!("images/{k}.png"))).unwrap();
            json!({"file_path": format!("images/{k}.png"), "transform_matrix": matrix(k)})
        })
        .collect();
    (folder, json!({"w": SIZE[0], "h": SIZE[1], "fl_x": 24.0, "frames": frames}))
}

/// Exit code, standard output and standard error, but for lines of stages, of a few steps of training.
fn train(folder: &Path, text: Option<&str>, options: &[&str]) -> (i32, String, String) {
    if let Some(text) = text {
        fs::write(folder.join("transforms.json"), text).unwrap();
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.arg("reconstruct").arg(folder).arg("--out").arg(folder.join("out"));
    command.args(["--iterations", "3", "--cap", "60", "--random-points", "40", "--hold-out", "3"]).args(options);
    command.env("QV_COLMAP_VENV", folder.join("none"));
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let is_stage = |line: &&str| line.starts_with("qv: ") && line.contains(" of 3: ");
    let err = text(&output.stderr).lines().filter(|line| !is_stage(line)).map(|line| format!("{line}\n")).collect();
    (output.status.code().unwrap(), text(&output.stdout), err)
}

fn metrics(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("out/metrics.json")).unwrap()).unwrap()
}

#[test]
fn guises_of_a_capture_give_what_the_plain_one_gives() {
    let (folder, document) = plain("guise_plain");
    let (code, _, err) = train(&folder, Some(&document.to_string()), &[]);
    assert_eq!((code, err.as_str()), (0, ""));
    let expected = metrics(&folder)["mean"].clone();
    let same = |name: &str, change: &dyn Fn(&Path, Value) -> String| {
        let (folder, document) = plain(name);
        let text = change(&folder, document);
        let (code, _, err) = train(&folder, Some(&text), &[]);
        assert_eq!((code, err.as_str()), (0, ""), "{name}");
        assert_eq!(metrics(&folder)["mean"], expected, "{name}");
    };
    let each = |mut document: Value, path: &dyn Fn(usize) -> String| {
        (0..VIEWS).for_each(|k| document["frames"][k]["file_path"] = path(k).into());
        document.to_string()
    };
    same("guise_no_size", &|_, mut document| {
        let root = document.as_object_mut().unwrap();
        ["w", "h", "fl_x"].iter().for_each(|key| drop(root.remove(*key)));
        root.insert("camera_angle_x".into(), json!(2.0 * 0.5f64.atan()));
        each(document, &|k| format!("./images/{k}"))
    });
    same("guise_null", &|_, mut document| {
        document["k3"] = Value::Null;
        document["frames"][1]["fl_y"] = Value::Null;
        document.to_string()
    });
    same("guise_nan", &|_, document| document.to_string().replace("\"w\"", "\"sharpness\":NaN,\"w\""));
    same("guise_bom", &|_, document| format!("\u{feff}{document}"));
    same("guise_case", &|_, document| each(document, &|k| format!("Images/{k}.PNG")));
    same("guise_backslash", &|_, document| each(document, &|k| format!("images\\{k}.png")));
    same("guise_elsewhere", &|_, document| each(document, &|k| format!("D:\\captures\\yard\\images\\{k}.png")));
    // COLMAP's text, of which the first model has two of the views.
    let (folder, _) = plain("guise_colmap");
    for (model, views) in [("0", 0..2), ("1", 0..VIEWS)] {
        let sparse = folder.join("sparse").join(model);
        fs::create_dir_all(&sparse).unwrap();
        fs::write(sparse.join("cameras.txt"), "1 PINHOLE 24 16 24 24 12 8\n").unwrap();
        // Half a turn about x takes OpenGL's axes to OpenCV's.
        let line = |k: usize| format!("{k} 0 1 0 0 {} 0 4 1 {k}.png\n\n", -0.2 * k as f64);
        fs::write(sparse.join("images.txt"), views.map(line).collect::<String>()).unwrap();
    }
    let (code, _, err) = train(&folder, None, &[]);
    assert!(code == 0 && err.states("2 COLMAP sparse/1 6 sparse/0 2"), "{err}");
    assert_eq!(metrics(&folder)["photographs"], 4);
}

#[test]
fn a_picture_is_turned_as_exif_says() {
    let (folder, mut document) = plain("exif");
    for k in 0..VIEWS {
        let file = folder.join(format!("images/{k}.jpg"));
        image::DynamicImage::from(picture(k)).rotate270().into_rgb8().save(&file).unwrap();
        let plain = fs::read(&file).unwrap();
        // Orientation 6: a viewer turns it by a quarter to the right.
        let exif = b"\xff\xe1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        fs::write(&file, [&plain[..2], exif, &plain[2..]].concat()).unwrap();
        document["frames"][k]["file_path"] = format!("images/{k}.jpg").into();
    }
    let (code, _, err) = train(&folder, Some(&document.to_string()), &[]);
    assert!(code == 0 && err.states("6 EXIF 6 24 16"), "{err}");
}

#[test]
fn scores_of_halves_that_are_masked_are_not_told() {
    let (folder, mut document) = plain("masked_half");
    let mask = GrayImage::from_fn(SIZE[0], SIZE[1], |x, _| Luma([if x < SIZE[0] / 2 { 255 } else { 0 }]));
    mask.save(folder.join("mask.png")).unwrap();
    (0..VIEWS).for_each(|k| document["frames"][k]["mask_path"] = "mask.png".into());
    let (code, out, err) = train(&folder, Some(&document.to_string()), &[]);
    assert!(code == 0 && out.states("PSNR") && out.states("halves"), "{out} {err}");
    assert!(!out.contains("NaN") && metrics(&folder)["mean"]["psnr_right"].is_null(), "{out}");
    let (_, out, _) = train(&folder, None, &["--json"]);
    assert!(!out.contains("NaN"), "{out}");
}

/// Depth of a plane 2 m ahead.
fn depth(path: &Path, units: u16, [width, height]: [u32; 2]) {
    let image: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_pixel(width, height, Luma([units]));
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    image.save(path).unwrap();
}

fn colour(path: &Path, k: usize) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::save_buffer(path, picture(k).as_raw(), SIZE[0], SIZE[1], ExtendedColorType::Rgb8).unwrap();
}

/// World from camera by rows, OpenCV's axes.
fn rows(k: usize) -> String {
    format!("1 0 0 {}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", 0.2 * k as f64)
}

#[test]
fn rgbd_folders_of_three_layouts_are_read() {
    let tum = directory("rgbd_tum");
    let (mut rgb, mut depths, mut poses) = (String::from("# color images\n"), String::new(), String::new());
    for k in 0..VIEWS {
        let t = 1305031102.17 + 0.1 * k as f64;
        colour(&tum.join(format!("rgb/{t:.6}.png")), k);
        depth(&tum.join(format!("depth/{t:.6}.png")), 10_000, SIZE);
        rgb += &format!("{t:.6} rgb/{t:.6}.png\n");
        depths += &format!("{:.6} depth/{t:.6}.png\n", t + 0.004);
        poses += &format!("{:.4} {} 0 0 0 0 0 1\n", t, 0.2 * k as f64);
    }
    let lens = "24 0 12\n0 24 8\n0 0 1\n";
    for (name, text) in
        [("rgb.txt", &*rgb), ("depth.txt", &*depths), ("groundtruth.txt", &*poses), ("camera-intrinsics.txt", lens)]
    {
        fs::write(tum.join(name), text).unwrap();
    }
    let redwood = directory("rgbd_redwood");
    let scannet = directory("rgbd_scannet");
    let mut log = String::new();
    for k in 0..VIEWS {
        colour(&redwood.join(format!("color/{k:05}.png")), k);
        depth(&redwood.join(format!("depth/{k:05}.png")), 2000, SIZE);
        log += &format!("{k} {k} {}\n{}", k + 1, rows(k));
        colour(&scannet.join(format!("color/{k}.png")), k);
        // The depth camera of ScanNet has its own lens.
        depth(&scannet.join(format!("depth/{k}.png")), 2000, [12, 8]);
        fs::create_dir_all(scannet.join("pose")).unwrap();
        fs::write(scannet.join(format!("pose/{k}.txt")), rows(k)).unwrap();
    }
    fs::write(redwood.join("trajectory.log"), log).unwrap();
    let lens = json!({"width": 24, "height": 16, "intrinsic_matrix": [24, 0, 0, 0, 24, 0, 11.5, 7.5, 1]});
    fs::write(redwood.join("camera_intrinsic.json"), lens.to_string()).unwrap();
    fs::create_dir_all(scannet.join("intrinsic")).unwrap();
    let lens = |f: f64, cx: f64, cy: f64| format!("{f} 0 {cx} 0\n0 {f} {cy} 0\n0 0 1 0\n0 0 0 1\n");
    fs::write(scannet.join("intrinsic/intrinsic_color.txt"), lens(24.0, 11.5, 7.5)).unwrap();
    fs::write(scannet.join("intrinsic/intrinsic_depth.txt"), lens(12.0, 5.5, 3.5)).unwrap();
    let mut found = vec![];
    for folder in [&tum, &redwood, &scannet] {
        // With depth: photographs without any would be reported.
        let (code, _, err) = train(folder, None, &["--depth-prior", "1", "--depth-points", "0"]);
        assert_eq!(
            (code, err.lines().filter(|l| !l.contains("terms of geometry")).count()),
            (0, 0),
            "{} {err}",
            folder.display()
        );
        found.push(metrics(folder)["mean"].clone());
    }
    assert!(found.iter().all(|mean| *mean == found[0]), "{found:#?}");
    // As terrain: the plane is seen in every frame.
    for folder in [&tum, &redwood, &scannet] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
        command.arg("mesh").arg(folder).arg("--out").arg(folder.join("m.glb")).args(["--json", "--voxel", "0.1"]);
        let output = command.output().unwrap();
        let line: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        assert_eq!(line["frames"], VIEWS, "{line} {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn scenes_known_by_name_are_drawn() {
    let folder = directory("scene_names");
    let mut row: Vec<u8> = [0.0f32, 0.0, 2.0, 0.3, 0.3, 0.3].iter().flat_map(|x| x.to_le_bytes()).collect();
    row.extend([250, 20, 20, 255, 255, 128, 128, 128]);
    fs::write(folder.join("a.splat"), &row).unwrap();
    fs::write(folder.join("a.spz"), &row).unwrap();
    let cameras = json!({"format": "qv-cameras/1", "cameras": [{"name": "front", "width": 24, "height": 16, "fx": 24.0,
        "position": [0.0, 0.0, 0.0], "rotation": [1.0, 0.0, 0.0, 0.0]}]});
    fs::write(folder.join("cameras.json"), cameras.to_string()).unwrap();
    let render = |name: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
        command.arg("render").arg(folder.join(name)).arg("--cameras").arg(folder.join("cameras.json"));
        let output = command.arg("--out").arg(folder.join("out")).output().unwrap();
        (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(render("a.splat"), (0, String::new()));
    let drawn = image::open(folder.join("out/front.png")).unwrap().into_rgb8();
    let [red, green, _] = drawn.get_pixel(12, 8).0;
    assert!(red > 200 && green < 60, "{:?}", drawn.get_pixel(12, 8));
    let (code, err) = render("a.spz");
    assert!(code == 1 && err.states(".splat"), "{err}");
}
