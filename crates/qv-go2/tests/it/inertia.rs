//! Mass properties of the Go2, as qv-sim reads them from our URDF, against MuJoCo's from its own description of the same
//! figures (`fixtures/mujoco/golden`).

use qv_go2::model;
use qv_sim::{BaseKind, Model, ModelOptions};
use serde_json::Value;

fn golden(name: &str) -> Value {
    let path = format!("{}/../../fixtures/mujoco/golden/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn go2() -> Model {
    let options = ModelOptions { base: BaseKind::Floating, armature: model::ARMATURE, ..Default::default() };
    Model::from_urdf(&model::urdf(), &options).unwrap()
}

#[test]
fn masses() {
    let (golden, robot) = (golden("invweights"), go2());
    let names = golden["body_names"].as_array().unwrap();
    let masses = numbers(&golden["body_mass"]);
    assert_eq!(names.len(), robot.links.len() + 1, "MuJoCo counts the world");
    for (name, mass) in names.iter().zip(masses).skip(1) {
        let link = robot.links.iter().find(|link| *name == link.name).unwrap_or_else(|| panic!("no link {name}"));
        assert!((link.mass - mass).abs() < 1e-12, "{name}: {} {mass}", link.mass);
    }
    assert!((robot.mass() - golden["total_mass"].as_f64().unwrap()).abs() < 1e-12);
}

#[test]
fn kinetic_energy_is_that_of_the_mass_matrix() {
    let (golden, robot) = (golden("single_step"), go2());
    for state in golden["states"].as_array().unwrap() {
        let (q, v, matrix) = (numbers(&state["q"]), numbers(&state["v"]), numbers(&state["mass_matrix"]));
        let row = |i: usize| (0..18).map(|j| matrix[18 * i + j] * v[j]).sum::<f64>();
        let expected = 0.5 * (0..18).map(|i| v[i] * row(i)).sum::<f64>();
        let found = robot.mechanics(&q, &v).kinetic_energy;
        assert!((found / expected - 1.0).abs() < 1e-7, "{found} {expected}");
    }
}
