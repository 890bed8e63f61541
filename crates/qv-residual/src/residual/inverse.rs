//! Which correction makes the simulator do what the robot did: Gauss and Newton over one decision, slopes by finite differences, one lane for
//! each joint.

use super::settings::{MOST, SupervisedSettings};
use super::stage::{Acts, Stage};
use crate::ResidualError;
use crate::windows::{Lane, Replayer, Window};
use qv_fit::linear::{add_diagonal, from_columns, gram, minus, squared, transposed_times};
use qv_fit::{Cholesky, Matrix};
use qv_sim::{Batch, LaneState};
use rayon::prelude::*;

/// Change of a correction for its slope \[rad\].
const PROBE: f32 = 0.04;
/// Seconds by which speeds are weighed against angles: a decision of 20 ms, in which a wrong speed becomes a wrong angle.
const SPEED: f32 = 0.02;

/// Corrections of many lanes.
pub(super) struct Inverse<'a> {
    probes: Stage<'a>,
    trial: Stage<'a>,
    kept: LaneState,
    bias: Vec<f64>,
    acts: Acts,
    /// Weight of a correction's square: (error of a state / size of corrections) squared.
    weight: f64,
    pull: f32,
    /// Decisions for which a correction is held before states are compared.
    ahead: usize,
}

/// One lane's linear problem.
struct LaneSolution {
    factor: Cholesky,
    slopes: Matrix,
    cost: f64,
    found: Vec<f32>,
}

impl<'a> Inverse<'a> {
    pub fn new(
        replayer: &'a Replayer<'a>,
        count: usize,
        lane: &Lane,
        acts: Acts,
        settings: &SupervisedSettings,
    ) -> Result<Self, ResidualError> {
        let group = replayer.log.joints + 1;
        Ok(Self {
            probes: Stage::new(replayer, count * group, lane)?,
            trial: Stage::new(replayer, count, lane)?,
            kept: LaneState::default(),
            bias: lane.bias.clone(),
            acts,
            weight: (settings.error / settings.spread).powi(2),
            pull: settings.pull,
            ahead: settings.ahead,
        })
    }

    /// Angles and weighed speeds that a lane should reach. With a pull of less than one it keeps a share of how far it is off now.
    fn wanted(&self, now: &Stage, env: usize, at: Window) -> Vec<f32> {
        let replayer = self.trial.replayer;
        let joints = replayer.log.joints;
        let stretch = &replayer.log.stretches[at.stretch];
        let ([real, speeds], [next, next_speeds]) = (
            <[&[f32]; 2]>::from(stretch.state(joints, at.decision)),
            <[&[f32]; 2]>::from(stretch.state(joints, at.decision + self.ahead)),
        );
        let bias = |j: usize| self.bias.get(j).map_or(0.0, |b| *b as f32);
        let stay = 1.0 - self.pull;
        let angle = |j: usize| {
            let off = now.q[env * (7 + joints) + 7 + j] - (real[7 + j] - bias(j));
            next[7 + j] - bias(j) + stay * off
        };
        let speed =
            |j: usize| SPEED * (next_speeds[6 + j] + stay * (now.v[env * (6 + joints) + 6 + j] - speeds[6 + j]));
        (0..joints).map(angle).chain((0..joints).map(speed)).collect()
    }

