//! `qv walk train`.

use super::inputs::{TerrainOption, ground_of, range, robot_of, urdf_of};
use crate::open::{file_error, write_error};
use crate::output::{self, make_folder, write_whole};
use crate::progress::remark;
use crate::terminal::print_message;
use crate::{Failure, Outcome, say};
use indicatif::{ProgressBar, ProgressStyle};
use qv_policy::gait::verdict;
use qv_policy::play::play;
use qv_policy::policy::PolicyFile;
use qv_policy::score::Score;
use qv_policy::stand::StandReport;
use qv_policy::train::{Checkpoint, Line, TrainSettings, Training};
use qv_policy::velocity::{Ground, Randomise, TaskRobot, VelocityTask};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Where a training stands that has not ended. The files of one that has stay until another one has.
const UNFINISHED: &str = "unfinished.bin";
/// What was measured in it.
const MEASURED: &str = "unfinished.json";
/// Time from one checkpoint to the next.
const SAVE_EVERY: Duration = Duration::from_secs(30);

/// Without a clock nothing but the last epochs breaks the tie between left and right.
const SYMMETRIC_TO_THE_END: &str = "the policy has no clock and is trained with mirror images to the end: it may be unable to start from a stand; \
     set `symmetry_epochs` below [ppo] so that the last 200 iterations go without (7 of 9 epochs)";

#[derive(clap::Args)]
pub struct Train {
    /// Set the robot: go2, go1, a1, a2, anymal_c, or a URDF, MJCF or TOML file
    #[arg(long, default_value = "go2", value_name = "ROBOT", help_heading = "Input")]
    robot: String,
    #[command(flatten)]
    terrain: TerrainOption,
    /// Train for N iterations [default: 900 to 3000, by terrain]
    ///
    /// An iteration is 24 steps of all robots. Default: 900 on the plane, 1200 on bumps and meshes or with --robust, 3000 on levels.
    #[arg(long, value_name = "N", help_heading = "Training")]
    iterations: Option<u64>,
    /// Stop training after this time
    #[arg(long, value_name = "SECONDS", value_parser = crate::numbers::positive, help_heading = "Training", hide_short_help = true)]
    max_seconds: Option<f64>,
    /// Stop when errors fall below these and no robot falls [m/s, rad/s]
    #[arg(long, value_name = "V,W", value_parser = goal, help_heading = "Training", hide_short_help = true)]
    until: Option<[f32; 2]>,
    /// Simulate N robots at once
    #[arg(long, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    robots: Option<usize>,
    /// Set the random seed
    #[arg(long, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    seed: Option<u64>,
    /// Randomize friction, mass, gains, latency and encoders; add pushes
    #[arg(long, help_heading = "Training")]
    robust: bool,
    /// Randomize around corrections (calibrated.toml)
    #[arg(long, value_name = "FILE.toml", alias = "around", help_heading = "Input")]
    params: Option<PathBuf>,
    /// Set the range of forward velocity commands [m/s]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "Training")]
    vx: Option<[f32; 2]>,
    /// Set the range of lateral velocity commands [m/s]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "Training")]
    vy: Option<[f32; 2]>,
    /// Set the range of yaw rate commands [rad/s]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "Training")]
    wz: Option<[f32; 2]>,
    /// Read all settings (settings.toml of an earlier run)
    #[arg(long, value_name = "FILE.toml", help_heading = "Advanced", hide_short_help = true)]
    settings: Option<PathBuf>,
    /// Resume the training in --out
    ///
    /// Gives the bits of an uninterrupted training if it stopped at the end of an epoch.
    #[arg(long, conflicts_with_all = ["settings", "seed", "robots", "start_from", "robust", "params", "vx", "vy", "wz"], help_heading = "Training", hide_short_help = true)]
    resume: bool,
    /// Start from the networks of a checkpoint.bin
    #[arg(long, value_name = "FILE", help_heading = "Training", hide_short_help = true)]
    start_from: Option<PathBuf>,
    /// Replace the policy in --out even if it scores better
    #[arg(long, help_heading = "Output", hide_short_help = true)]
    replace: bool,
    /// Use N threads [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), help_heading = "Advanced", hide_short_help = true)]
    threads: Option<u16>,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

fn goal(text: &str) -> Result<[f32; 2], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[v, w]) if v > 0.0 && w > 0.0 => Ok([v, w]),
        _ => Err(format!("expected two numbers above 0 (m/s, rad/s), found `{text}`")),
    }
}

