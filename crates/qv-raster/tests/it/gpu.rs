//! The graphics card against the CPU, stage by stage. Without an adapter the tests say that they skip.

use crate::facts::States;
use crate::skipped::skipped;
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::gpu::{Gpu, GpuCloud, GpuOptions, GpuRasteriser, GpuSettings, Stage};
use qv_raster::stages::compose::compose;
use qv_raster::stages::project::ProjectedGaussian;
use qv_raster::{Frame, Image, Outputs, RasterError, Scene, Settings, View, workload};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

/// A rasteriser without subgroups and one with, which all tests share: to compile their shaders takes longer than to use them. None without
/// an adapter.
fn rasterisers() -> MutexGuard<'static, Vec<GpuRasteriser>> {
    static SHARED: LazyLock<Mutex<Vec<GpuRasteriser>>> = LazyLock::new(|| Mutex::new(new_rasterisers()));
    let shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    if shared.is_empty() {
        skipped("no adapter");
    }
    shared
}

/// The same, whose buffers nothing has grown yet.
fn new_rasterisers() -> Vec<GpuRasteriser> {
    let (mut out, mut why) = (vec![], String::new());
    for without_subgroups in [true, false] {
        match Gpu::new(&GpuOptions { without_subgroups, adapter: None }) {
            Ok(gpu) => out.push(GpuRasteriser::new(gpu)),
            Err(error) => why = error.to_string(),
        }
    }
    if out.is_empty() {
        skipped(why);
    }
    out
}

/// The records as the CPU has them.
fn records_of(rasteriser: &GpuRasteriser, count: usize) -> Vec<ProjectedGaussian> {
    let shapes: Vec<[f32; 8]> = rasteriser.read_stage("records", count).unwrap();
    let shades: Vec<[f32; 4]> = rasteriser.read_stage("shades", count).unwrap();
    let of = |(a, c): (&[f32; 8], &[f32; 4])| ProjectedGaussian {
        mean: [a[0], a[1]],
        factor: [a[2], a[3], a[4]],
        opacity: a[5],
        depth: c[3],
        view: a[6].to_bits(),
        colour: [c[0], c[1], c[2]],
        splat: a[7].to_bits(),
    };
    shapes.iter().zip(&shades).map(of).collect()
}

fn views_of(count: usize, width: u32, height: u32) -> Vec<View> {
    workload::cameras(count, 1, width, height).into_iter().map(View::of).collect()
}

fn workload_cloud(count: usize, degree: u8, features: usize) -> GaussianCloud {
    let mut cloud = workload::cloud(count, degree, 1);
    cloud.feature_count = features;
    cloud.features = (0..count * features).map(|i| (i % 97) as f32 / 97.0).collect();
    cloud
}

const SETTINGS: Settings = Settings { outputs: Outputs::ALL, background: [0.3, 0.4, 0.5], antialias: false };

const SETTINGS_PLAIN: Settings = Settings {
    outputs: Outputs { depth: false, plane: false, features: false },
    background: [0.0; 3],
    antialias: false,
};

/// Largest difference outside a share of pixels that may flip.
fn differ(a: &[f32], b: &[f32], flips: usize) -> f32 {
    assert_eq!(a.len(), b.len());
    assert!(a.iter().chain(b).all(|x| x.is_finite()));
    let mut all: Vec<f32> = a.iter().zip(b).map(|(a, b)| (a - b).abs() / a.abs().max(1.0)).collect();
    all.sort_by(f32::total_cmp);
    all.get(all.len().saturating_sub(1 + flips)).copied().unwrap_or(0.0)
}

fn images_agree(cpu: &Image, gpu: &Image) {
    let n = cpu.alpha.len() / 200;
    for (name, a, b, each) in [
        ("colour", &cpu.colour, &gpu.colour, 3),
        ("alpha", &cpu.alpha, &gpu.alpha, 1),
        ("depth", &cpu.depth, &gpu.depth, 1),
        ("normal", &cpu.normal, &gpu.normal, 3),
        ("plane depth", &cpu.plane_depth, &gpu.plane_depth, 1),
        ("features", &cpu.features, &gpu.features, 3),
    ] {
        let worst = differ(a, b, each * n);
        assert!(worst < 1e-4, "{name}: {worst}");
    }
}

