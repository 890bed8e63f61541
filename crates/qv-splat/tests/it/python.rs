//! Our files, read by Python with packages that know nothing of ours (`fixtures/splat/read_splats.py`).

use crate::made_up::cloud;
use crate::skipped::skipped;
use qv_core::GaussianCloud;
use qv_splat::files::spz::{Version, write_version};
use qv_splat::files::{Format, read_any, write};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The Python of an environment with the packages, when the test runner made one.
fn python() -> Option<PathBuf> {
    let candidate = std::env::var_os("QV_PYTHON_SPLAT").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let works = Command::new(&candidate).args(["-c", "import numpy, plyfile, zstandard"]).output();
    let found = works.ok().filter(|output| output.status.success()).map(|_| candidate);
    if found.is_none() {
        skipped("no Python with numpy, plyfile and zstandard (cargo xtask test makes one)");
    }
    found
}

fn numbers(found: &Value, key: &str) -> Vec<f64> {
    found[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn near(name: &str, key: &str, found: &Value, expected: Vec<f64>, tolerance: f64) {
    let found = numbers(found, key);
    assert_eq!(found.len(), expected.len(), "{name}, {key}");
    for (i, (a, b)) in found.iter().zip(&expected).enumerate() {
        assert!((a - b).abs() <= tolerance * b.abs().max(1.0), "{name}, {key} {i}: {a}, expected {b}");
    }
}

/// A cloud as the program prints it.
fn check(name: &str, found: &Value, cloud: &GaussianCloud) {
    assert_eq!(found["count"], cloud.len());
    let flat = |numbers: &[[f32; 3]]| numbers.iter().flatten().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    near(name, "mean", found, flat(&cloud.means), 2e-6);
    near(name, "scale", found, flat(&cloud.log_scales).iter().map(|log| log.exp()).collect(), 2e-6);
    near(name, "sh", found, flat(&cloud.sh), 2e-6);
    let opacities = cloud.opacity_logits.iter().map(|logit| 1.0 / (1.0 + (-f64::from(*logit)).exp())).collect();
    near(name, "opacity", found, opacities, 1e-3);
    // Signs of quaternions with w near 0 may differ, so that products are compared.
    let python = numbers(found, "rotation");
    for (i, q) in cloud.rotations.iter().enumerate() {
        let length = q.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        let dot: f64 = (0..4).map(|k| f64::from(q[k]) / length * python[4 * i + k]).sum();
        assert!((dot.abs() - 1.0).abs() < 1e-6, "{name}, rotation {i}: {dot}");
    }
}

#[test]
fn python_reads_what_we_write_as_we_do() {
    let Some(python) = python() else { return };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/splat/read_splats.py");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    for degree in [0, 3] {
        let cloud = cloud(600, degree, 0);
        let files = [
            ("ply", "ply", write(&cloud, Format::Ply).unwrap()),
            ("compressed", "compressed", write(&cloud, Format::CompressedPly).unwrap()),
            ("spz2", "spz", write_version(&cloud, Version::V2).unwrap()),
            ("spz3", "spz", write_version(&cloud, Version::V3).unwrap()),
            ("spz4", "spz", write_version(&cloud, Version::V4).unwrap()),
            ("glb", "glb", write(&cloud, Format::Gltf).unwrap()),
        ];
        for (name, kind, bytes) in files {
            let path = folder.join(format!("{name}_{degree}"));
            fs::write(&path, &bytes).unwrap();
            let output = Command::new(&python).arg(&script).arg(kind).arg(&path).output().unwrap();
            assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
            let found: Value = serde_json::from_slice(&output.stdout).unwrap();
            // Both read the same bytes, so that rounding does not matter; opacities 0 and 255 do, by a quarter of a step.
            check(name, &found, &read_any(&bytes).unwrap().cloud);
        }
    }
}
