//! Our files, read by trimesh and by MuJoCo (`fixtures/mesh/read_mesh.py`), and by Blender (`fixtures/blender/open_mesh.py`).

use glam::DVec3;
use qv_core::{Camera, Pose, TriangleMesh};
use qv_mesh::files::{glb, ply, stl};
use qv_mesh::labels::LabelledPoints;
use qv_mesh::{DepthFrame, FuseOptions, MeshOptions, Topology, reconstruct};

use crate::skipped::skipped;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The Python of an environment with the packages, when the test runner made one.
fn python() -> Option<PathBuf> {
    let candidate = std::env::var_os("QV_PYTHON_MESH").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let works = Command::new(&candidate).args(["-c", "import numpy, mujoco"]).output();
    let found = works.ok().filter(|output| output.status.success()).map(|_| candidate);
    if found.is_none() {
        skipped("no Python with numpy and mujoco (cargo xtask test makes one)");
    }
    found
}

/// Two walls and a floor, seen by two cameras; the left half is grass.
fn solid() -> TriangleMesh {
    let planes = [(DVec3::Z, 0.0), (DVec3::NEG_X, -1.0), (DVec3::NEG_Y, -1.2)];
    let mut points = LabelledPoints::new(2);
    let frame = |x: f64| {
        let pose = Pose::from_xyz_rpy([x, -0.8, 1.0], [-2.2, 0.0, -0.5]);
        let camera = Camera {
            fx: 80.0,
            fy: 80.0,
            cx: 60.0,
            cy: 45.0,
            width: 120,
            height: 90,
            camera_from_world: pose.inverse(),
        };
        let depth = (0..camera.pixels()).map(|i| {
            let ray = DVec3::new(((i % 120) as f64 + 0.5 - 60.0) / 80.0, ((i / 120) as f64 + 0.5 - 45.0) / 80.0, 1.0);
            let along = pose.transform_vector(ray);
            let hits = planes.iter().map(|(n, d)| (d - n.dot(pose.position)) / n.dot(along)).filter(|t| *t > 0.0);
            hits.fold(f64::INFINITY, f64::min) as f32
        });
        DepthFrame { camera, depth: depth.collect(), weight: vec![] }
    };
    let frames = [frame(-0.3), frame(0.1)];
    for i in 0..4000 {
        let p = DVec3::new(f64::from(i % 80) * 0.05 - 2.5, f64::from(i / 80) * 0.08 - 1.5, 0.0);
        points.points.push(p);
        points.scores.extend(if p.x < 0.0 { [1.0, 0.0] } else { [0.0, 1.0] });
    }
    let materials = [("grass", Some(0.6)), ("stone", None)];
    let materials = materials.map(|(name, friction)| qv_core::Material { name: name.into(), friction });
    let fusing = FuseOptions { voxel: 0.04, ..Default::default() };
    let options = MeshOptions { triangles: Some(3000), ..Default::default() };
    let (mesh, report) = reconstruct(&frames, Some((&points, &materials)), &fusing, &options).unwrap();
    assert!(report.topology.is_watertight(), "{report:?}");
    mesh
}

fn bounds(found: &Value) -> Vec<f64> {
    let corners = found["bounds"].as_array().unwrap();
    corners.iter().flat_map(|c| c.as_array().unwrap()).map(|x| x.as_f64().unwrap()).collect()
}

/// What a script of `fixtures` finds in the files of a mesh.
fn read_by(python: &Path, script: &str, mesh: &TriangleMesh, name: &str) -> Value {
    let stem = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    for (ending, bytes) in [("glb", glb::write(mesh)), ("ply", ply::write(mesh)), ("stl", stl::write(mesh))] {
        fs::write(stem.with_extension(ending), bytes).unwrap();
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(script);
    let output = Command::new(python).arg(script).arg(&stem).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Blender reports its imports on standard output, too.
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(text.lines().last().unwrap_or_default()).unwrap()
}

/// Least and greatest corner, one after the other.
fn corners(mesh: &TriangleMesh) -> Vec<f64> {
    let low = mesh.vertices.iter().fold(DVec3::INFINITY, |a, b| a.min(*b));
    let high = mesh.vertices.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b));
    [low, high].iter().flat_map(|v| v.to_array()).collect()
}

/// Blender as a Python package (`bpy`, half a gigabyte) is made by nobody's test runner: give its Python as QV_PYTHON_BLENDER.
#[test]
fn blender_opens_what_we_write() {
    let Some(python) = std::env::var_os("QV_PYTHON_BLENDER").map(PathBuf::from) else {
        skipped("no Python with bpy in QV_PYTHON_BLENDER");
        return;
    };
    let mesh = solid();
    let found = read_by(&python, "blender/open_mesh.py", &mesh, "solid_blender");
    for kind in ["glb", "ply", "stl"] {
        let part = &found[kind];
        assert_eq!(part["faces"], mesh.triangles.len(), "{kind}");
        let [x0, y0, z0, x1, y1, z1] = corners(&mesh)[..] else { panic!("two corners") };
        // Our GLB has z up, as all of this project; Blender takes y for up in any GLB, and turns it.
        let expected = if kind == "glb" { [x0, -z1, y0, x1, -z0, y1] } else { [x0, y0, z0, x1, y1, z1] };
        for (a, b) in bounds(part).iter().zip(&expected) {
            assert!((a - b).abs() < 1e-4, "{kind}: {a}, expected {b}");
        }
    }
    let materials = &found["glb"]["materials"];
    assert!((materials["grass"]["friction"].as_f64().unwrap() - 0.6).abs() < 1e-6, "{materials}");
    assert!(materials["stone"]["faces"].as_u64().unwrap() > 100 && materials["stone"]["friction"].is_null());
}

#[test]
fn python_reads_what_we_write() {
    let Some(python) = python() else { return };
    let mesh = solid();
    let found = read_by(&python, "mesh/read_mesh.py", &mesh, "solid");
    let expected = corners(&mesh);
    let topology = Topology::of(&mesh);
    for kind in ["glb", "ply", "stl", "mujoco"] {
        let part = &found[kind];
        if part.is_null() {
            println!("no trimesh, so that {kind} is read by nobody: MuJoCo reads the others");
            continue;
        }
        assert_eq!(part["faces"], mesh.triangles.len(), "{kind}");
        for (a, b) in bounds(part).iter().zip(&expected) {
            assert!((a - b).abs() < 1e-4, "{kind}: {a}, expected {b}");
        }
        if kind == "ply" || kind == "stl" {
            assert_eq!((&part["watertight"], &part["winding"]), (&Value::Bool(true), &Value::Bool(true)), "{kind}");
            let volume = part["volume"].as_f64().unwrap();
            assert!((volume / topology.volume - 1.0).abs() < 1e-3, "{kind}: {volume}, expected {}", topology.volume);
        }
    }
    assert!(found["mujoco"]["faces"].as_u64().unwrap() > 100);
    if let Some(materials) = found["glb"]["materials"].as_object() {
        assert!(
            materials["grass"].as_f64().unwrap() > 0.5 && materials["stone"].as_f64().unwrap() > 0.5,
            "{materials:?}"
        );
    }
}