#[test]
fn stages_and_images_are_those_of_the_cpu() {
    let cloud = workload_cloud(3000, 2, 3);
    let scene = Scene::still(&cloud);
    let mut views = views_of(3, 120, 90);
    views[1].camera = workload::cameras(2, 1, 77, 50)[1];
    for antialias in [false, true] {
        let settings = Settings { antialias, ..SETTINGS };
        stages_agree(&scene, &views, &settings);
    }
}

fn stages_agree(scene: &Scene, views: &[View], settings: &Settings) {
    let cpu = Frame::new(scene, views, settings).unwrap();
    for rasteriser in rasterisers().iter_mut() {
        println!("{} with subgroups of {}", rasteriser.gpu.info.name, rasteriser.gpu.subgroup);
        let on_card = GpuCloud::new(&rasteriser.gpu, scene).unwrap();
        let how = GpuSettings { keep: true, ..Default::default() };
        let (images, counts) = rasteriser.render(&on_card, scene, views, settings, &how).unwrap();
        let images = images.read().unwrap();
        let n = counts.candidates;
        let records = records_of(rasteriser, n);
        for (i, (a, b)) in cpu.projections.records.iter().zip(&records).enumerate() {
            assert_eq!((a.view, a.splat), (b.view, b.splat));
            let same = |x: f32, y: f32| (x - y).abs() <= 2e-4 * x.abs().max(1.0);
            assert!((0..2).all(|k| same(a.mean[k], b.mean[k])), "{i}: {a:?} {b:?}");
            assert!((0..3).all(|k| same(a.factor[k], b.factor[k]) && same(a.colour[k], b.colour[k])), "{a:?} {b:?}");
            assert!(same(a.opacity, b.opacity) && same(a.depth, b.depth), "{i}: {a:?} {b:?}");
        }
        let cpu_entries = cpu.entries.tiles.len() as f64;
        assert!((counts.entries as f64 / cpu_entries - 1.0).abs() < 1e-3, "{} {cpu_entries}", counts.entries);
        assert_eq!(counts.faulty, 0);
        for (cpu, gpu) in cpu.images().iter().zip(&images) {
            images_agree(cpu, gpu);
        }
    }
}

#[test]
fn the_order_is_that_of_a_64_bit_key_on_128_cameras() {
    let cloud = workload_cloud(1500, 0, 0);
    let scene = Scene::still(&cloud);
    let views = views_of(128, 64, 48);
    for rasteriser in rasterisers().iter_mut() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let how = GpuSettings { keep: true, ..Default::default() };
        let (_, counts) = rasteriser.render(&on_card, &scene, &views, &Settings::default(), &how).unwrap();
        let records = records_of(rasteriser, counts.candidates);
        let owners: Vec<u32> = rasteriser.read_stage("owners", counts.entries).unwrap();
        let ranges: Vec<[u32; 2]> = rasteriser.read_stage("ranges", 128 * 12).unwrap();
        // 1536 tiles take 11 bits, which are two digits on every adapter.
        let sorted: Vec<u32> = rasteriser.read_stage("sorted", counts.entries).unwrap();
        let key = |tile: usize, entry: u32| {
            let record = owners[entry as usize];
            ((tile as u64) << 32 | records[record as usize].depth.to_bits() as u64, record)
        };
        let mut previous = None;
        let mut seen = 0;
        for (tile, range) in ranges.iter().enumerate() {
            for place in range[0]..range[1] {
                let this = key(tile, sorted[place as usize]);
                assert!(previous.is_none_or(|previous| previous < this), "{previous:?} {this:?}");
                assert_eq!(records[this.1 as usize].view as usize, tile / 12);
                previous = Some(this);
                seen += 1;
            }
        }
        assert_eq!(seen, counts.entries);
    }
}