impl Train {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let robot = robot_of(&self.robot)?;
        let kept = self.kept()?;
        let settings = match &kept {
            Some(kept) => kept.settings.clone(),
            None => self.settings(&robot)?,
        };
        let ground = ground_of(&self.terrain.name, settings.seed)?;
        let settings = match &self.params {
            Some(file) => self.around(file, &robot, &ground, settings)?,
            None => settings,
        };
        check_stand(&robot)?;
        match robot.mirror() {
            Err(reason) if settings.ppo.symmetry_epochs > 0 => remark(&format!("mirror images are off: {reason}")),
            Ok(_)
                if settings.task.clock == 0.0
                    && settings.ppo.symmetry_epochs.saturating_mul(settings.epoch) >= self.iterations() =>
            {
                remark(SYMMETRIC_TO_THE_END);
            }
            _ => {}
        }
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads.map_or(0, usize::from)).build()?;
        // Errors of the command line stay on their thread: this one crosses as its text.
        let remarks = pool.install(|| self.train(&robot, &ground, settings, kept).map_err(|e| e.to_string()));
        remarks.map_err(Failure::from)
    }

    /// The checkpoint to go on from.
    fn kept(&self) -> Result<Option<Checkpoint>, Failure> {
        if !self.resume {
            return Ok(None);
        }
        let unfinished = self.out.join(UNFINISHED);
        let path = if unfinished.is_file() { unfinished } else { self.out.join("checkpoint.bin") };
        let bytes = fs::read(&path).map_err(|e| file_error(&path, "the checkpoint of a training", &e.to_string()))?;
        let kept = Checkpoint::from_bytes(&bytes);
        Ok(Some(kept.map_err(|e| file_error(&path, "the checkpoint of a training", &e.to_string()))?))
    }

    fn settings(&self, robot: &TaskRobot) -> Result<TrainSettings, Failure> {
        let mut settings = match &self.settings {
            None => TrainSettings::default(),
            Some(path) => {
                let expected = "settings of a training";
                let text = fs::read_to_string(path).map_err(|e| file_error(path, expected, &e.to_string()))?;
                let (settings, removed) =
                    TrainSettings::parse(&text).map_err(|e| file_error(path, expected, &e.to_string()))?;
                if !removed.is_empty() {
                    remark(&format!("{}: ignored keys of an earlier version: {}", path.display(), removed.join(", ")));
                }
                settings
            }
        };
        if self.robust {
            settings.task.randomise = Randomise::robust(&robot.model.links[0].name);
        }
        let commands = &mut settings.task.commands;
        for (given, range) in [(self.vx, &mut commands.vx), (self.vy, &mut commands.vy), (self.wz, &mut commands.wz)] {
            if let Some(given) = given {
                *range = given;
            }
        }
        settings.seed = self.seed.unwrap_or(settings.seed);
        settings.robots = self.robots.unwrap_or(settings.robots);
        settings.check()?;
        Ok(settings)
    }

    fn around(
        &self,
        file: &Path,
        robot: &TaskRobot,
        ground: &Ground,
        mut settings: TrainSettings,
    ) -> Result<TrainSettings, Failure> {
        let found = super::around::around(file, robot, &ground.terrain, &mut settings.task.randomise)?;
        if found == 0 {
            return Err(file_error(file, "parameters that a diagnosis corrects", "none").into());
        }
        remark(&format!("{found} parameters are drawn around {}", file.display()));
        Ok(settings)
    }

    /// Iterations to do when nobody says how many: what brought trainings of each kind to where they change little.
    fn iterations(&self) -> u64 {
        self.iterations.unwrap_or(match self.terrain.name.as_str() {
            "levels" => 3000,
            "plane" if !self.robust => 900,
            _ => 1200,
        })
    }

    fn train(
        &self,
        robot: &TaskRobot,
        ground: &Ground,
        settings: TrainSettings,
        kept: Option<Checkpoint>,
    ) -> Result<Outcome, Failure> {
        let mut training = match &kept {
            Some(kept) => Training::resume(robot, ground, kept)?,
            None => Training::new(robot, ground, &settings)?,
        };
        if let Some(path) = &self.start_from {
            let bytes = fs::read(path).map_err(|e| file_error(path, "a checkpoint", &e.to_string()))?;
            let other = Checkpoint::from_bytes(&bytes).and_then(|other| training.start_from(&other));
            other.map_err(|e| file_error(path, "a checkpoint to begin from", &e.to_string()))?;
        }
        if kept.is_some() && training.ppo().iterations >= self.iterations() {
            let (done, asked) = (training.ppo().iterations, self.iterations());
            return Err(format!(
                "expected more iterations than the {done} that are done, found {asked} (--iterations)"
            )
            .into());
        }
        let done = self.run(&mut training, kept.as_ref())?;
        if done.is_stopped {
            print_message!("{}", self.how_to_go_on(training.ppo().iterations));
            return Ok(Outcome::Stopped);
        }
        if !training.ppo().iterations.is_multiple_of(settings.score_every) {
            // What came after the last score may be the best.
            training.judge_now()?;
        }
        let score = match training.best() {
            Some((score, _)) => score.clone(),
            None => training.judge_now()?,
        };
        let policy = training.best().map_or_else(|| training.policy(), |(_, policy)| policy.clone());
        let file = PolicyFile::new(robot, &settings.task, &self.terrain.name, Some(score.clone()));
        let last = training.checkpoint_now().to_bytes()?;
        if let Some(better) = self.better(&file) {
            // It can be taken up again, or put in the place of the other.
            self.save(&last, &self.metrics(kept.as_ref(), &done.lines)?)?;
            return self.report_better(&better, &score);
        }
        let put = |name: &str, bytes: &[u8]| write_whole(&self.out.join(name), bytes);
        put("policy.onnx", &policy.to_onnx(robot)?)?;
        put("policy.toml", file.to_text()?.as_bytes())?;
        put("settings.toml", toml::to_string(&settings)?.as_bytes())?;
        put("checkpoint.bin", &last)?;
        [UNFINISHED, MEASURED].iter().for_each(|name| output::remove(&self.out.join(name)));
        put("metrics.json", self.metrics(kept.as_ref(), &done.lines)?.as_bytes())?;
        let mut task = VelocityTask::new(robot.clone(), ground.clone(), settings.task.clone(), 1)?;
        let played = play(&policy, &mut task, &super::play::SHOWN, 12.0, settings.seed)?;
        put("walk.html", super::page::page(&self.title(), &done.lines, Some(&score), &played, &file).as_bytes())?;
        super::recording::write_recording(&self.out.join("replay.mcap"), &played, &urdf_of(&self.robot)?)?;
        let is_trial = training.ppo().iterations < TRIAL;
        let outcome = if is_trial || walks(&score, &file) { Outcome::Done } else { Outcome::Partial };
        if matches!(outcome, Outcome::Partial) {
            print_message!("{TO_WALK}");
        }
        if self.json {
            let line = serde_json::json!({
                "format": "qv-walk-train/1", "score": score, "iterations": training.ppo().iterations, "seconds": done.seconds,
                "samples": done.lines.last().map_or(0, |l| l.samples), "checkpoint": training.ppo().iterations, "out": self.out,
            });
            say(&format!("{line}\n"))?;
            return Ok(outcome);
        }
        say(&format!(
            "{}\n{}\n{} iterations, {:.2} million samples in {:.0} s; written to {} (checkpoint.bin: iteration {})\n",
            super::score::sentence(&score),
            score.gait.as_ref().map_or_else(String::new, |gait| verdict(&gait.checks(&played.feet))),
            training.ppo().iterations,
            done.lines.last().map_or(0.0, |l| l.samples as f64 / 1e6),
            done.seconds,
            self.out.display(),
            training.ppo().iterations
        ))?;
        Ok(outcome)
    }

    /// All lines of the training, those before it was taken up again among them.
    fn metrics(&self, kept: Option<&Checkpoint>, lines: &[Line]) -> Result<String, Failure> {
        let mut all: Vec<serde_json::Value> = Vec::new();
        if let Some(kept) = kept {
            let unfinished = self.out.join(MEASURED);
            let before = if unfinished.is_file() { unfinished } else { self.out.join("metrics.json") };
            let before = fs::read(before).unwrap_or_default();
            let before: Vec<serde_json::Value> = serde_json::from_slice(&before).unwrap_or_default();
            all.extend(before.into_iter().filter(|l| l["index"].as_u64().is_some_and(|index| index < kept.iterations)));
        }
        for line in lines {
            all.push(serde_json::to_value(line)?);
        }
        Ok(format!("{}\n", serde_json::to_string(&all)?))
    }

    fn title(&self) -> String {
        format!(
            "{} on {}",
            Path::new(&self.robot).file_stem().map_or("robot".into(), |s| s.to_string_lossy()),
            self.terrain.name
        )
    }

    fn run(&self, training: &mut Training, kept: Option<&Checkpoint>) -> Result<MetricsLog, Failure> {
        let stop = crate::stop::asked();
        let (clock, total) = (Instant::now(), self.iterations());
        let bar = ProgressBar::new(total);
        if let Ok(style) = ProgressStyle::with_template("{pos}/{len} {wide_bar} {msg} {eta} left") {
            bar.set_style(style);
        }
        let (mut begun, mut saved, mut is_stopped) = (Instant::now(), Instant::now(), false);
        let mut lines: Vec<Line> = Vec::new();
        let mut remarks = String::new();
        while training.ppo().iterations < total {
            let before = training.checkpoint().epoch;
            let line = training.advance()?;
            bar.set_position(training.ppo().iterations);
            if let Some(score) = &line.score {
                remarks = format!(
                    "{:.2} m/s {:.2} rad/s off, {} fell",
                    score.velocity_error, score.turning_error, score.fell
                );
            }
            bar.set_message(format!("reward {:.3} {remarks}", line.iteration.reward));
            let reached =
                line.score.as_ref().zip(self.until).is_some_and(|(score, [v, w])| {
                    score.velocity_error < v && score.turning_error < w && score.fell == 0
                });
            lines.push(line);
            is_stopped = stop.load(Ordering::Relaxed);
            let is_new = training.checkpoint().epoch != before;
            if is_new {
                begun = Instant::now();
            }
            if is_new || is_stopped || saved.elapsed() >= SAVE_EVERY {
                // Little is lost by going back to where an epoch began, from where the bits are the same.
                let is_short = begun.elapsed() < SAVE_EVERY;
                let state = if is_short { training.checkpoint() } else { &training.checkpoint_now() };
                self.save(&state.to_bytes()?, &self.metrics(kept, &lines)?)?;
                saved = Instant::now();
            }
            let late = self.max_seconds.is_some_and(|most| clock.elapsed().as_secs_f64() > most);
            if reached || late || is_stopped {
                is_stopped &= !(reached || late) && training.ppo().iterations < total;
                break;
            }
        }
        bar.finish_and_clear();
        Ok(MetricsLog { lines, seconds: clock.elapsed().as_secs_f64(), is_stopped })
    }

    /// Writes where training stands, and what was measured until then, at once.
    fn save(&self, checkpoint: &[u8], metrics: &str) -> Result<(), Failure> {
        let path = self.out.join(UNFINISHED);
        write_whole(&path, checkpoint)?;
        write_whole(&self.out.join(MEASURED), metrics.as_bytes())?;
        Ok(output::commit().map_err(|e| write_error(&path, &e))?)
    }

    fn how_to_go_on(&self, done: u64) -> String {
        let mut words = crate::config::arguments();
        if !self.resume {
            // A checkpoint has them.
            let kept = ["settings", "seed", "robots", "start-from", "around", "vx", "vy", "wz"];
            words = crate::config::without(words, &kept);
            words.retain(|word| word != "--robust");
            words.push("--resume".into());
        }
        let all = self.iterations();
        format!("stopped at {done} of {all} iterations; to go on: qv {}", crate::config::typed(&words))
    }

    /// The policy in the results, if it is of the same task and scores better.
    fn better(&self, new: &PolicyFile) -> Option<PolicyFile> {
        if self.replace || !self.out.join("policy.onnx").is_file() {
            return None;
        }
        let old = PolicyFile::parse(&fs::read_to_string(self.out.join("policy.toml")).ok()?).ok()?;
        let cost = |file: &PolicyFile| file.score.as_ref().map(Score::cost);
        let is_better = cost(&old)? < cost(new)?;
        let rated = |file: &PolicyFile| PolicyFile { score: None, ..file.clone() };
        (is_better && rated(&old) == rated(new)).then_some(old)
    }

    fn report_better(&self, old: &PolicyFile, new: &Score) -> Result<Outcome, Failure> {
        if self.json {
            let line =
                serde_json::json!({"format": "qv-walk-train/1", "score": new, "kept": old.score, "out": self.out});
            say(&format!("{line}\n"))?;
        } else {
            say(&format!("{}\n", super::score::sentence(new)))?;
        }
        print_message!(
            "the policy in '{}' scores better and stays; --resume --replace with more iterations resumes from this one, whose state is kept",
            self.out.display()
        );
        Ok(Outcome::Done)
    }
}

