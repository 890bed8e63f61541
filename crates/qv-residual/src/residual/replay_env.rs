//! Recordings as a task for a learner: robots begin at sampled instants, their motors warm, recorded targets are replayed, and the action moves
//! them.

use super::inputs::{position_inputs, position_scaling};
use super::position::{Look, Past, remember};
use super::stage::Stage;
use super::supervised::{LOST, spread};
use super::{ResidualNet, UNIT};
use crate::ResidualError;
use crate::windows::{Lane, Replayer, Window, yaw_of};
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::PolicyError;
use qv_policy::env::{End, VectorEnv};
use qv_sim::LaneState;
use rayon::prelude::*;

/// Decisions of an episode: a second at 50 Hz.
const LENGTH: usize = 50;
/// Instants at which episodes begin; each is kept with the state of its motors.
const STARTS: usize = 2048;
/// Instants that are warmed up together.
const TOGETHER: usize = 256;
/// Numbers that the critic knows of the base: how far it is off, and its velocity \[m, m/s\].
const OF_BASE: usize = 6;
/// Size of an error at which its part of the reward has fallen to 1/e: joints, fine and coarse \[rad\], their speeds \[rad/s\], the base \[m\].
const FINE: f32 = 0.05;
const COARSE: f32 = 0.2;
const SPEEDS: f32 = 2.0;
const BASE: f32 = 0.05;

/// Many robots that replay a log.
pub struct ReplayEnv<'a> {
    stage: Stage<'a>,
    look: Look,
    past: Past,
    /// Where each start is, and the state of lanes there.
    starts: Vec<(Window, LaneState, [f32; 3])>,
    bias: Vec<f64>,
    clip: f32,
    /// Start and age in decisions of each robot.
    at: Vec<(usize, usize)>,
    /// Decisions until each robot's time is over.
    left: Vec<usize>,
    random: Vec<Xoshiro256PlusPlus>,
    moved: Vec<f32>,
    before: Vec<f32>,
    sums: [f64; 4],
}

impl<'a> ReplayEnv<'a> {
    /// So many robots on windows of a log, on top of a lane's parameters and biases; corrections are cut at `clip` \[rad\].
    ///
    /// # Errors
    /// When no window leaves room for an episode of 1 s, there are no robots, or the simulator refuses a number.
    pub fn new(
        replayer: &'a Replayer<'a>,
        windows: &[Window],
        lane: &Lane,
        clip: f32,
        count: usize,
    ) -> Result<Self, ResidualError> {
        if count == 0 {
            return Err(ResidualError::input("robots of a replay", "at least 1", count));
        }
        let joints = replayer.log.joints;
        Ok(Self {
            stage: Stage::new(replayer, count, lane)?,
            look: Look::new(replayer.robot),
            past: Past::new(joints, count),
            starts: starts(replayer, &spread(replayer, windows, LENGTH, STARTS)?, lane)?,
            bias: lane.bias.clone(),
            clip,
            at: vec![(0, 0); count],
            left: vec![LENGTH - 1; count],
            random: (0..count).map(|env| Xoshiro256PlusPlus::of(0, 67, env as u64)).collect(),
            moved: vec![0.0; count * joints],
            before: vec![0.0; count * joints],
            sums: [0.0; 4],
        })
    }

    fn place(&self, env: usize) -> Window {
        let (start, age) = self.at[env];
        let (window, ..) = &self.starts[start];
        Window { decision: window.decision + age, ..*window }
    }

    fn begin(&mut self, env: usize, left: usize) -> Result<(), PolicyError> {
        let start = self.random[env].below(self.starts.len());
        self.at[env] = (start, 0);
        self.left[env] = left;
        let (window, state, _) = &self.starts[start];
        self.stage.batch.write_lane(env, state)?;
        let replayer = self.stage.replayer;
        let ago = |k: usize| replayer.targets(Window { decision: window.decision - k, ..*window }, 0);
        self.past.set(env, ago(1), ago(2));
        Ok(())
    }

