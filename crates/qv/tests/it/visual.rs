//! `qv diagnose --scene --camera`: a trotting Go2 with a camera in the yard, and every way to give it the wrong things.

use crate::bags::*;
use crate::facts::States;
use crate::footage::{HiddenError, Truth, mounting, recording};
use glam::{DQuat, DVec3};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use qv_camera::path::Path as Way;
use qv_camera::{Intrinsics, Rig};
use qv_core::{GaussianCloud, JointSeries, Pose};
use qv_go2::synthetic::{self, Robot};
use qv_recording::cdr::Writer;
use qv_recording::{BagFile, read_bag};
use qv_sim::Terrain;
use qv_splat::files::{Format, write as write_splats};
use std::path::{Path, PathBuf};
use yard::Yard;

const SIZE: [u32; 2] = [160, 120];

/// A `sensor_msgs/msg/CompressedImage` with a PNG in it.
fn image_message(time: f64, stamp: f64, rgba: &[[u8; 4]]) -> Message {
    let rgb: Vec<u8> = rgba.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    let mut png = Vec::new();
    PngEncoder::new(&mut png).write_image(&rgb, SIZE[0], SIZE[1], ExtendedColorType::Rgb8).unwrap();
    let ns = |t: f64| START + (1e9 * t) as u64;
    let mut writer = Writer::new();
    writer.time(ns(stamp)).string("camera").string("png").u32(png.len() as u32);
    png.iter().for_each(|b| {
        writer.u8(*b);
    });
    Message { topic: "/front/compressed", time: ns(time), data: writer.finish() }
}

fn camera_toml(rig: &Rig) -> String {
    let Intrinsics { fx, fy, cx, cy, width, height } = rig.intrinsics;
    format!(
        "width = {width}\nheight = {height}\nfx = {fx}\nfy = {fy}\ncx = {cx}\ncy = {cy}\n[base_from_camera]\nposition = {:?}\nquaternion = {:?}\n",
        rig.base_from_camera.position.to_array(),
        rig.base_from_camera.wxyz()
    )
}

fn rig() -> Rig {
    let [width, height] = SIZE;
    let intrinsics = Intrinsics { fx: 96.0, fy: 96.0, cx: 80.0, cy: 60.0, width, height };
    Rig { intrinsics, base_from_camera: mounting(), delay: 0.0, gain: 1.0, blur: 0.0 }
}

