//! What carries the camera: the trait, and a follower of velocities that knows no legs.

use crate::NavError;
use crate::map::Map;
use crate::task::PERIOD;
use crate::teacher::World;
use glam::DVec2;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Where a robot begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Base from above \[m\].
    pub place: [f64; 2],
    /// Its heading \[rad\].
    pub yaw: f64,
    /// For what differs from episode to episode.
    pub seed: u64,
}

/// How a robot moves at the moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The base in the world.
    pub world_from_base: Pose,
    /// Angular velocity in base axes \[rad/s\].
    pub gyro: [f64; 3],
    /// Whether it fell.
    pub fell: bool,
}

/// Many robots that follow commands.
pub trait Legs {
    /// How many there can be at once.
    fn count(&self) -> usize;
    /// Puts the first robots onto their places; there are at most [`Legs::count`].
    ///
    /// # Errors
    /// When there are too many, or a simulator refuses.
    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError>;
    /// Follows commands (forwards, to the left \[m/s\], turning \[rad/s\]) for [`PERIOD`]; robots that are not `active` may stand still. Both lists
    /// have [`Legs::count`] entries.
    ///
    /// # Errors
    /// When a simulator fails.
    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError>;
    /// How one moves.
    fn motion(&self, env: usize) -> Motion;
    /// Where the base was `ago` seconds ago, at most 0.3 s, to 20 ms; at the start where it began.
    fn past(&self, env: usize, ago: f64) -> Pose;
    /// Whether a step neither moves nor ages robots that are not active, and what an active one does does not depend on which others are. Then
    /// some go on while pictures of others are drawn, and a step has about half of the robots.
    fn are_apart(&self) -> bool {
        false
    }
}

/// Poses of the last 0.3 s, every 20 ms.
#[derive(Debug, Clone, Default)]
pub struct Past(VecDeque<Pose>);

/// Seconds from one kept pose to the next.
pub const TICK: f64 = 0.02;
/// Ticks of a decision.
pub(crate) const TICKS: usize = (PERIOD / TICK + 0.5) as usize;

impl Past {
    /// Forgets all but one pose.
    pub fn begin(&mut self, pose: Pose) {
        self.0.clear();
        self.0.push_back(pose);
    }

    /// Adds the pose after a tick.
    pub fn push(&mut self, pose: Pose) {
        self.0.push_back(pose);
        if self.0.len() > 16 {
            self.0.pop_front();
        }
    }

    /// The pose so many seconds before the last one.
    pub fn ago(&self, ago: f64) -> Pose {
        let back = (ago / TICK).round().max(0.0) as usize;
        let at = self.0.len().saturating_sub(1 + back);
        self.0.get(at).copied().unwrap_or(Pose::IDENTITY)
    }
}

/// What legs have that a training did not know of; each number is drawn for an episode between two bounds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Effects {
    /// Time from a command until it acts \[s\], at most 0.2, to 20 ms.
    pub latency: [f64; 2],
    /// Factor on all velocities.
    pub strength: [f64; 2],
    /// Deviation of a velocity that comes and goes within half a second, forwards and to the left \[m/s\]; of the turning rate, twice as much
    /// \[rad/s\].
    pub slip: [f64; 2],
}

impl Default for Effects {
    fn default() -> Self {
        Self { latency: [0.0; 2], strength: [1.0; 2], slip: [0.0; 2] }
    }
}

impl Effects {
    /// Those of the second world.
    pub fn hidden() -> Self {
        Self { latency: [0.04, 0.12], strength: [0.75, 0.95], slip: [0.02, 0.06] }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the first that means nothing.
    pub fn check(&self) -> Result<(), NavError> {
        for (what, bounds, most) in
            [("latency", self.latency, 0.2), ("strength", self.strength, 2.0), ("slip", self.slip, 1.0)]
        {
            check_bounds(what, bounds, most)?;
        }
        Ok(())
    }
}

/// How the velocity of a [`Follower`] follows its command: as a first-order lag. Each number is drawn for an episode between two bounds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Response {
    /// What the velocities forwards, to the left and turning are multiplied with.
    pub gains: [[f64; 2]; 3],
    /// Time constant \[s\]; with 0 a command is motion at once.
    pub lag: [f64; 2],
}

