//! What the robots learn to walk on, and where on it their episodes begin.

use crate::PolicyError;
use qv_core::random::Xoshiro256PlusPlus;
use qv_sim::Terrain;

/// Ground with the places at which episodes begin.
#[derive(Debug, Clone)]
pub struct Ground {
    /// For the simulator.
    pub terrain: Terrain,
    /// Names of the kinds of ground.
    pub kinds: Vec<String>,
    /// Centres of places `[kind][level]` \[m\]: x, y; an episode begins within `around` of one.
    pub places: Vec<Vec<[f32; 2]>>,
    /// Half the side of the square in which an episode begins \[m\].
    pub around: f32,
    /// Half the side of a place \[m\]: a robot that leaves it goes to the next level.
    pub reach: f32,
    grid: Option<Grid>,
}

/// Heights of our own making, for quick looks.
#[derive(Debug, Clone)]
struct Grid {
    origin: f32,
    spacing: f32,
    count: usize,
    heights: Vec<f32>,
}

impl Grid {
    fn at(&self, x: f32, y: f32) -> Option<f32> {
        let (u, v) = ((x - self.origin) / self.spacing, (y - self.origin) / self.spacing);
        let last = (self.count - 1) as f32;
        // Written so that NaN finds nothing.
        if !(u >= 0.0 && v >= 0.0 && u < last && v < last) {
            return None;
        }
        let (i, j) = (u as usize, v as usize);
        let (a, b) = (u - i as f32, v - j as f32);
        let h = |i: usize, j: usize| self.heights[j * self.count + i];
        // The two triangles of a cell, as the simulator splits it.
        Some(if a >= b {
            h(i, j) + a * (h(i + 1, j) - h(i, j)) + b * (h(i + 1, j + 1) - h(i + 1, j))
        } else {
            h(i, j) + b * (h(i, j + 1) - h(i, j)) + a * (h(i + 1, j + 1) - h(i, j + 1))
        })
    }
}

impl Ground {
    /// The plane z = 0.
    pub fn plane() -> Self {
        Self {
            terrain: Terrain::plane(),
            kinds: vec!["plane".into()],
            places: vec![vec![[0.0; 2]]],
            around: 0.0,
            reach: f32::INFINITY,
            grid: None,
        }
    }

    /// Bumps of up to `height` \[m\] on a grid of 0.1 m.
    ///
    /// # Errors
    /// When the height means nothing.
    pub fn bumps(height: f32, seed: u64) -> Result<Self, PolicyError> {
        if !(0.0..=0.5).contains(&height) {
            return Err(PolicyError::setting("height of bumps", "0 to 0.5 m", height));
        }
        let (count, spacing) = (641, 0.1);
        let mut random = Xoshiro256PlusPlus::of(seed, 11, 0);
        let heights: Vec<f32> = (0..count * count).map(|_| random.between(0.0, height)).collect();
        // Smoothed over neighbours, so that a foot meets slopes and not needles, then stretched to the height again.
        let heights = stretched(smoothed(&heights, count), height);
        Self::of_grid(spacing, count, heights, vec!["bumps".into()], vec![vec![[0.0; 2]]], 10.0, f32::INFINITY)
    }

