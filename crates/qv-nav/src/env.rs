//! The task one decision at a time, many robots at once: for learners of other programs, which bring their own loop.

use crate::NavError;
use crate::eye::{Eye, Shot};
use crate::legs::{Effects, Follower, Legs, Response, Start};
use crate::lens::{Lens, LensSpread};
use crate::map::Field;
use crate::net::{HEIGHT, WIDTH};
use crate::sight::{COLOURS, Cone, SEEN, free_rays};
use crate::task::{End, Episode, EpisodeSettings, Judge, Stratum};
use crate::teacher::World;
use glam::DVec3;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use rayon::prelude::*;
use std::sync::Arc;

/// Bytes of a picture, `[HEIGHT][WIDTH][3]`.
pub const PICTURE: usize = WIDTH * HEIGHT * 3;
/// Numbers beside a picture: colour of the wanted cone as one of three, direction of gravity in the base, sine and
/// cosine of the heading since the start.
pub const BESIDE: usize = COLOURS.len() + 5;
/// Numbers of an action: shares of the limits of a command, see [`crate::task::Limits::command`].
pub const ACTION: usize = 3;
/// What a goal that was reached adds to the metres of its decision.
pub const REACHED: f32 = 5.0;
/// What a collision, a pushed cone or a fall takes from them.
pub const FAILED: f32 = 2.0;

/// What an end adds to the metres of its decision.
pub(crate) fn worth(end: End) -> f32 {
    match end {
        End::Reached => REACHED,
        End::Collision | End::Pushed | End::Fell => -FAILED,
        End::Slow | End::Lost | End::NeverSeen => 0.0,
    }
}

/// How a task is made.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskSettings {
    /// How many robots there are.
    pub count: usize,
    /// Height of a base over the ground \[m\].
    pub height: f64,
    /// How cameras differ.
    pub spread: LensSpread,
    /// How legs follow commands.
    pub response: Response,
    /// What legs have beside that.
    pub effects: Effects,
    /// How episodes are drawn.
    pub episodes: EpisodeSettings,
}

impl Default for TaskSettings {
    fn default() -> Self {
        Self {
            count: 1,
            height: 0.3,
            spread: LensSpread::wide(),
            response: Response::default(),
            effects: Effects::default(),
            episodes: EpisodeSettings::default(),
        }
    }
}

/// Many robots, each in an episode of its own. What is drawn depends on the seed, the robot and the number of its
/// episode alone, so the same actions give the same bits on any number of threads.
pub struct NavTask {
    world: Arc<World>,
    eye: Box<dyn Eye + Send>,
    settings: TaskSettings,
    seed: u64,
    lanes: Vec<Lane>,
}

/// One robot.
struct Lane {
    episode: Episode,
    /// Lengths of ways to the goal, and that from where the robot was last \[m\].
    to_goal: Field,
    left: f64,
    judge: Judge,
    lens: Lens,
    cones: Vec<Cone>,
    legs: Follower<'static>,
    /// The last command.
    last: [f64; 3],
    step: usize,
    end: Option<End>,
    /// Episodes that it began before this one.
    before: u64,
}

impl NavTask {
    /// All robots at the start of their first episode.
    ///
    /// # Errors
    /// There is no robot, a setting means nothing, or the place has no such episodes.
    pub fn new(world: World, eye: Box<dyn Eye + Send>, settings: TaskSettings, seed: u64) -> Result<Self, NavError> {
        if settings.count == 0 {
            return Err(NavError::value("robots", "at least one", 0));
        }
        settings.spread.check()?;
        settings.response.check()?;
        settings.effects.check()?;
        let mut task = Self { world: Arc::new(world), eye, settings, seed, lanes: Vec::new() };
        task.restart(seed)?;
        Ok(task)
    }

    /// How many robots there are.
    pub fn count(&self) -> usize {
        self.lanes.len()
    }

    /// The place.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The episode of a robot.
    pub fn episode(&self, env: usize) -> &Episode {
        &self.lanes[env].episode
    }

    /// Where the base of a robot is in the world.
    pub fn base(&self, env: usize) -> Pose {
        self.lanes[env].legs.motion(0).world_from_base
    }

