//! `qv mesh`: a scene of Gaussians, folders of depth images, and what it says of bad input.

use crate::facts::States;
use crate::skipped::skipped;
use glam::DVec3;
use qv_core::GaussianCloud;
use qv_mesh::files::{glb, ply};
use qv_mesh::{Topology, compare};
use qv_splat::files::{Format, read_any, write};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use yard::Yard;

fn directory(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// Exit code, the line of JSON, and standard error.
fn mesh(scene: &Path, out: &Path, options: &[&str]) -> (i32, Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.arg("mesh").arg(scene).arg("--out").arg(out).arg("--json").args(options);
    let output = command.output().unwrap();
    let line = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), line, String::from_utf8_lossy(&output.stderr).into_owned())
}

const LABELS: &str =
    "[[label]]\nindex = 2\nname = \"stone\"\n\n[[label]]\nindex = 1\nname = \"grass\"\nfriction = 0.6\n";

/// Ground of flat discs at z = 0.1 over 3 x 3 m, feature 0 where x < 0, else feature 1; four cameras above it.
fn ground(folder: &Path) -> (PathBuf, PathBuf) {
    let mut cloud = GaussianCloud { feature_count: 2, ..Default::default() };
    for i in 0..61 * 61 {
        let (x, y) = ((i % 61) as f32 * 0.05 - 1.5, (i / 61) as f32 * 0.05 - 1.5);
        cloud.means.push([x, y, 0.1]);
        cloud.log_scales.push([-3.2, -3.2, -8.0]);
        cloud.rotations.push([1.0, 0.0, 0.0, 0.0]);
        cloud.opacity_logits.push(5.0);
        cloud.sh.push([0.3; 3]);
        cloud.features.extend(if x < 0.0 { [1.0, 0.0] } else { [0.0, 1.0] });
    }
    // Half a turn about x looks down.
    let camera = |x: f64, y: f64| json!({"name": format!("{x} {y}"), "width": 160, "height": 120, "fx": 100, "position": [x, y, 1.6], "rotation": [0, 1, 0, 0]});
    let cameras = [camera(-0.4, -0.4), camera(0.4, -0.4), camera(0.4, 0.4), camera(-0.4, 0.4)];
    let (scene, file) = (folder.join("scene.ply"), folder.join("cameras.json"));
    fs::write(&scene, write(&cloud, Format::Ply).unwrap()).unwrap();
    fs::write(&file, json!({"format": "qv-cameras/1", "cameras": cameras}).to_string()).unwrap();
    fs::write(folder.join("labels.toml"), LABELS).unwrap();
    (scene, file)
}

#[test]
fn gaussians_become_ground_with_friction() {
    let folder = directory("mesh_gaussians");
    let (scene, cameras) = ground(&folder);
    let (out, labels) = (folder.join("ground.glb"), folder.join("labels.toml"));
    let path = |path: &Path| path.to_str().unwrap().to_string();
    let (code, line, err) = mesh(
        &scene,
        &out,
        &["--cameras", &path(&cameras), "--labels", &path(&labels), "--triangles", "2000", "--agree", "0"],
    );
    assert_eq!((code, line["format"].as_str()), (0, Some("qv-mesh/1")), "{err}");
    assert_eq!((&line["watertight"], &line["frames"]), (&json!(true), &json!(4)), "{line:#}");
    assert!(line["triangles"].as_u64().unwrap() <= 2000, "walls and floor included: {line:#}");
    let found = glb::read(&fs::read(&out).unwrap()).unwrap();
    assert_eq!((found.materials[0].name.as_str(), found.materials[0].friction), ("grass", Some(0.6)));
    assert_eq!((found.materials[1].name.as_str(), found.materials[1].friction), ("stone", None));
    let top: Vec<usize> = (0..found.triangles.len())
        .filter(|t| {
            let [a, b, c] = found.corners(*t);
            let n = (b - a).cross(c - a);
            n.z > 0.99 * n.length()
        })
        .collect();
    let (mut area, mut wrong) = (0.0, 0.0);
    for t in top {
        let [a, b, c] = found.corners(t);
        assert!([a, b, c].iter().all(|p| (p.z - 0.1).abs() < 0.004), "{a} {b} {c}");
        let part = 0.5 * (b - a).cross(c - a).length();
        area += part;
        wrong += if (found.labels[t] == 0) == ((a + b + c).x < 0.0) { 0.0 } else { part };
    }
    assert!(area > 6.0 && wrong < 0.03 * area, "{area} {wrong}");
}

