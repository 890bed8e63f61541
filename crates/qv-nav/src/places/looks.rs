//! How a drawn place looks: materials, light and shadow, and the defects that reconstructions have, as Gaussians sown on its surface.

use super::layout::{Draw, Kind, Layout, Surface};
use crate::goals::of_hsv;
use glam::{DQuat, DVec2, DVec3};
use qv_core::random::{Xoshiro256PlusPlus, scrambled};
use qv_core::{GaussianCloud, sow};
use std::f64::consts::TAU;

/// The first harmonic: 1 / (2 sqrt(pi)).
const FIRST: f64 = 0.282_094_79;

/// What repeats on a surface.
#[derive(Debug, Clone, Copy)]
enum Pattern {
    Plain,
    Checks,
    Stripes,
    Tiles,
    Clouds,
}

/// One material.
#[derive(Debug, Clone)]
struct Material {
    /// Two colours as shown, 0 to 1.
    colours: [[f64; 3]; 2],
    pattern: Pattern,
    /// Length after which a pattern repeats \[m\].
    scale: f64,
    /// Turn of the pattern \[rad\].
    turn: f64,
    /// Deviation of the logarithm of single Gaussians' brightness.
    grain: f64,
    /// The same of patches of some decimetres.
    blotches: f64,
    /// Flat pictures on it: middle and half sides in the surface's axes \[m\], and colour.
    decals: Vec<(DVec2, DVec2, [f64; 3])>,
    seed: u64,
}

/// Light of a place.
struct Light {
    sun: DVec3,
    strength: f64,
    /// Colour of what comes from everywhere.
    ambient: [f64; 3],
    /// Lamps: place, and the radius within which they act \[m\].
    lamps: Vec<(DVec3, f64)>,
    /// How much darker it is where surfaces meet the floor.
    corners: f64,
}

/// Gaussians of a layout, and what is behind them.
pub struct Looks {
    /// The place.
    pub cloud: GaussianCloud,
    /// Sky or ceiling, as shown.
    pub background: [f32; 3],
}

/// Least and greatest number of Gaussians of a place, about.
const COUNTS: [f64; 2] = [6000.0, 20_000.0];

/// The looks of a layout.
pub fn draw(layout: &Layout, surface: &Surface, random: &mut Xoshiro256PlusPlus) -> Looks {
    let mut draw = Draw(random);
    let light = Light::draw(layout, &mut draw);
    let materials = materials(layout, &mut draw);
    let count = COUNTS[0] * (COUNTS[1] / COUNTS[0]).powf(draw.between(0.0, 1.0));
    let spacing = (surface.area() / count).sqrt();
    let cloud = sow(&surface.mesh, spacing, |t, point| {
        let [a, b, c] = surface.mesh.corners(t);
        let normal = (b - a).cross(c - a).normalize();
        let material = &materials[surface.solid_of[t].map_or(0, |solid| 1 + solid)];
        let shown = material.colour(point, normal);
        light.on(layout, point, normal, shown)
    });
    let cloud = spoil(cloud, spacing, &mut draw);
    let background = match layout.is_room {
        true => [draw.between(0.2, 0.95) as f32; 3],
        false => [(0.75, 0.82, 0.9), (0.55, 0.7, 0.95), (0.85, 0.85, 0.85), (0.3, 0.4, 0.25)][draw.0.below(4)].into(),
    };
    Looks { cloud, background }
}

/// One for the floor, then one for each solid.
fn materials(layout: &Layout, draw: &mut Draw) -> Vec<Material> {
    let mut out = vec![Material::draw(layout.half.max_element(), draw)];
    // Walls, and what belongs to one table, are most often alike.
    let (wall, mut table) = (Material::draw(layout.half.max_element(), draw), Material::draw(1.0, draw));
    let is_uniform = draw.chance(0.7);
    for solid in &layout.solids {
        out.push(match solid.kind {
            Kind::Wall if is_uniform => wall.clone(),
            Kind::Leg => table.clone(),
            _ => Material::draw(solid.half.max_element(), draw),
        });
        if solid.kind == Kind::Top {
            table = Material { decals: Vec::new(), ..out[out.len() - 1].clone() };
        }
    }
    out
}

/// A colour as things have it: most are grey or brown, some green, few vivid.
fn colour(draw: &mut Draw) -> [f64; 3] {
    let (hue, saturation, value) = match draw.between(0.0, 1.0) {
        k if k < 0.35 => (draw.between(0.0, 360.0), draw.between(0.0, 0.15), draw.between(0.1, 0.98)),
        k if k < 0.55 => (draw.between(15.0, 50.0), draw.between(0.15, 0.6), draw.between(0.15, 0.85)),
        k if k < 0.70 => (draw.between(60.0, 150.0), draw.between(0.15, 0.7), draw.between(0.1, 0.7)),
        k if k < 0.85 => (draw.between(0.0, 360.0), draw.between(0.1, 0.45), draw.between(0.2, 0.95)),
        _ => (draw.between(0.0, 360.0), draw.between(0.5, 1.0), draw.between(0.3, 1.0)),
    };
    of_hsv(hue as f32, saturation as f32, value as f32).map(f64::from)
}

