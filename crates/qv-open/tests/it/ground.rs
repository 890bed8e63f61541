//! Ground from files: heights, labels and frictions that were written, and poses above and beside it.

use crate::files::folder;
use glam::DVec3;
use qv_core::{JointSeries, Material, TriangleMesh};
use qv_mesh::files::glb;
use qv_open::ground::{check_ground, mesh_at, set_friction, terrain_at, terrain_of};
use qv_recording::RecordingError;
use std::fs;

/// A ramp over the square from the origin to (4, 4) m that rises by a quarter along x, of one label.
fn ramp() -> TriangleMesh {
    let corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)];
    TriangleMesh {
        vertices: corners.map(|(x, y)| DVec3::new(x, y, 0.25 * x)).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        labels: vec![0, 0],
        materials: vec![Material { name: "gravel".into(), friction: Some(0.5) }],
    }
}

#[test]
fn a_mesh_has_the_heights_that_were_written() {
    let file = folder("ramp").join("ramp.glb");
    fs::write(&file, glb::write(&ramp())).unwrap();
    let terrain = terrain_of(file.to_str().unwrap()).unwrap();
    for (x, y) in [(0.5, 0.5), (2.0, 3.0), (3.9, 0.1)] {
        let height = terrain.height_below(x, y, 10.0).unwrap();
        assert!((height - 0.25 * x).abs() < 1e-6, "{x} {y}: {height}");
    }
    assert_eq!(terrain.height_below(5.0, 1.0, 10.0), None, "beside it");
    assert_eq!(terrain_of("plane").unwrap().height_below(7.0, -3.0, 1.0), Some(0.0));
    let missing = terrain_of("nowhere.glb");
    assert!(matches!(missing, Err(RecordingError::File { file, .. }) if file == "nowhere.glb"));
    fs::write(&file, "no mesh").unwrap();
    assert!(
        matches!(mesh_at(&file, "a mesh"), Err(RecordingError::File { file: named, .. }) if named.ends_with("ramp.glb"))
    );
    let empty = TriangleMesh { triangles: vec![], labels: vec![], ..ramp() };
    assert!(terrain_at(&file, &empty).is_err());
}

#[test]
fn a_friction_replaces_that_of_its_label_alone() {
    let mut mesh = ramp();
    mesh.materials.push(Material { name: "ice".into(), friction: None });
    let given = [("ice".to_string(), 0.1)];
    set_friction(&mut mesh, &given, "ramp.glb".as_ref()).unwrap();
    assert_eq!(mesh.materials.iter().map(|m| m.friction).collect::<Vec<_>>(), [Some(0.5), Some(0.1)]);
    let unknown = set_friction(&mut mesh, &[("lava".to_string(), 0.1)], "ramp.glb".as_ref());
    assert!(matches!(unknown, Err(RecordingError::File { expected, .. }) if expected.contains("lava")));
}

#[test]
fn a_robot_that_walks_beside_its_ground_is_refused() {
    let terrain = terrain_at("ramp.glb".as_ref(), &ramp()).unwrap();
    let mut run = qv_recording::read_table(
        crate::files::pendulum_table(20, |_| 0.0).as_bytes(),
        crate::files::DESCRIPTION,
        Some(crate::files::PENDULUM),
        None,
    )
    .unwrap();
    assert!(check_ground(&run, &terrain).is_ok(), "no poses, no complaint");
    let mut poses = |x0: f64| {
        let time: Vec<f64> = (0..100).map(|k| 0.1 * f64::from(k)).collect();
        let values = time.iter().flat_map(|t| [x0 + 0.3 * t, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]).collect();
        run.measured.base_pose = Some(JointSeries { time, values, joints: 7 });
        check_ground(&run, &terrain)
    };
    assert!(poses(0.5).is_ok());
    assert!(poses(1.9).is_ok(), "a part of the way beside it");
    assert!(matches!(poses(20.0), Err(RecordingError::Run(error)) if error.what == "terrain"));
}