/// The scene goes where the mesh goes: twice as large, and turned so that its x is up.
#[test]
fn the_scene_is_moved_with_the_mesh() {
    let folder = directory("mesh_scene_out");
    let (scene, cameras) = ground(&folder);
    let (cameras, moved) = (cameras.to_str().unwrap().to_string(), folder.join("moved.ply"));
    let out = moved.to_str().unwrap();
    let common = ["--cameras", &cameras, "--agree", "0", "--open", "--scene-out", out];
    let turned = [&common[..], &["--distance", "0,0,0,1,0,0,2", "--up", "1,0,0"]].concat();
    let (code, line, err) = mesh(&scene, &folder.join("ground.ply"), &turned);
    assert_eq!(code, 0, "{err}");
    assert_eq!(line["result_from_scene"]["scale"], json!(2.0));
    let cloud = read_any(&fs::read(&moved).unwrap()).unwrap().cloud;
    // What was along x is along z, and the ground stands upright.
    let highest = cloud.means.iter().map(|mean| mean[2]).fold(f32::MIN, f32::max);
    assert!((highest - 3.0).abs() < 1e-5 && cloud.feature_count == 2, "{highest}");
    assert!((cloud.log_scales[0][0] - (-3.2 + 2f32.ln())).abs() < 1e-6);
    let found = ply::read(&fs::read(folder.join("ground.ply")).unwrap()).unwrap();
    let gaussians: Vec<DVec3> = cloud.means.iter().map(|mean| DVec3::from(mean.map(f64::from))).collect();
    let likeness = compare::compare_points(&found.vertices, &found.vertices, &gaussians, &[0.1]).unwrap();
    // The surface reaches past the outermost Gaussians, as far as their own size.
    assert!(likeness[0].precision > 0.95, "the mesh lies on the Gaussians: {likeness:?}");
    let without = ["--scene-out", out];
    let (code, _, err) = mesh(&folder, &folder.join("other.ply"), &without);
    assert!(code == 1 && err.contains("--scene-in"), "{err}");
    let bad = [&common[..5], &["--scene-out", "moved.txt"]].concat();
    let (code, _, err) = mesh(&scene, &folder.join("other.ply"), &bad);
    assert!(code == 1 && err.states(".ply .spz .glb"), "{err}");
}

#[test]
fn plain_ground_is_laid_on_its_plane_and_only_drawn_pictures_are() {
    let folder = directory("mesh_planes");
    let (scene, cameras) = ground(&folder);
    let (cameras, out) = (cameras.to_str().unwrap().to_string(), folder.join("ground.ply"));
    let (code, line, err) = mesh(&scene, &out, &["--cameras", &cameras, "--agree", "0", "--planes", "--open"]);
    assert_eq!(code, 0, "{err}");
    assert!(line["planes"].as_u64().unwrap() >= 1 && line["depth_on_planes"].as_f64().unwrap() > 0.05, "{line:#}");
    let found = ply::read(&fs::read(&out).unwrap()).unwrap();
    assert!(found.vertices.iter().all(|p| (p.z - 0.1).abs() < 0.02));
    let (_, line, _) = mesh(&scene, &out, &["--cameras", &cameras, "--agree", "0", "--open"]);
    assert!(line["planes"].is_null() && line["depth_on_planes"].is_null(), "{line:#}");
    let (code, _, err) = mesh(&folder, &out, &["--planes"]);
    assert!(code == 2 && err.contains("--cameras"), "{code} {err}");
}

