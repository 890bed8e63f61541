//! What a decision costs: how far the command is from the teacher's, or what PPO loses by it, and how far what the network knows is from the truth.

use crate::net::{COMMAND, KNOWN, OUTPUTS, SIGHT};
use crate::roll::{Record, StudentAction};
use crate::settings::{PolicySettings, TrainSettings};

/// Loss of one decision, and its gradient by what came out before tanh and the logistic function.
pub(crate) fn loss(raw: &[f32], record: &Record, step: usize, settings: &TrainSettings, of_raw: &mut [f32]) -> f32 {
    let TrainSettings { huber, cone_weight, visible_weight, known_weight, .. } = *settings;
    let imitation = settings.policy.map_or(1.0, |policy| policy.imitation);
    let said: [f32; COMMAND] = std::array::from_fn(|k| raw[k].tanh());
    let (mut sum, mut of_said) = match (settings.policy, record.acted.get(step)) {
        (Some(policy), Some(acted)) => surrogate(&policy, acted, &said),
        _ => (0.0, [0.0; COMMAND]),
    };
    for k in 0..COMMAND {
        let off = said[k] - record.commands[step][k];
        let near = off.abs() <= huber;
        sum += imitation * if near { 0.5 * off * off } else { huber * (off.abs() - 0.5 * huber) };
        of_said[k] += imitation * off.clamp(-huber, huber);
        of_raw[k] = of_said[k] * (1.0 - said[k] * said[k]);
    }
    let mut squared = |k: usize, wanted: f32, weight: f32| {
        let off = raw[k] - wanted;
        of_raw[k] = weight * off;
        sum += 0.5 * weight * off * off;
    };
    let (cone, known) = (&record.cones[step], &record.known[step]);
    if record.found[step] {
        (0..3).for_each(|k| squared(COMMAND + k, cone[k], cone_weight));
    }
    for k in 0..KNOWN {
        // Where the cone stands can be said only once it was seen.
        if record.found[step] || k < 4 {
            squared(OUTPUTS + k, known[k], known_weight);
        }
    }
    sum + crossed(raw[OUTPUTS - 1], cone[3], visible_weight, &mut of_raw[OUTPUTS - 1])
}

/// What PPO loses by one decision, and its gradient by the commands that the network says now: the clipped objective (Schulman et al. 2017, eq. 7) of
/// normal distributions about them, of the deviation that the command was drawn with.
fn surrogate(policy: &PolicySettings, acted: &StudentAction, said: &[f32; COMMAND]) -> (f32, [f32; COMMAND]) {
    let precision = 1.0 / (acted.deviation * acted.deviation);
    let log_ratio: f32 = (0..COMMAND)
        .map(|k| 0.5 * precision * ((acted.action[k] - acted.mean[k]).powi(2) - (acted.action[k] - said[k]).powi(2)))
        .sum();
    let (ratio, advantage) = (log_ratio.clamp(-LONGEST, LONGEST).exp(), acted.advantage);
    let clipped = ratio.clamp(1.0 - policy.clip, 1.0 + policy.clip) * advantage;
    let loss = -policy.weight * (ratio * advantage).min(clipped);
    if clipped < ratio * advantage {
        return (loss, [0.0; COMMAND]);
    }
    let slope = -policy.weight * advantage * ratio * precision;
    (loss, std::array::from_fn(|k| slope * (acted.action[k] - said[k])))
}

/// Greatest logarithm of a ratio of densities: beyond it, its exponential need not be known.
pub(crate) const LONGEST: f32 = 20.0;

/// The same of what is said of the picture alone.
pub(crate) fn sight_loss(raw: &[f32], wanted: &[f32; SIGHT], settings: &TrainSettings, of_raw: &mut [f32]) -> f32 {
    let TrainSettings { cone_weight, visible_weight, known_weight, ray_weight, .. } = *settings;
    let mut sum = 0.0;
    let mut squared = |k: usize, weight: f32| {
        let off = raw[k] - wanted[k];
        of_raw[k] = weight * off;
        sum += 0.5 * weight * off * off;
    };
    if wanted[3] > 0.5 {
        (0..3).for_each(|k| squared(k, cone_weight));
    }
    (4..8).for_each(|k| squared(k, known_weight));
    (8..SIGHT).for_each(|k| squared(k, ray_weight));
    sum + crossed(raw[3], wanted[3], visible_weight, &mut of_raw[3])
}

