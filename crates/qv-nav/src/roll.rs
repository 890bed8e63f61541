//! Episodes rolled: many robots at once, each with its camera, its teacher and its judge.

use crate::NavError;
use crate::eye::{Eye, Shot};
use crate::legs::{Legs, Start};
use crate::lens::{Lens, LensSpread};
use crate::net::{BEARINGS, KNOWN, STATE};
use crate::sight::Cone;
use crate::task::{DECISIONS, Episode, Judge, Trial};
use crate::teacher::{Advice, Teacher, World};
use glam::DVec2;
use qv_core::Pose;
use rayon::prelude::*;

/// What a pilot knows at a decision.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// Which robot.
    pub env: usize,
    /// Picture, `[HEIGHT][WIDTH][3]`.
    pub picture: &'a [u8],
    /// Numbers beside it.
    pub state: &'a [f32; STATE],
    /// Colour of the cone that is wanted.
    pub colour: usize,
    /// What the teacher says: for the teacher alone.
    pub advice: &'a Advice,
}

/// Decides where robots go.
pub trait Pilot {
    /// A robot begins an episode.
    fn begin(&mut self, env: usize, episode: &Episode);
    /// Commands as shares of their limits, one for each of `seen`.
    fn decide(&mut self, seen: &[Seen]) -> Vec<[f32; 3]>;
}

/// Where episodes are rolled.
pub struct Stage<'a> {
    /// Map and teacher's knowledge.
    pub world: &'a World,
    /// Draws pictures.
    pub eye: &'a dyn Eye,
    /// How cameras differ.
    pub spread: LensSpread,
}

/// What a network can learn from an episode, one entry for each decision.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Pictures.
    pub pictures: Vec<u8>,
    /// `[decisions][STATE]`.
    pub states: Vec<f32>,
    /// The teacher's command as shares of its limits.
    pub commands: Vec<[f32; 3]>,
    /// Sine and cosine of the cone's bearing, logarithm of its distance \[m\], 1 if it is in view.
    pub cones: Vec<[f32; 4]>,
    /// Whether the cone had been found, so that its bearing can be known.
    pub found: Vec<bool>,
    /// See [`crate::net::KNOWN`]: the place on the map, the heading, the cone's place, and room along some bearings.
    pub known: Vec<[f32; KNOWN]>,
}

impl Record {
    /// Decisions.
    pub fn len(&self) -> usize {
        self.commands.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.commands.is_empty()
    }
}

/// One robot on its way.
struct Run<'a> {
    episode: &'a Episode,
    teacher: Teacher,
    judge: Judge,
    lens: Lens,
    cones: Vec<Cone>,
    last: [f64; 3],
    over: bool,
    record: Record,
}

/// Rolls episodes, as many at once as there are legs. Gives what came out of each, and its record where `keep` says so.
///
/// # Errors
/// When an eye or legs fail.
pub fn roll(
    stage: &Stage,
    legs: &mut dyn Legs,
    episodes: &[Episode],
    pilot: &mut dyn Pilot,
    keep: impl Fn(usize) -> bool,
    done: &mut dyn FnMut(usize),
) -> Result<Vec<(Trial, Record)>, NavError> {
    stage.spread.check()?;
    let mut out = Vec::with_capacity(episodes.len());
    for (k, batch) in episodes.chunks(legs.count().max(1)).enumerate() {
        let first = k * legs.count().max(1);
        out.extend(roll_batch(stage, legs, batch, pilot, |env| keep(first + env))?);
        done(out.len());
    }
    Ok(out)
}

