//! A net that moves the joint targets at each decision.

use super::inputs::{OF_JOINTS, position_scaling};
use super::net::{NetKind, ResidualNet};
use crate::ResidualError;
use qv_policy::compensate::{Compensator, SimulatedStates};
use qv_policy::net::{Mlp, Tape, padded};
use qv_policy::velocity::TaskRobot;
use rayon::prelude::*;

/// A foot touches where it bears more than this share of its part of the weight.
const TOUCH: f32 = 0.1;
/// Environments that pass through the net together.
pub(super) const ROWS: usize = 64;

/// What a net remembers of each environment.
#[derive(Debug, Clone)]
pub(super) struct Past {
    joints: usize,
    /// The last targets, those before, the last correction, `[count][3][joints]`.
    pub numbers: Vec<f32>,
    /// Environments without a past.
    pub fresh: Vec<bool>,
}

impl Past {
    pub fn new(joints: usize, count: usize) -> Self {
        Self { joints, numbers: vec![0.0; 3 * joints * count], fresh: vec![true; count] }
    }

    /// Targets before the first, and no correction.
    pub fn set(&mut self, env: usize, last: &[f32], before: &[f32]) {
        let own = &mut self.numbers[env * 3 * self.joints..][..3 * self.joints];
        own[..self.joints].copy_from_slice(last);
        own[self.joints..2 * self.joints].copy_from_slice(before);
        own[2 * self.joints..].fill(0.0);
        self.fresh[env] = false;
    }
}

/// Numbers of one environment's past after a decision.
pub(super) fn remember(past: &mut [f32], target: &[f32], correction: &[f32]) {
    let joints = target.len();
    past.copy_within(0..joints, joints);
    past[..joints].copy_from_slice(target);
    past[2 * joints..].copy_from_slice(correction);
}

/// How a robot's state becomes the input of a net.
#[derive(Debug, Clone)]
pub(super) struct Look {
    stand: Vec<f32>,
    feet: Vec<usize>,
    shapes: usize,
    touch: f32,
}

impl Look {
    pub fn new(robot: &TaskRobot) -> Self {
        let share = (robot.model.mass() * qv_core::GRAVITY) as f32 / robot.feet.len() as f32;
        Self {
            stand: robot.stand.clone(),
            feet: robot.feet.clone(),
            shapes: robot.model.geoms.len(),
            touch: TOUCH * share,
        }
    }

    /// The input of one environment, unscaled.
    pub fn input(&self, env: usize, seen: &SimulatedStates, past: &[f32], out: &mut [f32]) {
        let joints = self.stand.len();
        let q = &seen.q[env * (7 + joints)..][..7 + joints];
        let v = &seen.v[env * (6 + joints)..][..6 + joints];
        let target = &seen.targets[env * joints..][..joints];
        for j in 0..joints {
            let of_joint = [
                q[7 + j] - self.stand[j],
                v[6 + j],
                target[j] - q[7 + j],
                past[j] - target[j],
                past[joints + j] - past[j],
                past[2 * joints + j],
            ];
            (0..OF_JOINTS).for_each(|k| out[k * joints + j] = of_joint[k]);
        }
        let rest = &mut out[OF_JOINTS * joints..];
        rest[..3].copy_from_slice(&gravity(&q[3..7]));
        rest[3..6].copy_from_slice(&v[3..6]);
        for (touches, &foot) in rest[6..].iter_mut().zip(&self.feet) {
            let force = &seen.forces[(env * self.shapes + foot) * 3..][..3];
            let size = force.iter().map(|x| x * x).sum::<f32>().sqrt();
            *touches = if size > self.touch { 1.0 } else { 0.0 };
        }
    }
}

/// Direction of gravity in the axes of a body whose quaternion is w, x, y, z.
fn gravity(q: &[f32]) -> [f32; 3] {
    let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
    [2.0 * (w * y - x * z), -2.0 * (y * z + w * x), 2.0 * (x * x + y * y) - 1.0]
}

