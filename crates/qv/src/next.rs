//! `qv next`: the motion that would distinguish the causes that a recording leaves open, as commands that a robot can play.

use crate::ground::{check_ground, terrain_of};
use crate::open::{file_error, find_gains, model_of, open_run, parameters_of, write_error};
use crate::output::{make_folder, put, stream};
use crate::progress::{Stages, remark};
use crate::{Outcome, RunArguments, say};
use qv_gap::decision::evidence::Evidence;
use qv_gap::next::{Hypothesis, Proposal, hypotheses, next};
use qv_gap::{Options, Progress, diagnose};
use qv_go2::synthetic::{Message, write_bag};
use qv_replay::{BagRobot, write_traces};

use qv_open::diagnosis::gap_error;
use qv_recording::run::Robot;
use qv_recording::{RecordingError, Run};
use qv_rollout::Trace;
use qv_sim::{Model, Terrain};
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;
use std::{fs, slice};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv diagnose arm.mcap --out out/why\n\
     \x20 qv next arm.mcap --diagnosis out/why --out out/next\n\
     \n\
     Results: next.json (all motions with the probability that each decides), commands.csv and commands.mcap (the best one).\n\
     Motions stay within the postures and speeds of the recording and the limits of the model. Review them before playback.",
    "3 done, but part of the input was lost (reported)"
);

/// Messages of a bag begin at this instant \[ns since the epoch\], so that the same motion is the same file.
const EPOCH: u64 = 1_000_000_000;

#[derive(clap::Args)]
pub struct Next {
    #[command(flatten)]
    run: RunArguments,
    /// Set the terrain: plane, or a labelled mesh (z up, frame of the poses)
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb", help_heading = "Input")]
    terrain: String,
    /// Read known simulator parameters (calibrated.toml)
    #[arg(long, value_name = "FILE.toml", help_heading = "Input")]
    params: Option<PathBuf>,
    /// Read the results of `qv diagnose` [default: diagnose first]
    #[arg(long, value_name = "DIR", help_heading = "Input")]
    diagnosis: Option<PathBuf>,
    /// Separate the N leading hypotheses
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u8).range(2..=8), help_heading = "What to test")]
    hypotheses: u8,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Next {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let mut run = open_run(&self.run)?;
        let model = model_of(&run, &self.run.run, self.run.reading.robot.as_deref())?;
        let terrain = terrain_of(&self.terrain)?;
        check_ground(&run, &terrain)?;
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let given = parameters_of(self.params.as_deref(), &model, &terrain)?;
        find_gains(slice::from_mut(&mut run), &model, &terrain, &given)?;
        let options = Options { given, ..Default::default() };
        let evidence = self.evidence(&run, &model, &terrain, &options)?;
        let all = hypotheses(&evidence, usize::from(self.hypotheses));
        let bar = Stages::new();
        let watch = |done: usize, count: usize| {
            let share = done as f64 / count.max(1) as f64;
            bar.begin((done + 1).min(count), count, "motion", Some(share));
        };
        let proposals = next(&run, &model, &terrain, &options, &all, &watch).map_err(gap_error)?;
        bar.finish();
        self.write(&proposals, &all)?;
        if self.json {
            say(&format!("{}\n", to_json(&proposals, &all)))?;
        } else {
            say(&format!("{}written to {}\n", table(&proposals, &all), self.out.display()))?;
        }
        Ok(Outcome::Done)
    }

    /// What a diagnosis measured of this recording.
    fn evidence(
        &self,
        run: &Run,
        model: &Model,
        terrain: &Terrain,
        options: &Options,
    ) -> Result<Evidence, RecordingError> {
        if let Some(directory) = &self.diagnosis {
            let path = directory.join("evidence.json");
            let expected = "what `qv diagnose` wrote";
            let text = fs::read_to_string(&path).map_err(|e| file_error(&path, expected, &e.to_string()))?;
            let evidence = Evidence::read(&text, &path.display().to_string()).map_err(gap_error)?;
            if evidence.joints != model.joint_names() {
                let found = format!("one of {}", evidence.joints.join(", "));
                let expected = format!("a diagnosis of a robot with the joints {}", model.joint_names().join(", "));
                return Err(file_error(&path, &expected, &found));
            }
            return Ok(evidence);
        }
        remark("the recording is diagnosed first; --diagnosis DIR takes what is there");
        let bar = Stages::new();
        let remarks = |at: &Progress| bar.begin(at.stage, at.stages, at.name, Some(at.done));
        let options = Options { given: options.given.clone(), progress: Some(&remarks), ..Default::default() };
        let found = diagnose(slice::from_ref(run), model, terrain, &options, 0).map_err(gap_error)?;
        bar.finish();
        Ok(found.evidence)
    }

    fn write(&self, proposals: &[Proposal], all: &[Hypothesis]) -> Result<(), RecordingError> {
        let Some(best) = proposals.first() else { return Ok(()) };
        let at = |name: &str| self.out.join(name);
        let [list, csv, bag] = ["next.json", "commands.csv", "commands.mcap"].map(at);
        put(&list, format!("{}\n", to_json(proposals, all))).map_err(|e| write_error(&list, &e))?;
        put(&csv, to_csv(&best.recording)).map_err(|e| write_error(&csv, &e))?;
        stream(&bag, |e| write_error(&bag, &e), |file| to_bag(&best.recording, file))
    }
}

