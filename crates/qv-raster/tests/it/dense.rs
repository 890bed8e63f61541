//! Images and derivatives against a dense renderer in double precision.

use crate::reference::{Parameters, decide, outputs, sums, twisted};
use glam::{DQuat, DVec3};
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Frame, Gradients, Image, Outputs, Scene, Settings, View};

const BACKGROUND: [f32; 3] = [0.2, 0.5, 0.1];

/// Uniform numbers in [-1, 1) from a linear congruence.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

fn camera(width: u32, height: u32) -> Camera {
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, -0.2, 0.05);
    let camera_from_world = Pose { position: DVec3::new(0.1, -0.05, 0.3), rotation };
    Camera {
        fx: 0.8 * width as f64,
        fy: 0.85 * width as f64,
        cx: 0.52 * width as f64,
        cy: 0.47 * height as f64,
        width,
        height,
        camera_from_world,
    }
}

/// Gaussians 1 m to 4 m before the camera.
fn crowd(count: usize, degree: u8, features: usize, seed: u64) -> GaussianCloud {
    let mut r = Random(seed);
    let mut cloud = GaussianCloud { sh_degree: degree, feature_count: features, ..Default::default() };
    for _ in 0..count {
        let depth = 2.5 + 1.5 * r.next();
        cloud.means.push([0.7 * depth * r.next(), 0.6 * depth * r.next(), depth]);
        cloud.log_scales.push([0; 3].map(|_| -2.6 + 0.9 * r.next()));
        cloud.rotations.push([0; 4].map(|_| 1.5 * r.next()));
        cloud.opacity_logits.push(0.5 + 2.5 * r.next());
        for k in 0..cloud.sh_count() {
            cloud.sh.push([0; 3].map(|_| if k == 0 { 1.5 * r.next() } else { 0.3 * r.next() }));
        }
        cloud.features.extend((0..features).map(|_| r.next()));
    }
    cloud
}

/// A crowd in which some are edge-on, tiny, huge, behind the camera, opaque, overlapping, or far beside the image.
fn odd_crowd(degree: u8, features: usize) -> GaussianCloud {
    let mut cloud = crowd(22, degree, features, 7);
    let inverse = camera(40, 30).camera_from_world.inverse();
    let at = |x: f64, y: f64, z: f64| inverse.transform_point(DVec3::new(x, y, z)).as_vec3().to_array();
    cloud.means[0] = at(0.1, 0.05, 1.5);
    let edge_on = (inverse.rotation * DQuat::from_rotation_y(1.55)).normalize();
    cloud.rotations[0] = [edge_on.w, edge_on.x, edge_on.y, edge_on.z].map(|x| x as f32);
    cloud.log_scales[0] = [-1.5, -1.7, -9.0];
    cloud.means[1] = at(-0.2, 0.1, 1.2);
    cloud.log_scales[1] = [-11.0, -12.0, -11.5];
    cloud.means[2] = at(1.0, -3.0, 9.0);
    cloud.log_scales[2] = [2.0, 2.5, 1.8];
    cloud.means[3] = at(0.1, 0.1, -2.0);
    cloud.log_scales[3] = [0.0; 3];
    cloud.opacity_logits[4] = 12.0;
    cloud.means[4] = at(-0.5, -0.3, 1.8);
    cloud.log_scales[4] = [-2.0, -2.2, -2.4];
    for copy in 6..9 {
        cloud.means[copy] = cloud.means[5];
    }
    cloud.means[9] = at(2.9, 0.3, 1.6);
    cloud.log_scales[9] = [-0.4, -0.8, -0.6];
    cloud.opacity_logits[9] = 3.0;
    cloud.means[10] = at(0.3, 0.25, 0.05);
    cloud.log_scales[10] = [-4.0, -4.5, -4.2];
    cloud
}

