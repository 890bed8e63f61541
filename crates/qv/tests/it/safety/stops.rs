//! What a stop leaves: exit code 130, the old result, and where to go on from.

use super::{command, contents, directory, done, qv, recording, remarks, signal, until};
use crate::facts::States;
use crate::reconstruct::capture_in;
use std::fs;
use std::path::Path;
use std::process::Stdio;

/// Settings of a training that takes a moment.
const SMALL: &str = "robots = 4\nepoch = 4\nscore_every = 1000\nscore_robots = 2\nscore_seconds = 2.0\n";

fn small(root: &Path) {
    fs::write(root.join("small.toml"), SMALL).unwrap();
}

/// Exit code and standard error of a command that gets a signal once a file is there, or after a moment.
fn stopped(root: &Path, words: &str, name: &str, is_time: impl Fn() -> bool) -> (i32, String) {
    let log = root.join("stderr");
    let mut child = command(root, words).stdout(Stdio::null()).stderr(fs::File::create(&log).unwrap()).spawn().unwrap();
    until(words, || is_time() || child.try_wait().unwrap().is_some());
    signal(&child, name);
    (child.wait().unwrap().code().unwrap_or(-1), fs::read_to_string(&log).unwrap())
}

#[test]
fn a_policy_stays_when_another_training_is_stopped_and_goes_on() {
    let root = directory("stop_walk");
    small(&root);
    done(&root, "walk train --settings small.toml --iterations 6 --out out");
    let old = contents(&root.join("out"));
    // Not a whole number of epochs: the checkpoint is of the last iteration, and the policy's.
    done(&root, "walk record out/policy.onnx --minutes 0.05 --walk 2.5 --out walks");
    let unfinished = root.join("out/unfinished.bin");
    let words = "walk train --settings small.toml --seed 7 --iterations 1000000 --out out";
    let (code, err) = stopped(&root, words, "-TERM", || unfinished.is_file());
    assert_eq!(code, 130, "{err}");
    let line = err.lines().last().unwrap();
    let at: u64 = line.split("stopped at ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(at >= 4 && line.states("1000000 1000000") && line.contains("--resume"), "{line}");
    assert_eq!(contents(&root.join("out")), old);
    // It goes on; one that scores less than what is there stays beside it unless that is asked for.
    let more = format!("walk train --resume --iterations {} --out out", at + 1);
    done(&root, &more);
    let now = contents(&root.join("out"));
    if now == old {
        assert!(unfinished.is_file());
        done(&root, &format!("walk train --resume --replace --iterations {} --out out", at + 2));
    }
    assert_ne!(contents(&root.join("out")), old);
    assert!(!unfinished.is_file());
    let settings = fs::read_to_string(root.join("out/settings.toml")).unwrap();
    assert!(settings.states("seed 7"), "{settings}");
}

#[test]
fn a_training_that_was_stopped_has_the_bits_of_one_that_was_not() {
    let root = directory("stop_bits");
    small(&root);
    done(&root, "walk train --settings small.toml --iterations 9 --out whole");
    let unfinished = root.join("part/unfinished.bin");
    let words = "walk train --settings small.toml --iterations 1000000 --out part";
    let (code, err) = stopped(&root, words, "-INT", || unfinished.is_file());
    assert_eq!(code, 130, "{err}");
    let checkpoint = fs::read(&unfinished).unwrap();
    let header: serde_json::Value =
        serde_json::from_slice(checkpoint.split(|byte| *byte == b'\n').next().unwrap()).unwrap();
    let at = header["iterations"].as_u64().unwrap();
    if at <= 8 {
        done(&root, "walk train --resume --iterations 9 --out part");
        let policy = |folder: &str| fs::read(root.join(folder).join("policy.onnx")).unwrap();
        assert_eq!(policy("part"), policy("whole"));
    }
    assert_eq!(at % 4, 0, "an epoch begins there");
}

#[test]
fn a_finished_scene_stays_when_another_training_is_stopped() {
    let root = directory("stop_reconstruct");
    capture_in(&root.join("capture"), 6);
    done(&root, "reconstruct capture --out out --iterations 20 --seed 2");
    let old = contents(&root.join("out"));
    let log = root.join("stderr");
    let is_training = || fs::read_to_string(&log).is_ok_and(|said| said.states("training 2 3"));
    let words = "reconstruct capture --out out --iterations 1000000 --seed 3 --aside 0";
    let (code, err) = stopped(&root, words, "-TERM", is_training);
    assert!(code == 130 && err.states("stopped") && err.contains("stays"), "{code} {err}");
    assert_eq!(contents(&root.join("out")), old);
    // The seed is the checkpoint's.
    let at: u64 = err.split("stopped at step ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let more = format!("reconstruct capture --out out --iterations {} --aside 0 --resume", at + 3);
    let (code, _, err) = qv(&root, &format!("{more} --seed 99"));
    assert!(code == 1 && err.states("--seed 3") && err.contains("99"), "{err}");
    let (code, _, err) = qv(&root, &format!("{more} --seed 3 --exposure"));
    assert!(code == 1 && err.contains("--exposure"), "{err}");
    assert_eq!(contents(&root.join("out")), old);
    done(&root, &format!("{more} --seed 3"));
    assert_ne!(contents(&root.join("out"))["scene.ply"], old["scene.ply"]);
    assert!(!root.join("out/unfinished.qvt").exists());
}

#[test]
fn every_command_ends_with_130_and_leaves_what_was_there() {
    let root = directory("stop_any");
    recording(&root.join("run"));
    done(&root, "diagnose run --out out");
    let old = contents(&root.join("out"));
    for name in ["-TERM", "-INT"] {
        let (code, err) = stopped(&root, "diagnose run --seed 5 --out out", name, || root.join("out/qv.lock").exists());
        assert!(code == 130 && err.contains("stopped"), "{code} {err}");
        assert_eq!(contents(&root.join("out")), old);
        assert!(!root.join("out/qv.lock").exists() && super::leftovers(&root).is_empty());
    }
    let (code, _) =
        stopped(&root, "diagnose run --out new/folder", "-TERM", || root.join("new/folder/qv.lock").exists());
    assert!(code == 130 && !root.join("new").exists());
}

#[test]
fn what_the_dead_left_is_removed_by_the_next() {
    let root = directory("stop_leftovers");
    recording(&root.join("run"));
    let mut child = command(&root, "replay run --out out").spawn().unwrap();
    until("files", || !super::leftovers(&root).is_empty() || child.try_wait().unwrap().is_some());
    signal(&child, "-KILL");
    let (_, out, err) = remarks(&child.wait_with_output().unwrap());
    assert!(contents(&root.join("out")).is_empty() || out.contains("written"), "{out}{err}");
    done(&root, "replay run --out out");
    assert!(super::leftovers(&root).is_empty());
    assert!(!root.join("out/qv.lock").exists());
}
