//! `qv reconstruct`: photographs with cameras become a scene of Gaussians.

mod arguments;
mod page;
mod scores;
mod search;
mod stereo;
mod watch;
mod words;

pub use arguments::Reconstruct;

use crate::capture::{OpenCapture, open_capture};
use crate::colmap::{PoseChoice, better_poses, poses_again};
use crate::outcome::about;
use crate::output::{self, make_folder, put, write_whole};
use crate::progress::{Stages, remark};
use crate::terminal::print_message;
use crate::{Failure, Outcome, say, video};
use arguments::{Background, PosesFrom};
use clap::ValueEnum;
use qv_core::{Camera, GaussianCloud};
use qv_splat::captures::distortion::Distortion;
use qv_splat::captures::{Attachments, Capture, CaptureCamera, cameras_json};
use qv_splat::files::ply;
use qv_splat::stereo::StereoDepth;
use qv_splat::train::{
    AT_DEPTHS, AT_RANDOM, Best, CpuEngine, Dataset, Engine, Model, NEUTRAL, Photograph, ReadOptions, Score,
    TrainOptions, Weights, at_depths, at_random, bake, cameras, checkpoint, growing, of_points, train,
};
use qv_splat::{SplatError, error_at};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::time::Instant;
use watch::{Run, SAVE_EVERY, TRAINING, show_mask};
use words::{in_words, named_mean};

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv reconstruct captures/yard --out out/yard\n\
     \x20 qv reconstruct captures/yard/transforms.json --out out/yard --exposure --iterations 30000 --json\n\
     \x20 qv reconstruct walk.mp4 --out out/yard\n\
     \n\
     CAPTURE is a nerfstudio transforms.json or its folder, a COLMAP project (model and images), or a folder of RGB-D frames\n\
     (7-Scenes, TUM, Redwood, ScanNet). Gaussians start at points.ply beside it, if present.\n\
     For a video (.mp4, .mov, ...) ffmpeg extracts frames, and COLMAP, installed once into a Python environment, estimates\n\
     poses; DIR/capture keeps both. Such a scene has no metric scale: `qv mesh` takes --distance, --markers or --trajectory.\n\
     \n\
     Results: scene.ply (3DGS), checkpoint.qvt, metrics.json; cameras.json if poses are COLMAP's or refined (for `qv mesh --cameras`).\n\
     Geometry and label losses start at step 1000. Ctrl-C keeps a finished scene in DIR, else writes the best scene so far;\n\
     --resume continues.",
    "3 done, but part of the input was lost (reported)"
);

/// Where training stood when the scene was written.
const CHECKPOINT: &str = "checkpoint.qvt";
/// Where a training stands that has not ended.
const UNFINISHED: &str = "unfinished.qvt";
/// Folder of what was left out of photographs.
const MASKS: &str = "masks";
/// Steps from one report to the next.
const REPORT_EVERY: u32 = 100;
/// Most frames that are taken of a video.
const FRAMES: usize = 150;
/// Share of the steps in which exposures are learned, where they are.
const EXPOSED_SHARE: f64 = 0.85;
/// Steps from one scene that may be kept to the next.
const JUDGE_EVERY: u32 = 1000;