/// Gaussians a hundred and more pixels long and a pixel or two wide, across an image of 40 x 30.
fn needles() -> GaussianCloud {
    let mut cloud = crowd(4, 1, 2, 13);
    let inverse = camera(40, 30).camera_from_world.inverse();
    let at = |x: f64, y: f64, z: f64| inverse.transform_point(DVec3::new(x, y, z)).as_vec3().to_array();
    let pixels = |n: f32| (n * 1.5 / 32.0).ln();
    for (k, (long, wide)) in [(100.0, 0.01), (100.0, 2.0), (300.0, 2.0), (30.0, 0.01)].into_iter().enumerate() {
        cloud.means[k] = at(0.02 * k as f64 - 0.03, 0.05 - 0.03 * k as f64, 1.5 + 0.1 * k as f64);
        cloud.log_scales[k] = [pixels(long), pixels(wide), pixels(wide) - 1.0];
        cloud.rotations[k] = [0.92, 0.02, -0.03, 0.3 + 0.2 * k as f32];
        cloud.opacity_logits[k] = 0.5;
    }
    cloud
}

fn settings(antialias: bool) -> Settings {
    Settings { outputs: Outputs::ALL, background: BACKGROUND, antialias }
}

/// Outputs of a pixel in the order of the reference.
fn pixel_of(image: &Image, pixel: usize) -> Vec<f32> {
    let k = image.features.len() / image.alpha.len();
    let mut out = image.colour[3 * pixel..3 * pixel + 3].to_vec();
    out.extend([image.alpha[pixel], image.depth[pixel], image.plane_depth[pixel]]);
    out.extend(&image.normal[3 * pixel..3 * pixel + 3]);
    out.extend(&image.features[k * pixel..k * (pixel + 1)]);
    out
}

fn compare(name: &str, cloud: &GaussianCloud, camera: &Camera, antialias: bool) {
    let frame = Frame::new(&Scene::still(cloud), &[View::of(*camera)], &settings(antialias)).unwrap();
    let image = &frame.images()[0];
    let parameters = Parameters::of(cloud, antialias);
    let dense = decide(&parameters, camera);
    let expected = outputs(&sums(&parameters, camera, &dense.taken), camera, BACKGROUND.map(|c| c as f64));
    let (mut flips, mut worst, mut bias, mut flipped) = (0, 0.0f64, 0.0, 0.0f64);
    for pixel in 0..camera.pixels() {
        let found = pixel_of(image, pixel);
        let error = expected[pixel].iter().zip(&found).enumerate().map(|(k, (e, f))| {
            // Plane depth is a quotient that may be as large as it likes: relative, and not where it is ill-conditioned.
            let scale = if k == 5 { e.abs().max(1.0).powi(2) } else { e.abs().max(1.0) };
            (*f as f64 - e) / scale
        });
        let error: Vec<f64> = error.collect();
        let largest = error.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        bias += error[0] + error[1] + error[2];
        if dense.close[pixel] && largest > 1e-5 {
            flips += 1;
            flipped = flipped.max(error[..4].iter().fold(0.0f64, |a, b| a.max(b.abs())));
        } else {
            worst = worst.max(largest);
        }
    }
    bias /= (3 * camera.pixels()) as f64;
    println!(
        "{name}: interior {worst:.1e}, {flips} flips of {}, at most {flipped:.1e}, bias {bias:.1e}",
        camera.pixels()
    );
    assert!(worst < 1e-5, "{name}: interior error {worst}");
    assert!(flips <= camera.pixels() / 200, "{name}: {flips} flips");
    assert!(flipped < 0.01, "{name}: a flip of {flipped}");
    assert!(bias.abs() < 1e-6, "{name}: bias {bias}");
}

#[test]
fn images_are_those_of_the_dense_renderer() {
    for antialias in [false, true] {
        compare("crowd", &crowd(150, 3, 4, 1), &camera(67, 50), antialias);
        compare("dense crowd", &crowd(600, 1, 0, 2), &camera(40, 30), antialias);
        compare("odd", &odd_crowd(2, 16), &camera(40, 30), antialias);
        compare("one pixel", &crowd(50, 0, 0, 3), &camera(1, 1), antialias);
    }
}

fn gradients_of(cloud: &GaussianCloud, camera: &Camera, weights: &[Vec<f64>], antialias: bool) -> Gradients {
    let scene = Scene::still(cloud);
    let frame = Frame::new(&scene, &[View::of(*camera)], &settings(antialias)).unwrap();
    let mut by_image = frame.blank_images();
    let image = &mut by_image[0];
    for (pixel, weight) in weights.iter().enumerate() {
        let weight: Vec<f32> = weight.iter().map(|&w| w as f32).collect();
        image.colour[3 * pixel..3 * pixel + 3].copy_from_slice(&weight[..3]);
        image.alpha[pixel] = weight[3];
        image.depth[pixel] = weight[4];
        image.plane_depth[pixel] = weight[5];
        image.normal[3 * pixel..3 * pixel + 3].copy_from_slice(&weight[6..9]);
        let k = weight.len() - 9;
        image.features[k * pixel..k * (pixel + 1)].copy_from_slice(&weight[9..]);
    }
    frame.gradients(&scene, &by_image).unwrap()
}

