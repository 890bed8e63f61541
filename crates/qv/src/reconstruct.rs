//! `qv reconstruct`: photographs with cameras become a scene of Gaussians.

mod arguments;
mod search;
mod stereo;
mod watch;
mod words;

pub use arguments::Reconstruct;

use crate::capture::{OpenCapture, open_capture};
use crate::colmap::{PoseChoice, better_poses, poses_again};
use crate::normals::{self, NormalModel};
use crate::outcome::about;
use crate::output::{self, make_folder, put, write_whole};
use crate::progress::{Stages, remark};
use crate::terminal::print_message;
use crate::{Failure, Outcome, say, video};
use arguments::{Background, GuideName, PosesFrom, StrategyName};
use clap::ValueEnum;
use qv_core::{Camera, GaussianCloud};
use qv_splat::captures::distortion::Distortion;
use qv_splat::captures::{Attachments, Capture, CaptureCamera, cameras_json};
use qv_splat::files::{Points, ply};
use qv_splat::train::guide::Guide;
use qv_splat::train::shutter::fitted_scores;
use qv_splat::train::{
    AT_DEPTHS, AT_RANDOM, Best, CpuEngine, Dataset, Engine, Ground, GroundOptions, Model, Photograph, ReadOptions,
    Score, Shutter, Strategy, TrainOptions, Weights, at_depths, at_far, at_random, cameras, checkpoint, clear, drawn,
    ground_scores, growing, label_shares, neighbours_scores, of_points, pose, scores, train_in_proportion,
};
use qv_splat::{SplatError, error_at};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::time::Instant;
use watch::{Run, TRAINING, beside};
use words::{in_words, named};

pub const EXAMPLE: &str = "Example:\n  qv reconstruct captures/yard --out out/yard\n  \
    qv reconstruct captures/yard/transforms.json --out out/yard --exposure --iterations 30000 --json\n\n\
    CAPTURE is nerfstudio's transforms.json or the folder that holds it, a COLMAP project (model and images), or a folder of\n\
    RGB-D frames (7-Scenes: FRAME.color.jpg, FRAME.depth.png, FRAME.pose.txt; TUM, Redwood, ScanNet). points.ply beside it is where Gaussians begin.\n\
    Of a video (.mp4, .mov, ...) ffmpeg takes frames and COLMAP, in a Python environment that is made once, finds their poses;\n\
    DIR/capture keeps both. Such a scene has no metres of its own: `qv mesh` takes --distance, --markers or --trajectory.\n\n\
    Writes scene.ply (3DGS), checkpoint.qvt, metrics.json, where poses are COLMAP's or refined cameras.json (for `qv mesh --cameras`),\n\
    with --preview pictures beside photographs. Terms of geometry and labels count from step 1000 on. Built with --features gpu, --gpu\n\
    works on the graphics card. Ctrl-C stops: a finished scene in DIR stays, else the best scene so far is written; --resume goes\n\
    on from where training stood.\n\n\
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done with part of the input lost (named), 130 stopped.";

/// Where training stood when the scene was written.
const CHECKPOINT: &str = "checkpoint.qvt";
/// Where a training stands that has not ended.
const UNFINISHED: &str = "unfinished.qvt";
/// Steps from one report to the next.
const REPORT_EVERY: u32 = 100;
/// Steps by which a held-out camera is aligned.
const ALIGN_STEPS: u32 = 40;
/// Steps from one scene that may be kept to the next.
const JUDGE_EVERY: u32 = 1000;