/// Cross entropy of a share before the logistic function, written so that no logarithm of 0 occurs, and its slope.
fn crossed(logit: f32, wanted: f32, weight: f32, of_logit: &mut f32) -> f32 {
    *of_logit = weight * (1.0 / (1.0 + (-logit).exp()) - wanted);
    weight * (logit.max(0.0) - logit * wanted + (-logit.abs()).exp().ln_1p())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dagger::tests::made_up;

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let record = made_up(1, 3);
        let mut raw = [0.3; OUTPUTS + KNOWN];
        raw[..OUTPUTS].copy_from_slice(&[0.3, -0.9, 1.2, 0.2, 0.7, 0.1, -0.4]);
        let settings = TrainSettings::default();
        for step in [0, 1] {
            let mut gradient = [0.0; OUTPUTS + KNOWN];
            loss(&raw, &record, step, &settings, &mut gradient);
            for k in 0..OUTPUTS + KNOWN {
                let at = |by: f32| {
                    let mut moved = raw;
                    moved[k] += by;
                    loss(&moved, &record, step, &settings, &mut [0.0; OUTPUTS + KNOWN])
                };
                let slope = (at(5e-3) - at(-5e-3)) / 1e-2;
                assert!((slope - gradient[k]).abs() < 1e-3, "{k}: {slope} {}", gradient[k]);
            }
        }
        let raw: [f32; SIGHT] = std::array::from_fn(|k| (k as f32).sin());
        for visible in [0.0, 1.0] {
            let mut wanted = [0.4; SIGHT];
            wanted[3] = visible;
            let mut gradient = [0.0; SIGHT];
            sight_loss(&raw, &wanted, &settings, &mut gradient);
            for k in 0..SIGHT {
                let at = |by: f32| {
                    let mut moved = raw;
                    moved[k] += by;
                    sight_loss(&moved, &wanted, &settings, &mut [0.0; SIGHT])
                };
                let slope = (at(5e-3) - at(-5e-3)) / 1e-2;
                assert!((slope - gradient[k]).abs() < 1e-3, "{k}: {slope} {}", gradient[k]);
            }
        }
    }

    #[test]
    fn the_gradient_of_the_clipped_objective_is_its_slope() {
        let policy = PolicySettings::default();
        let mut flat = 0;
        for (k, advantage) in [0.7f32, -1.2, 2.0, -0.4].into_iter().enumerate() {
            for spread in [0.05, 0.25] {
                let of = |n: usize| spread * ((3 * k + n) as f32).sin();
                let (action, mean) = ([of(1), of(2), of(3)], [of(4), of(5), of(6)]);
                let acted = StudentAction { action, mean, deviation: 0.3, advantage };
                let said = [of(7), of(8), of(9)];
                let (_, gradient) = surrogate(&policy, &acted, &said);
                flat += usize::from(gradient == [0.0; COMMAND]);
                for at in 0..COMMAND {
                    let moved = |by: f32| {
                        let mut said = said;
                        said[at] += by;
                        surrogate(&policy, &acted, &said).0
                    };
                    let slope = (moved(1e-3) - moved(-1e-3)) / 2e-3;
                    assert!(
                        (slope - gradient[at]).abs() < 2e-3 + 2e-2 * gradient[at].abs(),
                        "{k}, {at}: {slope} {}",
                        gradient[at]
                    );
                }
            }
        }
        assert!((1..8).contains(&flat), "some are clipped and some are not: {flat}");
        // The ratio of normal densities of deviation 0.3: exp((0.1^2 - 0.05^2) / (2 0.3^2)), within what is clipped at.
        let (action, mean) = ([0.1, 0.0, 0.0], [0.0; 3]);
        let acted = StudentAction { action, mean, deviation: 0.3, advantage: 1.0 };
        let (loss, _) = surrogate(&policy, &acted, &[0.05, 0.0, 0.0]);
        let expected = -policy.weight * ((0.01f32 - 0.0025) / 0.18).exp();
        assert!((loss - expected).abs() < 1e-6, "{loss} {expected}");
        // Where nothing has changed, the ratio is one: the loss is the advantage.
        let acted = StudentAction { action: [0.2, 0.0, 0.1], deviation: 0.3, advantage: 1.5, ..Default::default() };
        let (loss, gradient) = surrogate(&policy, &acted, &[0.0; 3]);
        assert!((loss + 1.5 * policy.weight).abs() < 1e-6 && gradient[0] < 0.0, "{loss} {gradient:?}");
    }
}
