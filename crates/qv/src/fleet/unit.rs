//! One unit: done once, by whoever has its lock.

use super::child::{self, End, Limits};
use super::folder::Folder;
use super::hash;
use crate::Failure;
use crate::lock::Lock;
use crate::outcome::about;
use crate::output::{self, open_plain, write_whole};
use qv_fleet::state::{Cost, FailedUnit, Kind, UnitRecord};
use qv_fleet::{InputFile, Unit};
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// The variable by which the number of threads of a child is set.
const THREADS: &str = "RAYON_NUM_THREADS";

/// How units are done.
pub struct How<'a> {
    pub limits: Limits,
    /// How often a unit is started again that may pass then.
    pub retries: u32,
    /// Threads of a child; none leaves that to what the user's environment says.
    pub threads: Option<usize>,
    pub stop: &'a AtomicBool,
}

/// How it ended.
pub enum Ending {
    Done(UnitRecord),
    /// It was done before.
    AlreadyDone,
    Failed(FailedUnit),
    Stopped,
}

/// Does a unit that is not done yet.
///
/// # Errors
/// Its folder cannot be written: what fails of the work itself is an ending.
pub fn work(folder: &Folder, unit: &Unit, how: &How) -> Result<Ending, Failure> {
    let place = folder.of(unit);
    if place.is_symlink() {
        return Err(format!("cannot work in '{}': it is a link", place.display()).into());
    }
    fs::create_dir_all(&place).map_err(|e| about(&place, format!("expected to make it, found {e}")))?;
    let Some(lock) = Lock::wait(&place.join("lock"), how.stop)? else { return Ok(Ending::Stopped) };
    // Somebody may have done it meanwhile.
    if folder.done(unit).is_some() {
        return Ok(Ending::AlreadyDone);
    }
    ["done.json", "failed.json"].iter().for_each(|name| remove_record(&place.join(name)));
    let (begun, mut cost) = (Instant::now(), Cost::default());
    let failed = |kind, reason, cost| {
        let failed = FailedUnit::new(unit, kind, reason, cost);
        write_whole(&place.join("failed.json"), failed.to_text().as_bytes())?;
        Ok(Ending::Failed(failed))
    };
    if let Some(reason) = changed(folder, unit) {
        return failed(Kind::InputChanged, reason, cost);
    }
    loop {
        cost.attempts += 1;
        let ended = attempt(folder, unit, how, &lock)?;
        cost.seconds = begun.elapsed().as_secs_f64();
        cost.cpu_seconds += ended.cpu_seconds;
        cost.peak_mib = cost.peak_mib.max(ended.peak_mib);
        let (kind, reason) = match judged(folder, unit, ended.end, &how.limits) {
            UnitVerdict::UnitRecord(code, report) => {
                let done = UnitRecord::new(&folder.plan, unit, code, &report, cost);
                write_whole(&place.join("done.json"), done.to_text().as_bytes())?;
                return Ok(Ending::Done(done));
            }
            UnitVerdict::Stopped => return Ok(Ending::Stopped),
            UnitVerdict::FailedUnit(kind, reason) => (kind, reason),
        };
        if !kind.may_pass() || cost.attempts > how.retries {
            return failed(kind, reason, cost);
        }
    }
}

/// Removes a record of an earlier attempt.
fn remove_record(path: &Path) {
    let record = fs::read(path).ok().and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    if record.is_some_and(|record| record["format"].as_str().is_some_and(|format| format.starts_with("qv-fleet-"))) {
        fs::remove_file(path).ok();
    }
}

/// How the log of a unit begins.
const LOG: &str = "# The log of a unit of qv fleet\n";

/// The log of a unit, emptied. A link is not followed, and a file that does not begin as a log of ours is not changed.
fn log_of(path: &Path) -> Result<File, Failure> {
    let failed = |e: std::io::Error| -> Failure { format!("cannot write '{}': {e}", path.display()).into() };
    let mut options = OpenOptions::new();
    let mut file = open_plain(path, options.read(true).write(true).create(true).truncate(false)).map_err(failed)?;
    let mut begin = vec![];
    (&file).take(LOG.len() as u64).read_to_end(&mut begin).map_err(failed)?;
    // A full disk may have cut it off within its first line.
    if !LOG.as_bytes().starts_with(&begin) {
        return Err(failed(std::io::Error::other("it does not begin as a log of qv fleet")));
    }
    file.set_len(0).and_then(|()| file.rewind()).and_then(|()| file.write_all(LOG.as_bytes())).map_err(failed)?;
    Ok(file)
}

