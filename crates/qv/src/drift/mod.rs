//! `qv drift`: whether a robot is the one that was calibrated.

mod baseline;
mod check;
mod junit;
mod page;

use crate::ground::check_ground;
use crate::open::{find_gains, open_run, write_error};
use crate::output::{make_folder, put};
use crate::progress::{Stages, remark};
use crate::provenance::provenance;
use crate::terminal::print_message;
use crate::{Failure, Outcome, RunArguments, say};
pub use baseline::BaselineRobot;
use check::{Check, hashes, p_value, rows};
use qv_gap::drift::{Baseline, DriftPolicy};
use qv_open::diagnosis::gap_error;
use qv_page::significant;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv diagnose monday.mcap --out out/why\n\
     \x20 qv drift today.mcap --baseline out/why\n\
     \x20 qv drift today.mcap --baseline out/why --out out/drift --junit out/drift.xml\n\
     \n\
     Results with --out: drift.json (all checks so far, all parameters), drift.html (parameters over days).\n\
     Recordings that DIR has checked already against this baseline are not checked again. Repeat the\n\
     motion of the calibration: with another one false alarms are frequent. See docs/guide/drift.md.",
    "3 inconclusive: the recording shows less than the calibration did, or part of it was lost\n  4 changed"
);

/// Format of drift.json.
const FORMAT: &str = "qv-drift/1";

#[derive(clap::Args)]
pub struct DriftCheck {
    /// Recordings of today, or directories of them; each is checked alone
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Read the calibration: the results of `qv diagnose`
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    baseline: PathBuf,
    /// Read the recordings of the calibration here [default: those it names]
    #[arg(long, value_name = "RUN", num_args = 1.., help_heading = "Input")]
    reference: Vec<PathBuf>,
    /// Set the probability of any false alarm in one check
    #[arg(long, default_value_t = 0.01, value_name = "SHARE", value_parser = alarm, help_heading = "What to test")]
    alarm: f64,
    /// Write drift.json and drift.html into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Write the results as JUnit XML, for continuous integration
    #[arg(long, value_name = "FILE.xml", help_heading = "Output")]
    junit: Option<PathBuf>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

fn alarm(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| format!("expected a share, found {text}"))?;
    if share > 0.0 && share <= 0.2 {
        Ok(share)
    } else {
        Err(format!("expected a share above 0, up to 0.2, found {text}"))
    }
}

/// drift.json.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct History {
    format: String,
    /// Hashes of what the checks are against: another calibration begins another history.
    baseline: Vec<String>,
    alarm: f64,
    checks: Vec<Check>,
    provenance: Value,
}

