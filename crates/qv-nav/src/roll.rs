//! Episodes rolled: many robots at once, each with its camera, its teacher and its judge.

use crate::NavError;
use crate::eye::{Eye, Shot};
use crate::legs::{Legs, Start};
use crate::lens::{Lens, LensSpread};
use crate::net::{KNOWN, RAYS, SIGHT, STATE};
use crate::recall::{CAMERA, Drift, FARTHEST, NEAREST, Odometer, Planar, RECALL, Recall, doubtful, ray};
use crate::reflex::Reflex;
use crate::sight::{Cone, SEEN, free_rays};
use crate::task::{DECISIONS, Episode, Judge, PERIOD, Trial};
use crate::teacher::{Advice, Teacher, World};
use crate::tune::Acted;
use glam::DVec2;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
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
    /// What the robot recalls.
    pub recall: &'a [f32; RECALL],
    /// Colour of the cone that is wanted.
    pub colour: usize,
    /// What the teacher says: for the teacher alone.
    pub advice: &'a Advice,
}

/// What a pilot says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// The command as shares of its limits.
    pub command: [f32; 3],
    /// What it says of the picture, which the robot then recalls. Without it, the robot recalls the truth with errors
    /// ([`crate::recall::doubtful`]): for the teacher, and for the first decisions of a training.
    pub sight: Option<[f32; SIGHT]>,
}

/// Decides where robots go.
pub trait Pilot {
    /// A robot begins an episode.
    fn begin(&mut self, env: usize, episode: &Episode);
    /// One for each of `seen`.
    fn decide(&mut self, seen: &[Seen]) -> Vec<Decision>;
}

/// Where episodes are rolled.
pub struct Stage<'a> {
    /// Map and teacher's knowledge.
    pub world: &'a World,
    /// Draws pictures.
    pub eye: &'a dyn Eye,
    /// How cameras differ.
    pub spread: LensSpread,
    /// How odometry errs.
    pub drift: Drift,
    /// How a robot whose network speaks keeps away from what it recalls.
    pub reflex: Reflex,
}

impl<'a> Stage<'a> {
    /// With odometry as it usually errs, and robots that keep away as they usually do.
    pub fn new(world: &'a World, eye: &'a dyn Eye, spread: LensSpread) -> Self {
        Self { world, eye, spread, drift: Drift::default(), reflex: Reflex::default() }
    }
}

/// What a network can learn from an episode, one entry for each decision.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Pictures.
    pub pictures: Vec<u8>,
    /// `[decisions][STATE]`.
    pub states: Vec<f32>,
    /// `[decisions][RECALL]`.
    pub recalls: Vec<f32>,
    /// What a network should say of the pictures, see [`SIGHT`].
    pub sights: Vec<[f32; SIGHT]>,
    /// The teacher's command as shares of its limits.
    pub commands: Vec<[f32; 3]>,
    /// Sine and cosine of the cone's bearing, logarithm of its distance \[m\], 1 if it is in view.
    pub cones: Vec<[f32; 4]>,
    /// Whether the cone had been found, so that its bearing can be known.
    pub found: Vec<bool>,
    /// See [`crate::net::KNOWN`]: the place on the map, the heading, the cone's place.
    pub known: Vec<[f32; KNOWN]>,
    /// What the student did where it learns by PPO; empty otherwise.
    pub acted: Vec<Acted>,
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
    odometer: Odometer,
    recall: Recall,
    random: Xoshiro256PlusPlus,
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
    let [low, high] = stage.world.map.bounds();
    let middle = 0.5 * (low + high);
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
                odometer: Odometer::new(&stage.drift, Planar::of(&legs.motion(env).world_from_base), episode.seed),
                recall: Recall::new(high - middle),
                random: Xoshiro256PlusPlus::of(episode.seed, 89, 0),
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
        let pasts: Vec<Pose> = (0..runs.len()).map(|env| legs.past(env, runs[env].lens.delay)).collect();
        let shot = |&env: &usize| {
            let run = &runs[env];
            Shot { camera: run.lens.rig.camera(&pasts[env]), cones: run.cones.clone(), seed: run.episode.seed }
        };
        let drawn = stage.eye.look(&live.iter().map(shot).collect::<Vec<_>>())?;
        let mut lenses: Vec<&mut Run> = runs.iter_mut().filter(|run| !run.over).collect();
        let gyros: Vec<[f64; 3]> = live.iter().map(|&env| motions[env].gyro).collect();
        let work = lenses.par_iter_mut().zip(&drawn).zip(&gyros);
        let pictures: Vec<Vec<u8>> = work.map(|((run, picture), gyro)| run.lens.bytes(picture, *gyro)).collect();
        let states: Vec<[f32; STATE]> =
            live.iter().map(|&env| state(runs[env].episode, &motions[env].world_from_base)).collect();
        let recalls: Vec<[f32; RECALL]> = runs
            .par_iter_mut()
            .zip(&motions)
            .filter(|(run, _)| !run.over)
            .map(|(run, motion)| {
                run.odometer.go(Planar::of(&motion.world_from_base), PERIOD);
                run.recall.go(run.odometer.pose);
                run.recall.features()
            })
            .collect();
        let told: Vec<Advice> = live.iter().filter_map(|&env| advice[env]).collect();
        let seen: Vec<Seen> = live
            .iter()
            .enumerate()
            .map(|(k, &env)| Seen {
                env,
                picture: &pictures[k],
                state: &states[k],
                recall: &recalls[k],
                colour: runs[env].episode.goal.colour,
                advice: &told[k],
            })
            .collect();
        let decisions = pilot.decide(&seen);
        let mut commands = vec![[0.0; 3]; runs.len()];
        let truth = |&env: &usize| sight(stage.world, &pasts[env], &runs[env].episode.goal, &runs[env].episode.others);
        let truths: Vec<[f32; SIGHT]> = live.par_iter().map(truth).collect();
        for (k, &env) in live.iter().enumerate() {
            if keep(env) {
                let known = known(stage.world, &motions[env].world_from_base, &runs[env].episode.goal);
                let record = &mut runs[env].record;
                record.pictures.extend_from_slice(&pictures[k]);
                record.states.extend(states[k]);
                record.recalls.extend(recalls[k]);
                record.sights.push(truths[k]);
                remember(record, &told[k], known, stage.world);
            }
            let mut wanted = stage.world.limits.command(decisions[k].command);
            if decisions[k].sight.is_some() {
                let head = stage.world.rig.head;
                wanted = stage.reflex.apply(&runs[env].recall, head, &stage.world.limits, wanted);
            }
            runs[env].last = stage.world.limits.limited(runs[env].last, wanted);
            commands[env] = runs[env].last;
        }
        let said: Vec<_> = decisions.iter().zip(&truths).collect();
        let mut driven: Vec<&mut Run> = runs.iter_mut().filter(|run| !run.over).collect();
        driven.par_iter_mut().zip(said).for_each(|(run, (decision, truth))| {
            let sight = decision.sight.unwrap_or_else(|| doubtful(truth, &mut run.random));
            run.recall.see(&sight);
        });
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
    state_of(episode.goal.colour, base)
}