    /// Places of eight metres of growing difficulty: slopes up and down, stairs up and down, bumps; ten levels of each. At the last
    /// level slopes have `slope` \[rad\], stairs steps of `step` \[m\], bumps three quarters of a step.
    ///
    /// # Errors
    /// When a number means nothing.
    pub fn levels(slope: f32, step: f32, seed: u64) -> Result<Self, PolicyError> {
        if !(0.0..=0.8).contains(&slope) {
            return Err(PolicyError::setting("slope", "0 to 0.8 rad", slope));
        }
        if !(0.0..=0.4).contains(&step) {
            return Err(PolicyError::setting("step", "0 to 0.4 m", step));
        }
        let kinds = ["slope_up", "slope_down", "stairs_up", "stairs_down", "bumps"];
        let (levels, side, spacing) = (10usize, 8.0f32, 0.05f32);
        let cells = (side / spacing) as usize;
        // A margin of flat ground around all.
        let count = cells * (levels + 2) + 1;
        let origin = -0.5 * side * (levels + 2) as f32;
        let mut heights = vec![0.0; count * count];
        let mut random = Xoshiro256PlusPlus::of(seed, 12, 0);
        let rough = smoothed(&(0..count * count).map(|_| random.unit()).collect::<Vec<_>>(), count);
        let mut places = vec![Vec::new(); kinds.len()];
        for kind in 0..kinds.len() {
            for level in 0..levels {
                let (i0, j0) = ((level + 1) * cells, (2 * kind + 1) * cells);
                let hard = (level + 1) as f32 / levels as f32;
                for j in 0..=cells {
                    for i in 0..=cells {
                        let (x, y) = ((i as f32 / cells as f32 - 0.5) * side, (j as f32 / cells as f32 - 0.5) * side);
                        let at = (j0 + j) * count + i0 + i;
                        heights[at] = shape(kind, hard, [x, y], [slope, step], side, rough[at]);
                    }
                }
                places[kind].push([
                    origin + (i0 as f32 + 0.5 * cells as f32) * spacing,
                    origin + (j0 as f32 + 0.5 * cells as f32) * spacing,
                ]);
            }
        }
        let kinds = kinds.map(String::from).to_vec();
        Self::of_grid(spacing, count, heights, kinds, places, 0.5, 0.5 * side)
    }

    fn of_grid(
        spacing: f32,
        count: usize,
        heights: Vec<f32>,
        kinds: Vec<String>,
        places: Vec<Vec<[f32; 2]>>,
        around: f32,
        reach: f32,
    ) -> Result<Self, PolicyError> {
        let origin = -0.5 * spacing * (count - 1) as f32;
        let wide: Vec<f64> = heights.iter().map(|&h| f64::from(h)).collect();
        let terrain = Terrain::height_field([f64::from(origin); 2], [f64::from(spacing); 2], count, count, wide)?;
        Ok(Self { terrain, kinds, places, around, reach, grid: Some(Grid { origin, spacing, count, heights }) })
    }

    /// Any ground, such as a mesh of the real place: episodes begin where a square of `room` \[m\] around a point is ground and
    /// nearly level, at up to 200 points drawn with `seed` between `low` and `high` (x, y).
    ///
    /// # Errors
    /// When no such point is found.
    pub fn of_terrain(terrain: Terrain, [low, high]: [[f64; 2]; 2], room: f64, seed: u64) -> Result<Self, PolicyError> {
        let mut random = Xoshiro256PlusPlus::of(seed, 13, 0);
        let mut places = Vec::new();
        for _ in 0..20_000 {
            let [x, y] = [0, 1].map(|k| low[k] + f64::from(random.unit()) * (high[k] - low[k]));
            let ring = [
                (0.0, 0.0),
                (1.0, 0.0),
                (-1.0, 0.0),
                (0.0, 1.0),
                (0.0, -1.0),
                (1.0, 1.0),
                (-1.0, -1.0),
                (1.0, -1.0),
                (-1.0, 1.0),
            ];
            let heights = ring.map(|(i, j)| terrain.height_below(x + i * room, y + j * room, 1e6));
            let known: Vec<f64> = heights.into_iter().flatten().collect();
            let least = known.iter().copied().fold(f64::INFINITY, f64::min);
            let most = known.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            // Nearly level: less than a fifth of the room, what a leg reaches without climbing.
            if known.len() == ring.len() && most - least < 0.2 * room {
                places.push([x as f32, y as f32]);
                if places.len() == 200 {
                    break;
                }
            }
        }
        if places.is_empty() {
            let expected = format!("ground with level places of {room} m");
            return Err(PolicyError::setting("terrain", &expected, "none in 20 000 tries"));
        }
        Ok(Self {
            terrain,
            kinds: vec!["terrain".into()],
            places: vec![places],
            around: 0.0,
            reach: f32::INFINITY,
            grid: None,
        })
    }

    /// Whether this is the plane, whose height is 0 everywhere.
    pub fn is_plane(&self) -> bool {
        self.terrain.is_plane()
    }

    /// Whether levels grow harder (else all places of a kind are alike).
    pub(crate) fn has_levels(&self) -> bool {
        self.reach.is_finite()
    }