    /// Corrections about `base` `[lanes][joints]` of lanes whose state is `now`'s, as last looked at; a lane that runs away has none.
    pub fn solve(&mut self, now: &Stage, at: &[Window], base: &[f32]) -> Result<Vec<Option<Vec<f32>>>, ResidualError> {
        let joints = self.trial.replayer.log.joints;
        let group = joints + 1;
        self.load(&now.batch, at.len(), group)?;
        let mut moved = vec![0.0; at.len() * group * joints];
        for (lane, moved) in moved.chunks_exact_mut(joints).enumerate() {
            moved.copy_from_slice(&base[lane / group * joints..][..joints]);
            if lane % group > 0 {
                moved[lane % group - 1] += PROBE;
            }
        }
        let later = |env: usize, k: usize| Window { decision: at[env].decision + k, ..at[env] };
        for k in 0..self.ahead {
            self.probes.decide(self.acts, &moved, |lane| later(lane / group, k))?;
        }
        self.probes.batch.read_positions(&mut self.probes.q)?;
        self.probes.batch.read_velocities(&mut self.probes.v)?;
        let this = &*self;
        let wanted: Vec<Vec<f32>> = (0..at.len()).into_par_iter().map(|env| this.wanted(now, env, at[env])).collect();
        let linear = |env: usize| this.linear(env, &wanted[env], &base[env * joints..][..joints]);
        let mut solved: Vec<Option<LaneSolution>> = (0..at.len()).into_par_iter().map(linear).collect();
        // Once more from there, along the same slopes.
        let first: Vec<f32> =
            solved.iter().flat_map(|s| s.as_ref().map_or_else(|| vec![0.0; joints], |s| s.found.clone())).collect();
        for k in 0..self.ahead {
            self.trial.decide(self.acts, &first, |env| later(env, k))?;
        }
        self.trial.batch.read_positions(&mut self.trial.q)?;
        self.trial.batch.read_velocities(&mut self.trial.v)?;
        let this = &*self;
        let again = |(env, solved): (usize, &mut Option<LaneSolution>)| {
            let solved = solved.as_mut()?;
            let rest = rest(&this.trial, env, &wanted[env]);
            let cost = this.cost(&rest, &solved.found);
            if !cost.is_finite() {
                return None;
            }
            if cost > solved.cost {
                // A foot that comes down or lifts: the slopes do not hold.
                return Some(base[env * joints..][..joints].to_vec());
            }
            Some(this.moved(&solved.factor, &solved.slopes, &rest, &solved.found))
        };
        Ok(solved.par_iter_mut().enumerate().map(again).collect())
    }

    fn load(&mut self, from: &Batch<f32>, count: usize, group: usize) -> Result<(), ResidualError> {
        for env in 0..count {
            from.read_lane(env, &mut self.kept)?;
            (0..group).try_for_each(|k| self.probes.batch.write_lane(env * group + k, &self.kept))?;
            self.trial.batch.write_lane(env, &self.kept)?;
        }
        Ok(())
    }

    fn cost(&self, rest: &[f64], found: &[f32]) -> f64 {
        squared(rest) + self.weight * found.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>()
    }

    fn moved(&self, factor: &Cholesky, slopes: &Matrix, rest: &[f64], from: &[f32]) -> Vec<f32> {
        let mut right = transposed_times(slopes, rest);
        right.iter_mut().zip(from).for_each(|(x, from)| *x -= self.weight * f64::from(*from));
        let change = factor.solve(&right);
        from.iter().zip(change.iter()).map(|(from, change)| (from + *change as f32).clamp(-MOST, MOST)).collect()
    }

    fn linear(&self, env: usize, wanted: &[f32], base: &[f32]) -> Option<LaneSolution> {
        let joints = base.len();
        let first = env * (joints + 1);
        let here = rest(&self.probes, first, wanted);
        let slope = |k: usize| {
            let there = rest(&self.probes, first + 1 + k, wanted);
            minus(&here, &there).iter().map(|x| x / f64::from(PROBE)).collect()
        };
        let columns: Vec<Vec<f64>> = (0..joints).map(slope).collect();
        if columns.iter().flatten().chain(&here).any(|x| !x.is_finite()) {
            return None;
        }
        let slopes = from_columns(2 * joints, &columns);
        let mut normal = gram(&slopes);
        add_diagonal(&mut normal, &vec![self.weight; joints]);
        let factor = Cholesky::new(&normal)?;
        let found = self.moved(&factor, &slopes, &here, base);
        Some(LaneSolution { factor, cost: self.cost(&here, base), slopes, found })
    }
}

/// Wanted less reached.
fn rest(stage: &Stage, env: usize, wanted: &[f32]) -> Vec<f64> {
    let joints = wanted.len() / 2;
    let q = &stage.q[env * (7 + joints) + 7..][..joints];
    let v = &stage.v[env * (6 + joints) + 6..][..joints];
    let reached = q.iter().copied().chain(v.iter().map(|x| SPEED * x));
    wanted.iter().zip(reached).map(|(wanted, x)| f64::from(wanted - x)).collect()
}
