//! The robots that are data: figures of the URDFs and of the tables beside them.

use qv_sim::{Model, ModelOptions, Shape};
use std::path::Path;

/// Name, published mass \[kg\], and how many shapes it has.
const ROBOTS: [(&str, f64); 4] = [
    // Trunk, and four times hip, thigh, calf with foot.
    ("go1", 5.204 + 4.0 * (0.68 + 1.009 + 0.195862)),
    ("a1", 4.713 + 4.0 * (0.696 + 1.013 + 0.166 + 0.06) + 0.001),
    ("a2", 19.651 + 4.0 * (1.62 + 0.407) + 2.0 * (3.079 + 3.077)),
    ("anymal_c", 52.13485),
];

fn robot(name: &str) -> (Model, toml::Table) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots");
    let read = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
    let table: toml::Table = toml::from_str(&read(&format!("{name}.toml"))).unwrap();
    let options = ModelOptions { armature: table["armature"].as_float().unwrap(), ..Default::default() };
    (Model::from_urdf(&read(table["urdf"].as_str().unwrap()), &options).unwrap(), table)
}

fn strings(value: &toml::Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(|item| item.as_str().unwrap()).collect()
}

/// Base at the origin, joints at the stand.
fn stand(model: &Model, table: &toml::Table) -> Vec<f64> {
    let angles = table["stand"].as_table().unwrap();
    let angle = |joint: &String| {
        let keys = angles.iter().filter(|(key, _)| joint.ends_with(key.as_str()));
        keys.max_by_key(|(key, _)| key.len()).unwrap().1.as_float().unwrap()
    };
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0].into_iter().chain(model.joint_names().iter().map(angle)).collect()
}

#[test]
fn masses_are_the_published_ones() {
    for (name, mass) in ROBOTS {
        let found = robot(name).0.mass();
        assert!((found - mass).abs() < 1e-6 * mass, "{name}: {found} kg, expected {mass}");
    }
}

#[test]
fn joints_are_legs_times_joints_in_order() {
    for (name, _) in ROBOTS {
        let (model, table) = robot(name);
        let kinds = strings(&table["joints"]);
        let legs = strings(&table["legs"]);
        let expected: Vec<String> =
            legs.iter().flat_map(|leg| kinds.iter().map(move |kind| format!("{leg}_{kind}"))).collect();
        assert_eq!(model.joint_names(), expected, "{name}");
        assert_eq!(expected.len(), 12);
        assert!(model.left_out.is_empty(), "{name}: {:?}", model.left_out);
        for joint in &model.joints {
            assert!(joint.effort.is_finite() && joint.effort > 10.0, "{name} {}", joint.name);
        }
    }
}

#[test]
fn the_stand_is_level_within_limits_and_on_its_feet() {
    for (name, _) in ROBOTS {
        let (model, table) = robot(name);
        let q = stand(&model, &table);
        for (joint, angle) in model.joints.iter().zip(&q[7..]) {
            assert!(joint.lower < *angle && *angle < joint.upper, "{name} {}: {angle}", joint.name);
        }
        let poses = model.world_from_links(&q);
        let feet = strings(&table["feet"]);
        assert_eq!(feet.len(), 4);
        let heights: Vec<f64> = feet
            .iter()
            .map(|foot| {
                let frame = model.frame(foot).unwrap();
                let shape = model.geoms.iter().find(|geom| geom.name == *foot).unwrap();
                assert!(
                    matches!(shape.shape, Shape::Sphere(radius) if (0.01..0.05).contains(&radius)),
                    "{name} {foot}"
                );
                assert!((shape.link_from_geom.position - frame.link_from_frame.position).length() < 1e-12);
                (poses[frame.link.unwrap()] * frame.link_from_frame).position.z
            })
            .collect();
        let spread = |f: fn(f64, f64) -> f64| heights.iter().copied().reduce(f).unwrap();
        assert!(spread(f64::max) - spread(f64::min) < 0.02, "{name}: {heights:?}");
        assert!(heights[0] < -0.2 && heights[0] > -0.6, "{name}: {heights:?}");
        // No other shape's origin lies as low as the feet.
        for geom in model.geoms.iter().filter(|geom| !feet.contains(&geom.name.as_str())) {
            let height = (poses[geom.link] * geom.link_from_geom).position.z;
            assert!(height > heights[0] + 0.05, "{name} {}: {height}", geom.name);
        }
    }
}

#[test]
fn legs_mirror_each_other() {
    for (name, _) in ROBOTS {
        let (model, table) = robot(name);
        let poses = model.world_from_links(&stand(&model, &table));
        let foot: Vec<_> = strings(&table["feet"])
            .into_iter()
            .map(|foot| {
                let frame = model.frame(foot).unwrap();
                (poses[frame.link.unwrap()] * frame.link_from_frame).position
            })
            .collect();
        for pair in [[0, 1], [2, 3]] {
            let mirrored = foot[pair[1]] * glam::DVec3::new(1.0, -1.0, 1.0);
            assert!((foot[pair[0]] - mirrored).length() < 2e-3, "{name}: {} {}", foot[pair[0]], foot[pair[1]]);
            assert!(foot[pair[0]].y > 0.05, "{name}");
        }
        assert!(foot[0].x > 0.1 && foot[2].x < -0.1, "{name}");
    }
}
