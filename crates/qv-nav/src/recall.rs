//! What a robot remembers of where it looked: odometry that drifts, a grid of what blocks and of what was looked at, where the cone was last,
//! and where in the place it probably is. All of it comes from odometry and from what the network said of the robot's own pictures; the map has no
//! part in it. `python/quadverse/navigation.py` does the same on a robot.
//!
//! The grid is an occupancy grid (Moravec and Elfes 1985): logarithms of odds that grow where a picture says that something blocks, and fall
//! before it. A network sees it around the robot, finer near by than far away ([`RECALL`]).

use crate::sizes::{RAYS, SIGHT};
use glam::DVec2;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Side of a cell \[m\], and cells along a side of the grid; its middle is the start.
pub const CELL: f64 = 0.1;
/// See [`CELL`].
pub const CELLS: usize = 160;
/// Bearings, from straight ahead to the left, and distances from the base between which a network sees the grid \[m\].
pub const SECTORS: usize = 24;
/// See [`SECTORS`].
pub const RINGS: [f64; 9] = [0.25, 0.4, 0.55, 0.75, 1.0, 1.5, 2.2, 3.3, 5.0];
/// Numbers for a network. First what blocks, `[SECTORS][rings]`: 1 blocked, -1 free, 0 not known, the greatest of twelve points. Then the share of
/// these that was looked at. Then whether a cone was seen, sine and cosine of its bearing, logarithm of its distance \[m\], seconds since / 5.
/// Then the place as it is believed, x and y in shares of the place's half sides, sine and cosine of the heading, and how sure that is. Then
/// sine and cosine of the heading since the start, and the way from the start in the axes of the start / 3 m.
pub const RECALL: usize = 2 * SECTORS * (RINGS.len() - 1) + 5 + 5 + 4;
/// Bearing from one ray to the next \[rad\]; they lie evenly about straight ahead.
pub const RAY_STEP: f64 = 0.08;
/// Greatest distance that a ray can determine \[m\], and least.
pub const FARTHEST: f64 = 6.0;
/// See [`FARTHEST`].
pub const NEAREST: f64 = 0.05;
/// Rays begin at the camera's foot, so far before the base \[m\].
pub const CAMERA: f64 = 0.30;
/// Age that a picture is taken for, in decisions.
const AGE: f64 = 0.4;
/// Points of a sector's ring, across and along.
const POINTS: [usize; 2] = [3, 4];

/// Bearing of a ray.
pub fn ray(k: usize) -> f64 {
    (k as f64 - 0.5 * (RAYS - 1) as f64) * RAY_STEP
}

/// How odometry errs; all are deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Drift {
    /// Factor on distances, as a share.
    pub scale: f64,
    /// Turning that is not there \[rad/s\].
    pub turning: f64,
    /// Error of each change, as a share of it.
    pub each: f64,
}

impl Default for Drift {
    fn default() -> Self {
        Self { scale: 0.03, turning: 0.01, each: 0.05 }
    }
}

/// A place and a heading from above.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Planar {
    /// \[m\].
    pub place: DVec2,
    /// \[rad\].
    pub yaw: f64,
}

impl Planar {
    /// That of a base.
    pub fn of(base: &Pose) -> Self {
        Self { place: base.position.truncate(), yaw: base.yaw() }
    }

    /// A point given in this frame, in the frame that this is given in.
    pub fn out(&self, point: DVec2) -> DVec2 {
        self.place + DVec2::from_angle(self.yaw).rotate(point)
    }

    /// The reverse.
    pub fn into_frame(&self, point: DVec2) -> DVec2 {
        DVec2::from_angle(-self.yaw).rotate(point - self.place)
    }
}

/// Odometry of one episode.
#[derive(Debug, Clone)]
pub(crate) struct Odometer {
    scale: f64,
    turning: f64,
    each: f64,
    true_pose: Planar,
    /// What it says, from the start on.
    pub pose: Planar,
    random: Xoshiro256PlusPlus,
}

impl Odometer {
    /// At the start.
    pub fn new(drift: &Drift, start: Planar, seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::of(seed, 86, 0);
        let mut normal = |deviation: f64| deviation * f64::from(random.normal());
        let (scale, turning) = (1.0 + normal(drift.scale), normal(drift.turning));
        Self { scale, turning, each: drift.each, true_pose: start, pose: Planar::default(), random }
    }