impl Material {
    fn draw(reach: f64, draw: &mut Draw) -> Self {
        let first = colour(draw);
        let second = match draw.chance(0.6) {
            // Most often another shade of the same.
            true => {
                let factor = draw.between(0.5, 1.4);
                first.map(|c| (c * factor).min(1.0))
            }
            false => colour(draw),
        };
        let patterns = [Pattern::Plain, Pattern::Checks, Pattern::Stripes, Pattern::Tiles, Pattern::Clouds];
        let decal = |draw: &mut Draw| {
            let half = DVec2::new(draw.between(0.08, 0.6), draw.between(0.08, 0.5));
            (draw.within(DVec2::new(reach, reach.min(1.2))), half, colour(draw))
        };
        let count = if draw.chance(0.4) { draw.0.below(4) } else { 0 };
        Self {
            colours: [first, second],
            pattern: patterns[draw.0.below(patterns.len())],
            scale: 0.12 * 10f64.powf(draw.between(0.0, 1.0)),
            turn: if draw.chance(0.6) { 0.0 } else { draw.between(0.0, TAU) },
            grain: draw.between(0.0, 0.3),
            blotches: draw.between(0.0, 0.3),
            decals: (0..count).map(|_| decal(draw)).collect(),
            seed: draw.0.bits(),
        }
    }

    /// The colour of a place on it, before light.
    fn colour(&self, point: DVec3, normal: DVec3) -> [f64; 3] {
        let uv = match normal.z.abs() > 0.9 {
            true => point.truncate(),
            false => DVec2::new(point.truncate().dot(DVec2::new(-normal.y, normal.x)), point.z),
        };
        let decal = self.decals.iter().find(|(middle, half, _)| (uv - *middle).abs().cmple(*half).all());
        let base = decal.map_or_else(|| self.pattern_at(uv), |(_, _, colour)| *colour);
        let single = noise(self.seed, (uv * 1000.0).as_ivec2().to_array());
        let patch = smooth(self.seed ^ 1, uv / 0.4);
        let factor = (self.grain * 1.7 * single + self.blotches * 1.7 * patch).exp();
        base.map(|c| (c * factor).min(1.0))
    }

    fn pattern_at(&self, uv: DVec2) -> [f64; 3] {
        let at = DVec2::from_angle(self.turn).rotate(uv) / self.scale;
        let cell = at.floor();
        let odd = |x: f64| x.rem_euclid(2.0) >= 1.0;
        let is_second = match self.pattern {
            Pattern::Plain => false,
            Pattern::Checks => odd(cell.x + cell.y),
            Pattern::Stripes => odd(cell.x),
            Pattern::Tiles => (at - cell).min_element() < 0.1,
            Pattern::Clouds => smooth(self.seed ^ 2, at) + 0.5 * smooth(self.seed ^ 3, 2.0 * at) > 0.0,
        };
        self.colours[usize::from(is_second)]
    }
}

