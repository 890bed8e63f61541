//! A network examined in a place: how often it reaches goals, beside who knows the place and who knows nothing, and what it says of pictures with
//! and without the goal.

use crate::NavError;
use crate::eye::{BlindEye, Eye, Shot};
use crate::goals::turn_hues;
use crate::legs::Follower;
use crate::lens::LensSpread;
use crate::map::standing;
use crate::net::{HIDDEN, Net, NetInput};
use crate::pilots::{BlobPilot, ConstantPilot, NetPilot, RandomPilot, TeacherPilot};
use crate::places::Site;
use crate::recall::RECALL;
use crate::roll::{Pilot, Stage, roll, state_of};
use crate::score::{Mean, Row, Share};
use crate::task::{End, Episode, Stratum, Trial};
use qv_core::random::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Height of a robot's base over the ground \[m\].
const HEIGHT: f64 = 0.3;

/// Who drives, in the order of the tables; the network first.
pub const PILOTS: [&str; 5] = ["policy", "expert", "blob follower", "constant", "random"];

/// How a network is examined in each place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExamSettings {
    /// Episodes.
    pub episodes: usize,
    /// Pictures without the goal; with it there are about as many.
    pub pictures: usize,
    /// Of episodes and pictures.
    pub seed: u64,
    /// How cameras differ.
    pub spread: LensSpread,
}

/// What came out of one place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Exam {
    /// The place.
    pub place: String,
    /// Its hash, in hexadecimal digits.
    pub hash: String,
    /// Trials of the same episodes, in the order of [`PILOTS`].
    pub trials: Vec<Vec<Trial>>,
    /// What was said of pictures, by the network and by the blob follower.
    pub said: [Answers; 2],
}

/// Answers to the question whether the goal is in a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answers {
    /// Pictures with the goal, and those in which it was seen.
    pub with: [usize; 2],
    /// Pictures without the goal, and those in which it was imagined.
    pub without: [usize; 2],
}

impl Answers {
    /// Both together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let sum = |a: [usize; 2], b: [usize; 2]| [a[0] + b[0], a[1] + b[1]];
        Self { with: sum(self.with, other.with), without: sum(self.without, other.without) }
    }

    /// Share of pictures with the goal in which it was seen.
    pub fn found(&self) -> Share {
        Share::of(self.with[1], self.with[0])
    }

    /// Share of pictures without the goal in which it was imagined.
    pub fn imagined(&self) -> Share {
        Share::of(self.without[1], self.without[0])
    }

    /// Mean of the shares of right answers with and without the goal: whoever always says the same, or guesses, has 0.5.
    pub fn balanced(&self) -> f64 {
        0.5 * (self.found().share + 1.0 - self.imagined().share)
    }
}

/// Figures of trials, as a table has them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExamRow {
    /// Success, its interval, ends, times.
    pub row: Row,
    /// Success weighted by path length.
    pub spl: Mean,
    /// Episodes that ended because the robot ran into something.
    pub collisions: Share,
    /// Episodes that ended because it pushed a goal or another object.
    pub pushed: Share,
    /// Way of the base in episodes in which the goal was reached \[m\].
    pub length: Mean,
}

impl ExamRow {
    /// Of trials.
    pub fn of(trials: &[Trial]) -> Self {
        let ended = |end: End| Share::of(trials.iter().filter(|t| t.end == end).count(), trials.len());
        let weighted = |t: &Trial| if t.reached() { t.shortest / t.length.max(t.shortest) } else { 0.0 };
        Self {
            row: Row::of(trials),
            spl: Mean::of(trials.iter().map(weighted)),
            collisions: ended(End::Collision),
            pushed: ended(End::Pushed),
            length: Mean::of(trials.iter().filter(|t| t.reached()).map(|t| t.length)),
        }
    }
}

/// Examines a network in a place.
///
/// # Errors
/// When no episode can be drawn, or the eye fails.
pub fn examine(site: &Site, net: &Net, parameters: &[f32], settings: &ExamSettings) -> Result<Exam, NavError> {
    let world = &site.world;
    let episodes = site.episodes(0.0).draw(world, settings.episodes, settings.seed)?;
    let count = episodes.len().clamp(1, 64);
    let limits = world.limits;
    let drive = |pilot: &mut dyn Pilot, sees: bool| -> Result<Vec<Trial>, NavError> {
        let blind = BlindEye;
        let eye: &dyn Eye = if sees { &*site.eye } else { &blind };
        let stage = Stage::new(world, eye, settings.spread);
        let mut legs = Follower::new(&world.map, count, HEIGHT);
        let rolled = roll(&stage, &mut legs, &episodes, pilot, |_| false, &mut |_| {})?;
        Ok(rolled.into_iter().map(|(trial, _)| trial).collect())
    };
    let trials = vec![
        drive(&mut NetPilot::new(net, parameters, count), true)?,
        drive(&mut TeacherPilot { limits }, false)?,
        drive(&mut BlobPilot { limits }, true)?,
        drive(&mut ConstantPilot::circling(&limits), false)?,
        drive(&mut RandomPilot::new(count), false)?,
    ];
    let said = ask(site, (net, parameters), settings)?;
    Ok(Exam { place: site.name.clone(), hash: format!("{:016x}", site.hash), trials, said })
}

