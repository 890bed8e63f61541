//! `qv diagnose`: where the gap lies, what causes it, how far it shrinks.

use crate::camera::{RobotCamera, open_camera, open_images, photographs, to_toml};
use crate::ground::{check_ground, terrain_of};
use crate::open::{
    check_joints, file_error, find_gains, lost_from, lost_from_model, model_of, open_run, parameters_of, remarks_of,
    urdf_of, write_error,
};
use crate::output::{make_folder, put};
use crate::progress::{Stages, remark};
use crate::provenance::provenance;
use crate::scene::open_scene;
use crate::terminal::print_message;
use crate::validation;
#[cfg(feature = "learn")]
use crate::walk::{
    ladder::{self, ladders},
    trial::TrialPolicy,
};
use crate::{Outcome, Reading, RunArguments, say};
use qv_camera::{EFFECTS, Footage, Look, LookOptions, Photograph, check, html, look};
use qv_core::{GaussianCloud, JointSeries};
use qv_gap::inference::linearised::NullOptions;
use qv_gap::report::{Gap, Report, Stage, UNKNOWN};
use qv_gap::{Diagnosis, Options, Progress, validate};
use qv_open::diagnosis::{self, Request, Robot, gap_error};
use qv_recording::{RecordingError, Run};
use std::path::{Path, PathBuf};
use std::time::Instant;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv diagnose walk.mcap --out out/why\n\
     \x20 qv diagnose monday.mcap tuesday.mcap --terrain yard.glb --library mine.toml --out out/both\n\
     \x20 qv diagnose walk.mcap --scene yard.ply --camera camera.toml --out out/seen\n\
     \n\
     Results: report.html, report.json, calibrated.toml (for --params), and the same corrections for MuJoCo, URDF and Isaac Lab;\n\
     with --scene also calibrated_camera.toml (for --camera). Images of a table are listed in images.csv (time, file).\n\
     Reading the report: docs/guide/reading_the_report.md. Verdict `unexplained`: docs/guide/troubleshooting.md.",
    "3 done, but part of the input was lost (reported)"
);

#[derive(clap::Args)]
pub struct Diagnose {
    /// Recordings of one robot with one fault: bags or tables
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    #[command(flatten)]
    reading: Reading,
    /// Set the terrain: plane, or a labelled mesh (z up, frame of the poses)
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb", help_heading = "Input")]
    terrain: String,
    /// Start from known simulator parameters (calibrated.toml)
    #[arg(long, value_name = "FILE.toml", help_heading = "Input")]
    params: Option<PathBuf>,
    /// Read recordings from before the change; their faults are not reported
    #[arg(long, value_name = "RUN", num_args = 1.., help_heading = "What to test")]
    reference: Vec<PathBuf>,
    /// Test the corrections on other recordings of the same robot
    ///
    /// Writes validation.json: how much of their error the corrections remove.
    #[arg(long, value_name = "RUN", num_args = 1.., help_heading = "What to test", hide_short_help = true)]
    validate: Vec<PathBuf>,
    /// Add effects from a file
    #[arg(long, value_name = "FILE.toml", help_heading = "What to test")]
    library: Option<PathBuf>,
    /// Exclude an effect [repeatable; names: qv effects]
    #[arg(long, value_name = "EFFECT", help_heading = "What to test")]
    without: Vec<String>,
    /// Repeat without each of the N most likely effects (ablation)
    ///
    /// Results go to DIR/without/EFFECT.
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "What to test")]
    leave_out: usize,
    /// Set the terrain height error (1 sigma) [default: mesh 0.003, plane 0]
    #[arg(long, value_name = "METRES", help_heading = "Input", hide_short_help = true)]
    ground_error: Option<f64>,
    /// Test the camera against this Gaussian scene (frame of the poses)
    #[arg(long, value_name = "SCENE.ply", requires = "camera", help_heading = "Scene", hide_short_help = true)]
    scene: Option<PathBuf>,
    /// Read camera intrinsics and extrinsics (base_from_camera)
    ///
    /// Keys: width, height, fx, fy, cx, cy, distortion, and base_from_camera with position (m) and quaternion (w, x, y, z).
    #[arg(long, value_name = "FILE.toml", requires = "scene", help_heading = "Scene", hide_short_help = true)]
    camera: Option<PathBuf>,
    /// Read images from this topic [default: the one with most images]
    #[arg(long, value_name = "TOPIC", requires = "scene", help_heading = "Scene", hide_short_help = true)]
    image_topic: Option<String>,
    /// Compare at most N images
    #[arg(
        long,
        default_value_t = 40,
        value_name = "N",
        requires = "scene",
        help_heading = "Scene",
        hide_short_help = true
    )]
    images: usize,
    #[cfg(feature = "learn")]
    #[command(flatten)]
    tried: PolicyArguments,
    /// Set the random seed
    #[arg(long, default_value_t = 1, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    seed: u64,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

