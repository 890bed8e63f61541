//! Episodes rolled: many robots at once, each with its camera, its teacher and its judge.

use crate::NavError;
use crate::eye::{Eye, Shot};
use crate::goals::turn_hues;
use crate::legs::{Legs, Motion, Start};
use crate::lens::{Lens, LensSpread};
use crate::net::{COLOUR, COMMAND, HEIGHT, KNOWN, RAYS, SIGHT, STATE, WIDTH};
use crate::recall::{CAMERA, Drift, FARTHEST, NEAREST, Odometer, Planar, RECALL, Recall, doubtful, ray};
use crate::reflex::Reflex;
use crate::sight::{Cone, SEEN, free_rays};
use crate::task::{Episode, Judge, PERIOD, Trial};
use crate::teacher::{Advice, Teacher, World};
use glam::DVec2;
use qv_core::Pose;
use qv_core::random::Xoshiro256PlusPlus;
use rayon::prelude::*;

/// What a pilot knows at a decision.
#[derive(Debug, Clone, Copy)]
pub struct PilotInput<'a> {
    /// Which robot.
    pub env: usize,
    /// Picture, `[HEIGHT][WIDTH][3]`, its hues turned for the goal ([`crate::goals::turn_hues`]).
    pub picture: &'a [u8],
    /// Numbers beside it.
    pub state: &'a [f32; STATE],
    /// What the robot recalls.
    pub recall: &'a [f32; RECALL],
    /// Hue of the goal in the picture \[degrees\].
    pub hue: f32,
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
    /// One for each of `seen`, which are some of the robots that are under way.
    ///
    /// [`roll`] panics when there are not as many.
    fn decide(&mut self, seen: &[PilotInput]) -> Vec<Decision>;
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
    pub acted: Vec<StudentAction>,
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
    env: usize,
    world: &'a World,
    episode: &'a Episode,
    teacher: Teacher,
    judge: Judge,
    lens: Lens,
    odometer: Odometer,
    recall: Recall,
    random: Xoshiro256PlusPlus,
    cones: Vec<Cone>,
    last: [f64; 3],
    /// What it does now, and where it was when the picture was taken that it is to decide by.
    motion: Motion,
    past: Pose,
    advice: Advice,
    over: bool,
    keep: bool,
    record: Record,
}

/// What a robot has to decide by, see [`PilotInput`].
struct Glimpse {
    picture: Vec<u8>,
    state: [f32; STATE],
    recall: [f32; RECALL],
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
    episodes.iter().enumerate().for_each(|(env, episode)| pilot.begin(env, episode));
    let begin = |(env, episode)| (env, episode, legs.motion(env), keep(env));
    let begun: Vec<_> = episodes.iter().enumerate().map(begin).collect();
    let mut runs: Vec<Run> =
        begun.into_par_iter().map(|(env, episode, motion, keep)| Run::new(stage, env, episode, motion, keep)).collect();
    // While the pictures of one half are drawn, the other half decides.
    let half = if legs.are_apart() { runs.len().div_ceil(2) } else { runs.len() };
    let (first, second) = runs.split_at_mut(half);
    let mut crews = [first, second];
    crews.iter_mut().for_each(|crew| look_round(stage, crew, legs, 0));
    let mut pictures = look(stage, crews[0])?;
    for turn in 0.. {
        if crews.iter().all(|crew| crew.iter().all(|run| run.over)) {
            break;
        }
        let [crew, next] = &mut crews;
        let (mut drawn, next) = (Ok(Vec::new()), &**next);
        rayon::in_place_scope(|scope| {
            scope.spawn(|_| drawn = look(stage, next));
            decide(stage, crew, &pictures, &mut *pilot, &mut *legs)?;
            look_round(stage, crew, legs, turn / 2 + 1);
            Ok::<(), NavError>(())
        })?;
        pictures = drawn?;
        crews.swap(0, 1);
    }
    Ok(runs.into_iter().map(|run| (run.judge.into_trial(), run.record)).collect())
}

/// The teacher's word on where robots are now, and the judge's: decision `step` of their episodes.
fn look_round(stage: &Stage, crew: &mut [Run], legs: &dyn Legs, step: usize) {
    for run in crew.iter_mut().filter(|run| !run.over) {
        (run.motion, run.past) = (legs.motion(run.env), legs.past(run.env, run.lens.delay));
    }
    crew.par_iter_mut().filter(|run| !run.over).for_each(|run| run.judge(stage.world, step));
}