#[test]
fn the_same_bits_from_run_to_run_and_after_growing() {
    let cloud = workload_cloud(4000, 0, 0);
    let scene = Scene::still(&cloud);
    for rasteriser in rasterisers().iter_mut() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let how = GpuSettings::default();
        let settings = Settings { outputs: Outputs { depth: true, ..Default::default() }, ..SETTINGS };
        let first =
            rasteriser.render(&on_card, &scene, &views_of(2, 96, 64), &settings, &how).unwrap().0.read().unwrap();
        let more =
            rasteriser.render(&on_card, &scene, &views_of(40, 96, 64), &settings, &how).unwrap().0.read().unwrap();
        let again =
            rasteriser.render(&on_card, &scene, &views_of(2, 96, 64), &settings, &how).unwrap().0.read().unwrap();
        assert_eq!(first, again);
        assert_eq!(first[..], more[..2]);
    }
}

#[test]
fn bytes_are_rounded_floats() {
    let cloud = workload_cloud(3000, 1, 0);
    let scene = Scene::still(&cloud);
    let views = views_of(2, 100, 70);
    let settings = Settings { outputs: Outputs { depth: true, ..Default::default() }, ..SETTINGS };
    for rasteriser in rasterisers().iter_mut() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let mut draw = |bytes: bool| {
            let how = GpuSettings { bytes, ..Default::default() };
            rasteriser.render(&on_card, &scene, &views, &settings, &how).unwrap().0.read().unwrap()
        };
        let (floats, bytes) = (draw(false), draw(true));
        for (float, byte) in floats.iter().zip(&bytes) {
            let worst = differ(&float.colour, &byte.colour, float.alpha.len() / 200);
            assert!(worst < 0.6 / 255.0 + 1e-3, "{worst}");
            assert!(differ(&float.depth, &byte.depth, float.alpha.len() / 100) < 1e-3);
        }
    }
}

#[test]
fn odd_numbers_poison_their_own_gaussian_only() {
    let cloud = workload_cloud(800, 1, 0);
    let mut odd = cloud.clone();
    odd.means[3][1] = f32::NAN;
    odd.log_scales[5][0] = f32::INFINITY;
    odd.rotations[7] = [0.0; 4];
    odd.opacity_logits[9] = f32::NAN;
    odd.sh[4 * 11][2] = f32::NEG_INFINITY;
    odd.log_scales[13] = [f32::from_bits(1); 3];
    let mut without = odd.clone();
    for i in [3, 5, 7, 9, 11] {
        without.means[i] = [0.0, 0.0, -1e6];
        without.log_scales[i] = [-5.0; 3];
        without.rotations[i] = [1.0, 0.0, 0.0, 0.0];
        without.opacity_logits[i] = -20.0;
        without.sh[4 * i][2] = 0.0;
    }
    let views = views_of(2, 80, 60);
    for rasteriser in rasterisers().iter_mut() {
        let mut draw = |cloud: &GaussianCloud| {
            let scene = Scene::still(cloud);
            let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
            let how = GpuSettings::default();
            let (images, counts) = rasteriser.render(&on_card, &scene, &views, &Settings::default(), &how).unwrap();
            (images.read().unwrap(), counts.faulty)
        };
        let (found, faulty) = draw(&odd);
        let (expected, none) = draw(&without);
        assert_eq!(found, expected);
        assert_eq!(none, 0);
        assert_eq!(faulty, Frame::new(&Scene::still(&odd), &views, &Settings::default()).unwrap().projections.faulty);
    }
}

#[test]
fn nothing_and_everything_hidden_are_background() {
    let empty = GaussianCloud::default();
    let camera =
        Camera { fx: 30.0, fy: 30.0, cx: 16.0, cy: 16.0, width: 33, height: 17, camera_from_world: Pose::IDENTITY };
    for rasteriser in rasterisers().iter_mut() {
        let scene = Scene::still(&empty);
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let how = GpuSettings { bytes: true, ..Default::default() };
        let (images, counts) = rasteriser
            .render(
                &on_card,
                &scene,
                &[View::of(camera); 2],
                &Settings { background: [1.0, 0.0, 0.2], ..Default::default() },
                &how,
            )
            .unwrap();
        assert_eq!(counts.candidates, 0);
        let bytes = images.read_bytes().unwrap();
        assert_eq!(bytes.len(), 2 * 33 * 17 * 4);
        assert!(bytes.chunks(4).all(|pixel| pixel == [255, 0, 51, 0]));
        let (images, _) = rasteriser.render(&on_card, &scene, &[], &Settings::default(), &how).unwrap();
        assert!(images.read().unwrap().is_empty());
    }
}

