//! Residual torques: a network foretells from what a joint does and is told to do the torque that must be added to that of
//! its motor, as in ASAP (He et al. 2025, arXiv:2502.01143, there as a change of the action) and unsupervised actuator nets (Fey
//! et al. 2025, arXiv:2502.10894). It names no cause.
//!
//! No recording has residual torques to learn from. They are learnt through the simulator: the change of a window's
//! features by a torque on each joint in each piece of 20 ms is found by simulation, and the weights follow the slope of what is
//! left, in units of the null, which is what they are judged by. Inputs are those of the nominal simulation, which
//! starts from the measured state and then sees commands only: what was measured later cannot leak in. The torques are added
//! to the commanded feed-forward torque, so that the law of the actuator sees them, too.

use crate::Answer;
use crate::network::{Adam, HIDDEN, Network};
use crate::plain::Plain;
use qv_core::JointSeries;
use qv_core::random::SplitMix64;
use qv_fit::Matrix;
use qv_fit::linear::{dot, gram, squared, times, transposed_times};
use qv_gap::GapError;
use qv_gap::inference::linearised::{LinearisedProblem, LinearisedWindow};
use qv_rollout::Channel;
use qv_rollout::Raw;
use qv_rollout::channels;
use qv_rollout::compare;
use qv_rollout::law::{self, ActuatorModel};
use qv_rollout::{Overrides, Rollout, Window, measured};
use rayon::prelude::*;

/// For so long a torque is held \[s\].
const PIECE: f64 = 0.02;
/// Torque of the finite differences, as a share of the joint's typical torque.
const PUSH: f64 = 0.1;
/// Typical torque of a joint that is commanded none \[N m\].
const SOME_TORQUE: f64 = 0.3;
/// Passes over the windows, and windows of each step of Adam.
const EPOCHS: usize = 150;
const TOGETHER: usize = 8;
const RATE: f64 = 0.003;
/// Every so manieth window of the fit decides which epoch is kept.
const VALIDATION: usize = 5;
/// Ages of the commands that are inputs \[s\].
const AGES: [f64; 2] = [0.025, 0.05];

/// A window as the network sees it.
struct Example {
    /// Of each piece and joint, shape `[pieces, joints][inputs]`.
    inputs: Vec<Vec<f64>>,
}

/// What is left of a fitted window with torques `x`: `e - 2 b'x + x'Hx`, over `count` numbers.
struct Quadratic {
    h: Matrix,
    b: Vec<f64>,
    e: f64,
    count: f64,
}

/// Trains on the windows of the fits, and says how far the gap of the others closes.
///
/// # Errors
/// When the simulator refuses.
pub fn answer(plain: &mut Plain, seed: u64) -> Result<Answer, GapError> {
    let study = &plain.study;
    let mut examples: Vec<Example> = study.seen.par_iter().map(|seen| example(&study.rollout, seen)).collect();
    let scales = torque_scales(&study.rollout, &examples, &plain.fitted);
    standardise(&mut examples, &plain.fitted);
    let fitted: Vec<&LinearisedWindow> = plain.fitted.iter().map(|&w| &study.seen[w]).collect();
    let found: Vec<(Option<Quadratic>, usize)> =
        fitted.iter().map(|seen| quadratic(study, seen, &scales)).collect::<Result<_, GapError>>()?;
    let mut steps: usize = found.iter().map(|f| f.1).sum();
    let whole: Vec<(&Example, &Quadratic)> = plain
        .fitted
        .iter()
        .zip(&found)
        .filter_map(|(&w, (quadratic, _))| quadratic.as_ref().map(|q| (&examples[w], q)))
        .collect();
    let network = train(&whole, seed);
    let raws: Vec<(Raw, usize)> = plain
        .held_out
        .iter()
        .map(|&w| {
            let torques = torques(&study.rollout, &network, &examples[w], &scales);
            under(study, &study.seen[w], &torques)
        })
        .collect::<Result<_, GapError>>()?;
    steps += raws.iter().map(|r| r.1).sum::<usize>();
    let after: Vec<Raw> = raws.into_iter().map(|r| r.0).collect();
    let closed = plain.closed_by(&after);
    plain.study.count(steps);
    Ok(Answer::new("unnamed", Vec::new(), Vec::new(), closed))
}