/// A policy that walks in the simulator before and after.
#[cfg(feature = "learn")]
#[derive(clap::Args)]
struct PolicyArguments {
    /// Test an ONNX policy in the nominal and the corrected simulator
    #[arg(
        long,
        value_name = "POLICY.onnx",
        requires = "policy_description",
        help_heading = "What to test",
        hide_short_help = true
    )]
    policy: Option<PathBuf>,
    /// Read the policy description (see: qv walk describe)
    #[arg(long, value_name = "FILE.toml", requires = "policy", help_heading = "What to test", hide_short_help = true)]
    policy_description: Option<PathBuf>,
}

/// The words of a command line behind `qv diagnose`.
#[derive(clap::Parser)]
#[command(no_binary_name = true)]
struct DiagnoseWords {
    #[command(flatten)]
    diagnose: Diagnose,
}

/// Options of every command, which change no result.
const COMMON: [&str; 5] = ["-q", "--quiet", "-v", "--verbose", "--no-config"];

/// What a diagnosis read, by the words that it was typed with; `None` for those of another command.
pub fn inputs_of(words: &[String]) -> Option<DiagnosisInputs> {
    let mut words = words.iter().filter(|word| !COMMON.contains(&word.as_str()));
    words.next().filter(|word| *word == "diagnose")?;
    <DiagnoseWords as clap::Parser>::try_parse_from(words).ok().map(|typed| typed.diagnose.inputs())
}

/// What a diagnosis was made from.
pub struct DiagnosisInputs {
    pub runs: Vec<PathBuf>,
    pub reading: Reading,
    pub terrain: String,
    pub params: Option<PathBuf>,
    pub library: Option<PathBuf>,
    pub ground_error: Option<f64>,
    pub seed: u64,
}