impl DriftCheck {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        if let Some(out) = &self.out {
            make_folder(out).map_err(|e| write_error(out, &e))?;
        }
        let runs: Vec<PathBuf> = self.runs.iter().flat_map(|run| self.recordings(run)).collect();
        let calibrated = BaselineRobot::open(&self.baseline, &self.reference)?;
        let mut checks = self.history(&calibrated.sha256);
        let named = self.check(&runs, &calibrated, &checks)?;
        checks.retain(|old| named.iter().all(|new| new.sha256 != old.sha256));
        checks.extend(named.iter().cloned());
        checks.sort_by(|a, b| a.start_ns.cmp(&b.start_ns).then(a.run.cmp(&b.run)));
        self.write(&calibrated, &named, checks)?;
        let worst = |outcome| named.iter().any(|check| check.outcome() == outcome);
        if self.json {
            let line = json!({ "format": FORMAT, "baseline": self.baseline, "checks": named });
            say(&format!("{line}\n"))?;
        } else {
            named.iter().try_for_each(|check| say(&text(check)))?;
        }
        for check in &named {
            check.lost.iter().for_each(|what| print_message!("{}: {what}", check.run));
        }
        Ok([Outcome::Changed, Outcome::Partial].into_iter().find(|o| worst(*o)).unwrap_or(Outcome::Done))
    }

    /// A recording, or those below a directory.
    fn recordings(&self, path: &Path) -> Vec<PathBuf> {
        let without = self.out.clone().unwrap_or_else(|| self.baseline.clone());
        let found = crate::fleet::recordings(path, &without);
        if found.is_empty() { vec![path.to_path_buf()] } else { found }
    }

    /// Checks of other days against the same calibration.
    fn history(&self, baseline: &[String]) -> Vec<Check> {
        let Some(text) = self.out.as_ref().and_then(|out| fs::read_to_string(out.join("drift.json")).ok()) else {
            return Vec::new();
        };
        match serde_json::from_str::<History>(&text) {
            Ok(old) if old.baseline == baseline && old.alarm == self.alarm => old.checks,
            _ => {
                remark("drift.json is of another calibration: a new history begins");
                Vec::new()
            }
        }
    }

    fn check(&self, runs: &[PathBuf], calibrated: &BaselineRobot, known: &[Check]) -> Result<Vec<Check>, Failure> {
        let bar = Stages::new();
        let policy = DriftPolicy { alarm: self.alarm, ..Default::default() };
        let (model, terrain, options) = (&calibrated.model, &calibrated.terrain, calibrated.options());
        let mut baseline: Option<Baseline> = None;
        let mut checks = Vec::new();
        for (index, path) in runs.iter().enumerate() {
            let sha256 = hashes(path);
            if let Some(old) = known.iter().find(|old| old.sha256 == sha256) {
                checks.push(Check { run: path.display().to_string(), ..old.clone() });
                continue;
            }
            bar.begin(index + 1, runs.len(), "compare", Some(0.0));
            let first = match baseline.take() {
                Some(first) => first,
                None => Baseline::new(&calibrated.runs, model, terrain, &options, &policy).map_err(gap_error)?,
            };
            let mut run = open_run(&RunArguments { run: path.clone(), reading: calibrated.reading.clone() })?;
            let remarks = check_ground(&run, terrain)?;
            run.remarks.extend(remarks);
            let mut all = [run];
            find_gains(&mut all, model, terrain, &options.given)?;
            let drift = first.compare(&all, model, terrain, &options).map_err(gap_error)?;
            let lost = crate::open::lost_from(&all[0]);
            checks.push(Check { run: path.display().to_string(), sha256, start_ns: all[0].epoch, lost, drift });
            baseline = Some(first);
        }
        bar.finish();
        Ok(checks)
    }

    fn write(&self, calibrated: &BaselineRobot, named: &[Check], checks: Vec<Check>) -> Result<(), Failure> {
        if let Some(path) = &self.junit {
            put(path, junit::to_xml(named)).map_err(|e| write_error(path, &e))?;
        }
        let Some(out) = &self.out else { return Ok(()) };
        let read = self.runs.iter().map(PathBuf::as_path).chain([self.baseline.as_path()]);
        let history = History {
            format: FORMAT.into(),
            baseline: calibrated.sha256.clone(),
            alarm: self.alarm,
            provenance: provenance(read),
            checks,
        };
        let [list, html] = ["drift.json", "drift.html"].map(|name| out.join(name));
        let title = format!("Drift against {}", self.baseline.display());
        put(&html, page::to_html(&title, &history.checks)).map_err(|e| write_error(&html, &e))?;
        let text = serde_json::to_string_pretty(&history)?;
        put(&list, format!("{text}\n")).map_err(|e| write_error(&list, &e))?;
        Ok(())
    }
}

/// Rows on a terminal.
const SHOWN: usize = 12;

fn text(check: &Check) -> String {
    let mut text = format!("{}\n{}\n", check.run, check.drift.sentence);
    let head = ["parameter", "on", "then", "now", "difference", "95 % interval", "p", "visible", "matters"];
    let mut table = vec![head.map(str::to_owned)];
    let of = |x: f64| significant(x, 3);
    let all = rows(&check.drift);
    for row in all.iter().take(SHOWN.max(check.drift.changes().count())) {
        let unit = if row.unit == "1" { String::new() } else { format!(" {}", row.unit) };
        table.push([
            if row.effect.ends_with(&row.parameter) {
                row.effect.clone()
            } else {
                format!("{} {}", row.effect, row.parameter)
            },
            row.scope.join(", "),
            of(row.then),
            of(row.now),
            format!("{}{unit}", of(row.difference)),
            format!("{} to {}", of(row.ci95[0]), of(row.ci95[1])),
            p_value(row.p_corrected),
            row.visible.map_or("-".into(), of),
            (if row.matters {
                "yes"
            } else if row.changed {
                "no"
            } else {
                ""
            })
            .into(),
        ]);
    }
    let width = |k: usize| table.iter().map(|r| r[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    for row in &table {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, &w)| format!("{cell:<w$}")).collect();
        _ = writeln!(text, "{}", cells.join("  ").trim_end());
    }
    if all.len() + 1 > table.len() {
        _ = writeln!(text, "and {} more effects without a change", all.len() + 1 - table.len());
    }
    text
}
