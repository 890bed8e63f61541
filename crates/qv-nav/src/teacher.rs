//! The seeing teacher: a planner that knows the map, but uses the cone's place only once it could have been seen.
//!
//! Before that it searches: it keeps in mind where a cone could still be, and turns in place or goes to a viewpoint, whichever shows most of that for
//! its time. It decides anew each time, so that what it says depends on where the robot is and on what was seen, and on nothing that only a
//! teacher keeps in mind. A teacher that knew all could not be imitated: the student would see nothing and average left and right.

use crate::goals::GoalSet;
use crate::limits::{Limits, TAIL, give_way};
use crate::map::{Field, Map, standing};
use crate::sight::{Cone, Rig, SEEN, free_rays, in_frustum};
use glam::{DVec2, DVec3};
use qv_core::{Camera, Pose};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// A place from which much can be seen.
#[derive(Debug, Clone)]
struct Viewpoint {
    place: DVec2,
    /// Candidates that can be seen from it.
    shows: Vec<bool>,
    /// The way to it.
    field: Field,
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
    /// How the teacher drives.
    pub teacher: TeacherSettings,
    /// What can be a goal.
    pub goals: GoalSet,
    /// Whether a network learns where in the place it is. It cannot where it is in another place each time.
    pub is_known: bool,
    viewpoints: Vec<Viewpoint>,
}

/// How the teacher drives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TeacherSettings {
    /// Height of a robot's camera over the ground, about \[m\].
    pub eye: f64,
    /// Height of the point of a cone that is looked for \[m\].
    pub looked_for: f64,
    /// Share of the candidates that must be new for a turn in place to be worth its time.
    pub worth: f64,
    /// Seconds that looking round at a viewpoint costs, for the choice among them.
    pub look_round: f64,
    /// Factor on what a turn in place shows: above 1 it looks round before it goes on.
    pub turns: f64,
    /// Seconds that a turn in place takes beside the turn itself.
    pub dawdle: f64,
    /// Distance from the base within which there is no cone \[m\].
    pub too_near: f64,
    /// Distance of the head from the cone at which it stands \[m\].
    pub stand_off: f64,
    /// Distances along the way to whose mean it steers \[m\]: one alone jumps with the map's cells.
    pub ahead: [f64; 3],
    /// Room at head, middle and tail below which it keeps away from what blocks \[m\].
    pub margin: f64,
    /// Speed away from what blocks where there is no room at all \[m/s\].
    pub push: f64,
    /// Greatest speed where the head is at what blocks, and how much more for each metre that is free ahead of it \[m/s\], \[1/s\].
    pub brake: [f64; 2],
    /// Speed to the cone for each metre that is left \[1/s\].
    pub approach: f64,
    /// Angle that turning to the right must save for it to turn to the right in a search, and angle behind it, on the right, from which on it
    /// turns to the left in pursuit \[rad\]: which of two ways is shorter by a little no student can determine.
    pub left: [f64; 2],
    /// Distance between viewpoints \[m\], and the room that they have \[m\].
    pub viewpoints: [f64; 2],
    /// Shortest and longest way from the start to a cone that the task allows: elsewhere it does not look \[m\].
    pub geodesic: [f64; 2],
    /// Mean speed on the way to a viewpoint where there is room, for the choice among them \[m/s\].
    pub travel: f64,
    /// Cosines of the angles to the way within which it goes at full speed, and beyond which it turns in place.
    pub bends: [f64; 2],
    /// The same near the cone: it goes there only while the cone is in the picture, for a student cannot judge a distance that it does not see.
    pub near_bends: [f64; 2],
    /// Distance of the head from the cone within which it is near \[m\].
    pub near: f64,
    /// Greatest speed there \[m/s\].
    pub near_speed: f64,
}

impl Default for TeacherSettings {
    fn default() -> Self {
        Self {
            eye: 0.42,
            looked_for: 0.3,
            worth: 0.04,
            look_round: 4.0,
            turns: 1.5,
            dawdle: 0.5,
            too_near: 0.7,
            stand_off: 0.25,
            ahead: [0.3, 0.45, 0.6],
            margin: 0.28,
            push: 0.5,
            brake: [0.1, 0.8],
            approach: 1.0,
            left: [2.5, 2.4],
            viewpoints: [0.5, 0.45],
            geodesic: [2.5, 7.0],
            travel: 0.5,
            bends: [0.92, 0.45],
            near_bends: [0.98, 0.91],
            near: 0.9,
            near_speed: 0.35,
        }
    }
}