/// Pieces of a window.
fn pieces(rollout: &Rollout) -> usize {
    (rollout.cut.window / PIECE).ceil() as usize
}

/// Simulated positions and speeds at the middle of each bin, shape `[joints][bins]`: measured less residual.
fn simulated(rollout: &Rollout, seen: &LinearisedWindow) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let bins = rollout.cut.bins();
    let features: usize = rollout.channels.iter().map(|&c| channels::width(c, bins)).sum();
    // Windows of a study could be prepared once already.
    let measured = measured(rollout, &seen.window).unwrap_or_else(|| vec![f64::NAN; features]);
    let mut position = vec![vec![f64::NAN; bins]; rollout.columns.len()];
    let mut speed = position.clone();
    let mut first = 0;
    for &channel in &rollout.channels {
        let width = channels::width(channel, bins);
        let values = || (first..first + width).map(|i| measured[i] - seen.raw.motion[i]).collect();
        match channel {
            Channel::Position(j) => position[j] = values(),
            Channel::Velocity(j) => speed[j] = values(),
            _ => {}
        }
        first += width;
    }
    for (q, dq) in position.iter().zip(&mut speed).filter(|(_, dq)| dq.iter().any(|x| !x.is_finite())) {
        let slope = |b: usize| {
            let (from, to) = (b.saturating_sub(1), (b + 1).min(bins - 1));
            (q[to] - q[from]) / ((to - from).max(1) as f64 * rollout.cut.bin)
        };
        *dq = (0..bins).map(slope).collect();
    }
    (position, speed)
}

/// Value `at` so many bins after the middle of the first, of a line through the two nearest middles.
fn between(middles: &[f64], at: f64) -> f64 {
    if middles.len() < 2 {
        return middles.first().copied().unwrap_or(f64::NAN);
    }
    let k = (at.max(0.0) as usize).min(middles.len() - 2);
    middles[k] + (at - k as f64) * (middles[k + 1] - middles[k])
}

/// Of each joint in each piece: position, speed, error, older commands against the present one, commanded speed, the law's
/// torque, how the trunk leans, and which joint it is. What a recording lacks is 0.
fn example(rollout: &Rollout, seen: &LinearisedWindow) -> Example {
    let (position, speed) = simulated(rollout, seen);
    let (run, window) = (&seen.window.view, &seen.window);
    let c = &run.commands;
    let lean = window.attitude.first().map_or([0.0; 2], |world_from_base| {
        let down = world_from_base.conjugate() * glam::DVec3::NEG_Z;
        [down.x, down.y]
    });
    let joints = rollout.columns.len();
    let mut inputs = Vec::with_capacity(joints * pieces(rollout));
    for piece in 0..pieces(rollout) {
        let since = (piece as f64 + 0.5) * PIECE;
        let (t, bin) = (window.start + since, since / rollout.cut.bin - 0.5);
        for (j, &column) in rollout.columns.iter().enumerate() {
            let held = |series: &Option<JointSeries>, at: f64, missing: f64| {
                let some = series.as_ref().filter(|s| !s.is_empty()).map(|s| s.hold(at)[column]);
                some.filter(|x| x.is_finite()).unwrap_or(missing)
            };
            let (q, dq) = (between(&position[j], bin), between(&speed[j], bin));
            let told = held(&c.position, t, q);
            let error = told - q;
            let faster = held(&c.velocity, t, 0.0);
            let (kp, kd) = (run.actuator.kp.unwrap_or(0.0), run.actuator.kd.unwrap_or(0.0));
            let torque = held(&c.kp, t, kp) * error + held(&c.kd, t, kd) * (faster - dq) + held(&c.torque, t, 0.0);
            let mut row = vec![torque, q, dq, error, faster, lean[0], lean[1]];
            row.extend(AGES.map(|age| told - held(&c.position, t - age, told)));
            row.extend((0..joints).map(|k| f64::from(u8::from(k == j))));
            row.iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = 0.0);
            inputs.push(row);
        }
    }
    Example { inputs }
}

