//! What other programs write into scenes and captures: values of another kind, their own split, coordinates of a map, depth keys.

use glam::DVec3;
use qv_core::GaussianCloud;
use qv_splat::captures::{Capture, nerfstudio};
use qv_splat::files::ply;
use serde_json::{Value, json};

/// Forty Gaussians with scales and opacities of a kind.
fn cloud(scale: f32, opacity: impl Fn(usize) -> f32) -> GaussianCloud {
    let count = 40;
    GaussianCloud {
        means: (0..count).map(|k| [k as f32, 0.0, 0.0]).collect(),
        log_scales: vec![[scale; 3]; count],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        opacity_logits: (0..count).map(opacity).collect(),
        sh_degree: 0,
        sh: vec![[0.2; 3]; count],
        feature_count: 0,
        features: vec![],
    }
}

#[test]
fn values_that_are_no_logarithms_and_logits_are_remarked() {
    let remarks = |cloud: &GaussianCloud| ply::read(&ply::write(cloud).unwrap()).unwrap().remarks;
    assert!(remarks(&cloud(-3.0, |k| 0.3 * k as f32 - 5.0)).is_empty());
    let both = remarks(&cloud(0.05, |k| k as f32 / 40.0));
    assert!(both.len() == 2 && both[0].contains("scales") && both[1].contains("opacities"), "{both:?}");
    assert_eq!(remarks(&cloud(-3.0, |k| k as f32 / 40.0)).len(), 1);
}

fn document(at: DVec3) -> Value {
    let frame = |k: usize| {
        let place = at + DVec3::new(k as f64, 0.0, 0.0);
        json!({"file_path": format!("./images/{k}.png"), "depth_path": format!("depth/{k}.png"),
            "transform_matrix": [[1, 0, 0, place.x], [0, 1, 0, place.y], [0, 0, 1, place.z], [0, 0, 0, 1]]})
    };
    json!({"w": 64, "h": 48, "fl_x": 50.0, "integer_depth_scale": 1.0 / 6553.5, "frames": (0..6).map(frame).collect::<Vec<_>>()})
}

#[test]
fn a_split_of_the_capture_is_kept() {
    let mut file = document(DVec3::ZERO);
    assert_eq!(nerfstudio::read_value(&file).unwrap().held_out, None);
    file["train_filenames"] = json!(["images/0.png", "./images/1.png", "images/2.png"]);
    file["val_filenames"] = json!(["images/3.png", "images/4.png"]);
    let capture = nerfstudio::read_value(&file).unwrap();
    let held: Vec<String> = capture.held_out.unwrap().into_iter().collect();
    assert_eq!((held, capture.cameras.len()), (vec!["3".to_string(), "4".to_string()], 5));
    assert!(capture.lost.len() == 1 && capture.lost[0].starts_with("1 frames"), "{:?}", capture.lost);
}

#[test]
fn depth_has_the_unit_and_the_keys_of_instant_ngp() {
    let capture = nerfstudio::read_value(&document(DVec3::ZERO)).unwrap();
    let depth = capture.cameras[2].attachments.depth.as_ref().unwrap();
    assert_eq!(depth.path, "depth/2.png");
    assert!((depth.metres_per_unit * 6553.5 - 1.0).abs() < 1e-12);
}

#[test]
fn cameras_of_a_map_are_moved_near_and_others_stay() {
    let places = |capture: &Capture| -> Vec<DVec3> {
        capture.cameras.iter().map(|one| one.camera.camera_from_world.inverse().position).collect()
    };
    let mut near = nerfstudio::read_value(&document(DVec3::new(3.0, -20.0, 100.0))).unwrap();
    let before = near.clone();
    assert_eq!((near.move_near(), &near), (None, &before));
    let far = DVec3::new(512_345.25, 5_412_345.5, 431.0);
    let mut capture = nerfstudio::read_value(&document(far)).unwrap();
    let origin = capture.move_near().unwrap();
    assert!(places(&capture).iter().all(|p| p.length() < 10.0));
    let back = places(&capture)[3] + origin;
    assert!((back - far - DVec3::new(3.0, 0.0, 0.0)).length() < 1e-6, "{back}");
    assert!(capture.remarks.iter().any(|r| r.contains("origin")));
}
