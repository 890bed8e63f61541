//! Files of `--params`: values, patterns, and what a robot does not have.

use crate::files::{PENDULUM, folder};
use glam::DVec3;
use qv_core::{Material, TriangleMesh};
use qv_open::{Calibration, beyond_range, calibration_of, robot_model};
use qv_recording::RecordingError;
use qv_sim::{BaseKind, Terrain};
use std::fs;

#[test]
fn parameters_of_a_robot_are_read_by_name_and_by_pattern() {
    let file = folder("parameters").join("calibrated.toml");
    let model = robot_model("go2", BaseKind::Floating).unwrap();
    let read = |text: &str| {
        fs::write(&file, text).unwrap();
        calibration_of(Some(&file), &model, &Terrain::plane()).map(|found| found.parameters)
    };
    assert_eq!(calibration_of(None, &model, &Terrain::plane()).unwrap(), Calibration::default());
    let found = read("[parameters]\n\"joint.FL_hip_joint.viscous_friction\" = 0.25\n").unwrap();
    assert_eq!(found, [("joint.FL_hip_joint.viscous_friction".to_string(), 0.25)]);
    let found = read("\"joint.*.viscous_friction\" = 0.5\n").unwrap();
    assert!(found.len() == 12 && found.iter().all(|(name, x)| name.starts_with("joint.") && *x == 0.5), "{found:?}");
    let is_named =
        |text: &str| matches!(read(text), Err(RecordingError::File { file, .. }) if file.ends_with("calibrated.toml"));
    assert!(is_named("\"joint.knee.viscous_friction\" = 0.5\n"), "a joint of another robot");
    assert!(is_named("\"joint.FL_hip_joint.viscous_friction\" = -0.5\n"), "a friction below zero");
    assert!(is_named("\"joint.FL_hip_joint.viscous_friction\" = nan\n"));
    assert!(is_named("\"joint.FL_hip_joint.viscous_friction\" = \"much\"\n"));
    assert!(is_named("no toml"));
    fs::remove_file(&file).unwrap();
    let gone = calibration_of(Some(&file), &model, &Terrain::plane());
    assert!(matches!(gone, Err(RecordingError::File { .. })), "no such file");
}

/// A square of ice.
fn ice() -> Terrain {
    let mut mesh = TriangleMesh { triangles: vec![[0, 1, 2], [0, 2, 3]], labels: vec![0; 2], ..Default::default() };
    mesh.vertices = [(-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0)].map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
    mesh.materials.push(Material { name: "ice".into(), friction: Some(0.1) });
    Terrain::from_mesh(&mesh).unwrap()
}

#[test]
fn what_one_command_found_is_read_by_another_on_other_ground() {
    let file = folder("parameters_across").join("calibrated.toml");
    let model = robot_model("go2", BaseKind::Floating).unwrap();
    let read = |text: &str, terrain: &Terrain| {
        fs::write(&file, text).unwrap();
        calibration_of(Some(&file), &model, terrain)
    };
    // Of a tuning, whose robot has feet of their own; of a calibration of contact; of a diagnosis on a plane.
    let tuned = "[parameters]\n\"geom.FL_foot.friction_scale\" = 0.7\n\"geom.RR_foot.radius_offset\" = 0.001\n";
    let of_contact = "[parameters]\n\"material.ice.friction\" = 0.2\n\"actuator.*.lag\" = 0.004\n";
    let of_plane = "[parameters]\n\"contact.friction\" = 0.4\n\"terrain.slope_x\" = 0.02\n";
    for terrain in [Terrain::plane(), ice()] {
        let is_labelled = !terrain.materials().is_empty();
        let found = read(tuned, &terrain).unwrap();
        assert_eq!(found.parameters.len(), 2);
        assert!(found.parameters.iter().all(|p| p.0.starts_with("geom.FL") || p.0.starts_with("geom.RR")), "{found:?}");
        let known = qv_sim::Batch::<f32>::new(&model, &terrain, &Default::default(), 1).unwrap();
        assert!(found.parameters.iter().all(|p| known.parameter_index(&p.0).is_ok()), "{found:?}");
        let found = read(of_contact, &terrain).unwrap();
        assert_eq!(found.parameters.len(), if is_labelled { 13 } else { 12 });
        assert_eq!(found.notes.iter().any(|note| note.contains("material.ice.friction")), !is_labelled, "{found:?}");
        let found = read(of_plane, &terrain).unwrap();
        assert_eq!(found.parameters.len(), 2);
        assert_eq!(found.notes.iter().any(|note| note.contains("contact.friction")), is_labelled, "{found:?}");
    }
    assert!(read("\"material.sand.friction\" = 0.5\n", &ice()).is_err(), "nothing of it fits");
    assert!(
        read("\"actuator.FL_hip_joint.stength\" = 0.9\n\"contact.friction\" = 0.4\n", &ice()).is_err(),
        "no such field"
    );
}

#[test]
fn values_beyond_what_is_searched_are_listed_and_used() {
    let model = robot_model(PENDULUM, BaseKind::Fixed).unwrap();
    let parameter = |value: f64| vec![("joint.hinge.viscous_friction".to_string(), value)];
    assert!(beyond_range(&parameter(0.2), &model, &Terrain::none()).is_empty());
    let listed = beyond_range(&parameter(900.0), &model, &Terrain::none());
    assert!(listed.len() == 1 && listed[0].contains("joint.hinge.viscous_friction") && listed[0].contains("900"));
}
