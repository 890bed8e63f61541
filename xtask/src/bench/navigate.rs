//! `cargo xtask bench navigate`: what pictures, driving and learning of the visual navigation cost, in CPU time of all threads.

use super::contest::{build, last_line, median, write};
use crate::workspace::Workspace;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::process::Command;

/// How to measure.
#[derive(clap::Args)]
pub struct Navigate {
    /// One short round: to see that all of it runs
    #[arg(long)]
    quick: bool,
    /// Pictures and learning on a graphics card, too: the number of its adapter
    #[arg(long, value_name = "N")]
    gpu: Option<usize>,
}

/// What `bench_navigate` prints: rates for each CPU second.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Round {
    images: Vec<Images>,
    decisions_driven_by_the_teacher_without_pictures: f64,
    decisions_driven_by_the_student: f64,
    decisions_learnt: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    card: Option<Card>,
}

/// What a graphics card does in each second of the clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Card {
    adapter: String,
    images_each_second: f64,
    decisions_learnt_each_second: f64,
}

/// Pictures of 80 x 60 of a cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Images {
    gaussians: usize,
    each_cpu_second: f64,
}

/// Runs the benchmark, which has no gate.
///
/// # Errors
/// The example cannot be built, fails, or prints something unexpected.
pub fn run(workspace: &Workspace, navigate: &Navigate) -> Result<bool> {
    let (rounds, scale) = if navigate.quick { (1, "0.1") } else { (3, "1") };
    let features: &[&str] = if navigate.gpu.is_some() { &["gpu"] } else { &[] };
    let program = build(workspace, "bench_navigate", features)?;
    let mut taken: Vec<Round> = vec![];
    for round in 0..rounds {
        eprintln!("round {} of {rounds}", round + 1);
        taken.push(last_line(Command::new(&program).arg(scale).args(navigate.gpu.map(|n| n.to_string())))?);
    }
    let result = middle(&taken)?;
    print(&result);
    write(workspace, "navigate.json", &result)?;
    Ok(true)
}

/// Medians over rounds, of which there is one at least.
fn middle(taken: &[Round]) -> Result<Round> {
    let of = |number: &dyn Fn(&Round) -> f64| median(taken.iter().map(number).collect());
    let Some(first) = taken.first() else { bail!("expected a round, found none") };
    if taken.iter().any(|round| round.images.len() != first.images.len()) {
        bail!("expected pictures of the same clouds in all rounds, found others");
    }
    let images = first.images.iter().enumerate();
    Ok(Round {
        images: images
            .map(|(k, i)| Images { gaussians: i.gaussians, each_cpu_second: of(&|r| r.images[k].each_cpu_second) })
            .collect(),
        decisions_driven_by_the_teacher_without_pictures: of(&|r| r.decisions_driven_by_the_teacher_without_pictures),
        decisions_driven_by_the_student: of(&|r| r.decisions_driven_by_the_student),
        decisions_learnt: of(&|r| r.decisions_learnt),
        card: first.card.as_ref().map(|card| {
            let on_card = |number: &dyn Fn(&Card) -> f64| of(&|r| r.card.as_ref().map_or(f64::NAN, number));
            Card {
                adapter: card.adapter.clone(),
                images_each_second: on_card(&|c| c.images_each_second),
                decisions_learnt_each_second: on_card(&|c| c.decisions_learnt_each_second),
            }
        }),
    })
}

fn print(result: &Round) {
    println!("for each CPU second:");
    for images in &result.images {
        println!("{:>8.0} pictures of {} Gaussians", images.each_cpu_second, images.gaussians);
    }
    println!("{:>8.0} decisions driven by the expert", result.decisions_driven_by_the_teacher_without_pictures);
    println!("{:>8.0} decisions driven by the student, with pictures", result.decisions_driven_by_the_student);
    println!("{:>8.0} decisions learned", result.decisions_learnt);
    if let Some(card) = &result.card {
        println!("for each second on {}:", card.adapter);
        println!(
            "{:>8.0} pictures, {:.0} decisions learned",
            card.images_each_second, card.decisions_learnt_each_second
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_rounds() {
        let round = |x: f64, clouds: usize| Round {
            images: vec![Images { gaussians: 9, each_cpu_second: 10.0 * x }; clouds],
            decisions_driven_by_the_teacher_without_pictures: x,
            decisions_driven_by_the_student: 2.0 * x,
            decisions_learnt: 3.0 * x,
            card: Some(Card {
                adapter: "one".into(),
                images_each_second: 4.0 * x,
                decisions_learnt_each_second: 5.0 * x,
            }),
        };
        let rounds = [round(3.0, 1), round(1.0, 1), round(2.0, 1)];
        assert_eq!(middle(&rounds).unwrap(), round(2.0, 1));
        assert!(middle(&[]).is_err() && middle(&[round(1.0, 1), round(1.0, 2)]).is_err());
    }
}