impl World {
    /// The map with its viewpoints.
    pub fn new(map: Map, rig: Rig, limits: Limits) -> Self {
        Self::with(map, rig, limits, TeacherSettings::default())
    }

    /// The same with a teacher that drives otherwise.
    pub fn with(map: Map, rig: Rig, limits: Limits, teacher: TeacherSettings) -> Self {
        let on_ground = |p: DVec2| map.height(p).map(|z| p.extend(z));
        let candidates: Vec<DVec3> = map.places(0.3, 0.42).into_iter().filter_map(on_ground).collect();
        let viewpoint = |place: DVec3| {
            let eye = place + DVec3::Z * teacher.eye;
            let shows = candidates.iter().map(|c| map.is_free(eye, *c + DVec3::Z * teacher.looked_for)).collect();
            Viewpoint { place: place.truncate(), shows, field: map.field(place.truncate(), &[]) }
        };
        let mut places = map.places(teacher.viewpoints[0], teacher.viewpoints[1]);
        if places.is_empty() {
            places = map.places(0.3, 0.0);
        }
        let places: Vec<DVec3> = places.into_iter().filter_map(on_ground).collect();
        let viewpoints = places.into_par_iter().map(viewpoint).collect();
        let goals = GoalSet::named();
        Self { map, rig, limits, candidates, teacher, goals, is_known: true, viewpoints }
    }

    /// The same place as one of many, with goals that are commanded by their colours.
    pub fn among_many(self, goals: GoalSet) -> Self {
        Self { goals, is_known: false, ..self }
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
    began: bool,
    found: bool,
    to_goal: Option<Field>,
    /// Whether the goal is not there, so that it is never found.
    is_absent: bool,
    /// Ways to viewpoints past the other cones, once they were wanted.
    ways: HashMap<usize, Field>,
}

impl Teacher {
    /// For an episode with other cones to keep away from.
    pub fn new(world: &World, others: &[Cone]) -> Self {
        Self {
            avoid: others.iter().map(Cone::axis).collect(),
            seen: vec![false; world.candidates.len()],
            began: false,
            found: false,
            to_goal: None,
            is_absent: false,
            ways: HashMap::new(),
        }
    }

    /// Finds the ways to the goal now, and not once it is seen: a robot that stops to do so keeps all others waiting.
    pub fn plan(&mut self, world: &World, goal: &Cone) {
        self.to_goal = Some(world.map.field(goal.axis(), &self.avoid));
    }

    /// The same for an episode without its goal: it searches until the end.
    pub fn without_goal(self) -> Self {
        Self { is_absent: true, ..self }
    }

    /// What to do at a pose, and what can be seen of the goal.
    pub(crate) fn advise(&mut self, world: &World, base: &Pose, goal: &Cone) -> Advice {
        let camera = world.rig.camera(base);
        self.leave_out(world, base.position.truncate());
        let in_view = !self.is_absent && free_rays(&world.map, &camera, goal, true) >= SEEN;
        self.found |= in_view;
        let p = base.position.truncate();
        let to = goal.axis() - p;
        let command = if self.found {
            let field = self.to_goal.get_or_insert_with(|| world.map.field(goal.axis(), &self.avoid));
            approach(world, field, base, goal)
        } else {
            self.look(world, &camera, p);
            self.search(world, base)
        };
        let command = keep_away(world, base, &self.avoid, command);
        let bearing = turn_to(base.yaw(), to);
        Advice { command, found: self.found, in_view, bearing, distance: to.length() }
    }

    /// Before the first decision: takes for seen what is too near to the start, or too far, to be looked for.
    fn leave_out(&mut self, world: &World, start: DVec2) {
        if std::mem::replace(&mut self.began, true) {
            return;
        }
        let lengths = world.map.lengths(start);
        let [least, most] = world.teacher.geodesic;
        for (seen, candidate) in self.seen.iter_mut().zip(&world.candidates) {
            *seen = !(least..=most).contains(&world.map.at(&lengths, candidate.truncate()));
        }
    }

