//! `cargo xtask bench walk`: what a policy that walks costs, and the learner beside rsl_rl's on one thread of the CPU.
//!
//! All but wall time is CPU time of all threads of a process: other work on the machine changes it little.

use super::contest::{build, last_line, median, write};
use crate::python;
use crate::workspace::Workspace;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::Command;

/// How to measure.
#[derive(clap::Args)]
pub struct Walk {
    /// Seeds of the trainings up to the goal
    #[arg(long, value_delimiter = ',', default_values_t = [1, 2, 3])]
    seeds: Vec<u64>,
    /// One seed, one round, few iterations: to see that all of it runs
    #[arg(long)]
    quick: bool,
}

/// How much is run.
struct Size {
    /// Most iterations of a training up to the goal.
    most: u64,
    /// Iterations before those that are measured, and those.
    iterations: [u64; 2],
    /// Times that the contestants take turns.
    rounds: usize,
    /// Updates of rsl_rl in a round.
    updates: usize,
}

const FULL: Size = Size { most: 600, iterations: [40, 60], rounds: 3, updates: 20 };
const QUICK: Size = Size { most: 20, iterations: [5, 5], rounds: 1, updates: 3 };
const GROUNDS: [&str; 2] = ["plane", "bumps"];

/// What `bench_walk goal` prints.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
struct Goal {
    reached: bool,
    cpu_seconds: f64,
    wall_seconds: f64,
    samples: u64,
    velocity_error: Option<f64>,
    turning_error: Option<f64>,
}

/// What `bench_walk loop` prints.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Loop {
    steps_per_cpu_second: f64,
    update_seconds: f64,
    rollout_networks_seconds: f64,
    share: Share,
    critic_inputs: usize,
}

/// Shares of the time of an iteration.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
struct Share {
    physics: f64,
    observe_and_reward: f64,
    networks_forward: f64,
    update: f64,
}

/// What `fixtures/walk/bench.py` prints.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Peer {
    update_seconds: f64,
    rollout_networks_seconds: f64,
    torch: String,
}

/// Medians over the rounds on one ground.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Row {
    ground: String,
    steps_per_cpu_second: f64,
    share: Share,
}

/// Our learner and rsl_rl's: medians over the rounds, ratios taken within a round.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Beside {
    torch: String,
    update_seconds: [f64; 2],
    update_times_peer: f64,
    rollout_networks_seconds: [f64; 2],
    rollout_networks_times_peer: f64,
}

/// All results.
#[derive(Debug, Clone, Serialize)]
struct Results {
    goals: Vec<(u64, Goal)>,
    rows: Vec<Row>,
    learner: Option<Beside>,
}

/// Runs the benchmark, which has no gate.
///
/// # Errors
/// Our side cannot be built, or a contestant fails or prints something unexpected.
pub fn run(workspace: &Workspace, walk: &Walk) -> Result<bool> {
    let size = if walk.quick { QUICK } else { FULL };
    let Some(first) = walk.seeds.first() else { bail!("--seeds: expected at least one, found none") };
    let seeds = if walk.quick { vec![*first] } else { walk.seeds.clone() };
    let ours = build(workspace, "bench_walk", &[])?;
    let peer = match python::environment(workspace, "walk") {
        Ok(python) => Some(python),
        Err(error) => {
            println!("rsl_rl is skipped, what fixtures/walk/requirements.txt names could not be installed: {error:#}");
            None
        }
    };
    let script = workspace.workspace_root.join("fixtures/walk/bench.py");
    let (mut loops, mut peers) = ([vec![], vec![]], vec![]);
    for round in 0..size.rounds {
        eprintln!("round {} of {}", round + 1, size.rounds);
        for (ground, taken) in GROUNDS.iter().zip(&mut loops) {
            taken.push(one_loop(&ours, ground, &size)?);
        }
        if let Some(python) = &peer {
            peers.push(one_peer(python, &script, loops[0][round].critic_inputs, &size)?);
        }
    }
    let mut goals = Vec::new();
    for seed in seeds {
        eprintln!("to the goal: seed {seed}");
        goals.push((seed, one_goal(&ours, seed, &size)?));
    }
    let rows: Vec<Row> = GROUNDS.iter().zip(&loops).map(|(ground, taken)| row(ground, taken)).collect();
    let learner = beside(&loops[0], &peers);
    print(&goals, &rows, learner.as_ref());
    write(workspace, "walk.json", &Results { goals, rows, learner })?;
    Ok(true)
}

