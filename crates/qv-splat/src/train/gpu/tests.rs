//! The card against the CPU. Without an adapter the tests say that they skip.

#[cfg(test)]
#[path = "../../../../../fixtures/skipped.rs"]
mod skipped;

#[cfg(test)]
mod against_the_cpu {
    use super::super::super::cpu::CpuEngine;
    use super::super::super::filter;
    use super::super::super::start::of_points;
    use super::super::super::tiny;
    use super::super::*;
    use crate::files::Points;
    use qv_core::Pose;
    use qv_raster::gpu::{Gpu, GpuOptions};
    use qv_raster::{Scene, render};

    fn rasteriser() -> Option<GpuRasteriser> {
        match Gpu::new(&GpuOptions::default()) {
            Ok(gpu) => Some(GpuRasteriser::new(gpu)),
            Err(error) => {
                super::skipped::skipped(error);
                None
            }
        }
    }

    /// 64 floats of 32 bits are near enough when their difference is small beside the largest of them.
    fn near(name: &str, a: &[f32], b: &[f32], share: f32) {
        assert_eq!(a.len(), b.len(), "{name}");
        let largest = a.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let worst = a.iter().zip(b).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        assert!(worst <= share * largest + 1e-12, "{name}: {worst} of {largest}");
    }

    fn begin(scene: &tiny::Tiny, options: &TrainOptions) -> Model {
        let places: Vec<[f32; 3]> = scene.cloud.means.iter().map(|m| m.map(|x| x + 0.03 * (9.0 * x).sin())).collect();
        let colours = vec![[0.5; 3]; places.len()];
        let mut model =
            Model::new(of_points(&Points { places, colours, ..Default::default() }, options).unwrap(), &scene.dataset);
        model.cloud.log_scales.iter_mut().for_each(|s| *s = [-2.0, -2.3, -2.6]);
        model.raise_degree(2);
        model
    }