    /// Simulated less measured: mean squares of joint angles and speeds, the greatest angle; and the base's place and velocity in the heading.
    fn off(&self, env: usize) -> Off {
        let replayer = self.stage.replayer;
        let (joints, at) = (replayer.log.joints, self.place(env));
        let stretch = &replayer.log.stretches[at.stretch];
        let (real, speeds) = stretch.state(joints, at.decision);
        let q = &self.stage.q[env * (7 + joints)..][..7 + joints];
        let v = &self.stage.v[env * (6 + joints)..][..6 + joints];
        let mut off = Off::default();
        for j in 0..joints {
            let bias = self.bias.get(j).map_or(0.0, |b| *b as f32);
            let angle = q[7 + j] - (real[7 + j] - bias);
            off.angles += angle * angle / joints as f32;
            off.speeds += (v[6 + j] - speeds[6 + j]).powi(2) / joints as f32;
            off.most = if angle.abs() <= off.most { off.most } else { angle.abs() };
        }
        let (start, _) = self.at[env];
        let (window, _, origin) = &self.starts[start];
        let (first, _) = stretch.state(joints, window.decision);
        let (s, c) = yaw_of(&first[3..7]).sin_cos();
        let moved: [f32; 3] = std::array::from_fn(|k| (q[k] - origin[k]) - (real[k] - first[k]));
        let faster: [f32; 3] = std::array::from_fn(|k| v[k] - speeds[k]);
        for (to, x) in off.base.chunks_exact_mut(3).zip([moved, faster]) {
            to.copy_from_slice(&[c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]]);
        }
        off
    }

    fn reward(&self, env: usize, off: &Off) -> f32 {
        let joints = self.stage.replayer.log.joints;
        let (moved, before) = (&self.moved[env * joints..][..joints], &self.before[env * joints..][..joints]);
        let gap: f32 = off.base[..3].iter().map(|x| x * x).sum();
        let near = (-off.angles / FINE.powi(2)).exp() + 0.5 * (-off.angles / COARSE.powi(2)).exp();
        let rest = (-off.speeds / SPEEDS.powi(2)).exp() + (-gap / BASE.powi(2)).exp();
        let size: f32 = moved.iter().map(|d| d * d).sum();
        let change: f32 = moved.iter().zip(before).map(|(d, b)| (d - b).powi(2)).sum();
        0.1 * (near + 0.2 * rest) - 0.05 * size - 0.02 * change
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Off {
    angles: f32,
    speeds: f32,
    most: f32,
    base: [f32; OF_BASE],
}

fn failed(error: ResidualError) -> PolicyError {
    match error {
        ResidualError::Policy(error) => error,
        ResidualError::Sim(error) => error.into(),
        other => PolicyError::Text { what: "replay".into(), reason: other.to_string() },
    }
}

/// Warm lanes at windows, and where their bases are.
fn starts(
    replayer: &Replayer,
    windows: &[Window],
    lane: &Lane,
) -> Result<Vec<(Window, LaneState, [f32; 3])>, ResidualError> {
    let mut all = Vec::with_capacity(windows.len());
    for together in windows.chunks(TOGETHER) {
        let lanes: Vec<Lane> = (0..together.len()).map(|window| Lane { window, ..lane.clone() }).collect();
        let mut stage = Stage::new(replayer, together.len(), lane)?;
        replayer.begin(&mut stage.batch, together, &lanes, &mut None)?;
        for (env, window) in together.iter().enumerate() {
            let mut kept = LaneState::default();
            stage.batch.read_lane(env, &mut kept)?;
            let state = stage.batch.state(env)?;
            all.push((*window, kept, std::array::from_fn(|k| state.q[k] as f32)));
        }
    }
    Ok(all)
}

impl VectorEnv for ReplayEnv<'_> {
    fn count(&self) -> usize {
        self.at.len()
    }

    fn observations(&self) -> usize {
        position_inputs(self.stage.replayer.robot)
    }

    fn privileged(&self) -> usize {
        self.observations() + 2 * self.actions() + OF_BASE
    }

    fn actions(&self) -> usize {
        self.stage.replayer.log.joints
    }

    fn observation_scaling(&self) -> (Vec<f32>, Vec<f32>) {
        position_scaling(self.stage.replayer.robot)
    }

    fn privileged_scaling(&self) -> (Vec<f32>, Vec<f32>) {
        let (mut offset, mut scale) = self.observation_scaling();
        offset.resize(self.privileged(), 0.0);
        // Errors of joints by 0.1 rad, of the base by 0.1 m and 0.5 m/s.
        scale.resize(self.observations() + 2 * self.actions() + 3, 10.0);
        scale.resize(self.privileged(), 2.0);
        (offset, scale)
    }

    fn observe(&mut self, observations: &mut [f32], privileged: &mut [f32]) {
        let (joints, seen, known) = (self.actions(), self.observations(), self.privileged());
        for env in 0..self.count() {
            let place = self.place(env);
            self.stage.asked[env * joints..][..joints].copy_from_slice(self.stage.replayer.targets(place, 0));
        }
        let this = &*self;
        let rows = observations.par_chunks_exact_mut(seen).zip(privileged.par_chunks_exact_mut(known));
        rows.enumerate().with_min_len(32).for_each(|(env, (row, all))| {
            let past = &this.past.numbers[env * 3 * joints..][..3 * joints];
            this.look.input(env, &this.stage.seen(), past, row);
            let (own, rest) = all.split_at_mut(seen);
            own.copy_from_slice(row);
            let at = this.place(env);
            let stretch = &this.stage.replayer.log.stretches[at.stretch];
            let ((now, _), (next, _)) = (stretch.state(joints, at.decision), stretch.state(joints, at.decision + 1));
            for j in 0..joints {
                let sim = this.stage.q[env * (7 + joints) + 7 + j] + this.bias.get(j).map_or(0.0, |b| *b as f32);
                rest[j] = now[7 + j] - sim;
                rest[joints + j] = next[7 + j] - sim;
            }
            rest[2 * joints..].copy_from_slice(&this.off(env).base);
        });
    }

    fn step(&mut self, actions: &[f32], rewards: &mut [f32], ends: &mut [End]) -> Result<(), PolicyError> {
        if let Some(&found) = actions.iter().find(|x| !x.is_finite()) {
            return Err(PolicyError::NotFinite { iteration: 0, term: "action".into(), found });
        }
        let joints = self.actions();
        for (env, past) in self.past.numbers.chunks_exact(3 * joints).enumerate() {
            self.before[env * joints..][..joints].copy_from_slice(&past[2 * joints..]);
        }
        let clip = self.clip;
        self.moved.iter_mut().zip(actions).for_each(|(moved, x)| *moved = (x * UNIT).clamp(-clip, clip));
        let places: Vec<Window> = (0..self.count()).map(|env| self.place(env)).collect();
        for (env, past) in self.past.numbers.chunks_exact_mut(3 * joints).enumerate() {
            let first = self.stage.replayer.targets(places[env], 0);
            remember(past, first, &self.moved[env * joints..][..joints]);
        }
        self.stage.decide(super::stage::Acts::Position, &self.moved, |env| places[env]).map_err(failed)?;
        self.stage.look().map_err(failed)?;
        self.at.iter_mut().for_each(|(_, age)| *age += 1);
        self.left.iter_mut().for_each(|left| *left -= 1);
        for env in 0..self.count() {
            let off = self.off(env);
            // Not so where the angle is no number: a robot that ran away has failed.
            let numbers = [off.angles, off.speeds];
            let is_finite = numbers.iter().chain(&off.base).all(|x| x.is_finite());
            let is_near = is_finite && off.most < LOST;
            rewards[env] = if is_near { self.reward(env, &off) } else { 0.0 };
            ends[env] = match (is_near, self.left[env] == 0) {
                (false, _) => End::Failed,
                (true, true) => End::TimeOut,
                (true, false) => End::No,
            };
            let angle = if is_near { off.angles.sqrt() } else { LOST };
            let size = self.moved[env * joints..][..joints].iter().map(|d| d * d).sum::<f32>() / joints as f32;
            self.sums[0] += 1.0;
            self.sums[1] += f64::from(angle);
            self.sums[2] += f64::from(size.sqrt());
            self.sums[3] += f64::from(u8::from(!is_near));
        }
        Ok(())
    }

    fn reset(&mut self, mask: &[bool]) -> Result<(), PolicyError> {
        for env in (0..mask.len()).filter(|&env| mask[env]) {
            self.begin(env, LENGTH - 1)?;
        }
        self.stage.look().map_err(failed)
    }

    fn restart(&mut self, seed: u64, epoch: u64) -> Result<(), PolicyError> {
        for env in 0..self.count() {
            self.random[env] = Xoshiro256PlusPlus::of(seed ^ epoch.rotate_left(40), 67, env as u64);
            // Ages are drawn, so that not all begin anew at once.
            let left = 1 + self.random[env].below(LENGTH - 1);
            self.begin(env, left)?;
        }
        self.stage.look().map_err(failed)
    }

    fn figures(&mut self) -> Vec<(&'static str, f32)> {
        let [steps, angle, size, lost] = std::mem::take(&mut self.sums);
        let mean = |sum: f64| (sum / steps.max(1.0)) as f32;
        vec![("joint_error", mean(angle)), ("correction", mean(size)), ("lost", mean(lost))]
    }
}

impl ReplayEnv<'_> {
    /// The file of an actor.
    pub(super) fn net(&self, actor: &qv_policy::net::Mlp, parameters: &[f32]) -> ResidualNet {
        ResidualNet::new(super::NetKind::Position, self.stage.replayer.robot, actor, parameters, self.clip)
    }
}