impl Default for Response {
    /// As legs walk that are known within some bounds.
    fn default() -> Self {
        Self { gains: [[0.85, 1.1], [0.8, 1.1], [0.85, 1.1]], lag: [0.08, 0.25] }
    }
}

impl Response {
    /// That of ideal legs: they do at once what they are reported.
    pub fn ideal() -> Self {
        Self { gains: [[1.0; 2]; 3], lag: [0.0; 2] }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the first that means nothing.
    pub fn check(&self) -> Result<(), NavError> {
        let gains = ["forwards", "to the left", "turning"].map(|axis| format!("gain {axis}"));
        for (what, bounds) in gains.iter().map(String::as_str).zip(self.gains).chain([("lag", self.lag)]) {
            check_bounds(what, bounds, 2.0)?;
        }
        Ok(())
    }
}

/// Whether two bounds are in order, from 0 to `most`.
fn check_bounds(what: &str, bounds: [f64; 2], most: f64) -> Result<(), NavError> {
    if 0.0 <= bounds[0] && bounds[0] <= bounds[1] && bounds[1] <= most {
        return Ok(());
    }
    let expected = format!("two numbers of 0 to {most}, the first not greater");
    Err(NavError::value(what, &expected, format!("{bounds:?}")))
}

/// Robots whose velocity follows the command as a first-order lag does, on the map's heights, with a sway as of walking. Nothing stops them
/// but the judge: there is no physics in this.
pub struct Follower<'a> {
    ground: Ground<'a>,
    robots: Vec<One>,
    height: f64,
    response: Response,
    effects: Effects,
}

/// Whose map a follower walks on.
enum Ground<'a> {
    Borrowed(&'a Map),
    Shared(Arc<World>),
}

impl Ground<'_> {
    fn map(&self) -> &Map {
        match self {
            Self::Borrowed(map) => map,
            Self::Shared(world) => &world.map,
        }
    }
}

#[derive(Debug, Clone, Default)]
struct One {
    place: DVec2,
    yaw: f64,
    velocity: [f64; 3],
    /// What each velocity is multiplied with, and the lag \[s\].
    gains: [f64; 3],
    lag: f64,
    phase: f64,
    gyro: [f64; 3],
    past: Past,
    /// Commands that wait, one for each tick of the latency.
    waiting: VecDeque<[f64; 3]>,
    /// Deviation of the slip, and the slip now.
    slip: (f64, [f64; 3]),
    random: Option<Xoshiro256PlusPlus>,
}

/// Time in which a slip is forgotten \[s\].
const SLIP_TIME: f64 = 0.5;

impl<'a> Follower<'a> {
    /// `count` robots whose base is `height` over the ground \[m\].
    pub fn new(map: &'a Map, count: usize, height: f64) -> Self {
        Self::on(Ground::Borrowed(map), count, height)
    }

    fn on(ground: Ground<'a>, count: usize, height: f64) -> Self {
        let robots = vec![One::default(); count];
        Self { ground, robots, height, response: Response::default(), effects: Effects::default() }
    }

    /// The same with effects that a training did not know of.
    ///
    /// # Errors
    /// When they mean nothing.
    pub fn with_effects(map: &'a Map, count: usize, height: f64, effects: Effects) -> Result<Self, NavError> {
        Self::new(map, count, height).suffering(effects)
    }

    /// These legs with effects.
    ///
    /// # Errors
    /// When they mean nothing.
    pub fn suffering(self, effects: Effects) -> Result<Self, NavError> {
        effects.check()?;
        Ok(Self { effects, ..self })
    }

    /// These legs, following commands in another way.
    ///
    /// # Errors
    /// When it means nothing.
    pub fn responding(self, response: Response) -> Result<Self, NavError> {
        response.check()?;
        Ok(Self { response, ..self })
    }
}

impl Follower<'static> {
    /// As [`Follower::new`], for who keeps the world and the legs together.
    pub fn shared(world: Arc<World>, count: usize, height: f64) -> Self {
        Self::on(Ground::Shared(world), count, height)
    }
}

