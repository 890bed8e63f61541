//! `qv contact` on recordings of another engine on mixed ground whose frictions are sealed.

use super::arguments::Blind;
use super::generate::{self, bar};
use super::seal;
use crate::workspace::Workspace;
use crate::{pipeline, process, programs};
use anyhow::{Context, Result, bail};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// What is asked of friction on labels that are slippery, of the errors' ratio, and of the time \[s\].
const GOALS: [f64; 3] = [0.05, 0.6, 60.0];

#[derive(Debug, Clone, Deserialize)]
struct Answers {
    recordings: BTreeMap<String, Answer>,
}

#[derive(Debug, Clone, Deserialize)]
struct Answer {
    frictions: BTreeMap<String, f64>,
    slippery: Vec<String>,
    redraws: u64,
}

/// One label of one recording.
#[derive(Debug, Clone, PartialEq)]
struct Label {
    name: String,
    slippery: bool,
    truth: f64,
    prior: f64,
    found: f64,
    grid: Option<f64>,
    covered: bool,
    status: String,
}

/// One recording.
#[derive(Debug, Clone, PartialEq)]
struct ScoredRecording {
    labels: Vec<Label>,
    /// Errors of the base \[m\] in segments that no fit has seen: uniform, prior, grid, posterior.
    errors: [f64; 4],
    seconds: f64,
}

/// Makes `count` recordings, seals their answers, calibrates and scores; false only when `gate` is asked for and a goal is
/// missed.
///
/// # Errors
/// Something does not build or run, the seal is broken, or files cannot be written.
pub fn run(workspace: &Workspace, blind: &Blind, count: usize, folder: &Path) -> Result<bool> {
    let generator = generate::build(workspace)?;
    let qv = programs::qv(workspace)?;
    let words =
        [format!("contact {count} {} {}", blind.seconds, blind.faults), blind.seed.to_string(), blind.engine.clone()];
    let folder = folder.join(format!("{:016x}", pipeline::hash(&words, std::slice::from_ref(&generator))?));
    let (recordings, kept) = (folder.join("recordings"), folder.join("redraws.json"));
    fs::create_dir_all(&recordings).with_context(|| format!("making {}", recordings.display()))?;
    let mut command = Command::new(&generator);
    command.arg("--out").arg(&recordings).args(["--mixed", &count.to_string(), "--jobs", "2"]);
    command.args(["--seed", &blind.seed.to_string(), "--seconds", &blind.seconds.to_string()]);
    command.args(["--engine", &blind.engine, "--mixed-faults", &blind.faults.to_string()]);
    if kept.is_file() {
        command.arg("--redraws").arg(&kept);
    }
    let document = process::output(&mut command)?;
    let answers: Answers = serde_json::from_str(&document).context("answers of the generator")?;
    let redraws: BTreeMap<&String, u64> = answers.recordings.iter().map(|(name, a)| (name, a.redraws)).collect();
    fs::write(&kept, serde_json::to_string(&redraws)?).with_context(|| format!("writing {}", kept.display()))?;
    let seal = seal::Seal::place(&document, &folder.join("seal.json"))?;
    println!("answers sealed: SHA-256 {}", seal.sha256());
    let reports = folder.join("contact");
    let progress = bar(answers.recordings.len(), "calibrating");
    for name in answers.recordings.keys() {
        calibrate(&qv, &recordings.join(name), &reports.join(name))?;
        progress.inc(1);
    }
    progress.finish_and_clear();
    seal.open(&document)?;
    let scored: Vec<ScoredRecording> = answers
        .recordings
        .iter()
        .map(|(name, answer)| score(&reports.join(name), answer).with_context(|| format!("recording {name}")))
        .collect::<Result<_>>()?;
    let (text, missed) = table(&scored);
    let file = reports.join("figures.md");
    fs::write(&file, &text).with_context(|| format!("writing {}", file.display()))?;
    print!("{text}");
    println!("written to {}\n{missed} goals missed", file.display());
    Ok(missed == 0 || !blind.gate)
}

/// Runs the program, always anew: its time is one of the figures.
fn calibrate(qv: &Path, recording: &Path, out: &Path) -> Result<()> {
    fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
    let clock = Instant::now();
    let mut command = Command::new(qv);
    command.arg("contact").arg(recording.join("run.mcap")).arg("--terrain").arg(recording.join("terrain.glb"));
    command.arg("--out").arg(out).stdin(Stdio::null()).stdout(Stdio::null());
    let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
    if !status.success() {
        bail!("expected {command:?} to succeed, found {status}");
    }
    let seconds = clock.elapsed().as_secs_f64();
    let file = out.join("seconds.json");
    fs::write(&file, json!({"seconds": seconds}).to_string()).with_context(|| format!("writing {}", file.display()))
}

fn score(report: &Path, answer: &Answer) -> Result<ScoredRecording> {
    let read = |name: &str| -> Result<Value> {
        let file = report.join(name);
        let text = fs::read_to_string(&file).with_context(|| format!("reading {}", file.display()))?;
        Ok(serde_json::from_str(&text)?)
    };
    let seconds = read("seconds.json")?["seconds"].as_f64().context("seconds")?;
    scored(&read("contact.json")?, answer, seconds)
}

