//! `cargo xtask withheld`: what `qv diagnose` says of recordings whose effect is taken out of its library.
//!
//! Each effect of a walking robot is recorded in several motions. Each recording is diagnosed as it is, which shows whether its effect can be seen,
//! and with `--without` its effect: then the right answer is `unexplained`, and a name is false.

use crate::blind::{Answers, build_generator, each};
use crate::workspace::Workspace;
use crate::{pipeline, process, programs};
use anyhow::{Context, Result, bail};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// What to record and where.
#[derive(clap::Args)]
pub struct Withheld {
    /// Effects to take out, or `all`
    #[arg(long, value_delimiter = ',', default_value = "all", value_name = "NAMES")]
    effects: Vec<String>,
    /// Motions in which each is recorded
    #[arg(long, value_delimiter = ',', default_value = "mixed,trot,stick", value_name = "NAMES")]
    motions: Vec<String>,
    /// Robots without an effect, diagnosed beside them
    #[arg(long, default_value_t = 21, value_name = "N")]
    none: usize,
    /// Seed of the recordings
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Diagnoses at a time
    #[arg(long, default_value_t = 2, value_name = "N")]
    jobs: usize,
    /// Begin no diagnosis after so many minutes; another run with the same --out goes on
    #[arg(long, value_name = "M")]
    minutes: Option<f64>,
    /// Folder for recordings and reports [default: one for each request and program under target/withheld]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Withheld {
    /// What decides what is recorded.
    fn words(&self) -> Vec<String> {
        vec![self.effects.join(","), self.motions.join(","), self.none.to_string(), self.seed.to_string()]
    }
}

/// What `report.json` is read for.
#[derive(Debug, Deserialize)]
struct Report {
    verdict: String,
    causes: Vec<Cause>,
}

#[derive(Debug, Deserialize)]
struct Cause {
    effect: String,
}

/// What a diagnosis comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Outcome {
    Right,
    Wrong,
    Unexplained,
    NoGap,
    Failed,
}

const OUTCOMES: [(Outcome, &str); 5] = [
    (Outcome::Right, "right"),
    (Outcome::Wrong, "wrong"),
    (Outcome::Unexplained, "unexplained"),
    (Outcome::NoGap, "no gap"),
    (Outcome::Failed, "failed"),
];

/// A recording, and what is left out of the library when it is diagnosed.
struct Diagnosis {
    name: String,
    effect: Option<String>,
    is_without: bool,
}

/// Outcomes of the recordings of one effect, with the whole library and without the effect.
type Row = [BTreeMap<Outcome, usize>; 2];

/// Records, diagnoses and prints the table. False when a diagnosis failed.
///
/// # Errors
/// A program does not build or run, or a folder cannot be written.
pub fn run(workspace: &Workspace, asked: &Withheld) -> Result<bool> {
    let qv = programs::qv(workspace)?;
    let folder = match &asked.out {
        Some(folder) => folder.clone(),
        // Another request, or another program, has a folder of its own.
        None => {
            let hash = pipeline::hash(&asked.words(), std::slice::from_ref(&qv))?;
            workspace.target_directory.join(format!("withheld/{hash:016x}"))
        }
    };
    let answers = record(workspace, asked, &folder)?;
    let diagnoses = list(&answers);
    let at_most = asked.minutes.map(|minutes| Duration::from_secs_f64(60.0 * minutes.clamp(0.0, 1e6)));
    each(&diagnoses, asked.jobs, at_most, |_, diagnosis| diagnosis.run(&qv, &folder))?;
    let all = diagnoses.len();
    let diagnoses: Vec<Diagnosis> = diagnoses.into_iter().filter(|d| d.out(&folder).is_dir()).collect();
    if diagnoses.len() < all {
        println!("{} of {all} diagnoses were begun; the table counts those.", diagnoses.len());
    }
    let table = table(&diagnoses, &folder);
    fs::write(folder.join("withheld.md"), &table).with_context(|| format!("writing in {}", folder.display()))?;
    print!("{table}");
    Ok(!table.contains(FAILED))
}