/// Reports how a robot stands under its gains, and refuses one that does not.
fn check_stand(robot: &TaskRobot) -> Result<(), Failure> {
    let report = StandReport::of(robot)?;
    let reserve = report.reserve.map_or("unknown".into(), |reserve| format!("{reserve:.1}"));
    let ends = |list: &[f32]| {
        let [low, high] = [list.iter().copied().fold(f32::MAX, f32::min), list.iter().copied().fold(0.0, f32::max)];
        if low == high { format!("{low:.3}") } else { format!("{low:.3} to {high:.3}") }
    };
    remark(&format!(
        "{}: base {:.2} m high, kp {} N m/rad, kd {} N m s/rad, action scale {} rad; it stands with a torque reserve of {reserve}",
        robot.name,
        robot.height,
        ends(&robot.kp),
        ends(&robot.kd),
        ends(&robot.action_scale)
    ));
    Ok(report.check()?)
}

/// Iterations below which a training is a trial of the command, of which nobody expects a walk.
const TRIAL: u64 = 400;
/// Most share of robots that fall, and most error in speeds that were asked for, of a policy that walks.
const MOST_FALLS: f32 = 0.1;
const MOST_ERROR: f32 = 0.6;

/// Whether a score is that of a robot that walks: it follows its commands better than one that stands.
fn walks(score: &Score, file: &PolicyFile) -> bool {
    let reach = |[low, high]: [f32; 2]| 0.25 * (high - low).max(low.abs() + high.abs());
    let asked = reach(file.commands.vx).hypot(reach(file.commands.vy));
    let moves = asked == 0.0 || score.velocity_error < MOST_ERROR * asked.max(0.1);
    moves && (score.fell as f32) <= MOST_FALLS * score.robots as f32
}

/// What to change about a training that did not end in a walk.
const TO_WALK: &str = "the robot does not walk after this training: try another --seed, more --iterations, a smaller range of commands \
    (--vx 0,0.5 --vy 0,0 --wz -0.5,0.5), or in a robot file a lower `action_scale`, a stand with straighter legs, other gains";

struct MetricsLog {
    lines: Vec<Line>,
    seconds: f64,
    /// Whether somebody stopped it.
    is_stopped: bool,
}
