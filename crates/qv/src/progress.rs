//! How far a command is, reported on standard error: a bar where that is a terminal, a line a stage where it is not.

use crate::terminal::{print_message, shown};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Instant;

/// How much is reported beside results: it belongs to the process, as standard error does.
static LEVEL: AtomicU8 = AtomicU8::new(Level::Normal as u8);

/// How much is reported beside results, errors and losses.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Nothing.
    Quiet = 0,
    /// How far it is, and remarks.
    Normal = 1,
    /// How long each stage took, too.
    Verbose = 2,
}

/// Sets it for the whole program.
pub fn set(level: Level) {
    LEVEL.store(level as u8, Ordering::Relaxed);
}

/// Whether at least this much is reported.
pub fn reports(level: Level) -> bool {
    LEVEL.load(Ordering::Relaxed) >= level as u8
}

/// A remark: nothing is lost by what it says.
pub fn remark(what: &str) {
    if reports(Level::Normal) {
        print_message!("{what}");
    }
}

/// Share of the work from which on the time left is reported: before, it would be a guess.
const TOLD_FROM: f64 = 0.03;

/// The stages of a command that takes more than two seconds.
pub struct Stages {
    bar: ProgressBar,
    /// Whether each stage has a line of its own.
    has_lines: bool,
    clock: Instant,
    now: Mutex<Now>,
}

/// Where a command is.
#[derive(Default)]
struct Now {
    /// Such as `2 of 4: search`.
    stage: String,
    /// When it began, in seconds since the first one did.
    since: f64,
    /// Share of the whole work that is done.
    share: f64,
}

impl Stages {
    pub fn new() -> Self {
        let bar = spinner("");
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}") {
            bar.set_style(style);
        }
        let has_lines = reports(Level::Normal) && (!std::io::stderr().is_terminal() || reports(Level::Verbose));
        Self { bar, has_lines, clock: Instant::now(), now: Mutex::default() }
    }

    /// Stage `number` of `count`, both from 1; `share` of the whole work lies behind it, where that is known.
    pub fn begin(&self, number: usize, count: usize, name: &str, share: Option<f64>) {
        self.finish_stage();
        let at = self.clock.elapsed().as_secs_f64();
        let share = share.unwrap_or((number.max(1) - 1) as f64 / count.max(1) as f64);
        let line = {
            let mut now = self.now.lock().unwrap_or_else(|e| e.into_inner());
            *now = Now { stage: format!("{number} of {count}: {name}"), since: at, share };
            remarks(&now, at, "")
        };
        if self.has_lines {
            self.bar.suspend(|| print_message!("{line}"));
        }
        self.bar.set_message(shown(&line));
    }

    /// `share` of the whole work is done; `figure` is what a reader may want to see beside it.
    pub fn at(&self, share: f64, figure: &str) {
        let at = self.clock.elapsed().as_secs_f64();
        let mut now = self.now.lock().unwrap_or_else(|e| e.into_inner());
        now.share = share.clamp(0.0, 1.0);
        self.bar.set_message(shown(&remarks(&now, at, figure)));
    }

    /// All is done.
    pub fn finish(&self) {
        self.finish_stage();
        self.bar.finish_and_clear();
    }

    fn finish_stage(&self) {
        let mut now = self.now.lock().unwrap_or_else(|e| e.into_inner());
        if reports(Level::Verbose) && !now.stage.is_empty() {
            let seconds = self.clock.elapsed().as_secs_f64() - now.since;
            self.bar.suspend(|| print_message!("{} took {seconds:.1} s", now.stage));
        }
        now.stage.clear();
    }
}

/// Such as `2 of 4: search, 31 % done, about 12 s left`.
fn remarks(now: &Now, at: f64, figure: &str) -> String {
    let mut text = format!("{}, {:.0} % done", now.stage, 100.0 * now.share);
    if now.share >= TOLD_FROM {
        text += &format!(", about {} left", duration(at * (1.0 - now.share) / now.share));
    }
    if !figure.is_empty() {
        text += &format!(" ({figure})");
    }
    text
}

/// Seconds as people say them.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 99.5 => format!("{s:.0} s"),
        s if s < 5970.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A bar on standard error; indicatif hides it where that is no terminal.
pub fn progress(total: u64, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent} %").expect("the template is well formed");
    let bar = if reports(Level::Normal) { ProgressBar::new(total) } else { ProgressBar::hidden() };
    bar.with_style(style).with_message(what)
}

/// A sign of life for work without a known end.
pub fn spinner(what: impl Into<std::borrow::Cow<'static, str>>) -> ProgressBar {
    if !reports(Level::Normal) {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new_spinner().with_message(shown(&what.into()));
    bar.enable_steady_tick(std::time::Duration::from_millis(100));
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stage_share_and_time_left_are_told() {
        let now = |share| Now { stage: "2 of 4: search".into(), share, since: 0.0 };
        assert_eq!(remarks(&now(0.25), 10.0, ""), "2 of 4: search, 25 % done, about 30 s left");
        assert_eq!(remarks(&now(0.5), 600.0, "loss 0.1"), "2 of 4: search, 50 % done, about 10 min left (loss 0.1)");
        assert_eq!(remarks(&now(0.0), 10.0, ""), "2 of 4: search, 0 % done");
        assert_eq!(duration(7200.0), "2.0 h");
    }
}