/// Derivatives by central differences, parameters first, then the pose.
fn differences(parameters: &Parameters, camera: &Camera, weights: &[Vec<f64>]) -> (Vec<f64>, [f64; 6]) {
    let dense = decide(parameters, camera);
    let background = BACKGROUND.map(|c| c as f64);
    let loss = |parameters: &Parameters, camera: &Camera| -> f64 {
        let out = outputs(&sums(parameters, camera, &dense.taken), camera, background);
        out.iter().zip(weights).flat_map(|(o, w)| o.iter().zip(w)).map(|(o, w)| o * w).sum()
    };
    let h = 1e-6;
    let by_parameter = |k: usize| {
        let mut moved = parameters.clone();
        moved.values[k] += h;
        let plus = loss(&moved, camera);
        moved.values[k] -= 2.0 * h;
        (plus - loss(&moved, camera)) / (2.0 * h)
    };
    let by_twist = |k: usize| {
        let twist = |h: f64| std::array::from_fn(|i| if i == k { h } else { 0.0 });
        (loss(parameters, &twisted(camera, twist(h))) - loss(parameters, &twisted(camera, twist(-h)))) / (2.0 * h)
    };
    ((0..parameters.values.len()).map(by_parameter).collect(), std::array::from_fn(by_twist))
}

/// Weights of a loss in which only some outputs count; none where a decision is close, or where plane depth is ill-conditioned.
fn weights(parameters: &Parameters, camera: &Camera, wanted: std::ops::Range<usize>) -> Vec<Vec<f64>> {
    let dense = decide(parameters, camera);
    let sums = sums(parameters, camera, &dense.taken);
    let out = outputs(&sums, camera, [0.0; 3]);
    let mut r = Random(99);
    let weight = |(pixel, out): (usize, &Vec<f64>)| {
        let mut weight: Vec<f64> = out.iter().map(|_| r.next() as f64).collect();
        for (k, w) in weight.iter_mut().enumerate() {
            let shaky = k == 5 && (out[5] > 10.0 || out[3] < 0.1);
            if dense.close[pixel] || !wanted.contains(&k) || shaky {
                *w = 0.0;
            }
        }
        weight
    };
    out.iter().enumerate().map(weight).collect()
}

fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    if dot(a, a) == 0.0 && dot(b, b) == 0.0 { 1.0 } else { dot(a, b) / (dot(a, a) * dot(b, b)).sqrt() }
}

/// What was found, Gaussian by Gaussian in the order of the reference.
fn flat(cloud: &GaussianCloud, g: &Gradients) -> Vec<f64> {
    let (n, k) = (cloud.sh_count(), cloud.feature_count);
    let mut out: Vec<f32> = vec![];
    for i in 0..cloud.len() {
        out.extend(g.means[i]);
        out.extend(g.log_scales[i]);
        out.extend(g.rotations[i]);
        out.push(g.opacity_logits[i]);
        out.extend(g.sh[i * n..(i + 1) * n].iter().flatten());
        out.extend(&g.features[i * k..(i + 1) * k]);
    }
    out.iter().map(|&x| x as f64).collect()
}

