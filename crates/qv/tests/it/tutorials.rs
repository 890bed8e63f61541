//! The tutorials of `docs`: commands in blocks called `console` are run, one after another, in an empty folder; a demo finds what it hides.

use crate::bags::directory;
use crate::facts::States;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs what a tutorial says, and gives the folder and what each command printed.
fn followed(name: &str) -> (PathBuf, Vec<String>) {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(format!("{name}.md"));
    let text = fs::read_to_string(page).unwrap();
    let folder = directory(name);
    let mut said = vec![];
    for block in text.split("```console\n").skip(1) {
        let block = block.split("```").next().unwrap();
        for line in block.lines().filter_map(|line| line.strip_prefix("$ qv ")) {
            let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
            let output = command.current_dir(&folder).args(line.split_whitespace()).output().unwrap();
            let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
            assert_eq!(output.status.code(), Some(0), "{name}: qv {line}\n{out}{err}");
            said.push(out);
        }
    }
    (folder, said)
}

/// The line of JSON of a command.
fn spoken(folder: &Path, words: &str) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    let output = command.current_dir(folder).args(words.split(' ')).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{words}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn who_has_a_bag_finds_what_the_demo_hides() {
    let (folder, said) = followed("tutorial_bag");
    let [truth, report] = ["truth.json", "why/report.json"].map(|name| json(&folder.join("out/demo").join(name)));
    let (hidden, cause) = (&truth["hidden"], &report["causes"][0]);
    assert_eq!((&cause["effect"], &cause["scope"]), (&hidden["effect"], &hidden["scope"]), "{report:#}");
    let number = |value: &Value| value.as_f64().unwrap();
    let [low, high] = [0, 1].map(|k| number(&cause["parameters"][0]["ci95"][k]));
    assert!((low..=high).contains(&number(&hidden["value"])), "{hidden} is not within {low} to {high}");
    let words = hidden["effect"].as_str().unwrap().replace('_', " ");
    let is_told = |head: &str| said[0].lines().any(|line| line.starts_with(head) && line.contains(&words));
    assert!(is_told("Hidden: ") && is_told("Found:  "), "{}", said[0]);
    assert!(said[0].states("The"), "{}", said[0]);
    assert!(folder.join("out/demo/view.html").is_file() && folder.join("out/replay/replay.layout.json").is_file());
    let view = spoken(&folder, "view out/demo/why --out out/view.html --json");
    assert_eq!((&view["format"], &view["causes"]), (&"qv-view/1".into(), &1.into()), "{view}");
    let report =
        spoken(&folder, "report --diagnosis out/demo/why --view out/view.html --out out/page/report.html --json");
    assert_eq!(report["format"], "qv-report/1");
    let page = fs::read_to_string(folder.join("out/page/report.html")).unwrap();
    assert!(page.contains("<a href=\"../view.html\">"), "the page links the view");
    // The corrections bring the simulator nearer.
    let off = |name: &str| number(&json(&folder.join(name).join("replay.json"))["windows"]["pos_rms_mean"]);
    assert!(off("out/after") < 0.5 * off("out/replay"), "{} of {}", off("out/after"), off("out/replay"));
}

#[test]
fn who_trains_policies_gets_the_files() {
    let (folder, said) = followed("tutorial_policy");
    for name in ["policy.onnx", "policy.toml", "walk.html"] {
        assert!(folder.join("out/try").join(name).is_file(), "{name}");
    }
    assert!(said[1].states("robots 8"), "{}", said[1]);
    let play = spoken(&folder, "walk play out/try/policy.onnx --seconds 1 --out out/play --json");
    assert_eq!((&play["format"], &play["seconds"]), (&"qv-walk-play/1".into(), &1.0.into()), "{play}");
}
