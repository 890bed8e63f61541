//! A plan of a fleet names no folder but its own, and runs nothing but `qv`.

use super::{contents, directory, done, qv, recording};
use std::fs;
use std::path::Path;

/// A laboratory of one recording with its fleet, planned.
fn planned(name: &str) -> std::path::PathBuf {
    let root = directory(name);
    recording(&root.join("lab/day"));
    fs::write(root.join("lab/day/rehearse.json"), "{}").unwrap();
    done(&root, "fleet plan lab --out fleet --command rehearse");
    root
}

fn unit(root: &Path) -> String {
    let plan: serde_json::Value = serde_json::from_slice(&fs::read(root.join("fleet/plan.json")).unwrap()).unwrap();
    plan["units"][0]["id"].as_str().unwrap().into()
}

#[test]
fn a_plan_with_other_identities_is_refused() {
    let root = planned("plan_identity");
    let victim = root.join("victim");
    fs::create_dir_all(victim.join("out")).unwrap();
    fs::write(victim.join("out/thesis.txt"), "mine").unwrap();
    let text = fs::read_to_string(root.join("fleet/plan.json")).unwrap();
    let absolute = victim.display().to_string();
    for odd in ["../../victim", &absolute, "a;touch x;#", "u0123456789abcdeF", ""] {
        fs::write(root.join("fleet/plan.json"), text.replace(&unit_of(&text), odd)).unwrap();
        for words in ["fleet run fleet", "fleet snakemake fleet", "fleet slurm fleet", "fleet gather fleet"] {
            let (code, out, err) = qv(&root, words);
            assert!(code == 1 && out.is_empty() && err.lines().count() == 2, "{words}: {out}{err}");
        }
    }
    assert_eq!(fs::read_to_string(victim.join("out/thesis.txt")).unwrap(), "mine");
    // Nor does a plan say to whom something is sent, or where results go.
    for odd in ["--ask=http://127.0.0.1:9", "--out=elsewhere"] {
        let hostile = text.replacen("\"options\": []", &format!("\"options\": [\"{odd}\"]"), 1);
        assert_ne!(hostile, text);
        fs::write(root.join("fleet/plan.json"), hostile).unwrap();
        assert_eq!(qv(&root, "fleet run fleet").0, 1);
    }
}

fn unit_of(text: &str) -> String {
    let plan: serde_json::Value = serde_json::from_str(text).unwrap();
    plan["units"][0]["id"].as_str().unwrap().into()
}

#[test]
fn a_unit_removes_what_its_command_wrote_and_nothing_else() {
    let root = planned("plan_out");
    let place = root.join("fleet/units").join(unit(&root));
    fs::create_dir_all(place.join("out/data")).unwrap();
    fs::write(place.join("out/data/notes.txt"), "mine").unwrap();
    fs::write(place.join("done.json"), "mine").unwrap();
    done(&root, "fleet run fleet");
    assert!(place.join("out/report.json").is_file());
    assert_eq!(fs::read_to_string(place.join("out/data/notes.txt")).unwrap(), "mine");
    // Done again after the record is gone: the report of the first time goes, what is not ours stays.
    fs::remove_file(place.join("done.json")).unwrap();
    done(&root, "fleet run fleet");
    let names: Vec<String> = contents(&place.join("out")).into_keys().collect();
    assert_eq!(names, ["data/notes.txt", "report.json"]);
}

#[test]
fn what_a_user_has_beside_a_plan_is_kept() {
    let root = planned("plan_foreign");
    done(&root, "fleet run fleet");
    fs::write(root.join("fleet/fleet.html"), "mine").unwrap();
    for _ in 0..2 {
        done(&root, "fleet gather fleet");
        done(&root, "fleet plan lab --out fleet --command rehearse");
    }
    assert_eq!(fs::read_to_string(root.join("fleet/fleet.html.kept-1")).unwrap(), "mine");
    let names: Vec<String> = contents(&root.join("fleet")).into_keys().filter(|name| name.contains("kept")).collect();
    assert_eq!(names, ["fleet.html.kept-1"]);
}

#[cfg(unix)]
#[test]
fn a_log_that_is_a_link_is_not_followed() {
    let root = planned("plan_log");
    let place = root.join("fleet/units").join(unit(&root));
    fs::create_dir_all(&place).unwrap();
    fs::write(root.join("secret"), "password").unwrap();
    for name in ["log.txt", "lock"] {
        let _ = fs::remove_file(place.join(name));
        std::os::unix::fs::symlink(root.join("secret"), place.join(name)).unwrap();
        let (code, out, err) = qv(&root, "fleet run fleet");
        assert!(code != 0 && !out.contains("password") && !err.contains("password"), "{out}{err}");
        assert_eq!(fs::read_to_string(root.join("secret")).unwrap(), "password");
        fs::remove_file(place.join(name)).unwrap();
    }
    fs::hard_link(root.join("secret"), place.join("log.txt")).unwrap();
    assert_ne!(qv(&root, "fleet run fleet").0, 0);
    assert_eq!(fs::read_to_string(root.join("secret")).unwrap(), "password");
}
