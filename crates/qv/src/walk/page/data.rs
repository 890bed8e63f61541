//! The numbers that the page's script draws, rounded to what a screen shows.

use qv_policy::play::Played;
use qv_policy::policy::PolicyFile;
use qv_policy::train::Line;
use serde_json::{Map, Value, json};

/// Points of a learning curve: more cannot be seen.
const POINTS: usize = 300;

/// Points on each side over which ends of episodes are counted: few end within one.
const AROUND: usize = 5;

/// Figures of the task that are no terms of its reward.
const NO_TERMS: [&str; 5] = ["velocity_error", "turning_error", "swing_time", "swing_height", "level"];

/// A number with some digits; what is not finite is a gap.
fn round(x: f32, digits: i32) -> Value {
    let scale = 10f64.powi(digits);
    let rounded = (f64::from(x) * scale).round() / scale;
    match rounded.is_finite() {
        true if digits == 0 => json!(rounded as i64),
        true => json!(rounded),
        false => Value::Null,
    }
}

fn rounded(values: impl Iterator<Item = f32>, digits: i32) -> Value {
    values.map(|x| round(x, digits)).collect::<Vec<_>>().into()
}

/// One list for each column.
fn columns(count: usize, rows: &[Vec<f32>], digits: i32) -> Value {
    (0..count).map(|k| rounded(rows.iter().map(|row| row[k]), digits)).collect::<Vec<_>>().into()
}

/// Points in space as whole millimetres, one flat list for each time.
fn places(rows: &[Vec<[f32; 3]>]) -> Value {
    rows.iter().map(|row| rounded(row.iter().flatten().map(|x| 1e3 * x), 0)).collect::<Vec<_>>().into()
}

/// All that the script draws.
pub fn data(lines: &[Line], played: &Played, policy: &PolicyFile) -> Value {
    let joints = played.joints.len();
    let angles: Vec<Vec<f32>> = played.q.iter().map(|q| q[7..].to_vec()).collect();
    let three = |rows: &[[f32; 3]], digits: i32| -> Vec<Value> {
        (0..3).map(|k| rounded(rows.iter().map(|row| row[k]), digits)).collect()
    };
    let mut done = three(&played.velocity, 3);
    done[2] = rounded(played.turning.iter().map(|t| t[2]), 3);
    let ground = played.ground.as_ref().map(|patch| {
        let heights: Vec<Value> = patch.heights.iter().map(|h| h.map_or(Value::Null, |h| round(1e3 * h, 0))).collect();
        json!({"origin": rounded(patch.origin.into_iter(), 3), "spacing": round(patch.spacing, 4), "size": patch.size, "heights": heights})
    });
    json!({
        "rate": round(played.rate, 3), "steps": played.q.len(), "fell": played.fell,
        "joints": played.joints, "feet": played.feet, "parents": played.parents, "footLinks": played.foot_links,
        "commands": three(&played.commands, 3), "done": done,
        "base": played.q.iter().map(|q| rounded(q[..7].iter().copied(), 3)).collect::<Vec<_>>(),
        "links": places(&played.link_positions), "feetAt": places(&played.foot_positions),
        "heights": columns(played.feet.len(), &played.foot_heights, 4), "forces": columns(played.feet.len(), &played.foot_forces, 1),
        "torques": columns(joints, &played.torques, 2), "targets": columns(joints, &played.targets, 3), "angles": columns(joints, &angles, 3),
        "efforts": played.efforts.iter().map(|e| e.map_or(Value::Null, |e| round(e, 2))).collect::<Vec<_>>(),
        "lower": rounded(policy.lower.iter().copied(), 3), "upper": rounded(policy.upper.iter().copied(), 3),
        "ground": ground, "learning": learning(lines),
    })
}

/// Curves over samples in millions; neighbouring iterations share a point where there are many.
fn learning(lines: &[Line]) -> Value {
    if lines.is_empty() {
        return Value::Null;
    }
    let chunks: Vec<&[Line]> = lines.chunks(lines.len().div_ceil(POINTS)).collect();
    let curve = |of: &dyn Fn(&Line) -> f32, digits: i32| {
        let mean = |chunk: &&[Line]| chunk.iter().map(of).sum::<f32>() / chunk.len() as f32;
        rounded(chunks.iter().map(mean), digits)
    };
    let figure = |name: &str, line: &Line| line.figures.iter().find(|(n, _)| *n == name).map_or(f32::NAN, |(_, x)| *x);
    let samples = chunks.iter().filter_map(|chunk| chunk.last()).map(|line| millions(line.samples));
    let failed = (0..chunks.len()).map(|at| {
        let near = &chunks[at.saturating_sub(AROUND)..(at + AROUND + 1).min(chunks.len())];
        let sum = |k: usize| near.iter().copied().flatten().map(|line| line.iteration.ends[k]).sum::<usize>() as f32;
        // No episode ended: nothing is known.
        sum(0) / (sum(0) + sum(1))
    });
    let mut terms = Map::new();
    for (name, _) in lines[0].figures.iter().filter(|(name, _)| !NO_TERMS.contains(name)) {
        // A term that is switched off is no line.
        if lines.iter().any(|line| figure(name, line) != 0.0) {
            terms.insert((*name).into(), curve(&|line| figure(name, line), 4));
        }
    }
    let scored: Vec<(u64, &qv_policy::score::Score)> =
        lines.iter().filter_map(|line| Some((line.samples, line.score.as_ref()?))).collect();
    let score = |of: &dyn Fn(&qv_policy::score::Score) -> f32| rounded(scored.iter().map(|(_, s)| of(s)), 4);
    json!({
        "samples": rounded(samples, 4), "reward": curve(&|l| l.iteration.reward, 5), "std": curve(&|l| l.iteration.std, 4),
        "rate": curve(&|l| l.iteration.rate, 8), "explained": curve(&|l| l.iteration.explained, 3),
        "velocity": curve(&|l| figure("velocity_error", l), 4), "turning": curve(&|l| figure("turning_error", l), 4),
        "failed": rounded(failed, 4), "terms": terms,
        "score": {
            "samples": rounded(scored.iter().map(|(samples, _)| millions(*samples)), 4),
            "velocity": score(&|s| s.velocity_error), "turning": score(&|s| s.turning_error),
            "fell": score(&|s| s.fell as f32 / s.robots.max(1) as f32),
        },
    })
}

fn millions(samples: u64) -> f32 {
    (samples as f64 / 1e6) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::walk::example::{file, lines, made_up};

    #[test]
    fn numbers_are_rounded_and_gaps_are_null() {
        assert_eq!([round(1.23456, 2), round(f32::NAN, 2), round(-0.6, 0)], [json!(1.23), Value::Null, json!(-1)]);
        let data = data(&lines(1000), &made_up(50), &file());
        assert_eq!(data["links"][0].as_array().unwrap().len(), 3 * 13);
        assert_eq!(data["base"][49][0], json!(0.49));
        let learning = &data["learning"];
        assert_eq!(learning["samples"].as_array().unwrap().len(), 250);
        assert_eq!(learning["reward"].as_array().unwrap().len(), 250);
        assert_eq!(learning["score"]["samples"].as_array().unwrap().len(), 50);
        assert_eq!(learning["terms"].as_object().unwrap().len(), 1);
        assert_eq!(super::learning(&lines(3))["failed"][0], Value::Null);
        assert!(learning["failed"][0] == json!(0.25));
    }

    #[test]
    fn twenty_seconds_are_small() {
        let text = data(&lines(2000), &made_up(1000), &file()).to_string();
        assert!(text.len() < 1_400_000, "{} bytes", text.len());
    }
}
