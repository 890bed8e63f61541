//! What commands do to files that are not their own, and what a stop leaves: run as a user would.

mod kills;
#[cfg(unix)]
mod links;
mod options;
mod own_files;
mod plans;
#[cfg(unix)]
mod stops;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// An empty folder for a test.
fn directory(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("safety").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// `qv` with words, in a folder. What is under the cache of whoever runs the tests makes no difference.
fn command(folder: &Path, words: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.current_dir(folder).args(words.split(' ')).env("QV_COLMAP_VENV", folder.join("no_environment"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Exit code, standard output and standard error.
fn remarks(output: &Output) -> (i32, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap_or(-1), text(&output.stdout), text(&output.stderr))
}

fn qv(folder: &Path, words: &str) -> (i32, String, String) {
    remarks(&command(folder, words).output().unwrap())
}

/// Runs `qv` and expects that it ends well.
fn done(folder: &Path, words: &str) {
    let (code, out, err) = qv(folder, words);
    assert!(code == 0 || code == 3, "{words}: {code} {out}{err}");
}

/// Contents of all files below a folder by name, but for what belongs to the making of them.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let (mut all, mut folders) = (BTreeMap::new(), vec![folder.to_path_buf()]);
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(&inside).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
            if entry.file_type().unwrap().is_dir() {
                folders.push(path);
            } else if !is_of_making(&name) {
                all.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    all
}

/// Manifests, locks, logs, and what a later command goes on from.
fn is_of_making(name: &str) -> bool {
    let last = name.rsplit('/').next().unwrap();
    last.starts_with('.')
        || ["qv.lock", "lock", "log.txt", "cost.json"].contains(&last)
        || last.starts_with("unfinished.")
        || name.starts_with("stages/")
}

/// Files that a command leaves when it is killed while it writes.
fn leftovers(folder: &Path) -> Vec<PathBuf> {
    let (mut all, mut folders) = (vec![], vec![folder.to_path_buf()]);
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(&inside).into_iter().flatten().flatten() {
            let path = entry.path();
            if entry.file_type().unwrap().is_dir() {
                folders.push(path);
            } else if path.to_str().unwrap().ends_with(".qv-new") {
                all.push(path);
            }
        }
    }
    all
}

fn copy(from: &Path, to: &Path) {
    let _ = fs::remove_dir_all(to);
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target)
        } else {
            _ = fs::copy(entry.path(), target).unwrap()
        }
    }
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([name, &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
    // It may have ended by itself.
    let _ = sent.success();
}

fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(120), "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

const URDF: &str = "<robot name=\"NAME\"><link name=\"a\"/><link name=\"b\"><inertial><origin xyz=\"0 0 -0.1\"/><mass value=\"0.5\"/>\
    <inertia ixx=\"0.002\" iyy=\"0.002\" izz=\"0.0003\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\
    <joint name=\"shaft\" type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 1 0\"/>\
    <limit lower=\"-9\" upper=\"9\" effort=\"50\" velocity=\"50\"/></joint></robot>";
const RUN: &str = "robot = \"robot.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 10.0\nkd = 0.5\n";

/// A short recording of a shaft.
fn recording(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    let row = |k: usize| {
        let (t, late) = (0.002 * k as f64, 0.002 * (k as f64 - 3.0));
        format!("{t:.3},{:.5},{:.6}\n", 0.3 * (3.0 * t).sin(), 0.3 * (3.0 * late).sin())
    };
    let rows: String = (0..1000).map(row).collect();
    fs::write(folder.join("run.csv"), format!("time,cmd_pos.shaft,pos.shaft\n{rows}")).unwrap();
    fs::write(folder.join("run.toml"), RUN).unwrap();
    fs::write(folder.join("robot.urdf"), URDF).unwrap();
}
