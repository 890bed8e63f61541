//! `qv navigate look`: photographs of a place beside the scene drawn from where they were taken, and what it says of bad input.

use crate::facts::States;
use glam::{DQuat, DVec3};
use qv_core::random::Xoshiro256PlusPlus;
use qv_core::{Camera, GaussianCloud, Pose, TriangleMesh};
use qv_mesh::files::glb;
use qv_nav::net::Net;
use qv_nav::sight::Rig;
use qv_nav::weights;
use qv_raster::{Scene, Settings, View, render};
use qv_splat::files::{Format, ply, read_any, write};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const SIZE: [u32; 2] = [320, 240];

/// Grey ground of 6 x 6 m, its mesh, photographs of it from where the robot's eye would be, all moved and scaled, and weights that know nothing.
pub fn place(folder: &Path, moved: &Pose, scale: f64) {
    let mut cloud = GaussianCloud::default();
    for (i, j) in (0..60).flat_map(|i| (0..60).map(move |j| (i, j))) {
        cloud.means.push([i as f32 * 0.1 - 2.95, j as f32 * 0.1 - 2.95, 0.0]);
        cloud.log_scales.push([0.06f32.ln(), 0.06f32.ln(), 0.004f32.ln()]);
        cloud.rotations.push([1.0, 0.0, 0.0, 0.0]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push([if (i / 4 + j / 4) % 2 == 0 { -0.8 } else { 0.4 }; 3]);
    }
    let corners = [(-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0)];
    let vertices = corners.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
    let mesh = TriangleMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Default::default() };
    fs::write(folder.join("mesh.glb"), glb::write(&mesh)).unwrap();
    fs::write(folder.join("scene.ply"), write(&cloud, Format::Ply).unwrap()).unwrap();
    let mut cameras = Vec::new();
    for k in 0..4 {
        let turn = f64::from(k) * 0.4;
        let base = Pose::from_xyz_rpy([0.3 * turn - 0.6, 0.2, 0.3], [0.0, 0.0, turn]);
        let world_from_camera = base * Rig::default().base_from_camera();
        let [width, height] = SIZE;
        let camera = Camera {
            // As wide as the robot's eye and a little more.
            fx: 300.0,
            fy: 300.0,
            cx: 160.0,
            cy: 120.0,
            width,
            height,
            camera_from_world: world_from_camera.inverse(),
        };
        let settings = Settings { background: [0.7, 0.8, 0.9], ..Default::default() };
        let image = render(&Scene::still(&cloud), &[View::of(camera)], &settings).unwrap().0.remove(0);
        let bytes: Vec<u8> = image.colour.iter().map(|c| (255.0 * c.clamp(0.0, 1.0)) as u8).collect();
        image::save_buffer(folder.join(format!("{k}.png")), &bytes, width, height, image::ExtendedColorType::Rgb8)
            .unwrap();
        // The capture has a frame of its own.
        let back = moved.inverse();
        let position = back.transform_point(world_from_camera.position) / scale;
        let DQuat { x, y, z, w } = (back.rotation * world_from_camera.rotation).normalize();
        cameras.push(json!({"name": format!("{k}"), "image": format!("{k}.png"), "width": width, "height": height,
            "fx": 300, "position": position.to_array(), "rotation": [w, x, y, z]}));
    }
    let DQuat { x, y, z, w } = moved.rotation;
    let result_from_scene =
        json!({"scale": scale, "position": moved.position.to_array(), "rotation_wxyz": [w, x, y, z]});
    let text = json!({"format": "qv-cameras/1", "cameras": cameras}).to_string();
    fs::write(folder.join("cameras.json"), text).unwrap();
    fs::write(folder.join("moved.json"), json!({"result_from_scene": result_from_scene}).to_string()).unwrap();
    let parameters = Net::default().draw(&mut Xoshiro256PlusPlus::new(1));
    fs::write(folder.join("weights.bin"), weights::to_bytes(&parameters)).unwrap();
}

