//! `qv contact` on a recording that is made up: a Go2 of the simulator that trots from ice onto concrete, beside grass.

use crate::facts::States;
use qv_core::{Material, TriangleMesh};
use qv_go2::synthetic::{self, Message, Robot};
use qv_mesh::files::glb;
use qv_page::read;
use qv_sim::Terrain;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Strips along x: label, from, to, friction.
const STRIPS: [(&str, f64, f64, f64); 3] =
    [("ice", -3.0, 0.45, 0.22), ("concrete", 0.45, 3.0, 0.8), ("grass", 3.0, 6.0, 0.5)];

fn ground() -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for (label, (name, x0, x1, friction)) in STRIPS.into_iter().enumerate() {
        mesh.materials.push(Material { name: name.into(), friction: Some(friction) });
        let first = mesh.vertices.len() as u32;
        for (x, y) in [(x0, -3.0), (x1, -3.0), (x1, 3.0), (x0, 3.0)] {
            mesh.vertices.push(glam::DVec3::new(x, y, 0.0));
        }
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.labels.extend([label as u16; 2]);
    }
    mesh
}

fn messages() -> &'static [Message] {
    static MADE: OnceLock<Vec<Message>> = OnceLock::new();
    MADE.get_or_init(|| {
        let robot = Robot { parameters: synthetic::small_differences(3), seed: 3, start: [0.0; 3] };
        synthetic::record(&Terrain::from_mesh(&ground()).unwrap(), &robot).unwrap()
    })
}

/// A folder of its own with the recording (of topics that `keep` says) and the labelled ground without frictions.
fn folder(name: &str, keep: impl Fn(&Message) -> bool) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("contact").join(name);
    fs::create_dir_all(&folder).unwrap();
    let mut mesh = ground();
    mesh.materials.iter_mut().for_each(|m| m.friction = None);
    fs::write(folder.join("terrain.glb"), glb::write(&mesh)).unwrap();
    let kept: Vec<Message> = messages().iter().filter(|m| keep(m)).cloned().collect();
    synthetic::write_bag(&kept, fs::File::create(folder.join("run.mcap")).unwrap()).unwrap();
    folder
}

fn contact(folder: &Path, more: &[&str]) -> (i32, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.arg("contact").arg(folder.join("run.mcap")).arg("--terrain").arg(folder.join("terrain.glb"));
    let output = command.arg("--out").arg(folder.join("out")).args(more).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn region<'a>(report: &'a Value, label: &str) -> &'a Value {
    report["regions"].as_array().unwrap().iter().find(|r| r["label"] == label).unwrap()
}

