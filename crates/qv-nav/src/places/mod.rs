//! Places drawn from seeds: yards and rooms with walls, clutter, materials and goals, so that a network learns in many places and is tested in
//! others.
//!
//! A place has a number. Trainings draw numbers below [`FIRST_TESTED`], tests draw from there on, so no seed makes them share one. Each place has
//! a hash of its geometry, too ([`Site::hash`]): a test compares those of its places with those of the training ([`TrainingPlaces`]) and refuses.

mod layout;
mod looks;

pub use layout::{Kind, Layout, Solid, Surface, hash_of};

use crate::NavError;
use crate::eye::{Eye, SplatEye};
use crate::goals::{Goal, GoalKind, GoalSet};
use crate::legs::{Follower, Legs};
use crate::lens::LensSpread;
use crate::map::{Map, MapSettings};
use crate::roll::Stage;
use crate::sight::Rig;
use crate::task::{EpisodeSettings, Limits, Stratum};
use crate::teacher::{TeacherSettings, World};
use qv_core::random::{Xoshiro256PlusPlus, scrambled, sub_seed};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Number of the first place of tests; those of trainings are less.
pub const FIRST_TESTED: u64 = 1 << 63;
/// Least free ground of a place \[m²\].
const LEAST: f64 = 6.0;
/// Height of a robot's base over the ground \[m\].
const HEIGHT: f64 = 0.3;

/// What a place is drawn for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// To learn in.
    Training,
    /// To be tested in.
    Test,
}

/// The number of a place: the `index`th of a seed.
pub fn number(role: Role, seed: u64, index: u64) -> u64 {
    let drawn = scrambled(sub_seed(seed, index));
    match role {
        Role::Training => drawn & (FIRST_TESTED - 1),
        Role::Test => drawn | FIRST_TESTED,
    }
}

/// Which goals a place has, and how the camera sits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiteSettings {
    /// Shapes and hues; none for cones of three colours that are commanded by name.
    pub goals: Option<GoalKind>,
    /// How many.
    pub count: usize,
    /// The camera.
    pub rig: Rig,
}

impl Default for SiteSettings {
    fn default() -> Self {
        Self { goals: Some(GoalKind::Trained), count: 8, rig: Rig::default() }
    }
}

/// A place that is ready.
pub struct Site {
    /// How it is called in tables.
    pub name: String,
    /// Map, goals and the expert's knowledge.
    pub world: World,
    /// What draws it.
    pub eye: Box<dyn Eye>,
    /// Of its geometry, see [`Layout::hash`]; of other places, of their files.
    pub hash: u64,
    /// Where goals can be when an episode begins.
    pub strata: Vec<Stratum>,
    /// Least and greatest length of the way to a goal \[m\].
    pub geodesic: [f64; 2],
}

/// Lengths of ways to a goal: those of a usual place, and of a small one \[m\].
const LENGTHS: [[f64; 2]; 2] = [[2.5, 7.0], [1.0, 7.0]];

impl Site {
    /// A place that is not drawn, such as a reconstruction. Where ways are short, goals are nearer.
    ///
    /// # Errors
    /// When no episode can be drawn in it.
    pub fn given(
        (name, hash): (String, u64),
        map: Map,
        (rig, teacher): (Rig, TeacherSettings),
        goals: GoalSet,
        eye: Box<dyn Eye>,
    ) -> Result<Self, NavError> {
        for geodesic in LENGTHS {
            let teacher = TeacherSettings { geodesic, ..teacher };
            let world = World::with(map.clone(), rig, Limits::default(), teacher).among_many(goals.clone());
            let strata = strata_of(&world, geodesic);
            if !strata.is_empty() {
                return Ok(Self { name, world, eye, hash, strata, geodesic });
            }
        }
        let [_, [least, most]] = LENGTHS;
        let expected = format!("free ground with ways of {least} to {most} m");
        Err(NavError::value(&format!("place '{name}'"), &expected, "none"))
    }

    /// The place of a number. What cannot be walked in is drawn again.
    ///
    /// # Errors
    /// When twenty draws in a row gave no place with enough room.
    pub fn drawn(number: u64, settings: &SiteSettings) -> Result<(Self, SplatEye), NavError> {
        for attempt in 0..20 {
            let mut random = Xoshiro256PlusPlus::of(number, 70, attempt);
            let layout = Layout::draw(&mut random);
            let surface = layout.surface();
            let Ok(map) = Map::new(&surface.mesh, &MapSettings::default()) else { continue };
            let free = map.places(0.1, 0.32).len() as f64 * 0.01;
            if free < LEAST || map.places(0.1, 0.5).is_empty() {
                continue;
            }
            let looks = looks::draw(&layout, &surface, &mut random);
            let (goals, eye) = match settings.goals {
                None => (GoalSet::named(), SplatEye::new(&looks.cloud)),
                Some(kind) => {
                    let goals = Goal::draw(kind, settings.count.max(1), &mut random);
                    let eye = SplatEye::with_goals(vec![looks.cloud], &goals, random.bits());
                    (GoalSet::of(goals), eye)
                }
            };
            let world = World::new(map, settings.rig, Limits::default());
            let world = world.among_many(goals);
            let strata = strata_of(&world, LENGTHS[0]);
            if strata.is_empty() {
                continue;
            }
            let name = format!("{} {:016x}", if layout.is_room { "room" } else { "yard" }, layout.hash());
            let eye = eye.as_made(Some(looks.background), false);
            let site = Self {
                name,
                world,
                eye: Box::new(crate::eye::BlindEye),
                hash: layout.hash(),
                strata,
                geodesic: LENGTHS[0],
            };
            return Ok((site, eye));
        }
        Err(NavError::value("place", "one of twenty draws with room to walk", format!("none for number {number}")))
    }

