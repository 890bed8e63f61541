//! Commands that are killed at random moments: the old result is there whole, or the new one.
//!
//! Each test kills a few times; `cargo xtask kills` kills each command 20 times.

use super::{command, contents, copy, directory, done, leftovers, qv, recording, signal};
use crate::facts::States;
use crate::navigate::place;
use crate::reconstruct::capture_in;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// How often a command is killed: the variable `QV_KILLS`, else a few times.
fn kills() -> u64 {
    std::env::var("QV_KILLS").ok().and_then(|count| count.parse().ok()).unwrap_or(3)
}

/// Names of files with other contents.
fn differing(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>) -> Vec<String> {
    a.keys().chain(b.keys()).filter(|name| a.get(*name) != b.get(*name)).cloned().collect()
}

/// Makes the moves that a manifest states and that were not all made.
fn end_moves(out: &Path) {
    let manifest = fs::read_to_string(out.join(".qv-files")).unwrap_or_default();
    let records: Vec<serde_json::Value> =
        manifest.lines().skip(1).filter_map(|l| serde_json::from_str(l).ok()).collect();
    let Some(last) = records.iter().rposition(|r| r.get("moves").is_some()) else { return };
    if records[last..].iter().any(|r| r == "moved") {
        return;
    }
    for pair in records[last]["moves"]["from_to"].as_array().unwrap() {
        let [from, to] = [0, 1].map(|k| out.join(pair[k].as_str().unwrap()));
        if from.exists() {
            fs::rename(from, to).unwrap();
        }
    }
}