    /// After `seconds`, at a true pose.
    pub fn go(&mut self, to: Planar, seconds: f64) {
        let step = self.true_pose.into_frame(to.place);
        let turn = (to.yaw - self.true_pose.yaw + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
        let mut off = || 1.0 + self.each * f64::from(self.random.normal());
        let step = DVec2::new(step.x * self.scale * off(), step.y * self.scale * off());
        let turn = turn * off() + self.turning * seconds;
        let place = self.pose.out(step);
        self.pose = Planar { place, yaw: self.pose.yaw + turn };
        self.true_pose = to;
    }
}

/// What was seen of a cone.
#[derive(Debug, Clone, Copy)]
struct ConeSighting {
    place: DVec2,
    decisions: f64,
}

/// Sums over what was said of the place: which shift and turn leads from odometry to the place.
#[derive(Debug, Clone, Copy, Default)]
struct Belief {
    weight: f64,
    said: DVec2,
    at: DVec2,
    turn: DVec2,
}

/// What one robot remembers.
#[derive(Debug, Clone)]
pub struct Recall {
    odds: Vec<f32>,
    looked: Vec<bool>,
    before: Planar,
    now: Planar,
    spotted: Option<ConeSighting>,
    belief: Belief,
    /// Half sides of the place \[m\]: what a share of the place is.
    half: DVec2,
}

impl Recall {
    /// Nothing yet, in a place of these half sides.
    pub fn new(half: DVec2) -> Self {
        let (odds, looked) = (vec![0.0; CELLS * CELLS], vec![false; CELLS * CELLS]);
        let now = Planar::default();
        Self { odds, looked, before: now, now, spotted: None, belief: Belief::default(), half }
    }

    /// Goes to where odometry says; once for each decision, before [`Recall::features`].
    pub fn go(&mut self, to: Planar) {
        (self.before, self.now) = (self.now, to);
        if let Some(spotted) = &mut self.spotted {
            spotted.decisions += 1.0;
        }
        // It stands where it is: nothing blocks there.
        for k in 0..9 {
            let along = -0.25 + 0.5 * f64::from(k) / 8.0;
            if let Some(cell) = cell(self.now.out(DVec2::new(along, 0.0))) {
                self.odds[cell] = -2.0;
            }
        }
    }

    /// Takes in what the network said of the picture of this decision ([`SIGHT`] numbers after [`crate::net::finish_sight`]).
    pub fn see(&mut self, sight: &[f32; SIGHT]) {
        // The picture is older than the decision.
        let back = |now: f64, before: f64| now + AGE * (before - now);
        let then = Planar {
            place: self.now.place + AGE * (self.before.place - self.now.place),
            yaw: back(self.now.yaw, self.before.yaw),
        };
        let number = |k: usize| f64::from(sight[k]);
        if number(3) > 0.5 {
            let bearing = DVec2::new(number(1), number(0)).normalize_or(DVec2::X);
            let place = then.out(number(2).clamp(-3.0, 2.5).exp() * bearing);
            let kept = self.spotted.filter(|s| s.place.distance(place) < 1.0).map_or(0.0, |_| 0.5);
            let before = self.spotted.map_or(place, |s| s.place);
            self.spotted = Some(ConeSighting { place: kept * before + (1.0 - kept) * place, decisions: 0.0 });
        }
        let said = DVec2::new(number(4), number(5)) * self.half;
        let heading = DVec2::new(number(7), number(6));
        // A network that is not sure says a short direction.
        let weight = heading.length_squared().min(1.0).powi(2);
        let belief = &mut self.belief;
        const KEPT: f64 = 0.96;
        belief.weight = KEPT * belief.weight + weight;
        belief.said = KEPT * belief.said + weight * said;
        belief.at = KEPT * belief.at + weight * then.place;
        belief.turn =
            KEPT * belief.turn + weight * DVec2::from_angle(-then.yaw).rotate(heading.normalize_or(DVec2::ZERO));
        self.lay(then, &sight[8..8 + RAYS], &sight[8 + RAYS..8 + 2 * RAYS]);
    }