    /// The same with an eye.
    pub fn seen_by(self, eye: Box<dyn Eye>) -> Self {
        Self { eye, ..self }
    }

    /// Episodes as they are drawn here.
    pub fn episodes(&self, absent: f32) -> EpisodeSettings {
        EpisodeSettings { strata: self.strata.clone(), geodesic: self.geodesic, absent, ..EpisodeSettings::default() }
    }
}

/// Kinds of starts that a place has.
fn strata_of(world: &World, geodesic: [f64; 2]) -> Vec<Stratum> {
    let can = |stratum: &Stratum| {
        let settings = EpisodeSettings { strata: vec![*stratum], geodesic, ..EpisodeSettings::default() };
        settings.draw(world, 1, 0).is_ok()
    };
    Stratum::ALL.into_iter().filter(can).collect()
}

/// Where a training takes place: one place after another.
pub trait Sites: Sync {
    /// Calls `visit` in the place that a number stands for, with legs and episodes for it.
    ///
    /// # Errors
    /// When the place cannot be drawn, or `visit` fails.
    fn visit(&self, number: u64, visit: &mut Visit) -> Result<(), NavError>;
}

/// What is done in a place.
pub type Visit<'a> = dyn FnMut(&Stage, &mut dyn Legs, &EpisodeSettings) -> Result<(), NavError> + 'a;

/// What draws the pictures of drawn places.
pub enum PlaceEyes {
    /// The processor.
    Processor,
    /// A graphics card. Its pictures differ from those of the processor by rounding.
    #[cfg(feature = "gpu")]
    Card(Box<crate::card::GpuEyes>),
}

impl PlaceEyes {
    fn lend(&self, eye: &SplatEye, visit: &mut dyn FnMut(&dyn Eye) -> Result<(), NavError>) -> Result<(), NavError> {
        match self {
            Self::Processor => visit(eye),
            #[cfg(feature = "gpu")]
            Self::Card(eyes) => eyes.lend(eye, visit),
        }
    }
}

/// Drawn places, and others that are given, such as reconstructions.
pub struct ManySites {
    /// How places are drawn.
    pub settings: SiteSettings,
    /// Of the numbers of places.
    pub seed: u64,
    /// Number of different drawn places.
    pub count: u64,
    /// Places that are given.
    pub given: Vec<Site>,
    /// Share of the visits that go to them.
    pub share_given: f32,
    /// How cameras differ.
    pub spread: LensSpread,
    /// What draws the drawn places; those that are given have eyes of their own.
    pub eyes: PlaceEyes,
    /// Robots at once in a place.
    pub robots: usize,
    /// Share of episodes without the goal.
    pub absent: f32,
    /// Hashes of all places that were visited, and the numbers of those that are drawn.
    pub visited: Mutex<BTreeMap<u64, Option<u64>>>,
}

impl ManySites {
    /// In which places a training has been.
    pub fn trained(&self) -> TrainingPlaces {
        TrainingPlaces::new(self.seed, self.count, &self.visited.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn at(&self, site: &Site, eye: &dyn Eye, number: Option<u64>, visit: &mut Visit) -> Result<(), NavError> {
        self.visited.lock().unwrap_or_else(PoisonError::into_inner).insert(site.hash, number);
        let stage = Stage::new(&site.world, eye, self.spread);
        let mut legs = Follower::new(&site.world.map, self.robots, HEIGHT);
        visit(&stage, &mut legs, &site.episodes(self.absent))
    }
}

impl Sites for ManySites {
    fn visit(&self, number: u64, visit: &mut Visit) -> Result<(), NavError> {
        let mut random = Xoshiro256PlusPlus::of(number, 71, 0);
        if !self.given.is_empty() && random.unit() < self.share_given {
            let site = &self.given[random.below(self.given.len())];
            return self.at(site, &*site.eye, None, visit);
        }
        let index = random.bits() % self.count.max(1);
        let drawn = self::number(Role::Training, self.seed, index);
        let (site, eye) = Site::drawn(drawn, &self.settings)?;
        self.eyes.lend(&eye, &mut |eye| self.at(&site, eye, Some(drawn), visit))
    }
}

/// In which places a network was trained.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingPlaces {
    /// Always [`TrainingPlaces::FORMAT`].
    pub format: String,
    /// Of the drawn places.
    pub seed: u64,
    /// Number of different drawn places.
    pub count: u64,
    /// Hashes of all places that were visited, in hexadecimal digits, and the numbers of those that are drawn.
    pub places: BTreeMap<String, Option<u64>>,
}

impl TrainingPlaces {
    /// What its files say of themselves.
    pub const FORMAT: &'static str = "qv-navigate-places/1";