/// Typical torque of each joint in the windows of the fits \[N m\].
fn torque_scales(rollout: &Rollout, examples: &[Example], fitted: &[usize]) -> Vec<f64> {
    let joints = rollout.columns.len();
    let scale = |j: usize| {
        let rows = || fitted.iter().flat_map(|&w| examples[w].inputs.iter().skip(j).step_by(joints));
        let rms = (rows().map(|row| row[0] * row[0]).sum::<f64>() / rows().count().max(1) as f64).sqrt();
        if rms > 0.0 { rms } else { SOME_TORQUE }
    };
    (0..joints).map(scale).collect()
}

/// Mean 0 and deviation 1 of each input over the windows of the fits.
fn standardise(examples: &mut [Example], fitted: &[usize]) {
    let Some(width) = examples.first().and_then(|e| e.inputs.first()).map(Vec::len) else { return };
    for i in 0..width {
        let all: Vec<f64> = fitted.iter().flat_map(|&w| examples[w].inputs.iter().map(|row| row[i])).collect();
        let count = all.len().max(1) as f64;
        let mean = all.iter().sum::<f64>() / count;
        let deviation = (all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt();
        let scale = if deviation > 1e-12 { 1.0 / deviation } else { 0.0 };
        examples.iter_mut().flat_map(|e| &mut e.inputs).for_each(|row| row[i] = (row[i] - mean) * scale);
    }
}

/// The window with `torques`, shape `[pieces, joints]` \[N m\], added to the commanded ones.
fn pushed(rollout: &Rollout, window: &Window, torques: &[f64]) -> Window {
    let (count, joints) = (pieces(rollout), rollout.columns.len());
    let commands = &window.view.commands;
    let stamps = |s: &Option<JointSeries>| s.as_ref().map_or(Vec::new(), |s| s.time.clone());
    let edges = (0..=count).map(|k| window.start + k as f64 * PIECE);
    let mut time: Vec<f64> = stamps(&commands.torque).into_iter().chain(edges).collect();
    time.sort_by(f64::total_cmp);
    time.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    let width = commands.torque.as_ref().map_or(window.view.joint_names.len(), |s| s.joints);
    let mut values = Vec::with_capacity(time.len() * width);
    for &t in &time {
        let mut row = match &commands.torque {
            Some(series) if !series.is_empty() => series.hold(t).to_vec(),
            _ => vec![0.0; width],
        };
        let piece = ((t - window.start) / PIECE + 1e-4).floor();
        if (0.0..count as f64).contains(&piece) {
            let of_piece = &torques[piece as usize * joints..(piece as usize + 1) * joints];
            rollout.columns.iter().zip(of_piece).for_each(|(&column, torque)| row[column] += torque);
        }
        values.extend(row);
    }
    let mut view = window.view.clone();
    view.commands.torque = Some(JointSeries { time, values, joints: width });
    window.seen_as(view)
}

/// Raw residual of a window under torques, empty when it runs away, and the steps that were simulated.
fn under(study: &LinearisedProblem, seen: &LinearisedWindow, torques: &[f64]) -> Result<(Raw, usize), GapError> {
    let rollout = &study.rollout;
    let window = pushed(rollout, &seen.window, torques);
    let mut found = compare(rollout, &rollout.numerics, &[&window], &[Overrides::new()])?;
    let motion = std::mem::take(&mut found.values[0][0]);
    let law = law::residual(rollout, &window, &Overrides::new(), study.parts[window.run].alignment);
    let whole = !motion.is_empty() && law.iter().all(|x| x.is_finite());
    Ok((if whole { Raw { motion, law } } else { Raw::default() }, found.steps))
}

/// The loss of a window in its torques, shape `[pieces, joints]` in units of `scales`, by finite differences; `None` when one
/// of them runs away. And the steps that were simulated.
fn quadratic(
    study: &LinearisedProblem,
    seen: &LinearisedWindow,
    scales: &[f64],
) -> Result<(Option<Quadratic>, usize), GapError> {
    let rollout = &study.rollout;
    let (count, joints) = (pieces(rollout), rollout.columns.len());
    let push = |k: usize| {
        let mut torques = vec![0.0; count * joints];
        torques[k] = PUSH * scales[k % joints];
        pushed(rollout, &seen.window, &torques)
    };
    let windows: Vec<Window> = (0..count * joints).into_par_iter().map(push).collect();
    let all: Vec<&Window> = windows.iter().collect();
    let found = compare(rollout, &rollout.numerics, &all, &[Overrides::new()])?;
    let alignment = study.parts[seen.window.run].alignment;
    let laws: Vec<ActuatorModel> =
        rollout.law_joints.iter().map(|&j| ActuatorModel::new(rollout, &Overrides::new(), j)).collect();
    let column = |(k, motion): (usize, &Vec<f64>)| {
        let mut law = seen.raw.law.clone();
        if let Some(at) = rollout.law_joints.iter().position(|&j| j == k % joints) {
            let of_joint = law::of_joint(rollout, &windows[k], &laws[at], alignment);
            law[at * of_joint.len()..(at + 1) * of_joint.len()].copy_from_slice(&of_joint);
        }
        let whole = !motion.is_empty() && law.iter().all(|x| x.is_finite());
        whole.then(|| seen.raw.minus(&Raw { motion: motion.clone(), law }))
    };
    let changes: Option<Vec<Raw>> = found.values[0].par_iter().enumerate().map(column).collect();
    let quadratic = changes.map(|changes| {
        let r = &seen.residual;
        let s = study.whitener(seen).differences(seen.index, &changes.iter().collect::<Vec<_>>()) * (1.0 / PUSH);
        Quadratic { h: gram(&s), b: transposed_times(&s, r), e: squared(r), count: r.len() as f64 }
    });
    Ok((quadratic, found.steps))
}

impl Quadratic {
    /// Loss per number at torques, and its slope along them.
    fn at(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let hx = times(&self.h, x);
        let loss = (self.e - 2.0 * dot(&self.b, x) + dot(x, &hx)) / self.count;
        (loss, hx.iter().zip(&self.b).map(|(hx, b)| (hx - b) * (2.0 / self.count)).collect())
    }
}

/// The network of the epoch that does best on the windows set aside; one that adds nothing when none does better.
fn train(windows: &[(&Example, &Quadratic)], seed: u64) -> Network {
    let inputs = windows.first().and_then(|w| w.0.inputs.first()).map_or(0, Vec::len);
    let mut network = Network::new(inputs, seed);
    let mut adam = Adam::new(network.weights.len(), RATE);
    let (mut order, aside): (Vec<usize>, Vec<usize>) =
        (0..windows.len()).partition(|k| k % VALIDATION != VALIDATION - 1);
    let loss = |network: &Network| {
        let of = |&k: &usize| windows[k].1.at(&outputs(network, windows[k].0)).0;
        aside.iter().map(of).sum::<f64>()
    };
    let (mut best, mut least) = (network.clone(), loss(&network));
    let mut random = SplitMix64::of(seed, 4003);
    for _ in 0..EPOCHS {
        for k in (1..order.len()).rev() {
            order.swap(k, ((random.uniform() * (k + 1) as f64) as usize).min(k));
        }
        for some in order.chunks(TOGETHER) {
            // Summed in order: the same bits on any number of threads.
            let gradients: Vec<Vec<f64>> = some.par_iter().map(|&k| gradient(&network, windows[k])).collect();
            let mut sum = vec![0.0; network.weights.len()];
            gradients.iter().for_each(|g| sum.iter_mut().zip(g).for_each(|(s, g)| *s += g / some.len() as f64));
            adam.step(&mut network.weights, &sum);
        }
        let now = loss(&network);
        if now < least {
            (best, least) = (network.clone(), now);
        }
    }
    best
}

/// Torques of a window, shape `[pieces, joints]`, in units of the joints' typical ones.
fn outputs(network: &Network, example: &Example) -> Vec<f64> {
    let mut hidden = [0.0; HIDDEN];
    example.inputs.iter().map(|x| network.output(x, &mut hidden)).collect()
}

/// The same in N m.
fn torques(rollout: &Rollout, network: &Network, example: &Example, scales: &[f64]) -> Vec<f64> {
    let joints = rollout.columns.len();
    outputs(network, example).iter().enumerate().map(|(k, x)| x * scales[k % joints]).collect()
}

/// Of the loss of a window along the weights.
fn gradient(network: &Network, (example, quadratic): (&Example, &Quadratic)) -> Vec<f64> {
    let (_, slope) = quadratic.at(&outputs(network, example));
    let mut gradient = vec![0.0; network.weights.len()];
    let mut hidden = [0.0; HIDDEN];
    for (x, slope) in example.inputs.iter().zip(slope.iter()) {
        network.output(x, &mut hidden);
        network.add_gradient(x, &hidden, *slope, &mut gradient);
    }
    gradient
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Windows whose loss asks for the torque `tanh(2 x)` of the first input.
    fn windows(count: usize, seed: u64) -> Vec<(Example, Quadratic)> {
        let mut random = SplitMix64::of(seed, 0);
        let window = |_| {
            let inputs: Vec<Vec<f64>> = (0..6).map(|_| vec![random.normal(1.0), random.normal(1.0)]).collect();
            let b: Vec<f64> = inputs.iter().map(|x| (2.0 * x[0]).tanh()).collect();
            let quadratic = Quadratic { h: Matrix::identity(6, 6), e: squared(&b), b, count: 6.0 };
            (Example { inputs }, quadratic)
        };
        (0..count).map(window).collect()
    }

    #[test]
    fn torques_that_windows_ask_for_are_learnt() {
        let (seen, unseen) = (windows(40, 1), windows(20, 2));
        let network = train(&seen.iter().map(|(e, q)| (e, q)).collect::<Vec<_>>(), 3);
        let left: f64 = unseen.iter().map(|(e, q)| q.at(&outputs(&network, e)).0).sum();
        let all: f64 = unseen.iter().map(|(_, q)| q.e / q.count).sum();
        assert!(left < 0.1 * all, "{left} of {all}");
    }

    #[test]
    fn between_the_middles_of_bins_and_beyond_lie_lines() {
        let middles = [1.0, 2.0, 4.0];
        assert_eq!([-0.5, 0.5, 1.5, 2.5].map(|at| between(&middles, at)), [0.5, 1.5, 3.0, 5.0]);
        assert!(between(&[3.0], 1.0) == 3.0 && between(&[], 1.0).is_nan());
    }

    #[test]
    fn without_windows_nothing_is_learnt() {
        let network = train(&[], 1);
        assert_eq!(network.output(&[], &mut [0.0; HIDDEN]), 0.0);
    }

    #[test]
    fn the_slope_is_that_of_the_loss() {
        let (example, mut quadratic) = windows(1, 5).remove(0);
        quadratic.h[(0, 1)] = 0.3;
        quadratic.h[(1, 0)] = 0.3;
        let x: Vec<f64> = outputs(&Network::new(2, 1), &example).iter().map(|x| x + 0.4).collect();
        let (loss, slope) = quadratic.at(&x);
        let mut moved = x.clone();
        moved[1] += 1e-6;
        assert!(((quadratic.at(&moved).0 - loss) / 1e-6 - slope[1]).abs() < 1e-5);
    }
}