impl One {
    fn pose(&self, map: &Map, height: f64) -> Pose {
        let [sway, bob, nod] = [self.phase, 2.0 * self.phase + 0.6, 2.0 * self.phase].map(f64::sin);
        let forwards = DVec2::from_angle(self.yaw);
        let under = |p: DVec2| map.height(p);
        let here = under(self.place).unwrap_or(0.0);
        let rise = match (under(self.place + 0.2 * forwards), under(self.place - 0.2 * forwards)) {
            (Some(a), Some(b)) if (a - b).abs() < 0.15 => ((a - b) / 0.4).atan(),
            _ => 0.0,
        };
        let position = [self.place.x, self.place.y, here + height + 0.006 * bob];
        Pose::from_xyz_rpy(position, [0.02 * sway, 0.015 * nod - rise, self.yaw])
    }

    /// Draws the effects of an episode.
    fn suffer(&mut self, effects: &Effects, seed: u64) {
        // A stream of its own: without effects, all is as it was.
        let mut random = Xoshiro256PlusPlus::of(seed, 84, 0);
        let mut between = |[low, high]: [f64; 2]| f64::from(random.between(low as f32, high as f32));
        let (latency, strength) = (between(effects.latency), between(effects.strength));
        self.slip = (between(effects.slip), [0.0; 3]);
        self.gains = self.gains.map(|gain| gain * strength);
        self.waiting = std::iter::repeat_n([0.0; 3], (latency / TICK).round() as usize).collect();
        self.random = Some(random);
    }

    /// The slip after a tick: noise of the first order whose deviation stays as it was drawn.
    fn slide(&mut self) {
        let Some(random) = self.random.as_mut().filter(|_| self.slip.0 > 0.0) else { return };
        let kept = (-TICK / SLIP_TIME).exp();
        for (k, slip) in self.slip.1.iter_mut().enumerate() {
            let deviation = self.slip.0 * if k == 2 { 2.0 } else { 1.0 };
            *slip = kept * *slip + (1.0 - kept * kept).sqrt() * deviation * f64::from(random.normal());
        }
    }

    fn tick(&mut self, map: &Map, height: f64, command: [f64; 3]) {
        self.waiting.push_back(command);
        let command = self.waiting.pop_front().unwrap_or(command);
        let share = 1.0 - (-TICK / self.lag).exp();
        for k in 0..3 {
            self.velocity[k] += share * (self.gains[k] * command[k] - self.velocity[k]);
        }
        self.slide();
        let [ahead, aside, turning] = std::array::from_fn(|k| self.velocity[k] + self.slip.1[k]);
        let before = self.past.ago(0.0);
        self.yaw += TICK * turning;
        self.place += TICK * DVec2::from_angle(self.yaw).rotate(DVec2::new(ahead, aside));
        // Steps twice a second, in place as well.
        self.phase += TICK * TAU * 2.0;
        let pose = self.pose(map, height);
        let turn = before.rotation.conjugate() * pose.rotation;
        let half = if turn.w < 0.0 { -1.0 } else { 1.0 };
        self.gyro = [turn.x, turn.y, turn.z].map(|x| 2.0 * half * x / TICK);
        self.past.push(pose);
    }
}

/// Whether there are robots for all starts.
///
/// # Errors
/// There are more starts than robots.
pub(crate) fn check_starts(starts: &[Start], robots: usize) -> Result<(), NavError> {
    match starts.len() <= robots {
        true => Ok(()),
        false => Err(NavError::value("starts", &format!("at most {robots}"), starts.len())),
    }
}