/// What of its inputs is not what it was when the plan was made.
fn changed(folder: &Folder, unit: &Unit) -> Option<String> {
    let base = Path::new(&folder.plan.task.folder);
    let of_recordings = unit.recordings.iter().flat_map(|r| &r.files);
    let differs = |planned: &&InputFile| {
        let found = hash::input(&base.join(&planned.path));
        !found.is_ok_and(|found| found.sha256 == planned.sha256)
    };
    let file = of_recordings.chain(&folder.plan.task.option_files).find(differs)?;
    Some(format!("{}: expected the contents that were planned, found others: plan again", file.path))
}

fn attempt(folder: &Folder, unit: &Unit, how: &How, lock: &Lock) -> Result<child::ChildExit, Failure> {
    let place = folder.of(unit);
    let (out, log) = (place.join("out"), place.join("log.txt"));
    if !folder.plan.task.command.goes_on() {
        output::clear(&out).map_err(|e| about(&out, format!("expected to remove what is ours, found {e}")))?;
    }
    let out = std::path::absolute(&out).map_err(|e| about(&out, e.to_string()))?;
    let file = log_of(&log)?;
    let copy = file.try_clone().map_err(|e| about(&log, e.to_string()))?;
    let program = std::env::current_exe().map_err(|e| format!("expected to know this program, found {e}"))?;
    let task = &folder.plan.task;
    let mut command = Command::new(program);
    command.current_dir(&task.folder);
    // What a unit is done with stands in the plan, all of it.
    command.args(task.command.words()).arg("--no-config").args(unit.recordings.iter().map(|r| &r.path));
    command.arg("--out").arg(out).args(&task.options);
    if let Some(threads) = how.threads.filter(|_| std::env::var_os(THREADS).is_none()) {
        command.env(THREADS, threads.to_string());
    }
    // The child holds the lock as long as it lives, also where this process is killed. It reads nothing from there.
    command.stdin(Stdio::from(lock.copy()?)).stdout(Stdio::from(copy)).stderr(Stdio::from(file));
    Ok(child::run(command, how.limits, how.stop))
}

enum UnitVerdict {
    Done(i32, Vec<u8>),
    Failed(Kind, String),
    Stopped,
}

fn judged(folder: &Folder, unit: &Unit, end: End, limits: &Limits) -> UnitVerdict {
    let command = folder.plan.task.command;
    let (kind, reason) = match end {
        End::Code(code @ (0 | 3)) => match folder.report(unit) {
            Some(report) if serde_json::from_slice::<serde_json::Value>(&report).is_ok() => {
                return UnitVerdict::UnitRecord(code, report);
            }
            _ => (Kind::NoReport, format!("expected {}, found none that can be read", command.report())),
        },
        End::Stopped => return UnitVerdict::Stopped,
        End::Code(2) => (Kind::Usage, last_line(folder, unit)),
        // Somebody else stopped it.
        End::Code(code) if code == i32::from(crate::stop::STOPPED) => (Kind::Killed, "stopped".into()),
        End::Code(1) => (Kind::Failed, last_line(folder, unit)),
        End::Code(code) => (Kind::Failed, format!("exit code {code}: {}", last_line(folder, unit))),
        End::Signal(signal) => (Kind::Killed, format!("signal {signal}")),
        End::Timeout => (Kind::Timeout, format!("longer than {} s", limits.timeout.unwrap_or_default())),
        End::Memory => (Kind::Memory, format!("more than {} MiB", limits.memory.unwrap_or_default())),
        End::NotStarted(reason) => (Kind::NotStarted, reason),
    };
    UnitVerdict::FailedUnit(kind, reason)
}

/// What the command said last.
fn last_line(folder: &Folder, unit: &Unit) -> String {
    let text = fs::read(folder.of(unit).join("log.txt")).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let text = text.strip_prefix(LOG).unwrap_or(&text);
    let mut lines = text.lines().rev().filter(|line| !line.trim().is_empty());
    let line =
        lines.clone().find(|line| line.starts_with("qv: ") || line.starts_with("error: ")).or_else(|| lines.next());
    line.map_or("nothing said".into(), |line| line.trim_start_matches("qv: ").trim_start_matches("error: ").to_owned())
}