/// One minus the cosine, and the ratio of lengths less one.
fn apart(a: &[f32], b: &[f32]) -> (f64, f64) {
    assert_eq!(a.len(), b.len());
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| *a as f64 * *b as f64).sum::<f64>();
    let (aa, bb) = (dot(a, a), dot(b, b));
    assert!(aa > 0.0, "nothing to compare");
    (1.0 - dot(a, b) / (aa * bb).sqrt(), (bb / aa).sqrt() - 1.0)
}

#[test]
fn gradients_are_those_of_the_cpu_and_the_same_bits_again() {
    let cloud = workload_cloud(2500, 3, 2);
    let scene = Scene::still(&cloud);
    let views = views_of(3, 90, 60);
    for (outputs, antialias) in [
        (Outputs::default(), false),
        (Outputs { depth: true, ..Default::default() }, false),
        (Outputs::ALL, false),
        (Outputs::ALL, true),
    ] {
        let settings = Settings { outputs, antialias, ..SETTINGS };
        let frame = Frame::new(&scene, &views, &settings).unwrap();
        let mut by_images = frame.blank_images();
        let wave = |values: &mut Vec<f32>| values.iter_mut().enumerate().for_each(|(i, x)| *x = (i as f32 * 0.7).sin());
        for image in &mut by_images {
            let all = [&mut image.colour, &mut image.alpha, &mut image.depth, &mut image.normal, &mut image.features];
            all.into_iter().for_each(wave);
            // Plane depth is ill-conditioned where little covers a pixel.
            let covered = frame.images();
            let solid = |i: usize| covered.iter().all(|image| image.alpha[i] > 0.2);
            image
                .plane_depth
                .iter_mut()
                .enumerate()
                .filter(|(i, _)| solid(*i))
                .for_each(|(i, x)| *x = (i as f32).cos());
        }
        let expected = frame.gradients(&scene, &by_images).unwrap();
        for rasteriser in rasterisers().iter_mut() {
            let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
            let how = GpuSettings { keep: true, ..Default::default() };
            let with_atomics = GpuSettings { atomic: true, ..how };
            rasteriser.render(&on_card, &scene, &views, &settings, &with_atomics).unwrap();
            let added_up = rasteriser.gradients(&on_card, &by_images).unwrap();
            rasteriser.render(&on_card, &scene, &views, &settings, &how).unwrap();
            let found = rasteriser.gradients(&on_card, &by_images).unwrap();
            let (angle, length) = apart(found.means.as_flattened(), added_up.means.as_flattened());
            assert!(angle < 1e-9 && length.abs() < 1e-5, "with atomics: {angle} {length}");
            let (angle, length) = apart(found.sh.as_flattened(), added_up.sh.as_flattened());
            assert!(angle < 1e-9 && length.abs() < 1e-5, "with atomics: {angle} {length}");
            for (name, a, b) in [
                ("means", expected.means.as_flattened(), found.means.as_flattened()),
                ("scales", expected.log_scales.as_flattened(), found.log_scales.as_flattened()),
                ("rotations", expected.rotations.as_flattened(), found.rotations.as_flattened()),
                ("opacities", &expected.opacity_logits[..], &found.opacity_logits[..]),
                ("sh", expected.sh.as_flattened(), found.sh.as_flattened()),
                ("poses", expected.poses.as_flattened(), found.poses.as_flattened()),
            ] {
                let (angle, length) = apart(a, b);
                println!("{outputs:?}: {name}: {angle:.1e} {length:.1e}");
                assert!(angle < 1e-5 && length.abs() < 1e-3, "{outputs:?}: {name}: {angle} {length}");
            }
            if outputs.features {
                assert!(apart(&expected.features, &found.features).0 < 1e-5);
            }
            assert_eq!(found, rasteriser.gradients(&on_card, &by_images).unwrap());
        }
    }
}