const FAILED: &str = "A diagnosis failed";

/// Makes the recordings, or reads their answers where they are there.
fn record(workspace: &Workspace, asked: &Withheld, folder: &Path) -> Result<Answers> {
    let file = folder.join("answers.json");
    if !file.is_file() {
        let mut generator = Command::new(build_generator(workspace)?);
        generator.args([
            "--engine",
            "both",
            "--effects",
            &asked.effects.join(","),
            "--motions",
            &asked.motions.join(","),
        ]);
        generator.args(["--per-effect", &asked.motions.len().to_string(), "--none", &asked.none.to_string()]);
        generator.args(["--seed", &asked.seed.to_string(), "--jobs", &asked.jobs.to_string()]);
        process::run(generator.arg("--out").arg(folder.join("recordings")).arg("--answers").arg(&file))?;
    }
    let text = fs::read_to_string(&file).with_context(|| format!("reading {}", file.display()))?;
    Answers::read(&text)
}

/// Every recording with the whole library, and those with an effect without it, too.
fn list(answers: &Answers) -> Vec<Diagnosis> {
    let mut out = Vec::new();
    for (name, answer) in &answers.recordings {
        let effect = answer.effects.first().map(|effect| effect.effect.clone());
        for is_without in [false, true].into_iter().take(1 + usize::from(effect.is_some())) {
            out.push(Diagnosis { name: name.clone(), effect: effect.clone(), is_without });
        }
    }
    out
}

impl Diagnosis {
    fn out(&self, folder: &Path) -> PathBuf {
        folder.join(if self.is_without { "without" } else { "whole" }).join(&self.name)
    }

    /// Runs it where there is no report yet.
    fn run(&self, qv: &Path, folder: &Path) -> Result<()> {
        let out = self.out(folder);
        if out.join("report.json").is_file() {
            return Ok(());
        }
        let bag = folder.join("recordings").join(&self.name).join("run.mcap");
        let mut command = Command::new(qv);
        command.arg("diagnose").arg(&bag).args(["--terrain", "plane", "--quiet", "--out"]).arg(&out);
        if let (true, Some(effect)) = (self.is_without, &self.effect) {
            command.args(["--without", effect]);
        }
        let output = command.output().with_context(|| format!("cannot start {command:?}"))?;
        // 3 is done with part of the input lost.
        match output.status.code() {
            Some(0 | 3) => Ok(()),
            _ if out.exists() => Ok(()),
            _ => bail!("{command:?}: {}", String::from_utf8_lossy(&output.stderr)),
        }
    }

    /// What was reported; `None` when the diagnosis failed.
    fn report(&self, folder: &Path) -> Option<Report> {
        serde_json::from_slice(&fs::read(self.out(folder).join("report.json")).ok()?).ok()
    }

    fn outcome(&self, folder: &Path) -> Outcome {
        let Some(report) = self.report(folder) else { return Outcome::Failed };
        match (report.causes.first(), report.verdict.as_str()) {
            (Some(cause), _) if !self.is_without && Some(&cause.effect) == self.effect.as_ref() => Outcome::Right,
            (Some(_), _) => Outcome::Wrong,
            (None, "no_gap") => Outcome::NoGap,
            (None, _) => Outcome::Unexplained,
        }
    }
}