impl Reconstruct {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let clock = Instant::now();
        let shutter = self.how_exposed()?;
        let bar = Stages::new();
        let stages = if self.stereo { 4 } else { 3 };
        bar.begin(1, stages, "reading", None);
        let chosen = self.open()?;
        let poses = words::of_poses(&chosen);
        let is_found = !chosen.is_given();
        let PoseChoice { mut opened, mut lost, found, .. } = chosen;
        if let Some(file) = &self.normal_model {
            let model = NormalModel { file, axes: &self.normal_axes, colours: self.normal_colours };
            normals::add_normals(&model, &mut opened, &self.out)?;
        }
        let options = self.options();
        options.check()?;
        let reading = ReadOptions { downscale: self.downscale, hold_out: self.hold_out };
        if options.weights.geometry() && options.iterations <= options.geometry_from {
            let (from, last) = (options.geometry_from, options.iterations);
            remark(&format!("terms of geometry count from step {from} on: with --iterations {last} they do nothing"));
        }
        let files = |path: &str| opened.read(path);
        let mut dataset = Dataset::new(&opened.capture, &files, &reading).map_err(|e| about(&self.capture, e))?;
        let depths = self.add_depths(&mut dataset, opened.points.as_ref(), &bar)?;
        self.check_needs(&opened, &dataset)?;
        if self.background == Background::Black {
            dataset.background = [0.0; 3];
        }
        dataset.antialias = self.antialias;
        dataset.shutter = shutter;
        if let (Some(points), true) = (&opened.points, self.clear > 0.0) {
            dataset.nearest = clear::nearest(&dataset, &points.places);
        }
        make_folder(&self.out).map_err(|e| about(&self.out, format!("expected a folder, found {e}")))?;
        let (model, at_points) = self.begin(&opened, &dataset, &options)?;
        let read_s = clock.elapsed().as_secs_f64();
        bar.begin(stages - 1, stages, "training", Some(self.training_from()));
        let mut run = Run::new(self, &dataset, &bar);
        let clock = Instant::now();
        let searched = self.search(&dataset, &options, &model.cloud, opened.points.as_ref(), &mut run)?;
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
        let weights = self.view_weights(&dataset, opened.points.as_ref())?;
        let (mut model, finished) = self.train(&dataset, &options, model, &weights, &mut run)?;
        // A stop that comes later finds training done.
        let is_stopped = !finished && run.is_stopped();
        let train_s = clock.elapsed().as_secs_f64();
        bar.begin(stages, stages, "scores", Some(TRAINING[1]));
        let clock = Instant::now();
        self.save(&model)?;
        if is_stopped && self.has_finished_scene() {
            bar.finish();
            print_message!("the finished scene in '{}' stays", self.out.display());
            print_message!("{}", self.how_to_go_on(model.iteration));
            return Ok(Outcome::Stopped);
        }
        let trained = checkpoint::write(&model, &self.begun_with()?);
        let (stood_at, mut scene_of) = (model.iteration, model.iteration);
        let earlier = if finished { None } else { std::mem::take(&mut run.best).instead_of(&model, &dataset)? };
        if let Some(kept) = earlier {
            scene_of = kept.iteration;
            kept.put_into(&mut model);
        }
        let as_learned = |one: &Photograph| cameras::as_learned(&model, &dataset, one);
        let looked_at: Vec<Photograph> = dataset.held_out.iter().map(as_learned).collect();
        let as_drawn = scores(&model.cloud, &looked_at, &dataset)?;
        let held_out = if self.exposure { neighbours_scores(&model, &dataset, &looked_at)? } else { as_drawn.clone() };
        let aligned = self.aligned(&model, &dataset, &looked_at)?;
        let moving = fitted_scores(&model.cloud, &looked_at, &dataset, self.refine_poses, ALIGN_STEPS)?;
        let ground = Ground::of(&model.cloud, &dataset, &GroundOptions::default())?;
        let of_ground = match &ground {
            Some(ground) => ground_scores(&model, &dataset, &looked_at, ground, self.exposure)?,
            None => vec![],
        };
        if self.preview {
            let folder = self.out.join("held_out");
            for photograph in &looked_at {
                let image = drawn(&model.cloud, &photograph.camera, &dataset)?;
                beside(photograph, &image, &folder, &photograph.name)?;
            }
        }
        self.save_scene(&model.cloud, &dataset)?;
        write_whole(&self.out.join(CHECKPOINT), &trained)?;
        output::remove(&self.out.join(UNFINISHED));
        let metrics = json!({
            "format": "qv-reconstruct/1", "capture": self.capture.display().to_string(), "iterations": stood_at, "scene_of_iteration": scene_of,
            "finished": finished, "gaussians": model.cloud.len(), "loss": run.loss, "timing": {"read_s": read_s, "search_s": search_s, "train_s": train_s,
            "write_s": clock.elapsed().as_secs_f64(), "times_ms": run.mean_times()}, "photographs": dataset.training.len(), "began_at_points": at_points,
            "ground_views": words::of_views(self.ground_views, &weights), "vignetting": self.vignetting,
            "exposure": self.exposure, "poses_refined": self.refine_poses, "shutter": words::of_shutter(&model, &dataset)?, "poses": poses, "poses_found": found, "stereo": stereo::named(depths.as_ref()), "cameras": refined(&model, &dataset), "seed": self.seed, "extent_m": dataset.extent, "background": dataset.background,
            "held_out": dataset.held_out.iter().zip(&held_out).map(|(one, score)| named(&one.name, score)).collect::<Vec<_>>(),
            "mean": Score::mean(&held_out).map(|mean| named("mean", &mean)),
            "mean_identity": Score::mean(&as_drawn).map(|mean| named("mean", &mean)),
            "mean_aligned": Score::mean(&aligned).map(|mean| named("mean", &mean)),
            "mean_moving": Score::mean(&moving).map(|mean| named("mean", &mean)), "antialias": dataset.antialias, "steps_asked": self.iterations,
            "aside": searched, "ground": words::of_ground(ground.as_ref(), &of_ground),
        });
        self.save_cameras(&model, &dataset, &looked_at, is_found)?;
        let path = self.out.join("metrics.json");
        put(&path, format!("{metrics:#}\n")).map_err(|e| about(&path, format!("expected to write it, found {e}")))?;
        bar.finish();
        self.notify(
            &metrics,
            [Score::mean(&held_out), Score::mean(&aligned), Score::mean(&moving)],
            &run,
            search_s + train_s,
            model.cloud.len(),
        )?;
        opened.capture.remarks.iter().for_each(|what| remark(what));
        dataset.turned.iter().for_each(|(what, count)| remark(&format!("{count} images with {what}")));
        lost.extend_from_slice(&dataset.lost);
        lost.extend(self.lost(&dataset));
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
            let lost = video::project(&self.capture, &folder, self.frames)?;
            return Ok(PoseChoice { lost, ..PoseChoice::given(open_capture(&folder)?, "COLMAP found them") });
        }
        let opened = open_capture(&self.capture).map_err(|e| video::or_video(&self.capture, e))?;
        match self.poses {
            PosesFrom::Capture => Ok(PoseChoice::given(opened, "they were asked for")),
            PosesFrom::Colmap => poses_again(&self.capture, opened, &folder),
            PosesFrom::Auto => better_poses(&self.capture, opened, &folder),
        }
    }

    fn options(&self) -> TrainOptions {
        TrainOptions {
            iterations: self.iterations,
            cap: self.cap,
            strategy: match self.strategy {
                StrategyName::Mcmc => Strategy::Mcmc,
                StrategyName::Classic => Strategy::Classic,
            },
            exposure: self.exposure,
            vignetting: self.vignetting,
            poses: self.refine_poses,
            lens: self.refine_lens,
            seed: self.seed,
            weights: Weights {
                flattening: self.flattening,
                depth_prior: self.depth_weight(),
                depth_normal: self.depth_normal,
                multi_view: self.multi_view,
                normal_prior: self.normal_prior,
                labels: self.labels,
                opacity: self.opacity_weight,
                scale: self.scale_weight,
                harmonics: self.harmonics_weight,
                ..Default::default()
            },
            noise: self.noise,
            settle: self.settle,
            guide: match self.guide {
                GuideName::Opacity => Guide::Opacity,
                GuideName::Error => Guide::Error,
                GuideName::Views => Guide::Views,
            },
            clear: self.clear,
            drop: self.drop,
            ..Default::default()
        }
    }

    /// How photographs are exposed; none where cameras are taken to be at rest.
    fn how_exposed(&self) -> Result<Option<Shutter>, Failure> {
        if !self.shutter {
            return Ok(None);
        }
        #[cfg(feature = "gpu")]
        if self.gpu {
            return Err("--shutter: expected training on the CPU, found --gpu; leave --gpu out".into());
        }
        let shutter = Shutter { samples: self.shutter_samples, readout: self.readout, gamma: self.gamma };
        shutter.check()?;
        Ok(Some(shutter))
    }

    /// Options that do something only where the capture has what they need.
    fn check_needs(&self, opened: &OpenCapture, dataset: &Dataset) -> Result<(), Failure> {
        let training = || dataset.training.iter();
        let [depth, normals] = [
            training().any(|one| one.depth.iter().any(|z| *z > 0.0)),
            training().any(|one| one.normals.iter().any(|n| *n != [0.0; 3])),
        ];
        let asked = [
            (self.clear > 0.0, "--clear", "points (points.ply)", opened.points.is_some()),
            (self.depth_weight() > 0.0, "--depth-prior", "depth images, or --stereo", depth),
            (self.depth_points.is_some_and(|n| n > 0), "--depth-points", "depth images, or --stereo", depth),
            (self.normal_prior > 0.0, "--normal-prior", "normal images, or --normal-model", normals),
        ];
        match asked.iter().find(|(is_asked, _, _, there)| *is_asked && !there) {
            Some((_, option, needs, _)) => Err(about(&self.capture, format!("{option}: expected {needs}, found none"))),
            None => Ok(()),
        }
    }

    /// A scene that was begun over one colour does not go on over another.
    fn check_background(&self, dataset: &Dataset) -> Result<(), Failure> {
        let path = self.out.join("scene.ply");
        let Ok(bytes) = fs::read(&path) else { return Ok(()) };
        let file = ply::read(&bytes).map_err(|e| about(&path, e))?;
        if file.antialias != dataset.antialias {
            let (expected, found) = match dataset.antialias {
                true => ("a scene made with --antialias", "one made without"),
                false => ("a scene made without --antialias", "one made with it"),
            };
            let found = format!("expected {expected}, found {found}");
            return Err(about(&path, found));
        }
        let before = file.background.unwrap_or_default();
        let now = dataset.background;
        // Reported in decimals that give the same bits.
        if before == now {
            return Ok(());
        }
        let found =
            format!("expected a scene made over {now:?}, as --background asks for, found one made over {before:?}");
        Err(about(&path, found))
    }

    /// What was learned of cameras goes on being learned, or else it would neither be used nor be gone.
    fn check_cameras(&self, model: &Model, path: &Path) -> Result<(), Failure> {
        let vignetting = model.shared.iter().any(|one| one.vignetting != [0.0; 3]);
        let moving = model.motions.iter().any(|motion| *motion != [0.0; 6]);
        let both = [("--vignetting", vignetting, self.vignetting), ("--shutter", moving, self.shutter)];
        match both.into_iter().find(|(_, there, asked)| model.iteration > 0 && there != asked) {
            Some((option, true, _)) => {
                Err(about(path, format!("--resume: expected {option}, with which it was begun, found none")))
            }
            Some((option, ..)) => {
                Err(about(path, format!("--resume: expected a checkpoint begun with {option}, found one without")))
            }
            None => Ok(()),
        }
    }

    /// As many as there is room for beside `others`.
    fn usual_depth_points(&self, others: usize) -> usize {
        let room = self.cap.saturating_sub(others + self.far_points);
        if self.depth_weight() > 0.0 { AT_DEPTHS.min(self.cap / 2).min(room) } else { 0 }
    }

    /// A model to begin with, and whether it is at points of the capture.
    fn begin(&self, opened: &OpenCapture, dataset: &Dataset, options: &TrainOptions) -> Result<(Model, bool), Failure> {
        let unfinished = self.out.join(UNFINISHED);
        let path = if unfinished.is_file() { unfinished } else { self.out.join(CHECKPOINT) };
        if self.resume {
            let bytes = fs::read(&path).map_err(|e| about(&path, format!("expected a checkpoint, found {e}")))?;
            let (model, begun_with) = checkpoint::read(&bytes).map_err(|e| about(&path, e))?;
            model.check_places(dataset).map_err(|e| about(&path, e))?;
            self.check_background(dataset)?;
            self.check_cameras(&model, &path)?;
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
        let usual = if opened.points.is_some() { 0 } else { AT_RANDOM };
        let count = self.random_points.unwrap_or(usual);
        let mut points = at_random(dataset, count, options);
        let known = opened.points.as_ref().map_or(0, |points| points.places.len());
        let at_depths = at_depths(
            dataset,
            self.depth_points.unwrap_or(self.usual_depth_points(points.places.len() + known)),
            options,
        );
        let far = at_far(dataset, opened.points.as_ref(), self.far_points, options);
        for more in opened.points.iter().chain([&at_depths, &far]) {
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

    /// Trains on photographs that grow; the model, and whether all steps were taken.
    fn train(
        &self,
        dataset: &Dataset,
        options: &TrainOptions,
        mut model: Model,
        weights: &[f32],
        run: &mut Run,
    ) -> Result<(Model, bool), Failure> {
        for (factor, until) in growing::stages(dataset, options.iterations, self.small) {
            if model.iteration >= until && factor > 1 {
                continue;
            }
            let small = (factor > 1).then(|| dataset.smaller(factor));
            let mut engine = self.engine(small.as_ref().unwrap_or(dataset), options, model)?;
            let trained =
                train_in_proportion(engine.as_mut(), weights, until, options.seed, REPORT_EVERY, &mut |engine, at| {
                    run.watch(engine, at).map_err(|e| error_at("training", "files", &e.to_string()))
                });
            let finished = trained.or_else(|error| self.rescue(std::mem::take(&mut run.best), dataset, error))?;
            model = engine.model()?;
            if !finished {
                return Ok((model, false));
            }
        }
        Ok((model, true))
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

    /// How often each photograph is learned from.
    fn view_weights(&self, dataset: &Dataset, points: Option<&Points>) -> Result<Vec<f32>, Failure> {
        if self.ground_views == 0.0 {
            return Ok(vec![1.0; dataset.training.len()]);
        }
        let none = |expected: &str| about(&self.capture, format!("--ground-views: expected {expected}, found none"));
        let shares = match self.ground_labels.is_empty() {
            false => label_shares(&self.ground_labels, dataset),
            true => {
                let points = points.ok_or_else(|| none("points (points.ply), or --ground-labels"))?;
                let ground = Ground::of_points(&points.places, dataset, &GroundOptions::default());
                ground.ok_or_else(|| none("a plane below the cameras"))?.shares(&points.places, dataset)
            }
        };
        if shares.iter().all(|share| *share == 0.0) {
            let there: BTreeSet<u8> = dataset.training.iter().flat_map(|one| one.labels.iter().copied()).collect();
            let expected = match self.ground_labels.is_empty() {
                true => "photographs that show the plane".into(),
                false => format!(
                    "label images with one of {:?} (--ground-labels; `index` in labels.toml), those here have {there:?}",
                    self.ground_labels
                ),
            };
            return Err(none(&expected));
        }
        Ok(shares.iter().map(|share| 1.0 + self.ground_views as f32 * share).collect())
    }

    /// Scores of held-out photographs with cameras that were moved to where they show the left half best; none when poses are as given.
    fn aligned(&self, model: &Model, dataset: &Dataset, held_out: &[Photograph]) -> Result<Vec<Score>, Failure> {
        if !self.refine_poses {
            return Ok(vec![]);
        }
        let align = |one: &Photograph| {
            let camera = pose::aligned(&model.cloud, one, dataset, ALIGN_STEPS)?;
            Ok(Photograph { camera, ..one.clone() })
        };
        let moved: Vec<Photograph> = held_out.iter().map(align).collect::<Result<_, Failure>>()?;
        Ok(scores(&model.cloud, &moved, dataset)?)
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
        if !(self.refine_poses || self.refine_lens || is_found) {
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
            "--seed": self.seed, "--strategy": named_value(&self.strategy), "--guide": named_value(&self.guide), "--poses": named_value(&self.poses),
            "--downscale": self.downscale, "--hold-out": self.hold_out, "--exposure": self.exposure, "--vignetting": self.vignetting,
            "--refine-poses": self.refine_poses, "--refine-lens": self.refine_lens, "--shutter": self.shutter, "--readout": self.readout,
            "--shutter-samples": self.shutter_samples, "--gamma": self.gamma, "--flattening": self.flattening,
            "--depth-prior": self.depth_weight(), "--stereo": self.stereo, "--depth-normal": self.depth_normal,
            "--multi-view": self.multi_view, "--normal-prior": self.normal_prior, "--labels": self.labels,
            "--ground-views": self.ground_views, "--clear": self.clear, "--drop": self.drop, "--small": self.small,
            "--antialias": self.antialias, "--settle": self.settle, "--harmonics-weight": self.harmonics_weight, "--noise": self.noise,
            "--opacity-weight": self.opacity_weight, "--scale-weight": self.scale_weight,
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
    fn lost(&self, dataset: &Dataset) -> Vec<String> {
        let without = |has: fn(&Photograph) -> bool| dataset.training.iter().filter(|one| !has(one)).count();
        let mut lost = vec![];
        for (name, weight, missing) in [
            ("depths", self.depth_weight(), without(|one| !one.depth.is_empty())),
            ("normals", self.normal_prior, without(|one| !one.normals.is_empty())),
            ("labels", self.labels, without(|one| !one.labels.is_empty())),
        ] {
            if weight > 0.0 && missing > 0 {
                lost.push(format!("{missing} of {} photographs have no {name}", dataset.training.len()));
            }
        }
        let alone = dataset.alone();
        if !alone.is_empty() {
            let names = alone.iter().take(5).copied().collect::<Vec<_>>().join(", ");
            let more = if alone.len() > 5 { ", ..." } else { "" };
            lost.push(format!("{} photographs show nothing that another shows: {names}{more}", alone.len()));
        }
        if dataset.stands_still() && self.depth_weight() == 0.0 {
            lost.push("all photographs were taken from one place: nothing tells depth".into());
        }
        lost
    }

    fn notify(
        &self,
        metrics: &Value,
        means: [Option<Score>; 3],
        run: &Run,
        seconds: f64,
        splats: usize,
    ) -> Result<(), Failure> {
        if self.json {
            return Ok(say(&format!("{metrics}\n"))?);
        }
        let loss = run.loss.map_or(String::new(), |loss| format!(", loss {loss:.5}"));
        let mut text = format!("{splats} Gaussians{loss}, {seconds:.1} s of training\n");
        if let Some(steps) = metrics["aside"]["steps"].as_u64().filter(|steps| *steps < u64::from(self.iterations)) {
            let asked = self.iterations;
            text += &format!("{steps} steps of {asked}: more did not help photographs that were put aside\n");
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
        if let Some(px) = metrics["shutter"]["motion_px"].as_f64() {
            text += &format!("cameras moved by {px:.2} px (mean) during a photograph\n");
        }
        if let Some(depths) = stereo::in_words(&metrics["stereo"]) {
            text += &format!("{depths}\n");
        }
        let remarks = [
            "held out",
            "held out, cameras aligned on the left half",
            "held out, with the motion of the camera fitted to the left half",
        ];
        for (what, mean) in remarks.iter().zip(means) {
            let Some(s) = mean else { continue };
            text += &format!("{what}: {}\n", in_words(&s));
        }
        if let Some(ground) = words::ground_in_words(&metrics["ground"]) {
            text += &format!("{ground}\n");
        }
        for (name, ms) in run.mean_times() {
            text += &format!("  {name:18} {ms:7.3} ms\n");
        }
        Ok(say(&format!("{text}written to {}\n", self.out.display()))?)
    }
}

/// A value of an option as it is typed.
fn named_value(value: &impl ValueEnum) -> Option<String> {
    value.to_possible_value().map(|value| value.get_name().to_owned())
}

/// Each camera as it was learned: its lens and the lens's vignetting, how far it moved, and the photographs' own motions (root mean square).
fn refined(model: &Model, dataset: &Dataset) -> Vec<Value> {
    let one = |(group, shared): (usize, &cameras::SharedAppearance)| {
        let of = |k: &usize| model.groups[*k] == group;
        let taken: Vec<usize> = (0..model.groups.len()).filter(of).collect();
        let lens = shared.camera(&dataset.training[taken[0]].camera);
        let own = |k: &usize| {
            let given = shared.motion * dataset.training[*k].camera.camera_from_world;
            let own = model.poses[*k] * given.inverse();
            (own.position.length_squared(), own.rotation.to_scaled_axis().length_squared())
        };
        let mean = |of: &dyn Fn((f64, f64)) -> f64| taken.iter().map(|k| of(own(k))).sum::<f64>() / taken.len() as f64;
        json!({"photographs": taken.len(), "fx": lens.fx, "fy": lens.fy, "cx": lens.cx, "cy": lens.cy, "vignetting": shared.vignetting,
            "motion_m": shared.motion.position.to_array(),
            "motion_deg": shared.motion.rotation.to_scaled_axis().to_array().map(f64::to_degrees),
            "own_motion_m": mean(&|(metres, _)| metres).sqrt(), "own_motion_deg": mean(&|(_, angle)| angle).sqrt().to_degrees()})
    };
    model.shared.iter().enumerate().map(one).collect()
}
