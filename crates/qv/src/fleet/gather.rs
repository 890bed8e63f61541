//! `qv fleet gather`: what was found, in fleet.json and fleet.html.

use super::folder::Folder;
use crate::output::{OutputFolder, write_whole};
use crate::{Failure, Outcome, say};
use qv_fleet::gather::{Fleet, State, gather};
use qv_fleet::page;
use qv_fleet::state::Cost;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Gather {
    /// Directory of the fleet
    #[arg(value_name = "FLEET")]
    folder: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Gather {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let folder = Folder::open(&self.folder)?;
        let (mut costs, mut known): (Vec<Cost>, usize) = (Vec::new(), 0);
        let fleet = gather(&folder.plan, |unit| {
            if let Some((done, report)) = folder.done(unit) {
                costs.push(done.cost);
                known += 1;
                return State::Done(done.exit_code, serde_json::from_slice(&report).unwrap_or_default());
            }
            match folder.failed(unit) {
                None => State::Missing,
                Some(failed) => {
                    costs.push(failed.cost);
                    State::Failed(failed.kind, failed.reason)
                }
            }
        });
        // What it cost is another each time, and so stands in a file of its own.
        let cost = cost(&costs);
        let put = |name: &str, text: String| write_whole(&self.folder.join(name), text.as_bytes());
        let out = OutputFolder::take(&self.folder)?;
        let written = put("fleet.json", fleet.to_text())
            .and_then(|()| put("fleet.html", page::to_html(&fleet, &folder.plan)))
            .and_then(|()| put("cost.json", format!("{cost:#}\n")));
        out.end(written.is_ok())?;
        written?;
        say(&if self.json { format!("{}\n", line(&fleet, &cost)) } else { self.summary(&fleet, &cost) })?;
        Ok(if known == fleet.units.len() { Outcome::Done } else { Outcome::Partial })
    }

    fn summary(&self, fleet: &Fleet, cost: &serde_json::Value) -> String {
        let mut text = String::new();
        let counts: Vec<String> =
            fleet.counts.iter().filter(|(_, n)| **n > 0).map(|(s, n)| format!("{n} {s}")).collect();
        let _ = writeln!(text, "{} units: {}", fleet.units.len(), counts.join(", "));
        for cause in &fleet.causes {
            let robots: Vec<String> = cause.robots.iter().map(|(r, with, of)| format!("{r} {with} of {of}")).collect();
            let _ = writeln!(text, "{:<24} {}", cause.effect, robots.join(", "));
        }
        for size in fleet.sizes.iter().filter(|size| size.drifts) {
            let Some(slope) = size.per_day else { continue };
            let _ = writeln!(
                text,
                "drift: {} of {}: {:.4} {} a day ({:.4} to {:.4})",
                size.parameter, size.robot, slope.value, size.unit, slope.ci95[0], slope.ci95[1]
            );
        }
        if !fleet.outliers.is_empty() {
            let _ = writeln!(text, "{} values stand apart (|z| > {})", fleet.outliers.len(), fleet.outlier_z);
        }
        for failure in &fleet.failures {
            let _ = writeln!(text, "{} failed, {}: {}", failure.units.len(), failure.kind.words(), failure.reason);
        }
        // The sum of nothing is -0.
        let hours = cost["core_hours"].as_f64().unwrap_or(0.0).abs();
        let _ = writeln!(text, "{hours:.4} core-hours; written to {}", self.folder.join("fleet.html").display());
        text
    }
}

fn cost(costs: &[Cost]) -> serde_json::Value {
    let sum = |of: fn(&Cost) -> f64| costs.iter().map(of).sum::<f64>();
    serde_json::json!({
        "format": "qv-fleet-cost/1",
        "core_hours": sum(|c| c.cpu_seconds) / 3600.0,
        "unit_hours": sum(|c| c.seconds) / 3600.0,
        "attempts": costs.iter().map(|c| c.attempts).sum::<u32>(),
        "peak_mib": costs.iter().map(|c| c.peak_mib).fold(0.0, f64::max),
    })
}

fn line(fleet: &Fleet, cost: &serde_json::Value) -> serde_json::Value {
    serde_json::json!({"format": "qv-fleet-gathered/1", "counts": fleet.counts, "causes": fleet.causes,
        "outliers": fleet.outliers.len(), "failures": fleet.failures, "cost": cost})
}