/// The same for the colour of a goal.
pub fn state_of(colour: usize, base: &Pose) -> [f32; STATE] {
    let gravity = base.rotation.conjugate() * glam::DVec3::NEG_Z;
    let mut out = [0.0; STATE];
    out[colour.min(2)] = 1.0;
    for k in 0..3 {
        out[3 + k] = gravity[k] as f32;
    }
    out
}

/// A place in shares of the map's half sides, from its middle.
fn share(world: &World, p: DVec2) -> DVec2 {
    let [low, high] = world.map.bounds();
    (2.0 * p - low - high) / (high - low)
}

/// What a network says besides in training, see [`KNOWN`].
fn known(world: &World, base: &Pose, goal: &Cone) -> [f32; KNOWN] {
    let (here, there) = (share(world, base.position.truncate()), share(world, goal.axis()));
    let (sine, cosine) = base.yaw().sin_cos();
    [here.x, here.y, sine, cosine, there.x, there.y].map(|x| x as f32)
}

/// What a network should say of a picture that was taken at a pose of the base, see [`SIGHT`]. Other cones than the goal block.
pub fn sight(world: &World, base: &Pose, goal: &Cone, others: &[Cone]) -> [f32; SIGHT] {
    let camera = world.rig.camera(base);
    let to = Planar::of(base).into_frame(goal.axis());
    let distance = to.length().max(NEAREST);
    let visible = free_rays(&world.map, &camera, goal, true) >= SEEN;
    let here = share(world, base.position.truncate());
    let (sine, cosine) = base.yaw().sin_cos();
    let first = [
        to.y / distance,
        to.x / distance,
        distance.ln(),
        if visible { 1.0 } else { 0.0 },
        here.x,
        here.y,
        sine,
        cosine,
    ];
    let mut out = [0.0; SIGHT];
    out.iter_mut().zip(first).for_each(|(out, x)| *out = x as f32);
    let foot = Planar::of(base).out(DVec2::new(CAMERA, 0.0));
    let eye = foot.extend(world.map.height(foot).unwrap_or(0.0) + world.teacher.eye);
    for k in 0..RAYS {
        let along = DVec2::from_angle(base.yaw() + ray(k));
        let free = others.iter().filter_map(|c| before_disc(c.axis() - foot, along, c.radius()));
        let walk = free.fold(world.map.clear(foot, along, FARTHEST), f64::min);
        let view = world.map.in_sight(eye, along, world.teacher.looked_for, FARTHEST);
        out[8 + k] = walk.max(NEAREST).ln() as f32;
        out[8 + RAYS + k] = view.max(NEAREST).ln() as f32;
    }
    out
}

/// Distance along a direction to a disc; none when the ray misses it.
fn before_disc(middle: DVec2, along: DVec2, radius: f64) -> Option<f64> {
    // Half a ray's step more, or a thin cone would stand between two rays.
    let (ahead, aside) = (middle.dot(along), middle.perp_dot(along).abs());
    let wide = radius + 0.5 * crate::recall::RAY_STEP * ahead;
    (ahead > 0.0 && aside < wide).then(|| (ahead - radius).max(0.0))
}

fn remember(record: &mut Record, advice: &Advice, known: [f32; KNOWN], world: &World) {
    record.commands.push(world.limits.shares(advice.command));
    let (sine, cosine) = advice.bearing.sin_cos();
    let visible = if advice.in_view { 1.0 } else { 0.0 };
    record.cones.push([sine as f32, cosine as f32, advice.distance.max(0.05).ln() as f32, visible]);
    record.found.push(advice.found);
    record.known.push(known);
}
