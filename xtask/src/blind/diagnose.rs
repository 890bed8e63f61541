//! `qv diagnose` on every recording.

use super::generate::bar;
use anyhow::{Context, Result, bail};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// How the diagnoses are run.
pub struct Diagnoses<'a> {
    /// The program.
    pub qv: &'a Path,
    /// The rivals' program and its first arguments; none where they do not run.
    pub rivals: &'a [PathBuf],
    /// How many at a time.
    pub jobs: usize,
    /// After so long no other is begun.
    pub at_most: Option<Duration>,
}

/// Effects taken out of the library in turn, the likeliest first: where the right one is among them, that is its
/// leave-one-out without reporting the diagnosis which it is. Each costs as much as the diagnosis.
const LEAVE_OUT: &str = "1";
/// Every so manieth recording is diagnosed with effects taken out, too.
const LEAVES_OUT: usize = 3;

/// Does something with each of some recordings, so many at a time, and begins no other after `at_most`; with a progress bar. `one` gets its number, too.
///
/// # Errors
/// The first error of `one`, after which none is begun.
pub fn each<T: Sync>(
    all: &[T],
    jobs: usize,
    at_most: Option<Duration>,
    one: impl Fn(usize, &T) -> Result<()> + Sync,
) -> Result<()> {
    let bar = bar(all.len(), "diagnosing");
    let (next, failure, clock) = (AtomicUsize::new(0), Mutex::new(None), Instant::now());
    let is_late = || at_most.is_some_and(|most| clock.elapsed() > most);
    let work = || {
        loop {
            let turn = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = all.get(turn).filter(|_| !is_late()) else { break };
            if let Err(error) = one(turn, item) {
                next.store(all.len(), Ordering::Relaxed);
                failure.lock().expect("no thread panics with it").get_or_insert(error);
            }
            bar.inc(1);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(work);
        }
    });
    bar.finish_and_clear();
    failure.into_inner().expect("no thread panics with it").map_or(Ok(()), Err)
}

impl Diagnoses<'_> {
    /// Diagnoses all `names` in `recordings` that have no report in `reports` yet. A diagnosis that fails is said, and
    /// leaves none; those that time was not left for have no folder.
    ///
    /// # Errors
    /// The program cannot be started, or a folder cannot be written.
    pub fn run(&self, names: &[&String], recordings: &Path, reports: &Path) -> Result<()> {
        fs::create_dir_all(reports).with_context(|| format!("making {}", reports.display()))?;
        let one = |turn: usize, name: &&String| {
            self.one(&recordings.join(name), &reports.join(name), turn.is_multiple_of(LEAVES_OUT))
        };
        each(names, self.jobs, self.at_most, one)
    }

    /// # Errors
    /// The program cannot diagnose.
    pub fn check(&self) -> Result<()> {
        let mut help = Command::new(self.qv);
        if !crate::process::works(help.args(["diagnose", "--help"])) {
            bail!("expected {} to have the command diagnose, found none", self.qv.display());
        }
        Ok(())
    }

    fn one(&self, recording: &Path, out: &Path, leaves_out: bool) -> Result<()> {
        let stamp = out.join("done.json");
        if stamp.is_file() {
            return Ok(());
        }
        if out.exists() {
            fs::remove_dir_all(out).with_context(|| format!("removing {}", out.display()))?;
        }
        fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
        let log = File::create(out.join("log.txt")).with_context(|| format!("writing in {}", out.display()))?;
        let mut command = Command::new(self.qv);
        from_to(command.arg("diagnose"), recording, out);
        if leaves_out {
            command.args(["--leave-out", LEAVE_OUT]);
        }
        let mut commands = vec![command];
        if let [program, script @ ..] = self.rivals {
            let mut command = Command::new(program);
            from_to(command.args(script).env("PYTHONDONTWRITEBYTECODE", "1"), recording, out);
            commands.push(command);
        }
        let clock = Instant::now();
        for command in &mut commands {
            command.stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log.try_clone()?);
            let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
            // 3 is done with part of the input lost.
            if !matches!(status.code(), Some(0 | 3)) {
                eprintln!("{}: {status}, see {}", recording.display(), out.join("log.txt").display());
                return Ok(());
            }
        }
        let seconds = clock.elapsed().as_secs_f64();
        fs::write(&stamp, format!("{{\"seconds\": {seconds:.2}}}\n"))
            .with_context(|| format!("writing {}", stamp.display()))
    }
}

