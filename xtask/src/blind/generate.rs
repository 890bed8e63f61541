//! The sealed recordings: made once for a seed and a program, their answers kept in memory.

use super::answers::Answers;
use crate::workspace::Workspace;
use crate::{pipeline, process, programs, python};
use anyhow::{Context, Result};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What makes recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Origin {
    /// A Go2 in the second engine, rapier.
    Rapier,
    /// A Go2 in MuJoCo.
    Walks,
    /// Arms of many sizes in MuJoCo.
    Arms,
}

/// What to record.
#[derive(Debug, Clone, PartialEq)]
pub struct Set {
    /// What makes them.
    pub origin: Origin,
    /// Effects to record one at a time; `all` for the whole library.
    pub effects: Vec<&'static str>,
    /// Recordings of each.
    pub per_effect: usize,
    /// Recordings without effect, with a withheld one, and with two at once.
    pub none: usize,
    pub withheld: usize,
    pub pairs: usize,
}

/// Effects of the small set: one or two of each interface.
const FEW: [&str; 6] =
    ["command_latency", "joint_coulomb_friction", "motor_strength", "payload_mass", "ground_friction", "imu_tilt"];

impl Set {
    /// All effects: half of the recordings are rapier's, the others MuJoCo's.
    pub fn full(per_effect: usize) -> Vec<Self> {
        let set = |origin, share: usize, none, withheld, pairs| {
            let per_effect = (share * per_effect).div_ceil(10);
            Self { origin, effects: vec!["all"], per_effect, none, withheld, pairs }
        };
        vec![set(Origin::Rapier, 5, 10, 18, 10), set(Origin::Walks, 3, 6, 14, 8), set(Origin::Arms, 5, 10, 9, 6)]
    }

    /// A few effects, for a quick look.
    pub fn subset(per_effect: usize) -> Vec<Self> {
        let set = |origin, effects: &[&'static str]| Self {
            origin,
            effects: effects.to_vec(),
            per_effect,
            none: 2,
            withheld: 2,
            pairs: 0,
        };
        vec![set(Origin::Rapier, &FEW), set(Origin::Walks, &FEW), set(Origin::Arms, &FEW[..4])]
    }

    /// Arguments of the generator, one list for each part that is made and kept on its own.
    fn parts(&self) -> Vec<Vec<String>> {
        let count = |name: &str, count: usize| (count > 0).then(|| vec![format!("--{name}"), count.to_string()]);
        let effects = self.effects.join(",");
        let round = |turn: usize| {
            let words = ["--effects", &effects, "--per-effect", "1", "--first-turn", &turn.to_string()];
            words.map(String::from).to_vec()
        };
        let mut parts: Vec<Vec<String>> = (0..self.per_effect).map(round).collect();
        parts.extend(count("none", self.none));
        parts.extend(count("withheld", self.withheld));
        parts.extend(count("pairs", self.pairs));
        parts
    }
}

/// Recordings on disk and answers in memory.
pub struct GeneratedSet {
    /// Folder with a folder for each recording.
    pub recordings: PathBuf,
    /// The documents that the generator printed.
    pub documents: Vec<String>,
}

impl GeneratedSet {
    /// What was generated, as one text to be sealed.
    pub fn sealed_text(&self) -> String {
        self.documents.concat()
    }

    /// The answers.
    ///
    /// # Errors
    /// The generator printed something else.
    pub fn answers(&self) -> Result<Answers> {
        Answers::join(self.documents.iter().map(String::as_str))
    }
}

/// A program that makes recordings and prints their answers.
pub struct Generator {
    command: Vec<PathBuf>,
    options: Vec<String>,
    /// What it is made of.
    pub files: Vec<PathBuf>,
}

impl Generator {
    /// Builds or installs it.
    ///
    /// # Errors
    /// It does not build, or its Python environment cannot be made.
    pub fn of(workspace: &Workspace, origin: Origin, engine: &str) -> Result<Self> {
        let script = match origin {
            Origin::Rapier => {
                let program = build(workspace)?;
                let options = vec!["--engine".into(), engine.into()];
                return Ok(Self { command: vec![program.clone()], options, files: vec![program] });
            }
            Origin::Walks => "walks.py",
            Origin::Arms => "arms.py",
        };
        let python = python::environment(workspace, "sealed")?;
        let folder = workspace.workspace_root.join("fixtures/sealed");
        let entries = fs::read_dir(&folder).with_context(|| format!("reading {}", folder.display()))?;
        let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        files.retain(|file| file.is_file());
        files.push(workspace.workspace_root.join("fixtures/mujoco/go2_mjcf.py"));
        files.sort();
        Ok(Self { command: vec![python, folder.join(script)], options: Vec::new(), files })
    }

