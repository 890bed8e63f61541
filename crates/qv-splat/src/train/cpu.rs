//! Steps on the CPU: the reference for those on the card.

use super::adam::{regularise, shake, step, step_exposure};
use super::cameras;
use super::dataset::{Dataset, Photograph};
use super::drawn::drawn;
use super::drop::Drop;
use super::engine::Engine;
use super::exposure::{self, Exposure, exposed_backward, exposed_image};
use super::filter::{self, Sampling};
use super::loss::photometric;
use super::mcmc::Relocation;
use super::model::Model;
use super::options::TrainOptions;
use super::random::{Purpose, words};
use super::terms::{depth_normal, labels, multi_view, priors};
use super::transients::{masked, masks, residuals};
use crate::SplatError;
use qv_core::{Camera, GaussianCloud};
use qv_raster::{Frame, Image, Outputs, Scene, Settings, View, render};
use std::borrow::Cow;

/// Trains on the CPU. The same inputs give the same bits on any number of threads.
#[derive(Debug)]
pub struct CpuEngine<'a> {
    dataset: &'a Dataset,
    options: TrainOptions,
    model: Model,
    /// Photographs without what moves; none before that was looked for.
    masked: Vec<Photograph>,
    /// For each photograph those that are near it.
    partners: Vec<Vec<usize>>,
    /// What photographs sample, with anti-aliasing.
    sampling: Option<Sampling>,
    /// Sum of losses, and of how many steps, since they were asked for.
    losses: (f64, u32),
}

impl<'a> CpuEngine<'a> {
    /// Begins, or goes on, with a model.
    ///
    /// # Errors
    /// Options are off, or the model is not of this many photographs.
    pub fn new(dataset: &'a Dataset, options: &TrainOptions, model: Model) -> Result<Self, SplatError> {
        options.check()?;
        model.cloud.check()?;
        model.check(dataset)?;
        let cameras: Vec<Camera> = dataset.training.iter().map(|one| one.camera).collect();
        let partners = multi_view::partners(&cameras, dataset.extent);
        let sampling = dataset.antialias.then(|| dataset.sampling());
        let masked = masked(dataset, &model.masks);
        Ok(Self { dataset, options: *options, model, masked, partners, sampling, losses: (0.0, 0) })
    }

    /// Deviations of the filter of each Gaussian; none without anti-aliasing.
    fn deviations(&self) -> Vec<f32> {
        self.sampling.as_ref().map_or(vec![], |sampling| sampling.deviations(&self.model.cloud.means))
    }

