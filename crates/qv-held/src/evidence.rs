//! What is measured of a recording and its references: plain data, from which everything is decided.

use crate::hypothesis::Hypothesis;
use serde::{Deserialize, Serialize};

/// Rows of a square matrix.
pub type Square = Vec<Vec<f64>>;

/// A torque from outside for a while.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Joint at which it acts.
    pub joint: String,
    /// Run that it is in, from 0.
    pub run: usize,
    /// From and until \[s\].
    pub time: [f64; 2],
    /// Its mean over that time \[N m\], positive along the joint.
    pub torque: f64,
    /// Probability of one as large without a cause, all windows and joints together.
    pub p: f64,
}

/// How a size moves with the bandwidth of the rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Size in the wide band less size in the narrow one.
    pub size: Vec<f64>,
    /// Its covariance by how blocks differ.
    pub sandwich: Square,
    /// The same change in each reference that was left out.
    pub left_out: Vec<Vec<f64>>,
}

/// A hypothesis at its best.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HypothesisTest {
    /// What it is.
    pub hypothesis: Hypothesis,
    /// Values of its axes, as deviations from the robot as it is stated.
    pub size: Vec<f64>,
    /// Information on these in the recording.
    pub information: Square,
    /// Their covariance by how blocks differ.
    pub sandwich: Square,
    /// What no block sees adds to it: of masses and inertias the spread of the drives' scales, of delays the time between commands.
    pub unseen: Square,
    /// Variance of each axis by which a single reference may differ on another day.
    pub drift: Vec<f64>,
    /// Sizes in each reference that was left out.
    pub left_out: Vec<Vec<f64>>,
    /// Sizes by bandwidth; none where one of them cannot be fitted.
    pub change: Option<Change>,
    /// Loss of each block, predicted from the others.
    pub losses: Vec<f64>,
    /// Loss of each block of the equations that it acts on, without it, and predicted from the others.
    pub acted: [Vec<f64>; 2],
    /// Mean loss of references that were left out in these equations.
    pub reference_acted: f64,
    /// Loss of all rows at its best.
    pub loss: f64,
    /// Events that are left beside it; none where that was not looked for.
    pub events: Option<Vec<Event>>,
    /// What it leaves of each joint's torque \[N m\], in the order of the traces; empty where it was not followed.
    #[serde(skip)]
    pub left: Vec<Vec<f64>>,
}

/// Two hypotheses at once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairTest {
    /// Its members, by their indices among all hypotheses.
    pub members: [usize; 2],
    /// Both at their best: axes of the first, then the axis of the second.
    pub test: HypothesisTest,
    /// Sizes of the first number of each that robots of one make may differ by.
    pub tolerances: [f64; 2],
}

/// Indices of tests from the one with the least loss of its blocks on.
pub(crate) fn best_first<T>(tests: &[T], losses: impl Fn(&T) -> &Vec<f64>) -> Vec<usize> {
    let sums: Vec<f64> = tests.iter().map(|test| losses(test).iter().sum()).collect();
    let mut order: Vec<usize> = (0..tests.len()).collect();
    order.sort_by(|&a, &b| sums[a].total_cmp(&sums[b]));
    order
}

/// Friction and rotor of a joint, whatever the verdict.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointRow {
    /// Joint.
    pub joint: String,
    /// Value, standard deviation and what is stated: Coulomb friction \[N m\], viscous friction \[N m s/rad\], armature \[kg m²\].
    pub coulomb: [f64; 3],
    /// See `coulomb`.
    pub viscous: [f64; 3],
    /// See `coulomb`.
    pub armature: [f64; 3],
    /// Usual speed (95 % quantile) \[rad/s\] and rms acceleration \[rad/s²\].
    pub excitation: [f64; 2],
    /// Rms of torque: recorded, left by the robot as it is stated, and left with the row's values \[N m\].
    pub torque: [f64; 3],
}

/// Torques of a joint at the rows of its balance, all through one filter.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TorqueTrace {
    /// Joint.
    pub joint: String,
    /// Times \[s\], run after run.
    pub time: Vec<f64>,
    /// Run that each row is of, from 0.
    pub run: Vec<usize>,
    /// Speed of the joint \[rad/s\].
    pub speed: Vec<f64>,
    /// Recorded torque \[N m\].
    pub measured: Vec<f64>,
    /// Torque of the robot as its references show it \[N m\].
    pub predicted: Vec<f64>,
    /// The same with what is named as the cause \[N m\]; empty without.
    pub corrected: Vec<f64>,
    /// Recorded torque less that of links and rotor of the model \[N m\].
    pub friction: Vec<f64>,
}

/// All that is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Whether references are simulated.
    pub is_fleet: bool,
    /// Whether positions of servos are compared, for want of torques.
    #[serde(default)]
    pub is_of_positions: bool,
    /// Number of references, or pieces of one.
    pub references: usize,
    /// Single samples that jumped and were taken out.
    pub spikes: usize,
    /// From and until of each block \[s\].
    pub blocks: Vec<[f64; 2]>,
    /// Loss of each block without a cause; 1 is what references leave.
    pub none: Vec<f64>,
    /// Loss of all rows without a cause.
    pub loss: f64,
    /// Loss with everything free.
    pub free: f64,
    /// Losses of each reference that was left out: without a cause, and with everything free.
    pub left_out: Vec<[f64; 2]>,
    /// All hypotheses.
    pub tested: Vec<HypothesisTest>,
    /// Pairs of the best of them, where none alone explains the gap.
    #[serde(default)]
    pub pairs: Vec<PairTest>,
    /// Events without a steady cause.
    pub events: Vec<Event>,
    /// Joints.
    pub joints: Vec<JointRow>,
    /// Torques over time, for plots; empty where none are weighed.
    #[serde(skip)]
    pub traces: Vec<TorqueTrace>,
}

impl Evidence {
    /// Torques over time with what a hypothesis makes of them.
    pub fn torque_traces(&self, cause: Option<&HypothesisTest>) -> Vec<TorqueTrace> {
        let left = cause.map_or(&[][..], |tested| &tested.left);
        let mut all = self.traces.clone();
        all.iter_mut()
            .zip(left)
            .for_each(|(trace, left)| trace.corrected = qv_fit::linear::minus(&trace.measured, left));
        all
    }

    /// Mean loss of references that were left out.
    pub fn reference_loss(&self) -> f64 {
        self.left_out.iter().map(|l| l[0]).sum::<f64>() / self.left_out.len().max(1) as f64
    }
}