fn one_goal(ours: &PathBuf, seed: u64, size: &Size) -> Result<Goal> {
    let mut program = Command::new(ours);
    program.args(["goal", &seed.to_string(), &size.most.to_string()]);
    let goal: Goal = last_line(&mut program)?;
    positive(&program, &[goal.cpu_seconds, goal.wall_seconds])?;
    Ok(goal)
}

fn one_loop(ours: &PathBuf, ground: &str, size: &Size) -> Result<Loop> {
    let mut program = Command::new(ours);
    program.args(["loop", ground]).args(size.iterations.map(|count| count.to_string()));
    let taken: Loop = last_line(&mut program)?;
    positive(&program, &[taken.steps_per_cpu_second, taken.update_seconds, taken.rollout_networks_seconds])?;
    Ok(taken)
}

fn one_peer(python: &Path, script: &Path, critic: usize, size: &Size) -> Result<Peer> {
    let mut program = Command::new(python);
    program.env("PYTHONDONTWRITEBYTECODE", "1").arg(script);
    program.args(["--critic", &critic.to_string(), "--updates", &size.updates.to_string()]);
    let peer: Peer = last_line(&mut program)?;
    positive(&program, &[peer.update_seconds, peer.rollout_networks_seconds])?;
    Ok(peer)
}

fn positive(program: &Command, numbers: &[f64]) -> Result<()> {
    match numbers.iter().find(|x| !(x.is_finite() && **x > 0.0)) {
        Some(bad) => bail!("{program:?}: expected positive numbers, found {bad}"),
        None => Ok(()),
    }
}

fn middle<T>(taken: &[T], number: impl Fn(&T) -> f64) -> f64 {
    median(taken.iter().map(number).collect())
}

fn row(ground: &str, taken: &[Loop]) -> Row {
    Row {
        ground: ground.into(),
        steps_per_cpu_second: middle(taken, |l| l.steps_per_cpu_second),
        share: Share {
            physics: middle(taken, |l| l.share.physics),
            observe_and_reward: middle(taken, |l| l.share.observe_and_reward),
            networks_forward: middle(taken, |l| l.share.networks_forward),
            update: middle(taken, |l| l.share.update),
        },
    }
}

/// `None` without a peer.
fn beside(ours: &[Loop], peers: &[Peer]) -> Option<Beside> {
    let torch = peers.first()?.torch.clone();
    let rounds: Vec<(&Loop, &Peer)> = ours.iter().zip(peers).collect();
    Some(Beside {
        torch,
        update_seconds: [middle(ours, |l| l.update_seconds), middle(peers, |p| p.update_seconds)],
        update_times_peer: middle(&rounds, |(l, p)| p.update_seconds / l.update_seconds),
        rollout_networks_seconds: [
            middle(ours, |l| l.rollout_networks_seconds),
            middle(peers, |p| p.rollout_networks_seconds),
        ],
        rollout_networks_times_peer: middle(&rounds, |(l, p)| p.rollout_networks_seconds / l.rollout_networks_seconds),
    })
}

