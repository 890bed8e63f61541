//! `qv check` on a file of each kind.

use crate::bags::*;
use crate::facts::States;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Exit code, the line of JSON, standard error.
fn check(path: &Path) -> (i32, Value, String) {
    let (code, out, err) = qv(&["check", "--json", path.to_str().unwrap()]);
    (code, serde_json::from_str(&out).unwrap_or(Value::Null), err)
}

#[test]
fn each_kind_of_file_is_told() {
    let folder = directory("check_kinds");
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    };
    let of = |path: &Path, kind: &str, used: &str, code: i32| {
        let (found, line, err) = check(path);
        assert_eq!((found, &line["kind"]), (code, &json!(kind)), "{err} {line:#}");
        assert!(line["used"].as_str().unwrap().contains(used), "{used}: {line:#}");
        line["missing"].to_string()
    };
    let missing = of(&bag("check_bag", &write_bag()), "recording", "go2, base free, 12 joints", 0);
    assert_eq!(missing, "[]");
    let csv =
        (0..50).map(|k| format!("{:.3},{:.3}\n", 0.01 * f64::from(k), (0.1 * f64::from(k)).sin())).collect::<String>();
    write("table/run.csv", format!("time,pos.a\n{csv}").as_bytes());
    write("table/run.toml", b"robot = \"r.urdf\"");
    let urdf = "<robot name=\"arm\"><link name=\"a\"/><link name=\"b\"><inertial><mass value=\"2\"/>\
        <inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link><joint name=\"j\" type=\"continuous\">\
        <parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 0 1\"/></joint></robot>";
    let robot = write("table/r.urdf", urdf.as_bytes());
    let missing = of(&folder.join("table"), "recording", "1 joints", 3);
    assert!(missing.states("commands"), "{missing}");
    let missing = of(&robot, "robot", "arm: 1 joints, 1 moving links of 2.00 kg", 0);
    assert!(missing.states("collision"), "{missing}");
    let mjcf = "<mujoco model=\"swing\"><worldbody><body name=\"a\"><joint name=\"j\" armature=\"0.01\"/>\
        <geom size=\"0.1\"/></body></worldbody></mujoco>";
    let swing = write("swing.xml", mjcf.as_bytes());
    let missing = of(&swing, "robot", "swing: 1 joints, 1 moving links of 4.19 kg", 0);
    assert!(!missing.contains("rotor inertia"), "{missing}");
    let cloud = qv_core::GaussianCloud {
        means: vec![[1.0, 2.0, 3.0]],
        log_scales: vec![[-3.0; 3]],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.5],
        sh: vec![[0.2, 0.1, 0.0]],
        ..Default::default()
    };
    for format in qv_splat::files::Format::ALL {
        let scene = write("scene", &qv_splat::files::write(&cloud, format).unwrap());
        assert!(of(&scene, "scene", "1 Gaussians", 0).states("cameras"));
    }
    let mesh = qv_core::TriangleMesh {
        vertices: vec![glam::DVec3::ZERO, glam::DVec3::X, glam::DVec3::Y],
        triangles: vec![[0, 1, 2]],
        ..Default::default()
    };
    let ground = write("ground.glb", &qv_mesh::files::glb::write(&mesh));
    assert!(of(&ground, "terrain", "1 triangles", 0).states("materials"));
    let transforms = json!({"w": 4, "h": 4, "fl_x": 4.0, "frames": [{"file_path": "a.png",
        "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]});
    write("capture/transforms.json", transforms.to_string().as_bytes());
    let missing = of(&folder.join("capture"), "capture", "1 cameras, 0 images", 0);
    assert!(missing.states("reconstruct 1"), "{missing}");
    let (code, line, err) = check(&write("notes.txt", b"buy milk"));
    assert!((code, line) == (1, Value::Null) && err.states("recording"), "{err}");
    let (code, _, err) = check(&write("bad.onnx", b"hello"));
    assert!(code == 1 && err.contains("bad.onnx"), "{err}");
    let (code, out, _) = qv(&["check", robot.to_str().unwrap(), ground.to_str().unwrap()]);
    assert!(code == 0 && out.contains("r.urdf: robot\n  used     arm") && out.states("ground.glb"), "{out}");
}

fn write_bag() -> Vec<u8> {
    write(&walk(1.0), small_chunks(None), &[])
}