/// A net that moves the joint targets at each decision, by at most its clip.
///
/// Its input: angles from the stand, speeds, target less angle, the last target less this one, the one before less the last, the last correction
/// (`[joints]` each), gravity's direction and turning rate in the base (3 each), whether each foot touches (0 or 1).
///
/// An environment whose state is not finite has run away and is not corrected; an output that is not finite is passed on, and the simulator
/// refuses it.
#[derive(Debug, Clone)]
pub struct PositionResidual {
    net: Mlp,
    parameters: Vec<f32>,
    clip: f32,
    look: Look,
    scaling: (Vec<f32>, Vec<f32>),
    past: Past,
    work: Vec<(Tape, Vec<f32>)>,
}

impl PositionResidual {
    /// For so many environments.
    ///
    /// # Errors
    /// When the net does not fit the robot, see [`ResidualNet::check`].
    pub fn new(net: &ResidualNet, robot: &TaskRobot, count: usize) -> Result<Self, ResidualError> {
        net.check(robot, NetKind::Position)?;
        let (layers, parameters) = net.layers();
        let (look, scaling, joints) = (Look::new(robot), position_scaling(robot), robot.joints());
        let this = Self {
            net: layers,
            parameters,
            clip: net.clip,
            look,
            scaling,
            past: Past::new(joints, 0),
            work: Vec::new(),
        };
        Ok(this.sized(count))
    }

    fn sized(&self, count: usize) -> Self {
        let row = || (self.net.tape(ROWS), vec![0.0; ROWS * padded(self.net.inputs())]);
        Self {
            past: Past::new(self.past.joints, count),
            work: (0..count.div_ceil(ROWS)).map(|_| row()).collect(),
            ..self.clone()
        }
    }

    /// Targets before the first, for an environment that begins in the midst of a recording.
    pub(super) fn set_past(&mut self, env: usize, last: &[f32], before: &[f32]) {
        self.past.set(env, last, before);
    }

    /// Corrections of all environments `[count][joints]` \[rad\], which are remembered.
    pub(super) fn corrections(&mut self, seen: &SimulatedStates, out: &mut [f32]) {
        let joints = self.past.joints;
        let (net, look, parameters, clip) = (&self.net, &self.look, &self.parameters, self.clip);
        let (offset, scale) = &self.scaling;
        let (inputs, width) = (net.inputs(), padded(net.inputs()));
        let parts = out.par_chunks_mut(ROWS * joints).zip(self.past.numbers.par_chunks_mut(ROWS * 3 * joints));
        let parts = parts.zip(self.past.fresh.par_chunks_mut(ROWS)).zip(&mut self.work);
        parts.enumerate().for_each(|(part, (((out, past), fresh), (tape, rows)))| {
            let count = fresh.len();
            for i in 0..count {
                let (env, past) = (part * ROWS + i, &mut past[i * 3 * joints..][..3 * joints]);
                let target = &seen.targets[env * joints..][..joints];
                if std::mem::take(&mut fresh[i]) {
                    past[..joints].copy_from_slice(target);
                    past[joints..2 * joints].copy_from_slice(target);
                    past[2 * joints..].fill(0.0);
                }
                let row = &mut rows[i * width..][..inputs];
                look.input(env, seen, past, row);
                row.iter_mut().zip(offset).zip(scale).for_each(|((x, offset), scale)| *x = (*x - offset) * scale);
            }
            let found = net.forward(parameters, count, rows, tape);
            for i in 0..count {
                let out = &mut out[i * joints..][..joints];
                let is_lost = rows[i * width..][..inputs].iter().any(|x| !x.is_finite());
                for j in 0..joints {
                    let asked = found[i * padded(joints) + j] * super::UNIT;
                    out[j] = if is_lost { 0.0 } else { asked.clamp(-clip, clip) };
                }
                let target = &seen.targets[(part * ROWS + i) * joints..][..joints];
                remember(&mut past[i * 3 * joints..][..3 * joints], target, out);
            }
        });
    }
}

impl Compensator for PositionResidual {
    fn begin(&mut self, env: usize) {
        self.past.fresh[env] = true;
    }

    fn move_targets(&mut self, seen: &SimulatedStates, sent: &mut [f32]) {
        let mut moved = vec![0.0; sent.len()];
        self.corrections(seen, &mut moved);
        sent.iter_mut().zip(&moved).for_each(|(sent, moved)| *sent += moved);
    }

    fn for_count(&self, count: usize) -> Box<dyn Compensator> {
        Box::new(self.sized(count))
    }
}