fn print(goals: &[(u64, Goal)], rows: &[Row], learner: Option<&Beside>) {
    println!("Go2 on the plane until |v| < 0.15 m/s, |wz| < 0.2 rad/s and nobody falls; CPU seconds of all threads:");
    println!("| seed | reached | CPU, s | wall, s | million samples | best: m/s | rad/s |");
    println!("|---:|---|---:|---:|---:|---:|---:|");
    for (seed, goal) in goals {
        println!("{}", goal_line(*seed, goal));
    }
    println!("| ground | robot steps per CPU second | physics | observe, reward | networks forward | update |");
    println!("|---|---:|---:|---:|---:|---:|");
    for Row { ground, steps_per_cpu_second, share } in rows {
        let percent = |part: f64| format!("{:.0} %", 100.0 * part);
        let parts = [share.physics, share.observe_and_reward, share.networks_forward, share.update].map(percent);
        println!("| {ground} | {steps_per_cpu_second:.0} | {} |", parts.join(" | "));
    }
    if let Some(beside) = learner {
        println!("| one thread, CPU seconds an iteration | ours | rsl_rl, torch {} | x |", beside.torch);
        println!("|---|---:|---:|---:|");
        let line = |what: &str, [own, other]: [f64; 2], ratio: f64| {
            println!("| {what} | {own:.4} | {other:.4} | {ratio:.2} |");
        };
        line("update", beside.update_seconds, beside.update_times_peer);
        line("networks of the rollout", beside.rollout_networks_seconds, beside.rollout_networks_times_peer);
    }
}

fn goal_line(seed: u64, goal: &Goal) -> String {
    let or_dash = |number: Option<f64>| number.map_or("-".into(), |x| format!("{x:.3}"));
    format!(
        "| {seed} | {} | {:.1} | {:.1} | {:.2} | {} | {} |",
        if goal.reached { "yes" } else { "no" },
        goal.cpu_seconds,
        goal.wall_seconds,
        goal.samples as f64 / 1e6,
        or_dash(goal.velocity_error),
        or_dash(goal.turning_error),
    )
}

#[cfg(test)]
mod tests {
    use super::super::contest::parse;
    use super::*;

    const LOOP: &str = r#"{"critic_inputs":62,"iteration_seconds":0.1,"rollout_networks_seconds":0.01,
        "share":{"networks_forward":0.1,"observe_and_reward":0.1,"physics":0.5,"update":0.3},
        "steps_per_cpu_second":60000.0,"update_seconds":0.03}"#;

    #[test]
    fn what_contestants_print_is_read() {
        let taken: Loop = parse(&LOOP.replace('\n', "")).unwrap();
        assert_eq!((taken.critic_inputs, taken.share.physics), (62, 0.5));
        let peer: Peer = parse(r#"{"rollout_networks_seconds": 0.028, "update_seconds": 0.18, "torch": "2"}"#).unwrap();
        assert_eq!(peer.update_seconds, 0.18);
        let goal: Goal = parse(
            r#"{"cpu_seconds":9.0,"reached":false,"samples":1000000,"turning_error":null,"velocity_error":0.2,"wall_seconds":5.0}"#,
        )
        .unwrap();
        assert_eq!(goal_line(3, &goal), "| 3 | no | 9.0 | 5.0 | 1.00 | 0.200 | - |");
        assert!(parse::<Goal>(LOOP.lines().next().unwrap()).is_err());
    }

    #[test]
    fn ratios_are_taken_within_a_round() {
        let ours: Loop = parse(&LOOP.replace('\n', "")).unwrap();
        let slow = Loop { update_seconds: 0.06, ..ours.clone() };
        let peer = |update_seconds| Peer { update_seconds, rollout_networks_seconds: 0.02, torch: "2".into() };
        let found = beside(&[ours.clone(), slow], &[peer(0.15), peer(0.30)]).unwrap();
        // The machine was twice as slow in the second round: the ratio is 5 all the same.
        assert_eq!((found.update_times_peer, found.rollout_networks_times_peer), (5.0, 2.0));
        assert_eq!(beside(&[ours], &[]), None);
    }

    #[test]
    fn what_is_not_positive_is_named() {
        let program = Command::new("bench_walk");
        assert!(positive(&program, &[1.0, 2.0]).is_ok());
        let error = positive(&program, &[1.0, f64::NAN]).unwrap_err().to_string();
        assert!(error.contains("bench_walk") && error.contains("NaN"), "{error}");
    }
}