#[test]
fn a_large_batch_leaves_no_claim_on_a_small_one_of_another_kind() {
    let cloud = workload_cloud(3000, 0, 0);
    let scene = Scene::still(&cloud);
    let views = views_of(24, 64, 48);
    for mut rasteriser in new_rasterisers() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let keep = GpuSettings { keep: true, ..Default::default() };
        rasteriser.render(&on_card, &scene, &views[..1], &SETTINGS, &keep).unwrap();
        let alone = rasteriser.bytes();
        rasteriser.render(&on_card, &scene, &views, &SETTINGS_PLAIN, &GpuSettings::default()).unwrap();
        rasteriser.render(&on_card, &scene, &views[..1], &SETTINGS, &keep).unwrap();
        assert!(rasteriser.bytes() <= alone, "{} {alone}", rasteriser.bytes());
    }
}

#[test]
fn buffers_grow_to_what_is_needed_and_not_to_a_guess() {
    // Of the candidates that the first run draws each is on every tile, of all the others on one.
    let mut cloud = workload::cloud(400_000, 0, 1);
    let camera = Camera {
        fx: 300.0,
        fy: 300.0,
        cx: 160.0,
        cy: 120.0,
        width: 320,
        height: 240,
        camera_from_world: Pose::IDENTITY,
    };
    for i in 0..cloud.len() {
        cloud.means[i] = [0.001 * (i % 600) as f32 - 0.3, 0.001 * (i % 397) as f32 - 0.2, 2.0];
        cloud.log_scales[i] = if i < 2000 { [1.0; 3] } else { [-9.0; 3] };
    }
    let scene = Scene::still(&cloud);
    for mut rasteriser in new_rasterisers() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let how = GpuSettings::default();
        let (_, counts) = rasteriser.render(&on_card, &scene, &[View::of(camera)], &SETTINGS_PLAIN, &how).unwrap();
        assert!(counts.candidates > 390_000 && counts.entries > 900_000, "{counts:?}");
        assert!(rasteriser.bytes() < 100_000_000, "{}", rasteriser.bytes());
    }
}

#[test]
fn another_cloud_and_what_was_not_drawn_are_refused() {
    let (large, small) = (workload_cloud(600, 0, 0), workload_cloud(2, 0, 0));
    let scene = Scene::still(&large);
    for rasteriser in rasterisers().iter_mut() {
        let [whole, part] = [&scene, &Scene::still(&small)].map(|scene| GpuCloud::new(&rasteriser.gpu, scene).unwrap());
        let how = GpuSettings { keep: true, ..Default::default() };
        rasteriser.prepare(&whole, &scene, &views_of(1, 64, 48), &SETTINGS_PLAIN, &how).unwrap();
        assert!(rasteriser.images().is_err() && rasteriser.submit_backward(&whole, false).is_err());
        let error = rasteriser.submit(&part, false).unwrap_err().to_string();
        assert!(error.states("600 Gaussians") && error.states("2 Gaussians"), "{error}");
        rasteriser.submit(&whole, false).unwrap();
        assert!(rasteriser.submit_backward(&part, false).is_err() && rasteriser.read_gradients(&part).is_err());
        assert!(rasteriser.read_stage::<u32>("order_other", 1).is_err(), "written over by later stages");
        assert!(rasteriser.read_stage::<u32>("order", 1 << 28).is_err());
    }
}

