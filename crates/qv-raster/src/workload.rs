//! The scene that rasterisers are measured on: a made-up yard of 30 m with boxes, bushes and a far shell, and views from the
//! head of a quadruped.
//!
//! Every number is a hash of a seed, a stream and an index, so that any language makes the same scene but for rounding.

use glam::{DMat3, DVec2, DVec3};
use qv_core::random::SplitMix64;
use qv_core::{Camera, GaussianCloud, Pose};
use std::f64::consts::PI;

/// Half the side of the yard \[m\].
const RADIUS: f64 = 15.0;
const BOXES: usize = 28;
const BUSHES: usize = 70;

/// The first number of SplitMix64 from a seed.
fn hash(x: u64) -> u64 {
    SplitMix64::new(x).bits()
}

/// Numbers by stream and index.
#[derive(Clone, Copy)]
struct Random {
    seed: u64,
}

impl Random {
    /// Uniform in [0, 1).
    fn uniform(&self, stream: u64, index: usize) -> f64 {
        let key = hash(self.seed.wrapping_mul(1_000_003).wrapping_add(stream));
        (hash(index as u64 ^ key) >> 11) as f64 * 2f64.powi(-53)
    }

    /// Standard normal, from this stream and the next (Box and Muller).
    fn normal(&self, stream: u64, index: usize) -> f64 {
        let radius = (-2.0 * (-self.uniform(stream, index)).ln_1p()).sqrt();
        radius * (2.0 * PI * self.uniform(stream + 1, index)).cos()
    }
}

struct Box3 {
    centre: DVec2,
    /// Half width, half depth, height \[m\].
    size: DVec3,
    yaw: f64,
    colour: DVec3,
}

struct Bush {
    centre: DVec2,
    radius: f64,
    height: f64,
    green: f64,
}

fn objects(seed: u64) -> (Vec<Box3>, Vec<Bush>) {
    let random = Random { seed: seed ^ 0x0B_7EC7 };
    let box_of = |i: usize| {
        let u = |stream: u64| random.uniform(stream, i);
        Box3 {
            centre: DVec2::new((u(1) * 2.0 - 1.0) * 13.5, (u(2) * 2.0 - 1.0) * 13.5),
            size: DVec3::new(0.25 + 1.5 * u(3).powi(2), 0.25 + 1.5 * u(4).powi(2), 0.3 + 2.7 * u(5).powf(1.5)),
            yaw: u(6) * PI,
            colour: DVec3::new(u(7), u(8), u(9)),
        }
    };
    let bush_of = |i: usize| {
        let u = |stream: u64| random.uniform(stream, i);
        Bush {
            centre: DVec2::new((u(21) * 2.0 - 1.0) * 14.5, (u(22) * 2.0 - 1.0) * 14.5),
            radius: 0.25 + 0.75 * u(23),
            height: 0.3 + 1.7 * u(24).powi(2),
            green: u(25),
        }
    };
    ((0..BOXES).map(box_of).collect(), (0..BUSHES).map(bush_of).collect())
}

/// A Gaussian of the scene before it is rounded.
struct Draft {
    mean: DVec3,
    normal: DVec3,
    scales: DVec3,
    colour: DVec3,
}

/// What the scene is made of, with sums over the boxes.
struct Yard {
    random: Random,
    count: f64,
    boxes: Vec<Box3>,
    bushes: Vec<Bush>,
    /// Running share of the boxes' area.
    shares: Vec<f64>,
    box_area: f64,
}

impl Yard {
    fn new(count: usize, seed: u64) -> Self {
        let (boxes, bushes) = objects(seed);
        let areas: Vec<f64> = boxes
            .iter()
            .map(|b| 4.0 * b.size.y * b.size.z + 4.0 * b.size.x * b.size.z + 4.0 * b.size.x * b.size.y)
            .collect();
        let box_area: f64 = areas.iter().sum();
        let mut sum = 0.0;
        let shares = areas.iter().map(|area| {
            sum += area;
            sum / box_area
        });
        Self { random: Random { seed }, count: count as f64, shares: shares.collect(), box_area, boxes, bushes }
    }

    fn u(&self, stream: u64, i: usize) -> f64 {
        self.random.uniform(stream, i)
    }

    fn n(&self, stream: u64, i: usize) -> f64 {
        self.random.normal(stream, i)
    }