    /// Marks the candidates that are in view.
    fn look(&mut self, world: &World, camera: &Camera, base: DVec2) {
        let eye = camera.camera_from_world.inverse().position;
        for (seen, candidate) in self.seen.iter_mut().zip(&world.candidates) {
            let point = *candidate + DVec3::Z * world.teacher.looked_for;
            // What stands nearer than this is no place for a cone: the robot would stand on it.
            *seen = *seen
                || candidate.truncate().distance(base) < world.teacher.too_near
                || (in_frustum(camera, point) && world.map.is_free(eye, point));
        }
    }

    fn new_from(&self, viewpoint: &Viewpoint) -> f64 {
        viewpoint.shows.iter().zip(&self.seen).filter(|(shows, seen)| **shows && !**seen).count() as f64
    }

    /// Bearings from the base's heading of the places that were not seen yet and can be from here, once the camera is turned to them.
    fn unseen_from_here(&self, world: &World, base: &Pose) -> Vec<f64> {
        let p = base.position.truncate();
        let unseen = self.seen.iter().zip(&world.candidates).filter(|(seen, _)| !**seen).map(|(_, c)| *c);
        unseen
            .filter(|c| {
                let to = c.truncate() - p;
                let there =
                    standing(&world.map, p, to.to_angle(), base.position.z - world.map.height(p).unwrap_or(0.0));
                let (camera, point) = (world.rig.camera(&there), *c + DVec3::Z * world.teacher.looked_for);
                in_frustum(&camera, point) && world.map.is_free(camera.camera_from_world.inverse().position, point)
            })
            .map(|c| turn_to(base.yaw(), c.truncate() - p))
            .collect()
    }

    fn search(&mut self, world: &World, base: &Pose) -> [f64; 3] {
        let (p, settings, limits) = (base.position.truncate(), &world.teacher, &world.limits);
        let worth = settings.worth * world.candidates.len() as f64;
        let bearings = self.unseen_from_here(world, base);
        let sense = shorter_sense(&bearings, settings.left[0]);
        let sweep = bearings.iter().map(|b| (sense * b).rem_euclid(TAU)).fold(0.0, f64::max);
        let turning = bearings.len() as f64 * settings.turns / (sweep / limits.turning + settings.dawdle);
        // A turn shows what can be seen from here; the rest is for another viewpoint.
        let distance = |v: &Viewpoint| v.place.distance(p);
        if (bearings.len() as f64) < worth {
            let here = world.viewpoints.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some(v) = here.filter(|v| distance(v) < 0.35) {
                self.seen.iter_mut().zip(&v.shows).for_each(|(seen, shows)| *seen |= shows);
            }
        }
        let rates: Vec<f64> = world.viewpoints.iter().map(|v| self.rate(world, base, v)).collect();
        let best = (0..rates.len()).max_by(|&a, &b| rates[a].total_cmp(&rates[b]));
        let going = best.map_or(0.0, |b| rates[b]);
        if bearings.len() as f64 >= worth && turning >= going {
            return [0.0, 0.0, sense * limits.turning];
        }
        match best.filter(|_| going > 0.0) {
            Some(best) => {
                let (viewpoint, avoid) = (&world.viewpoints[best], &self.avoid);
                if avoid.is_empty() {
                    return pursue(world, &viewpoint.field, base);
                }
                let way = self.ways.entry(best).or_insert_with(|| world.map.field(viewpoint.place, avoid));
                pursue(world, way, base)
            }
            None => {
                self.seen.fill(false);
                [0.0, 0.0, limits.turning]
            }
        }
    }