    /// Lays the rays of a picture onto the grid: logarithms of distances to what blocks, and to where the view ends.
    fn lay(&mut self, then: Planar, walk: &[f32], view: &[f32]) {
        let eye = Planar { place: then.out(DVec2::new(CAMERA, 0.0)), yaw: then.yaw };
        let distances = |logs: &[f32]| -> [f64; RAYS] {
            std::array::from_fn(|k| f64::from(logs[k]).exp().clamp(NEAREST, FARTHEST))
        };
        let (walk, view) = (distances(walk), distances(view));
        const REACH: f64 = 5.0;
        // Cells near enough, of which only a box around the fan of rays need be looked at: the triangle that touches its arc, and a cell more.
        let half = 0.5 * RAYS as f64 * RAY_STEP;
        let corners = [-half, half].map(|off| eye.place + REACH / half.cos() * DVec2::from_angle(eye.yaw + off));
        let (low, high) = corners.iter().fold((eye.place, eye.place), |(low, high), p| (low.min(*p), high.max(*p)));
        let low = (low - CELL).max(eye.place - REACH) / CELL + 0.5 * CELLS as f64;
        let high = (high + CELL).min(eye.place + REACH) / CELL + 0.5 * CELLS as f64;
        let range = |low: f64, high: f64| low.clamp(0.0, CELLS as f64) as usize..high.clamp(0.0, CELLS as f64) as usize;
        for j in range(low.y, high.y) {
            for i in range(low.x, high.x) {
                let p = eye.into_frame(centre(i, j));
                let distance = p.length();
                // Cheap first: most cells are not in the picture.
                if p.x <= 0.85 * distance || distance > REACH {
                    continue;
                }
                let at = p.y.atan2(p.x) / RAY_STEP + 0.5 * (RAYS - 1) as f64;
                if at < -0.5 || at > RAYS as f64 - 0.5 {
                    continue;
                }
                let ray = (at.round().max(0.0) as usize).min(RAYS - 1);
                let (walk, view, cell) = (walk[ray], view[ray], j * CELLS + i);
                if distance < view - 0.1 {
                    self.looked[cell] = true;
                }
                let odds = &mut self.odds[cell];
                let off = 0.05 + 0.07 * walk;
                if distance < walk - off {
                    *odds = (*odds - 0.6).max(-2.0);
                } else if distance < walk + off && walk < 3.0 {
                    *odds = (*odds + (1.2 / (1.0 + walk)) as f32).min(2.0);
                }
            }
        }
    }

    /// How a network sees it, see [`RECALL`].
    pub fn features(&self) -> [f32; RECALL] {
        let mut out = [0.0; RECALL];
        let rings = RINGS.len() - 1;
        let count = SECTORS * rings;
        for (k, [blocked, looked]) in self.around().into_iter().enumerate() {
            (out[k], out[count + k]) = (blocked, looked);
        }
        let rest = &mut out[2 * count..];
        if let Some(spotted) = &self.spotted {
            let to = self.now.into_frame(spotted.place);
            let distance = to.length().max(0.05);
            let since = (0.2 / 5.0 * spotted.decisions).min(3.0);
            let numbers = [1.0, to.y / distance, to.x / distance, distance.ln(), since];
            rest[..5].iter_mut().zip(numbers).for_each(|(out, x)| *out = x as f32);
        }
        let belief = &self.belief;
        if belief.weight > 1e-3 {
            let turn = belief.turn.normalize_or(DVec2::X);
            let place = belief.said / belief.weight + turn.rotate(self.now.place - belief.at / belief.weight);
            let heading = turn.rotate(DVec2::from_angle(self.now.yaw));
            let sure = belief.turn.length() / belief.weight * (belief.weight / (1.0 + belief.weight));
            let share = place / self.half;
            let numbers = [share.x.clamp(-2.0, 2.0), share.y.clamp(-2.0, 2.0), heading.y, heading.x, sure];
            rest[5..10].iter_mut().zip(numbers).for_each(|(out, x)| *out = x as f32);
        }
        let (sine, cosine) = self.now.yaw.sin_cos();
        let numbers = [sine, cosine, self.now.place.x / 3.0, self.now.place.y / 3.0];
        rest[10..].iter_mut().zip(numbers).for_each(|(out, x)| *out = x as f32);
        out
    }

    /// For each sector and ring what blocks and what was looked at.
    fn around(&self) -> Vec<[f32; 2]> {
        let [across, along] = POINTS;
        let mut out = Vec::with_capacity(SECTORS * (RINGS.len() - 1));
        for sector in 0..SECTORS {
            // Along the sides and the middle of the sector.
            let axes: [DVec2; POINTS[0]] = std::array::from_fn(|k| {
                let share = sector as f64 + (k as f64 + 0.5) / across as f64 - 0.5;
                DVec2::from_angle(self.now.yaw + TAU * share / SECTORS as f64)
            });
            for ends in RINGS.windows(2) {
                let (mut most, mut looked) = (f32::MIN, 0);
                for k in 0..along {
                    let distance = ends[0] + (ends[1] - ends[0]) * (k as f64 + 0.5) / along as f64;
                    for axis in axes {
                        let cell = cell(self.now.place + distance * axis);
                        most = most.max(cell.map_or(0.0, |c| self.odds[c]));
                        looked += usize::from(cell.is_some_and(|c| self.looked[c]));
                    }
                }
                out.push([0.5 * most, looked as f32 / (across * along) as f32]);
            }
        }
        out
    }