/// Kills `new` at random moments of its time over the results of `old` in the folder `out`. `is_same` says which files have the same contents in every run.
fn survives(root: &Path, old: &str, new: &str, is_same: &dyn Fn(&str) -> bool) {
    let (out, kept) = (root.join("out"), root.join("kept"));
    done(root, old);
    copy(&out, &kept);
    let before = contents(&out);
    let clock = Instant::now();
    done(root, new);
    let time = clock.elapsed();
    let after = contents(&out);
    let changed = differing(&before, &after);
    assert!(!changed.is_empty() && changed.iter().any(|name| is_same(name)), "{new} changes nothing");
    let mut random = Xoshiro256PlusPlus::new(u64::from(std::process::id()));
    let (mut olds, mut news) = (0, 0);
    for k in 0..kills() {
        copy(&kept, &out);
        let mut child = command(root, new).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // The first comes where results take their places.
        let share = if k == 0 { 0.97 } else { f64::from(random.unit()) };
        std::thread::sleep(Duration::from_secs_f64(share * time.as_secs_f64()));
        signal(&child, if k % 3 == 2 { "-TERM" } else { "-KILL" });
        let code = child.wait().unwrap().code();
        assert!([None, Some(0), Some(3), Some(130)].contains(&code), "{new}: {code:?}");
        // A kill between two moves of a commit is ended by the next owner of the folder, from what the manifest states.
        end_moves(&out);
        let now = contents(&out);
        let from_old = differing(&before, &now);
        if from_old.is_empty() {
            olds += 1;
            assert_ne!(code, Some(0), "{new}: ended well and changed nothing");
            continue;
        }
        news += 1;
        let half: Vec<&String> = changed.iter().filter(|name| !from_old.contains(name)).collect();
        let wrong: Vec<&String> =
            after.keys().filter(|name| is_same(name) && now.get(*name) != after.get(*name)).collect();
        assert!(half.is_empty() && wrong.is_empty(), "{new}: killed at {share:.3}: old {half:?}, wrong {wrong:?}");
        assert_eq!(now.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    }
    assert_eq!(olds + news, kills());
    // The next owner of the folder tidies up, and its results are whole.
    done(root, new);
    let again = contents(&out);
    assert!(after.keys().filter(|name| is_same(name)).all(|name| again.get(name) == after.get(name)), "{new}");
    assert_eq!(leftovers(&out), Vec::<std::path::PathBuf>::new());
    assert!(again.keys().all(|name| !name.contains(".kept-")), "{:?}", again.keys());
    assert_eq!(again.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
}

#[test]
fn a_reconstruction_survives() {
    let root = directory("kill_reconstruct");
    capture_in(&root.join("capture"), 6);
    let new = "reconstruct capture --out out --iterations 150 --seed 2 --preview";
    let old = "reconstruct capture --out out --iterations 20 --seed 1 --preview";
    survives(&root, old, new, &|name| ["scene.ply", "checkpoint.qvt"].contains(&name));
}

#[test]
fn a_walking_policy_survives() {
    let root = directory("kill_walk");
    fs::write(root.join("small.toml"), "robots = 4\nepoch = 4\nscore_robots = 2\nscore_seconds = 2.0\n").unwrap();
    let new = "walk train --settings small.toml --iterations 6 --seed 2 --replace --out out";
    let old = "walk train --settings small.toml --iterations 2 --seed 1 --out out";
    survives(&root, old, new, &|name| {
        ["policy.onnx", "policy.toml", "settings.toml", "checkpoint.bin"].contains(&name)
    });
}

#[test]
fn a_navigation_policy_survives() {
    let root = directory("kill_navigate");
    place(&root, &Pose::IDENTITY, 1.0);
    let words = "navigate train --scene scene.ply --terrain mesh.glb --starts view --distance 1,2 --camera none --robots 2 --epochs 1 --batch 2 --frames 20 --out out";
    let (old, new) = (format!("{words} --rounds 1 --seed 1"), format!("{words} --rounds 3 --seed 2"));
    survives(&root, &old, &new, &|name| ["weights.bin", "policy.onnx", "metrics.json"].contains(&name));
    // What was stopped goes on.
    let mut child = command(&root, &format!("{words} --rounds 100000 --seed 3")).spawn().unwrap();
    super::until("a round", || root.join("out/unfinished.json").exists() || child.try_wait().unwrap().is_some());
    signal(&child, "-TERM");
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let (code, _, err) = qv(&root, &format!("{words} --rounds 100000 --seed 4 --resume"));
    assert!(code == 1 && err.states("--seed 3"), "{err}");
}

#[test]
fn a_diagnosis_survives() {
    let root = directory("kill_diagnose");
    recording(&root.join("run"));
    let new = "diagnose run --out out --seed 2 --without backlash";
    let is_same = |name: &str| ["calibrated.toml", "mjcf_fragment.xml", "evidence.json"].contains(&name);
    survives(&root, "diagnose run --out out --seed 1", new, &|name| is_same(name.rsplit('/').next().unwrap()));
}

#[test]
fn a_tuning_survives() {
    let root = directory("kill_tune");
    fs::write(root.join("small.toml"), "robots = 4\nepoch = 4\nscore_robots = 2\nscore_seconds = 2.0\n").unwrap();
    done(&root, "walk train --settings small.toml --iterations 4 --out walk");
    done(&root, "walk record walk/policy.onnx --minutes 0.4 --walk 2.5 --out log");
    let settings = "held_every = 2\nwalks = 6\n[fit]\nwindows = 12\nsteps = 1\nlength = 10\n\
        [tune]\niterations = 1\nrobots = 4\ncalibration = 4\nwalks = 6\n";
    fs::write(root.join("tune.toml"), settings).unwrap();
    let words = "tune log --policy walk/policy.onnx --settings tune.toml --out out --seed";
    let is_same = |name: &str| ["policy.onnx", "compensator.json", "calibrated.toml", "settings.toml"].contains(&name);
    survives(&root, &format!("{words} 1"), &format!("{words} 2"), &is_same);
    // Files of somebody else in the folder of stages stay, though stages of other inputs go.
    let foreign = root.join("out/stages/act_one.txt");
    fs::write(&foreign, "theirs").unwrap();
    done(&root, &format!("{words} 1"));
    assert_eq!(fs::read_to_string(foreign).unwrap(), "theirs");
}

#[test]
fn a_fleet_survives() {
    let root = directory("kill_fleet");
    for k in 0..3 {
        let folder = root.join(format!("lab/day{k}"));
        recording(&folder);
        let report = format!("{{\"seconds\": 0.1, \"report\": {{\"verdict\": \"explained\", \"day\": {k}}}}}");
        fs::write(folder.join("rehearse.json"), report).unwrap();
    }
    done(&root, "fleet plan lab --out out --command rehearse");
    copy(&root.join("out"), &root.join("kept"));
    let clock = Instant::now();
    done(&root, "fleet run out --jobs 2");
    let (time, after) = (clock.elapsed(), contents(&root.join("out")));
    let reports = |all: &BTreeMap<String, Vec<u8>>| -> BTreeMap<String, Vec<u8>> {
        all.iter().filter(|(name, _)| name.ends_with("report.json")).map(|(n, b)| (n.clone(), b.clone())).collect()
    };
    let mut random = Xoshiro256PlusPlus::new(u64::from(std::process::id()));
    for k in 0..kills() {
        copy(&root.join("kept"), &root.join("out"));
        let mut child =
            command(&root, "fleet run out --jobs 2").stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs_f64(f64::from(random.unit()) * time.as_secs_f64()));
        signal(&child, if k % 3 == 2 { "-TERM" } else { "-KILL" });
        child.wait().unwrap();
        let now = reports(&contents(&root.join("out")));
        assert!(now.iter().all(|(name, bytes)| after.get(name) == Some(bytes)), "a report that is half there");
        done(&root, "fleet run out --jobs 2");
        assert_eq!(reports(&contents(&root.join("out"))), reports(&after));
        assert_eq!(leftovers(&root.join("out")), Vec::<std::path::PathBuf>::new());
    }
}