/// Pictures of the robots that are under way.
fn look(stage: &Stage, crew: &[Run]) -> Result<Vec<Vec<f32>>, NavError> {
    let live = crew.iter().filter(|run| !run.over);
    let shots: Vec<Shot> = live
        .map(|run| Shot { camera: run.lens.rig.camera(&run.past), cones: run.cones.clone(), seed: run.episode.seed })
        .collect();
    let drawn = if shots.is_empty() { Vec::new() } else { stage.eye.look(&shots)? };
    let sizes = drawn.iter().map(Vec::len);
    match drawn.len() == shots.len() && sizes.clone().all(|size| size == WIDTH * HEIGHT * 3) {
        true => Ok(drawn),
        false => {
            let expected = format!("{} pictures of {WIDTH} x {HEIGHT} x 3 numbers", shots.len());
            Err(NavError::value("eye", &expected, format!("{:?}", sizes.collect::<Vec<_>>())))
        }
    }
}

/// Robots that are under way decide by the pictures that were drawn, and go on.
fn decide(
    stage: &Stage,
    crew: &mut [Run],
    drawn: &[Vec<f32>],
    pilot: &mut dyn Pilot,
    legs: &mut dyn Legs,
) -> Result<(), NavError> {
    let mut live: Vec<&mut Run> = crew.iter_mut().filter(|run| !run.over).collect();
    if live.is_empty() {
        return Ok(());
    }
    let glimpses: Vec<Glimpse> = live.par_iter_mut().zip(drawn).map(|(run, picture)| run.glimpse(picture)).collect();
    let decisions =
        pilot.decide(&live.iter().zip(&glimpses).map(|(run, glimpse)| run.sees(glimpse)).collect::<Vec<_>>());
    assert_eq!(decisions.len(), live.len(), "a pilot decides for all that it is asked for");
    let (mut commands, mut active) = (vec![[0.0; 3]; legs.count()], vec![false; legs.count()]);
    live.par_iter_mut().zip(&glimpses).zip(&decisions).for_each(|((run, glimpse), decision)| {
        run.follow(stage, glimpse, decision);
    });
    for run in &live {
        (commands[run.env], active[run.env]) = (run.last, true);
    }
    legs.step(&commands, &active)
}

impl<'a> Run<'a> {
    fn new(stage: &Stage<'a>, env: usize, episode: &'a Episode, motion: Motion, keep: bool) -> Self {
        let [low, high] = stage.world.map.bounds();
        let nothing = Advice { command: [0.0; 3], found: false, in_view: false, bearing: 0.0, distance: 0.0 };
        let mut teacher = Teacher::new(stage.world, &episode.others);
        match episode.is_absent {
            true => teacher = teacher.without_goal(),
            false => teacher.plan(stage.world, &episode.goal),
        }
        Self {
            env,
            world: stage.world,
            episode,
            teacher,
            judge: Judge::new(stage.world, episode),
            lens: stage.spread.draw(&stage.world.rig, episode.seed),
            odometer: Odometer::new(&stage.drift, Planar::of(&motion.world_from_base), episode.seed),
            recall: Recall::new(0.5 * (high - low)),
            random: Xoshiro256PlusPlus::of(episode.seed, 89, 0),
            cones: Some(episode.goal)
                .filter(|_| !episode.is_absent)
                .into_iter()
                .chain(episode.others.iter().copied())
                .collect(),
            last: [0.0; 3],
            motion,
            past: motion.world_from_base,
            advice: nothing,
            over: false,
            keep,
            record: Record::default(),
        }
    }

    fn judge(&mut self, world: &World, step: usize) {
        let base = &self.motion.world_from_base;
        self.advice = self.teacher.advise(world, base, &self.episode.goal);
        let result = (self.advice.in_view, self.motion.fell);
        self.over = self.judge.look(world, self.episode, base, step, result).is_some();
    }