#[test]
fn the_card_goes_on_from_any_stage_of_the_cpu() {
    let cloud = workload_cloud(2000, 1, 3);
    let scene = Scene::still(&cloud);
    let views = views_of(2, 90, 60);
    let frame = Frame::new(&scene, &views, &SETTINGS).unwrap();
    let expected = frame.images();
    for rasteriser in rasterisers().iter_mut() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        for stage in Stage::ALL {
            for keep in [false, true] {
                let how = GpuSettings { keep, ..Default::default() };
                let images = rasteriser.render_after(stage, &frame, &on_card, &scene, &views, &how).unwrap();
                for (expected, found) in expected.iter().zip(&images.read().unwrap()) {
                    images_agree(expected, found);
                }
                let error = rasteriser.gradients(&on_card, &frame.blank_images()).unwrap_err().to_string();
                assert!(error.states("CPU"), "{error}");
            }
        }
    }
}

#[test]
fn what_moves_is_put_before_a_backdrop_as_on_the_cpu() {
    let (still, moving) = (workload_cloud(2000, 0, 0), workload::cloud(300, 0, 2));
    let (scene, objects) = (Scene::still(&still), Scene::still(&moving));
    let views = views_of(3, 90, 60);
    for depth in [false, true] {
        let settings = Settings { outputs: Outputs { depth, ..Default::default() }, ..SETTINGS_PLAIN };
        let behind = Frame::new(&scene, &views, &settings).unwrap().images();
        let mut expected = Frame::new(&objects, &views, &settings).unwrap().images();
        for (front, back) in expected.iter_mut().zip(&behind) {
            compose(front, back).unwrap();
        }
        for rasteriser in rasterisers().iter_mut() {
            let (ground, group) = [&scene, &objects].map(|scene| GpuCloud::new(&rasteriser.gpu, scene).unwrap()).into();
            for bytes in [false, true] {
                let how = GpuSettings { bytes, ..Default::default() };
                rasteriser.render(&ground, &scene, &views, &settings, &how).unwrap();
                let backdrop = rasteriser.backdrop().unwrap();
                rasteriser.render(&group, &objects, &views, &settings, &how).unwrap();
                rasteriser.compose(&backdrop, false).unwrap();
                let found = rasteriser.images().unwrap().read().unwrap();
                for (expected, found) in expected.iter().zip(&found) {
                    let n = expected.alpha.len() / 200;
                    let off = differ(&expected.colour, &found.colour, 3 * n);
                    assert!(off < if bytes { 6e-3 } else { 1e-4 }, "{off}");
                    assert!(differ(&expected.depth, &found.depth, n) < if bytes { 2e-2 } else { 1e-4 });
                }
                rasteriser.render(&group, &objects, &views[..2], &settings, &how).unwrap();
                assert!(rasteriser.compose(&backdrop, false).unwrap_err().to_string().states("views"));
            }
        }
    }
}

#[test]
fn moving_groups_are_where_the_cpu_sees_them() {
    let cloud = workload_cloud(1200, 1, 0);
    let group_of: Vec<u32> = (0..1200).map(|i| if i % 5 == 0 { 1 + i / 5 % 2 } else { 0 }).collect();
    let pose = |x: f64| Pose::from_position_wxyz([x, 0.3, 0.2], [0.9, 0.1, 0.0, x]);
    let environments = [vec![pose(0.5), None], vec![pose(-0.4), pose(1.0)]];
    let scene = Scene { cloud: &cloud, group_of: &group_of, environments: &environments };
    let mut views = views_of(4, 90, 60);
    views[1].environment = 1;
    views[3].environment = 1;
    let settings = Settings { outputs: Outputs { features: false, ..Outputs::ALL }, ..SETTINGS };
    let expected = Frame::new(&scene, &views, &settings).unwrap().images();
    for rasteriser in rasterisers().iter_mut() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let how = GpuSettings::default();
        let (images, _) = rasteriser.render(&on_card, &scene, &views, &settings, &how).unwrap();
        for (expected, found) in expected.iter().zip(&images.read().unwrap()) {
            images_agree(expected, found);
        }
        let alone = Scene { environments: &environments[1..], ..scene };
        let view = View { environment: 0, ..views[1] };
        let together = images.read().unwrap().swap_remove(1);
        let (images, _) = rasteriser.render(&on_card, &alone, &[view], &settings, &how).unwrap();
        assert_eq!(images.read().unwrap()[0], together);
    }
}