    /// Where the cone is in the base's frame, if it was seen within the last three seconds \[m\].
    pub(crate) fn cone_now(&self) -> Option<DVec2> {
        self.spotted.filter(|s| s.decisions < 15.0).map(|s| self.now.into_frame(s.place))
    }

    /// Logarithm of the odds that a point in the base's frame is blocked.
    pub fn odds(&self, point: DVec2) -> f32 {
        cell(self.now.out(point)).map_or(0.0, |c| self.odds[c])
    }
}

fn centre(i: usize, j: usize) -> DVec2 {
    (DVec2::new(i as f64, j as f64) + 0.5 - 0.5 * CELLS as f64) * CELL
}

fn cell(p: DVec2) -> Option<usize> {
    let at = p / CELL + 0.5 * CELLS as f64;
    let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < CELLS as f64 && at.y < CELLS as f64;
    inside.then(|| at.y as usize * CELLS + at.x as usize)
}

/// The truth with the errors that a network makes, for decisions at which no network spoke.
pub fn doubtful(truth: &[f32; SIGHT], random: &mut Xoshiro256PlusPlus) -> [f32; SIGHT] {
    let mut out = *truth;
    let bearing = out[0].atan2(out[1]) + 0.04 * random.normal();
    (out[0], out[1]) = bearing.sin_cos();
    out[2] += 0.1 * random.normal();
    if random.unit() < 0.02 {
        out[3] = 1.0 - out[3];
    }
    let length = out[6].hypot(out[7]);
    let heading = out[6].atan2(out[7]) + 0.15 * random.normal();
    if length > 0.0 {
        (out[6], out[7]) = heading.sin_cos();
    }
    out[4..6].iter_mut().for_each(|x| *x += 0.1 * random.normal());
    let common = 0.05 * random.normal();
    out[8..8 + 2 * RAYS].iter_mut().for_each(|x| *x += common + 0.08 * random.normal());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLS_OF_GRID: usize = SECTORS * (RINGS.len() - 1);

    /// What a perfect network says with a wall across the way, `walk` metres before the camera, that hides nothing.
    fn wall(walk: f64) -> [f32; SIGHT] {
        let mut sight = [0.0; SIGHT];
        for k in 0..RAYS {
            sight[8 + k] = (walk / ray(k).cos()).min(FARTHEST).ln() as f32;
            sight[8 + RAYS + k] = FARTHEST.ln() as f32;
        }
        sight
    }

    #[test]
    fn odometry_without_drift_is_true_and_with_it_nearly() {
        let start = Planar { place: DVec2::new(1.0, -2.0), yaw: 0.7 };
        let none = Drift { scale: 0.0, turning: 0.0, each: 0.0 };
        let (mut exact, mut drifts) = (Odometer::new(&none, start, 3), Odometer::new(&Drift::default(), start, 3));
        let mut at = start;
        for k in 0..100 {
            at = Planar { place: at.out(DVec2::new(0.08, 0.01)), yaw: at.yaw + if k < 50 { 0.1 } else { -0.05 } };
            exact.go(at, 0.2);
            drifts.go(at, 0.2);
        }
        let expected = start.into_frame(at.place);
        assert!((exact.pose.place - expected).length() < 1e-9 && (exact.pose.yaw - (at.yaw - start.yaw)).abs() < 1e-9);
        let off = (drifts.pose.place - expected).length();
        assert!(off > 1e-3 && off < 0.2 * 8.0, "{off}");
    }

    #[test]
    fn what_blocks_is_recalled_behind_the_robot() {
        let mut recall = Recall::new(DVec2::splat(3.0));
        for _ in 0..4 {
            recall.go(Planar::default());
            recall.see(&wall(0.5));
        }
        let ahead = recall.features();
        // The wall is 0.8 m before the base: in the fourth ring, from 0.75 to 1.0 m.
        assert!(ahead[3] > 0.9 && ahead[1] < -0.9 && ahead[12 * 8 + 3] == 0.0, "{:?}", &ahead[..8]);
        assert!(ahead[CELLS_OF_GRID + 6] > 0.9 && ahead[CELLS_OF_GRID + 12 * 8 + 6] == 0.0, "it looked over the wall");
        recall.go(Planar { place: DVec2::ZERO, yaw: 0.5 * TAU });
        let behind = recall.features();
        assert!((behind[12 * 8 + 3] - ahead[3]).abs() < 1e-6 && behind[3] == 0.0, "{:?}", &behind[12 * 8..13 * 8]);
        assert!(recall.odds(DVec2::new(-0.8, 0.0)) > 1.5 && recall.odds(DVec2::ZERO) == -2.0);
    }

    #[test]
    fn the_cone_and_the_place_are_recalled_while_the_robot_moves() {
        let mut recall = Recall::new(DVec2::new(3.0, 2.0));
        let rest = 2 * CELLS_OF_GRID;
        assert_eq!(recall.features()[rest..rest + 10], [0.0; 10]);
        let mut sight = wall(5.0);
        // Two metres to the left; at (1.5, 0) of the place, turned to the left.
        [1.0, 0.0, 2f32.ln(), 0.9, 0.5, 0.0, 1.0, 0.0].into_iter().enumerate().for_each(|(k, x)| sight[k] = x);
        for _ in 0..5 {
            recall.go(Planar::default());
            recall.see(&sight);
        }
        // A metre ahead, which is along y of the place, then turned to the right.
        let to = Planar { place: DVec2::new(1.0, 0.0), yaw: -0.25 * TAU };
        recall.go(to);
        let f = &recall.features()[rest..];
        let bearing = f64::from(f[1]).atan2(f64::from(f[2]));
        let expected = (2f64).atan2(-1.0) + 0.25 * TAU - TAU;
        assert!(f[0] == 1.0 && (bearing - expected).abs() < 1e-5 && (f[3].exp() - 5f32.sqrt()).abs() < 1e-4, "{f:?}");
        assert!((f[4] - 0.04).abs() < 1e-6);
        assert!(
            (f[5] - 0.5).abs() < 1e-5 && (f[6] - 0.5).abs() < 1e-5 && f[7].abs() < 1e-5 && (f[8] - 1.0).abs() < 1e-5
        );
        assert!(f[9] > 0.7 && (f[10] + 1.0).abs() < 1e-6 && (f[12] - 1.0 / 3.0).abs() < 1e-6);
    }

    /// Only a box of cells is looked at. All of the grid that rays show lies in it.
    #[test]
    fn rays_are_laid_onto_all_cells_that_they_show() {
        let mut random = Xoshiro256PlusPlus::new(8);
        let far = [FARTHEST.ln() as f32; RAYS];
        for _ in 0..300 {
            let place = DVec2::new(f64::from(random.between(-9.0, 9.0)), f64::from(random.between(-9.0, 9.0)));
            let then = Planar { place, yaw: f64::from(random.between(-7.0, 7.0)) };
            let mut recall = Recall::new(DVec2::splat(3.0));
            recall.lay(then, &far, &far);
            let eye = Planar { place: then.out(DVec2::new(CAMERA, 0.0)), yaw: then.yaw };
            let shown = |p: DVec2| {
                let at = p.y.atan2(p.x) / RAY_STEP + 0.5 * (RAYS - 1) as f64;
                p.x > 0.85 * p.length() && (-0.5..=RAYS as f64 - 0.5).contains(&at)
            };
            for cell in 0..CELLS * CELLS {
                let p = eye.into_frame(centre(cell % CELLS, cell / CELLS));
                // A cell at the far end may be left out where the grid is not in line with it.
                if p.length() < 5.0 - CELL {
                    assert_eq!(recall.looked[cell], shown(p), "{then:?} {p}");
                } else if p.length() > 5.0 {
                    assert!(!recall.looked[cell], "{then:?} {p}");
                }
            }
        }
    }

    #[test]
    fn numbers_that_are_none_do_not_break_it() {
        let mut recall = Recall::new(DVec2::splat(3.0));
        recall.go(Planar { place: DVec2::new(1e9, f64::NAN), yaw: f64::NAN });
        recall.see(&[f32::NAN; SIGHT]);
        recall.see(&[f32::INFINITY; SIGHT]);
        assert_eq!(recall.features().len(), RECALL);
    }
}