fn scored(report: &Value, answer: &Answer, seconds: f64) -> Result<ScoredRecording> {
    let mut labels = Vec::new();
    for region in report["regions"].as_array().context("expected regions in contact.json")? {
        let name = region["label"].as_str().context("a region's label")?.to_string();
        let truth =
            *answer.frictions.get(&name).with_context(|| format!("expected a label of the answers, found {name}"))?;
        let number = |pointer: &str| region.pointer(pointer).and_then(Value::as_f64);
        let bound = |k: usize| number(&format!("/posterior/interval90/{k}")).context("a posterior's interval");
        labels.push(Label {
            slippery: answer.slippery.contains(&name),
            truth,
            prior: number("/prior/mean").context("a prior's mean")?,
            found: number("/friction").context("a friction")?,
            grid: number("/grid/friction"),
            covered: (bound(0)?..=bound(1)?).contains(&truth),
            status: region["status"].as_str().unwrap_or_default().to_string(),
            name,
        });
    }
    let error = |name: &str| report.pointer(&format!("/base_error/held_out/{name}")).and_then(Value::as_f64);
    let all = ["uniform", "prior", "grid", "posterior"].map(error);
    let [Some(uniform), Some(prior), Some(grid), Some(posterior)] = all else {
        bail!("expected errors of held-out segments in contact.json, found none")
    };
    Ok(ScoredRecording { labels, errors: [uniform, prior, grid, posterior], seconds })
}

/// The tables, and how many goals are missed.
fn table(all: &[ScoredRecording]) -> (String, usize) {
    let mut text = String::from(
        "| label | truth | prior | grid | posterior | off | in its 90 % interval |\n|---|---|---|---|---|---|---|\n",
    );
    for scored in all {
        for l in &scored.labels {
            let grid = l.grid.map_or("-".into(), |g| format!("{g:.3}"));
            let slippery = if l.slippery { " (slippery)" } else { "" };
            text += &format!(
                "| {}{slippery} | {:.3} | {:.2} | {grid} | {:.3} | {:.3} | {}{} |\n",
                l.name,
                l.truth,
                l.prior,
                l.found,
                (l.found - l.truth).abs(),
                if l.covered { "yes" } else { "no" },
                if l.status == "refined" { String::new() } else { format!(", {}", l.status) }
            );
        }
    }
    text += "\n| recording | uniform m | prior m | grid m | posterior m | posterior / prior | time s |\n|---|---|---|---|---|---|---|\n";
    for (k, s) in all.iter().enumerate() {
        let [u, p, g, q] = s.errors;
        text += &format!("| {k} | {u:.4} | {p:.4} | {g:.4} | {q:.4} | {:.2} | {:.1} |\n", q / p, s.seconds);
    }
    let mean = |k: usize| all.iter().map(|s| s.errors[k]).sum::<f64>() / all.len().max(1) as f64;
    let ratio = mean(3) / mean(1);
    text += &format!("| mean | {:.4} | {:.4} | {:.4} | {:.4} | {ratio:.2} | |\n\n", mean(0), mean(1), mean(2), mean(3));
    let labels = || all.iter().flat_map(|s| &s.labels);
    let slippery: Vec<&Label> = labels().filter(|l| l.slippery).collect();
    let off = |l: &Label, x: f64| (x - l.truth).abs();
    let within = slippery.iter().filter(|l| off(l, l.found) <= GOALS[0]).count();
    let worst = slippery.iter().map(|l| off(l, l.found)).fold(0.0, f64::max);
    let average = |of: &dyn Fn(&Label) -> Option<f64>| {
        let found: Vec<f64> = slippery.iter().filter_map(|l| of(l)).collect();
        found.iter().sum::<f64>() / found.len().max(1) as f64
    };
    let slowest = all.iter().map(|s| s.seconds).fold(0.0, f64::max);
    text += &format!(
        "slippery labels within {}: {within} of {}; mean error {:.3} posterior, {:.3} grid, {:.3} prior; largest {worst:.3}\n",
        GOALS[0],
        slippery.len(),
        average(&|l| Some(off(l, l.found))),
        average(&|l| l.grid.map(|g| off(l, g))),
        average(&|l| Some(off(l, l.prior))),
    );
    text += &format!(
        "90 % intervals that hold the truth: {} of {}, of slippery labels {} of {}\n",
        labels().filter(|l| l.covered).count(),
        labels().count(),
        slippery.iter().filter(|l| l.covered).count(),
        slippery.len()
    );
    text += &format!("slowest calibration: {slowest:.1} s\n");
    let missed = [within < slippery.len(), ratio.is_nan() || ratio > GOALS[1], slowest > GOALS[2]];
    (text, missed.into_iter().filter(|m| *m).count())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(friction: f64, posterior: f64) -> Value {
        json!({
            "regions": [{
                "label": "ice", "status": "refined", "friction": friction, "prior": {"mean": 0.12},
                "posterior": {"interval90": [friction - 0.02, friction + 0.02]}, "grid": {"friction": 0.2},
            }],
            "base_error": {"held_out": {"uniform": 0.5, "prior": 0.1, "grid": 0.08, "posterior": posterior}},
        })
    }

    fn answer() -> Answer {
        Answer { frictions: [("ice".to_string(), 0.25)].into(), slippery: vec!["ice".into()], redraws: 0 }
    }

    #[test]
    fn goals_are_met_and_missed() {
        let good = scored(&report(0.24, 0.05), &answer(), 30.0).unwrap();
        assert!(good.labels[0].covered && good.labels[0].slippery);
        let (text, missed) = table(std::slice::from_ref(&good));
        assert!(missed == 0 && text.contains("1 of 1; mean error 0.010 posterior, 0.050 grid, 0.130 prior"), "{text}");
        let bad = scored(&report(0.32, 0.09), &answer(), 70.0).unwrap();
        assert_eq!(table(&[bad]).1, 3);
    }

    #[test]
    fn reports_that_lack_something_are_errors() {
        let mut other = answer();
        other.frictions.clear();
        assert!(scored(&report(0.24, 0.05), &other, 1.0).is_err());
        let mut short = report(0.24, 0.05);
        short["base_error"]["held_out"] = Value::Null;
        assert!(scored(&short, &answer(), 1.0).is_err());
    }
}