#[test]
fn batches_are_split_to_fit_memory() {
    let cloud = workload_cloud(4000, 0, 0);
    let scene = Scene::still(&cloud);
    let views = views_of(29, 64, 48);
    for mut rasteriser in new_rasterisers() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let how = GpuSettings::default();
        let whole = rasteriser.render(&on_card, &scene, &views, &SETTINGS_PLAIN, &how).unwrap().0.read().unwrap();
        let needed = rasteriser.bytes();
        let mut split = GpuRasteriser::new(rasteriser.gpu);
        split.memory = needed / 2;
        let error = split.render(&on_card, &scene, &views, &SETTINGS_PLAIN, &how).unwrap_err();
        assert!(matches!(error, RasterError::TooLarge { limit, .. } if limit == needed / 2), "{error}");
        let (mut images, mut batches) = (vec![], 0);
        let each = |first: usize, found: qv_raster::gpu::GpuImages, counts: qv_raster::gpu::Counts| {
            assert_eq!((first, counts.faulty), (images.len(), 0));
            images.extend(found.read()?);
            batches += 1;
            Ok(())
        };
        split.render_all(&on_card, &scene, &views, &SETTINGS_PLAIN, &how, each).unwrap();
        assert!(batches > 1 && images == whole);
        split.memory = 1000;
        assert!(split.render_all(&on_card, &scene, &views, &SETTINGS_PLAIN, &how, |_, _, _| Ok(())).is_err());
    }
}

#[test]
fn many_sizes_are_drawn_like_on_the_cpu() {
    for rasteriser in rasterisers().iter_mut() {
        for count in [1, 31, 255, 257, 4097] {
            let cloud = workload_cloud(count, 0, 0);
            let scene = Scene::still(&cloud);
            let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
            for (views, width, height) in [(1, 1, 1), (3, 33, 17), (17, 16, 32), (2, 200, 130)] {
                let views = views_of(views, width, height);
                let how = GpuSettings { bytes: count % 2 == 0, ..Default::default() };
                let cpu = Frame::new(&scene, &views, &SETTINGS_PLAIN).unwrap();
                let (images, counts) = rasteriser.render(&on_card, &scene, &views, &SETTINGS_PLAIN, &how).unwrap();
                assert_eq!(counts.candidates, cpu.candidates.len());
                assert!(counts.entries.abs_diff(cpu.entries.tiles.len()) <= 1 + counts.entries / 1000);
                for (expected, found) in cpu.images().iter().zip(&images.read().unwrap()) {
                    images_agree(expected, found);
                }
            }
        }
    }
}

#[test]
fn four_thousand_and_ninety_six_views_are_one_batch_and_one_more_is_refused() {
    let cloud = workload_cloud(64, 0, 0);
    let scene = Scene::still(&cloud);
    let mut views = views_of(4096, 8, 8);
    for rasteriser in rasterisers().iter_mut() {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene).unwrap();
        let how = GpuSettings::default();
        let (images, _) = rasteriser.render(&on_card, &scene, &views, &SETTINGS_PLAIN, &how).unwrap();
        let images = images.read().unwrap();
        assert_eq!(images.len(), 4096);
        let last = Frame::new(&scene, &views[4095..], &SETTINGS_PLAIN).unwrap().images();
        images_agree(&last[0], &images[4095]);
        views.push(views[0]);
        let error = rasteriser.render(&on_card, &scene, &views, &SETTINGS_PLAIN, &how).unwrap_err();
        assert!(matches!(error, RasterError::TooLarge { limit: 4096, found: 4097, .. }), "{error}");
        views.pop();
    }
}

#[test]
fn an_adapter_that_is_not_there_is_named() {
    let asked = |adapter| Gpu::new(&GpuOptions { adapter: Some(adapter), ..Default::default() });
    let said = asked(4096).err().unwrap().to_string();
    assert!(said.states("adapter 4096 0") && said.contains("adapters:"), "{said}");
    match asked(0) {
        Ok(gpu) => assert!(!gpu.info.name.is_empty()),
        Err(error) => skipped(error),
    }
}
