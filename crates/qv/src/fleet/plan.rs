//! `qv fleet plan`: which recordings there are, and what is to be done with them.

use super::find::{files, recordings, with_companions};
use super::folder::{Folder, check_own};
use super::hash;
use crate::output::{OutputFolder, write_whole};
use crate::progress::progress;
use crate::{Failure, Outcome, say};
use qv_fleet::{Command, InputFile, Plan as Units, Recording, RefusedPath, Task, sha256};
use qv_open::{Reading, open_run};
use qv_recording::run::Robot;
use rayon::prelude::*;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Lines of what could not be opened that are printed.
const TOLD: usize = 10;
/// Digits of the hash by which robots of one name and different models are distinguished.
const DIGITS: usize = 6;

/// What makes recordings be of one robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum By {
    /// Model name and, where recorded, URDF
    Model,
    /// Folder directly below DIR, for several robots of one model
    Folder,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum What {
    Diagnose,
    Contact,
    Tune,
    #[value(hide = true)]
    Rehearse,
}

impl What {
    fn command(self) -> Command {
        match self {
            Self::Diagnose => Command::Diagnose,
            Self::Contact => Command::Contact,
            Self::Tune => Command::Tune,
            Self::Rehearse => Command::Rehearse,
        }
    }
}

#[derive(clap::Args)]
pub struct Plan {
    /// Recordings, or directories to search for recordings
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Write the plan into this directory; finished units are kept
    #[arg(long, value_name = "FLEET", help_heading = "Output")]
    out: PathBuf,
    /// Run this command on each unit
    #[arg(long, value_enum, default_value = "diagnose", value_name = "COMMAND", help_heading = "What to test")]
    command: What,
    /// Make one unit per robot instead of one per recording
    #[arg(long, help_heading = "What to test")]
    group: bool,
    /// Group recordings into robots by model or by folder
    #[arg(long, value_enum, default_value = "model", value_name = "model|folder", help_heading = "What to test")]
    robots_by: By,
    /// Open N recordings at once
    #[arg(long, default_value_t = 2, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256), help_heading = "Advanced")]
    jobs: u16,
    /// Options passed to the command, after --
    #[arg(last = true, value_name = "OPTION")]
    options: Vec<String>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Plan {
    /// With `root`, the command that all others are in.
    pub fn execute(&self, root: clap::Command) -> Result<Outcome, Failure> {
        self.check_options(root)?;
        if let Some(folder) = self.folders.iter().find(|folder| !folder.exists()) {
            return Err(format!("{}: expected a folder with recordings, found nothing", folder.display()).into());
        }
        let mut paths: Vec<(PathBuf, PathBuf)> = Vec::new();
        for folder in &self.folders {
            paths.extend(recordings(folder, &self.out).into_iter().map(|path| (folder.clone(), path)));
        }
        if paths.is_empty() {
            let folders: Vec<String> = self.folders.iter().map(|f| f.display().to_string()).collect();
            return Err(format!("{}: expected recordings below it, found none", folders.join(", ")).into());
        }
        // Only now, so that a plan of nothing leaves nothing behind.
        let _lock = Folder::lock(&self.out)?;
        let bar = progress(paths.len() as u64, "reading");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(self.jobs)).build()?;
        let read = |(folder, path): &(PathBuf, PathBuf)| {
            let found = self.recording(folder, path);
            bar.inc(1);
            found.map_err(|reason| RefusedPath { path: path.display().to_string(), reason })
        };
        let found: Vec<Result<Recording, RefusedPath>> = pool.install(|| paths.par_iter().map(read).collect());
        bar.finish_and_clear();
        let (mut good, mut refused) = (Vec::new(), Vec::new());
        for one in found {
            match one {
                Ok(recording) => good.push(recording),
                Err(why) => refused.push(why),
            }
        }
        let plan = Units::new(self.task()?, good, refused, self.group);
        let out = OutputFolder::take(&self.out)?;
        let written = write_whole(&self.out.join("plan.json"), plan.to_text().as_bytes());
        out.end(written.is_ok())?;
        written?;
        say(&if self.json { line(&plan) } else { summary(&plan, &self.out) })?;
        Ok(if plan.refused.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    /// Looks whether the command would take the options, so that this is said now and not by every unit.
    fn check_options(&self, root: clap::Command) -> Result<(), Failure> {
        check_own(&self.options)?;
        let words =
            ["qv"].into_iter().chain(self.command.command().words().iter().copied()).chain(["RUN", "--out", "OUT"]);
        let words = words.chain(self.options.iter().map(String::as_str));
        match root.try_get_matches_from(words) {
            Ok(_) => Ok(()),
            Err(error) => {
                let text = error.to_string();
                // What is missing stands on lines of its own, up to an empty one.
                let first: Vec<&str> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
                let first = first.join(" ").trim_start_matches("error: ").to_owned();
                Err(format!(
                    "options after --: expected those of qv {}, found: {first}",
                    self.command.command().words().join(" ")
                )
                .into())
            }
        }
    }

    fn task(&self) -> Result<Task, Failure> {
        let folder = std::env::current_dir().map_err(|e| format!("expected a current folder, found {e}"))?;
        Ok(Task {
            version: env!("CARGO_PKG_VERSION").into(),
            command: self.command.command(),
            options: self.options.clone(),
            option_files: self.option_files()?,
            folder: stored(&folder)?,
        })
    }

    /// The files that options name.
    fn option_files(&self) -> Result<Vec<InputFile>, Failure> {
        let values = self.options.iter().map(|word| word.split_once('=').map_or(word.as_str(), |(_, value)| value));
        let paths: Vec<PathBuf> = values.map(PathBuf::from).filter(|path| path.exists()).collect();
        let mut all: Vec<PathBuf> = Vec::new();
        for path in paths {
            all.extend(if path.is_dir() { files(&path) } else { with_companions(&path) });
        }
        all.iter().map(|path| hash::input(path)).collect()
    }

    /// The value of an option that is passed on, and by which recordings are read.
    fn passed(&self, name: &str) -> Option<String> {
        let mut words = self.options.iter();
        while let Some(word) = words.next() {
            if word == name {
                return words.next().cloned();
            }
            if let Some(value) = word.strip_prefix(name).and_then(|rest| rest.strip_prefix('=')) {
                return Some(value.to_owned());
            }
        }
        None
    }

    fn recording(&self, folder: &Path, path: &Path) -> Result<Recording, String> {
        let real = path.canonicalize().map_err(|e| format!("{}: expected a recording, found {e}", path.display()))?;
        let stored = stored(&real)?;
        let reading = Reading {
            pose_topic: self.passed("--pose-topic"),
            // For tuning it names what the policy was trained for, in another way.
            robot: self.passed("--robot").filter(|_| !matches!(self.command, What::Tune)),
            namespace: self.passed("--namespace"),
            ..Reading::default()
        };
        let run = open_run(&real, &reading, &|_, _| {}).map_err(|e| e.to_string())?;
        let inputs: Result<Vec<InputFile>, Failure> = files(&real).iter().map(|file| hash::input(file)).collect();
        let [start, end] = run.span();
        Ok(Recording {
            path: stored,
            robot: match self.robots_by {
                By::Model => model_name(&run.robot),
                By::Folder => folder_name(folder, path),
            },
            start_ns: (run.epoch > 0).then_some(run.epoch),
            seconds: end - start,
            files: inputs.map_err(|e| e.to_string())?,
        })
    }
}

/// A path as text, by which it is found again.
fn stored(path: &Path) -> Result<String, String> {
    let text = path.to_str().map(str::to_owned);
    text.ok_or_else(|| {
        format!("cannot store the path '{}': its bytes are no UTF-8; give it another name", path.display())
    })
}

/// The name of a robot; models that recordings bring along are distinguished by their contents.
fn model_name(robot: &Robot) -> String {
    let text = match robot {
        Robot::Named(name) => return name.clone(),
        Robot::Urdf(text) => text,
    };
    let root =
        ["<robot", "<mujoco"].iter().find_map(|tag| text.split_once(tag)?.1.split_once('>').map(|(head, _)| head));
    let value = |key: &str| {
        let rest = root?.split_once(key)?.1.trim_start().strip_prefix('=')?.trim_start();
        let quote = rest.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        rest[1..].split(quote).next().map(str::to_owned)
    };
    let name = value("name").or_else(|| value("model")).unwrap_or_else(|| "robot".into());
    format!("{name} ({})", &sha256(text.as_bytes())[..DIGITS])
}

/// The folder directly below `folder` on the way to `path`.
fn folder_name(folder: &Path, path: &Path) -> String {
    let inside = path.strip_prefix(folder).unwrap_or(path);
    let first = inside.components().next().map(|c| c.as_os_str().to_string_lossy().into_owned());
    first.filter(|name| !name.is_empty()).unwrap_or_else(|| folder.display().to_string())
}

fn line(plan: &Units) -> String {
    let robots: std::collections::BTreeSet<&str> = plan.units.iter().map(|u| u.robot.as_str()).collect();
    let value = serde_json::json!({"format": "qv-fleet-planned/1", "units": plan.units.len(), "robots": robots,
        "refused": plan.refused, "repeated": plan.repeated});
    format!("{value}\n")
}

fn summary(plan: &Units, out: &Path) -> String {
    let mut text = String::new();
    let mut robots: std::collections::BTreeMap<&str, [f64; 3]> = Default::default();
    for unit in &plan.units {
        let of_it = robots.entry(&unit.robot).or_default();
        let seconds: f64 = unit.recordings.iter().map(|r| r.seconds).sum();
        [1.0, unit.recordings.len() as f64, seconds].iter().zip(of_it).for_each(|(x, sum)| *sum += x);
    }
    let _ = writeln!(text, "{:<40} {:>7} {:>11} {:>9}", "robot", "units", "recordings", "minutes");
    for (robot, [units, recordings, seconds]) in &robots {
        let _ = writeln!(text, "{robot:<40} {units:>7} {recordings:>11} {:>9.1}", seconds / 60.0);
    }
    for one in &plan.repeated {
        let _ = writeln!(text, "{}: the same as {}, done once", one.path, one.same_as);
    }
    for one in plan.refused.iter().take(TOLD) {
        let _ = writeln!(text, "{} cannot be used: {}", one.path, one.reason);
    }
    if plan.refused.len() > TOLD {
        let _ = writeln!(text, "and {} more, see plan.json", plan.refused.len() - TOLD);
    }
    let _ = writeln!(text, "written to {}; next: qv fleet run {}", out.join("plan.json").display(), out.display());
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robots_have_names() {
        assert_eq!(model_name(&Robot::Named("go2".into())), "go2");
        let of = |text: &str| model_name(&Robot::Urdf(text.into()));
        assert!(of("<?xml version=\"1.0\"?><robot xmlns=\"x\" name = 'arm'><link name=\"a\"/>").starts_with("arm ("));
        assert!(of("<mujoco model=\"leg\"/>").starts_with("leg (") && of("<robot>").starts_with("robot ("));
        assert_ne!(of("<robot name=\"a\"/>"), of("<robot name=\"a\"></robot>"));
        assert_eq!(folder_name(Path::new("lab"), Path::new("lab/rex/monday/run.mcap")), "rex");
        assert_eq!(folder_name(Path::new("lab/run.mcap"), Path::new("lab/run.mcap")), "lab/run.mcap");
    }
}