    fn ground(&self, i: usize) -> Draft {
        let (x, y) = ((self.u(1, i) * 2.0 - 1.0) * RADIUS, (self.u(2, i) * 2.0 - 1.0) * RADIUS);
        let z = 0.02 * (1.3 * x).sin() * (0.9 * y).cos() + 0.01 * self.n(10, i);
        let spacing = 0.45 * ((2.0 * RADIUS).powi(2) / (0.45 * self.count).max(1.0)).sqrt();
        Draft {
            mean: DVec3::new(x, y, z),
            normal: DVec3::new(0.05 * self.n(12, i), 0.05 * self.n(14, i), 1.0),
            scales: DVec3::new(spacing, spacing, 0.1 * spacing),
            colour: DVec3::new(0.42 + 0.08 * x.sin(), 0.38 + 0.08 * y.cos(), 0.28),
        }
    }

    fn on_box(&self, i: usize) -> Draft {
        let u1 = self.u(1, i);
        let chosen = &self.boxes[self.shares.partition_point(|&share| share < u1).min(BOXES - 1)];
        let DVec3 { x: hx, y: hy, z: hz } = chosen.size;
        let faces = [2.0 * hy * hz, 2.0 * hy * hz, 2.0 * hx * hz, 2.0 * hx * hz, 4.0 * hx * hy];
        let total: f64 = faces.iter().sum();
        let u2 = self.u(2, i);
        let mut sum = 0.0;
        let passed = faces.iter().filter(|&&face| {
            sum += face;
            u2 > sum / total
        });
        let face = passed.count().min(4);
        let (a, c) = (self.u(3, i) * 2.0 - 1.0, self.u(4, i));
        let sign = if face % 2 == 0 { 1.0 } else { -1.0 };
        let (local, normal) = match face {
            0 | 1 => (DVec3::new(sign * hx, a * hy, c * hz), DVec3::new(sign, 0.0, 0.0)),
            2 | 3 => (DVec3::new(a * hx, sign * hy, c * hz), DVec3::new(0.0, sign, 0.0)),
            _ => (DVec3::new(a * hx, (c * 2.0 - 1.0) * hy, hz), DVec3::Z),
        };
        let turn = DMat3::from_rotation_z(chosen.yaw);
        let spacing = 0.45 * (self.box_area / (0.2 * self.count).max(1.0)).sqrt();
        Draft {
            mean: turn * local + chosen.centre.extend(0.0),
            normal: turn * normal,
            scales: DVec3::new(spacing, spacing, 0.1 * spacing),
            colour: DVec3::splat(0.25) + 0.5 * chosen.colour,
        }
    }

    fn bush(&self, i: usize) -> Draft {
        let bush = &self.bushes[((self.u(1, i) * BUSHES as f64) as usize).min(BUSHES - 1)];
        let (n1, n2, n3) = (self.n(10, i), self.n(12, i), self.n(14, i));
        let size = 0.025 * (3e5 / self.count).sqrt().powf(2.0 / 3.0);
        let at = bush.centre + 0.5 * bush.radius * DVec2::new(n1, n2);
        Draft {
            mean: at.extend(bush.height * self.u(2, i).powf(0.8)),
            normal: DVec3::new(n2, n3, 0.4 * n1),
            scales: DVec3::new(2.2 * size, 0.7 * size, 0.35 * size),
            colour: DVec3::new(0.15 + 0.2 * bush.green, 0.3 + 0.25 * self.u(3, i), 0.1),
        }
    }

    fn far(&self, i: usize) -> Draft {
        let (angle, radius) = (self.u(1, i) * 2.0 * PI, 18.0 + 27.0 * self.u(2, i));
        let size = 0.20 * (3e5 / self.count).sqrt();
        let light = 0.2 * self.u(4, i);
        let height = 6.0 * self.u(3, i).powf(1.5) * radius / 20.0;
        Draft {
            mean: DVec3::new(radius * angle.cos(), radius * angle.sin(), height),
            normal: DVec3::new(-angle.cos(), -angle.sin(), 0.3 * self.n(10, i)),
            scales: DVec3::new(size, size, 0.3 * size),
            colour: DVec3::new(0.2 + light, 0.3 + light, 0.25 + light),
        }
    }

    fn draft(&self, i: usize) -> Draft {
        let mut draft = match self.u(0, i) {
            u if u < 0.45 => self.ground(i),
            u if u < 0.65 => self.on_box(i),
            u if u < 0.93 => self.bush(i),
            _ => self.far(i),
        };
        let tail = if self.u(22, i) < 0.02 { 3.0 } else { 1.0 };
        let size = (0.5 * self.n(20, i)).exp() * tail;
        let jitter = [24, 26, 28].map(|stream| (0.3 * self.n(stream, i)).exp());
        draft.scales = (draft.scales * size * DVec3::from_array(jitter)).clamp(DVec3::splat(1e-3), DVec3::splat(3.0));
        draft.normal /= draft.normal.length() + 1e-12;
        draft
    }