impl Diagnose {
    /// What it reads, to do the like again.
    fn inputs(self) -> DiagnosisInputs {
        let Self { runs, reading, terrain, params, library, ground_error, seed, .. } = self;
        DiagnosisInputs { runs, reading, terrain, params, library, ground_error, seed }
    }

    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let mut runs = self.open(&self.runs)?;
        // What is wrong with it is said before minutes are spent on the rest.
        let place = match (&self.scene, &self.camera) {
            (Some(scene), Some(camera)) => Some(self.place(scene, camera, &runs[0])?),
            _ => None,
        };
        let model = model_of(&runs[0], &self.runs[0], self.reading.robot.as_deref())?;
        let terrain = terrain_of(&self.terrain)?;
        for run in &mut runs {
            let remarks = check_ground(run, &terrain)?;
            run.remarks.extend(remarks);
            check_joints(run, &model, &terrain, self.reading.fix)?;
        }
        let effects = diagnosis::effects(self.library.as_deref())?;
        diagnosis::check_without(&self.without, &effects, &EFFECTS.each_ref().map(|e| e.name))?;
        let ground_error = diagnosis::ground_error(self.ground_error, &self.terrain)?;
        #[cfg(feature = "learn")]
        let mut tried = match (&self.tried.policy, &self.tried.policy_description) {
            (Some(policy), Some(description)) => Some(TrialPolicy::open(policy, description, &model).map_err(untold)?),
            _ => None,
        };
        // Before minutes are spent on what could not be written.
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let given = parameters_of(self.params.as_deref(), &model, &terrain)?;
        // What no one states of the robot is the same in recordings before a change.
        let count = runs.len();
        runs.extend(self.open(&self.reference)?);
        find_gains(&mut runs, &model, &terrain, &given)?;
        let reference = runs.split_off(count);
        let others = self.open(&self.validate)?;
        let on_others = Options {
            library: effects.clone(),
            given: given.clone(),
            reference: reference.clone(),
            effort: NullOptions { seed: self.seed, ground_error, ..Default::default() },
            ..Default::default()
        };
        let bar = Stages::new();
        let clock = Instant::now();
        let seconds = || clock.elapsed().as_secs_f64();
        let stage = |at: &Progress| bar.begin(at.stage, at.stages, at.name, Some(at.done));
        let recordings = self.runs.iter().chain(&self.reference).chain(&self.validate);
        let read = recordings.map(PathBuf::as_path).chain([Path::new(&self.terrain)]);
        let read = read.chain(self.params.as_deref()).chain(self.library.as_deref()).chain(self.scene.as_deref());
        let read = read.chain(self.camera.as_deref()).chain(self.reading.robot_file());
        let read = read.chain(self.tried.policy.as_deref()).chain(self.tried.policy_description.as_deref());
        let mut lost: Vec<String> = runs.iter().flat_map(lost_from).collect();
        lost.extend(place.iter().flat_map(|p| p.notes.iter().cloned()));
        lost.extend(lost_from_model(&model));
        let remarks = remarks_of(&runs[0], &model);
        let request = Request {
            runs: &runs,
            reference,
            model: &model,
            terrain: &terrain,
            given,
            effects,
            without: self.without.clone(),
            ground_error,
            seed: self.seed,
            leave_out: self.leave_out,
            title: self.runs.iter().map(|r| r.display().to_string()).collect::<Vec<_>>().join(", "),
            notes: remarks.iter().chain(&lost).cloned().collect(),
            provenance: Some(provenance(read)),
        };
        let mut diagnosis = diagnosis::diagnose(request, &seconds, &stage)?;
        let seen = match &place {
            Some(place) => Some(self.look(place, &runs[0], &mut diagnosis, &seconds, &bar)?),
            None => None,
        };
        let validated = if others.is_empty() {
            None
        } else {
            let corrections = &diagnosis.report.corrections;
            Some(validate(&others, &model, &terrain, &on_others, corrections).map_err(gap_error)?)
        };
        bar.finish();
        let robot =
            Robot::new(&runs[0], model.clone(), urdf_of(&runs[0], &self.runs[0], self.reading.robot.as_deref()));
        let stated = &diagnosis.report.gap;
        let sights = seen.iter().zip(&diagnosis.report.visual);
        let sections: Vec<String> = sights
            .map(|(look, sight)| html::section(sight, &look.pictures))
            .chain(validated.iter().map(|other| validation::section(stated, other)))
            .collect();
        #[cfg(feature = "learn")]
        let (walks, sections) = match &mut tried {
            Some(tried) => self.walked(tried, (&model, &terrain), &diagnosis.report, sections)?,
            None => (String::new(), sections),
        };
        #[cfg(not(feature = "learn"))]
        let walks = "";
        let files = robot.files(&diagnosis.report, &diagnosis.evidence, &sections);
        let has_fragment = files.iter().any(|(name, _)| name == "mjcf_fragment.xml");
        write(&self.out, files)?;
        for (effect, report, evidence) in &diagnosis.without {
            write(&self.out.join("without").join(effect), robot.files(report, evidence, &[]))?;
        }
        for ((place, look), sight) in place.iter().zip(&seen).zip(&diagnosis.report.visual) {
            let path = self.out.join("calibrated_camera.toml");
            let camera = RobotCamera { rig: look.corrected, ..place.camera };
            put(&path, to_toml(&camera, &sight.sentence)).map_err(|e| write_error(&path, &e))?;
        }
        let report = &diagnosis.report;
        let on_others =
            validated.map_or_else(|| Ok(String::new()), |other| self.write_validation(&report.gap, &other))?;
        if self.json {
            let line = serde_json::to_value(report).expect("a report is plain data");
            say(&format!("{line}\n"))?;
        } else {
            say(&format!("{}{on_others}{walks}written to {}\n", summary(report), self.out.display()))?;
        }
        remarks.iter().for_each(|what| remark(what));
        if !has_fragment && report.corrections_apply && !report.corrections.is_empty() {
            remark(
                "mjcf_fragment.xml was not written: an MJCF include cannot state these corrections (mjcf_by_hand.txt: what to change by hand)",
            );
        }
        lost.iter().for_each(|what| print_message!("{what}"));
        if !report.corrections_apply {
            print_message!("correcting the effect raises the error of held-out windows: no file applies it");
        }
        Ok(if lost.is_empty() && report.corrections_apply { Outcome::Done } else { Outcome::Partial })
    }

    /// Writes validation.json; a line for the screen.
    fn write_validation(&self, stated: &Gap, other: &Gap) -> Result<String, RecordingError> {
        let path = self.out.join("validation.json");
        let text = serde_json::to_string(other).expect("a gap is plain data");
        put(&path, text + "\n").map_err(|e| write_error(&path, &e))?;
        Ok(validation::sentence(stated, other) + "\n")
    }

    fn open(&self, paths: &[PathBuf]) -> Result<Vec<Run>, RecordingError> {
        let open = |path: &PathBuf| open_run(&RunArguments { run: path.clone(), reading: self.reading.clone() });
        paths.iter().map(open).collect()
    }

    /// Scene, camera and images, checked.
    fn place(&self, scene: &Path, camera: &Path, run: &Run) -> Result<Place, RecordingError> {
        let file = open_scene(scene).map_err(|e| file_error(scene, "a splat file", &e.to_string()))?;
        let arguments = RunArguments { run: self.runs[0].clone(), reading: self.reading.clone() };
        let images = open_images(&arguments, run, self.image_topic.as_deref(), self.images)?;
        let camera = open_camera(camera, images.info.as_ref())?;
        let photographs = photographs(&images.images, &camera)?;
        let background = file.background.unwrap_or_default();
        let place = Place { cloud: file.cloud, background, camera, photographs, notes: images.notes };
        let options = LookOptions { most: self.images, ..Default::default() };
        check(&place.footage(run.measured.base_pose.as_ref()), &options)?;
        Ok(place)
    }

    /// Compares images with the scene, and decides once more with what they show.
    fn look(
        &self,
        place: &Place,
        run: &Run,
        Diagnosis { report, evidence, .. }: &mut Diagnosis,
        seconds: &dyn Fn() -> f64,
        bar: &Stages,
    ) -> Result<Look, RecordingError> {
        let begun = seconds();
        // A pose that comes late is known by now: the camera is not accused of it.
        let late = report.corrections.iter().find(|c| c.parameter == "sensor.pose.delay").map_or(0.0, |c| c.value);
        let mut poses = run.measured.base_pose.clone();
        poses.iter_mut().flat_map(|p| &mut p.time).for_each(|t| *t -= late);
        let stages = report.stages.len() + 1;
        bar.begin(stages, stages, "images", None);
        // What lies behind took the time that its stages say; images cost about as much each.
        let (from, to) = ((stages - 1) as f64 / stages as f64, 1.0);
        let progress = |done: usize, all: usize| {
            let share = from + (to - from) * done as f64 / all.max(1) as f64;
            bar.at(share, &format!("image {done} of {all}"));
        };
        let options = LookOptions {
            without: self.without.clone(),
            most: self.images,
            seed: self.seed,
            progress: Some(&progress),
            ..Default::default()
        };
        let look = look(&place.footage(poses.as_ref()), &options)?;
        evidence.camera = Some(look.evidence.clone());
        let spent = seconds() - begun;
        if let Some(data) = &mut evidence.report {
            data.stages.push(Stage { name: "images".into(), steps: 0 });
            data.timing.stages_s.push(spent);
            data.timing.runtime_s += spent;
        }
        *report = qv_gap::report::report(evidence, &options.policy).map_err(gap_error)?;
        Ok(look)
    }

    /// Lets a policy walk before and after the corrections: writes policy.json, adds to the page, gives a line for the screen.
    #[cfg(feature = "learn")]
    fn walked(
        &self,
        tried: &mut TrialPolicy,
        (model, terrain): (&qv_sim::Model, &qv_sim::Terrain),
        report: &Report,
        mut sections: Vec<String>,
    ) -> Result<(String, Vec<String>), RecordingError> {
        let sizes: Vec<_> = report.causes.iter().flat_map(|c| c.parameters.clone()).collect();
        let trial = tried.trial((model, terrain), &report.corrections).map_err(untold)?;
        let ladders = ladders(tried, (model, terrain), (&sizes, &report.corrections), &trial).map_err(untold)?;
        sections.extend([trial.section(), ladder::section(&ladders, &trial)]);
        let path = self.out.join("policy.json");
        let text = serde_json::to_string(&File { trial: &trial, ladders: &ladders }).expect("plain data");
        put(&path, text + "\n").map_err(|e| write_error(&path, &e))?;
        let lines = [vec![trial.sentence()], ladder::sentences(&ladders)].concat();
        Ok((lines.join("\n") + "\n", sections))
    }
}

