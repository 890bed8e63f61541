//! A net that adds a torque to each joint at each physics step, from what that joint did (the inputs of Hwangbo et al. 2019).

use super::inputs::{INSTANTS, OF_INSTANT, SCALE, kinds};
use super::net::{NetKind, ResidualNet};
use crate::ResidualError;
use qv_policy::compensate::{Compensator, SimulatedStates};
use qv_policy::net::{Mlp, Tape, padded};
use qv_policy::velocity::TaskRobot;
use rayon::prelude::*;

/// Environments that pass through the net together.
const ROWS: usize = 16;

/// What is kept of each environment and how it becomes inputs.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    kinds: Vec<usize>,
    kind_count: usize,
    pub kp: Vec<f32>,
    substeps: usize,
    /// The present and the last two decisions, newest first: `[count][2 substeps + 1][joints][3]`, scaled.
    past: Vec<f32>,
    fresh: Vec<bool>,
}

impl Watch {
    pub fn new(robot: &TaskRobot, substeps: usize, count: usize) -> Self {
        let (kinds, kind_count) = kinds(robot);
        let width = (2 * substeps + 1) * robot.joints() * OF_INSTANT;
        Self {
            kinds,
            kind_count,
            kp: robot.kp.clone(),
            substeps,
            past: vec![0.0; count * width],
            fresh: vec![true; count],
        }
    }

    fn joints(&self) -> usize {
        self.kp.len()
    }

    fn width(&self) -> usize {
        (2 * self.substeps + 1) * self.joints() * OF_INSTANT
    }

    pub fn for_count(&self, count: usize) -> Self {
        Self { past: vec![0.0; count * self.width()], fresh: vec![true; count], ..self.clone() }
    }

    pub fn begin(&mut self, env: usize) {
        self.fresh[env] = true;
    }

    /// Takes in the present of all environments, once a physics step.
    pub fn watch(&mut self, seen: &SimulatedStates) {
        let (joints, kp) = (self.joints(), &self.kp);
        let (width, row) = (self.width(), joints * OF_INSTANT);
        let parts = self.past.par_chunks_exact_mut(width).zip(&mut self.fresh).with_min_len(64);
        parts.enumerate().for_each(|(env, (past, fresh))| {
            past.copy_within(0..width - row, row);
            for j in 0..joints {
                let off = seen.targets[env * joints + j] - seen.q[env * (7 + joints) + 7 + j];
                let (speed, torque) = (seen.v[env * (6 + joints) + 6 + j], seen.torques[env * joints + j]);
                let now = [SCALE[0] * off, SCALE[1] * speed, SCALE[2] * torque / kp[j]];
                past[j * OF_INSTANT..][..OF_INSTANT].copy_from_slice(&now);
            }
            if std::mem::take(fresh) {
                (1..width / row).for_each(|k| past.copy_within(0..row, k * row));
            }
        });
    }

    /// The scaled input of one joint.
    pub fn input(&self, env: usize, joint: usize, out: &mut [f32]) {
        let past = &self.past[env * self.width()..][..self.width()];
        for k in 0..INSTANTS {
            let from = (k * self.substeps * self.joints() + joint) * OF_INSTANT;
            out[k * OF_INSTANT..][..OF_INSTANT].copy_from_slice(&past[from..][..OF_INSTANT]);
        }
        let kinds = &mut out[INSTANTS * OF_INSTANT..][..self.kind_count];
        kinds.fill(0.0);
        kinds[self.kinds[joint]] = 1.0;
    }
}

/// A net that adds a torque to each joint at each physics step, behind latency and lag, of at most its clip times the position gain.
///
/// Its input, of one joint: target less angle \[rad\], speed \[rad/s\] and the motor's torque over the position gain \[rad\], now and one and two
/// decisions ago; and a one for the kind of joint it is.
/// The weights are shared by all joints. A joint whose state is not finite has run away and gets nothing.
#[derive(Debug, Clone)]
pub struct TorqueResidual {
    net: Mlp,
    parameters: Vec<f32>,
    clip: f32,
    watch: Watch,
    work: Vec<(Tape, Vec<f32>)>,
}

impl TorqueResidual {
    /// For so many environments, at so many physics steps a decision.
    ///
    /// # Errors
    /// When the net does not fit the robot, see [`ResidualNet::check`], or there are no physics steps.
    pub fn new(net: &ResidualNet, robot: &TaskRobot, substeps: usize, count: usize) -> Result<Self, ResidualError> {
        net.check(robot, NetKind::Torque)?;
        if substeps == 0 {
            return Err(ResidualError::input("physics steps of a decision", "at least 1", substeps));
        }
        let (layers, parameters) = net.layers();
        let this =
            Self { net: layers, parameters, clip: net.clip, watch: Watch::new(robot, substeps, 0), work: Vec::new() };
        Ok(this.sized(count))
    }

    fn sized(&self, count: usize) -> Self {
        let rows = ROWS * self.watch.joints();
        let work = || (self.net.tape(rows), vec![0.0; rows * padded(self.net.inputs())]);
        Self {
            watch: self.watch.for_count(count),
            work: (0..count.div_ceil(ROWS)).map(|_| work()).collect(),
            ..self.clone()
        }
    }

    /// Corrections of the coming physics step over the position gain \[rad\], `[count][joints]`.
    pub(super) fn corrections(&mut self, seen: &SimulatedStates, out: &mut [f32]) {
        self.watch.watch(seen);
        let joints = self.watch.joints();
        let (net, parameters, clip, watch) = (&self.net, &self.parameters, self.clip, &self.watch);
        let width = padded(net.inputs());
        let parts = out.par_chunks_mut(ROWS * joints).zip(&mut self.work);
        parts.enumerate().for_each(|(part, (out, (tape, rows)))| {
            for (i, row) in rows.chunks_exact_mut(width).enumerate().take(out.len()) {
                watch.input(part * ROWS + i / joints, i % joints, row);
            }
            let found = net.forward(parameters, out.len(), rows, tape);
            for (i, out) in out.iter_mut().enumerate() {
                let is_lost = rows[i * width..][..width].iter().any(|x| !x.is_finite());
                *out = if is_lost { 0.0 } else { (found[i * padded(1)] * super::UNIT).clamp(-clip, clip) };
            }
        });
    }
}

impl Compensator for TorqueResidual {
    fn begin(&mut self, env: usize) {
        self.watch.begin(env);
    }

    fn move_targets(&mut self, _seen: &SimulatedStates, _sent: &mut [f32]) {}

    fn adds_torques(&self) -> bool {
        true
    }

    fn add_torques(&mut self, seen: &SimulatedStates, added: &mut [f32]) {
        self.corrections(seen, added);
        added.iter_mut().zip(self.watch.kp.iter().cycle()).for_each(|(added, kp)| *added *= kp);
    }

    fn for_count(&self, count: usize) -> Box<dyn Compensator> {
        Box::new(self.sized(count))
    }
}
