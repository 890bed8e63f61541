//! The task: episodes drawn from a seed, what counts as reached, and why others failed.

use crate::NavError;
pub use crate::limits::{Limits, TAIL};
pub use crate::map::standing;
use crate::sight::{COLOURS, Cone, SEEN, free_rays};
use crate::teacher::World;
use glam::{DVec2, DVec3};
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Seconds from one decision to the next.
pub const PERIOD: f64 = 0.2;
/// Most decisions of an episode: 25 s.
pub const DECISIONS: usize = 125;
/// The head must be so near the cone's axis \[m\].
pub const NEAR: f64 = 0.35;
/// And slower than this \[m/s\].
pub const SLOW: f64 = 0.2;
/// Most decisions of an episode without its goal: 10 s.
const SEARCHED: usize = 50;
/// For so many decisions after the first: 0.6 s.
const HELD: usize = 3;
/// A cone is pushed when its axis comes so near the line from tail to head \[m\].
const PUSHED: f64 = 0.15;
/// The robot has collided when there is so little room at any place of that line \[m\].
const STRUCK: f64 = 0.08;

/// Where the cone is at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stratum {
    /// In the picture.
    InView,
    /// Behind or beside the robot, with nothing between.
    Turned,
    /// Behind a box or another obstacle.
    Hidden,
}

impl Stratum {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::InView, Self::Turned, Self::Hidden];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::InView => "in view",
            Self::Turned => "out of the picture",
            Self::Hidden => "hidden",
        }
    }
}

/// One episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Where the base starts \[m\].
    pub start: [f64; 2],
    /// Its heading \[rad\].
    pub yaw: f64,
    /// The cone to be reached.
    pub goal: Cone,
    /// Cones of other colours.
    pub others: Vec<Cone>,
    /// Where the goal is at the start.
    pub stratum: Stratum,
    /// Length of the shortest way from the start to the goal \[m\].
    pub geodesic: f64,
    /// For all that is drawn during the episode.
    pub seed: u64,
    /// Whether the goal is not there: nothing is to be found, and nothing should be said to be.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_absent: bool,
}

/// How episodes are drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EpisodeSettings {
    /// Least and greatest length of the way \[m\].
    pub geodesic: [f64; 2],
    /// Room at the start \[m\].
    pub room: f64,
    /// Height of the cones \[m\] and how much it varies, as a share.
    pub height: [f64; 2],
    /// Looks of each colour that the eye has.
    pub looks: usize,
    /// Where the goal is at the start, in turn.
    pub strata: Vec<Stratum>,
    /// Share of episodes without the goal.
    #[serde(default)]
    pub absent: f32,
}

impl Default for EpisodeSettings {
    fn default() -> Self {
        Self {
            geodesic: [2.5, 7.0],
            room: 0.5,
            height: [0.45, 0.05],
            looks: 4,
            strata: Stratum::ALL.to_vec(),
            absent: 0.0,
        }
    }
}

impl EpisodeSettings {
    /// `count` episodes, of each stratum in turn. The first `n` are the same for every count.
    ///
    /// # Errors
    /// When a range means nothing, or the place has no such episodes.
    pub fn draw(&self, world: &World, count: usize, seed: u64) -> Result<Vec<Episode>, NavError> {
        let [least, most] = self.geodesic;
        if !(least > 0.0 && most > least) {
            return Err(NavError::value("geodesic", "two lengths, the first less", format!("{least}, {most}")));
        }
        if self.strata.is_empty() {
            return Err(NavError::value("strata", "at least one", "none"));
        }
        let starts = world.map.places(0.1, self.room);
        if starts.is_empty() || world.candidates.is_empty() {
            return Err(NavError::value("map", "places to start and for cones", "none"));
        }
        // One of each kind first: what cannot be drawn takes long to find out.
        let kinds = count.min(self.strata.len());
        let mut drawn: Vec<_> = (0..kinds).map(|k| self.one(world, &starts, k, seed)).collect::<Result<_, _>>()?;
        let rest: Vec<_> = (kinds..count).into_par_iter().map(|k| self.one(world, &starts, k, seed)).collect();
        for episode in rest {
            drawn.push(episode?);
        }
        Ok(drawn)
    }