    /// What it has to decide by when this was drawn.
    fn glimpse(&mut self, drawn: &[f32]) -> Glimpse {
        let base = &self.motion.world_from_base;
        self.odometer.go(Planar::of(base), PERIOD);
        self.recall.go(self.odometer.pose);
        let mut picture = self.lens.bytes(drawn, self.motion.gyro);
        turn_hues(&mut picture, self.world.goals.turn(self.episode.goal.colour));
        Glimpse { picture, state: state(self.world, self.episode, base), recall: self.recall.features() }
    }

    fn sees<'b>(&'b self, glimpse: &'b Glimpse) -> PilotInput<'b> {
        PilotInput {
            env: self.env,
            picture: &glimpse.picture,
            state: &glimpse.state,
            recall: &glimpse.recall,
            hue: self.world.goals.hue(self.episode.goal.colour),
            advice: &self.advice,
        }
    }

    /// Keeps what can be learnt, and does what was decided.
    fn follow(&mut self, stage: &Stage, glimpse: &Glimpse, decision: &Decision) {
        let (world, goal) = (stage.world, &self.episode.goal);
        let mut truth = sight(world, &self.past, goal, &self.episode.others);
        if self.episode.is_absent {
            truth[3] = 0.0;
        }
        if self.keep {
            let known = known(world, &self.motion.world_from_base, goal);
            self.record.pictures.extend_from_slice(&glimpse.picture);
            self.record.states.extend(glimpse.state);
            self.record.recalls.extend(glimpse.recall);
            self.record.sights.push(truth);
            remember(&mut self.record, &self.advice, known, world);
        }
        let mut wanted = world.limits.command(decision.command);
        if decision.sight.is_some() {
            wanted = stage.reflex.apply(&self.recall, world.rig.head, &world.limits, wanted);
        }
        self.last = world.limits.limited(self.last, wanted);
        let said = decision.sight.unwrap_or_else(|| doubtful(&truth, &mut self.random));
        self.recall.see(&said);
    }
}

/// Numbers beside the picture, see [`STATE`].
pub fn state(world: &World, episode: &Episode, base: &Pose) -> [f32; STATE] {
    state_of(world.goals.code(episode.goal.colour), base)
}

/// The same for the numbers that command a goal.
pub(crate) fn state_of(goal: [f32; COLOUR], base: &Pose) -> [f32; STATE] {
    let gravity = base.rotation.conjugate() * glam::DVec3::NEG_Z;
    let mut out = [0.0; STATE];
    out[..COLOUR].copy_from_slice(&goal);
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
    let all = [here.x, here.y, sine, cosine, there.x, there.y];
    all.map(|x| if world.is_known { x as f32 } else { 0.0 })
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
    if !world.is_known {
        out[4..8].fill(0.0);
    }
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

/// What a student did at a decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StudentAction {
    /// The command that it drew, in shares of its limits; beyond -1 to 1 it is cut off only by who carries it out.
    pub action: [f32; COMMAND],
    /// What the network said: the mean of the draw.
    pub mean: [f32; COMMAND],
    /// The standard deviation of the draw.
    pub deviation: f32,
    /// How much better it went on than the critic expected, over all decisions of a round with mean 0 and deviation 1.
    pub advantage: f32,
}

impl Default for StudentAction {
    /// Nothing, of which nothing can be learnt.
    fn default() -> Self {
        Self { action: [0.0; COMMAND], mean: [0.0; COMMAND], deviation: 1.0, advantage: 0.0 }
    }
}

#[cfg(feature = "gpu")]
impl StudentAction {
    /// How many numbers it is.
    pub(crate) const NUMBERS: usize = 2 * COMMAND + 2;

    /// One after the other.
    pub(crate) fn numbers(&self) -> [f32; Self::NUMBERS] {
        let mut all = [self.advantage; Self::NUMBERS];
        all[..COMMAND].copy_from_slice(&self.action);
        all[COMMAND..2 * COMMAND].copy_from_slice(&self.mean);
        all[2 * COMMAND] = self.deviation;
        all
    }
}

/// An episode that was driven.
pub(crate) struct EpisodeTrace {
    pub(crate) episode: Episode,
    /// Whether the student drove alone.
    pub(crate) alone: bool,
    pub(crate) trial: Trial,
    pub(crate) record: Record,
}

pub(crate) fn driven_frames(all: &[EpisodeTrace]) -> usize {
    all.iter().map(|driven| driven.record.len()).sum()
}
