//! What holds for every command: files that are there whole or not at all, one writer in a folder, options from qv.toml, shells, manuals.

use crate::bags::{directory, qv};
use crate::facts::States;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Names in a folder, without the manifest of what `qv` wrote.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| name != ".qv-files");
    names.sort();
    names
}

/// Runs `qv` in a folder, as a shell does.
fn qv_in(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_qv")).current_dir(folder).args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

/// A file may not grow beyond a few kilobytes, which fails as a full disk does: while it is written.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_old_file() {
    let folder = directory("full_disk");
    fs::write(folder.join("run.mcap"), "the old one").unwrap();
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" fixture --out \"$1\"";
    let output = Command::new("sh").args(["-c", script, env!("CARGO_BIN_EXE_qv")]).arg(&folder).output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && err.contains("run.mcap"), "{err}");
    assert_eq!(fs::read(folder.join("run.mcap")).unwrap(), b"the old one");
    assert_eq!(names(&folder), ["run.mcap"], "no part of what failed is left");
    assert!(!folder.join(".qv-files").exists(), "nothing is ours");
}

#[test]
fn a_lock_that_is_held_is_named_and_one_of_the_dead_is_taken_over() {
    let folder = directory("locked");
    let out = folder.display().to_string();
    let file = folder.join("qv.lock");
    let held = fs::File::create(&file).unwrap();
    held.lock().unwrap();
    fs::write(&file, "process 42 on lab").unwrap();
    let (code, _, err) = qv(&["fixture", "--out", &out]);
    assert!(code == 1 && err.contains(&out) && err.states("process 42"), "{err}");
    assert_eq!(names(&folder), ["qv.lock"]);
    drop(held);
    let (code, _, err) = qv(&["fixture", "--out", &out]);
    assert!(code == 0 && err.states("process 42"), "{err}");
    assert_eq!(names(&folder), ["run.mcap", "terrain.glb", "truth.json"]);
}

#[test]
fn options_come_from_the_nearest_file_and_what_was_read_is_told() {
    let lab = directory("config");
    let day = lab.join("day");
    fs::create_dir_all(&day).unwrap();
    let own = "[[effect]]\nname = \"grease\"\ninterface = \"actuator\"\nscope = \"joints\"\nunit = \"N m\"\nrange = [0.0, 1.0]\ntolerance = 0.03\nlevels = [0.15]\n\
        [[effect.axis]]\nname = \"torque\"\nmoves = { \"joint.{joint}.coulomb_friction\" = 1.0 }\n";
    fs::write(lab.join("mine.toml"), own).unwrap();
    fs::write(lab.join("qv.toml"), "[effects]\nlibrary = \"mine.toml\"\njson = true\n").unwrap();
    // The file lies above, and so does the one that it names.
    let (code, out, err) = qv_in(&day, &["effects"]);
    assert!(code == 0 && out.starts_with('{') && out.contains("\"grease\""), "{out}{err}");
    assert!(err.states("qv.toml --json --library="), "{err}");
    let (code, out, err) = qv_in(&day, &["effects", "--no-config"]);
    assert!(code == 0 && !out.contains("grease") && out.starts_with("name") && err.is_empty(), "{out}{err}");
    fs::write(day.join("qv.toml"), "[effects]\nlibary = \"mine.toml\"\n").unwrap();
    let (code, _, err) = qv_in(&day, &["robots"]);
    let expected = "qv.toml': effects.libary: unknown option \"libary\"\nhint: did you mean 'library'?";
    assert!(code == 2 && err.contains(expected), "{err}");
    // A value that the option does not take is given by the option, and where it stands is reported, too.
    fs::write(day.join("qv.toml"), "[fixture]\nseed = \"one\"\n").unwrap();
    let (code, _, err) = qv_in(&day, &["fixture", "--out", "o"]);
    assert!(code == 2 && err.contains("'one' for '--seed <N>'") && err.states("qv.toml --seed=one"), "{err}");
    assert!(!day.join("o").exists());
}

#[test]
fn shells_and_manuals_know_every_command() {
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let (code, out, err) = qv(&["completions", shell]);
        assert_eq!(code, 0, "{err}");
        assert!(["diagnose", "reconstruct", "completions"].iter().all(|name| out.contains(name)), "{shell}");
        assert!(out.contains("ground-error"), "{shell} knows options");
    }
    let folder = directory("man").join("man1");
    let (code, out, err) = qv(&["man", &folder.display().to_string()]);
    assert_eq!(code, 0, "{err}");
    let pages = names(&folder);
    assert_eq!(out, format!("{} pages written to {}\n", pages.len(), folder.display()));
    for page in ["qv.1", "qv-diagnose.1", "qv-walk-train.1", "qv-fleet-run.1"] {
        assert!(pages.iter().any(|name| name == page), "{pages:?}");
    }
    let text = fs::read_to_string(folder.join("qv-diagnose.1")).unwrap();
    assert!(text.states(".SH OPTIONS") && text.contains("terrain"), "{text}");
    assert!(!pages.iter().any(|name| name.contains("rehearse")), "hidden commands have no page");
}
