//! `qv fleet run`: the units of a plan, several at once.

use super::child::{Limits, watches_memory};
use super::folder::Folder;
use super::unit::{Ending, How, work};
use crate::numbers::positive;
use crate::progress::{Level, duration, reports, spinner};
use crate::terminal::{print_message, shown};
use crate::{Failure, Outcome, say};
use qv_fleet::Unit;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

/// Seconds from one line about progress to the next, where standard error is no terminal.
const EVERY: f64 = 10.0;

#[derive(clap::Args)]
pub struct Run {
    /// Directory of the fleet, with plan.json of `qv fleet plan`
    #[arg(value_name = "FLEET")]
    folder: PathBuf,
    /// Run N units at once [default: number of processors]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096), help_heading = "Advanced")]
    jobs: Option<u16>,
    /// Kill a unit that exceeds this memory (Linux)
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..), help_heading = "Advanced")]
    memory: Option<u64>,
    /// Kill a unit that runs longer
    #[arg(long, value_name = "SECONDS", value_parser = positive, help_heading = "Advanced")]
    timeout: Option<f64>,
    /// Restart a killed unit up to K times
    #[arg(long, default_value_t = 0, value_name = "K", value_parser = clap::value_parser!(u32).range(0..=100), help_heading = "Advanced")]
    retries: u32,
    /// Run one unit: index from 0, range such as 0-9, or identity
    #[arg(long, value_name = "I", help_heading = "Input")]
    unit: Option<String>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

/// What came of it so far.
#[derive(Default)]
struct Tally {
    done: usize,
    /// Of `done`: those that ended with 3.
    findings: usize,
    failed: usize,
    /// Done before this run.
    before: usize,
    cpu_seconds: f64,
    /// The first failure that keeps this run from going on.
    broken: Option<String>,
    /// The last failure of a unit.
    last: Option<String>,
}

impl Run {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        if self.memory.is_some() && !watches_memory() {
            return Err(
                "--memory: expected Linux, where the memory of a process can be watched, found another system".into()
            );
        }
        let folder = Folder::open_to_work(&self.folder)?;
        // Tasks of a cluster work beside each other: each has the lock of its unit.
        let _lock = if self.unit.is_none() { Some(Folder::lock(&self.folder)?) } else { None };
        let all = match &self.unit {
            Some(asked) => folder.plan.find(asked)?,
            None => (0..folder.plan.units.len()).collect(),
        };
        let mut tally = Tally::default();
        let mut wanted = Vec::new();
        for unit in all.iter().map(|&k| &folder.plan.units[k]) {
            match folder.done(unit) {
                None => wanted.push(unit),
                Some((done, _)) => {
                    tally.before += 1;
                    tally.done += 1;
                    tally.findings += usize::from(done.exit_code == 3);
                }
            }
        }
        let stop = crate::stop::asked();
        let (begun, total) = (Instant::now(), all.len());
        let tally = self.work_on(&folder, &wanted, tally, total, &stop);
        if let Some(why) = &tally.broken {
            return Err(why.clone().into());
        }
        let seconds = begun.elapsed().as_secs_f64();
        say(&if self.json { line(&tally, total, seconds) } else { self.summary(&tally, total, seconds) })?;
        self.outcome(&tally, total, stop.load(Ordering::Relaxed))
    }

    fn work_on(&self, folder: &Folder, wanted: &[&Unit], tally: Tally, total: usize, stop: &AtomicBool) -> Tally {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = self.jobs.map_or(processors, usize::from).min(wanted.len()).max(1);
        let threads = self.unit.is_none().then(|| (processors / jobs).max(1));
        let limits = Limits { memory: self.memory, timeout: self.timeout };
        let how = How { limits, retries: self.retries, threads, stop };
        let (next, remarks) = (AtomicUsize::new(0), Reporter::new(total, wanted.len()));
        let tally = Mutex::new(tally);
        std::thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(|| {
                    while let Some(unit) = wanted.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if stop.load(Ordering::Relaxed) {
                            break;
                        }
                        let ending = work(folder, unit, &how).map_err(|e| e.to_string());
                        let mut tally = tally.lock().unwrap_or_else(|e| e.into_inner());
                        tally.count(unit, ending, &remarks);
                        if tally.broken.is_some() {
                            // The folder cannot be written: no unit can be done.
                            stop.store(true, Ordering::Relaxed);
                        }
                        remarks.notify(&tally);
                    }
                });
            }
        });
        remarks.finish();
        tally.into_inner().unwrap_or_else(|e| e.into_inner())
    }

    fn summary(&self, tally: &Tally, total: usize, seconds: f64) -> String {
        let Tally { done, findings, failed, before, cpu_seconds, .. } = tally;
        format!(
            "{done} of {total} units are done ({before} before, {findings} with exit code 3), {failed} failed; \
             {:.4} core-hours in {}\nnext: qv fleet gather {}\n",
            cpu_seconds / 3600.0,
            duration(seconds),
            self.folder.display()
        )
    }

    fn outcome(&self, tally: &Tally, total: usize, is_stopped: bool) -> Result<Outcome, Failure> {
        if is_stopped {
            print_message!("stopped; the same command goes on");
            return Ok(Outcome::Stopped);
        }
        match (&tally.last, tally.done) {
            (Some(why), 0) if total == 1 => Err(why.clone().into()),
            (Some(why), 0) => Err(format!("expected units that can be done, found none; the last: {why}").into()),
            (Some(_), _) => Ok(Outcome::Partial),
            (None, _) => Ok(if tally.findings > 0 { Outcome::Partial } else { Outcome::Done }),
        }
    }
}