#[test]
fn the_yard_from_its_depth_images() {
    let folder = directory("mesh_yard");
    yard::files::write(&Yard::new(24, 160, 120, 1).unwrap(), &folder, || ()).unwrap();
    let (labels, truth) = (folder.join("labels.toml"), folder.join("truth.glb"));
    let options =
        ["--labels", labels.to_str().unwrap(), "--compare", truth.to_str().unwrap(), "--voxel", "0.03", "--open"];
    let (code, line, err) = mesh(&folder, &folder.join("yard.ply"), &options);
    assert_eq!(code, 0, "{err}");
    let f1 = |k: usize| line["likeness"][k]["f1"].as_f64().unwrap();
    assert!(f1(0) > 0.9 && f1(1) > 0.97, "{line:#}");
    assert_eq!(line["materials"][1]["name"], "grass");
    assert_eq!(line["watertight"], false);

    // A frame that is gone is named, and the rest is used.
    fs::remove_file(folder.join("depth/0004.png")).unwrap();
    let (code, line, err) = mesh(&folder, &folder.join("yard.stl"), &["--voxel", "0.04"]);
    assert_eq!((code, &line["frames"], &line["watertight"]), (3, &json!(23), &json!(true)), "{err}");
    assert!(err.contains("0004.png"), "{err}");
}