    /// What shows its seeds from those of the other generators; nothing of rapier's, whose recordings are older.
    fn words(&self) -> Vec<String> {
        self.command[1..].iter().filter_map(|file| Some(file.file_name()?.to_str()?.to_string())).collect()
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.command[0]);
        // What Python keeps of its modules would lie beside the sources.
        command.args(&self.command[1..]).args(&self.options).env("PYTHONDONTWRITEBYTECODE", "1");
        command
    }
}

/// Builds rapier's generator, whichever crate has it.
///
/// # Errors
/// No crate has it, or it does not build.
pub fn build(workspace: &Workspace) -> Result<PathBuf> {
    let owner = workspace.members().find(|package| package.has_example("sealed_recordings"));
    let owner = owner.context("expected a crate with the example sealed_recordings, found none")?;
    let folder =
        programs::build(workspace, &[&owner.name], &["--features", "rapier", "--example", "sealed_recordings"])?;
    Ok(folder.join("examples").join(programs::file("sealed_recordings")))
}

/// Makes what is not there yet into `folder`.
///
/// # Errors
/// The generator fails, or the folder cannot be written.
pub fn generate(generators: &[Generator], sets: &[Set], seed: u64, jobs: usize, folder: &Path) -> Result<GeneratedSet> {
    let recordings = folder.join("recordings");
    fs::create_dir_all(&recordings).with_context(|| format!("making {}", recordings.display()))?;
    let kept = folder.join("redraws.json");
    let mut redraws: BTreeMap<String, u64> = match fs::read_to_string(&kept) {
        Ok(text) => serde_json::from_str(&text).with_context(|| format!("in {}", kept.display()))?,
        Err(_) => BTreeMap::new(),
    };
    let of_set = |(generator, set): (_, &Set)| set.parts().into_iter().map(move |part| (generator, part));
    let parts: Vec<(&Generator, Vec<String>)> = generators.iter().zip(sets).flat_map(of_set).collect();
    let bar = bar(parts.len(), "recording");
    let mut documents = Vec::new();
    for (generator, part) in &parts {
        fs::write(&kept, serde_json::to_string(&redraws)?).with_context(|| format!("writing {}", kept.display()))?;
        // A seed of its own for each part, so that no two make the same names.
        let own = pipeline::hash(&[vec![seed.to_string()], generator.words(), part.clone()].concat(), &[])?;
        let mut command = generator.command();
        command.arg("--out").arg(&recordings).arg("--redraws").arg(&kept).args(part);
        command.args(["--seed", &own.to_string(), "--jobs", &jobs.to_string()]);
        let document = process::output(&mut command)?;
        let answers = Answers::read(&document)?;
        redraws.extend(answers.recordings.iter().map(|(name, answer)| (name.clone(), answer.redraws)));
        documents.push(document);
        bar.inc(1);
    }
    bar.finish_and_clear();
    fs::write(&kept, serde_json::to_string(&redraws)?).with_context(|| format!("writing {}", kept.display()))?;
    Ok(GeneratedSet { recordings, documents })
}

/// A progress bar; silent where there is no terminal.
pub fn bar(count: usize, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(count as u64).with_message(what);
    let style = ProgressStyle::with_template("{msg} {bar:30} {pos}/{len}, {elapsed}, {eta} left");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_asks_for_something_of_its_own() {
        let origin = Origin::Rapier;
        let parts = Set { origin, effects: vec!["a", "b"], per_effect: 2, none: 1, withheld: 0, pairs: 3 }.parts();
        assert_eq!(parts.len(), 4);
        assert_eq!(parts[0], ["--effects", "a,b", "--per-effect", "1", "--first-turn", "0"]);
        assert_eq!(parts[3], ["--pairs", "3"]);
        let mut different = parts.clone();
        different.sort();
        different.dedup();
        assert_eq!(different.len(), parts.len());
    }
}
