//! `qv diagnose`: where the gap lies, what causes it, how far it shrinks.

use crate::open::{file_error, lost_from, model_of, open_run, parameters, spinner, terrain_of, urdf_of};
use crate::{Outcome, RunArguments, say};
use qv_core::JointSeries;
use qv_gap::baselines::{Baselines, CMA_ES_STEPS, baselines};
use qv_gap::report::{Report, UNKNOWN};
use qv_gap::{GapError, Options, diagnose, library, output};
use qv_replay::{ReplayError, Run};
use qv_sim::Model;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub const EXAMPLE: &str = "Example:\n  qv diagnose walk.mcap --out out/walk\n  qv diagnose monday.mcap tuesday.mcap --terrain yard.glb \
    --library mine.toml --out out/both\n\n\
    Writes report.json, report.html, calibrated.toml (for --params), and the same corrections for MuJoCo, URDF and Isaac \
    Lab.\nSeveral recordings are taken to be of one robot with one cause.\n\n\
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done with part of the input lost (named).";

/// How far off a mesh may be under a foot \[m\]: what flat ground in a mesh of good photographs has.
const GROUND_ERROR: f64 = 0.003;

#[derive(clap::Args)]
pub struct Diagnose {
    /// Bags (.mcap files, or directories of split bags), or tables (run.csv, or their directories)
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Topic of the base pose; default /Odometry, else whichever topic carries poses
    #[arg(long, value_name = "TOPIC")]
    pose_topic: Option<String>,
    /// go2, or a URDF file; default: what the recording says
    #[arg(long, value_name = "go2|URDF")]
    robot: Option<String>,
    /// plane, or a mesh with a material per label
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb")]
    terrain: String,
    /// Parameters that are known already
    #[arg(long, value_name = "FILE.toml")]
    params: Option<PathBuf>,
    /// Recordings of the same robot before something changed: what the simulator lacked then is not accused
    #[arg(long, value_name = "RUN", num_args = 1..)]
    reference: Vec<PathBuf>,
    /// Effects of your own, beside those that come with the program
    #[arg(long, value_name = "FILE.toml")]
    library: Option<PathBuf>,
    /// Effects that may not be accused
    #[arg(long, value_name = "EFFECT")]
    without: Vec<String>,
    /// Diagnose again without each of the N most probable effects, into DIR/without/EFFECT
    #[arg(long, default_value_t = 0, value_name = "N")]
    leave_out: usize,
    /// Also let three rivals judge (one effect at a time, CMA-ES, a residual network), into DIR/baselines.json
    #[arg(long)]
    baselines: bool,
    /// How far off the ground may be under a foot, in metres (standard deviation); default 0.003 for a mesh, 0 for a plane
    #[arg(long, value_name = "METRES")]
    ground_error: Option<f64>,
    /// Seed of the simulated recordings without an effect
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Directory for the results; made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// One line of JSON at the end instead of the summary
    #[arg(long)]
    json: bool,
}

