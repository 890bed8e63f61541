//! Names with dots, colons, bytes that are no text, and letters that move the cursor.

use super::tables::table;
use super::{bounded, bounded_in};
use crate::bags::{bag, directory, small_chunks, walk, write};
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

#[test]
fn joints_may_have_dots_in_their_names() {
    let folder = table("dotted", "hip.L", 3000, 0.002);
    let run = folder.to_str().unwrap();
    let params = folder.join("params.toml");
    fs::write(&params, "[parameters]\n\"actuator.*.lag\" = 0.004\n\"joint.hip.L.armature\" = 0.01\n").unwrap();
    let out = folder.join("out");
    let arguments = ["replay", run, "--out", out.to_str().unwrap(), "--params", params.to_str().unwrap()];
    let (code, _, err) = bounded(&arguments);
    assert!(code == 0 || code == 3, "{err}");
    let output = Command::new(env!("CARGO_BIN_EXE_qv"))
        .args(["diagnose", run, "--out", folder.join("found").to_str().unwrap()])
        .output()
        .unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() || output.status.code() == Some(3), "{err}");
    let report = fs::read_to_string(folder.join("found/report.json")).unwrap();
    assert!(report.contains("hip.L"));
}

#[test]
fn a_path_that_is_no_text_is_not_stored_as_another() {
    let messages = walk(1.0);
    let plain = bag("odd_path", &write(&messages, small_chunks(None), &[]));
    let odd = plain.with_file_name(OsStr::from_bytes(b"caf\xe9.mcap"));
    fs::rename(&plain, &odd).unwrap();
    let folder = directory("odd_path_out");
    let run = |arguments: &[&OsStr]| {
        let output = Command::new(env!("CARGO_BIN_EXE_qv")).args(arguments).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let word = OsStr::new;
    assert_eq!(run(&[word("inspect"), odd.as_os_str()]).0, Some(0), "what stores nothing reads any path");
    let out = folder.join("replayed");
    let (code, err) = run(&[word("replay"), odd.as_os_str(), word("--out"), out.as_os_str()]);
    assert!(code == Some(2) && err.contains("UTF-8") && !out.exists(), "{err}");
    // A fleet finds it by itself.
    let plan = folder.join("fleet");
    let beside = odd.parent().unwrap().as_os_str();
    let (code, err) = run(&[word("fleet"), word("plan"), beside, word("--out"), plan.as_os_str()]);
    let text = fs::read_to_string(plan.join("plan.json")).unwrap_or_default();
    assert!(code != Some(0) && !text.contains("\"units\":[{"), "{err} {text}");
}

#[test]
fn letters_that_move_the_cursor_are_escaped() {
    let folder = directory("cursor");
    let name = "a\u{1b}[2J\u{1b}]0;mine\u{7}\u{202e}.urdf";
    fs::write(folder.join(name), "no URDF").unwrap();
    for arguments in [vec!["params", name], vec!["check", name], vec!["inspect", name, "--none\u{1b}[2J"]] {
        let output = Command::new(env!("CARGO_BIN_EXE_qv")).args(&arguments).current_dir(&folder).output().unwrap();
        let said = [output.stdout, output.stderr].concat();
        let said = String::from_utf8_lossy(&said);
        assert!(!output.status.success() && !said.is_empty(), "{arguments:?}");
        assert!(!said.contains(['\u{1b}', '\u{7}', '\u{202e}']), "{said:?}");
    }
}

/// A program that writes its arguments down, a line each, and fails.
fn pretend(folder: &Path, name: &str) {
    let path = folder.join(name);
    fs::write(&path, format!("#!/bin/sh\nprintf '%s\\n' \"$@\" >> {}/said\nexit 1\n", folder.display())).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn a_video_with_a_colon_is_a_file_for_ffmpeg() {
    let folder = directory("colon");
    pretend(&folder, "ffprobe");
    fs::write(folder.join("2024-05-01T12:30.mp4"), "no video").unwrap();
    let path = std::env::var("PATH").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_qv"))
        .args(["reconstruct", "2024-05-01T12:30.mp4", "--out", "out"])
        .current_dir(&folder)
        .env("PATH", format!("{}:{path}", folder.display()))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = fs::read_to_string(folder.join("said")).unwrap();
    assert!(said.lines().any(|word| word == "file:2024-05-01T12:30.mp4"), "{said}");
}

/// Photographs with cameras, whose poses COLMAP could check.
fn capture(folder: &Path) {
    let frame = |k: u32| {
        let noise = image::GrayImage::from_fn(32, 24, |x, y| image::Luma([(x * 37 + y * 91 + k * 13) as u8]));
        noise.save(folder.join(format!("{k}.png"))).unwrap();
        let rows =
            [[1.0, 0.0, 0.0, 0.1 * f64::from(k)], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]];
        json!({"file_path": format!("{k}.png"), "transform_matrix": rows})
    };
    let frames: Vec<Value> = (0..10).map(frame).collect();
    let cameras = json!({"w": 32, "h": 24, "fl_x": 30.0, "fl_y": 30.0, "cx": 16.0, "cy": 12.0, "frames": frames});
    fs::write(folder.join("transforms.json"), cameras.to_string()).unwrap();
}

/// `qv reconstruct` of such photographs in a folder.
fn reconstruct(folder: &Path) -> Command {
    capture(folder);
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.args(["reconstruct", ".", "--out", "out", "--iterations", "1"]).current_dir(folder);
    command
}

#[test]
fn without_a_home_no_python_of_somebody_else_runs() {
    let folder = directory("homeless");
    let environment = folder.join("tmp/quadverse/colmap/bin");
    fs::create_dir_all(&environment).unwrap();
    pretend(&environment, "python");
    let mut command = reconstruct(&folder);
    command.env_remove("HOME").env_remove("XDG_CACHE_HOME").env_remove("QV_COLMAP_VENV");
    let output = command.env("TMPDIR", folder.join("tmp")).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!environment.join("said").exists());
}

#[test]
fn python_runs_isolated() {
    let folder = directory("isolated");
    let environment = folder.join("venv/bin");
    fs::create_dir_all(&environment).unwrap();
    pretend(&environment, "python");
    let output = reconstruct(&folder).env("QV_COLMAP_VENV", folder.join("venv")).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let said = fs::read_to_string(environment.join("said")).unwrap();
    assert_eq!(said.lines().next(), Some("-I"), "{said}");
}

#[test]
fn a_relative_path_works_within_the_limits() {
    let folder = table("relative", "j", 500, 0.002);
    let (code, _, err) = bounded_in(&folder, &["inspect", "run.csv"]);
    assert_eq!(code, 0, "{err}");
}
