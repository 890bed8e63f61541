//! `qv fleet rehearse`, which is hidden: a command that does what a file beside the recording says. Tests and the benchmark use it.

use crate::output::{make_folder, write_whole};
use crate::{Failure, Outcome, say};
use serde::Deserialize;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

/// What it writes where nothing else is asked for.
const REPORT: &str = "{\"format\": \"qv-rehearsal/1\", \"verdict\": \"rehearsed\", \"sentence\": \"A rehearsal: nothing was measured.\"}";

#[derive(clap::Args)]
pub struct Rehearse {
    /// Recordings; only rehearse.json beside the first is read
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Write report.json into this directory
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
}

/// What `rehearse.json` may ask for.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RehearsedFault {
    /// How long it takes \[s\].
    seconds: f64,
    /// Memory that it takes \[MiB\].
    mib: usize,
    /// Its exit code.
    exit: u8,
    /// Ends by a signal, at its first attempt only.
    dies_first: bool,
    /// Writes no report.
    is_mute: bool,
    /// What it writes.
    report: Option<serde_json::Value>,
}

impl Rehearse {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let run = &self.runs[0];
        let beside = if run.is_dir() { run.join("rehearse.json") } else { run.with_file_name("rehearse.json") };
        let part: RehearsedFault = match fs::read_to_string(&beside) {
            Ok(text) => serde_json::from_str(&text)?,
            Err(_) => RehearsedFault::default(),
        };
        // A line for each start, so that tests see what was started twice.
        let starts = self.out.with_file_name("starts.txt");
        let is_first = !starts.exists();
        writeln!(OpenOptions::new().create(true).append(true).open(&starts)?, "{}", std::process::id())?;
        if part.dies_first && is_first {
            std::process::abort();
        }
        // Written to, so that the system gives it.
        let memory = vec![1u8; part.mib << 20];
        std::thread::sleep(Duration::from_secs_f64(part.seconds));
        if memory.iter().step_by(4096).any(|byte| *byte != 1) {
            return Err("expected memory that keeps what it is given, found another".into());
        }
        if !part.is_mute {
            make_folder(&self.out)?;
            let report = part.report.map_or(REPORT.into(), |report| report.to_string());
            write_whole(&self.out.join("report.json"), report.as_bytes())?;
        }
        say("A rehearsal: nothing was measured.\n")?;
        match part.exit {
            0 => Ok(Outcome::Done),
            3 => Ok(Outcome::Partial),
            _ => {
                Err(format!("{}: expected a rehearsal that ends well, found exit {}", run.display(), part.exit).into())
            }
        }
    }
}