    /// All episodes anew, of this seed.
    ///
    /// # Errors
    /// The place has no such episodes.
    pub fn restart(&mut self, seed: u64) -> Result<(), NavError> {
        self.seed = seed;
        let lanes = (0..self.settings.count).into_par_iter().map(|env| self.begun(env, 0));
        self.lanes = lanes.collect::<Result<_, _>>()?;
        Ok(())
    }

    /// The next episode of each robot of the mask.
    ///
    /// # Errors
    /// The mask has another length, or the place has no such episodes.
    pub fn reset(&mut self, mask: &[bool]) -> Result<(), NavError> {
        self.check("mask", mask.len(), 1)?;
        let which: Vec<usize> = (0..mask.len()).filter(|&env| mask[env]).collect();
        let begun: Vec<Lane> = which
            .par_iter()
            .map(|&env| self.begun(env, self.lanes[env].before + 1))
            .collect::<Result<_, NavError>>()?;
        for (env, lane) in which.into_iter().zip(begun) {
            self.lanes[env] = lane;
        }
        Ok(())
    }

    /// A robot at the start of an episode.
    fn begun(&self, env: usize, before: u64) -> Result<Lane, NavError> {
        let drawn = Xoshiro256PlusPlus::of(self.seed, 90, env as u64 + (before << 24)).bits();
        let all = &self.settings.episodes;
        // Goals in view, out of the picture and hidden come in turn, for each robot and beside each other.
        let stratum: Vec<Stratum> = match all.strata.len() {
            0 => Vec::new(),
            count => vec![all.strata[(env + before as usize) % count]],
        };
        let settings = EpisodeSettings { strata: stratum, ..all.clone() };
        let episode = settings.draw(&self.world, 1, drawn)?.swap_remove(0);
        let mut legs = Follower::shared(Arc::clone(&self.world), 1, self.settings.height)
            .responding(self.settings.response)?
            .suffering(self.settings.effects)?;
        legs.begin(&[Start { place: episode.start, yaw: episode.yaw, seed: episode.seed }])?;
        let to_goal = self.world.map.lengths(episode.goal.axis());
        let mut lane = Lane {
            left: episode.geodesic,
            to_goal,
            judge: Judge::new(&self.world, &episode),
            lens: self.settings.spread.draw(&self.world.rig, episode.seed),
            cones: std::iter::once(episode.goal).chain(episode.others.iter().copied()).collect(),
            legs,
            last: [0.0; 3],
            step: 0,
            end: None,
            before,
            episode,
        };
        lane.look(&self.world);
        Ok(lane)
    }

    /// What robots of the mask see: pictures as bytes, `[robots][HEIGHT][WIDTH][3]`, and numbers, `[robots][BESIDE]`.
    /// What stands in the arrays for others stays.
    ///
    /// # Errors
    /// A length is another, or a picture cannot be drawn.
    pub fn observe(&mut self, mask: &[bool], pictures: &mut [u8], beside: &mut [f32]) -> Result<(), NavError> {
        self.check("mask", mask.len(), 1)?;
        self.check("pictures", pictures.len(), PICTURE)?;
        self.check("numbers beside them", beside.len(), BESIDE)?;
        let shots: Vec<Shot> =
            self.lanes.iter().zip(mask).filter(|(_, wanted)| **wanted).map(|(l, _)| l.shot()).collect();
        let drawn = self.eye.look(&shots)?;
        let rows = pictures.chunks_exact_mut(PICTURE).zip(beside.chunks_exact_mut(BESIDE));
        let seeing = self.lanes.iter_mut().zip(rows).zip(mask).filter(|(_, wanted)| **wanted);
        let work: Vec<_> = seeing.map(|(one, _)| one).zip(drawn).collect();
        work.into_par_iter().for_each(|((lane, (picture, beside)), drawn)| {
            let gyro = lane.legs.motion(0).gyro;
            picture.copy_from_slice(&lane.lens.bytes(&drawn, gyro));
            beside.copy_from_slice(&lane.beside());
        });
        Ok(())
    }