/// Frames as 7-Scenes has them, in a frame that is turned, moved and half as large.
#[test]
fn rgbd_frames_and_what_brings_them_to_metres() {
    let folder = directory("mesh_rgbd");
    let yard = Yard::new(16, 160, 120, 3).unwrap();
    let scene_from_world = qv_mesh::similarity::Similarity {
        scale: 0.5,
        pose: qv_core::Pose::from_xyz_rpy([0.3, -2.0, 1.0], [0.5, -0.2, 0.9]),
    };
    let (mut markers, mut trajectory) = (String::from("# scene, then metres\n"), String::new());
    let mut near = String::new();
    for (view, camera) in yard.cameras.iter().enumerate() {
        let depth = yard.photo(view).depth;
        let mut frame = qv_mesh::DepthFrame { camera: *camera, depth, weight: vec![] };
        let place = camera.camera_from_world.inverse().position;
        scene_from_world.apply_to_frame(&mut frame);
        let pose = frame.camera.camera_from_world.inverse();
        let m = pose.matrix().transpose().to_cols_array_2d();
        let rows: Vec<String> =
            (0..3).map(|k| format!("{} {} {} {}", m[k][0], m[k][1], m[k][2], pose.position[k])).collect();
        let name = format!("frame-{view:06}");
        fs::write(folder.join(format!("{name}.pose.txt")), rows.join("\n") + "\n0 0 0 1\n").unwrap();
        let millimetres: Vec<u8> =
            frame.depth.iter().flat_map(|d| ((d * 1000.0).round() as u16).to_ne_bytes()).collect();
        let path = folder.join(format!("{name}.depth.png"));
        image::save_buffer(path, &millimetres, 160, 120, image::ExtendedColorType::L16).unwrap();
        // Names of either image, or of neither.
        let ending = ["", ".color.jpg", ".depth.png"][view % 3];
        trajectory += &format!("{name}{ending} {} {} {}\n", place.x, place.y, place.z);
        let p = scene_from_world.transform_point(place + DVec3::new(0.0, 0.3, -1.0));
        let q = place + DVec3::new(0.0, 0.3, -1.0);
        markers += &format!("{} {} {} {} {} {}\n", p.x, p.y, p.z, q.x, q.y, q.z);
        let q = 1.02 * q + DVec3::new(0.04, -0.03, 0.02);
        near += &format!("{} {} {} {} {} {}\n", p.x, p.y, p.z, q.x, q.y, q.z);
    }
    let c = &yard.cameras[0];
    fs::write(folder.join("camera-intrinsics.txt"), format!("{} 0 {}\n0 {} {}\n0 0 1\n", c.fx, c.cx, c.fy, c.cy))
        .unwrap();
    let write = |name: &str, text: &str| {
        fs::write(folder.join(name), text).unwrap();
        folder.join(name).to_str().unwrap().to_string()
    };
    let (markers, trajectory) = (write("markers.txt", &markers), write("trajectory.txt", &trajectory));
    let truth = write("truth.glb", "");
    fs::write(&truth, glb::write(&yard.mesh)).unwrap();
    for how in [["--markers", markers.as_str()], ["--trajectory", trajectory.as_str()]] {
        let options = [how[0], how[1], "--voxel", "0.04", "--compare", truth.as_str(), "--open"];
        let (code, line, err) = mesh(&folder, &folder.join("out.glb"), &options);
        assert_eq!(code, 0, "{err}");
        assert!(line["likeness"][1]["f1"].as_f64().unwrap() > 0.9, "{how:?}: {line:#}");
    }
    // Two per cent too large and some centimetres off: far from the truth, until it is laid on it.
    let near = write("near.txt", &near);
    let options = ["--markers", &near, "--voxel", "0.04", "--compare", &truth, "--open", "--compare-aligned"];
    let f1 = |options: &[&str]| {
        let (code, line, err) = mesh(&folder, &folder.join("out.glb"), options);
        assert_eq!(code, 0, "{err}");
        (line["likeness"][1]["f1"].as_f64().unwrap(), err)
    };
    let (off, laid) = (f1(&options[..7]).0, f1(&options));
    assert!(off < 0.9 && laid.0 > 0.98 && laid.1.contains("0.98"), "{off} {laid:?}");
    // What no frame measured does not count against it, and all that is there is found.
    let own = folder.join("own.ply");
    let [own_path, frames] = [&own, &folder].map(|path| path.to_str().unwrap());
    let (code, ..) = mesh(&folder, &own, &["--voxel", "0.04", "--open"]);
    assert_eq!(code, 0);
    let measured = f1(&["--voxel", "0.04", "--open", "--compare", own_path, "--compare-measured", frames]).0;
    assert_eq!(measured, 1.0);
    let (code, _, err) = mesh(&folder, &own, &["--open", "--compare", own_path]);
    assert!(code == 1 && err.states("read"), "{err}");
    let (code, _, err) = mesh(&folder, &folder.join("out.glb"), &["--open", "--compare", "none.ply"]);
    assert!(code == 1 && err.states("none.ply"), "{err}");

    // The scale from a distance, z from the ground: heights are right, place and heading are not known.
    let [a, b] = [DVec3::ZERO, DVec3::X].map(|p| scene_from_world.transform_point(p).to_array());
    let distance = format!("--distance={},{},{},{},{},{},1.0", a[0], a[1], a[2], b[0], b[1], b[2]);
    let out = folder.join("level.glb");
    let (code, _, err) = mesh(&folder, &out, &[&distance, "--up", "ground", "--voxel", "0.04", "--open"]);
    assert_eq!(code, 0, "{err}");
    let found = glb::read(&fs::read(&out).unwrap()).unwrap();
    let points = compare::sample(&found, 20_000, 1).unwrap();
    let ground = points.iter().filter(|p| p.z.abs() < 0.02).count();
    assert!(ground > 10_000, "{ground} of 20000 on the ground");
    assert!((Topology::of(&found).area / 46.0 - 1.0).abs() < 0.15, "{:?}", Topology::of(&found));
    // The first frame is of another size than the others: it is left out and named, not they.
    let odd = folder.join("frame-000000.depth.png");
    image::save_buffer(odd, &[0; 2 * 140 * 110], 140, 110, image::ExtendedColorType::L16).unwrap();
    let (code, line, err) = mesh(&folder, &out, &["--voxel", "0.04", "--open"]);
    assert_eq!((code, &line["frames"]), (3, &json!(15)), "{err}");
    assert!(err.states("frame-000000.depth.png 160 120 140 110"), "{err}");
}