/// What the network and the blob follower say of pictures: from where episodes begin, each once with the goal, if it is in view there, and once
/// without it. Other objects are there in half of them.
fn ask(site: &Site, (net, parameters): (&Net, &[f32]), settings: &ExamSettings) -> Result<[Answers; 2], NavError> {
    let seed = Xoshiro256PlusPlus::of(settings.seed, 72, site.hash).bits();
    let episodes = site.episodes(0.0).draw(&site.world, settings.pictures, seed)?;
    let mut said = [Answers::default(); 2];
    for with_goal in [true, false] {
        let asked: Vec<&Episode> = episodes.iter().filter(|e| !with_goal || e.stratum == Stratum::InView).collect();
        let pictures = pictures(site, &asked, with_goal, &settings.spread)?;
        let answers: Vec<[bool; 2]> = asked
            .par_iter()
            .zip(&pictures)
            .map(|(episode, picture)| {
                let hue = site.world.goals.hue(episode.goal.colour);
                let is_blob = BlobPilot::blob(picture, hue).0 >= BlobPilot::LEAST;
                [sees(site, (net, parameters), episode, picture), is_blob]
            })
            .collect();
        for (k, said) in said.iter_mut().enumerate() {
            let counts = [answers.len(), answers.iter().filter(|a| a[k]).count()];
            if with_goal {
                said.with = counts;
            } else {
                said.without = counts;
            }
        }
    }
    Ok(said)
}

/// Pictures from the starts of episodes, as their cameras take them.
fn pictures(
    site: &Site,
    episodes: &[&Episode],
    with_goal: bool,
    spread: &LensSpread,
) -> Result<Vec<Vec<u8>>, NavError> {
    let lenses: Vec<_> = episodes.iter().map(|e| spread.draw(&site.world.rig, e.seed)).collect();
    let shot = |(e, lens): (&&Episode, &crate::lens::Lens)| {
        let base = standing(&site.world.map, e.start.into(), e.yaw, HEIGHT);
        let goal = Some(e.goal).filter(|_| with_goal);
        let cones = goal.into_iter().chain(e.others.iter().copied()).collect();
        Shot { camera: lens.rig.camera(&base), cones, seed: e.seed }
    };
    let shots: Vec<Shot> = episodes.iter().zip(&lenses).map(shot).collect();
    let drawn = if shots.is_empty() { Vec::new() } else { site.eye.look(&shots)? };
    let seen = drawn.iter().zip(lenses).zip(episodes).map(|((picture, mut lens), episode)| {
        let mut bytes = lens.bytes(picture, [0.0; 3]);
        turn_hues(&mut bytes, site.world.goals.turn(episode.goal.colour));
        bytes
    });
    Ok(seen.collect())
}

/// Whether a network says that it sees the goal in a picture.
fn sees(site: &Site, (net, parameters): (&Net, &[f32]), episode: &Episode, picture: &[u8]) -> bool {
    let picture: Vec<f32> = picture.iter().map(|&b| f32::from(b)).collect();
    let base = standing(&site.world.map, episode.start.into(), episode.yaw, HEIGHT);
    let state = state_of(site.world.goals.code(episode.goal.colour), &base);
    let input = NetInput { picture: &picture, state: &state, recall: &[0.0; RECALL] };
    net.step(parameters, &input, &mut [0.0; HIDDEN], &mut net.scratch()).sight[3] > 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::{Role, SiteSettings, number};

    #[test]
    fn who_knows_the_place_arrives_and_who_says_always_yes_is_no_better_than_a_guess() {
        let (site, eye) = Site::drawn(number(Role::Test, 5, 1), &SiteSettings::default()).unwrap();
        let site = site.seen_by(Box::new(eye));
        let net = Net::default();
        let parameters = net.draw(&mut Xoshiro256PlusPlus::new(1));
        let settings = ExamSettings { episodes: 6, pictures: 12, seed: 3, spread: LensSpread::none() };
        let exam = examine(&site, &net, &parameters, &settings).unwrap();
        assert_eq!(exam.trials.len(), PILOTS.len());
        let rows: Vec<ExamRow> = exam.trials.iter().map(|trials| ExamRow::of(trials)).collect();
        assert!(rows.iter().all(|row| row.row.episodes == 6));
        assert!(rows[1].row.reached >= 5, "the expert: {:?}", rows[1].row);
        assert!(rows[3].row.reached <= 2 && rows[4].row.reached <= 2, "who knows nothing");
        assert!(rows[1].spl.value > 0.4 && rows[1].length.n == rows[1].row.reached);
        let [network, blob] = exam.said;
        assert_eq!((network.with[0], network.without[0]), (blob.with[0], blob.without[0]));
        assert!(network.without[0] == 12 && network.with[0] >= 4);
        let always = Answers { with: [10, 10], without: [20, 20] };
        assert_eq!(always.balanced(), 0.5);
        assert_eq!(always.and(always).imagined().n, 40);
    }
}