    /// One decision of each robot. `actions` are shares of the limits of commands, `[robots][ACTION]`, -1 to 1. Rewards
    /// are metres of the shortest way to the goal that were gained, and [`REACHED`] or [`FAILED`] at an end. A robot
    /// whose episode is over stands still until it is reset, and gets nothing.
    ///
    /// # Errors
    /// A length is another, or an action is not finite.
    pub fn step(&mut self, actions: &[f32], rewards: &mut [f32], ends: &mut [Option<End>]) -> Result<(), NavError> {
        self.check("actions", actions.len(), ACTION)?;
        self.check("rewards", rewards.len(), 1)?;
        self.check("ends", ends.len(), 1)?;
        if let Some(k) = actions.iter().position(|a| !a.is_finite()) {
            let what = format!("action {} of robot {}", k % ACTION, k / ACTION);
            return Err(NavError::value(&what, "-1 to 1", actions[k]));
        }
        let world = &self.world;
        let rows = actions.par_chunks_exact(ACTION).zip(rewards).zip(ends);
        self.lanes.par_iter_mut().zip(rows).try_for_each(|(lane, ((action, reward), end))| {
            *reward = if lane.end.is_some() { 0.0 } else { lane.go(world, [action[0], action[1], action[2]])? };
            *end = lane.end;
            Ok(())
        })
    }

    fn check(&self, what: &str, found: usize, of_one: usize) -> Result<(), NavError> {
        let expected = self.lanes.len() * of_one;
        if found == expected { Ok(()) } else { Err(NavError::value(what, &expected.to_string(), found)) }
    }
}

impl Lane {
    /// One decision: what it is worth.
    fn go(&mut self, world: &World, shares: [f32; 3]) -> Result<f32, NavError> {
        self.last = world.limits.limited(self.last, world.limits.command(shares));
        self.legs.step(&[self.last], &[true])?;
        self.step += 1;
        self.look(world);
        let place = self.legs.motion(0).world_from_base.position.truncate();
        let left = world.map.at(&self.to_goal, place);
        // Where there is too little room, no way is known: what is gained there counts once there is one again.
        let mut gained = 0.0;
        if left.is_finite() {
            gained = self.left - left;
            self.left = left;
        }
        Ok(gained as f32 + self.end.map_or(0.0, worth))
    }

    /// The judge's word.
    fn look(&mut self, world: &World) {
        let motion = self.legs.motion(0);
        let camera = world.rig.camera(&motion.world_from_base);
        let in_view = free_rays(&world.map, &camera, &self.episode.goal, true) >= SEEN;
        let seen = (in_view, motion.fell);
        self.end = self.judge.look(world, &self.episode, &motion.world_from_base, self.step, seen);
    }

    fn shot(&self) -> Shot {
        let camera = self.lens.rig.camera(&self.legs.past(0, self.lens.delay));
        Shot { camera, cones: self.cones.clone(), seed: self.episode.seed }
    }