    #[test]
    fn one_step_is_that_of_the_cpu() {
        let mut scene = tiny::scene(70, 12, 50);
        for (i, pixel) in scene.dataset.training[1].pixels.rgba.iter_mut().enumerate() {
            pixel[3] = if i % 50 < 6 { 0 } else { 255 };
        }
        scene.dataset.training[1].normals =
            (0..2500).map(|i| if i % 3 == 0 { [0.0; 3] } else { [0.0, 0.0, -1.0] }).collect();
        scene.dataset.training[1].labels = (0..2500).map(|i| (i % 4) as u8).collect();
        for strategy in [Strategy::Mcmc, Strategy::Classic] {
            for atomic in [true, false] {
                scene.dataset.antialias = atomic;
                let Some(rasteriser) = rasteriser() else { return };
                let mut options =
                    TrainOptions { strategy, exposure: true, poses: true, lens: true, cap: 100, ..Default::default() };
                options.vignetting = true;
                (options.drop, options.iterations) = (0.5, 10);
                options.weights.flattening = 10.0;
                options.weights.harmonics = 50.0;
                options.settle = 0.5;
                options.weights.normal_prior = 0.1;
                options.weights.labels = 0.5;
                options.weights.depth_normal = 0.1;
                options.weights.depth_prior = 0.2;
                options.weights.multi_view = 3.0;
                options.geometry_from = 0;
                scene.dataset.background = [0.6, 0.3, 0.1];
                let mut model = begin(&scene, &options);
                model.cloud.feature_count = 3;
                model.cloud.features = (0..210).map(|i| (i as f32).sin()).collect();
                let mut model = Model::new(model.cloud, &scene.dataset);
                // Half way, where a quarter of the Gaussians is left out.
                model.iteration = 5;
                model.shared[0].vignetting = [-0.2, 0.1, -0.05];
                let mut cpu = CpuEngine::new(&scene.dataset, &options, model.clone()).unwrap();
                let how = GpuTraining { atomic };
                let mut gpu = GpuEngine::new(rasteriser, &scene.dataset, &options, model.clone(), how).unwrap();
                // What the other view shows is drawn anew on the CPU and kept from the last time on the card.
                for (k, buffer) in gpu.plane_depths.iter().enumerate() {
                    let outputs = Outputs { plane: true, ..Default::default() };
                    let settings = Settings { outputs, antialias: atomic, ..Default::default() };
                    let view = View::of(scene.dataset.training[k].camera);
                    let mut cloud = begin(&scene, &options).cloud;
                    if atomic {
                        cloud = filter::seen(&cloud, &scene.dataset.sampling().deviations(&cloud.means));
                    }
                    let (images, _) = render(&Scene::still(&cloud), &[view], &settings).unwrap();
                    gpu.rasteriser.gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&images[0].plane_depth));
                }
                cpu.step(1).unwrap();
                gpu.step(1).unwrap();
                // The card shows the photometric loss alone.
                let (loss, found) = (cpu.loss().unwrap(), gpu.loss().unwrap());
                assert!(found < loss && found > 0.1 * loss, "{loss} {found}");
                let (a, b) = (cpu.model().unwrap(), gpu.model().unwrap());
                let mut without = options;
                without.weights.multi_view = 0.0;
                let mut other = CpuEngine::new(&scene.dataset, &without, model.clone()).unwrap();
                other.step(1).unwrap();
                assert_ne!(other.model().unwrap().first.means, a.first.means, "the pair was looked at");
                for (name, m, n) in [("first", &a.first, &b.first), ("second", &a.second, &b.second)] {
                    near(&format!("{name} means"), m.means.as_flattened(), n.means.as_flattened(), 1e-3);
                    near(&format!("{name} scales"), m.log_scales.as_flattened(), n.log_scales.as_flattened(), 1e-3);
                    near(&format!("{name} rotations"), m.rotations.as_flattened(), n.rotations.as_flattened(), 1e-3);
                    near(&format!("{name} logits"), &m.opacity_logits, &n.opacity_logits, 1e-3);
                    near(&format!("{name} sh"), m.sh.as_flattened(), n.sh.as_flattened(), 1e-3);
                    near(&format!("{name} features"), &m.features, &n.features, 1e-3);
                    near(&format!("{name} poses"), m.poses.as_flattened(), n.poses.as_flattened(), 1e-3);
                }
                near("exposures", a.exposures.as_flattened(), b.exposures.as_flattened(), 1e-4);
                near("exposure means", a.exposures_first.as_flattened(), b.exposures_first.as_flattened(), 1e-3);
                let apart = |p: &Pose, q: &Pose| p.position.distance(q.position) + p.rotation.angle_between(q.rotation);
                assert!(a.poses.iter().zip(&b.poses).all(|(p, q)| apart(p, q) < 1e-5));
                let [shared, found] = [&a.shared[0], &b.shared[0]];
                near("camera first", &shared.first, &found.first, 1e-3);
                near("camera second", &shared.second, &found.second, 1e-3);
                near("lens", &shared.lens, &found.lens, 1e-3);
                near("vignetting", &shared.vignetting, &found.vignetting, 1e-3);
                assert!(shared.first[9..].iter().all(|mean| *mean != 0.0), "{:?}", shared.first);
                assert!(apart(&shared.motion, &found.motion) < 1e-5 && shared.seen == 1 && found.seen == 1);
                near("noise and means", a.cloud.means.as_flattened(), b.cloud.means.as_flattened(), 1e-3);
                if strategy == Strategy::Classic {
                    near("pulls", a.pulls.as_flattened(), b.pulls.as_flattened(), 1e-3);
                }
            }
        }
    }

    #[test]
    fn errors_are_shared_out_as_on_the_cpu() {
        let mut scene = tiny::scene(70, 12, 50);
        for antialias in [false, true] {
            let Some(rasteriser) = rasteriser() else { return };
            scene.dataset.antialias = antialias;
            let options =
                TrainOptions { guide: Guide::Views, exposure: true, vignetting: true, cap: 100, ..Default::default() };
            let mut model = begin(&scene, &options);
            model.iteration = 700;
            model.shared[0].vignetting = [-0.2, 0.1, -0.05];
            let cpu = CpuEngine::new(&scene.dataset, &options, model.clone()).unwrap();
            let mut gpu = GpuEngine::new(rasteriser, &scene.dataset, &options, model, Default::default()).unwrap();
            let (a, b) = (cpu.guide_weights().unwrap(), gpu.guide_weights().unwrap());
            near("weights", &a, &b, 1e-3);
            assert!(a.iter().all(|weight| *weight >= 0.0) && a.iter().sum::<f32>() > 1.0, "{a:?}");
        }
    }

    #[test]
    fn a_scene_is_learned_with_gaussians_that_come_and_go() {
        let scene = tiny::scene(60, 6, 40);
        for strategy in [Strategy::Mcmc, Strategy::Classic] {
            let Some(rasteriser) = rasteriser() else { return };
            let options = TrainOptions {
                strategy,
                iterations: 150,
                cap: 90,
                refine_from: 20,
                refine_every: 20,
                sh_degree: 1,
                sh_interval: 70,
                ..Default::default()
            };
            let mut model = begin(&scene, &options);
            model.cloud.opacity_logits[3] = -8.0;
            let mut engine = GpuEngine::new(rasteriser, &scene.dataset, &options, model, Default::default()).unwrap();
            let mut losses = vec![];
            let finished = crate::train::train(&mut engine, 6, 150, 1, 30, &mut |_, progress| {
                losses.extend(progress.loss);
                Ok(true)
            });
            assert_eq!((finished, losses.len()), (Ok(true), 5));
            assert!(losses[4] < 0.6 * losses[0], "{strategy:?}: {losses:?}");
            let model = engine.model().unwrap();
            assert_eq!((model.cloud.check(), model.iteration, model.cloud.len()), (Ok(()), 150, engine.splats()));
            assert!(engine.splats() > 60 && engine.splats() <= 90, "{}", engine.splats());
            assert!(model.cloud.means.iter().flatten().all(|x| x.is_finite()));
            if strategy == Strategy::Mcmc {
                assert!(model.cloud.opacity_logits[3] > -8.0);
            }
        }
    }
}