/// Says what to read and where to write.
fn from_to(command: &mut Command, recording: &Path, out: &Path) {
    // Tables are of arms, which stand on nothing.
    match recording.join("run.mcap") {
        bag if bag.is_file() => command.arg(bag).args(["--terrain", "plane"]),
        _ => command.arg(recording),
    };
    command.arg("--out").arg(out);
}

/// Where the reports of this program on these recordings lie.
pub fn reports_folder(recordings: &Path, program: u64) -> PathBuf {
    recordings.with_file_name("reports").join(format!("{program:016x}"))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    /// Stands in for `qv`: writes the recording's own bytes as the report, and fails on an empty recording.
    const PROGRAM: &str = "#!/bin/sh\n[ \"$2\" = --help ] && exit 0\n\
        echo run >> \"$(dirname \"$0\")/count\"\n[ -s \"$2\" ] || exit 1\ncp \"$2\" \"$6/report.json\"\nexit 3\n";

    #[test]
    fn each_recording_is_diagnosed_once_and_failures_are_tried_again() {
        let folder = std::env::temp_dir().join(format!("qv-diagnoses-{}", std::process::id()));
        let recordings = folder.join("recordings");
        for (name, bytes) in [("a", "A"), ("b", ""), ("c", "C")] {
            fs::create_dir_all(recordings.join(name)).unwrap();
            fs::write(recordings.join(name).join("run.mcap"), bytes).unwrap();
        }
        let qv = folder.join("qv");
        fs::write(&qv, PROGRAM).unwrap();
        fs::set_permissions(&qv, fs::Permissions::from_mode(0o755)).unwrap();
        let diagnoses = Diagnoses { qv: &qv, rivals: &[], jobs: 2, at_most: None };
        diagnoses.check().unwrap();
        let names = ["a", "b", "c"].map(String::from);
        let names: Vec<&String> = names.iter().collect();
        let reports = reports_folder(&recordings, 7);
        let runs = || fs::read_to_string(folder.join("count")).unwrap().lines().count();
        diagnoses.run(&names, &recordings, &reports).unwrap();
        assert_eq!(runs(), 3);
        assert_eq!(fs::read_to_string(reports.join("c/report.json")).unwrap(), "C");
        assert!(reports.join("a/done.json").is_file() && !reports.join("b/done.json").exists());
        diagnoses.run(&names, &recordings, &reports).unwrap();
        assert_eq!(runs(), 4, "only what failed is run again");
        let late = Diagnoses { qv: &qv, rivals: &[], jobs: 1, at_most: Some(Duration::ZERO) };
        late.run(&names, &recordings, &reports_folder(&recordings, 8)).unwrap();
        assert!(runs() == 4 && !reports_folder(&recordings, 8).join("a").exists(), "no time is left");
        // The rivals are called after the diagnosis, with the same recording and folder.
        let rivals = folder.join("rivals");
        fs::write(&rivals, "#!/bin/sh\n[ -s \"$5/report.json\" ] && cp \"$1\" \"$5/baselines.json\"\n").unwrap();
        fs::set_permissions(&rivals, fs::Permissions::from_mode(0o755)).unwrap();
        let beside = Diagnoses { qv: &qv, rivals: &[rivals], jobs: 1, at_most: None };
        let reports = reports_folder(&recordings, 9);
        beside.run(&names, &recordings, &reports).unwrap();
        assert_eq!(fs::read_to_string(reports.join("c/baselines.json")).unwrap(), "C");
        assert!(!reports.join("b/baselines.json").exists());
        let missing = Diagnoses { qv: &folder.join("no-qv"), rivals: &[], jobs: 1, at_most: None };
        assert!(missing.check().unwrap_err().to_string().contains("no-qv"));
        fs::remove_dir_all(&folder).unwrap();
    }
}