    /// What was visited.
    pub fn new(seed: u64, count: u64, visited: &BTreeMap<u64, Option<u64>>) -> Self {
        let places = visited.iter().map(|(hash, number)| (format!("{hash:016x}"), *number)).collect();
        Self { format: Self::FORMAT.into(), seed, count, places }
    }

    /// Hashes and numbers.
    pub fn visited(&self) -> BTreeMap<u64, Option<u64>> {
        let read = |(hash, number): (&String, &Option<u64>)| Some((u64::from_str_radix(hash, 16).ok()?, *number));
        self.places.iter().filter_map(read).collect()
    }

    /// Numbers of the drawn places.
    pub fn numbers(&self) -> impl Iterator<Item = u64> + '_ {
        self.places.values().flatten().copied()
    }

    /// Refuses places of the training.
    ///
    /// # Errors
    /// Names the first that is one.
    pub fn check_unseen(&self, sites: &[Site]) -> Result<(), NavError> {
        let visited = self.visited();
        match sites.iter().find(|site| visited.contains_key(&site.hash)) {
            None => Ok(()),
            Some(site) => {
                let expected = "a place in which the network was not trained";
                Err(NavError::value(&format!("place '{}'", site.name), expected, "one in which it was"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eye::Shot;
    use crate::map::standing;
    use crate::net::{HEIGHT as ROWS, WIDTH};

    #[test]
    fn places_of_trainings_and_tests_are_disjoint_and_the_hash_refuses() {
        let numbers = |role| (0..500).map(|k| number(role, 3, k)).collect::<std::collections::BTreeSet<u64>>();
        let (training, test) = (numbers(Role::Training), numbers(Role::Test));
        assert!(training.len() == 500 && test.len() == 500 && training.is_disjoint(&test));
        assert!(training.iter().all(|n| *n < FIRST_TESTED) && test.iter().all(|n| *n >= FIRST_TESTED));
        let (a, _) = Site::drawn(number(Role::Training, 3, 0), &SiteSettings::default()).unwrap();
        let (b, _) = Site::drawn(number(Role::Test, 3, 0), &SiteSettings::default()).unwrap();
        assert_ne!(a.hash, b.hash);
        let trained = TrainingPlaces::new(3, 1, &BTreeMap::from([(a.hash, Some(5))]));
        let text = serde_json::to_string(&trained).unwrap();
        let trained: TrainingPlaces = serde_json::from_str(&text).unwrap();
        assert_eq!(trained.numbers().collect::<Vec<_>>(), [5]);
        trained.check_unseen(std::slice::from_ref(&b)).unwrap();
        let error = trained.check_unseen(&[b, a]).unwrap_err().to_string();
        assert!(error.contains("not trained"), "{error}");
    }

    #[test]
    fn a_place_is_its_number_and_can_be_walked_and_seen() {
        let settings = SiteSettings::default();
        for index in 0..4 {
            let number = number(Role::Training, 1, index);
            let (site, eye) = Site::drawn(number, &settings).unwrap();
            let (again, _) = Site::drawn(number, &settings).unwrap();
            assert_eq!((site.hash, &site.world.goals), (again.hash, &again.world.goals));
            let episodes = site.episodes(0.5).draw(&site.world, 12, 7).unwrap();
            let absent = episodes.iter().filter(|e| e.is_absent).count();
            assert!((1..12).contains(&absent), "{absent}");
            assert!(episodes.iter().all(|e| e.others.iter().all(|o| o.colour != e.goal.colour)));
            // A goal in view changes pixels towards its colour.
            let Some(seen) = episodes.iter().find(|e| e.stratum == Stratum::InView) else { continue };
            let base = standing(&site.world.map, seen.start.into(), seen.yaw, 0.3);
            let shot = |cones| Shot { camera: site.world.rig.camera(&base), cones, seed: seen.seed };
            let pictures = eye.look(&[shot(vec![seen.goal]), shot(vec![])]).unwrap();
            let changed = pictures[0].chunks(3).zip(pictures[1].chunks(3)).filter(|(a, b)| a != b).count();
            assert!(changed > 4 && changed < WIDTH * ROWS / 2, "{changed}");
        }
    }
}