impl Diagnose {
    pub fn execute(&self) -> Result<Outcome, ReplayError> {
        let runs = self.open(&self.runs)?;
        let model = model_of(&runs[0], &self.runs[0], self.robot.as_deref())?;
        let terrain = terrain_of(&self.terrain)?;
        let mut library = library::built_in();
        if let Some(path) = &self.library {
            let text =
                fs::read_to_string(path).map_err(|e| file_error(path, "a library of effects", &e.to_string()))?;
            library.extend(library::parse(&text, &path.display().to_string()).map_err(replay_error)?);
        }
        let unknown = self.without.iter().find(|name| !library.iter().any(|e| e.name == **name));
        if let Some(name) = unknown {
            return Err(ReplayError::Run {
                what: "--without".into(),
                expected: "an effect of the library".into(),
                found: name.clone(),
            });
        }
        let is_mesh = self.terrain != "plane";
        let ground_error = self.ground_error.unwrap_or(if is_mesh { GROUND_ERROR } else { 0.0 });
        if !(0.0..=0.05).contains(&ground_error) {
            return Err(ReplayError::Run {
                what: "--ground-error".into(),
                expected: "0 to 0.05 m".into(),
                found: ground_error.to_string(),
            });
        }
        let bar = spinner("reading");
        let clock = Instant::now();
        let seconds = || clock.elapsed().as_secs_f64();
        let told = |stage: &str| bar.set_message(stage.to_string());
        let options = Options {
            library,
            given: parameters(self.params.as_deref())?,
            reference: self.open(&self.reference)?,
            effort: qv_gap::study::Effort { seed: self.seed, ground_error, ..Default::default() },
            without: self.without.clone(),
            clock: Some(&seconds),
            progress: Some(&told),
            ..Default::default()
        };
        let diagnosis = diagnose(&runs, &model, &terrain, &options, self.leave_out).map_err(replay_error)?;
        let rivals = if self.baselines {
            Some(baselines(&runs, &model, &terrain, &options, CMA_ES_STEPS).map_err(replay_error)?)
        } else {
            None
        };
        bar.finish_and_clear();
        let lost: Vec<String> = runs.iter().flat_map(lost_from).collect();
        let urdf = urdf_of(&runs[0], self.robot.as_deref());
        let robot = Robot::new(&runs[0], model.clone(), urdf, lost.clone());
        self.write(&self.out, &diagnosis.report, &robot)?;
        for (effect, report) in &diagnosis.without {
            self.write(&self.out.join("without").join(effect), report, &robot)?;
        }
        if let Some(rivals) = &rivals {
            write_baselines(&self.out, rivals)?;
        }
        let report = &diagnosis.report;
        if self.json {
            let line = serde_json::to_value(report).expect("a report is plain data");
            say(&format!("{line}\n"))?;
        } else {
            say(&format!("{}written to {}\n", summary(report), self.out.display()))?;
        }
        lost.iter().for_each(|what| eprintln!("qv: {what}"));
        Ok(if lost.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    fn open(&self, paths: &[PathBuf]) -> Result<Vec<Run>, ReplayError> {
        let open = |path: &PathBuf| open_run(&RunArguments { run: path.clone(), pose_topic: self.pose_topic.clone() });
        paths.iter().map(open).collect()
    }

    fn write(&self, directory: &Path, report: &Report, robot: &Robot) -> Result<(), ReplayError> {
        fs::create_dir_all(directory).map_err(|e| write_error(directory, &e))?;
        let title: Vec<String> = self.runs.iter().map(|r| r.display().to_string()).collect();
        let urdf = robot.urdf.as_deref();
        let files = output::files(report, &robot.model, urdf, &title.join(", "), &robot.notes, &robot.kp, &robot.kd);
        for (name, bytes) in files {
            let path = directory.join(name);
            fs::write(&path, bytes).map_err(|e| write_error(&path, &e))?;
        }
        Ok(())
    }
}

fn write_baselines(directory: &Path, rivals: &Baselines) -> Result<(), ReplayError> {
    let path = directory.join("baselines.json");
    let text = serde_json::to_string_pretty(rivals).expect("answers are plain data") + "\n";
    fs::write(&path, text).map_err(|e| write_error(&path, &e))
}

fn write_error(what: &Path, error: &std::io::Error) -> ReplayError {
    ReplayError::Write { what: what.display().to_string(), reason: error.to_string() }
}

/// What the outputs need to know of the robot.
struct Robot {
    model: Model,
    urdf: Option<String>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    notes: Vec<String>,
}

impl Robot {
    fn new(run: &Run, model: Model, urdf: Option<String>, notes: Vec<String>) -> Self {
        let gains = |series: &Option<JointSeries>, fixed: Option<f64>| {
            let of = |name: &String| {
                let column = run.joint_names.iter().position(|n| n == name);
                let typical = series.as_ref().zip(column).and_then(|(s, c)| median(s.column(c).collect()));
                typical.or(fixed).unwrap_or(0.0)
            };
            model.joint_names().iter().map(of).collect()
        };
        let kp = gains(&run.commands.kp, run.actuator.kp);
        let kd = gains(&run.commands.kd, run.actuator.kd);
        Self { model, urdf, kp, kd, notes }
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.retain(|x| x.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn replay_error(error: GapError) -> ReplayError {
    match error {
        GapError::Replay(error) => error,
        GapError::Library { file, expected, found } => ReplayError::File { file, expected, found },
        GapError::Run { what, expected, found } => ReplayError::Run { what, expected, found },
        GapError::Sim(error) => {
            ReplayError::Run { what: "simulator".into(), expected: "a simulation".into(), found: error.to_string() }
        }
    }
}

fn summary(report: &Report) -> String {
    let gap = &report.gap;
    let mut text = format!("{}\n\n", report.sentence);
    text += &format!(
        "gap {:.2} before, {:.2} after, {:.2} floor; closed {:.0} % ({:.0} to {:.0}); joints {:.2} -> {:.2} mrad\n",
        gap.before,
        gap.after,
        gap.floor,
        100.0 * gap.closed,
        100.0 * gap.closed_ci95[0],
        100.0 * gap.closed_ci95[1],
        1e3 * gap.joint_rms[0],
        1e3 * gap.joint_rms[1]
    );
    for ranked in report.ranking.iter().take(4) {
        let name = if ranked.effect == UNKNOWN { "none of the library" } else { &ranked.effect };
        text += &format!("{:>6.1} %  {name}\n", 100.0 * ranked.probability);
    }
    for cause in report.causes.iter().filter(|c| !c.confusable_with.is_empty()) {
        text += &format!(
            "{} looks like {}: {}\n",
            cause.effect,
            cause.confusable_with.join(", "),
            cause.separating_experiment
        );
    }
    for lead in &report.leads {
        text += &format!(
            "not accused, but near: {} would close {:.0} %, joints {:.2} -> {:.2} mrad\n",
            lead.effects.join(" or "),
            100.0 * lead.closed,
            1e3 * lead.joint_rms[0],
            1e3 * lead.joint_rms[1]
        );
    }
    report.cannot_tell.iter().for_each(|line| text += &format!("{line}\n"));
    text
}