fn look(folder: &Path, options: &[&str]) -> (i32, Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.current_dir(folder).args([
        "navigate",
        "look",
        "weights.bin",
        "--scene",
        "scene.ply",
        "--terrain",
        "mesh.glb",
    ]);
    command.args(["--capture", "cameras.json", "--hold-out", "1", "--out", "look.html", "--json"]).args(options);
    let output = command.output().unwrap();
    let line = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), line, String::from_utf8_lossy(&output.stderr).into_owned())
}

fn directory(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

#[test]
fn photographs_are_looked_at_from_where_they_were_taken() {
    let folder = directory("navigate_look");
    place(&folder, &Pose::from_xyz_rpy([0.4, -1.0, 2.0], [0.7, 0.2, -1.0]), 2.5);
    let (code, line, err) = look(&folder, &["--moved", "moved.json"]);
    assert_eq!(code, 0, "{err}");
    let heights: Vec<f64> = serde_json::from_value(line["heights_m"].clone()).unwrap();
    // The eye is 0.12 m above a base at 0.3 m.
    assert!(heights.len() == 4 && heights.iter().all(|h| (h - 0.42).abs() < 0.02), "{heights:?}");
    let result = &line["agreement"];
    assert!(result["views"].as_u64() > Some(7) && result["questions"] == json!(12), "{result:#}");
    let page = fs::read_to_string(folder.join("look.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && page.contains("McNemar"), "pictures and the table");
    // The capture's own frame is not the mesh's: no camera stands over the ground there.
    let (code, _, err) = look(&folder, &[]);
    assert!(code == 1 && err.states("views"), "{code} {err}");
}

#[test]
fn bad_input_is_named() {
    let folder = directory("navigate_look_bad");
    place(&folder, &Pose::IDENTITY, 1.0);
    fs::write(folder.join("bad.json"), "{\"result_from_scene\": {\"scale\": 0}}").unwrap();
    let (code, _, err) = look(&folder, &["--moved", "bad.json"]);
    assert!(code == 1 && err.contains("bad.json") && err.contains("result_from_scene"), "{err}");
    fs::write(folder.join("other.json"), "{\"format\": \"qv-cameras/1\", \"cameras\": []}").unwrap();
    let (code, _, err) = look(&folder, &["--cameras", "other.json"]);
    assert!(code == 1 && err.states("views"), "{err}");
    fs::write(folder.join("weights.bin"), "nothing").unwrap();
    let (code, _, err) = look(&folder, &[]);
    assert!(code == 1 && err.contains("weights.bin"), "{err}");
    fs::write(folder.join("narrow.toml"), "width = 640\nheight = 480\nfx = 200.0\ncx = 320.0\ncy = 240.0\n[base_from_camera]\nposition = [0.3, 0.0, 0.12]\nquaternion = [0.5, -0.5, 0.5, -0.5]\n").unwrap();
    place(&folder, &Pose::IDENTITY, 1.0);
    let (code, _, err) = look(&folder, &["--mount", "narrow.toml"]);
    assert!(code == 1 && err.states("fill"), "{err}");
}

/// Runs `qv`; gives its exit code, the JSON of standard output, and what it says.
fn qv(folder: &Path, arguments: &str) -> (i32, Value, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_qv")).current_dir(folder).args(arguments.split(' ')).output().unwrap();
    let line = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), line, String::from_utf8_lossy(&output.stderr).into_owned())
}

/// A place with a cone in view.
const VIEW: &str = "--scene scene.ply --terrain mesh.glb --starts view,turned --distance 1.2,2.5";

#[test]
fn a_student_learns_from_the_teacher_then_from_trials_on_legs_that_walk() {
    let folder = directory("navigate_walks");
    place(&folder, &Pose::IDENTITY, 1.0);
    let (code, _, err) = qv(&folder, "walk train --iterations 100 --robots 16 --out walk --json");
    assert_eq!(code, 0, "{err}");
    fs::write(
        folder.join("calibrated.toml"),
        "[parameters]\n\"actuator.*.strength\" = 0.8\n\"sensor.*.encoder_latency\" = 0.02\n",
    )
    .unwrap();
    let train = format!(
        "navigate train {VIEW} --rounds 1 --ppo-rounds 2 --frames 30 --robots 3 --out nav --json --walk walk/policy.onnx"
    );
    let (code, line, err) = qv(&folder, &format!("{train} --params calibrated.toml"));
    assert!(code == 0 && err.states("encoder_latency"), "{err}");
    let metrics: Value = serde_json::from_slice(&fs::read(folder.join("nav/metrics.json")).unwrap()).unwrap();
    let result = metrics.as_array().unwrap();
    assert!(result.len() == 3 && line["rounds"] == json!(3) && line["decisions"] == result[2]["frames"], "{metrics:#}");
    assert!(result[0]["gains"].is_null() && result[2]["gains"]["reward"].is_number(), "{metrics:#}");
    assert!(
        result[2]["frames"].as_u64() > result[1]["frames"].as_u64() && result[2]["round"] == json!(3),
        "{metrics:#}"
    );
    let test = |more: &str| {
        let (code, line, err) =
            qv(&folder, &format!("navigate test nav/weights.bin {VIEW} --episodes 3 --out results.json --json{more}"));
        assert_eq!(code, 0, "{err}");
        line
    };
    let (walked, followed) = (test(" --walk walk/policy.onnx"), test(""));
    assert!(walked["legs"].as_str().unwrap().starts_with("go2 in the simulator"), "{}", walked["legs"]);
    assert!(followed["legs"].as_str().unwrap().states("physics"), "{}", followed["legs"]);
    // Results are read back; those of other weights are not the same policy's.
    fs::write(folder.join("walked.json"), walked.to_string()).unwrap();
    fs::write(folder.join("other.json"), walked.to_string().replace(walked["weights"].as_str().unwrap(), "0")).unwrap();
    let page = |beside: &str| qv(&folder, &format!("navigate page results.json --beside {beside} --out page.html"));
    assert_eq!(page("walked.json").0, 0);
    let (code, _, err) = page("other.json");
    assert!(code == 1 && err.states("other.json --beside"), "{err}");
    // Weights of a training that was cut off become a policy.
    let (code, _, err) =
        qv(&folder, &format!("navigate train {VIEW} --rounds 0 --from nav/weights.bin --out again --json"));
    assert_eq!(code, 0, "{err}");
    let [a, b] = ["nav", "again"].map(|out| fs::read(folder.join(out).join("policy.onnx")).unwrap());
    assert!(a == b, "the same policy");
    // The teacher goes otherwise on a Go2 that has hardly learnt to walk.
    let tracks = |results: &Value| results["rows"][1]["trials"].clone();
    assert!(results_differ(&tracks(&walked), &tracks(&followed)));
}

fn results_differ(a: &Value, b: &Value) -> bool {
    !a.is_null() && !b.is_null() && a != b
}

#[test]
fn a_training_can_see_several_scenes_of_a_place() {
    let folder = directory("navigate_also");
    place(&folder, &Pose::IDENTITY, 1.0);
    // The same ground, darker.
    let mut dark = read_any(&fs::read(folder.join("scene.ply")).unwrap()).unwrap().cloud;
    dark.sh.iter_mut().flatten().for_each(|c| *c -= 0.5);
    fs::write(folder.join("dark.ply"), write(&dark, Format::Ply).unwrap()).unwrap();
    let learnt = |also: &str| {
        let arguments = format!("navigate train {VIEW} --rounds 1 --frames 30 --robots 6 --out nav --json{also}");
        let (code, _, err) = qv(&folder, &arguments);
        assert_eq!(code, 0, "{err}");
        fs::read(folder.join("nav/weights.bin")).unwrap()
    };
    let one = learnt("");
    assert!(one == learnt(" --also scene.ply"), "the same scene twice is one");
    assert!(one != learnt(" --also dark.ply"));
    // The same ground made over red is drawn over red, over black before a sky as what says nothing.
    let ground = read_any(&fs::read(folder.join("scene.ply")).unwrap()).unwrap().cloud;
    for (name, background) in [("red.ply", [0.8, 0.1, 0.1]), ("black.ply", [0.0; 3])] {
        fs::write(folder.join(name), ply::write_over(&ground, Some(background)).unwrap()).unwrap();
    }
    assert!(one != learnt(" --also red.ply") && one == learnt(" --also black.ply"));
    let (code, _, err) = qv(&folder, &format!("navigate train {VIEW} --also none.ply --out nav"));
    assert!(code == 1 && err.contains("none.ply"), "{err}");
    // In another frame.
    dark.means.iter_mut().for_each(|p| p[0] += 100.0);
    fs::write(folder.join("far.ply"), write(&dark, Format::Ply).unwrap()).unwrap();
    let (code, _, err) = qv(&folder, &format!("navigate train {VIEW} --also dark.ply far.ply --out nav"));
    assert!(code == 1 && err.states("far.ply Gaussians -3.1 3.1"), "{err}");
    let (code, _, err) = qv(&folder, &format!("navigate train {VIEW} --also nav/metrics.json --out nav"));
    assert!(code == 1 && err.contains("metrics.json"), "{err}");
}

#[test]
fn what_a_training_cannot_use_is_named() {
    let folder = directory("navigate_walks_bad");
    place(&folder, &Pose::IDENTITY, 1.0);
    let train = |more: &str| {
        let (code, _, err) = qv(&folder, &format!("navigate train {VIEW} --frames 30 --robots 3 --out nav {more}"));
        assert_eq!(code, 1, "{err}");
        err
    };
    let err = train("--rounds 0 --ppo-rounds 3");
    assert!(err.states("--from WEIGHTS.bin"), "{err}");
    fs::create_dir(folder.join("nav")).unwrap();
    fs::copy(folder.join("weights.bin"), folder.join("nav/policy.onnx")).unwrap();
    let err = train("--rounds 1 --from nav/policy.onnx");
    assert!(err.states("nav/policy.onnx"), "{err}");
    let (code, _, err) = qv(&folder, &format!("navigate test weights.bin {VIEW} --out scene.ply"));
    assert!(code == 1 && err.states("scene.ply"), "{err}");
    let (code, _, err) = qv(&folder, &format!("navigate train {VIEW} --robots 5000000 --out many"));
    assert_eq!(code, 2, "{err}");
    assert!(err.states("robots 1 100000"), "{err}");
    let err = train("--walk nowhere/policy.onnx");
    assert!(err.contains("nowhere/policy.onnx"), "{err}");
    let err = train("--walk policy.onnx --floor 0");
    assert!(err.states("floor"), "{err}");
    let (code, _, err) = qv(&folder, "walk train --iterations 100 --robots 8 --out walk --json");
    assert_eq!(code, 0, "{err}");
    fs::write(
        folder.join("compensator.json"),
        "{\"version\": 1, \"robot\": \"spot\", \"joints\": [], \"kind\": \"nominal\", \"parameters\": {}}",
    )
    .unwrap();
    let err = train("--walk walk/policy.onnx --params compensator.json");
    assert!(err.contains("compensator.json") && err.contains("go2"), "{err}");
    fs::write(folder.join("calibrated.toml"), "[parameters]\n").unwrap();
    let err = train("--walk walk/policy.onnx --params calibrated.toml");
    assert!(err.states("calibrated.toml"), "{err}");
    fs::write(folder.join("calibrated.toml"), "[parameters]\n\"actuator.*.colour\" = 0.8\n").unwrap();
    let err = train("--walk walk/policy.onnx --params calibrated.toml");
    assert!(err.contains("calibrated.toml") && err.contains("colour"), "{err}");
}

/// A process that ends with the test.
#[cfg(unix)]
struct GuardedChild(std::process::Child);

#[cfg(unix)]
impl Drop for GuardedChild {
    fn drop(&mut self) {
        let _ = self.0.kill();
    }
}

/// What a training says, and its exit code, that gets a signal once something is true.
#[cfg(unix)]
fn stopped(folder: &Path, arguments: &str, signal: &str, is_time: impl Fn(&Path) -> bool) -> (Option<i32>, String) {
    use std::time::{Duration, Instant};
    let log = folder.join("stderr");
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.current_dir(folder).args(arguments.split(' ')).stderr(fs::File::create(&log).unwrap());
    let mut child = GuardedChild(command.spawn().unwrap());
    let said = || fs::read_to_string(&log).unwrap();
    let begun = Instant::now();
    while !is_time(folder) {
        assert!(child.0.try_wait().unwrap().is_none(), "it ended by itself: {}", said());
        assert!(begun.elapsed() < Duration::from_secs(120), "{}", said());
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(Command::new("kill").args([signal, &child.0.id().to_string()]).status().unwrap().success());
    (child.0.wait().unwrap().code(), said())
}

#[cfg(unix)]
#[test]
fn a_training_that_is_stopped_says_how_to_go_on() {
    let folder = directory("navigate_stopped");
    place(&folder, &Pose::IDENTITY, 1.0);
    let small = format!("navigate train {VIEW} --robots 2 --epochs 1 --batch 2");
    let long = format!("{small} --out nav --frames 20 --rounds 100000 --ppo-rounds=7");
    // It is written after the weights of a round.
    let (code, err) = stopped(&folder, &long, "-INT", |folder| folder.join("nav/unfinished.json").exists());
    assert_eq!(code, Some(130), "{err}");
    let line = err.lines().last().unwrap();
    let rest = line.strip_prefix("qv: stopped after ").unwrap_or_else(|| panic!("{err}"));
    let rounds: usize = rest.split(' ').next().unwrap().parse().unwrap();
    let (_, typed) = line.split_once("to go on: qv ").unwrap();
    assert!(rounds > 0 && typed.ends_with(" --resume"), "{line}");
    let kept = weights::from_bytes(&fs::read(folder.join("nav/weights.bin")).unwrap(), &Net::default()).unwrap();
    assert!(folder.join("nav/policy.onnx").exists() && !folder.join("nav/qv.lock").exists());
    // What it says can be typed, and is stopped again after another round; the policy of the first stop stays.
    let state = |folder: &Path| -> usize {
        let state: Value = serde_json::from_slice(&fs::read(folder.join("nav/unfinished.json")).unwrap()).unwrap();
        state["metrics"].as_array().unwrap().len()
    };
    assert_eq!(state(&folder), rounds);
    let (code, err) = stopped(&folder, typed, "-INT", |folder| state(folder) > rounds);
    assert_eq!(code, Some(130), "{err}");
    let read =
        |name: &str| weights::from_bytes(&fs::read(folder.join("nav").join(name)).unwrap(), &Net::default()).unwrap();
    assert!(read("weights.bin") == kept && read("unfinished.bin") != kept, "it learnt");
    // From those weights another training ends.
    let from = format!("{small} --out more --frames 20 --from nav/weights.bin --rounds 1 --json");
    let (code, line, err) = qv(&folder, &from);
    assert!(code == 0 && line["rounds"] == json!(1), "{err}");
    // In the first round there is nothing yet.
    let (code, err) = stopped(&folder, &format!("{small} --frames 10000000 --out first"), "-TERM", |folder| {
        fs::read_to_string(folder.join("stderr")).is_ok_and(|said| said.states("drive"))
    });
    assert_eq!(code, Some(130), "{err}");
    assert!(err.lines().last().unwrap().ends_with("in the first of 18 rounds; nothing was written"), "{err}");
    assert!(!folder.join("first/weights.bin").exists());
}