#[test]
fn ice_is_found_and_grass_keeps_its_prior() {
    let folder = folder("found", |_| true);
    let (code, out, err) = contact(&folder, &["--json"]);
    assert_eq!(code, 0, "{err}");
    let report: Value = serde_json::from_str(out.trim()).unwrap();
    assert_eq!(report["format"], "qv-contact/1");
    let ice = region(&report, "ice");
    let friction = ice["friction"].as_f64().unwrap();
    assert!((friction - 0.22).abs() < 0.03, "{friction}");
    assert_eq!(ice["status"], "refined");
    let grid = ice["grid"]["friction"].as_f64().unwrap();
    assert!((0.1..0.4).contains(&grid), "{grid}");
    let grass = region(&report, "grass");
    assert_eq!(grass["status"], "not_touched");
    assert_eq!(grass["friction"], grass["prior"]["mean"]);
    let errors = &report["base_error"]["held_out"];
    assert!(errors["posterior"].as_f64().unwrap() < errors["prior"].as_f64().unwrap(), "{errors}");
    assert!(out.lines().count() == 1 && report["lost"].as_array().unwrap().is_empty());

    let page = fs::read_to_string(folder.join("out/contact.html")).unwrap();
    crate::browser::check("contact", &page);
    let text = read::without_scripts(&page);
    assert!(text.contains("<svg") && text.states("touched") && !text.contains("NaN") && !page.contains("http:"));
    let boards = read::boards(&page);
    assert_eq!(boards.len(), report["regions"].as_array().unwrap().len());
    assert!(boards.iter().any(|b| b.panels[0].lines.iter().any(|l| l.name == "posterior") && b.panels.len() == 2));
    let written = glb::read(&fs::read(folder.join("out/terrain.glb")).unwrap()).unwrap();
    assert!((written.materials[0].friction.unwrap() - friction).abs() < 1e-6);
    let whole: Value = serde_json::from_str(&fs::read_to_string(folder.join("out/contact.json")).unwrap()).unwrap();
    assert!(!whole["path"].as_array().unwrap().is_empty() && !whole["slips"].as_array().unwrap().is_empty());

    // What it writes is taken by the other commands.
    let mut replay = Command::new(env!("CARGO_BIN_EXE_qv"));
    replay.arg("replay").arg(folder.join("run.mcap")).arg("--terrain").arg(folder.join("terrain.glb"));
    replay.arg("--params").arg(folder.join("out/calibrated.toml")).arg("--out").arg(folder.join("replay"));
    let output = replay.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Feet slip on the ice: a prior that is sure of the opposite does not stand.
#[test]
fn a_sure_prior_that_the_recording_contradicts_is_left_out() {
    let folder = folder("sure", |_| true);
    let priors = folder.join("priors.json");
    fs::write(&priors, "{\"ice\": {\"mean\": 0.9, \"sd\": 0.1}}").unwrap();
    let (code, out, err) = contact(&folder, &["--json", "--friction-prior", priors.to_str().unwrap()]);
    assert_eq!(code, 0, "{err}");
    let report: Value = serde_json::from_str(out.trim()).unwrap();
    let ice = region(&report, "ice");
    assert!(ice["slip_share"].as_f64().unwrap() > 0.1 && ice["prior_is_contradicted"] == true, "{ice}");
    assert!((ice["friction"].as_f64().unwrap() - 0.22).abs() < 0.03, "{}", ice["friction"]);
    assert!(report["notes"].as_array().unwrap().iter().any(|note| note.as_str().unwrap().contains("contradicts")));
}

#[test]
fn bad_inputs_are_named() {
    let folder = folder("bad", |_| true);
    let expect = |more: &[&str], code: i32, word: &str| {
        let (found, _, err) = contact(&folder, more);
        assert!(found == code && err.contains(word), "{more:?}: code {found}, {err}");
    };
    expect(&[folder.join("run.mcap").to_str().unwrap()], 1, "recording 1 and 2 alike");
    let priors = folder.join("priors.json");
    let path = priors.to_str().unwrap();
    fs::write(&priors, "{\"ice\": {\"mean\": 0.1}").unwrap();
    expect(&["--friction-prior", path], 1, "priors.json");
    fs::write(&priors, "{\"lava\": {\"mean\": 0.1, \"sd\": 0.1}}").unwrap();
    expect(&["--friction-prior", path], 1, "`lava`");
    expect(&["--materials", path], 1, "a table of materials");
    expect(&["--ask", "http://localhost:1"], 2, "--model");
    expect(&["--segment", "0"], 2, "0.2 to 100");
    let params = folder.join("params.toml");
    fs::write(&params, "\"joint.FL_knee.armature\" = 1.0\n").unwrap();
    expect(&["--params", params.to_str().unwrap()], 1, "FL_knee");
}

#[test]
fn a_ground_without_labels_and_a_run_without_poses_are_named() {
    let folder = folder("unlabelled", |_| true);
    let mut mesh = ground();
    (mesh.labels, mesh.materials) = (Vec::new(), Vec::new());
    fs::write(folder.join("terrain.glb"), glb::write(&mesh)).unwrap();
    let (code, _, err) = contact(&folder, &[]);
    assert!(code == 1 && err.contains("terrain.glb") && err.states("triangles"), "{err}");
    let folder = self::folder("no_poses", |m| m.topic != "/Odometry");
    let (code, _, err) = contact(&folder, &[]);
    assert!(code == 1 && err.contains("poses"), "{err}");
}