impl Legs for Follower<'_> {
    fn count(&self) -> usize {
        self.robots.len()
    }

    fn begin(&mut self, starts: &[Start]) -> Result<(), NavError> {
        check_starts(starts, self.robots.len())?;
        for (robot, start) in self.robots.iter_mut().zip(starts) {
            let mut random = Xoshiro256PlusPlus::of(start.seed, 83, 0);
            let mut between = |[low, high]: [f64; 2]| f64::from(random.between(low as f32, high as f32));
            *robot = One {
                place: DVec2::from(start.place),
                yaw: start.yaw,
                gains: self.response.gains.map(&mut between),
                lag: between(self.response.lag),
                phase: between([0.0, TAU]),
                ..One::default()
            };
            robot.suffer(&self.effects, start.seed);
            robot.past.begin(robot.pose(self.ground.map(), self.height));
        }
        Ok(())
    }

    fn step(&mut self, commands: &[[f64; 3]], active: &[bool]) -> Result<(), NavError> {
        let (map, height) = (self.ground.map(), self.height);
        let work = self.robots.par_iter_mut().zip(commands).zip(active).filter(|(_, active)| **active);
        work.for_each(|((robot, command), _)| (0..TICKS).for_each(|_| robot.tick(map, height, *command)));
        Ok(())
    }

    fn are_apart(&self) -> bool {
        true
    }

    fn motion(&self, env: usize) -> Motion {
        let robot = &self.robots[env];
        Motion { world_from_base: robot.past.ago(0.0), gyro: robot.gyro, fell: false }
    }

    fn past(&self, env: usize, ago: f64) -> Pose {
        self.robots[env].past.ago(ago)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::map::MapSettings;
    use glam::DVec3;
    use qv_core::TriangleMesh;

    fn plane() -> Map {
        let corners = [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mesh = TriangleMesh { vertices: corners.to_vec(), triangles, ..Default::default() };
        Map::new(&mesh, &MapSettings::default()).unwrap()
    }

    /// Way after a second of driving ahead \[m\], and place to the side.
    fn driven(effects: Effects) -> [f64; 2] {
        let map = plane();
        let mut legs = Follower::with_effects(&map, 1, 0.3, effects).unwrap();
        legs.begin(&[Start { place: [0.0; 2], yaw: 0.0, seed: 5 }]).unwrap();
        for _ in 0..5 {
            legs.step(&[[0.5, 0.0, 0.0]], &[true]).unwrap();
        }
        let p = legs.motion(0).world_from_base.position;
        [p.x, p.y]
    }

    #[test]
    fn effects_delay_weaken_and_push_aside() {
        let plain = driven(Effects::default());
        let mut weak = Effects { strength: [0.8; 2], ..Effects::default() };
        assert!((driven(weak)[0] / plain[0] - 0.8).abs() < 1e-6 && plain[1] == 0.0);
        weak = Effects { latency: [0.1; 2], ..Effects::default() };
        // Five ticks late: at the end it went at about the full speed.
        let late = plain[0] - driven(weak)[0];
        assert!((0.035..0.056).contains(&late), "{late}");
        let slipped = driven(Effects { slip: [0.05; 2], ..Effects::default() });
        assert!(slipped[1].abs() > 1e-3 && slipped[1].abs() < 0.2, "{slipped:?}");
        assert_eq!(slipped, driven(Effects { slip: [0.05; 2], ..Effects::default() }));
        let bad = Effects { latency: [0.1, 9.0], ..Effects::default() };
        assert!(bad.check().unwrap_err().to_string().contains("latency"));
    }
    #[test]
    fn ideal_legs_do_at_once_what_they_are_told() {
        let map = plane();
        let mut legs = Follower::new(&map, 1, 0.3).responding(Response::ideal()).unwrap();
        legs.begin(&[Start { place: [0.0; 2], yaw: 0.0, seed: 5 }]).unwrap();
        legs.step(&[[0.5, -0.2, 0.0]], &[true]).unwrap();
        let p = legs.motion(0).world_from_base.position;
        assert!((p.x - 0.5 * PERIOD).abs() < 1e-9 && (p.y + 0.2 * PERIOD).abs() < 1e-9, "{p}");
        legs.step(&[[0.0, 0.0, 1.0]], &[true]).unwrap();
        let after = legs.motion(0).world_from_base;
        assert!((after.position.x - p.x).abs() < 1e-9 && (after.yaw() - PERIOD).abs() < 1e-6, "{after:?}");
        let bad = Response { lag: [0.3, 0.1], ..Response::default() };
        let said = Follower::new(&map, 1, 0.3).responding(bad).err().unwrap().to_string();
        assert!(said.states("numbers 0 2"), "{said}");
    }
}