    fn logit(&self, i: usize) -> f64 {
        if self.u(31, i) < 0.55 { 3.0 + self.n(32, i) } else { -1.0 + 1.2 * self.n(34, i) }
    }
}

/// Quaternion w, x, y, z that turns z to a unit vector after a spin about z \[rad\].
fn quaternion(normal: DVec3, spin: f64) -> [f64; 4] {
    let w = 1.0 + normal.z;
    let [a, b, c, d] = if w < 1e-9 {
        [0.0, 1.0, 0.0, 0.0]
    } else {
        let length = (w * w + normal.y * normal.y + normal.x * normal.x).sqrt();
        [w / length, -normal.y / length, normal.x / length, 0.0]
    };
    let (sin, cos) = (spin / 2.0).sin_cos();
    [a * cos - d * sin, b * cos + c * sin, c * cos - b * sin, d * cos + a * sin]
}

/// The scene: `count` Gaussians in no order, with spherical harmonics to a degree of 0 to 3.
pub fn cloud(count: usize, sh_degree: u8, seed: u64) -> GaussianCloud {
    let yard = Yard::new(count, seed);
    let mut out = GaussianCloud { sh_degree, ..Default::default() };
    for i in 0..count {
        let draft = yard.draft(i);
        out.means.push(draft.mean.as_vec3().to_array());
        out.log_scales.push(draft.scales.to_array().map(|scale| scale.ln() as f32));
        out.rotations.push(quaternion(draft.normal, yard.u(30, i) * 2.0 * PI).map(|x| x as f32));
        out.opacity_logits.push(yard.logit(i) as f32);
        let noise = DVec3::new(yard.n(10, i), yard.n(12, i), yard.n(14, i));
        let colour = (draft.colour + 0.06 * noise).clamp(DVec3::splat(0.02), DVec3::splat(0.98));
        out.sh.push(((colour - 0.5) / 0.282_094_791_773_878_14).as_vec3().to_array());
        for j in 1..out.sh_count() as u64 {
            out.sh.push([0, 1, 2].map(|c| (0.05 * yard.n(100 + (j * 3 + c) * 2, i)) as f32));
        }
    }
    out
}

/// Views from a height of 0.3 m that stand in no box and no bush; fewer only if 64 count + 256 places do not give as many.
pub fn cameras(count: usize, seed: u64, width: u32, height: u32) -> Vec<Camera> {
    let (boxes, bushes) = objects(seed);
    let random = Random { seed: seed ^ 0xCA_3E7A };
    let free = |at: DVec2| {
        let outside = |b: &Box3| {
            let local = DVec2::from_angle(-b.yaw).rotate(at - b.centre).abs() - b.size.truncate();
            local.max(DVec2::ZERO).length()
        };
        boxes.iter().all(|b| outside(b) > 0.5) && bushes.iter().all(|b| (at - b.centre).length() - b.radius > 0.35)
    };
    let place = |j: usize| {
        let u = |stream: u64| (random.uniform(stream, j) * 2.0 - 1.0) * 10.0;
        DVec2::new(u(1), u(2))
    };
    let tries = 0..64 * count + 256;
    tries.filter(|&j| free(place(j))).take(count).map(|j| camera(&random, j, place(j), width, height)).collect()
}

fn camera(random: &Random, j: usize, at: DVec2, width: u32, height: u32) -> Camera {
    let yaw = random.uniform(3, j) * 2.0 * PI;
    let (pitch, roll) = (3f64.to_radians() * random.normal(4, j), 2f64.to_radians() * random.normal(6, j));
    let z = 0.3 + 0.03 * random.normal(8, j).clamp(-2.0, 2.0);
    let focal = (380.0 + (615.0 - 380.0) * random.uniform(10, j)) * (width as f64 / 640.0);
    let forward = DVec3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), -pitch.sin());
    let right = DVec3::new(yaw.sin(), -yaw.cos(), 0.0);
    let down = forward.cross(right);
    let (sin, cos) = roll.sin_cos();
    let world_from_camera = DMat3::from_cols(cos * right + sin * down, cos * down - sin * right, forward);
    let rotation = glam::DQuat::from_mat3(&world_from_camera.transpose()).normalize();
    Camera {
        fx: focal,
        fy: focal,
        cx: width as f64 / 2.0,
        cy: height as f64 / 2.0,
        width,
        height,
        camera_from_world: Pose { position: -(rotation * at.extend(z)), rotation },
    }
}