    /// The Gaussians as they are drawn.
    fn filtered(&self, deviations: &[f32]) -> Cow<'_, GaussianCloud> {
        match deviations.is_empty() {
            true => Cow::Borrowed(&self.model.cloud),
            false => Cow::Owned(filter::seen(&self.model.cloud, deviations)),
        }
    }

    /// A photograph to learn from, without what moves.
    fn photograph(&self, index: usize) -> &Photograph {
        self.masked.get(index).unwrap_or(&self.dataset.training[index])
    }

    /// Looks for what moves in all photographs.
    fn mask(&mut self) -> Result<(), SplatError> {
        let (mut cameras, mut all) = (vec![], vec![]);
        for (index, one) in self.dataset.training.iter().enumerate() {
            let camera = self.model.camera(self.dataset, index);
            let image = drawn(&self.model.cloud, &camera, self.dataset)?;
            cameras.push(camera);
            all.push(residuals(&exposed_image(&self.model.exposures[index], &image.colour), one));
        }
        self.model.masks = masks(&self.model.cloud.means, &cameras, &all);
        self.masked = masked(self.dataset, &self.model.masks);
        Ok(())
    }

    fn settings(&self) -> Settings {
        self.dataset.settings(outputs(&self.options, self.model.iteration))
    }

    /// One photograph: derivatives of everything but the Gaussians' regularisers.
    fn look(&mut self, index: usize) -> Result<qv_raster::Gradients, SplatError> {
        let camera = self.model.camera(self.dataset, index);
        let settings = self.settings();
        let drop = Drop::of(&self.options, self.model.iteration);
        let deviations = self.deviations();
        let filtered = self.filtered(&deviations);
        let whole: &GaussianCloud = &filtered;
        let thinned = drop.map(|drop| {
            let opacity_logits = drop.seen(&whole.opacity_logits);
            GaussianCloud { opacity_logits, ..whole.clone() }
        });
        let scene = Scene::still(thinned.as_ref().unwrap_or(whole));
        let frame = Frame::new(&scene, &[View::of(camera)], &settings)?;
        let (images, mut by_images) = (frame.images(), frame.blank_images());
        let (mut loss, by_colour, by_exposure) = self.photometric(index, &images[0]);
        by_images[0].colour = by_colour;
        loss += self.terms(index, &camera, &images[0], &mut by_images[0])?;
        let mut by = frame.gradients(&scene, &by_images)?;
        if let Some(drop) = drop {
            drop.back(&whole.opacity_logits, &mut by.opacity_logits);
        }
        if !deviations.is_empty() {
            filter::back(&self.model.cloud, &deviations, &mut by);
        }
        self.losses.0 += loss as f64;
        self.losses.1 += 1;
        if let Some(by) = by_exposure {
            let rates = self.options.rates(self.model.iteration, self.dataset.extent);
            let seen = self.seen();
            step_exposure(&mut self.model, index, &by, rates.exposures, seen);
        }
        Ok(by)
    }

    /// Loss of colours, and its derivatives by them and by the exposure where that is learned.
    fn photometric(&self, index: usize, image: &Image) -> (f32, Vec<f32>, Option<Exposure>) {
        let photograph = self.photograph(index);
        let (wanted, valid) = (photograph.colour(), photograph.valid());
        let (options, exposure) = (&self.options, &self.model.exposures[index]);
        let (width, share) = (image.width, options.weights.ssim);
        if !options.exposure {
            let (loss, by) = photometric(&image.colour, &wanted, &valid, width, share);
            return (loss, by, None);
        }
        let seen = exposed_image(exposure, &image.colour);
        let (loss, mut by) = photometric(&seen, &wanted, &valid, width, share);
        let mut by_exposure = exposed_backward(exposure, &image.colour, &mut by);
        exposure::regularise(exposure, options.weights.exposure, &mut by_exposure);
        (loss, by, Some(by_exposure))
    }

    /// Terms of geometry and labels; their derivatives go into `by`.
    fn terms(&self, index: usize, camera: &Camera, image: &Image, by: &mut Image) -> Result<f32, SplatError> {
        let (weights, iteration) = (&self.options.weights, self.model.iteration);
        let photograph = self.photograph(index);
        let mut loss = 0.0;
        if weights.labels > 0.0 {
            loss += labels::add(image, photograph, self.model.cloud.feature_count, weights.labels, by);
        }
        if iteration < self.options.geometry_from {
            return Ok(loss);
        }
        if weights.depth_prior > 0.0 && !photograph.depth.is_empty() {
            loss += priors::depth(image, photograph, weights.depth_prior, by);
        }
        if weights.depth_normal > 0.0 {
            loss += depth_normal::add(image, camera, weights.depth_normal, by);
        }
        if weights.multi_view > 0.0 {
            loss += self.multi_view(index, camera, image, by)?;
        }
        Ok(loss)
    }

    fn multi_view(&self, index: usize, camera: &Camera, image: &Image, by: &mut Image) -> Result<f32, SplatError> {
        let (options, iteration) = (&self.options, self.model.iteration);
        let partners = &self.partners[index];
        if partners.is_empty() {
            return Ok(0.0);
        }
        let word = words(options.seed, iteration, 0, Purpose::Pair)[0];
        let partner = partners[word as usize % partners.len()];
        let other = &self.dataset.training[partner];
        let other_camera = self.model.camera(self.dataset, partner);
        let outputs = Outputs { plane: true, ..Default::default() };
        let settings = Settings { outputs, ..self.settings() };
        let filtered = self.filtered(&self.deviations());
        let (drawn, _) = render(&Scene::still(&filtered), &[View::of(other_camera)], &settings)?;
        let (grey, other_grey) = (multi_view::grey(&self.dataset.training[index]), multi_view::grey(other));
        let other = multi_view::Other::new(&other_camera, camera, &other_grey, &drawn[0].plane_depth);
        let random = [options.seed, iteration];
        Ok(multi_view::add(image, &grey, camera, &other, options.weights.multi_view, random, by))
    }

    /// How often a photograph has been seen, this time counted.
    fn seen(&self) -> u32 {
        self.model.iteration / self.dataset.training.len() as u32 + 1
    }

    fn come_and_go(&mut self) {
        let (options, iteration) = (self.options, self.model.iteration);
        if options.refines(iteration) {
            let model = &mut self.model;
            Relocation::of_dead(&model.cloud.opacity_logits, options.seed, iteration).apply(model);
            Relocation::of_new(&model.cloud.opacity_logits, options.cap, options.seed, iteration).apply(model);
        }
    }
}