/// policy.json.
#[cfg(feature = "learn")]
#[derive(serde::Serialize)]
struct File<'f> {
    #[serde(flatten)]
    trial: &'f crate::walk::trial::Trial,
    ladders: &'f [ladder::Ladder],
}

/// A policy's error as one of the run.
#[cfg(feature = "learn")]
fn untold(error: crate::Failure) -> RecordingError {
    qv_core::Mismatch::new("--policy", "a policy that the simulator can roll", error).into()
}

/// What the camera is judged with.
struct Place {
    cloud: GaussianCloud,
    /// Colour that it was made to be drawn over.
    background: [f32; 3],
    camera: RobotCamera,
    photographs: Vec<Photograph>,
    notes: Vec<String>,
}

impl Place {
    fn footage<'a>(&'a self, poses: Option<&'a JointSeries>) -> Footage<'a> {
        Footage {
            cloud: &self.cloud,
            background: self.background,
            rig: self.camera.rig,
            poses,
            photographs: &self.photographs,
        }
    }
}

fn write(folder: &Path, files: Vec<(String, Vec<u8>)>) -> Result<(), RecordingError> {
    make_folder(folder).map_err(|e| write_error(folder, &e))?;
    files.into_iter().try_for_each(|(name, bytes)| {
        let path = folder.join(name);
        put(&path, bytes).map_err(|e| write_error(&path, &e))
    })
}