    /// Height of the ground at (x, y) \[m\], seen from `z`; `None` where there is none.
    pub fn height(&self, x: f32, y: f32, z: f32) -> Option<f32> {
        if self.is_plane() {
            return Some(0.0);
        }
        match &self.grid {
            Some(grid) => grid.at(x, y),
            None => self.terrain.height_below(f64::from(x), f64::from(y), f64::from(z)).map(|h| h as f32),
        }
    }
}

/// Height of a place at (x, y) from its centre: pyramids for slopes and stairs, with a flat top of one metre.
fn shape(kind: usize, hard: f32, [x, y]: [f32; 2], [slope, step]: [f32; 2], side: f32, rough: f32) -> f32 {
    /// Depth of a stair \[m\].
    const TREAD: f32 = 0.3;
    let out = x.abs().max(y.abs());
    let inwards = (0.5 * side - out).max(0.0).min(0.5 * side - 1.0);
    match kind {
        0 => -inwards * (hard * slope).tan(),
        1 => inwards * (hard * slope).tan(),
        2 => -(inwards / TREAD).floor() * hard * step,
        3 => (inwards / TREAD).floor() * hard * step,
        _ if inwards > 0.0 => rough * hard * 0.75 * step,
        _ => 0.0,
    }
}

/// Mean over each point and its eight neighbours.
fn smoothed(heights: &[f32], count: usize) -> Vec<f32> {
    let mut out = heights.to_vec();
    for j in 1..count - 1 {
        for i in 1..count - 1 {
            let around = (0..9).map(|k| heights[(j + k / 3 - 1) * count + i + k % 3 - 1]);
            out[j * count + i] = around.sum::<f32>() / 9.0;
        }
    }
    out
}

fn stretched(mut heights: Vec<f32>, height: f32) -> Vec<f32> {
    let least = heights.iter().copied().fold(f32::INFINITY, f32::min);
    let most = heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let scale = if most > least { height / (most - least) } else { 0.0 };
    heights.iter_mut().for_each(|h| *h = (*h - least) * scale);
    heights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quick_heights_are_those_of_the_simulator() {
        let ground = Ground::levels(0.26, 0.1, 3).unwrap();
        let mut random = Xoshiro256PlusPlus::new(1);
        for _ in 0..2000 {
            let (x, y) = (random.between(-47.0, 47.0), random.between(-47.0, 47.0));
            let exact = ground.terrain.height_below(f64::from(x), f64::from(y), 10.0).unwrap();
            let quick = f64::from(ground.height(x, y, 10.0).unwrap());
            assert!((exact - quick).abs() < 1e-3, "{exact} {quick} at {x} {y}");
        }
        assert_eq!(ground.height(1000.0, 0.0, 1.0), None);
    }

    #[test]
    fn levels_grow_harder() {
        let ground = Ground::levels(0.26, 0.1, 3).unwrap();
        let drop = |kind: usize, level: usize| {
            let [x, y] = ground.places[kind][level];
            ground.height(x, y, 10.0).unwrap() - ground.height(x + 3.9, y, 10.0).unwrap()
        };
        assert!((drop(1, 9) - 2.9 * 0.26f32.tan()).abs() < 0.03, "{}", drop(1, 9));
        assert!((drop(3, 9) - 0.9).abs() < 0.11 && drop(3, 0) > 0.05 && drop(2, 9) < -0.7, "{}", drop(3, 9));
    }

    #[test]
    fn bumps_have_their_height_and_bad_numbers_are_named() {
        let ground = Ground::bumps(0.04, 5).unwrap();
        let mut random = Xoshiro256PlusPlus::new(2);
        let heights: Vec<f32> = (0..5000)
            .map(|_| ground.height(random.between(-30.0, 30.0), random.between(-30.0, 30.0), 1.0).unwrap())
            .collect();
        let most = heights.iter().copied().fold(0.0, f32::max);
        assert!(most > 0.03 && most <= 0.04 && heights.iter().all(|&h| h >= 0.0), "{most}");
        assert!(Ground::bumps(f32::NAN, 0).is_err() && Ground::levels(2.0, 0.1, 0).is_err());
    }
}
