//! Derivatives against differences, and what each term does to a scene that is made for it: a patterned wall, of which the Gaussians begin
//! as balls beside it.

use super::*;
use crate::train::random::{Purpose, unit, words};
use crate::train::{CpuEngine, Dataset, Model, TrainOptions, Weights, tiny, train};
use qv_core::GaussianCloud;
use qv_raster::{Image, Outputs, Scene, Settings, View, render};

const SIDE: u32 = 48;

fn drawn(cloud: &GaussianCloud, camera: &Camera) -> Image {
    let settings = Settings { outputs: Outputs::ALL, ..Default::default() };
    render(&Scene::still(cloud), &[View::of(*camera)], &settings).unwrap().0.remove(0)
}

/// Photographs of the wall, from the pattern and the geometry themselves, with true depths, and labels by left and right.
fn wall() -> Dataset {
    let cameras = tiny::before_the_wall(SIDE);
    let one = |(k, camera): (usize, &Camera)| {
        let places: Vec<Vec3> = (0..camera.pixels()).map(|pixel| place(camera, pixel)).collect();
        let inside = |p: &Vec3| p.x.abs() < 1.15 && p.z.abs() < 1.15;
        let depth = |p: &Vec3| camera.camera_from_world.transform_point(p.as_dvec3()).z as f32;
        let image = Image {
            width: camera.width as usize,
            height: camera.height as usize,
            colour: places.iter().flat_map(|p| if inside(p) { pattern(p) } else { [0.0; 3] }).collect(),
            depth: places.iter().map(|p| if inside(p) { depth(p) } else { 0.0 }).collect(),
            ..Default::default()
        };
        let mut photograph = tiny::of_image(&image, camera, &format!("v{k}"));
        photograph.labels = places.iter().map(|p| 1 + (p.x > 0.0) as u8).collect();
        photograph
    };
    let dataset = Dataset::of_photographs(cameras.iter().enumerate().map(one).collect(), 0).unwrap();
    Dataset { background: [0.0; 3], ..dataset }
}

/// Colour of the wall at a place: waves that no pixel is too coarse for.
fn pattern(p: &Vec3) -> [f32; 3] {
    [0.0f32, 1.3, 2.9].map(|c| {
        let bent = 14.0 * p.x + 3.0 * (6.0 * p.z + c).sin() + c;
        0.5 + 0.22 * bent.sin() + 0.22 * (12.0 * p.z + 2.0 * (7.0 * p.x - c).sin()).cos()
    })
}

/// The point of the wall that a pixel shows.
fn place(camera: &Camera, pixel: usize) -> Vec3 {
    let world = camera.camera_from_world.inverse();
    let ray = world.transform_vector(ray(camera, pixel).as_dvec3());
    (world.position - ray * (world.position.y / ray.y)).as_vec3()
}

/// Balls beside the wall.
fn beside() -> GaussianCloud {
    let mut cloud = tiny::wall();
    for i in 0..cloud.len() {
        cloud.means[i][1] = 0.24 * (unit(words(8, 0, i as u32, Purpose::Start)[0]) - 0.5);
        cloud.log_scales[i] = [-3.0, -3.1, -3.05];
        cloud.rotations[i] = words(8, 1, i as u32, Purpose::Start).map(|word| unit(word) - 0.5);
        cloud.sh[i] = [0.0; 3];
    }
    cloud
}

fn learned(dataset: &Dataset, cloud: GaussianCloud, weights: Weights) -> GaussianCloud {
    let options = TrainOptions {
        iterations: 240,
        geometry_from: 40,
        refine_from: 1000,
        sh_degree: 0,
        noise: 0.0,
        weights: Weights { opacity: 0.0, scale: 0.0, ..weights },
        ..Default::default()
    };
    let mut engine = CpuEngine::new(dataset, &options, Model::new(cloud, dataset)).unwrap();
    assert_eq!(train(&mut engine, 6, 240, 1, 60, &mut |_, _| Ok(true)), Ok(true));
    crate::train::Engine::model(&mut engine).unwrap().cloud
}

/// The wall's normal in the axes of a camera.
fn wall_normal(camera: &Camera) -> Vec3 {
    camera.camera_from_world.transform_vector(glam::DVec3::NEG_Y).as_vec3()
}

