//! Files of `--params`: values, patterns, and what a robot does not have.

use crate::files::{PENDULUM, folder};
use qv_open::{beyond_range, parameters, parameters_of, robot_model};
use qv_recording::RecordingError;
use qv_sim::{BaseKind, Terrain};
use std::fs;

#[test]
fn parameters_of_a_robot_are_read_by_name_and_by_pattern() {
    let file = folder("parameters").join("calibrated.toml");
    let model = robot_model("go2", BaseKind::Floating).unwrap();
    let read = |text: &str| {
        fs::write(&file, text).unwrap();
        parameters_of(Some(&file), &model, &Terrain::plane())
    };
    assert_eq!(parameters(None).unwrap(), []);
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
    assert!(matches!(parameters(Some(&file)), Err(RecordingError::File { .. })), "no such file");
}

#[test]
fn values_beyond_what_is_searched_are_listed_and_used() {
    let model = robot_model(PENDULUM, BaseKind::Fixed).unwrap();
    let parameter = |value: f64| vec![("joint.hinge.viscous_friction".to_string(), value)];
    assert!(beyond_range(&parameter(0.2), &model, &Terrain::none()).is_empty());
    let listed = beyond_range(&parameter(900.0), &model, &Terrain::none());
    assert!(listed.len() == 1 && listed[0].contains("joint.hinge.viscous_friction") && listed[0].contains("900"));
}
