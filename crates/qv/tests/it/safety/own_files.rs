//! An output folder owns what `qv` wrote into it, and nothing else; what is read is never written over.

use super::{contents, directory, done, qv, recording};
use crate::facts::States;
use crate::reconstruct::capture_in;
use std::fs;
use std::path::Path;

/// Files of a user that lie where a command has its own.
fn foreign(folder: &Path, names: &[&str]) {
    for name in names {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("mine: {name}")).unwrap();
    }
}

/// Whether all that a user has is there, under its name or beside it.
fn is_kept(folder: &Path, names: &[&str]) -> bool {
    let all = contents(folder);
    names.iter().all(|name| all.values().any(|bytes| *bytes == format!("mine: {name}").into_bytes()))
}

#[test]
fn a_capture_in_the_output_folder_is_refused_and_stays() {
    let root = directory("capture");
    capture_in(&root.join("proj/capture"), 6);
    let before = contents(&root);
    for words in [
        "reconstruct proj/capture --out proj --iterations 1",
        "reconstruct proj/capture/transforms.json --out proj --iterations 1",
        "reconstruct proj/capture --out proj/../proj --iterations 1",
        "reconstruct proj/capture --out proj/capture/.. --poses colmap --iterations 1",
    ] {
        let (code, _, err) = qv(&root, words);
        assert!(code == 1 && err.lines().count() == 2 && err.states("read"), "{words}: {err}");
        assert_eq!(contents(&root), before, "{words}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("proj", root.join("link")).unwrap();
        let (code, _, err) = qv(&root, "reconstruct proj/capture --out link --iterations 1");
        assert!(code == 1 && err.states("read"), "{err}");
        fs::remove_file(root.join("link")).unwrap();
    }
    assert_eq!(contents(&root), before);
}

#[test]
fn a_video_beside_photographs_is_refused() {
    let root = directory("video");
    foreign(&root, &["proj/capture/walk.mp4", "proj/capture/images/holiday.jpg"]);
    let before = contents(&root);
    let (code, _, err) = qv(&root, "reconstruct proj/capture/walk.mp4 --out proj");
    assert!(code == 1 && err.contains("walk.mp4"), "{err}");
    // One from elsewhere finds the folder taken.
    fs::rename(root.join("proj/capture/walk.mp4"), root.join("walk.mp4")).unwrap();
    let (code, _, err) = qv(&root, "reconstruct walk.mp4 --out proj");
    assert!(code == 1, "{err}");
    assert_eq!(contents(&root).len(), before.len());
    assert!(is_kept(&root, &["proj/capture/walk.mp4", "proj/capture/images/holiday.jpg"]), "{err}");
}

#[test]
fn cameras_that_are_read_stay() {
    let root = directory("cameras");
    capture_in(&root.join("capy"), 6);
    foreign(&root, &["capy/cameras.json", "capy/notes.txt"]);
    let (code, _, err) = qv(&root, "reconstruct capy/cameras.json --out capy --iterations 1");
    assert!(code == 1 && err.contains("cameras.json"), "{err}");
    done(&root, "reconstruct capy/transforms.json --out capy --iterations 1");
    assert!(is_kept(&root.join("capy"), &["capy/cameras.json", "capy/notes.txt"]));
    assert!(root.join("capy/images/00.png").is_file() && root.join("capy/scene.ply").is_file());
}

#[test]
fn what_a_diagnosis_reads_is_not_written_over() {
    let root = directory("diagnosis");
    recording(&root.join("run"));
    fs::create_dir_all(root.join("d")).unwrap();
    fs::write(root.join("d/calibrated.toml"), "[parameters]\n\"joint.shaft.coulomb_friction\" = 0.01\n").unwrap();
    let before = contents(&root);
    for out in ["d", "d/", "d/../d"] {
        let (code, _, err) = qv(&root, &format!("diagnose run --params d/calibrated.toml --out {out}"));
        assert!(code == 1 && err.contains("calibrated.toml") && err.lines().count() == 2, "{err}");
        assert_eq!(contents(&root), before);
    }
}

#[test]
fn what_a_user_has_in_a_folder_is_kept_and_ours_is_replaced() {
    let root = directory("foreign");
    recording(&root.join("run"));
    let names = ["out/replay.json", "out/replay.html", "out/mine.txt"];
    foreign(&root, &names);
    done(&root, "replay run --out out");
    assert!(is_kept(&root, &names));
    let first = contents(&root.join("out"));
    assert!(serde_json::from_slice::<serde_json::Value>(&first["replay.json"]).is_ok());
    // Again: ours is replaced without another copy.
    done(&root, "replay run --out out");
    assert_eq!(contents(&root.join("out")).keys().collect::<Vec<_>>(), first.keys().collect::<Vec<_>>());
    // What somebody changed is not ours any more.
    fs::write(root.join("out/replay.layout.json"), "mine: changed").unwrap();
    done(&root, "replay run --out out");
    assert!(is_kept(&root, &["changed"]) && is_kept(&root, &names));
}

/// A file may not grow beyond a few kilobytes, which fails as a full disk does.
#[cfg(unix)]
#[test]
fn a_failure_leaves_all_of_what_was_there() {
    let root = directory("failure");
    recording(&root.join("run"));
    done(&root, "replay run --out out");
    let before = contents(&root.join("out"));
    let script = "trap '' XFSZ; ulimit -f 24; exec \"$0\" replay run --out out";
    let mut shell = std::process::Command::new("sh");
    let output = shell.current_dir(&root).args(["-c", script, env!("CARGO_BIN_EXE_qv")]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(contents(&root.join("out")), before);
    assert!(super::leftovers(&root).is_empty());
}

/// A file without the field that says how long it took.
fn without_timing(bytes: &[u8]) -> Vec<u8> {
    match serde_json::from_slice::<serde_json::Value>(bytes) {
        Ok(mut value) if value.get("timing").is_some() => {
            value["timing"] = serde_json::Value::Null;
            value.to_string().into_bytes()
        }
        _ => bytes.to_vec(),
    }
}

#[test]
fn two_runs_give_equal_files_but_for_how_long_they_took() {
    let root = directory("equal");
    recording(&root.join("run"));
    capture_in(&root.join("capture"), 6);
    fs::write(root.join("small.toml"), "robots = 4\nscore_robots = 2\nscore_seconds = 2.0\n").unwrap();
    for words in [
        "diagnose run --out out",
        "replay run --out out",
        "reconstruct capture --iterations 20 --out out",
        "walk train --settings small.toml --iterations 2 --out out",
    ] {
        let run = || {
            let _ = fs::remove_dir_all(root.join("out"));
            done(&root, words);
            contents(&root.join("out"))
        };
        let (one, two) = (run(), run());
        assert_eq!(one.len(), two.len());
        for (name, bytes) in &one {
            assert!(without_timing(bytes) == without_timing(&two[name]), "{words}: {name}");
        }
    }
}

/// An environment whose Python is a script that finds given poses good, as COLMAP does, and leaves a database.
#[cfg(unix)]
fn stand_in(root: &Path) {
    use std::os::unix::fs::PermissionsExt;
    let python = root.join("no_environment/bin/python");
    fs::create_dir_all(python.parent().unwrap()).unwrap();
    let script = "#!/bin/sh\nfor a in \"$@\"; do\n[ \"$a\" = -c ] && exit 0\ncase \"$a\" in */given.json) given=$a;; esac\ndone\n\
        folder=$(dirname \"$given\")\n[ -f \"$folder/images/0/000000.png\" ] || exit 1\necho x > \"$folder/database.db\"\n\
        echo '{\"frames\": 9, \"placed\": 0, \"held\": 0.0, \"given_explain\": 0.97}'\n";
    fs::write(&python, script).unwrap();
    fs::set_permissions(&python, fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(unix)]
#[test]
fn what_checks_poses_leaves_what_is_not_its_own() {
    let root = directory("checked");
    stand_in(&root);
    capture_in(&root.join("proj/capture"), 9);
    let before = contents(&root.join("proj"));
    let words = "reconstruct proj/capture --iterations 5 --json --out";
    assert_eq!(qv(&root, &format!("{words} proj")).0, 1);
    assert_eq!(contents(&root.join("proj")), before);
    // Elsewhere it works, twice, and copies of photographs are gone after it.
    for _ in 0..2 {
        let (code, out, err) = qv(&root, &format!("{words} out"));
        assert!(code == 0 && out.contains("0.97"), "{out}{err}");
        assert!(!root.join("out/capture/images").exists() && !root.join("out/capture/database.db").exists());
    }
    // A folder with photographs of somebody is not worked in.
    foreign(&root, &["other/capture/images/holiday.jpg", "other/capture/database.db"]);
    let (code, out, err) = qv(&root, &format!("{words} other"));
    assert!(code == 0 && !out.contains("0.97") && out.states("written"), "{out}{err}");
    assert!(is_kept(&root, &["other/capture/images/holiday.jpg", "other/capture/database.db"]));
    let (code, _, err) = qv(&root, &format!("{words} other --poses colmap"));
    assert!(code == 1 && err.states("written"), "{err}");
    assert_eq!(contents(&root.join("proj")), before);
}