fn to_json(proposals: &[Proposal], all: &[Hypothesis]) -> serde_json::Value {
    let one = |p: &Proposal| {
        json!({
            "motion": p.motion.name,
            "about": p.motion.about,
            "seconds": p.motion.position.len() as f64 * p.motion.interval,
            "gain": p.motion.gain,
            "worth": p.worth,
        })
    };
    json!({ "format": "qv-next/1", "hypotheses": all, "motions": proposals.iter().map(one).collect::<Vec<_>>() })
}

fn table(proposals: &[Proposal], all: &[Hypothesis]) -> String {
    let mut text = String::from("To be separated:\n");
    for hypothesis in all {
        let values: Vec<String> = hypothesis.values.iter().map(|v| format!("{v:.4}")).collect();
        let _ = writeln!(
            text,
            "  {} on {}, size {}, evidence {:.1} nats so far",
            hypothesis.effect,
            hypothesis.scope.join(", "),
            values.join(", "),
            hypothesis.evidence
        );
    }
    let _ = writeln!(text, "\ndecides  motion");
    for proposal in proposals {
        let _ = writeln!(
            text,
            "{:6.0} %  {}: {}",
            100.0 * proposal.worth.decides,
            proposal.motion.name,
            proposal.motion.about
        );
    }
    if let Some(best) = proposals.first() {
        let hardest = best.worth.pairs.iter().min_by(|a, b| a.probability.total_cmp(&b.probability));
        if let Some(pair) = hardest {
            let _ = writeln!(
                text,
                "\nHardest with {}: {} from {}, {:.0} %.",
                best.motion.name,
                pair.truth,
                pair.rival,
                100.0 * pair.probability
            );
        }
    }
    text
}

/// Commands as the columns of a run.csv.
fn to_csv(run: &Run) -> String {
    let c = &run.commands;
    let channels = [("cmd_pos", &c.position), ("cmd_kp", &c.kp), ("cmd_kd", &c.kd)];
    let channels: Vec<_> = channels.into_iter().filter_map(|(name, s)| Some((name, s.as_ref()?))).collect();
    let mut text = String::from("time");
    for (name, _) in &channels {
        run.joint_names.iter().for_each(|joint| text += &format!(",{name}.{joint}"));
    }
    text.push('\n');
    let rows = c.position.as_ref().map_or(0, |s| s.len());
    for row in 0..rows {
        let time = c.position.as_ref().map_or(0.0, |s| s.time[row]);
        let _ = write!(text, "{time:.6}");
        for (_, series) in &channels {
            series.row(row).iter().for_each(|x| {
                let _ = write!(text, ",{x:.6}");
            });
        }
        text.push('\n');
    }
    text
}

/// Commands as a bag: `/lowcmd` of a Go2, and for other robots a JointState with targets.
fn to_bag(run: &Run, out: impl std::io::Write + std::io::Seek) -> Result<(), RecordingError> {
    let Some(position) = &run.commands.position else { return Ok(()) };
    let is_go2 = matches!(&run.robot, Robot::Named(name) if name == "go2");
    if is_go2 && position.joints == 12 {
        return write_bag(&low_commands(run), out);
    }
    let trace = Trace {
        time: position.time.clone(),
        position: position.values.clone(),
        velocity: vec![0.0; position.values.len()],
        torque: vec![0.0; position.values.len()],
        foot_force: Vec::new(),
        base: Vec::new(),
        joints: position.joints,
    };
    Ok(write_traces(&[BagRobot::new("command", &run.joint_names, &trace)], EPOCH, out)?)
}

fn low_commands(run: &Run) -> Vec<Message> {
    let c = &run.commands;
    let Some(position) = &c.position else { return Vec::new() };
    let of = |series: &Option<qv_core::JointSeries>, fixed: f64, row: usize| -> [f64; 12] {
        let values = series.as_ref().filter(|s| row < s.len()).map(|s| s.row(row));
        std::array::from_fn(|j| values.map_or(fixed, |v| v[j]))
    };
    let one = |row: usize| {
        let command = qv_go2::messages::LowCmd {
            q: of(&c.position, 0.0, row),
            dq: [0.0; 12],
            tau: [0.0; 12],
            kp: of(&c.kp, run.actuator.kp.unwrap_or(0.0), row),
            kd: of(&c.kd, run.actuator.kd.unwrap_or(0.0), row),
        };
        let time = EPOCH + (position.time[row] * 1e9).round() as u64;
        Message { topic: "/lowcmd", time, data: qv_go2::messages::encode_low_cmd(&command) }
    };
    (0..position.len()).map(one).collect()
}
