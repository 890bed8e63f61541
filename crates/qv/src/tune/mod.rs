//! `qv tune`: recordings of a robot under its policy become a policy that follows its commands better.

mod keep;
mod page;
mod recordings;

use crate::open::{file_error, parameters_of, write_error};
use crate::output::{is_same, make_folder, write_whole};
use crate::progress::{Stages, remark};
use crate::walk::inputs::{as_trained, checkpoint_of, ground_of, policy_of, robot_of};
use crate::{Failure, Outcome, say};
use keep::Folder;
use qv_policy::policy::PolicyFile;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, TaskRobot};
use qv_residual::close::{Event, Inputs, LoopSettings, Outcome as Closed, Report, close};
use qv_residual::log::Log;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv walk train --out out/walk\n\
     \x20 qv walk record out/walk/policy.onnx --out out/log      # a simulated robot with hidden effects; use your own recordings\n\
     \x20 qv tune out/log --policy out/walk/policy.onnx --out out/tuned\n\
     \n\
     Results: policy.onnx (fine-tuned in the corrected simulator), tune.html (path-tracking error before and after), tune.json.\n\
     Guide: docs/guide/tuning.md.",
    "3 part of the recordings could not be used"
);

#[derive(clap::Args)]
pub struct Tune {
    /// Recordings of the robot walking under the policy
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Read the policy of `qv walk train` (with policy.toml, checkpoint.bin)
    #[arg(long, value_name = "FILE.onnx", help_heading = "Input")]
    policy: PathBuf,
    /// Set the robot: go2, go1, a1, a2, anymal_c, or a URDF, MJCF or TOML file
    #[arg(long, default_value = "go2", value_name = "ROBOT", help_heading = "Input")]
    robot: String,
    /// Set the terrain of the recordings: plane, or a labelled mesh
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb", help_heading = "Input")]
    terrain: String,
    /// Set the training terrain [default: that of the recordings]
    ///
    /// Policies are trained and compared there. A small scene has no room for walks of 8 s.
    #[arg(long, value_name = "plane|bumps|levels|FILE.glb", help_heading = "Training", hide_short_help = true)]
    train_on: Option<String>,
    /// Add calibrated.toml of `qv diagnose` as a candidate
    #[arg(long, value_name = "FILE.toml", alias = "calibrated", help_heading = "Input")]
    params: Option<PathBuf>,
    /// Read all settings (settings.toml of an earlier run)
    #[arg(long, value_name = "FILE.toml", help_heading = "Advanced", hide_short_help = true)]
    settings: Option<PathBuf>,
    /// Train each policy for N iterations (24 steps of all robots each)
    #[arg(long, value_name = "N", help_heading = "Training")]
    iterations: Option<u64>,
    /// Set the random seed
    #[arg(long, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    seed: Option<u64>,
    /// Read base poses from this topic [default: /Odometry, else any]
    #[arg(long, value_name = "TOPIC", help_heading = "Input", hide_short_help = true)]
    pose_topic: Option<String>,
    /// Use N threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), help_heading = "Advanced", hide_short_help = true)]
    threads: Option<u16>,
    /// Write the results into this directory; finished stages are kept
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Tune {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let settings = self.settings()?;
        let (_, file) = policy_of(&self.policy)?;
        let robot = as_trained(robot_of(&self.robot)?, &file, &self.policy)?;
        let start = checkpoint_of(&self.policy, &robot)?;
        let ground = ground_of(&self.terrain, settings.tune.seed)?;
        let train_on = ground_of(self.train_on.as_ref().unwrap_or(&self.terrain), settings.tune.seed)?;
        let given = match &self.params {
            None => None,
            Some(path) => Some(parameters_of(Some(path), &robot.model, &ground.terrain)?),
        };
        let (log, refused) =
            recordings::read(&self.recordings, self.pose_topic.as_deref(), &robot, &start.settings.task)?;
        let own = self.policy.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if is_same(&self.out, own) {
            let found = "the folder of --policy, whose files would be written over";
            return Err(file_error(&self.out, "another folder for --out", found).into());
        }
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads.map_or(0, usize::from)).build()?;
        let work = Work {
            tune: self,
            robot: &robot,
            grounds: [&ground, &train_on],
            start: &start,
            file: &file,
            given,
            log: &log,
            settings,
        };
        // Errors of the command line stay on their thread: this one crosses as its text.
        let done = pool.install(|| work.run().map_err(|e| e.to_string()));
        done?;
        Ok(if refused > 0 || !log.remarks.is_empty() { Outcome::Partial } else { Outcome::Done })
    }

    fn settings(&self) -> Result<LoopSettings, Failure> {
        let mut settings = match &self.settings {
            None => LoopSettings::default(),
            Some(path) => {
                let expected = "settings of `qv tune`";
                let text = fs::read_to_string(path).map_err(|e| file_error(path, expected, &e.to_string()))?;
                let mut table: toml::Table =
                    toml::from_str(&text).map_err(|e| file_error(path, expected, &e.to_string()))?;
                if table.remove("nets").is_some() {
                    remark(&format!("'{}': ignored [nets]: residual networks were removed", path.display()));
                }
                table.try_into().map_err(|e| file_error(path, expected, &e.to_string()))?
            }
        };
        settings.tune.iterations = self.iterations.unwrap_or(settings.tune.iterations);
        settings.tune.seed = self.seed.unwrap_or(settings.tune.seed);
        settings.check()?;
        Ok(settings)
    }
}