impl Tally {
    fn count(&mut self, unit: &Unit, ending: Result<Ending, String>, remarks: &Reporter) {
        match ending {
            Ok(Ending::Done(done)) => {
                self.done += 1;
                self.findings += usize::from(done.exit_code == 3);
                self.cpu_seconds += done.cost.cpu_seconds;
            }
            Ok(Ending::AlreadyDone) => {
                self.done += 1;
                self.before += 1;
            }
            Ok(Ending::Failed(failed)) => {
                self.failed += 1;
                self.cpu_seconds += failed.cost.cpu_seconds;
                let paths: Vec<&str> = unit.recordings.iter().map(|r| r.path.as_str()).collect();
                let why = format!("{} ({}): {}: {}", unit.id, paths.join(", "), failed.kind.words(), failed.reason);
                remarks.line(&why);
                self.last = Some(why);
            }
            Ok(Ending::Stopped) => {}
            Err(why) => self.broken = Some(why),
        }
    }
}

fn line(tally: &Tally, total: usize, seconds: f64) -> String {
    let value = serde_json::json!({"format": "qv-fleet-ran/1", "units": total, "done": tally.done, "before": tally.before,
        "findings": tally.findings, "failed": tally.failed, "core_hours": tally.cpu_seconds / 3600.0, "seconds": seconds});
    format!("{value}\n")
}

/// Reports how far it is.
struct Reporter {
    bar: indicatif::ProgressBar,
    has_lines: bool,
    begun: Instant,
    last: Mutex<f64>,
    total: usize,
    /// How many were to be done when it began.
    wanted: usize,
}

impl Reporter {
    fn new(total: usize, wanted: usize) -> Self {
        let has_lines = reports(Level::Normal) && !std::io::stderr().is_terminal();
        Self { bar: spinner(""), has_lines, begun: Instant::now(), last: Mutex::new(0.0), total, wanted }
    }

    fn notify(&self, tally: &Tally) {
        let at = self.begun.elapsed().as_secs_f64();
        let text = far(tally, self.total, self.wanted, at);
        let mut last = self.last.lock().unwrap_or_else(|e| e.into_inner());
        if self.has_lines && at - *last > EVERY {
            *last = at;
            print_message!("{text}");
        }
        self.bar.set_message(shown(&text));
    }

    /// A failure; that of an only unit is reported at the end.
    fn line(&self, text: &str) {
        if self.total == 1 {
            return;
        }
        self.bar.suspend(|| print_message!("{text}"));
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Such as `12 of 40 units, 1 failed, 0.02 core-hours, about 4 min left`.
fn far(tally: &Tally, total: usize, wanted: usize, at: f64) -> String {
    let ended = tally.done + tally.failed;
    let now = (wanted + ended).saturating_sub(total);
    let mut text =
        format!("{ended} of {total} units, {} failed, {:.2} core-hours", tally.failed, tally.cpu_seconds / 3600.0);
    if now > 0 && ended < total {
        text += &format!(", about {} left", duration(at / now as f64 * (total - ended) as f64));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn how_far_it_is() {
        let tally = Tally { done: 11, failed: 1, before: 8, cpu_seconds: 72.0, ..Tally::default() };
        // Four of this run took 10 s; 28 are left.
        assert_eq!(far(&tally, 40, 32, 10.0), "12 of 40 units, 1 failed, 0.02 core-hours, about 70 s left");
        assert_eq!(far(&Tally::default(), 40, 40, 1.0), "0 of 40 units, 0 failed, 0.00 core-hours");
    }
}
