//! Moving groups, threads, odd numbers, nothing, and bad requests, on the CPU.

use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Frame, Image, Outputs, RasterError, Scene, Settings, View, render, workload};

const SETTINGS: Settings = Settings { outputs: Outputs::ALL, background: [0.1, 0.2, 0.3], antialias: false };

fn camera(width: u32, height: u32) -> Camera {
    let (w, h) = (width as f64, height as f64);
    Camera { fx: w, fy: w, cx: w / 2.0, cy: h / 2.0, width, height, camera_from_world: Pose::IDENTITY }
}

fn ball(at: [f32; 3]) -> GaussianCloud {
    GaussianCloud {
        means: vec![at],
        log_scales: vec![[-2.0, -2.5, -1.7]],
        rotations: vec![[0.9, 0.1, -0.3, 0.2]],
        opacity_logits: vec![3.0],
        sh_degree: 1,
        sh: vec![[0.5, 0.1, -0.2], [0.1, 0.0, 0.3], [0.0, 0.4, -0.1], [-0.2, 0.1, 0.2]],
        ..Default::default()
    }
}

fn joined(parts: &[&GaussianCloud]) -> GaussianCloud {
    let mut out = GaussianCloud { sh_degree: 1, ..Default::default() };
    for part in parts {
        out.means.extend(&part.means);
        out.log_scales.extend(&part.log_scales);
        out.rotations.extend(&part.rotations);
        out.opacity_logits.extend(&part.opacity_logits);
        out.sh.extend(&part.sh);
    }
    out
}

fn shift(x: f64) -> Option<Pose> {
    Pose::from_position_wxyz([x, 0.0, 2.0], [0.8, 0.0, 0.6, 0.0])
}

#[test]
fn environments_share_a_cloud_and_do_not_see_each_others_moving_objects() {
    // One that stays, and two movers about their own origins.
    let cloud = joined(&[&ball([0.0, 0.3, 3.0]), &ball([0.1, 0.0, 0.0]), &ball([0.0, 0.1, 0.0])]);
    let environments = [vec![shift(-0.4), None], vec![shift(0.5), shift(0.0)], vec![None, None]];
    let scene = Scene { cloud: &cloud, group_of: &[0, 1, 2], environments: &environments };
    let views: Vec<View> = (0..3).map(|environment| View { camera: camera(48, 36), environment }).collect();
    let together = Frame::new(&scene, &views, &SETTINGS).unwrap().images();
    for (environment, poses) in environments.iter().enumerate() {
        let alone = Scene { environments: std::slice::from_ref(poses), ..scene };
        let image = &Frame::new(&alone, &[View::of(camera(48, 36))], &SETTINGS).unwrap().images()[0];
        assert_eq!(image, &together[environment]);
    }
    let still = ball([0.0, 0.3, 3.0]);
    let empty = Frame::new(&Scene::still(&still), &views[..1], &SETTINGS).unwrap().images();
    assert_eq!(together[2], empty[0]);
    assert_ne!(together[0], together[1]);
}

#[test]
fn a_moved_group_is_seen_as_from_a_camera_that_moved_the_other_way() {
    let cloud = ball([0.1, -0.05, 0.2]);
    let environments = [vec![shift(0.2)]];
    let scene = Scene { cloud: &cloud, group_of: &[1], environments: &environments };
    let moved = Frame::new(&scene, &[View::of(camera(48, 36))], &SETTINGS).unwrap().images();
    let other = Camera { camera_from_world: shift(0.2).unwrap(), ..camera(48, 36) };
    let still = Frame::new(&Scene::still(&cloud), &[View::of(other)], &SETTINGS).unwrap().images();
    assert_eq!(moved, still);
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let cloud = workload::cloud(3000, 1, 1);
    let scene = Scene::still(&cloud);
    let views: Vec<View> = workload::cameras(3, 1, 100, 70).into_iter().map(View::of).collect();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let frame = Frame::new(&scene, &views, &SETTINGS).unwrap();
            let mut by_images = frame.blank_images();
            for image in &mut by_images {
                image.colour.iter_mut().enumerate().for_each(|(i, x)| *x = (i as f32).sin());
                image.depth.fill(0.1);
                image.normal.fill(-0.2);
            }
            (frame.images(), frame.gradients(&scene, &by_images).unwrap(), render(&scene, &views, &SETTINGS).unwrap().0)
        })
    };
    let one = on(1);
    let three = on(3);
    assert!(one == three, "images or derivatives depend on the number of threads");
    assert_eq!(one.0, one.2, "a batch and view by view");
}