    fn one(&self, world: &World, starts: &[DVec2], index: usize, seed: u64) -> Result<Episode, NavError> {
        let mut random = Xoshiro256PlusPlus::of(seed, 81, index as u64);
        let stratum = self.strata[index % self.strata.len()];
        for _ in 0..400 {
            let start = starts[random.below(starts.len())];
            let lengths = world.map.lengths(start);
            for _ in 0..40 {
                let goal = world.candidates[random.below(world.candidates.len())];
                let yaw = f64::from(random.between(-PI as f32, PI as f32));
                let geodesic = world.map.at(&lengths, goal.truncate());
                if !(self.geodesic[0]..=self.geodesic[1]).contains(&geodesic) {
                    continue;
                }
                let colour = random.below(world.goals.len());
                let goal = self.cone(world, goal, colour, &mut random);
                if stratum_of(world, start, yaw, &goal) != Some(stratum) {
                    continue;
                }
                let others = self.others(world, start, &goal, &mut random);
                let seed = random.bits();
                let is_absent = Xoshiro256PlusPlus::of(seed, 82, index as u64).unit() < self.absent;
                return Ok(Episode { start: start.to_array(), yaw, goal, others, stratum, geodesic, seed, is_absent });
            }
        }
        let expected = format!("an episode with the cone {}", stratum.name());
        let found = "none in 16 000 tries: leave this kind of goal out, or use a place with room for it (a goal is hidden by what is higher than \
                     the camera)";
        Err(NavError::value("map", &expected, found))
    }

    fn cone(&self, world: &World, place: DVec3, colour: usize, random: &mut Xoshiro256PlusPlus) -> Cone {
        let [height, share] = self.height;
        // Goals that are drawn one by one have the height that they have.
        let share = if world.goals.height(colour).is_some() { 0.0 } else { share };
        Cone {
            place: place.to_array(),
            height: world.goals.height(colour).unwrap_or(height) * (1.0 + share * f64::from(random.between(-1.0, 1.0))),
            colour,
            look: random.below(self.looks.max(1)),
            turn: f64::from(random.between(-PI as f32, PI as f32)),
        }
    }

    /// In half of the episodes, two cones of the other colours, away from the start and the goal.
    fn others(&self, world: &World, start: DVec2, goal: &Cone, random: &mut Xoshiro256PlusPlus) -> Vec<Cone> {
        let mut others: Vec<Cone> = Vec::new();
        if random.unit() < 0.5 {
            return others;
        }
        let apart = (0..world.goals.len()).filter(|&c| world.goals.are_apart(c, goal.colour));
        for colour in some(apart.collect(), COLOURS.len() - 1, random) {
            for _ in 0..50 {
                let place = world.candidates[random.below(world.candidates.len())];
                let p = place.truncate();
                // A robot must get past it.
                if world.map.room(p) < 0.75 {
                    continue;
                }
                let clear = others.iter().chain([goal]).all(|c| c.axis().distance(p) > 0.9);
                if clear && p.distance(start) > 0.9 {
                    others.push(self.cone(world, place, colour, random));
                    break;
                }
            }
        }
        others
    }
}

/// So many of a list, drawn; all of them in their order if there are no more.
fn some(mut all: Vec<usize>, count: usize, random: &mut Xoshiro256PlusPlus) -> Vec<usize> {
    while all.len() > count {
        all.swap_remove(random.below(all.len()));
    }
    all
}

fn stratum_of(world: &World, start: DVec2, yaw: f64, goal: &Cone) -> Option<Stratum> {
    let camera = world.rig.camera(&standing(&world.map, start, yaw, 0.3));
    let free = free_rays(&world.map, &camera, goal, false);
    if free_rays(&world.map, &camera, goal, true) >= SEEN {
        Some(Stratum::InView)
    } else if free >= SEEN {
        // Turned to it, the camera stands elsewhere: it must see it there, too.
        let there = (goal.axis() - start).to_angle();
        let camera = world.rig.camera(&standing(&world.map, start, there, 0.3));
        (free_rays(&world.map, &camera, goal, true) >= SEEN).then_some(Stratum::Turned)
    } else if free == 0 {
        Some(Stratum::Hidden)
    } else {
        None
    }
}

/// How an episode ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// The head stood near the cone.
    Reached,
    /// Time was over, and the cone had never been in view.
    NeverSeen,
    /// Time was over, and the cone had not been in view for 5 s.
    Lost,
    /// Time was over with the cone in view.
    Slow,
    /// The robot ran into something.
    Collision,
    /// The robot pushed a cone.
    Pushed,
    /// The robot fell.
    Fell,
}

impl End {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Reached, Self::NeverSeen, Self::Lost, Self::Slow, Self::Collision, Self::Pushed, Self::Fell];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::NeverSeen => "never seen",
            Self::Lost => "lost",
            Self::Slow => "slow",
            Self::Collision => "collision",
            Self::Pushed => "cone pushed",
            Self::Fell => "fell",
        }
    }
}