/// What the terms of the loss need to be drawn in a step.
pub fn outputs(options: &TrainOptions, iteration: u32) -> Outputs {
    let geometry = iteration >= options.geometry_from;
    Outputs {
        depth: options.weights.depth_prior > 0.0 && geometry,
        plane: options.weights.planes() && geometry,
        features: options.weights.labels > 0.0,
    }
}

impl Engine for CpuEngine<'_> {
    fn step(&mut self, photograph: usize) -> Result<(), SplatError> {
        let iteration = self.model.iteration;
        self.model.raise_degree(self.options.degree(iteration));
        let mut by = self.look(photograph)?;
        let rates = self.options.rates(iteration, self.dataset.extent);
        regularise(&self.model, &self.options, self.dataset.extent, &mut by);
        step(&mut self.model, &by, &rates);
        if self.options.poses {
            let (seen, extent) = (self.seen(), self.dataset.extent);
            cameras::step(&mut self.model, &self.options, photograph, &by.poses[0], extent, seen);
        }
        let noise = self.options.noise_rate(iteration, self.dataset.extent);
        shake(&mut self.model, noise, self.options.seed);
        self.come_and_go();
        self.model.iteration += 1;
        if self.options.looks_for_transients(self.model.iteration) {
            self.mask()?;
        }
        Ok(())
    }

    fn iteration(&self) -> u32 {
        self.model.iteration
    }

    fn splats(&self) -> usize {
        self.model.cloud.len()
    }

    fn loss(&mut self) -> Result<f32, SplatError> {
        let (sum, count) = std::mem::take(&mut self.losses);
        Ok((sum / count.max(1) as f64) as f32)
    }

    fn model(&mut self) -> Result<Model, SplatError> {
        Ok(self.model.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::super::engine::train;
    use super::super::exposure::NEUTRAL;
    use super::super::exposure::exposed_image;
    use super::super::start::of_points;
    use super::super::{checkpoint, scores, tiny};
    use super::*;
    use crate::facts::States;
    use crate::files::Points;

    fn begin(scene: &tiny::Tiny, options: &TrainOptions) -> Model {
        let shaken = |(i, mean): (usize, &[f32; 3])| mean.map(|x| x + 0.03 * (i as f32 + 7.0 * x).sin());
        let places: Vec<[f32; 3]> = scene.cloud.means.iter().enumerate().map(shaken).collect();
        let colours = vec![[0.5; 3]; places.len()];
        Model::new(of_points(&Points { places, colours, ..Default::default() }, options).unwrap(), &scene.dataset)
    }

    fn options(iterations: u32) -> TrainOptions {
        TrainOptions {
            iterations,
            cap: 150,
            refine_from: 50,
            refine_every: 25,
            sh_degree: 1,
            sh_interval: 60,
            ..Default::default()
        }
    }

    fn run(engine: &mut CpuEngine, views: usize, until: u32) -> f32 {
        let mut last = f32::MAX;
        let finished = train(engine, views, until, 3, 25, &mut |_, progress| {
            last = progress.loss.unwrap_or(last);
            Ok(true)
        });
        assert_eq!(finished, Ok(true));
        last
    }

    fn psnr(engine: &mut CpuEngine, dataset: &Dataset) -> f64 {
        let all = scores(&engine.model().unwrap().cloud, &dataset.training, dataset).unwrap();
        all.iter().map(|score| score.psnr).sum::<f64>() / all.len() as f64
    }

    #[test]
    fn a_known_scene_is_recovered() {
        let scene = tiny::scene(60, 8, 48);
        let options = TrainOptions { cap: 110, ..options(600) };
        let mut engine = CpuEngine::new(&scene.dataset, &options, begin(&scene, &options)).unwrap();
        let before = psnr(&mut engine, &scene.dataset);
        run(&mut engine, 8, 600);
        let after = psnr(&mut engine, &scene.dataset);
        println!("{before:.2} to {after:.2} dB with {}", engine.splats());
        assert!(after > 29.0 && after > before + 6.0, "{before} to {after}");
        assert!(engine.splats() > 60 && engine.splats() <= 110);
    }

    #[test]
    fn a_background_that_is_known_need_not_be_learned() {
        // Photographs of the same scene over grey, learned over grey and over black.
        let mut scene = tiny::scene(60, 8, 48);
        let grey = [0.5, 0.4, 0.6];
        let over = Dataset { background: grey, ..scene.dataset.clone() };
        for one in &mut scene.dataset.training {
            let image = drawn(&scene.cloud, &one.camera, &over).unwrap();
            one.pixels = tiny::of_image(&image, &one.camera, &one.name).pixels;
        }
        let losses = [grey, [0.0; 3]].map(|background| {
            scene.dataset.background = background;
            let options = options(200);
            let mut engine = CpuEngine::new(&scene.dataset, &options, begin(&scene, &options)).unwrap();
            run(&mut engine, 8, 200)
        });
        assert!(losses[0] < 0.7 * losses[1], "{losses:?}");
    }

    #[test]
    fn stopping_and_going_on_gives_the_same_bits_on_any_number_of_threads() {
        let mut scene = tiny::scene(40, 4, 32);
        for antialias in [true, false] {
            scene.dataset.antialias = antialias;
            let options = TrainOptions { exposure: true, poses: true, drop: 0.2, ..options(90) };
            let whole = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let mut engine = CpuEngine::new(&scene.dataset, &options, begin(&scene, &options)).unwrap();
                    run(&mut engine, 4, 90);
                    engine.model().unwrap()
                })
            };
            let one = whole(1);
            assert!(one == whole(3), "{antialias}: threads");
            let mut engine = CpuEngine::new(&scene.dataset, &options, begin(&scene, &options)).unwrap();
            run(&mut engine, 4, 61);
            let saved = checkpoint::read(&checkpoint::write(&engine.model().unwrap(), "")).unwrap().0;
            let mut again = CpuEngine::new(&scene.dataset, &options, saved).unwrap();
            run(&mut again, 4, 90);
            assert!(one == again.model().unwrap(), "{antialias}: going on");
        }
    }

    #[test]
    fn exposures_are_learned_and_a_stop_is_a_stop() {
        let mut scene = tiny::scene(60, 6, 40);
        for (k, photograph) in scene.dataset.training.iter_mut().enumerate() {
            let mut e = NEUTRAL;
            (0..3).for_each(|c| e[5 * c] = 0.7 + 0.1 * k as f32);
            let bytes = exposed_image(&e, &photograph.colour());
            for (pixel, colour) in photograph.pixels.rgba.iter_mut().zip(bytes.chunks_exact(3)) {
                (0..3).for_each(|c| pixel[c] = (colour[c].clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            }
        }
        let mut losses = vec![];
        for exposure in [false, true] {
            let mut options = TrainOptions { exposure, ..options(600) };
            options.weights.exposure = 0.001;
            let mut engine = CpuEngine::new(&scene.dataset, &options, begin(&scene, &options)).unwrap();
            losses.push(run(&mut engine, 6, 600));
            let model = engine.model().unwrap();
            let gains: Vec<f32> = model.exposures.iter().map(|e| e[0]).collect();
            assert!(!exposure || gains[5] > 1.1 * gains[0], "{gains:?}");
            let mean = gains.iter().sum::<f32>() / gains.len() as f32;
            assert!((mean - 1.0).abs() < 1e-4, "the mean stays: {mean}");
        }
        assert!(losses[1] < 0.85 * losses[0], "{losses:?}");
        let options = options(100);
        let mut engine = CpuEngine::new(&scene.dataset, &options, begin(&scene, &options)).unwrap();
        let finished = train(&mut engine, 6, 100, 3, 25, &mut |_, progress| Ok(progress.iteration < 7)).unwrap();
        assert_eq!((finished, engine.iteration()), (false, 7));
    }

    #[test]
    fn a_pose_that_is_off_is_brought_back() {
        let scene = tiny::scene(60, 6, 48);
        let options = TrainOptions { poses: true, noise: 0.0, ..options(250) };
        let options = TrainOptions { refine_from: 1000, ..options };
        let mut model = Model::new(scene.cloud.clone(), &scene.dataset);
        let right = model.poses[2];
        model.poses[2].position.x += 0.01;
        let mut engine = CpuEngine::new(&scene.dataset, &options, model).unwrap();
        run(&mut engine, 6, 250);
        let found = engine.model().unwrap().poses[2].position.distance(right.position);
        assert!(found < 0.004, "{found}");
    }

    #[test]
    fn nothing_is_learned_from_what_is_held_out() {
        let all = tiny::scene(40, 9, 32);
        let (cloud, photographs) = (all.cloud, all.dataset.training);
        let mut models = vec![];
        for altered in [false, true] {
            let mut photographs = photographs.clone();
            if altered {
                photographs.iter_mut().step_by(4).for_each(|one| one.pixels.rgba.fill([9, 200, 9, 255]));
            }
            let dataset = Dataset::of_photographs(photographs, 4).unwrap();
            let names: Vec<&str> = dataset.held_out.iter().map(|one| one.name.as_str()).collect();
            assert_eq!(names, ["v00", "v04", "v08"]);
            assert!(dataset.training.iter().all(|one| !names.contains(&one.name.as_str())));
            let scene = tiny::Tiny { cloud: cloud.clone(), dataset };
            let options = options(60);
            let mut engine = CpuEngine::new(&scene.dataset, &options, begin(&scene, &options)).unwrap();
            run(&mut engine, 6, 60);
            models.push(engine.model().unwrap());
        }
        assert!(models[0] == models[1]);
    }

    #[test]
    fn a_model_of_other_photographs_is_refused() {
        let scene = tiny::scene(10, 4, 16);
        let mut model = Model::new(scene.cloud.clone(), &scene.dataset);
        model.exposures.pop();
        let error = CpuEngine::new(&scene.dataset, &TrainOptions::default(), model).unwrap_err().to_string();
        assert!(error.states("images 4 3"), "{error}");
        let mut model = Model::new(scene.cloud.clone(), &scene.dataset);
        assert_eq!(model.check_places(&scene.dataset), Ok(()));
        model.poses[2].position.x += 0.01;
        let error = model.check_places(&scene.dataset).unwrap_err().to_string();
        assert!(error.states("v02"), "{error}");
        model.first.poses[0][0] = 1e-9;
        assert_eq!(model.check_places(&scene.dataset), Ok(()), "refined poses");
    }
}
