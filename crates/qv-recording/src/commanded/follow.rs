//! Whose commands each joint follows: joints that are exchanged in the commands, turned signs and other units.
//!
//! The position of each joint is correlated with the commanded position of every joint, in blocks of the recording. A joint follows its own
//! commands unless another joint's explain it better, over all and in several blocks; what is exchanged must come out as whole cycles. A
//! trot commands diagonal legs alike, so they cannot be parted there: then nothing is reported.

use super::analysis::{Analysis, Check, Finding, cycles, number};
use super::reading::CommandReading;
use crate::lag::lags_behind_command;
use crate::run::Run;
use crate::slopes::{Reading, convention, fit};
use qv_core::JointSeries;

/// Blocks of a recording, and in how many of them a joint must move.
const BLOCKS: usize = 8;
const LEAST_BLOCKS: usize = 4;
/// Samples that are compared, at most.
const MOST: usize = 4000;
/// Delays of positions behind commands that are tried \[s\]: a servo follows within one of them.
const DELAYS: [f64; 4] = [0.0, 0.02, 0.05, 0.1];
/// Least motion of a joint or of a command in a block (standard deviation) \[rad\].
const LEAST_MOTION: f64 = 0.03;
/// Correlation from which on a joint follows a command.
const FOLLOWS: f64 = 0.8;
/// Share of what a joint's own commands leave unexplained that another's may leave.
const BETTER: f64 = 0.5;

/// A part of the recording: the motion about its mean, `[joints][samples]`, and the commands at each of [`DELAYS`].
struct Block {
    positions: Vec<Motion>,
    commands: Vec<[Motion; DELAYS.len()]>,
}

/// Samples about their mean \[rad\]; empty where they hardly move or some are missing.
type Motion = Vec<f64>;

/// What the motion of the joints shows of their commands: commands of another joint, of the other sign, in another unit, stamps that are late.
pub(super) fn analyse(run: &Run) -> Analysis {
    let mut reading = CommandReading::plain(run.joint_names.len());
    let nothing = |reading| Analysis { findings: Vec::new(), checks: Vec::new(), reading };
    let (Some(position), Some(commands)) = (&run.measured.position, &run.commands.position) else {
        return nothing(reading);
    };
    if position.joints != run.joint_names.len() || commands.joints != position.joints || commands.is_empty() {
        return nothing(reading);
    }
    let blocks = blocks(position, commands);
    let exchanged = exchanged(&blocks, position.joints);
    let mut findings = Vec::new();
    for joint in 0..position.joints {
        let name = &run.joint_names[joint];
        let found = match exchanged[joint] {
            Some(other) => {
                let other_name = &run.joint_names[other];
                reading.joints[joint].of = other;
                let what =
                    format!("the joint follows the commands of {other_name}: exchanged columns or names of joints");
                Some((what, format!("[joint.{name}] command_of = \"{other_name}\"")))
            }
            None => other_unit(&blocks, joint).map(|(what, scale)| {
                reading.joints[joint].scale = scale.unwrap_or(1.0);
                let line = scale.map(|s| format!("[joint.{name}] command_scale = {}", number(s)));
                (format!("against the joint's positions, {what}"), line.unwrap_or_default())
            }),
        };
        let channel = format!("commands {name}");
        findings.extend(found.map(|(what, line)| Finding { channel, what, line }));
    }
    let delay = leading(run, position.joints).filter(|_| findings.is_empty());
    findings.extend(delay.map(|delay| {
        reading.delay = delay;
        Finding {
            channel: "commands".into(),
            what: format!("joints move {:.0} ms before their commands are stamped: the stamps are late", -1e3 * delay),
            line: format!("[commands] delay = {delay:.4}"),
        }
    }));
    let checks = checks(run, &blocks, &findings);
    Analysis { findings, checks, reading }
}

/// A joint cannot move before its command \[s\].
const LEADING: f64 = -0.008;

/// The lag of joints behind their commands where it is clearly negative.
fn leading(run: &Run, joints: usize) -> Option<f64> {
    let columns: Vec<usize> = (0..joints).collect();
    let lags = lags_behind_command(run, &columns);
    let clear: Vec<f64> = lags.iter().filter(|l| l.after < 0.5 * l.before).map(|l| l.lag).collect();
    let most = clear.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (!clear.is_empty() && most < LEADING).then_some(most)
}