fn roll_batch(
    stage: &Stage,
    legs: &mut dyn Legs,
    episodes: &[Episode],
    pilot: &mut dyn Pilot,
    keep: impl Fn(usize) -> bool,
) -> Result<Vec<(Trial, Record)>, NavError> {
    let start = |e: &Episode| Start { place: e.start, yaw: e.yaw, seed: e.seed };
    legs.begin(&episodes.iter().map(start).collect::<Vec<_>>())?;
    let mut runs: Vec<Run> = episodes
        .iter()
        .enumerate()
        .map(|(env, episode)| {
            pilot.begin(env, episode);
            Run {
                episode,
                teacher: Teacher::new(stage.world, &episode.others),
                judge: Judge::new(stage.world, episode),
                lens: stage.spread.draw(&stage.world.rig, episode.seed),
                cones: std::iter::once(episode.goal).chain(episode.others.iter().copied()).collect(),
                last: [0.0; 3],
                over: false,
                record: Record::default(),
            }
        })
        .collect();
    for step in 0..=DECISIONS {
        let motions: Vec<_> = (0..runs.len()).map(|env| legs.motion(env)).collect();
        let advice: Vec<Option<Advice>> = runs
            .par_iter_mut()
            .zip(&motions)
            .map(|(run, motion)| {
                (!run.over).then(|| advise(stage.world, run, &motion.world_from_base, motion.fell, step))
            })
            .collect();
        let live: Vec<usize> = (0..runs.len()).filter(|&env| !runs[env].over).collect();
        if live.is_empty() {
            break;
        }
        let shot = |&env: &usize| {
            let lens = &runs[env].lens;
            Shot { camera: lens.rig.camera(&legs.past(env, lens.delay)), cones: runs[env].cones.clone() }
        };
        let drawn = stage.eye.look(&live.iter().map(shot).collect::<Vec<_>>())?;
        let mut lenses: Vec<&mut Run> = runs.iter_mut().filter(|run| !run.over).collect();
        let pictures: Vec<Vec<u8>> =
            lenses.par_iter_mut().zip(&drawn).map(|(run, picture)| run.lens.bytes(picture)).collect();
        let states: Vec<[f32; STATE]> =
            live.iter().map(|&env| state(runs[env].episode, &motions[env].world_from_base)).collect();
        let told: Vec<Advice> = live.iter().filter_map(|&env| advice[env]).collect();
        let seen: Vec<Seen> = live
            .iter()
            .enumerate()
            .map(|(k, &env)| Seen {
                env,
                picture: &pictures[k],
                state: &states[k],
                colour: runs[env].episode.goal.colour,
                advice: &told[k],
            })
            .collect();
        let shares = pilot.decide(&seen);
        let mut commands = vec![[0.0; 3]; runs.len()];
        for (k, &env) in live.iter().enumerate() {
            if keep(env) {
                let known = known(stage.world, &motions[env].world_from_base, &runs[env].episode.goal);
                remember(&mut runs[env].record, (&pictures[k], &states[k]), &told[k], known, stage.world);
            }
            let wanted = stage.world.limits.command(shares[k]);
            runs[env].last = stage.world.limits.limited(runs[env].last, wanted);
            commands[env] = runs[env].last;
        }
        let active: Vec<bool> = runs.iter().map(|run| !run.over).collect();
        legs.step(&commands, &active)?;
    }
    Ok(runs.into_iter().map(|run| (run.judge.into_trial(), run.record)).collect())
}

/// The teacher's word, and the judge's.
fn advise(world: &World, run: &mut Run, base: &Pose, fell: bool, step: usize) -> Advice {
    let advice = run.teacher.advise(world, base, &run.episode.goal);
    run.over = run.judge.look(world, run.episode, base, step, (advice.in_view, fell)).is_some();
    advice
}

/// Numbers beside the picture, see [`STATE`].
pub fn state(episode: &Episode, base: &Pose) -> [f32; STATE] {
    let gravity = base.rotation.conjugate() * glam::DVec3::NEG_Z;
    let mut out = [0.0; STATE];
    out[episode.goal.colour.min(2)] = 1.0;
    for k in 0..3 {
        out[3 + k] = gravity[k] as f32;
    }
    let (sine, cosine) = (base.yaw() - episode.yaw).sin_cos();
    (out[6], out[7]) = (sine as f32, cosine as f32);
    out
}

/// What a network says besides in training, see [`KNOWN`].
fn known(world: &World, base: &Pose, goal: &Cone) -> [f32; KNOWN] {
    const FAR: f64 = 3.0;
    let [low, high] = world.map.bounds();
    let share = |p: DVec2| (2.0 * p - low - high) / (high - low);
    let p = base.position.truncate();
    let (here, there) = (share(p), share(goal.axis()));
    let (sine, cosine) = base.yaw().sin_cos();
    let mut out = [0.0; KNOWN];
    for (out, x) in out.iter_mut().zip([here.x, here.y, sine, cosine, there.x, there.y]) {
        *out = x as f32;
    }
    for (out, bearing) in out[6..].iter_mut().zip(BEARINGS) {
        *out = (world.map.clear(p, DVec2::from_angle(base.yaw() + bearing), FAR) / FAR) as f32;
    }
    out
}

fn remember(
    record: &mut Record,
    (picture, state): (&[u8], &[f32]),
    advice: &Advice,
    known: [f32; KNOWN],
    world: &World,
) {
    record.pictures.extend_from_slice(picture);
    record.states.extend_from_slice(state);
    record.commands.push(world.limits.shares(advice.command));
    let (sine, cosine) = advice.bearing.sin_cos();
    let visible = if advice.in_view { 1.0 } else { 0.0 };
    record.cones.push([sine as f32, cosine as f32, advice.distance.max(0.05).ln() as f32, visible]);
    record.found.push(advice.found);
    record.known.push(known);
}
