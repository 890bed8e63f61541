//! `qv fleet`: plans, runs that are stopped, killed and started again, limits, and what is gathered.

use crate::bags::{directory, qv};
use crate::facts::States;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const URDF: &str = "<robot name=\"NAME\"><link name=\"a\"/><link name=\"b\"><inertial><origin xyz=\"0 0 -0.1\"/><mass value=\"0.5\"/>\
    <inertia ixx=\"0.002\" iyy=\"0.002\" izz=\"0.0003\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\
    <joint name=\"shaft\" type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 1 0\"/>\
    <limit lower=\"-9\" upper=\"9\" effort=\"50\" velocity=\"50\"/></joint></robot>";
const TOML: &str = "robot = \"robot.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 10.0\nkd = 0.5\n";

/// A short recording of a shaft; `number` makes it differ from others.
fn recording(folder: &Path, robot: &str, number: usize) {
    fs::create_dir_all(folder).unwrap();
    let row = |k: usize| {
        let (t, late) = (0.002 * k as f64, 0.002 * (k as f64 - 3.0));
        format!("{t:.3},{:.5},{:.6}\n", 0.3 * (3.0 * t).sin(), 0.3 * (3.0 * late).sin() + 1e-5 * number as f64)
    };
    let rows: String = (0..1000).map(row).collect();
    fs::write(folder.join("run.csv"), format!("time,cmd_pos.shaft,pos.shaft\n{rows}")).unwrap();
    fs::write(folder.join("run.toml"), TOML).unwrap();
    fs::write(folder.join("robot.urdf"), URDF.replace("NAME", robot)).unwrap();
}

/// A laboratory with recordings, each with what its rehearsal is to do; and the folder of its fleet.
fn laboratory(name: &str, parts: &[&str]) -> (PathBuf, String) {
    let root = directory(name);
    for (k, part) in parts.iter().enumerate() {
        let robot = if k % 2 == 0 { "rex" } else { "bello" };
        let folder = root.join("lab").join(robot).join(format!("day{k:02}"));
        recording(&folder, robot, k);
        fs::write(folder.join("rehearse.json"), part).unwrap();
    }
    let fleet = root.join("fleet").display().to_string();
    (root, fleet)
}

fn plan(root: &Path, fleet: &str, more: &[&str]) -> (i32, String, String) {
    let lab = root.join("lab").display().to_string();
    qv(&[&["fleet", "plan", &lab, "--out", fleet], more].concat())
}

fn rehearsed(root: &Path, fleet: &str) {
    let (code, out, err) = plan(root, fleet, &["--command", "rehearse"]);
    assert_eq!(code, 0, "{out}{err}");
}

fn json(path: impl AsRef<Path>) -> Value {
    serde_json::from_slice(&fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.as_ref().display()))).unwrap()
}

/// How often the command of each unit was started, in the order of the plan.
fn starts(fleet: &str) -> Vec<usize> {
    let plan = json(Path::new(fleet).join("plan.json"));
    let of = |unit: &Value| Path::new(fleet).join("units").join(unit["id"].as_str().unwrap()).join("starts.txt");
    let count = |unit| fs::read_to_string(of(unit)).map_or(0, |text| text.lines().count());
    plan["units"].as_array().unwrap().iter().map(count).collect()
}

fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(30), "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn start(arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn a_plan_names_what_it_found_and_what_it_cannot_use() {
    let (root, fleet) = laboratory("fleet_plan", &["{}"; 5]);
    fs::create_dir_all(root.join("lab/odd")).unwrap();
    fs::write(root.join("lab/odd/run.mcap"), "no bag").unwrap();
    let twice = root.join("lab/rex/copy");
    recording(&twice, "rex", 0);
    fs::write(twice.join("rehearse.json"), "{}").unwrap();
    let (code, out, err) = plan(&root, &fleet, &["--command", "rehearse"]);
    assert_eq!(code, 3, "{out}{err}");
    assert!(out.contains("odd/run.mcap") && out.states("day00") && out.states("fleet"), "{out}");
    let first = fs::read(Path::new(&fleet).join("plan.json")).unwrap();
    let planned: Value = serde_json::from_slice(&first).unwrap();
    let robots: Vec<&str> = planned["units"].as_array().unwrap().iter().map(|u| u["robot"].as_str().unwrap()).collect();
    assert_eq!(robots.iter().filter(|r| r.starts_with("rex (")).count(), 3);
    assert_eq!(robots.len(), 5);
    let files = planned["units"][0]["recordings"][0]["files"].as_array().unwrap();
    assert!(files.len() == 4 && files.iter().all(|f| f["sha256"].as_str().unwrap().len() == 64), "{files:?}");
    // Again, the same bytes; grouped, a unit for each robot; by folder, robots are folders.
    plan(&root, &fleet, &["--command", "rehearse", "--jobs", "4"]);
    assert_eq!(fs::read(Path::new(&fleet).join("plan.json")).unwrap(), first);
    plan(&root, &fleet, &["--command", "rehearse", "--group", "--robots-by", "folder"]);
    let planned = json(Path::new(&fleet).join("plan.json"));
    let names: Vec<&str> = planned["units"].as_array().unwrap().iter().map(|u| u["robot"].as_str().unwrap()).collect();
    assert_eq!(names, ["bello", "rex"]);
}

#[test]
fn wrong_plans_are_refused() {
    let (root, fleet) = laboratory("fleet_wrong", &["{}"]);
    for (options, words) in [
        (vec!["--", "--sed", "3"], "expected those of qv diagnose, found: unexpected argument '--sed'"),
        (vec!["--", "--out", "x"], "a fleet sets itself, found --out"),
        (vec!["--command", "contact"], "--terrain"),
    ] {
        let (code, _, err) = plan(&root, &fleet, &options);
        assert!(code == 1 && (err.contains(words) || err.states("arguments")), "{code} {err}");
    }
    let (code, _, err) = qv(&["fleet", "run", &fleet]);
    assert!(code == 1 && err.states("plan.json `qv plan`"), "{err}");
    fs::create_dir_all(root.join("empty")).unwrap();
    let unmade = root.join("unmade");
    let (code, _, err) =
        qv(&["fleet", "plan", root.join("empty").to_str().unwrap(), "--out", unmade.to_str().unwrap()]);
    assert!(code == 1 && err.states("recordings"), "{err}");
    assert!(!unmade.exists(), "a plan of nothing left something behind");
    rehearsed(&root, &fleet);
    let path = Path::new(&fleet).join("plan.json");
    let other = fs::read_to_string(&path).unwrap().replacen(env!("CARGO_PKG_VERSION"), "0.0.7", 1);
    fs::write(&path, other).unwrap();
    let (code, _, err) = qv(&["fleet", "run", &fleet]);
    assert!(code == 1 && err.states("0.0.7 0.0.7"), "{err}");
}