/// A number of -1 to 1 for each cell of a grid.
fn noise(seed: u64, [i, j]: [i32; 2]) -> f64 {
    let mixed = scrambled(seed ^ scrambled(i as u64 ^ (j as u64).rotate_left(32)));
    (mixed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// The same, smooth between cells.
fn smooth(seed: u64, at: DVec2) -> f64 {
    let cell = at.floor();
    let f = at - cell;
    let (i, j) = (cell.x as i32, cell.y as i32);
    let corner = |a: i32, b: i32| noise(seed, [i.wrapping_add(a), j.wrapping_add(b)]);
    let ease = |x: f64| x * x * (3.0 - 2.0 * x);
    let (u, v) = (ease(f.x), ease(f.y));
    let row = |b: i32| corner(0, b) * (1.0 - u) + corner(1, b) * u;
    row(0) * (1.0 - v) + row(1) * v
}

impl Light {
    fn draw(layout: &Layout, draw: &mut Draw) -> Self {
        let (turn, up) = (draw.between(0.0, TAU), draw.between(0.35, 1.3));
        let sun = (DVec2::from_angle(turn) * up.cos()).extend(up.sin());
        let strength = if layout.is_room { draw.between(0.0, 0.25) } else { draw.between(0.0, 0.8) };
        let warm = draw.between(-0.12, 0.12);
        let level = draw.between(0.55, 1.0);
        let lamps = if layout.is_room { 1 + draw.0.below(3) } else { 0 };
        let lamp = |draw: &mut Draw| {
            let place = draw.within(layout.half).extend(draw.between(1.5, 2.5));
            (place, draw.between(1.5, 4.0))
        };
        Self {
            sun,
            strength,
            ambient: [level * (1.0 + warm), level, level * (1.0 - warm)],
            lamps: (0..lamps).map(|_| lamp(draw)).collect(),
            corners: draw.between(0.0, 0.5),
        }
    }

    /// What a colour is shown as at a place.
    fn on(&self, layout: &Layout, point: DVec3, normal: DVec3, shown: [f64; 3]) -> [f64; 3] {
        let facing = normal.dot(self.sun).max(0.0);
        let sun = if facing > 0.0 && self.strength > 0.02 && !self.is_shadowed(layout, point, normal) {
            self.strength * facing
        } else {
            0.0
        };
        let lamps: f64 =
            self.lamps.iter().map(|(place, radius)| 0.5 * (-(place.distance(point) / radius).powi(2)).exp()).sum();
        let side = 0.85 + 0.15 * normal.z;
        let corner = if normal.z < 0.9 { 1.0 - self.corners * (1.0 - (point.z / 0.3).min(1.0)) } else { 1.0 };
        std::array::from_fn(|c| {
            let linear = shown[c].powf(2.2) * (self.ambient[c] * side * corner + sun + lamps);
            linear.clamp(0.0, 1.0).powf(1.0 / 2.2)
        })
    }

    /// Whether something stands between a place and the sun.
    fn is_shadowed(&self, layout: &Layout, point: DVec3, normal: DVec3) -> bool {
        let from = point + 0.02 * normal;
        layout.solids.iter().any(|solid| {
            let most = (solid.heights[1] - from.z) / self.sun.z;
            most > 0.0
                && (0..6).any(|k| {
                    let p = from + self.sun * most * (f64::from(k) + 0.5) / 6.0;
                    p.z > solid.heights[0] && solid.covers(p.truncate())
                })
        })
    }
}

/// Moves, blurs and leaves out Gaussians, and hangs some into the air, as a reconstruction does.
fn spoil(cloud: GaussianCloud, spacing: f64, draw: &mut Draw) -> GaussianCloud {
    let (holes, jitter) = (draw.between(0.0, 0.05), draw.between(0.0, 0.4) * spacing);
    let (lift, uneven) = (draw.between(0.0, 0.012), draw.between(0.0, 0.4));
    let (wider, solid) = (draw.between(0.9, 1.4).ln(), draw.between(1.5, 5.0));
    let kept: Vec<bool> = (0..cloud.len()).map(|_| !draw.chance(holes)).collect();
    let mut out = cloud.filtered(|k| kept[k]);
    for k in 0..out.len() {
        let [w, x, y, z] = out.rotations[k].map(f64::from);
        let turn = DQuat::from_xyzw(x, y, z, w);
        let off = DVec3::new(draw.between(-jitter, jitter), draw.between(-jitter, jitter), 0.0);
        let normal = lift * f64::from(draw.0.normal());
        let moved = turn * (off + DVec3::Z * normal);
        for (mean, by) in out.means[k].iter_mut().zip(moved.to_array()) {
            *mean += by as f32;
        }
        for scale in &mut out.log_scales[k][..2] {
            *scale += (wider + uneven * f64::from(draw.0.normal())) as f32;
        }
        out.opacity_logits[k] = solid as f32;
    }
    let hanging = (draw.between(0.0, 0.004) * out.len() as f64) as usize;
    for _ in 0..hanging {
        hang(&mut out, draw);
    }
    out
}

/// One faint Gaussian in the air, of some colour of the place.
fn hang(cloud: &mut GaussianCloud, draw: &mut Draw) {
    let (at, of) = (draw.0.below(cloud.len()), draw.0.below(cloud.len()));
    let [x, y, _] = cloud.means[at];
    let colour = cloud.sh[of * cloud.sh_count()].map(|c| 0.5 + FIRST as f32 * c);
    cloud.means.push([x, y, draw.between(0.15, 1.2) as f32]);
    cloud.log_scales.push([0; 3].map(|_| draw.between(0.03, 0.12).ln() as f32));
    let turn = DQuat::from_rotation_z(draw.between(0.0, TAU));
    cloud.rotations.push([turn.w, turn.x, turn.y, turn.z].map(|q| q as f32));
    cloud.opacity_logits.push(draw.between(-3.0, -0.5) as f32);
    cloud.sh.push(colour.map(|c| (c - 0.5) / FIRST as f32));
    cloud.sh.extend(std::iter::repeat_n([0.0; 3], cloud.sh_count() - 1));
}