fn check_gradients(
    name: &str,
    cloud: &GaussianCloud,
    camera: &Camera,
    wanted: std::ops::Range<usize>,
    antialias: bool,
) {
    let parameters = Parameters::of(cloud, antialias);
    let weights = weights(&parameters, camera, wanted);
    let found = gradients_of(cloud, camera, &weights, antialias);
    let (expected, pose) = differences(&parameters, camera, &weights);
    let values = flat(cloud, &found);
    let stride = parameters.stride();
    let sh = 11..stride - cloud.feature_count;
    let kinds = [
        ("mean", 0..3),
        ("scale", 3..6),
        ("rotation", 6..10),
        ("opacity", 10..11),
        ("sh", sh.clone()),
        ("feature", sh.end..stride),
    ];
    let mut shown = vec![];
    for (kind, range) in kinds {
        let pick = |all: &[f64]| -> Vec<f64> {
            all.chunks(stride).flat_map(|gaussian| gaussian[range.clone()].to_vec()).collect()
        };
        let (e, f) = (pick(&expected), pick(&values));
        let largest = e.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let whole = cosine(&e, &f);
        shown.push(format!("{kind} {:.1e}", 1.0 - whole));
        assert!(whole > 0.9999, "{name}: {kind}: cosine {whole}");
        // Each Gaussian by itself, unless it hardly matters.
        for (i, (e, f)) in e.chunks(range.len().max(1)).zip(f.chunks(range.len().max(1))).enumerate() {
            if e.iter().any(|x| x.abs() > 1e-4 * largest) {
                assert!(cosine(e, f) > 0.999, "{name}: {kind} of {i}: {e:?} {f:?}");
                let (le, lf) = (length(e), length(f));
                assert!((le / lf - 1.0).abs() < 0.01, "{name}: {kind} of {i}: {e:?} {f:?}");
            }
        }
    }
    let found_pose = found.poses[0].map(|x| x as f64);
    shown.push(format!("pose {:.1e}", 1.0 - cosine(&pose, &found_pose)));
    println!("{name}: 1 - cosine: {}", shown.join(", "));
    assert!(cosine(&pose, &found_pose) > 0.9999, "{name}: pose {pose:?} {found_pose:?}");
    assert!((length(&pose) / length(&found_pose) - 1.0).abs() < 1e-3, "{name}: {pose:?} {found_pose:?}");
}

fn length(a: &[f64]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[test]
fn gradients_are_those_of_finite_differences() {
    let camera = camera(40, 30);
    let cloud = odd_crowd(2, 3);
    for (name, wanted) in [
        ("colour", 0..3),
        ("alpha", 3..4),
        ("depth", 4..5),
        ("plane depth", 5..6),
        ("normal", 6..9),
        ("features", 9..12),
    ] {
        check_gradients(name, &cloud, &camera, wanted, false);
    }
    for antialias in [false, true] {
        check_gradients("needles", &needles(), &camera, 0..4, antialias);
        check_gradients("all", &crowd(40, 3, 2, 11), &camera, 0..11, antialias);
    }
    check_gradients("antialias", &cloud, &camera, 0..4, true);
    // Fine ones, of a tenth of a pixel to one, where most of the opacity is made up for.
    let mut fine = crowd(60, 1, 2, 12);
    fine.log_scales.iter_mut().flatten().for_each(|scale| *scale -= 1.5);
    fine.opacity_logits.iter_mut().for_each(|logit| *logit += 2.0);
    check_gradients("fine", &fine, &camera, 0..4, true);
}

/// Mean of squares of `by` x `by` pixels.
fn averaged(image: &Image, by: usize) -> Vec<f32> {
    let (width, height) = (image.width / by, image.height / by);
    let mut out = vec![0.0; 3 * width * height];
    for (at, colour) in image.colour.iter().enumerate() {
        let (x, y) = (at / 3 % image.width / by, at / 3 / image.width / by);
        out[3 * (y * width + x) + at % 3] += colour / (by * by) as f32;
    }
    out
}

#[test]
fn a_small_image_is_the_average_of_a_large_one() {
    // The figure that docs/theory/rasteriser.md gives, with a tenth of the Gaussians.
    let cloud = qv_raster::workload::cloud(30_000, 0, 1);
    let large = qv_raster::workload::cameras(1, 1, 640, 480)[0];
    let small = qv_raster::workload::cameras(1, 1, 80, 60)[0];
    let psnr = [false, true].map(|antialias| {
        let settings = Settings { outputs: Outputs::default(), ..settings(antialias) };
        let draw = |camera: Camera| {
            let (mut images, _) = qv_raster::render(&Scene::still(&cloud), &[View::of(camera)], &settings).unwrap();
            images.remove(0)
        };
        let (wanted, found) = (averaged(&draw(large), 8), draw(small).colour);
        let square: f32 = wanted.iter().zip(&found).map(|(a, b)| (a - b).powi(2)).sum();
        -10.0 * (square / wanted.len() as f32).log10()
    });
    println!("without {:.2} dB, with {:.2} dB", psnr[0], psnr[1]);
    assert!(psnr[1] > psnr[0] + 3.0, "{psnr:?}");
}
