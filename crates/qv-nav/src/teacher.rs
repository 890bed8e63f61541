//! The seeing teacher: a planner that knows the map, but uses the cone's place only once it could have been seen.
//!
//! Before that it searches: it keeps in mind where a cone could still be, turns to the left while turning shows more of that, then goes to
//! the viewpoint that shows most for the time that it costs. A teacher that knew all could not be imitated: the student would see nothing
//! and average left and right.

use crate::map::{Field, Map};
use crate::sight::{Cone, Rig, SEEN, free_rays, in_frustum};
use crate::task::{Limits, PERIOD};
use glam::{DVec2, DVec3};
use qv_core::{Camera, Pose};
use std::f64::consts::{PI, TAU};

/// A place from which much can be seen.
#[derive(Debug, Clone)]
struct Viewpoint {
    place: DVec2,
    field: Field,
    /// Candidates that can be seen from it.
    shows: Vec<bool>,
}

/// What teachers of all episodes share.
#[derive(Debug, Clone)]
pub struct World {
    /// The map.
    pub map: Map,
    /// How the camera sits.
    pub rig: Rig,
    /// Limits of commands.
    pub limits: Limits,
    /// Where a cone may stand: centres on the ground \[m\].
    pub candidates: Vec<DVec3>,
    viewpoints: Vec<Viewpoint>,
}

/// Height of a robot's camera over the ground, about \[m\].
const EYE: f64 = 0.42;
/// Height of the point of a cone that is looked for \[m\].
const LOOKED_FOR: f64 = 0.3;
/// Share of the candidates that must be new for a look round to be worth its time.
const WORTH: f64 = 0.05;
/// Seconds that a look round costs.
const LOOK_ROUND: f64 = 3.0;
/// Distance of the head from the cone at which the teacher stands \[m\].
const STAND_OFF: f64 = 0.29;

impl World {
    /// The map with its viewpoints.
    pub fn new(map: Map, rig: Rig, limits: Limits) -> Self {
        let on_ground = |p: DVec2| map.height(p).map(|z| p.extend(z));
        let candidates: Vec<DVec3> = map.places(0.3, 0.42).into_iter().filter_map(on_ground).collect();
        let viewpoint = |place: DVec3| {
            let eye = place + DVec3::Z * EYE;
            let shows = candidates.iter().map(|c| map.is_free(eye, *c + DVec3::Z * LOOKED_FOR)).collect();
            Viewpoint { place: place.truncate(), field: map.field(place.truncate(), &[]), shows }
        };
        let mut places = map.places(0.7, 0.45);
        if places.is_empty() {
            places = map.places(0.3, 0.0);
        }
        let viewpoints = places.into_iter().filter_map(on_ground).map(viewpoint).collect();
        Self { map, rig, limits, candidates, viewpoints }
    }
}

/// What the teacher says at one decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Advice {
    /// Forwards, to the left \[m/s\], turning to the left \[rad/s\].
    pub command: [f64; 3],
    /// Whether the cone was seen at any time up to now.
    pub found: bool,
    /// Whether it is in view now.
    pub in_view: bool,
    /// Bearing of the cone from the base's heading \[rad\], positive to the left.
    pub bearing: f64,
    /// Distance of the cone from the base \[m\].
    pub distance: f64,
}

/// The teacher of one episode.
#[derive(Debug, Clone)]
pub struct Teacher {
    avoid: Vec<DVec2>,
    seen: Vec<bool>,
    found: bool,
    to_goal: Option<Field>,
    viewpoint: Option<(usize, Field)>,
    /// Decisions spent turning in place.
    turns: usize,
}

impl Teacher {
    /// For an episode with other cones to keep away from.
    pub fn new(world: &World, others: &[Cone]) -> Self {
        Self {
            avoid: others.iter().map(Cone::axis).collect(),
            seen: vec![false; world.candidates.len()],
            found: false,
            to_goal: None,
            viewpoint: None,
            turns: 0,
        }
    }

    /// What to do at a pose, and what can be seen of the goal.
    pub fn advise(&mut self, world: &World, base: &Pose, goal: &Cone) -> Advice {
        let camera = world.rig.camera(base);
        let in_view = free_rays(&world.map, &camera, goal, true) >= SEEN;
        self.found |= in_view;
        let p = base.position.truncate();
        let to = goal.axis() - p;
        let command = if self.found {
            let field = self.to_goal.get_or_insert_with(|| world.map.field(goal.axis(), &self.avoid));
            approach(world, field, base, goal)
        } else {
            self.look(world, &camera);
            self.search(world, base)
        };
        let bearing = turn_to(base.yaw(), to);
        Advice { command, found: self.found, in_view, bearing, distance: to.length() }
    }

