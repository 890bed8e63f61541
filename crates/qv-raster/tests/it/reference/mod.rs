//! A dense renderer in double precision, written from the formulas: every pixel looks at every Gaussian in the order of
//! depth. No tiles, no extents, no shared code.
//!
//! Which Gaussians a pixel takes is decided once, at the undisturbed parameters, and held while parameters are moved: what
//! finite differences then give is the derivative that holds almost everywhere.
#![allow(dead_code)]

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use qv_core::{Camera, GaussianCloud, Pose};

/// The parameters of a cloud, in a flat list.
#[derive(Clone)]
pub struct Parameters {
    pub values: Vec<f64>,
    pub count: usize,
    pub degree: u8,
    pub features: usize,
    /// A smaller low-pass, and opacities that make up for it.
    pub antialias: bool,
}

impl Parameters {
    pub fn of(cloud: &GaussianCloud, antialias: bool) -> Self {
        let mut values = vec![];
        for i in 0..cloud.len() {
            values.extend(cloud.means[i].map(|x| x as f64));
            values.extend(cloud.log_scales[i].map(|x| x as f64));
            values.extend(cloud.rotations[i].map(|x| x as f64));
            values.push(cloud.opacity_logits[i] as f64);
            values.extend(cloud.sh_of(i).iter().flatten().map(|&x| x as f64));
            values.extend(cloud.features_of(i).iter().map(|&x| x as f64));
        }
        Self { values, count: cloud.len(), degree: cloud.sh_degree, features: cloud.feature_count, antialias }
    }

    /// Numbers per Gaussian.
    pub fn stride(&self) -> usize {
        11 + 3 * (self.degree as usize + 1).pow(2) + self.features
    }
}

/// A Gaussian as a camera sees it.
struct ReferenceGaussian {
    index: usize,
    mean: DVec2,
    inverse: DMat2,
    opacity: f64,
    /// Colour, depth, normal, distance of the plane, features.
    numbers: Vec<f64>,
}

/// The sums of one pixel; the last one is what is left for the background.
pub type Pixel = Vec<f64>;

/// For each pixel the Gaussians that it takes, near to far.
pub type PixelOrder = Vec<Vec<usize>>;

pub struct Dense {
    pub taken: PixelOrder,
    /// Whether a decision of a pixel is so close that single precision may take it otherwise.
    pub close: Vec<bool>,
}

fn basis(degree: u8, d: DVec3) -> Vec<f64> {
    let (x, y, z) = (d.x, d.y, d.z);
    let pi = std::f64::consts::PI;
    let mut out = vec![0.5 / pi.sqrt()];
    if degree >= 1 {
        let k = (3.0 / (4.0 * pi)).sqrt();
        out.extend([-k * y, k * z, -k * x]);
    }
    if degree >= 2 {
        let (a, b, c) = (0.5 * (15.0 / pi).sqrt(), 0.25 * (5.0 / pi).sqrt(), 0.25 * (15.0 / pi).sqrt());
        out.extend([a * x * y, -a * y * z, b * (3.0 * z * z - 1.0), -a * x * z, c * (x * x - y * y)]);
    }
    if degree >= 3 {
        let a = 0.25 * (35.0 / (2.0 * pi)).sqrt();
        let b = 0.5 * (105.0 / pi).sqrt();
        let c = 0.25 * (21.0 / (2.0 * pi)).sqrt();
        let e = 0.25 * (7.0 / pi).sqrt();
        out.extend([
            -a * y * (3.0 * x * x - y * y),
            b * x * y * z,
            -c * y * (5.0 * z * z - 1.0),
            e * z * (5.0 * z * z - 3.0),
            -c * x * (5.0 * z * z - 1.0),
            0.5 * b * z * (x * x - y * y),
            -a * x * (x * x - 3.0 * y * y),
        ]);
    }
    out
}

fn see(p: &Parameters, i: usize, camera: &Camera) -> Option<ReferenceGaussian> {
    let v = &p.values[i * p.stride()..(i + 1) * p.stride()];
    let mean = DVec3::new(v[0], v[1], v[2]);
    let centre = camera.camera_from_world.transform_point(mean);
    if centre.z <= 0.01 {
        return None;
    }
    let turn = DMat3::from_quat(DQuat::from_xyzw(v[7], v[8], v[9], v[6]).normalize());
    let scales = DVec3::new(v[3].exp(), v[4].exp(), v[5].exp());
    let world = turn * DMat3::from_diagonal(scales * scales) * turn.transpose();
    let view = camera.camera_from_world.matrix();
    let local = view * world * view.transpose();
    let (margin_x, margin_y) = (0.15 * camera.width as f64 / camera.fx, 0.15 * camera.height as f64 / camera.fy);
    let x = (centre.x / centre.z)
        .clamp(-camera.cx / camera.fx - margin_x, (camera.width as f64 - camera.cx) / camera.fx + margin_x);
    let y = (centre.y / centre.z)
        .clamp(-camera.cy / camera.fy - margin_y, (camera.height as f64 - camera.cy) / camera.fy + margin_y);
    let j = [
        DVec3::new(camera.fx / centre.z, 0.0, -camera.fx * x / centre.z),
        DVec3::new(0.0, camera.fy / centre.z, -camera.fy * y / centre.z),
    ];
    let entry = |a: usize, b: usize| j[a].dot(local * j[b]);
    let before = DMat2::from_cols_array(&[entry(0, 0), entry(0, 1), entry(1, 0), entry(1, 1)]);
    let covariance = before + DMat2::from_diagonal(DVec2::splat(if p.antialias { 0.1 } else { 0.3 }));
    let kept = if p.antialias { (before.determinant().max(0.0) / covariance.determinant()).sqrt() } else { 1.0 };
    let eye = camera.camera_from_world.inverse().position;
    let weights = basis(p.degree, (mean - eye).normalize());
    let mut numbers = vec![0.5; 3];
    for (k, weight) in weights.iter().enumerate() {
        for c in 0..3 {
            numbers[c] += weight * v[11 + 3 * k + c];
        }
    }
    numbers.iter_mut().for_each(|c| *c = c.max(0.0));
    numbers.push(centre.z);
    let shortest = (0..3).fold(0, |best, k| if v[3 + k] < v[3 + best] { k } else { best });
    let mut normal = view * turn.col(shortest);
    if normal.dot(centre) > 0.0 {
        normal = -normal;
    }
    numbers.extend(normal.to_array());
    numbers.push(-normal.dot(centre));
    numbers.extend(&v[p.stride() - p.features..]);
    Some(ReferenceGaussian {
        index: i,
        mean: DVec2::new(camera.fx * centre.x / centre.z + camera.cx, camera.fy * centre.y / centre.z + camera.cy),
        inverse: covariance.inverse(),
        opacity: kept / (1.0 + (-v[10]).exp()),
        numbers,
    })
}

