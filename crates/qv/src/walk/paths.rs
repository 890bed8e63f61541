//! `qv walk paths`: how far a robot with hidden effects strays from the paths that its commands describe.

use super::made_up::MadeUp;
use crate::open::write_error;
use crate::output::write_whole;
use crate::{Failure, Outcome, say};
use qv_residual::hidden::SCORED;
use qv_residual::paths::commands;
use serde_json::json;
use std::fs;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Paths {
    /// Policies of `qv walk train` or `qv tune` (policy.onnx)
    #[arg(required = true, value_name = "POLICY.onnx")]
    policies: Vec<PathBuf>,
    #[command(flatten)]
    made_up: MadeUp,
    /// Set the length of each walk
    #[arg(long, default_value_t = 8.0, value_name = "SECONDS", value_parser = crate::numbers::positive, help_heading = "What to test", hide_short_help = true)]
    seconds: f64,
    /// Run N walks over six kinds of command
    #[arg(long, default_value_t = 24, value_name = "N", value_parser = clap::value_parser!(u16).range(6..), help_heading = "What to test")]
    walks: u16,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE.json", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Paths {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        if !(1.0..=600.0).contains(&self.seconds) {
            return Err(format!("--seconds: expected 1 to 600, found {}", self.seconds).into());
        }
        let mut rows = Vec::new();
        let bar = crate::progress::progress(self.policies.len() as u64, "walking");
        for path in &self.policies {
            let walked = self.made_up.under(path)?;
            let wanted = commands(&walked.task.commands, self.walks.into(), SCORED + self.made_up.seed);
            let score = walked.hidden.score(
                &walked.robot,
                &walked.ground,
                &walked.policy,
                &walked.task,
                &wanted,
                self.seconds as f32,
                self.made_up.seed,
            )?;
            let line = format!(
                "{}: {:.3} ± {:.3} m from the commanded path over {} s, {} of {} walks fell\n",
                path.display(),
                score.position,
                score.position_se,
                self.seconds,
                score.fell,
                score.walks
            );
            if !self.json {
                bar.suspend(|| say(&line))?;
            }
            rows.push(json!({"policy": path, "robot": walked.hidden.name, "seconds": self.seconds, "paths": score}));
            bar.inc(1);
        }
        bar.finish_and_clear();
        let figures = json!({ "policies": rows });
        if let Some(file) = &self.out {
            if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
                fs::create_dir_all(folder).map_err(|e| write_error(folder, &e))?;
            }
            write_whole(file, serde_json::to_string_pretty(&figures)?.as_bytes())?;
        }
        if self.json {
            say(&format!("{figures}\n"))?;
        }
        Ok(Outcome::Done)
    }
}
