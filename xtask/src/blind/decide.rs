//! `cargo xtask blind decide`: scores what a policy makes of evidence that is stored, in seconds, beside what the policy of the program does.

use super::answers::{Answers, Case};
use super::figures::figures;
use super::score::{DiagnosisScore, score};
use super::table;
use crate::bench::contest;
use crate::process;
use crate::workspace::Workspace;
use anyhow::{Context, Result};
use clap::Args;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What to score.
#[derive(Args)]
pub struct Decide {
    /// Folder with NAME/evidence.json
    #[arg(long, value_name = "DIR")]
    evidence: PathBuf,
    /// Answers, as `blind` leaves them in answers.json once the seal is opened
    #[arg(long, value_name = "FILE")]
    answers: PathBuf,
    /// Numbers of the policy that are other than the program's
    #[arg(long, value_name = "FILE.toml")]
    policy: Option<PathBuf>,
}

/// Scores, and prints the figures and which recordings are won and lost.
///
/// # Errors
/// Something does not build, or a file is missing or malformed.
pub fn run(workspace: &Workspace, decide: &Decide) -> Result<()> {
    let program = contest::build(workspace, "decide", &[])?;
    let text = fs::read_to_string(&decide.answers).with_context(|| format!("reading {}", decide.answers.display()))?;
    let answers = Answers::read(&text)?;
    let folder = workspace.target_directory.join("blind/decided");
    let decided = |name: &str, policy: Option<&Path>| -> Result<Vec<DiagnosisScore>> {
        let out = folder.join(name);
        if out.exists() {
            fs::remove_dir_all(&out).with_context(|| format!("removing {}", out.display()))?;
        }
        let mut command = Command::new(&program);
        command.arg(&decide.evidence).arg(&out).args(policy);
        print!("{name}: {}", process::output(&mut command)?);
        let there = answers.recordings.iter().filter(|(name, _)| out.join(name).is_dir());
        there.map(|(name, answer)| score(name, answer, &out.join(name))).collect()
    };
    let own = decided("program", None)?;
    let Some(policy) = &decide.policy else {
        print!("{}", table::markdown(&figures(own)));
        return Ok(());
    };
    let other = decided("policy", Some(policy))?;
    // Recordings that the policy would have led elsewhere have no score; figures are of the others alone.
    let both = |scored: &[DiagnosisScore], of: &[DiagnosisScore]| -> Vec<DiagnosisScore> {
        scored.iter().filter(|s| of.iter().any(|o| o.name == s.name)).cloned().collect()
    };
    let (own, other) = (both(&own, &other), both(&other, &own));
    println!(
        "\nprogram:\n{}\npolicy:\n{}",
        table::markdown(&figures(own.clone())),
        table::markdown(&figures(other.clone()))
    );
    print!("{}", differences(&own, &other));
    Ok(())
}

/// Recordings that one is right about and the other is not, as two tables.
fn differences(own: &[DiagnosisScore], other: &[DiagnosisScore]) -> String {
    let mut tables = [("won", String::new(), 0), ("lost", String::new(), 0)];
    for (before, after) in own.iter().zip(other) {
        let table = match (is_right(before), is_right(after)) {
            (false, true) => &mut tables[0],
            (true, false) => &mut tables[1],
            _ => continue,
        };
        let truth = if before.truth.is_empty() { "no effect".into() } else { before.truth.join(" and ") };
        table.1 += &format!("| {} | {truth} | {} | {} |\n", before.name, before.said, after.said);
        table.2 += 1;
    }
    let one = |(name, rows, count): &(&str, String, usize)| match count {
        0 => format!("{name}: none\n"),
        _ => format!("{name}: {count}\n\n| recording | is there | program | policy |\n|---|---|---|---|\n{rows}\n"),
    };
    tables.iter().map(one).collect()
}

/// Whether a diagnosis says what it should: the effect that is there first, both of two, none where there is none or one that no library has.
fn is_right(scored: &DiagnosisScore) -> bool {
    match scored.case {
        Case::Single => scored.named,
        Case::Pair => scored.all_accused,
        Case::None | Case::Withheld => scored.accused.is_empty(),
    }
}