/// What came out of one episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// How it ended.
    pub end: End,
    /// When \[s\].
    pub time: f64,
    /// Length of the base's way \[m\].
    pub length: f64,
    /// Length of the shortest way that ends with the head near the cone \[m\].
    pub shortest: f64,
    /// Least distance of the head from the cone's axis \[m\].
    pub nearest: f64,
    /// When the cone was in view first \[s\].
    pub seen: Option<f64>,
    /// Base at each decision: x, y \[m\], yaw \[rad\].
    pub track: Vec<[f32; 3]>,
}

impl Trial {
    /// Whether the cone was reached.
    pub fn reached(&self) -> bool {
        self.end == End::Reached
    }
}

/// Judges one episode while it runs.
#[derive(Debug, Clone)]
pub struct Judge {
    held: usize,
    last_seen: Option<usize>,
    trial: Trial,
}

impl Judge {
    /// At the start.
    pub fn new(world: &World, episode: &Episode) -> Self {
        let shortest = (episode.geodesic - world.rig.head - NEAR).max(0.1);
        let (end, track) = (End::Slow, Vec::new());
        let trial = Trial { end, time: 0.0, length: 0.0, shortest, nearest: f64::INFINITY, seen: None, track };
        Self { held: 0, last_seen: None, trial }
    }

    /// Looks at the base at decision `step`; `in_view` says whether the goal is. Gives the end, once there is one.
    pub fn look(
        &mut self,
        world: &World,
        episode: &Episode,
        base: &Pose,
        step: usize,
        (in_view, fell): (bool, bool),
    ) -> Option<End> {
        let p = base.position.truncate();
        let trial = &mut self.trial;
        let moved = trial.track.last().map_or(0.0, |l| DVec2::new(f64::from(l[0]), f64::from(l[1])).distance(p));
        trial.track.push([p.x as f32, p.y as f32, base.yaw() as f32]);
        trial.length += moved;
        trial.time = step as f64 * PERIOD;
        if in_view {
            self.last_seen = Some(step);
            trial.seen = trial.seen.or(Some(trial.time));
        }
        let head = world.rig.head(base);
        // What is not there can be neither reached nor pushed.
        let goal = Some(&episode.goal).filter(|_| !episode.is_absent);
        let most = if episode.is_absent { SEARCHED } else { DECISIONS };
        let away = goal.map_or(f64::INFINITY, |goal| head.distance(goal.axis()));
        trial.nearest = trial.nearest.min(away);
        self.held = if away <= NEAR && moved / PERIOD < SLOW { self.held + 1 } else { 0 };
        let tail = p - TAIL * DVec2::from_angle(base.yaw());
        let struck = |k: i32| world.map.room(tail.lerp(head, f64::from(k) / 4.0)) < STRUCK;
        let pushed = |c: &Cone| distance_to_segment(c.axis(), tail, head) < PUSHED;
        let end = if fell {
            Some(End::Fell)
        } else if (0..=4).any(struck) {
            Some(End::Collision)
        } else if episode.others.iter().chain(goal).any(pushed) {
            Some(End::Pushed)
        } else if self.held > HELD {
            Some(End::Reached)
        } else if step >= most {
            let recent = self.last_seen.map(|seen| step - seen < (5.0 / PERIOD) as usize);
            Some(recent.map_or(End::NeverSeen, |recent| if recent { End::Slow } else { End::Lost }))
        } else {
            None
        };
        if let Some(end) = end {
            trial.end = end;
        }
        end
    }

    /// What came out.
    pub(crate) fn into_trial(self) -> Trial {
        self.trial
    }
}

fn distance_to_segment(p: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
    p.distance(a.lerp(b, along))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_and_shares_are_inverse() {
        let limits = Limits::default();
        let command = [0.35, -0.1, 0.7];
        let back = limits.command(limits.shares(command));
        assert!(back.iter().zip(command).all(|(a, b)| (a - b).abs() < 1e-6), "{back:?}");
        let least = limits.command([-1.0, 0.0, 1.0]);
        assert!((least[0] + 0.2).abs() < 1e-12 && least[1..] == [0.0, 1.0], "{least:?}");
        assert_eq!(limits.limited([0.0; 3], [0.6, 0.0, -1.0]), [0.3, 0.0, -1.0]);
    }

    #[test]
    fn segments() {
        let (a, b) = (DVec2::ZERO, DVec2::new(2.0, 0.0));
        assert_eq!(distance_to_segment(DVec2::new(1.0, 0.5), a, b), 0.5);
        assert_eq!(distance_to_segment(DVec2::new(3.0, 0.0), a, b), 1.0);
    }
}
