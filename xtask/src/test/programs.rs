//! The test programs of the workspace: which there are, and one run of each.

use super::counts::Counts;
use crate::process;
use crate::workspace::short;
use anyhow::{Context, Result};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A test program that cargo built.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TestProgram {
    /// Crate and target, such as `qv-sim it`.
    pub name: String,
    /// Whether it holds integration tests; else unit tests.
    pub is_integration: bool,
    executable: PathBuf,
    /// Folder of the package, where its tests run.
    folder: PathBuf,
}

/// From this time on the line of a test says how long it took.
const SLOW: Duration = Duration::from_secs(1);

/// What one run of a program gave.
#[derive(Debug)]
pub struct TestRun {
    pub counts: Counts,
    pub succeeded: bool,
    /// Wall time.
    pub wall: Duration,
    /// Processor time of the program and of all that it started; none where the system does not report it.
    pub cpu: Option<Duration>,
    /// All that it printed.
    pub output: String,
}

/// Builds test programs with `cargo test --no-run` and lists them; cargo's own output is passed through.
///
/// # Errors
/// Cargo cannot be started, or a program does not build.
pub fn build(root: &Path, options: &[String]) -> Result<Vec<TestProgram>> {
    let mut cargo = process::cargo();
    cargo.current_dir(root).args(["test", "--no-run", "--message-format=json-render-diagnostics"]).args(options);
    Ok(process::output(&mut cargo)?.lines().filter_map(parse).collect())
}

/// The test program in a line of cargo's messages.
fn parse(line: &str) -> Option<TestProgram> {
    let message: Value = serde_json::from_str(line).ok()?;
    if message["profile"]["test"] != true {
        return None;
    }
    let executable = message["executable"].as_str()?.into();
    let folder: PathBuf = Path::new(message["manifest_path"].as_str()?).parent()?.into();
    let target = &message["target"];
    let is_integration = target["kind"][0] == "test";
    let name = format!("{} {}", short(folder.file_name()?.to_str()?), target["kind"][0].as_str()?);
    Some(TestProgram { name, is_integration, executable, folder })
}

/// Runs the tests of a program one after another, so that the time of each is known.
///
/// # Errors
/// The program cannot be started, or its output cannot be read.
pub fn run(program: &TestProgram, environment: &[(&str, PathBuf)]) -> Result<TestRun> {
    let (output, input) = std::io::pipe().context("making a pipe")?;
    let mut command = Command::new(&program.executable);
    command.current_dir(&program.folder).arg("--test-threads=1").env("CARGO_MANIFEST_DIR", &program.folder);
    command.envs(environment.iter().map(|(name, value)| (name, value)));
    command.stdin(Stdio::null()).stdout(input.try_clone().context("doubling a pipe")?).stderr(input);
    let clock = Instant::now();
    let mut child = command.spawn().with_context(|| format!("cannot start {command:?}"))?;
    // The command holds the writing end; without it the reading end meets the end of the output.
    drop(command);
    let mut run =
        TestRun { counts: Counts::default(), succeeded: false, wall: Duration::ZERO, cpu: None, output: String::new() };
    let mut ended = 0;
    for line in BufReader::new(output).split(b'\n') {
        let line = line.with_context(|| format!("reading from {}", program.name))?;
        let line = String::from_utf8_lossy(&line);
        run.counts.add_line(&line, clock.elapsed());
        run.output.push_str(&line);
        let took = run.counts.durations.last().filter(|_| run.counts.durations.len() > ended).map(|(_, took)| *took);
        ended = run.counts.durations.len();
        if let Some(took) = took.filter(|took| *took >= SLOW) {
            run.output.push_str(&format!(" in {:.1} s", took.as_secs_f64()));
        }
        run.output.push('\n');
    }
    run.cpu = processor_time(&child);
    run.succeeded = child.wait().with_context(|| format!("waiting for {}", program.name))?.success();
    run.wall = clock.elapsed();
    if !run.succeeded && run.counts.failed == 0 {
        // It died before it printed a result.
        run.counts.failed = 1;
    }
    Ok(run)
}

/// Processor time of a child that has ended but has not been waited for, and of its own children; Linux reports it until then.
fn processor_time(child: &Child) -> Option<Duration> {
    /// Ticks of Linux's clock a second, the same on every machine.
    const TICKS: f64 = 100.0;
    let file = format!("/proc/{}/stat", child.id());
    let deadline = Instant::now() + Duration::from_secs(2);
    loop {
        let text = std::fs::read_to_string(&file).ok()?;
        // The name, in parentheses, may hold spaces.
        let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
        if fields.first() == Some(&"Z") {
            let ticks = fields.get(11..15)?.iter().filter_map(|field| field.parse::<f64>().ok()).sum::<f64>();
            return Some(Duration::from_secs_f64(ticks / TICKS));
        }
        if Instant::now() > deadline {
            return None;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = r#"{"reason":"compiler-artifact","manifest_path":"/w/crates/qv-sim/Cargo.toml","target":{"kind":["test"],"name":"it"},
        "profile":{"test":true},"executable":"/w/target/debug/deps/it-1"}"#;

    #[test]
    fn a_test_program_is_read_from_a_message_of_cargo() {
        let found = parse(LINE).unwrap();
        assert_eq!((found.name.as_str(), found.is_integration), ("qv-sim test", true));
        assert_eq!(found.executable, Path::new("/w/target/debug/deps/it-1"));
        assert_eq!(parse(&LINE.replace("\"test\":true", "\"test\":false")), None, "a plain library");
        assert_eq!(parse("warning: something"), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_processor_time_of_a_child_is_read() {
        let mut child =
            Command::new("sh").args(["-c", "i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done"]).spawn().unwrap();
        let cpu = processor_time(&child).unwrap();
        assert!(child.wait().unwrap().success());
        assert!(cpu > Duration::from_millis(10) && cpu < Duration::from_secs(60), "{cpu:?}");
    }
}