    /// What a viewpoint shows for the time that it takes to turn to it, to go there and to look round.
    fn rate(&self, world: &World, base: &Pose, viewpoint: &Viewpoint) -> f64 {
        let (new, settings, p) = (self.new_from(viewpoint), &world.teacher, base.position.truncate());
        let way = world.map.at(&viewpoint.field, p);
        if new < 1.0 || !way.is_finite() || viewpoint.place.distance(p) < 0.25 {
            return 0.0;
        }
        let towards = world.map.ahead(&viewpoint.field, p, settings.ahead[1]).unwrap_or(p);
        let facing = turn_to(base.yaw(), towards - p).abs() / world.limits.turning;
        new / (facing + way / settings.travel + settings.look_round)
    }
}

/// Angle to turn from a heading to a direction, -pi to pi.
pub(crate) fn turn_to(yaw: f64, direction: DVec2) -> f64 {
    (direction.y.atan2(direction.x) - yaw + PI).rem_euclid(TAU) - PI
}

/// -1 if turning to the right shows places at some bearings \[rad\] at least `saved` \[rad\] sooner than turning to the left, else 1.
fn shorter_sense(bearings: &[f64], saved: f64) -> f64 {
    let sweep = |sense: f64| bearings.iter().map(|b| (sense * b).rem_euclid(TAU)).fold(0.0, f64::max);
    if sweep(-1.0) < sweep(1.0) - saved { -1.0 } else { 1.0 }
}

/// Follows a way.
fn pursue(world: &World, field: &Field, base: &Pose) -> [f64; 3] {
    let p = base.position.truncate();
    let mut target = DVec2::ZERO;
    for ahead in world.teacher.ahead {
        let Some(point) = world.map.ahead(field, p, ahead) else { return [0.0; 3] };
        target += point / world.teacher.ahead.len() as f64;
    }
    if target.distance(p) < 0.02 {
        return [0.0; 3];
    }
    let turn = turn_to(base.yaw(), target - p);
    // What is about behind is turned to on one side.
    let turn = if turn < -world.teacher.left[1] { turn + TAU } else { turn };
    steer(world, turn, world.limits.forwards[1], world.teacher.bends)
}

/// Turns towards a direction, and goes once it is about ahead.
fn steer(world: &World, turn: f64, speed: f64, [full, none]: [f64; 2]) -> [f64; 3] {
    let limits = &world.limits;
    let ahead = ((turn.cos() - none) / (full - none)).clamp(0.0, 1.0);
    [speed * ahead, 0.0, (2.0 * turn).clamp(-limits.turning, limits.turning)]
}

/// Follows the way to the cone, and stands before it.
fn approach(world: &World, field: &Field, base: &Pose, goal: &Cone) -> [f64; 3] {
    let p = base.position.truncate();
    let to = goal.axis() - p;
    let straight = (1..=8).all(|k| world.map.room(p.lerp(goal.axis(), f64::from(k) / 8.0)) > world.teacher.margin);
    if to.length() > world.rig.head + world.teacher.near || (to.length() > world.rig.head + 0.3 && !straight) {
        return pursue(world, field, base);
    }
    let turn = turn_to(base.yaw(), to);
    let left = world.rig.head(base).distance(goal.axis()) - world.teacher.stand_off;
    let (limits, rate) = (&world.limits, world.teacher.approach);
    // Close to it and turned away: back off rather than push it with the shoulder.
    if to.length() < world.rig.head + 0.15 {
        let back = if turn.abs() > 0.5 { -0.2 } else { (rate * left).clamp(limits.forwards[0], 0.1) };
        return [back, 0.0, (2.0 * turn).clamp(-limits.turning, limits.turning)];
    }
    let speed = (rate * left).clamp(limits.forwards[0], world.teacher.near_speed);
    let wanted = steer(world, turn, speed.max(0.0), world.teacher.near_bends);
    if left < 0.03 { [speed.min(0.0), 0.0, wanted[2]] } else { wanted }
}

/// Radius of a cone's foot, about \[m\].
const FOOT: f64 = 0.08;

/// Changes a command so that head, middle and tail get away from what blocks: none of them gets nearer than it should, and each is pushed
/// off with a speed that grows as its room shrinks.
fn keep_away(world: &World, base: &Pose, cones: &[DVec2], command: [f64; 3]) -> [f64; 3] {
    let (TeacherSettings { margin, push, .. }, map) = (world.teacher, &world.map);
    let heading = DVec2::from_angle(base.yaw());
    let p = base.position.truncate();
    let mut command = command;
    let free = map.clear(p + world.rig.head * heading, heading, 1.0);
    command[0] = command[0].min(world.teacher.brake[0] + world.teacher.brake[1] * free);
    for along in [world.rig.head, 0.0, -TAIL] {
        let q = p + along * heading;
        let cone = cones.iter().copied().min_by(|a, b| a.distance(q).total_cmp(&b.distance(q)));
        let from_cone = cone.map_or(f64::INFINITY, |c| c.distance(q) - FOOT);
        let room = map.room(q).min(from_cone);
        if room >= margin {
            continue;
        }
        // Away from what blocks, in base axes.
        let out = cone.filter(|_| from_cone == room).map_or_else(|| map.away(q), |c| (q - c).normalize_or_zero());
        let out = DVec2::new(out.dot(heading), out.dot(heading.perp()));
        command = give_way(command, along, out, (margin - room) / margin * push);
    }
    world.limits.clamped(command)
}