fn checks(run: &Run, blocks: &[Block], findings: &[Finding]) -> Vec<Check> {
    let joints = 0..run.joint_names.len();
    let moving = joints.clone().filter(|&j| blocks.iter().any(|b| b.follows(j, j).is_some())).count();
    let of = |word: &[&str]| findings.iter().filter(|f| word.iter().any(|w| f.what.contains(w))).count();
    let check = |name: &str, bad: usize| Check {
        name: name.into(),
        found: match bad {
            0 => format!("by the motion of {moving} of {} joints", joints.end),
            n => format!("another convention at {n} joints"),
        },
        is_ours: (moving > 0).then_some(bad == 0),
    };
    vec![
        check("order of commands", of(&["follows the commands of"])),
        check("sign and unit of commands", of(&["against the joint's positions"])),
        check("stamps of commands", of(&["stamped"])),
    ]
}

fn blocks(position: &JointSeries, commands: &JointSeries) -> Vec<Block> {
    let last = *commands.time.last().expect("commands that are not empty");
    let known =
        |i: &usize| position.time[*i] >= commands.time[0] + DELAYS[DELAYS.len() - 1] && position.time[*i] <= last;
    let samples: Vec<usize> = (0..position.len()).step_by(position.len().div_ceil(MOST).max(1)).filter(known).collect();
    let length = samples.len().div_ceil(BLOCKS).max(1);
    samples.chunks(length).map(|rows| block(position, commands, rows)).collect()
}

fn block(position: &JointSeries, commands: &JointSeries, rows: &[usize]) -> Block {
    let joints = 0..position.joints;
    let commanded = |joint: usize, delay: f64| {
        motion(rows.iter().map(|&i| commands.hold(position.time[i] - delay)[joint]).collect())
    };
    Block {
        positions: joints.clone().map(|j| motion(rows.iter().map(|&i| position.row(i)[j]).collect())).collect(),
        commands: joints.map(|j| DELAYS.map(|delay| commanded(j, delay))).collect(),
    }
}

fn motion(mut samples: Vec<f64>) -> Motion {
    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
    samples.iter_mut().for_each(|x| *x -= mean);
    let moves = deviation(&samples) > LEAST_MOTION && samples.len() >= 20;
    if moves { samples } else { Vec::new() }
}

/// Root of the mean square; NaN where a sample is missing.
fn deviation(motion: &[f64]) -> f64 {
    (motion.iter().map(|x| x * x).sum::<f64>() / motion.len() as f64).sqrt()
}

impl Block {
    /// Correlation of a joint's positions with a command, and its delay: the one at which it is strongest. None where either stands still.
    fn follows(&self, joint: usize, command: usize) -> Option<(f64, usize)> {
        let position = &self.positions[joint];
        let one = |delay: usize| {
            let commanded = &self.commands[command][delay];
            let both = !position.is_empty() && !commanded.is_empty();
            both.then(|| (correlation(position, commanded), delay))
        };
        (0..DELAYS.len()).filter_map(one).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
    }
}

fn correlation(x: &[f64], y: &[f64]) -> f64 {
    let product: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
    product / (x.len() as f64 * deviation(x) * deviation(y))
}

/// The joint whose commands each joint follows instead of its own.
fn exchanged(blocks: &[Block], joints: usize) -> Vec<Option<usize>> {
    // A joint outside of a cycle moves with another for a reason of its own.
    cycles((0..joints).map(|joint| followed(blocks, joint, joints)).collect())
}

fn followed(blocks: &[Block], joint: usize, joints: usize) -> Option<usize> {
    let own = unexplained(blocks, joint, joint);
    let others: Vec<(usize, MotionRemainder)> =
        (0..joints).filter(|k| *k != joint).map(|k| (k, unexplained(blocks, joint, k))).collect();
    let explains = |other: &&(usize, MotionRemainder)| {
        let better = other.1.blocks.iter().zip(&own.blocks).filter(|(other, own)| **other < BETTER * **own).count();
        better >= LEAST_BLOCKS && other.1.share < (BETTER * own.share).min(1.0 - FOLLOWS * FOLLOWS)
    };
    others.iter().filter(explains).min_by(|a, b| a.1.share.total_cmp(&b.1.share)).map(|(other, _)| *other)
}

/// What commands leave unexplained of a joint's motion.
struct MotionRemainder {
    /// Share of the square of the motion, over all blocks in which the joint moves.
    share: f64,
    /// The same of each of these blocks.
    blocks: Vec<f64>,
}

/// A command that stands still while the joint moves explains nothing.
fn unexplained(blocks: &[Block], joint: usize, command: usize) -> MotionRemainder {
    let moving = || blocks.iter().filter(|block| !block.positions[joint].is_empty());
    let left = |block: &Block| 1.0 - block.follows(joint, command).map_or(0.0, |(r, _)| r * r);
    let squares: Vec<f64> = moving().map(|block| deviation(&block.positions[joint]).powi(2)).collect();
    let blocks: Vec<f64> = moving().map(left).collect();
    let share =
        blocks.iter().zip(&squares).map(|(left, square)| left * square).sum::<f64>() / squares.iter().sum::<f64>();
    MotionRemainder { share, blocks }
}