#[test]
fn only_what_is_missing_is_done_and_the_summary_is_the_same() {
    let late = |ms: f64| {
        format!(
            "{{\"report\": {{\"verdict\": \"explained\", \"sentence\": \"late\", \"gap\": {{\"after\": 1.0}}, \"causes\": [{{\"effect\": \
             \"command_latency\", \"scope\": [\"all\"], \"parameters\": [{{\"name\": \"latency\", \"value\": {ms}, \"ci95\": [{}, {}], \
             \"unit\": \"ms\"}}]}}]}}}}",
            ms - 0.5,
            ms + 0.5
        )
    };
    let parts: Vec<String> = (0..6).map(|k| late(8.0 + 0.1 * f64::from(k))).collect();
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let (root, fleet) = laboratory("fleet_again", &parts);
    rehearsed(&root, &fleet);
    let (code, out, err) = qv(&["fleet", "run", &fleet, "--unit", "4"]);
    assert_eq!(code, 0, "{out}{err}");
    assert_eq!(starts(&fleet), [0, 0, 0, 0, 1, 0]);
    let (code, _, _) = qv(&["fleet", "gather", &fleet]);
    assert_eq!(code, 3, "five are missing");
    let (code, out, err) = qv(&["fleet", "run", &fleet, "--jobs", "3"]);
    assert!(code == 0 && out.states("before 6 6 1"), "{out}{err}");
    let (_, out, _) = qv(&["fleet", "run", &fleet, "--json"]);
    let line: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((line["before"].as_u64(), line["core_hours"].as_f64()), (Some(6), Some(0.0)));
    assert_eq!(starts(&fleet), [1; 6]);
    let (code, out, _) = qv(&["fleet", "gather", &fleet]);
    assert!(code == 0 && out.contains("command_latency") && out.contains("core-hours"), "{out}");
    let read = |fleet: &str| ["fleet.json", "fleet.html"].map(|name| fs::read(Path::new(fleet).join(name)).unwrap());
    let other = root.join("other").display().to_string();
    rehearsed(&root, &other);
    for unit in ["5", "0-2", "3-9"] {
        assert_eq!(qv(&["fleet", "run", &other, "--unit", unit]).0, 0);
    }
    qv(&["fleet", "gather", &other]);
    assert!(read(&fleet) == read(&other), "one after the other and elsewhere");
    // What is not as it was left is done again.
    let planned = json(Path::new(&fleet).join("plan.json"));
    let unit = Path::new(&fleet).join("units").join(planned["units"][2]["id"].as_str().unwrap());
    fs::write(unit.join("out/report.json"), "{}").unwrap();
    assert_eq!(qv(&["fleet", "run", &fleet]).0, 0);
    assert_eq!(starts(&fleet), [1, 1, 2, 1, 1, 1]);
    qv(&["fleet", "gather", &fleet]);
    assert!(read(&fleet) == read(&other));
}

#[test]
fn limits_and_failures_are_told_apart() {
    let parts = [
        "{\"seconds\": 30}",
        "{\"mib\": 400, \"seconds\": 20}",
        "{\"exit\": 1}",
        "{\"exit\": 3}",
        "{\"dies_first\": true}",
        "{\"is_mute\": true}",
        "{}",
    ];
    let (root, fleet) = laboratory("fleet_limits", &parts);
    rehearsed(&root, &fleet);
    let run = ["fleet", "run", &fleet, "--jobs", "2", "--timeout", "2", "--retries", "1", "--json", "--memory", "200"];
    let (code, out, err) = if cfg!(target_os = "linux") { qv(&run) } else { qv(&run[..run.len() - 2]) };
    assert_eq!(code, 3, "{out}{err}");
    let line: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(
        (line["done"].as_u64(), line["findings"].as_u64(), line["failed"].as_u64()),
        (Some(3), Some(1), Some(4))
    );
    qv(&["fleet", "gather", &fleet]);
    let summary = json(Path::new(&fleet).join("fleet.json"));
    let mut kinds: Vec<&str> =
        summary["failures"].as_array().unwrap().iter().map(|f| f["kind"].as_str().unwrap()).collect();
    kinds.sort_unstable();
    let memory = if cfg!(target_os = "linux") { "memory" } else { "timeout" };
    assert!(kinds.contains(&"failed") && kinds.contains(&"no_report") && kinds.contains(&"timeout"), "{kinds:?}");
    assert!(kinds.contains(&memory), "{kinds:?}");
    let said = summary["failures"].as_array().unwrap().iter().find(|f| f["kind"] == "failed").unwrap();
    assert_eq!(said["reason"], "cannot read 'RECORDING': expected a rehearsal that ends well, found exit 1");
    // By robot, then by day: bello 1, 3, 5, rex 0, 2, 4, 6. What was killed is started again, what a command says is believed.
    assert_eq!(starts(&fleet), [2, 1, 2, 2, 1, 2, 1]);
    let html = fs::read_to_string(Path::new(&fleet).join("fleet.html")).unwrap();
    assert!(html.states("rehearsal") && html.states("slow"));
    let (code, _, err) = qv(&["fleet", "run", &fleet, "--unit", "4"]);
    assert!(code == 1 && err.states("exit 1"), "{err}");
    assert_eq!(qv(&["fleet", "run", &fleet, "--unit", "1"]).0, 3, "a finding stays one");
    assert_eq!(qv(&["fleet", "run", &fleet, "--unit", "7"]).0, 1, "no such unit");
}