/// What the work needs.
struct Work<'a> {
    tune: &'a Tune,
    robot: &'a TaskRobot,
    /// Of the recordings, and of the training.
    grounds: [&'a Ground; 2],
    start: &'a Checkpoint,
    file: &'a PolicyFile,
    given: Option<Vec<(String, f64)>>,
    log: &'a Log,
    settings: LoopSettings,
}

impl Work<'_> {
    fn run(&self) -> Result<(), Failure> {
        let inputs = Inputs {
            robot: self.robot,
            ground: self.grounds[0],
            train_on: self.grounds[1],
            log: self.log,
            start: self.start,
            given: self.given.as_deref(),
            settings: &self.settings,
        };
        let keep = Folder::new(&self.tune.out, &inputs)?;
        let bar = Stages::new();
        let mut at = (1, 1);
        let closed = close(&inputs, &keep, &mut |event| match event {
            Event::Stage(name, number, count) => {
                at = (number, count);
                bar.begin(number, count, name.as_ref(), None);
            }
            // Stages are taken to be of one length: those that train are, and there are few others.
            Event::Progress(share, figure) => {
                let (number, count) = (at.0 as f64, at.1.max(1) as f64);
                bar.at((number - 1.0 + share) / count, figure.as_ref());
            }
        })?;
        bar.finish();
        self.write(&closed)?;
        if self.tune.json {
            say(&format!("{}\n", serde_json::to_string(&closed.report)?))?;
            return Ok(());
        }
        say(&sentences(&closed.report))?;
        say(&format!("Written to {}: policy.onnx, compensator.onnx, tune.json, tune.html\n", self.tune.out.display()))?;
        Ok(())
    }

    fn write(&self, closed: &Closed) -> Result<(), Failure> {
        let Report { chosen, candidates, .. } = &closed.report;
        let put = |name: &str, bytes: &[u8]| write_whole(&self.tune.out.join(name), bytes);
        let mut file = self.file.clone();
        let onnx = match chosen {
            None => fs::read(&self.tune.policy)?,
            Some(_) => {
                // The score of the training is of another policy.
                file.score = None;
                closed.policy.to_onnx(self.robot)?
            }
        };
        put("policy.onnx", &onnx)?;
        put("policy.toml", file.to_text()?.as_bytes())?;
        // So that the policy can be tuned again, on what the robot records under it.
        let start = match (chosen, &self.start.best) {
            (None, _) => self.start.clone(),
            (Some(_), best) => {
                let score = best.as_ref().map(|(score, _)| score.clone()).unwrap_or_default();
                Checkpoint { best: Some((score, closed.policy.parameters.clone())), ..self.start.clone() }
            }
        };
        put("checkpoint.bin", &start.to_bytes()?)?;
        // Corrections that stay are worth something to others, though no policy is better for them.
        let staying = candidates.iter().rposition(|c| c.held_out.stays);
        let compensation = &candidates[chosen.or(staying).unwrap_or(0)].compensation;
        put("compensator.json", serde_json::to_string_pretty(compensation)?.as_bytes())?;
        put("compensator.onnx", &compensation.to_onnx(self.robot)?)?;
        let mut text = String::from("# What `qv tune` found; for --params of every command.\n[parameters]\n");
        let calibrated = &candidates[closed.report.calibrated].compensation.parameters;
        calibrated.iter().for_each(|(name, x)| _ = writeln!(text, "\"{name}\" = {x:?}"));
        put("calibrated.toml", text.as_bytes())?;
        put("settings.toml", toml::to_string(&self.settings)?.as_bytes())?;
        put("tune.json", serde_json::to_string_pretty(&closed.report)?.as_bytes())?;
        put("tune.html", page::page(&closed.report).as_bytes())
    }
}

/// What was found, in words.
pub fn sentences(report: &Report) -> String {
    let mut text = String::new();
    for candidate in &report.candidates {
        let held = &candidate.held_out;
        _ = writeln!(
            text,
            "{:<33} joints are off by {:5.1} ± {:.1} mrad after {} s on held-out recordings{}",
            candidate.compensation.kind,
            1e3 * held.error,
            1e3 * held.error_se,
            report.settings.window,
            if held.stays { "" } else { "; not better by more than chance: left out" }
        );
    }
    _ = writeln!(text, "{}", report.why);
    text
}