/// What the commands of a joint are of its positions, where they go together and are of another sign or unit.
fn other_unit(blocks: &[Block], joint: usize) -> Option<(String, Option<f64>)> {
    let own: Vec<(&Block, f64, usize)> =
        blocks.iter().filter_map(|b| b.follows(joint, joint).map(|(r, delay)| (b, r, delay))).collect();
    if own.len() < LEAST_BLOCKS || own.iter().any(|(_, r, _)| r.abs() < FOLLOWS || r * own[0].1 < 0.0) {
        return None;
    }
    let pairs = own.iter().flat_map(|(block, _, delay)| {
        block.positions[joint].iter().copied().zip(block.commands[joint][*delay].iter().copied())
    });
    let (what, reading) = convention(fit(&pairs.collect::<Vec<_>>(), 0.0)?)?;
    let scale = if let Reading::Scaled(by) = reading { Some(by) } else { None };
    Some((what, scale))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Base, Robot};

    const JOINTS: usize = 4;

    /// Four joints that follow chirps of their own with a lag and some noise for 20 s, commanded by `commanded(joint, time)`.
    fn run(commanded: &dyn Fn(usize, f64) -> f64) -> Run {
        let time: Vec<f64> = (0..2000).map(|i| 0.01 * f64::from(i)).collect();
        let series = |of: &dyn Fn(usize, f64) -> f64| {
            let values = time.iter().flat_map(|&t| (0..JOINTS).map(move |j| of(j, t))).collect();
            Some(JointSeries::new(time.clone(), values, JOINTS).unwrap())
        };
        let noise = |j: usize, t: f64| 0.01 * (713.0 * t + j as f64).sin();
        let names = ["a", "b", "c", "d"].map(String::from).to_vec();
        let mut run = Run::empty(Robot::Named("arm".into()), Base::Fixed, names);
        run.commands.position = series(commanded);
        run.measured.position = series(&|j, t| 0.9 * wanted(j, t - 0.03) + noise(j, t));
        run
    }

    fn wanted(joint: usize, time: f64) -> f64 {
        let rate = 1.0 + 0.7 * joint as f64;
        0.4 * (rate * time + 0.05 * time * time).sin() + 0.1 * joint as f64
    }

    fn reported(commanded: &dyn Fn(usize, f64) -> f64) -> Vec<(String, String)> {
        analyse(&run(commanded)).findings.into_iter().map(|f| (f.channel, f.what)).collect()
    }

    #[test]
    fn right_commands_are_not_reported() {
        assert_eq!(reported(&wanted), []);
        assert_eq!(reported(&|_, _| 0.3), [], "commands that stand still");
    }

    #[test]
    fn exchanged_joints_are_named_with_each_other() {
        let swap = |joint: usize| [1, 0, 2, 3][joint];
        let found = reported(&|j, t| wanted(swap(j), t));
        assert_eq!(found.iter().map(|f| f.0.as_str()).collect::<Vec<_>>(), ["commands a", "commands b"]);
        assert!(found[0].1.contains("commands of b") && found[1].1.contains("commands of a"), "{found:?}");
        let turn = |joint: usize| [1, 2, 0, 3][joint];
        assert_eq!(reported(&|j, t| wanted(turn(j), t)).len(), 3);
    }

    #[test]
    fn signs_and_units_are_reported() {
        let sign = |joint: usize| if joint == 2 { -1.0 } else { 1.0 };
        let found = reported(&|j, t| sign(j) * wanted(j, t));
        assert!(found.len() == 1 && found[0].0 == "commands c" && found[0].1.contains("sign"), "{found:?}");
        let found = reported(&|j, t| wanted(j, t).to_degrees());
        assert!(found.len() == JOINTS && found[0].1.contains("degrees"), "{found:?}");
    }

    #[test]
    fn a_joint_that_moves_with_another_is_no_exchange() {
        // c is commanded to stand and swings with d; b repeats the commands of a.
        let stands = |joint: usize, time: f64| match joint {
            1 => wanted(0, time),
            joint => wanted(joint, time),
        };
        let mut both = run(&stands);
        let position = both.measured.position.as_mut().unwrap();
        position.values.chunks_exact_mut(JOINTS).for_each(|row| row[1] = row[0]);
        assert!(analyse(&both).findings.is_empty());
    }
}