#[test]
fn a_recording_that_changed_is_no_longer_the_planned_one() {
    let (root, fleet) = laboratory("fleet_changed", &["{}", "{}"]);
    rehearsed(&root, &fleet);
    recording(&root.join("lab/rex/day00"), "rex", 99);
    let (code, _, err) = qv(&["fleet", "run", &fleet]);
    assert!(code == 3 && err.states("recording") && err.states("again"), "{err}");
    rehearsed(&root, &fleet);
    let (code, out, _) = qv(&["fleet", "run", &fleet]);
    assert!(code == 0 && out.states("before 1"), "what is done and still wanted stays: {out}");
}

/// Starts a run whose first unit takes long, and waits until it does.
fn busy(name: &str) -> (String, Child) {
    let (root, fleet) = laboratory(name, &["{}", "{\"seconds\": 60}", "{}"]);
    rehearsed(&root, &fleet);
    let child = start(&["fleet", "run", &fleet, "--jobs", "1"]);
    until("the unit starts", || starts(&fleet)[0] == 1);
    (fleet, child)
}

/// Makes the long unit short, as if it took the time that it takes; the plan is made again for it.
fn shorten(fleet: &str) {
    let root = Path::new(fleet).parent().unwrap();
    fs::write(root.join("lab/bello/day01/rehearse.json"), "{}").unwrap();
    rehearsed(root, fleet);
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_stopped_goes_on() {
    let (fleet, child) = busy("fleet_stopped");
    let (code, _, err) = qv(&["fleet", "run", &fleet]);
    assert!(code == 1 && err.states("process"), "{err}");
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(130) && err.states("command"), "{err}");
    let unit = fs::read_dir(Path::new(&fleet).join("units")).unwrap().next().unwrap().unwrap().path();
    let pid = fs::read_to_string(unit.join("starts.txt")).unwrap();
    assert!(!Path::new("/proc").join(pid.trim()).exists(), "its child ended with it");
    shorten(&fleet);
    assert_eq!(qv(&["fleet", "run", &fleet]).0, 0);
    assert!(starts(&fleet).iter().all(|&n| n == 1));
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_killed_leaves_a_lock_that_is_taken_over() {
    let (fleet, mut child) = busy("fleet_killed");
    signal(&child, "-KILL");
    child.wait().unwrap();
    shorten(&fleet);
    let (code, _, err) = qv(&["fleet", "run", &fleet]);
    assert_eq!(code, 0, "{err}");
    assert!(starts(&fleet).iter().all(|&n| n == 1));
    // The plan is made under the same lock, and reported of it; here it is left once more.
    fs::write(Path::new(&fleet).join("lock"), "process 1234567 on nowhere").unwrap();
    let (code, _, err) = qv(&["fleet", "run", &fleet]);
    assert!(code == 0 && err.states("process 1234567"), "{err}");
}

#[test]
fn two_tasks_for_one_unit_do_it_once() {
    let (root, fleet) = laboratory("fleet_twice", &["{\"seconds\": 1}"]);
    rehearsed(&root, &fleet);
    let tasks: Vec<Child> = (0..3).map(|_| start(&["fleet", "run", &fleet, "--unit", "0"])).collect();
    for task in tasks {
        let output = task.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_eq!(starts(&fleet), [1]);
}

#[test]
fn a_job_array_does_all_units() {
    let (root, fleet) = laboratory("fleet_slurm", &["{}", "{\"exit\": 3}", "{}"]);
    rehearsed(&root, &fleet);
    let program = env!("CARGO_BIN_EXE_qv");
    let (code, script, err) =
        qv(&["fleet", "slurm", &fleet, "--program", program, "--units-per-task", "2", "--timeout", "60"]);
    assert!(code == 0 && script.contains("#SBATCH --array=0-1\n"), "{script}{err}");
    let file = root.join("array.sh");
    fs::write(&file, script).unwrap();
    if Command::new("bash").arg("--version").stdout(Stdio::null()).status().is_err() {
        return crate::skipped::skipped("no bash");
    }
    for task in ["0", "1"] {
        let mut bash = Command::new("bash");
        let output = bash.arg(&file).env("SLURM_ARRAY_TASK_ID", task).env("SLURM_CPUS_PER_TASK", "1").output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_eq!(starts(&fleet), [1; 3]);
    assert_eq!(qv(&["fleet", "gather", &fleet]).0, 0);
}

#[test]
fn a_workflow_of_snakemake_does_all_units() {
    let program = std::env::var("SNAKEMAKE").unwrap_or_else(|_| "snakemake".into());
    if Command::new(&program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
        return crate::skipped::skipped("no snakemake on the path, nor in the variable SNAKEMAKE");
    }
    let (root, fleet) = laboratory("fleet_snakemake", &["{}", "{\"exit\": 3}", "{\"exit\": 1}", "{}"]);
    rehearsed(&root, &fleet);
    let (code, text, err) =
        qv(&["fleet", "snakemake", &fleet, "--program", env!("CARGO_BIN_EXE_qv"), "--retries", "1"]);
    assert_eq!(code, 0, "{err}");
    let file = root.join("Snakefile");
    fs::write(&file, text).unwrap();
    let snakemake = || {
        let mut command = Command::new(&program);
        command.current_dir(&root).args(["--cores", "2", "--keep-going", "-s"]).arg(&file);
        command.env("XDG_CACHE_HOME", root.join("cache")).output().unwrap()
    };
    let output = snakemake();
    assert!(!output.status.success(), "one unit fails");
    let summary = json(Path::new(&fleet).join("fleet.json"));
    let counts = ["done", "finding", "failed", "missing"].map(|state| summary["counts"][state].as_u64().unwrap());
    assert_eq!(counts, [2, 1, 1, 0], "{}", String::from_utf8_lossy(&output.stderr));
    // Again: only what failed.
    snakemake();
    assert_eq!(starts(&fleet), [1, 1, 1, 2]);
}

#[test]
fn recordings_are_diagnosed() {
    let (root, fleet) = laboratory("fleet_diagnosed", &["{}"]);
    assert_eq!(plan(&root, &fleet, &["--", "--seed", "2"]).0, 0);
    let (code, out, err) = qv(&["fleet", "run", &fleet, "--timeout", "300"]);
    assert!(code == 0 || code == 3, "{out}{err}");
    assert_eq!(qv(&["fleet", "gather", &fleet]).0, 0);
    let summary = json(Path::new(&fleet).join("fleet.json"));
    assert_eq!(summary["options"], serde_json::json!(["--seed", "2"]));
    assert!(!summary["units"][0]["verdict"].as_str().unwrap().is_empty(), "{summary:#}");
    let unit = Path::new(&fleet).join("units").join(summary["units"][0]["id"].as_str().unwrap());
    assert!(
        unit.join("out/report.html").is_file()
            && json(unit.join("done.json"))["cost"]["cpu_seconds"].as_f64() > Some(0.0)
    );
}