/// Mean error of plane depth \[m\] and of normals \[1 - cosine\] where the image is solid, over all views.
fn errors(cloud: &GaussianCloud, dataset: &Dataset) -> (f32, f32) {
    let (mut depth, mut normal, mut count) = (0.0, 0.0, 0.0);
    for photograph in &dataset.training {
        let image = drawn(cloud, &photograph.camera);
        for pixel in 0..image.alpha.len() {
            if image.alpha[pixel] > 0.8 && photograph.depth[pixel] > 0.0 && image.plane_depth[pixel] > 0.0 {
                depth += (image.plane_depth[pixel] - photograph.depth[pixel]).abs().min(0.5);
                let n = Vec3::from_slice(&image.normal[3 * pixel..]).normalize_or_zero();
                normal += 1.0 - n.dot(wall_normal(&photograph.camera));
                count += 1.0;
            }
        }
    }
    assert!(count > 3000.0, "{count}");
    (depth / count, normal / count)
}

#[test]
fn each_term_does_what_it_says() {
    let dataset = wall();
    let none = Weights::default();
    let plain = learned(&dataset, beside(), none);
    let (depth, normal) = errors(&plain, &dataset);
    let with = |weights: Weights| errors(&learned(&dataset, beside(), weights), &dataset);
    let (d, _) = with(Weights { depth_prior: 2.0, ..none });
    assert!(d < 0.8 * depth, "{d} {depth}");
    let (_, n) = with(Weights { depth_normal: 0.3, ..none });
    assert!(n < 0.8 * normal, "{n} {normal}");
    let (d, _) = with(Weights { multi_view: 0.3, ..none });
    assert!(d < 0.9 * depth, "{d} {depth}");
    let flatness = |cloud: &GaussianCloud| -> f32 {
        let smallest = |s: &[f32; 3]| s.iter().copied().fold(f32::MAX, f32::min);
        cloud.log_scales.iter().map(smallest).sum::<f32>() / cloud.len() as f32
    };
    let flat = flatness(&learned(&dataset, beside(), Weights { flattening: 100.0, ..none }));
    assert!(flat < flatness(&plain) - 0.5, "{flat} {}", flatness(&plain));
}

#[test]
fn labels_are_learned() {
    let dataset = wall();
    let mut cloud = beside();
    cloud.feature_count = 2;
    cloud.features = vec![0.0; 2 * cloud.len()];
    let cloud = learned(&dataset, cloud, Weights { labels: 1.0, ..Default::default() });
    let (mut right, mut count) = (0, 0);
    for photograph in &dataset.training {
        let image = drawn(&cloud, &photograph.camera);
        for pixel in (0..image.alpha.len()).filter(|pixel| image.alpha[*pixel] > 0.8) {
            let strongest = 1 + (image.features[2 * pixel + 1] > image.features[2 * pixel]) as u8;
            right += (strongest == photograph.labels[pixel]) as usize;
            count += 1;
        }
    }
    assert!(right as f32 > 0.95 * count as f32 && count > 3000, "{right} of {count}");
}

/// A smooth made-up image with everything drawn.
fn made_up(camera: &Camera) -> Image {
    let n = camera.pixels();
    let wave = |i: usize, a: f32, b: f32| {
        (a * (i % camera.width as usize) as f32 + b * (i / camera.width as usize) as f32).sin()
    };
    Image {
        width: camera.width as usize,
        height: camera.height as usize,
        colour: vec![0.0; 3 * n],
        alpha: vec![0.9; n],
        depth: (0..n).map(|i| 2.0 + 0.1 * wave(i, 0.3, 0.2)).collect(),
        plane_depth: (0..n).map(|i| 2.4 + 0.05 * wave(i, 0.21, 0.13)).collect(),
        normal: (0..n).flat_map(|i| [0.1 * wave(i, 0.2, 0.5), 0.1 * wave(i, 0.4, 0.1), -0.8]).collect(),
        features: (0..2 * n).map(|i| wave(i, 0.7, 0.3)).collect(),
    }
}

fn blank(image: &Image) -> Image {
    let zeros = |list: &Vec<f32>| vec![0.0; list.len()];
    Image {
        width: image.width,
        height: image.height,
        colour: zeros(&image.colour),
        alpha: zeros(&image.alpha),
        depth: zeros(&image.depth),
        plane_depth: zeros(&image.plane_depth),
        normal: zeros(&image.normal),
        features: zeros(&image.features),
    }
}