fn alpha(seen: &ReferenceGaussian, pixel: DVec2) -> f64 {
    let d = pixel - seen.mean;
    (seen.opacity * (-0.5 * d.dot(seen.inverse * d)).exp()).min(0.999)
}

fn seen_in_order(p: &Parameters, camera: &Camera) -> Vec<ReferenceGaussian> {
    let mut seen: Vec<ReferenceGaussian> = (0..p.count).filter_map(|i| see(p, i, camera)).collect();
    seen.sort_by(|a, b| a.numbers[3].total_cmp(&b.numbers[3]));
    seen
}

fn centre(camera: &Camera, pixel: usize) -> DVec2 {
    let width = camera.width as usize;
    DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
}

/// Decides which Gaussians each pixel takes.
pub fn decide(p: &Parameters, camera: &Camera) -> Dense {
    let seen = seen_in_order(p, camera);
    let mut out = Dense { taken: vec![], close: vec![] };
    for pixel in 0..camera.pixels() {
        let (mut left, mut taken, mut close) = (1.0, vec![], false);
        for gaussian in &seen {
            let a = alpha(gaussian, centre(camera, pixel));
            close |= (a * 255.0 - 1.0).abs() < 1e-3;
            if a < 1.0 / 255.0 {
                continue;
            }
            let after = left * (1.0 - a);
            close |= (after / 1e-4 - 1.0).abs() < 1e-2;
            if after <= 1e-4 {
                break;
            }
            left = after;
            taken.push(gaussian.index);
        }
        out.taken.push(taken);
        out.close.push(close);
    }
    out
}

/// Sums of every pixel, given which Gaussians it takes: colour, depth, normal, distance, features, transmittance.
pub fn sums(p: &Parameters, camera: &Camera, taken: &PixelOrder) -> Vec<Pixel> {
    let mut place = vec![None; p.count];
    let seen = seen_in_order(p, camera);
    for (k, gaussian) in seen.iter().enumerate() {
        place[gaussian.index] = Some(k);
    }
    let numbers = 8 + p.features;
    let pixel = |pixel: usize| {
        let mut sums = vec![0.0; numbers];
        let mut left = 1.0;
        for gaussian in taken[pixel].iter().filter_map(|&i| place[i]).map(|k| &seen[k]) {
            let a = alpha(gaussian, centre(camera, pixel));
            for (sum, number) in sums.iter_mut().zip(&gaussian.numbers) {
                *sum += left * a * number;
            }
            left *= 1.0 - a;
        }
        sums.push(left);
        sums
    };
    (0..camera.pixels()).map(pixel).collect()
}

/// The outputs of every pixel: colour (3), alpha, depth, plane depth, normal (3), features.
pub fn outputs(sums: &[Pixel], camera: &Camera, background: [f64; 3]) -> Vec<Vec<f64>> {
    let of = |(pixel, sums): (usize, &Pixel)| {
        let left = sums[sums.len() - 1];
        let at = centre(camera, pixel);
        let ray = DVec3::new((at.x - camera.cx) / camera.fx, (at.y - camera.cy) / camera.fy, 1.0);
        let facing = -DVec3::new(sums[4], sums[5], sums[6]).dot(ray);
        let mut out: Vec<f64> = (0..3).map(|c| sums[c] + left * background[c]).collect();
        out.push(1.0 - left);
        out.push(if left < 1.0 { sums[3] / (1.0 - left) } else { 0.0 });
        out.push(if facing > 1e-4 { sums[7] / facing } else { 0.0 });
        out.extend(&sums[4..7]);
        out.extend(&sums[8..sums.len() - 1]);
        out
    };
    sums.iter().enumerate().map(of).collect()
}

/// The pose after a twist on its left: translation \[m\], then rotation \[rad\].
pub fn twisted(camera: &Camera, twist: [f64; 6]) -> Camera {
    let turn = DQuat::from_scaled_axis(DVec3::new(twist[3], twist[4], twist[5]));
    // To first order, which is what central differences of a derivative at zero ask for.
    let step = Pose { position: DVec3::new(twist[0], twist[1], twist[2]), rotation: turn };
    Camera { camera_from_world: step * camera.camera_from_world, ..*camera }
}