/// Makes a Gaussian's numbers odd.
type Oddity = fn(&mut GaussianCloud, usize);

/// Each way in which the numbers of a Gaussian may be odd.
fn oddities() -> Vec<(&'static str, Oddity)> {
    vec![
        ("NaN mean", |c, i| c.means[i][0] = f32::NAN),
        ("infinite mean", |c, i| c.means[i][2] = f32::INFINITY),
        ("infinite scale", |c, i| c.log_scales[i][1] = f32::INFINITY),
        ("huge scale", |c, i| c.log_scales[i] = [80.0; 3]),
        ("NaN scale", |c, i| c.log_scales[i][0] = f32::NAN),
        ("no rotation", |c, i| c.rotations[i] = [0.0; 4]),
        ("denormal rotation", |c, i| c.rotations[i] = [f32::from_bits(3); 4]),
        ("NaN rotation", |c, i| c.rotations[i][3] = f32::NAN),
        ("NaN opacity", |c, i| c.opacity_logits[i] = f32::NAN),
        ("infinite colour", |c, i| c.sh[4 * i][0] = f32::NEG_INFINITY),
        ("NaN harmonic", |c, i| c.sh[4 * i + 3][1] = f32::NAN),
    ]
}

#[test]
fn odd_numbers_poison_their_own_gaussian_only() {
    let good = [&ball([0.1, 0.0, 2.0]), &ball([-0.1, 0.1, 2.5])];
    let expected = Frame::new(&Scene::still(&joined(&good)), &[View::of(camera(40, 30))], &SETTINGS).unwrap();
    for (name, change) in oddities() {
        let mut cloud = joined(&[good[0], good[1], &ball([0.0, 0.05, 1.5])]);
        change(&mut cloud, 2);
        let scene = Scene::still(&cloud);
        let frame = Frame::new(&scene, &[View::of(camera(40, 30))], &SETTINGS).unwrap();
        assert_eq!(frame.images(), expected.images(), "{name}");
        assert_eq!(frame.projections.faulty, 1, "{name}");
        let mut by_images = frame.blank_images();
        by_images[0].colour.fill(1.0);
        by_images[0].plane_depth.fill(1.0);
        let gradients = frame.gradients(&scene, &by_images).unwrap();
        assert_eq!(gradients.means[2], [0.0; 3], "{name}");
        let all = gradients.means.iter().chain(&gradients.log_scales).chain(&gradients.sh).flatten();
        assert!(all.chain(gradients.poses.as_flattened()).all(|x| x.is_finite()), "{name}");
    }
}

#[test]
fn denormals_and_extremes_are_drawn_or_not_but_spoil_nothing() {
    for log_scale in [f32::from_bits(1), -100.0, -1e30, f32::NEG_INFINITY, 8.0] {
        for logit in [f32::from_bits(1), 100.0, -100.0, f32::INFINITY, f32::NEG_INFINITY] {
            let mut cloud = ball([0.0, 0.0, 2.0]);
            cloud.log_scales[0] = [log_scale; 3];
            cloud.opacity_logits[0] = logit;
            let scene = Scene::still(&cloud);
            let frame = Frame::new(&scene, &[View::of(camera(20, 20))], &SETTINGS).unwrap();
            let image = &frame.images()[0];
            assert!(image.colour.iter().chain(&image.depth).chain(&image.plane_depth).all(|x| x.is_finite()));
            assert_eq!(frame.projections.faulty, 0, "{log_scale} {logit}");
            if logit == 100.0 && log_scale == 8.0 {
                assert!(image.alpha.iter().all(|&alpha| alpha == qv_raster::constants::MAX_ALPHA));
            }
            let mut by_images = frame.blank_images();
            by_images[0].colour.fill(1.0);
            let gradients = frame.gradients(&scene, &by_images).unwrap();
            assert!(gradients.means[0].iter().chain(&gradients.log_scales[0]).all(|x| x.is_finite()));
        }
    }
}