    /// Marks the candidates that are in view.
    fn look(&mut self, world: &World, camera: &Camera) {
        let eye = camera.camera_from_world.inverse().position;
        for (seen, candidate) in self.seen.iter_mut().zip(&world.candidates) {
            let point = *candidate + DVec3::Z * LOOKED_FOR;
            *seen = *seen || (in_frustum(camera, point) && world.map.is_free(eye, point));
        }
    }

    fn new_from(&self, viewpoint: &Viewpoint) -> f64 {
        viewpoint.shows.iter().zip(&self.seen).filter(|(shows, seen)| **shows && !**seen).count() as f64
    }

    fn search(&mut self, world: &World, base: &Pose) -> [f64; 3] {
        let p = base.position.truncate();
        let worth = WORTH * world.candidates.len() as f64;
        let distance = |v: &Viewpoint| v.place.distance(p);
        if let Some((at, _)) = &self.viewpoint {
            let viewpoint = &world.viewpoints[*at];
            if distance(viewpoint) < 0.3 || self.new_from(viewpoint) < 0.5 * worth {
                self.viewpoint = None;
            }
        }
        if self.viewpoint.is_none() {
            let here = world.viewpoints.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some(v) = here.filter(|v| distance(v) < 0.8 && self.new_from(v) >= worth) {
                self.turns += 1;
                if self.turns as f64 * PERIOD * world.limits.turning < TAU {
                    return [0.0, 0.0, world.limits.turning];
                }
                // A whole turn showed what can be seen from here; the rest is for another viewpoint.
                self.seen.iter_mut().zip(&v.shows).for_each(|(seen, shows)| *seen |= shows);
            }
            self.turns = 0;
            self.choose(world, p);
        }
        match &self.viewpoint {
            Some((_, field)) => pursue(world, field, base),
            None => [0.0, 0.0, world.limits.turning],
        }
    }

    /// The viewpoint that shows most for its time; all is forgotten when nothing is left to be seen.
    fn choose(&mut self, world: &World, p: DVec2) {
        let rate = |v: &Viewpoint| {
            let time = world.map.at(&v.field, p) / world.limits.forwards[1] + LOOK_ROUND;
            if time.is_finite() { self.new_from(v) / time } else { 0.0 }
        };
        let rates: Vec<f64> = world.viewpoints.iter().map(rate).collect();
        let best = (0..rates.len()).max_by(|&a, &b| rates[a].total_cmp(&rates[b]));
        match best.filter(|&b| self.new_from(&world.viewpoints[b]) >= 1.0) {
            Some(best) => {
                let field = world.map.field(world.viewpoints[best].place, &self.avoid);
                self.viewpoint = Some((best, field));
            }
            None => self.seen.fill(false),
        }
    }
}

/// Angle to turn from a heading to a direction, -pi to pi.
pub fn turn_to(yaw: f64, direction: DVec2) -> f64 {
    (direction.y.atan2(direction.x) - yaw + PI).rem_euclid(TAU) - PI
}

/// Follows a way.
fn pursue(world: &World, field: &Field, base: &Pose) -> [f64; 3] {
    let p = base.position.truncate();
    let Some(target) = world.map.ahead(field, p, 0.4) else { return [0.0; 3] };
    if target.distance(p) < 0.02 {
        return [0.0; 3];
    }
    steer(&world.limits, turn_to(base.yaw(), target - p), world.limits.forwards[1])
}

/// Turns towards a direction, and goes once it is about ahead.
fn steer(limits: &Limits, turn: f64, speed: f64) -> [f64; 3] {
    // Full speed within 20 degrees, none beyond 50: corners are not cut.
    let ahead = ((turn.cos() - 0.64) / 0.3).clamp(0.0, 1.0);
    [speed * ahead, 0.0, (2.0 * turn).clamp(-limits.turning, limits.turning)]
}

/// Follows the way to the cone, and stands before it.
fn approach(world: &World, field: &Field, base: &Pose, goal: &Cone) -> [f64; 3] {
    let to = goal.axis() - base.position.truncate();
    if to.length() > world.rig.head + 0.7 {
        return pursue(world, field, base);
    }
    let turn = turn_to(base.yaw(), to);
    let left = world.rig.head(base).distance(goal.axis()) - STAND_OFF;
    let limits = &world.limits;
    // Close to it and turned away: back off rather than push it with the shoulder.
    if to.length() < world.rig.head + 0.15 {
        let back = if turn.abs() > 0.5 { -0.2 } else { (1.0 * left).clamp(limits.forwards[0], 0.1) };
        return [back, 0.0, (2.0 * turn).clamp(-limits.turning, limits.turning)];
    }
    let speed = (1.0 * left).clamp(limits.forwards[0], limits.forwards[1]);
    let wanted = steer(limits, turn, speed.max(0.0));
    if left < 0.03 { [speed.min(0.0), 0.0, wanted[2]] } else { wanted }
}