/// Errors of joints before and after, where they were simulated.
fn joint_rms([before, after]: [f64; 2]) -> String {
    if before.is_nan() { String::new() } else { format!("; joints {:.2} -> {:.2} mrad", 1e3 * before, 1e3 * after) }
}

/// Mistakes in the commands or joints, which go before any physical cause: with them nothing else is to be believed.
fn first_lead(report: &Report) -> String {
    let is_mistake = |line: &&String| {
        let kind = line.split([' ', ':']).next().unwrap_or_default();
        ["commands", "joint", "torques", "imu"].contains(&kind)
            && (line.contains("--fix") || line.contains("two programs"))
    };
    let found: Vec<&str> = report.cannot_tell.iter().filter(is_mistake).map(String::as_str).collect();
    match found[..] {
        [] => String::new(),
        [first] => format!("conventions first: {first}\n"),
        [first, ..] => format!("conventions first: {first}; and {} more (qv inspect)\n", found.len() - 1),
    }
}

fn summary(report: &Report) -> String {
    let gap = &report.gap;
    let mut text = first_lead(report);
    text += &format!("{}\n\n", report.sentence);
    text += &format!(
        "normalized error {:.2} -> {:.2}, noise floor {:.2}; removed {:.0} % ({:.0} to {:.0}){}\n",
        gap.before,
        gap.after,
        gap.floor,
        100.0 * gap.closed,
        100.0 * gap.closed_ci95[0],
        100.0 * gap.closed_ci95[1],
        joint_rms(gap.joint_rms)
    );
    let is_balanced = report.is_balanced();
    if is_balanced {
        text += &format!("tests at an error rate of {:.0} % per diagnosis\n", 100.0 * report.policy.held.alpha);
    }
    // What passed tests at an error rate has no score.
    for ranked in report.ranking.iter().take(if is_balanced { 0 } else { 4 }) {
        let name = if ranked.effect == UNKNOWN { "none of the library" } else { &ranked.effect };
        text += &format!("score {:.2}  {name}\n", ranked.score);
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
            "nearest candidate, not identified: {} would remove {:.0} %{}\n",
            lead.effects.join(" or "),
            100.0 * lead.closed,
            joint_rms(lead.joint_rms)
        );
    }
    for effect in report.together.iter().flat_map(|t| &t.effects) {
        let names: Vec<&str> = effect.names().collect();
        let sizes = effect
            .parameters
            .iter()
            .map(|p| format!("{} {:.4} ({:.4} to {:.4}) {}", p.name, p.value, p.ci95[0], p.ci95[1], p.unit));
        text += &format!(
            "fitted together: {} of {}: {}\n",
            names.join(" or "),
            effect.scope.join(", "),
            sizes.collect::<Vec<_>>().join(", ")
        );
    }
    report.cannot_tell.iter().for_each(|line| text += &format!("{line}\n"));
    text
}