#[test]
fn nothing_is_background() {
    let cloud = GaussianCloud::default();
    let (images, faulty) = render(&Scene::still(&cloud), &[View::of(camera(17, 5))], &SETTINGS).unwrap();
    assert_eq!(faulty, 0);
    assert!(images[0].colour.chunks(3).all(|pixel| pixel == SETTINGS.background));
    assert!(images[0].alpha.iter().chain(&images[0].plane_depth).all(|&x| x == 0.0));
    assert_eq!(images[0].colour_u8()[..3], [26, 51, 77]);
    assert!(render(&Scene::still(&cloud), &[], &SETTINGS).unwrap().0.is_empty());
}

#[test]
fn bad_requests_are_named() {
    let cloud = ball([0.0, 0.0, 2.0]);
    let scene = Scene::still(&cloud);
    let says = |scene: &Scene, view: View| Frame::new(scene, &[view], &SETTINGS).unwrap_err().to_string();
    let good = View::of(camera(20, 20));
    let bad = View::of(Camera { fx: 0.0, ..camera(20, 20) });
    assert_eq!(says(&scene, bad), "view 0: camera fx: expected 0.001 to 10 000 000 pixels, found 0");
    let elsewhere = View { environment: 3, ..good };
    assert_eq!(says(&scene, elsewhere), "environment of view 0: expected an index below 1, found 3");
    let groups = Scene { group_of: &[1], ..scene };
    assert_eq!(says(&groups, good), "group of Gaussian 0: expected an index below 1, found 1");
    let short = Scene { group_of: &[0, 0], ..scene };
    assert_eq!(says(&short, good), "group of each Gaussian: expected length 1, found 2");
    let mut torn = cloud.clone();
    torn.sh.pop();
    let torn = says(&Scene::still(&torn), good);
    assert_eq!(torn, "cloud: spherical harmonics of a cloud: expected length 4, found 3");
    let many = vec![good; 4097];
    let error = Frame::new(&scene, &many, &SETTINGS).unwrap_err();
    assert!(matches!(error, RasterError::TooLarge { limit: 4096, found: 4097, .. }));
    let frame = Frame::new(&scene, &[good], &SETTINGS).unwrap();
    let error = frame.gradients(&scene, &[Image::default()]).unwrap_err().to_string();
    assert_eq!(error, "derivatives by colour of view 0: expected length 1200, found 0");
    let two = joined(&[&cloud, &cloud]);
    let error = frame.gradients(&Scene::still(&two), &frame.blank_images()).unwrap_err().to_string();
    assert_eq!(error, "Gaussians that were drawn: expected length 1, found 2");
    let lost = View::of(Camera { cx: 1e10, fx: 1e-300, ..camera(20, 20) });
    assert!(says(&scene, lost).starts_with("view 0: camera fx"));
}

#[test]
fn centres_whose_square_overflows_are_left_out_and_counted() {
    for mean in [[0.0, 0.0, 3e19], [3.4e38, 3.4e38, -3.3e38], [2e19, 0.0, 1.0]] {
        let cloud = ball(mean);
        let scene = Scene::still(&cloud);
        let wide = Camera { fx: 1e-3, fy: 1e-3, ..camera(20, 20) };
        let frame = Frame::new(&scene, &[View::of(wide)], &SETTINGS).unwrap();
        assert!(frame.candidates.is_empty() || frame.projections.faulty == 1, "{mean:?}");
        assert!(frame.images()[0].alpha.iter().all(|&alpha| alpha == 0.0), "{mean:?}");
    }
}

#[test]
fn features_that_are_not_drawn_matter_to_nobody() {
    let mut cloud = ball([0.0, 0.0, 2.0]);
    (cloud.feature_count, cloud.features) = (1, vec![f32::NAN]);
    let scene = Scene::still(&cloud);
    let plain = Settings { outputs: Default::default(), ..SETTINGS };
    let faulty = |settings| render(&scene, &[View::of(camera(20, 20))], settings).unwrap().1;
    assert_eq!((faulty(&plain), faulty(&SETTINGS)), (0, 1));
}