impl Reconstruct {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let clock = Instant::now();
        let bar = Stages::new();
        let stages = if self.no_stereo { 3 } else { 4 };
        bar.begin(1, stages, "reading", None);
        let chosen = self.open()?;
        let poses = words::of_poses(&chosen);
        let is_found = !chosen.is_given();
        let PoseChoice { opened, mut lost, found, .. } = chosen;
        self.options(None).check()?;
        let reading = ReadOptions { downscale: self.downscale, hold_out: self.hold_out };
        let files = |path: &str| opened.read(path);
        let mut dataset = Dataset::new(&opened.capture, &files, &reading).map_err(|e| about(&self.capture, e))?;
        let depths = self.add_depths(&mut dataset, opened.points.as_ref(), &bar);
        self.check_needs(&dataset)?;
        let options = self.options(depths.measured.as_ref());
        if self.asks_for_geometry() && options.iterations <= options.geometry_from {
            let (from, last) = (options.geometry_from, options.iterations);
            remark(&format!("terms of geometry count from step {from} on: with --iterations {last} they do nothing"));
        }
        if self.background == Background::Black {
            dataset.background = [0.0; 3];
        }
        dataset.antialias = self.antialias;
        make_folder(&self.out).map_err(|e| about(&self.out, format!("expected a folder, found {e}")))?;
        let (model, at_points) = self.begin(&opened, &dataset, &options)?;
        let read_s = clock.elapsed().as_secs_f64();
        bar.begin(stages - 1, stages, "training", Some(self.training_from()));
        let mut run = Run::new(self, &dataset, &bar);
        let clock = Instant::now();
        let searched = self.search(&dataset, &options, &model.cloud, &mut run)?;
        if let Some(scene) = searched.as_ref().and_then(|found| found.stopped_with.as_ref()) {
            if !self.has_finished_scene() {
                self.save_scene(scene, &dataset)?;
            }
            self.save(&model)?;
            print_message!("{}", self.how_to_go_on(0));
            return Ok(Outcome::Stopped);
        }
        let options =
            TrainOptions { iterations: searched.as_ref().map_or(options.iterations, |found| found.steps), ..options };
        let search_s = clock.elapsed().as_secs_f64();
        run.iterations = options.iterations;
        let clock = Instant::now();
        let (mut model, finished) = self.train(&dataset, &options, model, &mut run)?;
        // A stop that comes later finds training done.
        let is_stopped = !finished && run.is_stopped();
        let train_s = clock.elapsed().as_secs_f64();
        bar.begin(stages, stages, "scores", Some(TRAINING[1]));
        let clock = Instant::now();
        // A finished training is written with its scene. One that took long is not left to the scores.
        if !finished || train_s > SAVE_EVERY.as_secs_f64() {
            self.save(&model)?;
        }
        if is_stopped && self.has_finished_scene() {
            bar.finish();
            print_message!("the finished scene in '{}' stays", self.out.display());
            print_message!("{}", self.how_to_go_on(model.iteration));
            return Ok(Outcome::Stopped);
        }
        let trained = checkpoint::write(&model, &self.begun_with()?);
        let (loss, times, curve) = (run.loss, run.mean_times(), std::mem::take(&mut run.curve));
        let (stood_at, mut scene_of) = (model.iteration, model.iteration);
        let earlier = if finished { None } else { std::mem::take(&mut run.best).instead_of(&model, &dataset)? };
        if let Some(kept) = earlier {
            scene_of = kept.iteration;
            kept.put_into(&mut model);
        }
        if self.exposure {
            dataset.background = bake(&mut model, dataset.background);
        }
        let as_learned = |one: &Photograph| cameras::as_learned(&model, &dataset, one);
        let looked_at: Vec<Photograph> = dataset.held_out.iter().map(as_learned).collect();
        let held_out = self.score(&model, &dataset, &looked_at)?;
        self.save_masks(&model, &dataset)?;
        self.save_scene(&model.cloud, &dataset)?;
        write_whole(&self.out.join(CHECKPOINT), &trained)?;
        output::remove(&self.out.join(UNFINISHED));
        let metrics = json!({
            "format": "qv-reconstruct/1", "capture": self.capture.display().to_string(), "iterations": stood_at, "scene_of_iteration": scene_of,
            "finished": finished, "gaussians": model.cloud.len(), "loss": loss, "origin": opened.origin.map(|o| o.to_array()), "timing": {"read_s": read_s, "search_s": search_s, "train_s": train_s,
            "write_s": clock.elapsed().as_secs_f64(), "times_ms": times}, "photographs": dataset.training.len(), "began_at_points": at_points,
            "exposure": self.exposure, "poses_refined": self.refine_poses, "poses": poses, "poses_found": found, "stereo": stereo::named(&depths), "cameras": refined(&model, &dataset), "seed": self.seed, "extent_m": dataset.extent, "background": dataset.background,
            "antialias": dataset.antialias, "steps_asked": self.iterations, "transients": words::of_masks(&model.masks),
            "aside": searched, "held_out": held_out.by_name(&dataset), "mean": named_mean(&held_out.drawn),
            "mean_aligned": named_mean(&held_out.aligned), "ground": held_out.of_ground,
        });
        self.save_cameras(&model, &dataset, &looked_at, is_found)?;
        let path = self.out.join("metrics.json");
        put(&path, format!("{metrics:#}\n")).map_err(|e| about(&path, format!("expected to write it, found {e}")))?;
        let page = page::Summary {
            model: &model,
            dataset: &dataset,
            looked_at: &looked_at,
            scores: &held_out,
            curve: &curve,
            has_masks: model.masks.iter().any(|mask| mask.share() > 0.0),
        };
        match page.to_html() {
            Ok(html) => write_whole(&self.out.join("index.html"), html.as_bytes())?,
            Err(why) => remark(&format!("cannot write 'index.html': {why}")),
        }
        bar.finish();
        self.notify(&metrics, &held_out.means(), &times, search_s + train_s)?;
        opened.capture.remarks.iter().for_each(|what| remark(what));
        dataset.turned.iter().for_each(|(what, count)| remark(&format!("{count} images with {what}")));
        lost.extend_from_slice(&dataset.lost);
        lost.extend(self.lost(&dataset, &options));
        lost.iter().for_each(|what| print_message!("{what}"));
        if is_stopped {
            print_message!("{}", self.how_to_go_on(stood_at));
            return Ok(Outcome::Stopped);
        }
        Ok(if lost.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    /// What to type after a stop: the same once more, which takes up the checkpoint.
    fn how_to_go_on(&self, at: u32) -> String {
        let mut words = crate::config::arguments();
        if !self.resume {
            words.push("--resume".into());
        }
        format!("stopped at step {at} of {}; to go on: qv {}", self.iterations, crate::config::typed(&words))
    }

    /// The capture with the poses that are taken.
    fn open(&self) -> Result<PoseChoice, Failure> {
        let folder = self.out.join("capture");
        if video::is_video(&self.capture) {
            let lost = video::project(&self.capture, &folder, FRAMES)?;
            return Ok(PoseChoice { lost, ..PoseChoice::given(open_capture(&folder)?, "COLMAP found them") });
        }
        let opened = open_capture(&self.capture).map_err(|e| video::or_video(&self.capture, e))?;
        match self.poses {
            PosesFrom::Capture => Ok(PoseChoice::given(opened, "they were asked for")),
            PosesFrom::Colmap => poses_again(&self.capture, opened, &folder),
            PosesFrom::Auto => better_poses(&self.capture, opened, &folder),
        }
    }

    /// How to train; `measured` is what stereo found.
    fn options(&self, measured: Option<&StereoDepth>) -> TrainOptions {
        TrainOptions {
            iterations: self.iterations,
            cap: self.cap,
            exposure: self.exposure,
            poses: self.refine_poses,
            seed: self.seed,
            weights: Weights {
                flattening: self.flattening,
                depth_prior: self.depth_prior.unwrap_or(if measured.is_some() { stereo::WEIGHT } else { 0.0 }),
                depth_normal: self.depth_normal,
                multi_view: self.multi_view,
                labels: self.labels,
                ..Default::default()
            },
            drop: if measured.is_some() { stereo::DROP } else { 0.0 },
            transients: self.transients,
            ..Default::default()
        }
    }

    /// Whether terms of geometry are asked for, rather than brought by stereo.
    fn asks_for_geometry(&self) -> bool {
        let asked = [self.flattening, self.depth_prior.unwrap_or(0.0), self.depth_normal, self.multi_view, self.labels];
        asked.iter().any(|weight| *weight > 0.0)
    }

    /// Options that do something only where the capture has what they need.
    fn check_needs(&self, dataset: &Dataset) -> Result<(), Failure> {
        let training = || dataset.training.iter();
        let depth = training().any(|one| one.depth.iter().any(|z| *z > 0.0));
        match self.depth_prior.is_some_and(|weight| weight > 0.0) && !depth {
            true => Err(about(
                &self.capture,
                "--depth-prior: expected depth images, or images without --no-stereo, found none",
            )),
            false => Ok(()),
        }
    }

    /// As many as there is room for beside `others`.
    fn depth_points(&self, others: usize, options: &TrainOptions) -> usize {
        let room = self.cap.saturating_sub(others);
        if options.weights.depth_prior > 0.0 { AT_DEPTHS.min(self.cap / 2).min(room) } else { 0 }
    }

    /// A model to begin with, and whether it is at points of the capture.
    fn begin(&self, opened: &OpenCapture, dataset: &Dataset, options: &TrainOptions) -> Result<(Model, bool), Failure> {
        let unfinished = self.out.join(UNFINISHED);
        let path = if unfinished.is_file() { unfinished } else { self.out.join(CHECKPOINT) };
        if self.resume {
            let bytes = fs::read(&path).map_err(|e| about(&path, format!("expected a checkpoint, found {e}")))?;
            let (model, begun_with) = checkpoint::read(&bytes).map_err(|e| about(&path, e))?;
            model.check_places(dataset).map_err(|e| about(&path, e))?;
            self.check_begun_with(&begun_with, &path)?;
            if self.labels > 0.0 && model.cloud.feature_count == 0 {
                let expected = "--labels: expected a checkpoint that was begun with labels, found one without";
                return Err(about(&path, expected));
            }
            if model.cloud.len() > self.cap {
                let expected =
                    format!("--cap: expected at least the {} Gaussians of the checkpoint", model.cloud.len());
                return Err(about(&path, format!("{expected}, found {}", self.cap)));
            }
            return Ok((model, opened.points.is_some()));
        }
        let mut points = at_random(dataset, if opened.points.is_some() { 0 } else { AT_RANDOM }, options);
        let known = opened.points.as_ref().map_or(0, |points| points.places.len());
        let count = self.depth_points(points.places.len() + known, options);
        let at_depths = at_depths(dataset, count, options);
        for more in opened.points.iter().chain([&at_depths]) {
            points.places.extend_from_slice(&more.places);
            points.colours.extend_from_slice(&more.colours);
        }
        let mut cloud = of_points(&points, options)?;
        if self.labels > 0.0 {
            let most = dataset.training.iter().flat_map(|one| &one.labels).copied().max().unwrap_or(0) as usize;
            if !(1..=GaussianCloud::MAX_FEATURES).contains(&most) {
                return Err(about(&self.capture, format!("expected label images with 1 to 16 labels, found {most}")));
            }
            cloud.feature_count = most;
            cloud.features = vec![0.0; most * cloud.len()];
        }
        Ok((Model::new(cloud, dataset), opened.points.is_some()))
    }

    /// Trains on photographs that grow; the model, and whether all steps were taken. Exposures are learned first. The last part of the steps goes
    /// without them, from their median: a scene is drawn without exposures, and is then to look like the photographs.
    fn train(
        &self,
        dataset: &Dataset,
        options: &TrainOptions,
        mut model: Model,
        run: &mut Run,
    ) -> Result<(Model, bool), Failure> {
        for (factor, until) in growing::stages(dataset, options.iterations, self.small) {
            if model.iteration >= until && factor > 1 {
                continue;
            }
            let small = (factor > 1).then(|| dataset.smaller(factor));
            let photographs = small.as_ref().unwrap_or(dataset);
            let exposed = (f64::from(options.iterations) * EXPOSED_SHARE) as u32;
            if options.exposure && model.iteration < exposed {
                let (trained, finished) = self.train_until(exposed.min(until), photographs, options, model, run)?;
                model = trained;
                if !finished {
                    return Ok((model, false));
                }
                if model.iteration < exposed {
                    continue;
                }
            }
            // What is behind the scene has the photographs' colours as it is.
            bake(&mut model, dataset.background);
            if options.exposure {
                model.exposures.fill(NEUTRAL);
                // What was kept so far was judged through its exposures.
                run.best = Best::default();
            }
            let options = TrainOptions { exposure: false, ..*options };
            let (trained, finished) = self.train_until(until, photographs, &options, model, run)?;
            model = trained;
            if !finished {
                return Ok((model, false));
            }
        }
        Ok((model, true))
    }

    fn train_until(
        &self,
        until: u32,
        dataset: &Dataset,
        options: &TrainOptions,
        model: Model,
        run: &mut Run,
    ) -> Result<(Model, bool), Failure> {
        let mut engine = self.engine(dataset, options, model)?;
        let trained =
            train(engine.as_mut(), dataset.training.len(), until, options.seed, REPORT_EVERY, &mut |engine, at| {
                run.watch(engine, at).map_err(|e| error_at("training", "files", &e.to_string()))
            });
        let finished = trained.or_else(|error| self.rescue(std::mem::take(&mut run.best), dataset, error))?;
        Ok((engine.model()?, finished))
    }

    fn judge_every(&self) -> u32 {
        // Fetching a scene from the card and judging it takes as long as some hundred steps there.
        #[cfg(feature = "gpu")]
        if self.gpu {
            return watch::FETCH_EVERY;
        }
        JUDGE_EVERY
    }

    #[cfg(not(feature = "gpu"))]
    fn engine<'a>(
        &self,
        dataset: &'a Dataset,
        options: &TrainOptions,
        model: Model,
    ) -> Result<Box<dyn Engine + 'a>, Failure> {
        Ok(Box::new(CpuEngine::new(dataset, options, model)?))
    }

    #[cfg(feature = "gpu")]
    fn engine<'a>(
        &self,
        dataset: &'a Dataset,
        options: &TrainOptions,
        model: Model,
    ) -> Result<Box<dyn Engine + 'a>, Failure> {
        use qv_raster::gpu::{Gpu, GpuOptions, GpuRasteriser};
        use qv_splat::train::gpu::{GpuEngine, GpuTraining};
        if !self.gpu {
            return Ok(Box::new(CpuEngine::new(dataset, options, model)?));
        }
        let rasteriser = GpuRasteriser::new(Gpu::new(&GpuOptions { adapter: self.gpu_index, ..Default::default() })?);
        let how = GpuTraining { atomic: !self.ordered };
        Ok(Box::new(GpuEngine::new(rasteriser, dataset, options, model, how)?))
    }

    /// All cameras as they were learned; nothing when they are those of the capture.
    fn save_cameras(
        &self,
        model: &Model,
        dataset: &Dataset,
        held_out: &[Photograph],
        is_found: bool,
    ) -> Result<(), Failure> {
        let path = self.out.join("cameras.json");
        if !(self.refine_poses || is_found) {
            // Those of an earlier scene would be wrong for this one.
            output::remove(&path);
            return Ok(());
        }
        let learned = dataset.training.iter().enumerate().map(|(k, one)| (&one.name, model.camera(dataset, k)));
        let all = learned.chain(held_out.iter().map(|one| (&one.name, one.camera)));
        let camera = |(name, camera): (&String, Camera)| CaptureCamera {
            name: name.clone(),
            camera,
            distortion: Distortion::default(),
            image: None,
            attachments: Attachments::default(),
        };
        let mut cameras: Vec<CaptureCamera> = all.map(camera).collect();
        cameras.sort_by(|a, b| a.name.cmp(&b.name));
        let written = put(&path, cameras_json::write(&Capture { cameras, ..Capture::default() }));
        written.map_err(|e| about(&path, format!("expected to write it, found {e}")))
    }

    /// Photographs with what was left out of them in red, of those that lost something.
    fn save_masks(&self, model: &Model, dataset: &Dataset) -> Result<(), Failure> {
        let folder = self.out.join(MASKS);
        for (one, mask) in dataset.training.iter().zip(&model.masks).filter(|(_, mask)| mask.share() > 0.0) {
            show_mask(one, &mask.masked(one), &folder)?;
        }
        Ok(())
    }

    fn save_scene(&self, cloud: &GaussianCloud, dataset: &Dataset) -> Result<(), Failure> {
        let path = self.out.join("scene.ply");
        let filter = dataset.antialias.then(|| dataset.sampling().deviations(&cloud.means));
        put(&path, ply::write_filtered(cloud, Some(dataset.background), filter.as_deref())?)
            .map_err(|e| about(&path, format!("expected to write it, found {e}")))
    }

    /// Training broke down: the best scene so far is written before that is reported.
    fn rescue(&self, best: Best, dataset: &Dataset, error: SplatError) -> Result<bool, Failure> {
        let Some(kept) = best.kept().filter(|_| !self.has_finished_scene()) else { return Err(error.into()) };
        self.save_scene(&kept.cloud, dataset)?;
        output::commit().map_err(|e| about(&self.out, e))?;
        Err(format!("{error}; the scene of step {} is in {}", kept.iteration, self.out.display()).into())
    }

    /// Writes where training stands, at once. The checkpoint of a scene that is finished stays until another one is.
    fn save(&self, model: &Model) -> Result<(), Failure> {
        write_whole(&self.out.join(UNFINISHED), &checkpoint::write(model, &self.begun_with()?))?;
        output::commit().map_err(|e| about(&self.out, e))
    }

    /// Whether a scene is there whose training took all its steps.
    fn has_finished_scene(&self) -> bool {
        let metrics = fs::read(self.out.join("metrics.json")).ok();
        let metrics = metrics.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
        metrics.is_some_and(|metrics| metrics["finished"] == true) && self.out.join("scene.ply").is_file()
    }

    /// What a training goes on with as it was begun: options by name.
    fn begun_with(&self) -> Result<String, Failure> {
        let options = json!({
            "--seed": self.seed, "--poses": named_value(&self.poses), "--background": named_value(&self.background),
            "--downscale": self.downscale, "--hold-out": self.hold_out, "--exposure": self.exposure,
            "--refine-poses": self.refine_poses, "--flattening": self.flattening,
            "--depth-prior": self.depth_prior, "--no-stereo": self.no_stereo, "--transients": self.transients, "--depth-normal": self.depth_normal,
            "--multi-view": self.multi_view, "--labels": self.labels,
            "--small": self.small,
            "--antialias": self.antialias,
        });
        Ok(serde_json::to_string(&options)?)
    }

    /// Refuses to go on with other options than a training was begun with: its scene would be that of neither.
    fn check_begun_with(&self, text: &str, path: &Path) -> Result<(), Failure> {
        let read = |text: &str| serde_json::from_str::<serde_json::Map<String, Value>>(text);
        let begun = read(text).map_err(|e| about(path, format!("expected options in JSON, found {e}")))?;
        let now = read(&self.begun_with()?)?;
        match now.iter().find(|(option, value)| begun.get(*option).is_some_and(|begun| begun != *value)) {
            Some((option, now)) => {
                let expected = format!("--resume: expected {option} {}, with which it was begun", begun[option]);
                Err(about(path, format!("{expected}, found {now}")))
            }
            None => Ok(()),
        }
    }

    /// What of the capture was not used, a line each.
    fn lost(&self, dataset: &Dataset, options: &TrainOptions) -> Vec<String> {
        let without = |has: fn(&Photograph) -> bool| dataset.training.iter().filter(|one| !has(one)).count();
        let mut lost = vec![];
        for (name, weight, missing) in [
            ("depths", options.weights.depth_prior, without(|one| !one.depth.is_empty())),
            ("labels", self.labels, without(|one| !one.labels.is_empty())),
        ] {
            if weight > 0.0 && missing > 0 {
                lost.push(format!("{missing} of {} images have no {name}", dataset.training.len()));
            }
        }
        let alone = dataset.alone();
        if !alone.is_empty() {
            let names = alone.iter().take(5).copied().collect::<Vec<_>>().join(", ");
            let more = if alone.len() > 5 { ", ..." } else { "" };
            lost.push(format!("{} images show nothing that another shows: {names}{more}", alone.len()));
        }
        if dataset.stands_still() && options.weights.depth_prior == 0.0 {
            lost.push("all images were taken from one position: depth cannot be measured".into());
        }
        lost
    }

    fn notify(
        &self,
        metrics: &Value,
        means: &[Option<Score>; 2],
        times: &[(&'static str, f64)],
        seconds: f64,
    ) -> Result<(), Failure> {
        if self.json {
            return Ok(say(&format!("{metrics}\n"))?);
        }
        let loss = metrics["loss"].as_f64().map_or(String::new(), |loss| format!(", loss {loss:.5}"));
        let mut text = format!("{} Gaussians{loss}, {seconds:.1} s of training\n", metrics["gaussians"]);
        if let Some(steps) = metrics["aside"]["steps"].as_u64().filter(|steps| *steps < u64::from(self.iterations)) {
            let asked = self.iterations;
            text += &format!("{steps} steps of {asked}: more did not help images that were put aside\n");
        }
        if metrics["scene_of_iteration"] != metrics["iterations"] {
            let [scene, stood] = ["scene_of_iteration", "iterations"].map(|key| &metrics[key]);
            text += &format!("stopped at step {stood}; the scene is that of step {scene}, which drew better\n");
        }
        text += &words::poses_in_words(&metrics["poses"]);
        let found = &metrics["poses_found"];
        if let (Some(metres), Some(degrees)) = (found["from_given_m"].as_f64(), found["from_given_deg"].as_f64()) {
            let (placed, of) = (&found["placed"], &found["of"]);
            text += &format!(
                "poses by COLMAP: {placed} of {of}, {:.0} mm and {degrees:.2} degrees (rms) from the capture's\n",
                1e3 * metres
            );
        }
        if let Some(depths) = stereo::in_words(&metrics["stereo"]) {
            text += &format!("{depths}\n");
        }
        if let Some(masks) = words::masks_in_words(&metrics["transients"]) {
            text += &format!("{masks}\n");
        }
        let remarks = ["held out", "held out, cameras aligned on the left half"];
        for (what, mean) in remarks.iter().zip(means) {
            let Some(s) = mean else { continue };
            text += &format!("{what}: {}\n", in_words(s));
        }
        if let Some(ground) = words::ground_in_words(&metrics["ground"]) {
            text += &format!("{ground}\n");
        }
        for (name, ms) in times {
            text += &format!("  {name:18} {ms:7.3} ms\n");
        }
        Ok(say(&format!("{text}written to {}\n", self.out.display()))?)
    }
}

/// A value of an option as it is typed.
fn named_value(value: &impl ValueEnum) -> Option<String> {
    value.to_possible_value().map(|value| value.get_name().to_owned())
}

/// Each camera: its lens, how far it moved, and the photographs' own motions (root mean square).
fn refined(model: &Model, dataset: &Dataset) -> Vec<Value> {
    let one = |(group, shared): (usize, &cameras::SharedAppearance)| {
        let of = |k: &usize| model.groups[*k] == group;
        let taken: Vec<usize> = (0..model.groups.len()).filter(of).collect();
        let lens = dataset.training[taken[0]].camera;
        let own = |k: &usize| {
            let given = shared.motion * dataset.training[*k].camera.camera_from_world;
            let own = model.poses[*k] * given.inverse();
            (own.position.length_squared(), own.rotation.to_scaled_axis().length_squared())
        };
        let mean = |of: &dyn Fn((f64, f64)) -> f64| taken.iter().map(|k| of(own(k))).sum::<f64>() / taken.len() as f64;
        json!({"photographs": taken.len(), "fx": lens.fx, "fy": lens.fy, "cx": lens.cx, "cy": lens.cy,
            "motion_m": shared.motion.position.to_array(),
            "motion_deg": shared.motion.rotation.to_scaled_axis().to_array().map(f64::to_degrees),
            "own_motion_m": mean(&|(metres, _)| metres).sqrt(), "own_motion_deg": mean(&|(_, angle)| angle).sqrt().to_degrees()})
    };
    model.shared.iter().enumerate().map(one).collect()
}
