//! Joints whose axis is turned round, or whose columns are exchanged with another's, in all channels alike: no channel contradicts another
//! then, but the simulator does, by gravity and inertia.

use crate::engine::{ReplayOptions, simulate};
use crate::error::ReplayError;
use crate::errors;
use qv_core::JointSeries;
use qv_recording::Run;
use qv_rollout::channels::snippet;
use qv_sim::{Model, Terrain};

/// Error in windows from which on a mistake is looked for (mean over joints) \[rad\].
const LOOKED_AT: f64 = 0.005;
/// Share of the error that may be left without the mistake.
const LEFT: f64 = 0.4;
/// Stretches that are replayed, and their length \[s\].
const STRETCHES: usize = 2;
const LENGTH: f64 = 1.3;
/// Joints of which pairs are tried at most: more take too long.
const MOST_PAIRED: usize = 20;

/// What was mistaken about the joints of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointMistake {
    /// The joint's axis is turned round.
    Turned(usize),
    /// The columns of two joints are exchanged.
    Exchanged(usize, usize),
}

/// A mistake, and the errors of windows with and without it (mean over joints) \[rad\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MistakenJoints {
    /// What it is; joints are those of the run.
    pub mistake: JointMistake,
    /// Error of windows as recorded.
    pub before: f64,
    /// Error of windows read otherwise.
    pub after: f64,
}

impl JointMistake {
    /// Channels of `run` read without it.
    pub fn undo(self, run: &mut Run) {
        let (c, m) = (&mut run.commands, &mut run.measured);
        let signed = [&mut c.position, &mut c.velocity, &mut c.torque, &mut m.position, &mut m.velocity, &mut m.torque];
        let gains = [&mut c.kp, &mut c.kd];
        let change = |series: &mut JointSeries, is_signed: bool| {
            for row in series.values.chunks_exact_mut(series.joints) {
                match self {
                    Self::Turned(joint) if is_signed => row[joint] = -row[joint],
                    Self::Turned(_) => {}
                    Self::Exchanged(a, b) => row.swap(a, b),
                }
            }
        };
        signed.into_iter().flatten().for_each(|series| change(series, true));
        gains.into_iter().flatten().for_each(|series| change(series, false));
    }

    /// What it is, in words.
    pub fn words(self, names: &[String]) -> String {
        match self {
            Self::Turned(joint) => format!("joint {} is turned round in all channels", names[joint]),
            Self::Exchanged(a, b) => format!("joints {} and {} are exchanged in all channels", names[a], names[b]),
        }
    }

    /// The lines of `run.toml` that read the recording without it.
    pub fn lines(self, names: &[String]) -> String {
        match self {
            Self::Turned(joint) => format!("[joint.{}] sign = -1", names[joint]),
            Self::Exchanged(a, b) => {
                let (a, b) = (&names[a], &names[b]);
                format!("[joint.{a}] columns_of = \"{b}\", [joint.{b}] columns_of = \"{a}\"")
            }
        }
    }
}

/// Looks for a joint that is turned round or exchanged with another, where windows are far from the recording. `None` where they are near,
/// or nothing explains it.
///
/// # Errors
/// As [`crate::replay`].
pub fn mistaken_joints(
    run: &Run,
    model: &Model,
    terrain: &Terrain,
    options: &ReplayOptions,
) -> Result<Option<MistakenJoints>, ReplayError> {
    let pieces = pieces(run);
    let before = error(&pieces, model, terrain, options)?;
    if before.is_nan() || before < LOOKED_AT {
        return Ok(None);
    }
    let joints: Vec<usize> =
        (0..run.joint_names.len()).filter(|&j| model.joint_names().contains(&run.joint_names[j])).collect();
    let turned = joints.iter().map(|j| JointMistake::Turned(*j));
    let pairs = joints.iter().enumerate().flat_map(|(k, a)| joints[k + 1..].iter().map(|b| (*a, *b)));
    let exchanged = pairs.filter(|_| joints.len() <= MOST_PAIRED).map(|(a, b)| JointMistake::Exchanged(a, b));
    let mut best: Option<MistakenJoints> = None;
    for mistake in turned.chain(exchanged) {
        let mut read = pieces.clone();
        read.iter_mut().for_each(|piece| mistake.undo(piece));
        // A reading that cannot be simulated is none.
        let after = error(&read, model, terrain, options).unwrap_or(f64::NAN);
        if after < LEFT * before && best.is_none_or(|b| after < b.after) {
            best = Some(MistakenJoints { mistake, before, after });
        }
    }
    Ok(best)
}

/// Short stretches of the recording, spread over it.
fn pieces(run: &Run) -> Vec<Run> {
    let [start, end] = run.span();
    let share = (end - start) / STRETCHES as f64;
    let middle = |k: usize| start + share * (k as f64 + 0.5);
    (0..STRETCHES).map(|k| snippet(run, middle(k) - 0.5 * LENGTH, middle(k) + 0.5 * LENGTH)).collect()
}

/// Error of windows: mean over joints and pieces of the root mean square of positions.
fn error(pieces: &[Run], model: &Model, terrain: &Terrain, options: &ReplayOptions) -> Result<f64, ReplayError> {
    let mut sum = 0.0;
    for piece in pieces {
        let simulated = simulate(piece, model, terrain, options)?;
        sum += errors::of_windows(&simulated.recorded, &simulated.windows, &simulated.feet).position_mean();
    }
    Ok(sum / pieces.len() as f64)
}