#[test]
fn bad_input_is_named() {
    let folder = directory("mesh_bad");
    let (scene, cameras) = ground(&folder);
    let cameras = cameras.to_str().unwrap();
    let out = folder.join("out.glb");
    let fails = |scene: &Path, out: &Path, options: &[&str], words: &[&str]| {
        let (code, _, err) = mesh(scene, out, options);
        assert_eq!(code, 1, "{options:?}: {err}");
        assert!(words.iter().all(|word| err.contains(word)), "{words:?}: {err}");
    };
    fails(&scene, &folder.join("out.obj"), &["--cameras", cameras], &["out.obj", ".glb, .ply or .stl"]);
    fails(&scene, &out, &[], &["cannot mesh", "--cameras is missing", "hint: ", "cameras.json"]);
    fails(&folder, &out, &[], &["a folder without depth"]);
    fails(&scene, &scene.join("in/out.glb"), &["--cameras", cameras], &["scene.ply", "expected a folder"]);
    fails(&folder.join("none.ply"), &out, &["--cameras", cameras], &["none.ply"]);
    for [option, value] in [["--voxel", "0"], ["--max-depth", "nan"], ["--memory", "inf"], ["--agree", "9"]] {
        let (code, _, err) = mesh(&scene, &out, &["--cameras", cameras, option, value]);
        assert!(code == 2 && err.contains(option) && err.contains(value), "{code} {err}");
    }
    fails(
        &scene,
        &out,
        &["--cameras", cameras, "--voxel", "0.001", "--memory", "0.01"],
        &["bytes of memory", "larger voxels"],
    );
    fails(&scene, &out, &["--cameras", cameras, "--max-depth", "0.5"], &["found none in 4 frames"]);
    fails(&scene, &out, &["--cameras", cameras, "--up", "1,2"], &["--up", "1,2"]);
    fails(&scene, &out, &["--cameras", cameras, "--distance=0,0,0,1"], &["--distance", "4 numbers"]);
    let one = folder.join("one.json");
    let camera =
        json!({"name": "a", "width": 64, "height": 48, "fx": 50, "position": [0, 0, 1.5], "rotation": [0, 1, 0, 0]});
    fs::write(&one, json!({"format": "qv-cameras/1", "cameras": [camera]}).to_string()).unwrap();
    fails(&scene, &out, &["--cameras", one.to_str().unwrap()], &["two or more, found 1"]);
    let labels = folder.join("bad.toml");
    for (text, word) in [
        ("x = [", "TOML"),
        ("a = 1", "[[label]]"),
        ("[[label]]\nindex = 3\nname = \"a\"", "label 1: expected an index"),
        ("[[label]]\nindex = 1", "label 1: expected a name"),
        ("[[label]]\nindex = 1\nname = \"a\"\nfriction = -1", "friction of at least 0"),
    ] {
        fs::write(&labels, text).unwrap();
        fails(&scene, &out, &["--cameras", cameras, "--labels", labels.to_str().unwrap()], &["bad.toml", word]);
    }
    let line = folder.join("line.txt");
    fs::write(&line, "0 0 0 0 0 0\n1 0 0 1 0 0\n2 0 0 2 0 0\n").unwrap();
    fails(&scene, &out, &["--cameras", cameras, "--markers", line.to_str().unwrap()], &["not on one line"]);
    assert!(!out.exists());
}

#[test]
fn redkitchen() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes/redkitchen");
    if !folder.exists() {
        skipped("no ../shared beside the workspace");
        return;
    }
    let out = directory("mesh_kitchen").join("kitchen.glb");
    let (code, line, err) = mesh(&folder, &out, &["--up", "ground", "--triangles", "60000"]);
    assert_eq!((code, &line["frames"], &line["watertight"]), (0, &json!(50), &json!(true)), "{err}");
    println!("{line:#}");
    assert!(line["extracted"].as_u64().unwrap() > 100_000, "{line:#}");
    assert!(line["triangles"].as_u64().unwrap() <= 60_000 || err.contains("--triangles 60000: "), "{line:#} {err}");
}
