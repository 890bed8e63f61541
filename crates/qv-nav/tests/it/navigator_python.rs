//! The navigator decides what that of `python/quadverse/navigation.py` decides, on the same policy, frames and odometry.

use glam::DVec2;
use qv_core::random::Xoshiro256PlusPlus;
use qv_nav::navigator::{FRAME, Navigator};
use qv_nav::net::Net;
use qv_nav::onnx::to_bytes_for;
use qv_nav::recall::Planar;
use qv_nav::task::Limits;
use qv_nav::weights::GoalInput;
use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

/// Frames are a file of bytes; rows hold gravity and odometry.
const SCRIPT: &str = "
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
import navigation
navigator = navigation.Navigator(sys.argv[2], sys.argv[5])
frames = np.fromfile(sys.argv[3], np.uint8).reshape(-1, 480, 640, 3)
rows = json.load(open(sys.argv[4]))
json.dump([navigator.decide(f, g, o).tolist() for f, (g, o) in zip(frames, rows)], sys.stdout)
";

#[test]
fn python_decides_the_same() {
    let python = std::env::var_os("QV_PYTHON_ONNX").unwrap_or_else(|| "python3".into());
    let works = Command::new(&python).args(["-c", "import numpy, onnxruntime"]).output();
    if !works.is_ok_and(|output| output.status.success()) {
        crate::skipped::skipped("no Python with numpy and onnxruntime (cargo xtask test makes one)");
        return;
    }
    for (input, colour) in [(GoalInput::Name, "yellow"), (GoalInput::Colour, "#30a0d0"), (GoalInput::Colour, "orange")]
    {
        compare(&python, input, colour);
    }
}

/// Compares the decisions of a policy that is commanded in some way.
fn compare(python: &OsStr, input: GoalInput, colour: &str) {
    let (net, mut random) = (Net::default(), Xoshiro256PlusPlus::new(8));
    let mut parameters = net.draw(&mut random);
    // Commands of a size at which errors would be seen.
    parameters.iter_mut().for_each(|p| *p *= 1.3);
    let policy = to_bytes_for(&net, &parameters, &Limits::default(), [3.0, 2.5], input).unwrap();
    let mut navigator = Navigator::new(&policy, colour).unwrap();
    let (mut at, mut frames, mut rows, mut decided) = (Planar::default(), Vec::new(), Vec::new(), Vec::new());
    for _ in 0..10 {
        let level = random.below(200) as u8;
        let frame: Vec<u8> = (0..FRAME[0] * FRAME[1] * 3).map(|_| level + random.below(56) as u8).collect();
        let gravity = [0.1, -0.05, -(1.0f64 - 0.0125).sqrt()];
        decided.push(navigator.decide(&frame, gravity, at).unwrap());
        rows.push((gravity, [at.place.x, at.place.y, at.yaw]));
        frames.extend(frame);
        at = Planar { place: at.out(DVec2::new(0.08, 0.01)), yaw: at.yaw + 0.15 };
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("navigator_{}", colour.trim_start_matches('#')));
    std::fs::create_dir_all(&folder).unwrap();
    let files = ["policy.onnx", "frames.bin", "rows.json"].map(|name| folder.join(name));
    for (file, bytes) in files.iter().zip([policy, frames, serde_json::to_vec(&rows).unwrap()]) {
        std::fs::write(file, bytes).unwrap();
    }
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../python/quadverse");
    let output = Command::new(python).args(["-c", SCRIPT]).arg(package).args(files).arg(colour).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let expected: Vec<[f64; 3]> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(expected.len(), decided.len());
    for (k, (a, b)) in decided.iter().zip(&expected).enumerate() {
        assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-4), "decision {k}: {a:?} here, {b:?} in Python");
    }
    let moved = |i: usize| decided.iter().any(|d| (d[i] - decided[0][i]).abs() > 1e-3);
    assert!(moved(0) && moved(2), "frames make a difference: {decided:?}");
}
