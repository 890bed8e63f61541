//! MJCF files as models: against MuJoCo (`fixtures/mjcf`), what is told, what is refused.

mod against_mujoco;

use against_mujoco::compare;
use qv_sim::mjcf::{MjcfModel, is_mjcf};
use qv_sim::{BaseKind, Model, ModelOptions, SimError};
use serde_json::Value;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/mjcf");

fn file(name: &str) -> Result<String, String> {
    std::fs::read_to_string(format!("{FOLDER}/{name}")).map_err(|e| format!("{name}: {e}"))
}

fn fixture(name: &str, base: BaseKind) -> MjcfModel {
    let options = ModelOptions { base, ..Default::default() };
    MjcfModel::read(&file(&format!("{name}.xml")).unwrap(), &options, &file).unwrap()
}

fn golden(name: &str) -> Value {
    serde_json::from_str(&file(&format!("golden/{name}.json")).unwrap()).unwrap()
}

fn check(name: &str, base: BaseKind) {
    let (read, golden) = (fixture(name, base), golden(name));
    let found = compare(&read, &golden);
    println!("{name}: {found:?}");
    let tolerance = golden["tolerance"]["relative"].as_f64().unwrap();
    let all = [found.mass, found.pose, found.kinetic_energy, found.center_of_mass, found.angular_momentum, found.joints];
    assert!(all.iter().all(|x| *x < tolerance), "{name}: {found:?}");
    assert!(found.motion < golden["tolerance"]["motion_rms"].as_f64().unwrap(), "{name}: {found:?}");
    assert!(found.frames > 30, "{name}: {found:?}");
}

#[test]
fn a_biped_of_classes_and_frames_is_mujocos() {
    check("biped", BaseKind::Floating);
}

#[test]
fn an_arm_that_weighs_what_its_geoms_do_is_mujocos() {
    check("arm", BaseKind::Fixed);
}
