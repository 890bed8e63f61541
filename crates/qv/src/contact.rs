//! `qv contact`: friction of each material of a labelled ground.

use crate::ask::ask;
use crate::ground::mesh_at;
use crate::numbers::within;
use crate::open::{file_error, lost_from, lost_from_model, model_of, open_run, parameters_of, remarks_of, write_error};
use crate::output::{make_folder, put};
use crate::progress::{Stages, remark};
use crate::provenance::provenance;
use crate::terminal::print_message;
use crate::{Outcome, Reading, RunArguments, say};
use qv_contact::report::Status;
use qv_contact::{ContactError, Ground, Options, Prior, Report, calibrate, html, prior};
use qv_core::TriangleMesh;
use qv_mesh::files::glb;
use qv_recording::{RecordingError, Run};
use qv_rollout::RolloutError;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv contact walk.mcap --terrain yard.glb --out out/contact\n\
     \x20 qv contact monday.mcap tuesday.mcap --terrain yard.glb --params out/why/calibrated.toml --out out/contact\n\
     \x20 qv contact walk.mcap --terrain yard.glb --ask http://localhost:8080/v1 --model NAME --out out/contact\n\
     \n\
     Results: contact.json, contact.html, calibrated.toml (for --params), terrain.glb (the mesh with the identified friction).\n\
     --friction-prior reads JSON: {\"grass\": {\"mean\": 0.5, \"sd\": 0.15, \"source\": \"..\"}}.",
    "3 done, but part of the input was lost (reported)"
);

/// Share of the time that simulations take.
const SIMULATING: f64 = 0.98;