/// One minus the cosine between derivatives and central differences, of some entries of one of an image's arrays.
fn disagreement(
    image: &Image,
    pick: fn(&mut Image) -> &mut Vec<f32>,
    term: &dyn Fn(&Image, &mut Image) -> f32,
    h: f32,
) -> f64 {
    let mut by = blank(image);
    term(image, &mut by);
    let by = pick(&mut by).clone();
    let (mut ab, mut aa, mut bb) = (0.0f64, 0.0f64, 0.0f64);
    for at in (0..by.len()).step_by(7) {
        let value = |shift: f32| {
            let mut other = image.clone();
            pick(&mut other)[at] += shift;
            term(&other, &mut blank(image)) as f64
        };
        let difference = (value(h) - value(-h)) / (2.0 * h as f64);
        let found = by[at] as f64;
        (ab, aa, bb) = (ab + found * difference, aa + found * found, bb + difference * difference);
    }
    assert!(aa > 0.0 && bb > 0.0);
    1.0 - ab / (aa * bb).sqrt()
}

#[test]
fn derivatives_are_those_of_the_terms() {
    let dataset = wall();
    let camera = dataset.training[0].camera;
    let image = made_up(&camera);
    // Weights are large so that sums in single precision keep their differences.
    let weight = 1e3;
    let photograph = &dataset.training[0];
    let prior = |image: &Image, by: &mut Image| priors::depth(image, photograph, weight, by);
    assert!(disagreement(&image, |image| &mut image.depth, &prior, 1e-3) < 1e-3);
    let labels = |image: &Image, by: &mut Image| labels::add(image, photograph, 2, weight, by);
    assert!(disagreement(&image, |image| &mut image.features, &labels, 1e-2) < 1e-3);
    let consistency = |image: &Image, by: &mut Image| depth_normal::add(image, &camera, weight, by);
    assert!(disagreement(&image, |image| &mut image.normal, &consistency, 1e-2) < 1e-3);
    assert!(disagreement(&image, |image| &mut image.plane_depth, &consistency, 1e-3) < 1e-3);
}

#[test]
fn derivatives_of_a_patch_are_those_of_ncc() {
    let dataset = wall();
    let (here, there) = (&dataset.training[0], &dataset.training[1]);
    let (grey, other_grey) = (multi_view::grey(here), multi_view::grey(there));
    let other = multi_view::Other::new(&there.camera, &here.camera, &other_grey, &there.depth);
    let wall_normal = wall_normal(&here.camera);
    let (mut ab, mut aa, mut bb, mut count, mut alike) = ([0.0f64; 2], [0.0f64; 2], [0.0f64; 2], 0, 0.0);
    for pixel in (0..here.depth.len()).step_by(5).filter(|pixel| here.depth[*pixel] > 0.0) {
        // The true plane looks the same; derivatives are taken beside it.
        let value = |normal: Vec3, depth: f32| multi_view::patch(&grey, &here.camera, &other, pixel, normal, depth);
        if let Some((loss, ..)) = value(wall_normal, here.depth[pixel]) {
            alike += loss;
            count += 1;
        }
        let (normal, depth) = (wall_normal * 0.9 + Vec3::new(0.02, -0.03, 0.0), here.depth[pixel] * 1.004);
        let Some((_, by_normal, by_depth)) = value(normal, depth) else { continue };
        let h = 2e-3;
        let ends = |a: Vec3, d: f32| {
            Some((value(normal + a, depth + d)?.0 - value(normal - a, depth - d)?.0) as f64 / (2.0 * h as f64))
        };
        let by_axis = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| ends(axis * h, 0.0));
        let mut add = |which: usize, found: f32, expected: Option<f64>| {
            let (Some(expected), found) = (expected, found as f64) else { return };
            ab[which] += found * expected;
            aa[which] += found * found;
            bb[which] += expected * expected;
        };
        (0..3).for_each(|k| add(0, by_normal[k], by_axis[k]));
        add(1, by_depth, ends(Vec3::ZERO, h));
    }
    assert!(count > 60 && alike / (count as f32) < 0.15, "{count} {alike}");
    for which in [0, 1] {
        let apart = 1.0 - ab[which] / (aa[which] * bb[which]).sqrt();
        assert!(apart < 0.02, "{which}: {apart}");
    }
}
