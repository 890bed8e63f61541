//! `cargo xtask blind`: recordings of another engine with sealed answers, diagnosed, then scored.
//!
//! The answers stay in this process's memory until every diagnosis has ended; what is written before the first one is
//! their seal. The diagnosing program is given a recording in a folder of an opaque name, and nothing else.

mod answers;
mod arguments;
mod contact;
mod decide;
mod diagnose;
mod figures;
mod generate;
pub mod golden;
mod report;
mod score;
mod seal;
mod table;
#[cfg(test)]
mod tests;

use crate::workspace::Workspace;
use crate::{pipeline, process, programs, python};
pub use answers::Answers;
pub use arguments::Blind;
pub use diagnose::each;
pub use generate::build as build_generator;

use anyhow::{Context, Result};
use arguments::Chore;
use diagnose::Diagnoses;
use figures::Figures;
use generate::{Generator, Origin, Set};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Runs and scores; false only when `gate` is asked for and a goal is missed.
///
/// # Errors
/// Something does not build, the generator or a program fails to run, the seal is broken, or files cannot be written.
pub fn run(workspace: &Workspace, blind: &Blind) -> Result<bool> {
    if let Some(Chore::Decide(decide)) = &blind.chore {
        return decide::run(workspace, decide).map(|()| true);
    }
    let folder = workspace.target_directory.join("blind");
    if let Some(count) = blind.contact {
        return contact::run(workspace, blind, count, &folder);
    }
    let figures = match (&blind.reports_only, &blind.answers) {
        (Some(reports), Some(answers)) => {
            let text = fs::read_to_string(answers).with_context(|| format!("reading {}", answers.display()))?;
            score_all(&Answers::read(&text)?, reports)?
        }
        _ => diagnose_all(workspace, blind, &folder)?,
    };
    let tables = table::markdown(&figures);
    fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    for (name, text) in
        [("figures.json", serde_json::to_string_pretty(&figures)? + "\n"), ("figures.md", tables.clone())]
    {
        let file = folder.join(name);
        fs::write(&file, text).with_context(|| format!("writing {}", file.display()))?;
        println!("written to {}", file.display());
    }
    print!("{tables}");
    if blind.write_docs {
        let root = &workspace.workspace_root;
        let measured = format!("{}\n\n{tables}", table::how(std::env::args().skip(1), &commit(root), &figures));
        table::refresh(&root.join("docs/reference/results.md"), &measured)?;
    }
    let missed = figures.figures.iter().filter(|figure| figure.met() == Some(false)).count();
    println!("{missed} goals missed");
    Ok(missed == 0 || !blind.gate)
}

/// The commit that is checked out, and whether files differ from it.
fn commit(root: &Path) -> String {
    let git = |words: &[&str]| process::output(Command::new("git").current_dir(root).args(words));
    let Ok(hash) = git(&["rev-parse", "--short=10", "HEAD"]) else { return "a commit that git does not report".into() };
    // The page itself may have been written before.
    let changed = git(&["status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs"]);
    let differs = changed.map_or(true, |list| !list.trim().is_empty());
    format!("commit {}{}", hash.trim(), if differs { ", with changes that are not committed" } else { "" })
}

fn diagnose_all(workspace: &Workspace, blind: &Blind, folder: &Path) -> Result<Figures> {
    let mut sets = match blind.full || blind.arms {
        true => Set::full(blind.per_effect.unwrap_or(10)),
        false => Set::subset(blind.per_effect.unwrap_or(1)),
    };
    match (blind.origins.is_empty(), blind.full) {
        _ if blind.arms => sets.retain(|set| set.origin == Origin::Arms),
        (true, true) => {}
        (true, false) => sets.retain(|set| set.origin == Origin::Rapier),
        (false, _) => sets.retain(|set| blind.origins.contains(&set.origin)),
    }
    let (answers, reports) = diagnosed(workspace, blind, &sets, folder)?;
    score_all(&answers, &reports)
}

/// The command of the rivals: Python and its script.
fn rivals(workspace: &Workspace) -> Result<Vec<PathBuf>> {
    let python = python::environment(workspace, "rivals")?;
    Ok(vec![python, workspace.workspace_root.join("fixtures/rivals/rivals.py")])
}

/// Makes the recordings of all sets, seals their answers, has the recordings diagnosed, and opens the seal: answers of what was
/// diagnosed, and the folder with the reports.
fn diagnosed(workspace: &Workspace, blind: &Blind, sets: &[Set], folder: &Path) -> Result<(Answers, PathBuf)> {
    let generators = sets.iter().map(|set| Generator::of(workspace, set.origin, &blind.engine));
    let generators = generators.collect::<Result<Vec<_>>>()?;
    let qv = programs::qv(workspace)?;
    let at_most = blind.minutes.map(|minutes| Duration::from_secs_f64(60.0 * minutes.clamp(0.0, 1e6)));
    let rivals = if blind.baselines { rivals(workspace)? } else { Vec::new() };
    let diagnoses = Diagnoses { qv: &qv, rivals: &rivals, jobs: blind.jobs, at_most };
    diagnoses.check()?;
    // Another set, seed, engine or generator has a folder of its own.
    let words = [format!("{sets:?}"), blind.seed.to_string(), blind.engine.clone()];
    let files: Vec<PathBuf> = generators.iter().flat_map(|g| g.files.clone()).collect();
    let folder = folder.join(format!("{:016x}", pipeline::hash(&words, &files)?));
    let generated = generate::generate(&generators, sets, blind.seed, 2, &folder)?;
    let seal_file = folder.join("seal.json");
    let seal = seal::Seal::place(&generated.sealed_text(), &seal_file)?;
    println!("answers sealed in {}: SHA-256 {}", seal_file.display(), seal.sha256());
    let mut answers = generated.answers()?;
    let words = [format!("baselines {}", blind.baselines)];
    let scripts = rivals.iter().skip(1).map(|script| script.with_file_name("recording.py"));
    let programs: Vec<PathBuf> = [qv.clone()].into_iter().chain(rivals.iter().cloned()).chain(scripts).collect();
    let reports = diagnose::reports_folder(&generated.recordings, pipeline::hash(&words, &programs)?);
    let all = answers.recordings.len();
    let skipped: Vec<String> = answers.recordings.keys().take(blind.skip).cloned().collect();
    answers.recordings.retain(|name, _| !skipped.contains(name));
    let names: Vec<&String> = answers.recordings.keys().collect();
    diagnoses.run(&names, &generated.recordings, &reports)?;
    seal.open(&generated.sealed_text())?;
    println!("seal opened: {all} answers are those that were sealed");
    // From now on these recordings are burnt: rules may be tried on their evidence.
    let opened = folder.join("answers.json");
    fs::write(&opened, serde_json::to_string(&answers)?).with_context(|| format!("writing {}", opened.display()))?;
    answers.recordings.retain(|name, _| reports.join(name).is_dir());
    if !skipped.is_empty() {
        println!("{} of {all} left out, the first in the order of their names", skipped.len());
    }
    if answers.recordings.len() + skipped.len() < all {
        println!("{} of {all} were diagnosed; another run goes on", answers.recordings.len());
    }
    Ok((answers, reports))
}

fn score_all(answers: &Answers, reports: &Path) -> Result<Figures> {
    let all = answers.recordings.iter();
    let scored = all.map(|(name, answer)| score::score(name, answer, &reports.join(name)));
    Ok(figures::figures(scored.collect::<Result<_>>()?))
}