/// The table by effect, and its sums.
fn table(diagnoses: &[Diagnosis], folder: &Path) -> String {
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    // Whether the effect can be seen in a recording: the whole library names it.
    let mut is_seen: BTreeMap<&str, bool> = BTreeMap::new();
    let mut seen_without: BTreeMap<Outcome, usize> = BTreeMap::new();
    // What was named in the place of which effect.
    let mut wrong: BTreeMap<(&str, String), usize> = BTreeMap::new();
    for diagnosis in diagnoses {
        let outcome = diagnosis.outcome(folder);
        if let (true, Outcome::Wrong, Some(effect)) = (diagnosis.is_without, outcome, &diagnosis.effect) {
            let named = diagnosis.report(folder).and_then(|r| r.causes.into_iter().next()).map(|c| c.effect);
            *wrong.entry((effect, named.unwrap_or_default())).or_default() += 1;
        }
        let row = rows.entry(diagnosis.effect.as_deref().unwrap_or("(none)")).or_default();
        *row[usize::from(diagnosis.is_without)].entry(outcome).or_default() += 1;
        match diagnosis.is_without {
            false => drop(is_seen.insert(&diagnosis.name, outcome == Outcome::Right)),
            true if is_seen.get(diagnosis.name.as_str()) == Some(&true) => {
                *seen_without.entry(outcome).or_default() += 1
            }
            true => {}
        }
    }
    let mut out = String::from("| effect | whole library | without it |\n|---|---|---|\n");
    for (effect, row) in &rows {
        let _ = writeln!(out, "| {effect} | {} | {} |", words(&row[0]), words(&row[1]));
    }
    let mut sums: Row = Default::default();
    for row in rows.iter().filter(|row| *row.0 != "(none)").map(|row| row.1) {
        for (sum, counts) in sums.iter_mut().zip(row) {
            counts.iter().for_each(|(outcome, count)| *sum.entry(*outcome).or_default() += count);
        }
    }
    let _ = writeln!(out, "| **all effects** | {} | {} |", words(&sums[0]), words(&sums[1]));
    let _ = writeln!(out, "| of those that the whole library identifies | | {} |", words(&seen_without));
    for ((effect, named), count) in &wrong {
        let _ = writeln!(out, "\nWithout `{effect}`: {count} named `{named}`.");
    }
    if rows.values().flatten().any(|counts| counts.contains_key(&Outcome::Failed)) {
        let _ = writeln!(out, "\n{FAILED}: its folder has no report.");
    }
    out
}

fn words(counts: &BTreeMap<Outcome, usize>) -> String {
    let of = |(outcome, name): &(Outcome, &str)| counts.get(outcome).map(|count| format!("{count} {name}"));
    let words: Vec<String> = OUTCOMES.iter().filter_map(of).collect();
    if words.is_empty() { "-".into() } else { words.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_counts_what_is_right_and_what_is_false() {
        let folder = std::env::temp_dir().join(format!("qv-withheld-{}", std::process::id()));
        let case = |name: &str, effect: Option<&str>, is_without, verdict: &str, said: &[&str]| {
            let diagnosis = Diagnosis { name: name.into(), effect: effect.map(Into::into), is_without };
            let causes: Vec<_> = said.iter().map(|effect| serde_json::json!({ "effect": effect })).collect();
            let report = serde_json::json!({ "verdict": verdict, "causes": causes });
            fs::create_dir_all(diagnosis.out(&folder)).unwrap();
            fs::write(diagnosis.out(&folder).join("report.json"), report.to_string()).unwrap();
            diagnosis
        };
        let all = [
            case("a", Some("payload_mass"), false, "explained", &["payload_mass"]),
            case("a", Some("payload_mass"), true, "explained", &["external_force"]),
            case("b", Some("payload_mass"), false, "no_gap", &[]),
            case("b", Some("payload_mass"), true, "no_gap", &[]),
            case("c", None, false, "no_gap", &[]),
            Diagnosis { name: "d".into(), effect: None, is_without: false },
        ];
        let table = table(&all, &folder);
        fs::remove_dir_all(&folder).unwrap();
        assert!(table.contains("| payload_mass | 1 right, 1 no gap | 1 wrong, 1 no gap |"), "{table}");
        assert!(table.contains("| (none) | 1 no gap, 1 failed | - |"), "{table}");
        assert!(table.contains("| of those that the whole library identifies | | 1 wrong |"), "{table}");
        assert!(table.contains("Without `payload_mass`: 1 named `external_force`."), "{table}");
        assert!(table.contains(FAILED), "{table}");
    }
}