#[derive(clap::Args)]
pub struct Contact {
    /// Recordings of one robot on one terrain: bags or tables
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Set the terrain: a mesh with one material per label
    #[arg(long, value_name = "FILE.glb", help_heading = "Input")]
    terrain: PathBuf,
    #[command(flatten)]
    reading: Reading,
    /// Read known simulator parameters (calibrated.toml)
    #[arg(long, value_name = "FILE.toml", help_heading = "Input")]
    params: Option<PathBuf>,
    /// Replace the built-in table of material friction
    #[arg(long, value_name = "FILE.toml", help_heading = "Advanced", hide_short_help = true)]
    materials: Option<PathBuf>,
    /// Read friction priors by label: {"grass": {"mean": .., "sd": ..}}
    #[arg(long, value_name = "FILE.json", conflicts_with = "ask", help_heading = "Advanced", hide_short_help = true)]
    friction_prior: Option<PathBuf>,
    /// Query an OpenAI-compatible endpoint for priors (key: QV_API_KEY)
    #[arg(long, value_name = "URL", requires = "model", help_heading = "Advanced", hide_short_help = true)]
    ask: Option<String>,
    /// Set the language model of --ask
    #[arg(long, value_name = "NAME", requires = "ask", help_heading = "Advanced", hide_short_help = true)]
    model: Option<String>,
    /// Keep the prior where prior and posterior both exceed this friction
    ///
    /// The grid search skips labels with such a prior unless feet slip on them.
    #[arg(long, default_value_t = 0.5, value_name = "FRICTION", value_parser = friction, help_heading = "Advanced", hide_short_help = true)]
    slip_threshold: f64,
    /// Set the uniform friction used as the baseline
    #[arg(long, default_value_t = 0.8, value_name = "FRICTION", value_parser = friction, help_heading = "Advanced", hide_short_help = true)]
    uniform: f64,
    /// Set the length of open-loop segments for the base error
    #[arg(long, default_value_t = 2.0, value_name = "SECONDS", value_parser = segment, help_heading = "Advanced", hide_short_help = true)]
    segment: f64,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Contact {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let mesh = self.mesh()?;
        self.make_out()?;
        let ground = Ground::new(&mesh).map_err(|e| self.of_terrain(e))?;
        let priors = self.priors(&ground.labels())?;
        let open = |path: &PathBuf| open_run(&RunArguments { run: path.clone(), reading: self.reading.clone() });
        let runs: Vec<Run> = self.runs.iter().map(open).collect::<Result<_, _>>()?;
        let model = model_of(&runs[0], &self.runs[0], self.reading.robot.as_deref())?;
        let means: Vec<f64> = priors.iter().map(|p| p.mean).collect();
        let terrain = ground.terrain(&means).map_err(|e| self.of_terrain(e))?;
        let given = parameters_of(self.params.as_deref(), &model, &terrain)?;
        let bar = Stages::new();
        bar.begin(1, 2, "simulating", None);
        let remarks = |share: f64| bar.at(SIMULATING * share, "");
        let clock = Instant::now();
        let seconds = || clock.elapsed().as_secs_f64();
        let options = Options {
            given,
            slip_threshold: self.slip_threshold,
            uniform: self.uniform,
            segment: self.segment,
            clock: Some(&seconds),
            progress: Some(&remarks),
            ..Default::default()
        };
        let report = calibrate(&runs, &model, &mesh, &priors, &options).map_err(replay_error)?;
        bar.begin(2, 2, "writing", Some(SIMULATING));
        let mut lost: Vec<String> = runs.iter().flat_map(lost_from).collect();
        lost.extend(lost_from_model(&model));
        self.write(&report, &ground, &lost)?;
        bar.finish();
        if self.json {
            say(&format!("{}\n", line(&report, &lost)))?;
        } else {
            say(&format!("{}written to {}\n", summary(&report), self.out.display()))?;
        }
        remarks_of(&runs[0], &model).iter().for_each(|what| remark(what));
        lost.iter().for_each(|what| print_message!("{what}"));
        Ok(if lost.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    /// Makes the folder before the work, and refuses to write over the terrain that is read.
    fn make_out(&self) -> Result<(), RecordingError> {
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let real = |path: &Path| path.canonicalize().ok();
        if real(&self.out.join("terrain.glb")).is_some_and(|ours| Some(ours) == real(&self.terrain)) {
            return Err(file_error(
                &self.terrain,
                "a terrain outside of --out, where terrain.glb is written",
                "one in it",
            ));
        }
        Ok(())
    }

    fn mesh(&self) -> Result<TriangleMesh, RecordingError> {
        mesh_at(&self.terrain, "a .glb file")
    }

    fn of_terrain(&self, error: ContactError) -> RecordingError {
        match error {
            ContactError::Run(error) => file_error(&self.terrain, &error.expected, &error.found),
            other => replay_error(other),
        }
    }

    fn priors(&self, labels: &[String]) -> Result<Vec<Prior>, RecordingError> {
        let table = match &self.materials {
            None => prior::built_in(),
            Some(path) => {
                let text = read(path, "a table of materials")?;
                prior::parse(&text, &path.display().to_string()).map_err(replay_error)?
            }
        };
        let priors = prior::from_table(labels, &table).map_err(replay_error)?;
        let answer = match (&self.friction_prior, &self.ask, &self.model) {
            (Some(path), ..) => Some((read(path, "priors in JSON")?, path.display().to_string())),
            (None, Some(url), Some(model)) => Some((ask(url, model, labels).map_err(replay_error)?, url.clone())),
            _ => None,
        };
        match answer {
            None => Ok(priors),
            Some((text, file)) => prior::from_answer(&text, &file, priors).map_err(replay_error),
        }
    }

    fn write(&self, report: &Report, ground: &Ground, lost: &[String]) -> Result<(), RecordingError> {
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let title = self.runs.iter().map(|r| r.display().to_string()).collect::<Vec<_>>().join(", ");
        let mut value = serde_json::to_value(report).expect("a report is plain data");
        value["lost"] = lost.into();
        value["sentence"] = report.sentence().into();
        let read = self.runs.iter().map(PathBuf::as_path).chain([self.terrain.as_path()]);
        value["provenance"] = provenance(read.chain(self.materials.as_deref()).chain(self.reading.robot_file()));
        let files: [(&str, Vec<u8>); 4] = [
            ("contact.json", format!("{value:#}\n").into_bytes()),
            ("contact.html", html::to_html(report, ground, &title, lost).into_bytes()),
            ("calibrated.toml", report.to_toml().into_bytes()),
            ("terrain.glb", glb::write(&ground.with_frictions(&report.frictions()))),
        ];
        for (name, bytes) in files {
            let path = self.out.join(name);
            put(&path, bytes).map_err(|e| write_error(&path, &e))?;
        }
        Ok(())
    }
}

fn read(path: &Path, expected: &str) -> Result<String, RecordingError> {
    fs::read_to_string(path).map_err(|e| file_error(path, expected, &e.to_string()))
}

fn replay_error(error: ContactError) -> RecordingError {
    match error {
        ContactError::Rollout(error) => error.into(),
        ContactError::Prior { file, expected, found } => RecordingError::File { file, expected, found },
        ContactError::Run(error) => error.into(),
        ContactError::Sim(error) => RolloutError::Sim(error).into(),
    }
}

/// The report without what only pictures need.
fn line(report: &Report, lost: &[String]) -> serde_json::Value {
    let mut value = serde_json::to_value(report).expect("a report is plain data");
    for region in value["regions"].as_array_mut().into_iter().flatten() {
        region.as_object_mut().map(|r| r.remove("curves"));
    }
    if let Some(report) = value.as_object_mut() {
        report.retain(|key, _| key != "path" && key != "slips");
    }
    value["lost"] = lost.into();
    value
}

fn summary(report: &Report) -> String {
    let mut text = String::from(
        "material               prior   friction   90 % interval     grid   on it    slipping   evidence\n",
    );
    for r in &report.regions {
        // A prior that is kept was not measured.
        let interval = match r.status {
            Status::Refined => format!("{:.3} to {:.3}", r.posterior.interval90[0], r.posterior.interval90[1]),
            _ => "-".into(),
        };
        let grid = r.grid.as_ref().map_or("-".to_string(), |g| format!("{:.3}", g.friction));
        let status = if r.status == Status::Refined { String::new() } else { format!("  {}", r.status.words()) };
        text += &format!(
            "{:<20} {:>7.3} {:>10.3}   {interval:>14} {grid:>8} {:>6.1} s {:>8.0} % {:>10.1}{status}\n",
            r.label,
            r.prior.mean,
            r.friction,
            r.contact_time,
            100.0 * r.slip_share,
            r.evidence,
        );
    }
    for value in &report.robot {
        text +=
            &format!("{}: {:.4} ± {:.4}, {:.4} before\n", value.parameter, value.value, value.deviation, value.before);
    }
    let base = &report.base_error;
    for (what, errors) in [("unseen", base.held_out), ("all", base.all)] {
        if let Some(e) = errors {
            text += &format!(
                "base error over {} s, mean of {} {what} segments: {:.1} mm with {} everywhere, {:.1} prior, {:.1} grid, {:.1} posterior\n",
                base.segment,
                e.segments,
                1e3 * e.uniform,
                base.uniform_friction,
                1e3 * e.prior,
                1e3 * e.grid,
                1e3 * e.posterior
            );
        }
    }
    report.notes.iter().for_each(|note| text += &format!("{note}\n"));
    text
}

fn friction(text: &str) -> Result<f64, String> {
    within(text, 0.01, 10.0)
}

fn segment(text: &str) -> Result<f64, String> {
    within(text, 0.2, 100.0)
}