/// A wall of dots two metres ahead of the robot's start.
fn dots() -> GaussianCloud {
    let mut cloud = GaussianCloud::default();
    for k in 0..900 {
        let (i, j) = (k % 30, k / 30);
        cloud.means.push([2.0, 0.1 * (i - 15) as f32, 0.1 * j as f32 - 1.0]);
        cloud.log_scales.push([-2.7; 3]);
        cloud.rotations.push([1.0, 0.0, 0.0, 0.0]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push([((i * 7 + j * 3) % 5) as f32 * 0.3 - 0.6; 3]);
    }
    cloud
}

/// Writes a bag, a scene and a camera, and runs the diagnosis.
fn diagnose(name: &str, messages: &[Message], cloud: &GaussianCloud, camera: &str) -> (i32, String, String, PathBuf) {
    let run = bag(name, &write(messages, small_chunks(None), &[]));
    let folder = run.parent().unwrap().to_path_buf();
    std::fs::write(folder.join("scene.ply"), write_splats(cloud, Format::Ply).unwrap()).unwrap();
    std::fs::write(folder.join("camera.toml"), camera).unwrap();
    let path = |name: &str| folder.join(name).to_str().unwrap().to_string();
    let arguments = [
        "diagnose",
        run.to_str().unwrap(),
        "--scene",
        &path("scene.ply"),
        "--camera",
        &path("camera.toml"),
        "--json",
        "--out",
    ];
    let (code, out, err) = qv(&[&arguments[..], &[&path("out")]].concat());
    (code, out, err, folder.join("out"))
}

#[test]
fn wrong_inputs_are_named_before_anything_is_simulated() {
    let plain = walk(2.0);
    let camera = camera_toml(&rig());
    let fails = |name: &str, messages: &[Message], cloud: &GaussianCloud, camera: &str, words: &[&str]| {
        let (code, _, err, _) = diagnose(name, messages, cloud, camera);
        assert!(code == 1 && words.iter().all(|w| err.contains(w)), "{name}: {code} {err}");
    };
    fails("see_no_images", &plain, &dots(), &camera, &["images", "CompressedImage", "none"]);
    let with_images = |rgba: &[[u8; 4]]| {
        let mut messages = walk(2.0);
        messages.extend((0..8).map(|k| image_message(0.2 * k as f64 + 0.1, 0.2 * k as f64 + 0.1, rgba)));
        messages.sort_by_key(|m| m.time);
        messages
    };
    let grey = vec![[90, 90, 90, 255]; 160 * 120];
    let wrong_size = camera.replace("width = 160", "width = 320");
    fails("see_wrong_size", &with_images(&grey), &dots(), &wrong_size, &["320 x 120", "160 x 120"]);
    fails("see_no_mounting", &with_images(&grey), &dots(), "width = 160\n", &["camera.toml", "base_from_camera"]);
    fails("see_no_focal", &with_images(&grey), &dots(), &camera.replace("fx = 96", ""), &["fx", "CameraInfo"]);
    let mut behind = dots();
    behind.means.iter_mut().for_each(|m| m[0] -= 50.0);
    fails("see_nothing", &with_images(&grey), &behind, &camera, &["scene", "0 % of the pixels"]);
    let no_pose: Vec<Message> = with_images(&grey).into_iter().filter(|m| m.topic != "/Odometry").collect();
    fails("see_no_pose", &no_pose, &dots(), &camera, &["base pose"]);
    let (code, _, err) = qv(&["diagnose", "run.mcap", "--scene", "scene.ply", "--out", "out"]);
    assert!(code == 2 && err.contains("--camera"), "{err}");
}

/// A recording of the simulated Go2 with images of the yard that are `late` by so many seconds, a tenth of a second apart.
fn trot(late: f64) -> (Vec<Message>, GaussianCloud) {
    let robot = Robot { parameters: synthetic::small_differences(5), seed: 5, start: [0.0; 3] };
    let recorded = synthetic::record(&Terrain::plane(), &robot).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    synthetic::write_bag(&recorded, &mut bytes).unwrap();
    let file = BagFile { name: "trot".into(), source: bytes.get_ref().as_slice() };
    let run = read_bag([file], &qv_go2::wire::mapping(None)).unwrap();
    let poses: &JointSeries = run.measured.base_pose.as_ref().unwrap();
    let way = Way::new(Some(poses)).unwrap();
    // The robot starts in a corner of the yard and looks across it.
    let yard_from_run = Pose { position: DVec3::new(-1.0, -1.4, 0.0), rotation: DQuat::from_rotation_z(0.8) };
    let mut yard = Yard::new(48, 96, 72, 5).unwrap();
    let others: Vec<_> = (0..yard.cameras.len()).map(|view| yard.photo(view)).collect();
    let mut cameras = yard.cameras.clone();
    cameras.iter_mut().for_each(|c| c.camera_from_world = c.camera_from_world * yard_from_run);
    let cloud = crate::footage::on_surfaces(&cameras, &others, 0.03);
    let times: Vec<f64> = (0..32).map(|k| 2.2 + 0.45 * k as f64).collect();
    yard.cameras = times.iter().map(|t| rig().camera((yard_from_run * way.at(*t) * mounting()).inverse())).collect();
    let mut messages: Vec<Message> =
        recorded.into_iter().map(|m| Message { topic: m.topic, time: m.time, data: m.data }).collect();
    for (k, t) in times.iter().enumerate() {
        messages.push(image_message(t + late, t + late, &crate::footage::unexposed(&yard.photo(k))));
    }
    messages.sort_by_key(|m| m.time);
    (messages, cloud)
}

/// Slow without optimisation: `cargo test --release -p quadverse --test visual -- --ignored`.
#[test]
#[ignore = "three whole diagnoses, minutes even with --release"]
fn a_late_camera_is_accused_and_nothing_else_and_the_corrected_one_is_not() {
    let (messages, cloud) = trot(0.07);
    let (code, out, err, folder) = diagnose("see_late", &messages, &cloud, &camera_toml(&rig()));
    assert_eq!(code, 0, "{err}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["verdict"], "explained", "{}", report["sentence"]);
    let causes = report["causes"].as_array().unwrap();
    assert_eq!((causes.len(), &causes[0]["effect"]), (1, &"camera_delay".into()), "{causes:#?}");
    let delay = causes[0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((delay - 0.07).abs() < 0.01, "{delay}");
    let interfaces = report["where"]["interfaces"].as_array().unwrap();
    let visual = interfaces.iter().find(|i| i["name"] == "visual").unwrap();
    assert!(visual["share"].as_f64().unwrap() > 0.9, "{interfaces:?}");
    assert_eq!(report["visual"]["causes"][0]["effect"], "camera_delay");
    let total: f64 = report["ranking"].as_array().unwrap().iter().map(|r| r["score"].as_f64().unwrap()).sum();
    assert!(total < 1.001 && report["ranking"][0]["effect"] == "camera_delay", "{}", report["ranking"]);
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(page.states("What") && page.matches("data:image/png;base64,").count() == 15);
    // The corrections of the simulator are as readable as ever, and the corrected camera is accused of nothing.
    let parameters = std::fs::read_to_string(folder.join("calibrated.toml")).unwrap();
    assert!(qv_rollout::parameters_from_toml(&parameters).unwrap().is_empty());
    let corrected = std::fs::read_to_string(folder.join("calibrated_camera.toml")).unwrap();
    let (code, out, err, _) = diagnose("see_corrected", &messages, &cloud, &corrected);
    assert_eq!(code, 0, "{err}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["verdict"], "no_gap", "{}", report["sentence"]);
    // Without a scene the report says nothing of a camera.
    let run = folder.parent().unwrap().join("run.mcap");
    let plain: &Path = &folder.with_file_name("plain");
    let (_, out, _) = qv(&["diagnose", run.to_str().unwrap(), "--json", "--out", plain.to_str().unwrap()]);
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!(report.get("visual").is_none() && !plain.join("calibrated_camera.toml").exists());
}

/// A folder with `run.csv`, `images.csv` and image files has images, too; that they are read is seen by what is said of a bad one.
#[test]
fn images_of_a_table_are_listed_in_a_file() {
    let folder = directory("see_table");
    let rows: String =
        (0..200).map(|k| format!("{},0.1,0.1,{},0,0.3,1,0,0,0\n", 0.01 * k as f64, 0.001 * k as f64)).collect();
    let put = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    put(
        "run.csv",
        &format!(
            "time,cmd_pos.FL_hip_joint,pos.FL_hip_joint,base.x,base.y,base.z,base.qw,base.qx,base.qy,base.qz\n{rows}"
        ),
    );
    put("run.toml", "robot = \"go2\"\nbase = \"free\"\n[actuator]\nkind = \"pd\"\n");
    put("camera.toml", &camera_toml(&rig()));
    std::fs::write(folder.join("scene.ply"), write_splats(&dots(), Format::Ply).unwrap()).unwrap();
    let path = |name: &str| folder.join(name).to_str().unwrap().to_string();
    let fails = |words: &[&str]| {
        let (code, _, err) = qv(&[
            "diagnose",
            folder.to_str().unwrap(),
            "--scene",
            &path("scene.ply"),
            "--camera",
            &path("camera.toml"),
            "--out",
            &path("out"),
        ]);
        assert!(code == 1 && words.iter().all(|w| err.contains(w)), "{code} {err}");
    };
    fails(&["images.csv", "images of the run"]);
    put("images.csv", "time,name\n0.1,a.png\n");
    fails(&["images.csv", "a column `file`"]);
    put("images.csv", "time,file\n0.1,a.png\nsoon,b.png\n");
    fails(&["images.csv", "line 3"]);
    put("images.csv", "time,file\n0.1,a.png\n");
    fails(&["a.png", "an image"]);
    put("a.png", "no image");
    fails(&["image at 0.100 s", "JPEG or PNG"]);
    image::save_buffer(folder.join("a.png"), &[9; 3 * 160 * 120], 160, 120, ExtendedColorType::Rgb8).unwrap();
    fails(&["at least 6 images", "1 of 1"]);
}

/// The footage's other parts are used by the tests of qv-gap.
#[test]
fn a_recording_of_the_fixture_has_what_a_truth_has() {
    let truth = Truth {
        intrinsics: rig().intrinsics,
        base_from_camera: mounting(),
        path: Box::new(crate::footage::walk),
        span: [0.0, 1.0],
        images: vec![(0.5, vec![[7, 7, 7, 255]; 160 * 120])],
        cloud: dots(),
    };
    let made = recording(&truth, HiddenError::Delay(0.05), 1);
    assert_eq!((made.photographs[0].time, made.poses.len()), (0.55, 51));
}
