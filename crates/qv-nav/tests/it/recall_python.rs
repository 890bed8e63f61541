//! The robot's memory in Python gives what it gives here: what a network sees of it, and the last word on commands.

use glam::DVec2;
use qv_core::random::Xoshiro256PlusPlus;
use qv_nav::net::{RAYS, SIGHT};
use qv_nav::recall::{Planar, RECALL, Recall};
use qv_nav::reflex::Reflex;
use qv_nav::task::Limits;
use std::path::Path;
use std::process::Command;

/// Rows of odometry, sight and command go in; what the network sees and the command that is followed come out.
const SCRIPT: &str = "
import json, sys
sys.path.insert(0, sys.argv[1])
import navigation
recall, rows = navigation.Recall((3.0, 2.5)), []
for odometry, sight, command in json.load(open(sys.argv[2])):
    recall.go(*odometry)
    rows.append(recall.features().tolist() + navigation.reflex(recall, command))
    recall.see(sight)
json.dump(rows, sys.stdout)
";

#[test]
fn python_recalls_the_same() {
    let python = std::env::var_os("QV_PYTHON_ONNX").unwrap_or_else(|| "python3".into());
    let works = Command::new(&python).args(["-c", "import numpy"]).output();
    if !works.is_ok_and(|output| output.status.success()) {
        crate::skipped::skipped("no Python with numpy (cargo xtask test makes one)");
        return;
    }
    let mut random = Xoshiro256PlusPlus::new(6);
    let (mut recall, mut at) = (Recall::new(DVec2::new(3.0, 2.5)), Planar::default());
    let (mut given, mut expected, mut changed) = (Vec::new(), Vec::new(), 0);
    for step in 0..60 {
        at = Planar {
            place: at.out(DVec2::new(0.06, 0.01 * f64::from(random.normal()))),
            yaw: at.yaw + 0.15 * f64::from(random.normal()) + 0.05,
        };
        let mut sight: [f32; SIGHT] = std::array::from_fn(|_| random.normal());
        // Both answers to whether a cone is in view, and distances near and far.
        sight[3] = if step % 4 < 2 { 0.9 } else { 0.1 };
        (8..8 + 2 * RAYS).for_each(|k| sight[k] = 0.7 * sight[k] - 0.5);
        let command = [0; 3].map(|_| f64::from(random.between(-0.3, 0.6)));
        recall.go(at);
        let followed = Reflex::default().apply(&recall, 0.33, &Limits::default(), command);
        changed += usize::from(followed.iter().zip(command).any(|(a, b)| (a - b).abs() > 1e-9));
        expected.push(recall.features().map(f64::from).into_iter().chain(followed).collect::<Vec<f64>>());
        given.push(serde_json::json!([[at.place.x, at.place.y, at.yaw], sight.to_vec(), command]));
        recall.see(&sight);
    }
    assert!(changed > 15 && changed < 60, "{changed}");
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("recall.json");
    std::fs::write(&file, serde_json::to_vec(&given).unwrap()).unwrap();
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../python/quadverse");
    let output = Command::new(python).args(["-c", SCRIPT]).args([package, file]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Vec<Vec<f64>> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found.len(), expected.len());
    for (step, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(found.len(), RECALL + 3);
        for (k, (a, b)) in found.iter().zip(expected).enumerate() {
            assert!((a - b).abs() < 1e-4, "decision {step}, number {k}: {a} for {b}");
        }
    }
}