    /// See [`BESIDE`].
    fn beside(&self) -> [f32; BESIDE] {
        let base = self.legs.motion(0).world_from_base;
        let gravity = base.rotation.conjugate() * DVec3::NEG_Z;
        let (sine, cosine) = (base.yaw() - self.episode.yaw).sin_cos();
        let mut out = [0.0; BESIDE];
        out[self.episode.goal.colour.min(COLOURS.len() - 1)] = 1.0;
        let rest = [gravity.x, gravity.y, gravity.z, sine, cosine];
        out[COLOURS.len()..].iter_mut().zip(rest).for_each(|(out, x)| *out = x as f32);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eye::BlindEye;
    use crate::facts::States;
    use crate::map::{Map, MapSettings};
    use crate::sight::Rig;
    use crate::task::Limits;
    use crate::teacher::Teacher;
    use qv_core::TriangleMesh;

    /// Seven by seven metres with a box of 1 x 1 m in the middle.
    fn place() -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for (half, z) in [(3.5, 0.0), (0.5, 0.6)] {
            let first = mesh.vertices.len() as u32;
            let corners = [(-half, -half), (half, -half), (half, half), (-half, half)];
            mesh.vertices.extend(corners.map(|(x, y)| DVec3::new(x, y, z)));
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        mesh
    }

    fn task(count: usize, seed: u64) -> NavTask {
        let map = Map::new(&place(), &MapSettings::default()).unwrap();
        let world = World::new(map, Rig::default(), Limits::default());
        let episodes = EpisodeSettings { strata: vec![Stratum::InView, Stratum::Turned], ..Default::default() };
        let settings = TaskSettings { count, spread: LensSpread::none(), episodes, ..Default::default() };
        NavTask::new(world, Box::new(BlindEye), settings, seed).unwrap()
    }

    #[test]
    fn the_teacher_reaches_goals_and_is_paid_for_the_way() {
        let mut task = task(8, 3);
        let mut teachers: Vec<Teacher> =
            (0..8).map(|env| Teacher::new(task.world(), &task.episode(env).others)).collect();
        let (mut paid, mut rewards, mut ends) = ([0.0; 8], [0.0; 8], [None; 8]);
        while ends.iter().any(Option::is_none) {
            let actions: Vec<f32> = (0..8)
                .flat_map(|env| {
                    let (base, goal) = (task.base(env), task.episode(env).goal);
                    let advice = teachers[env].advise(task.world(), &base, &goal);
                    task.world().limits.shares(advice.command)
                })
                .collect();
            task.step(&actions, &mut rewards, &mut ends).unwrap();
            paid.iter_mut().zip(rewards).for_each(|(sum, reward)| *sum += f64::from(reward));
        }
        let reached: Vec<usize> = (0..8).filter(|&env| ends[env] == Some(End::Reached)).collect();
        assert!(reached.len() >= 7, "{ends:?}");
        for env in reached {
            // The base ends a head's length and what counts as near before the axis.
            let way = task.episode(env).geodesic - (paid[env] - f64::from(REACHED));
            assert!((0.3..0.9).contains(&way), "{way} m are left of {}", task.episode(env).geodesic);
        }
        task.step(&[0.0; 24], &mut rewards, &mut ends).unwrap();
        assert!(rewards == [0.0; 8] && ends.iter().all(Option::is_some), "who ended waits");
        let mask: [bool; 8] = std::array::from_fn(|env| env == 2);
        let (old, other) = (task.episode(2).clone(), task.episode(3).clone());
        task.reset(&mask).unwrap();
        assert!(*task.episode(2) != old && *task.episode(3) == other);
        assert_eq!(task.episode(2).stratum, Stratum::Turned, "the kinds come in turn");
    }

    #[test]
    fn straight_on_ends_in_a_collision_that_costs() {
        let mut task = task(4, 5);
        let (mut rewards, mut ends, mut last) = ([0.0; 4], [None; 4], [0.0; 4]);
        for _ in 0..130 {
            let is_over = ends.map(|end: Option<End>| end.is_some());
            task.step(&[1.0, 0.0, 0.0].repeat(4), &mut rewards, &mut ends).unwrap();
            (0..4).filter(|&env| !is_over[env]).for_each(|env| last[env] = rewards[env]);
        }
        for (end, reward) in ends.iter().zip(last) {
            let bad = matches!(end, Some(End::Collision | End::Pushed));
            assert!(bad && reward < -1.5, "{end:?} {reward}");
        }
    }

    #[test]
    fn pictures_fill_their_rows_and_seeds_are_bits() {
        let seen = |seed| {
            let mut task = task(3, seed);
            let (mut pictures, mut beside) = (vec![0; 3 * PICTURE], vec![0.0; 3 * BESIDE]);
            task.observe(&[true, false, true], &mut pictures, &mut beside).unwrap();
            assert!(
                pictures[..PICTURE].iter().all(|b| *b == 128) && pictures[PICTURE..2 * PICTURE].iter().all(|b| *b == 0)
            );
            assert!(
                beside[..3].iter().sum::<f32>() == 1.0 && beside[BESIDE - 2].abs() < 1e-6 && beside[BESIDE - 1] == 1.0
            );
            (pictures, beside, task.episode(1).clone())
        };
        assert_eq!(seen(7), seen(7));
        assert_ne!(seen(7).2, seen(8).2);
    }

    #[test]
    fn what_means_nothing_is_refused() {
        let mut task = task(2, 1);
        let (mut rewards, mut ends) = ([0.0; 2], [None; 2]);
        let said = task.step(&[0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0], &mut rewards, &mut ends).unwrap_err().to_string();
        assert!(said.states("1 1 -1 1 NaN"), "{said}");
        assert!(task.step(&[0.0; 5], &mut rewards, &mut ends).unwrap_err().to_string().states("expected 6 5"));
        assert!(task.reset(&[true]).is_err());
    }
}
