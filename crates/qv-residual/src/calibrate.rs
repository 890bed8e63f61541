//! A policy's commands calibrated: a gait that walks a little faster, or bends a little to a side, is asked for a little less of it.

use crate::ResidualError;
use crate::paths::{Path, SECONDS, uniform, walk};
use glam::{DMat3, DVec3};
use qv_fit::linear::{gram, transposed_product};
use qv_fit::{Cholesky, Matrix};
use qv_policy::env::VectorEnv;
use qv_policy::net::padded;
use qv_policy::policy::Policy;
use qv_policy::velocity::{COMMAND_AT, Commands, VelocityTask};

/// Mean velocity as a function of the command, both forwards, to the left \[m/s\] and turning \[rad/s\]: `matrix` command + `offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// The identity where commands are followed.
    pub matrix: DMat3,
    /// Zero where commands are followed.
    pub offset: DVec3,
}

/// Mean velocity of a path in the robot's own heading; `None` after a fall.
fn mean_velocity(path: &Path, rate: f32, decisions: usize) -> Option<DVec3> {
    if path.len() < decisions.max(2) {
        return None;
    }
    let steps = path.windows(2).map(|pair| {
        let [[x0, y0, h0], [x1, y1, h1]] = [pair[0], pair[1]].map(|p| p.map(f64::from));
        let turned = (h1 - h0).sin().atan2((h1 - h0).cos());
        let (s, c) = (h0 + 0.5 * turned).sin_cos();
        DVec3::new(c * (x1 - x0) + s * (y1 - y0), c * (y1 - y0) - s * (x1 - x0), turned)
    });
    Some(steps.sum::<DVec3>() * (f64::from(rate) / (path.len() - 1) as f64))
}

/// How a policy responds to commands drawn from `ranges`, by least squares over one walk of each robot of a task. `None` when fewer than
/// half of the walks last.
///
/// # Errors
/// When a number is not finite.
pub fn response(
    policy: &Policy,
    task: &mut VelocityTask,
    ranges: &Commands,
    seed: u64,
) -> Result<Option<Response>, ResidualError> {
    let commands = uniform(ranges, task.count(), seed);
    let walks = walk(policy, task, &commands, SECONDS, seed)?;
    let rate = task.settings().rate;
    let decisions = (SECONDS * rate) as usize;
    let found = commands.iter().zip(&walks);
    let rows: Vec<_> = found.filter_map(|(c, (path, _))| Some((*c, mean_velocity(path, rate, decisions)?))).collect();
    if rows.len() < 8.max(commands.len() / 2) {
        return Ok(None);
    }
    let a = Matrix::from_fn(rows.len(), 4, |r, k| if k < 3 { f64::from(rows[r].0[k]) } else { 1.0 });
    let b = Matrix::from_fn(rows.len(), 3, |r, k| rows[r].1[k]);
    let solved = Cholesky::new(&gram(&a)).map(|factor| factor.solve_columns(&transposed_product(&a, &b)));
    let row = |x: &Matrix, k: usize| DVec3::new(x[(k, 0)], x[(k, 1)], x[(k, 2)]);
    Ok(solved.map(|x| Response {
        // A column is what one command does.
        matrix: DMat3::from_cols(row(&x, 0), row(&x, 1), row(&x, 2)),
        offset: row(&x, 3),
    }))
}

/// The policy with the inverse of its response in front, inside its first layer: the file stays as it was in form. `None` when the response
/// has no inverse.
pub fn calibrated(policy: &Policy, response: &Response) -> Option<Policy> {
    let inverse = (response.matrix.determinant() != 0.0).then(|| response.matrix.inverse())?;
    let shift = -(inverse * response.offset);
    let mut out = policy.clone();
    let layer = &policy.actor.layers[0];
    let width = padded(layer.outputs);
    let bias = layer.start + padded(layer.inputs) * width;
    // Of scaled commands u = s (c - o), what the layer is fed becomes s (A (u / s + o) + b - o).
    let [scale, offset] = [&policy.scale, &policy.offset]
        .map(|list| DVec3::from_array([0, 1, 2].map(|k| f64::from(list[COMMAND_AT + k]))));
    let matrix = DMat3::from_diagonal(scale) * inverse * DMat3::from_diagonal(scale.recip());
    let constant = scale * (inverse * offset + shift - offset);
    for o in 0..layer.outputs {
        let at = |k: usize| layer.start + (COMMAND_AT + k) * width + o;
        let old = DVec3::from_array([0, 1, 2].map(|k| f64::from(policy.parameters[at(k)])));
        let new = matrix.transpose() * old;
        (0..3).for_each(|k| out.parameters[at(k)] = new[k] as f32);
        out.parameters[bias + o] += old.dot(constant) as f32;
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::Xoshiro256PlusPlus;
    use qv_policy::net::Mlp;
    use qv_policy::score::Decide;

    fn straight(velocity: [f32; 2], turning: f32, decisions: usize) -> Path {
        (1..=decisions).map(|k| crate::paths::place([velocity[0], velocity[1], turning], k as f32 * 0.02)).collect()
    }

    #[test]
    fn a_mean_velocity_is_that_of_the_path() {
        let found = mean_velocity(&straight([0.5, -0.1], 0.8, 400), 50.0, 400).unwrap();
        assert!((found - DVec3::new(0.5, -0.1, 0.8)).abs().max_element() < 1e-3, "{found}");
        assert!(mean_velocity(&straight([0.5, 0.0], 0.0, 399), 50.0, 400).is_none(), "it fell");
    }

    #[test]
    fn a_calibrated_policy_does_what_the_other_does_when_asked_otherwise() {
        let actor = Mlp::new(&[12, 16, 2]);
        let mut random = Xoshiro256PlusPlus::of(1, 2, 3);
        let parameters = actor.draw(1.0, &mut random);
        let list =
            |low: f32, high: f32, random: &mut Xoshiro256PlusPlus| (0..12).map(|_| random.between(low, high)).collect();
        let (offset, scale) = (list(-0.3, 0.3, &mut random), list(0.5, 2.0, &mut random));
        let policy = Policy { actor, parameters, offset, scale };
        let response = Response {
            matrix: DMat3::from_cols_array(&[1.1, -0.03, 0.0, 0.02, 0.9, 0.05, 0.0, 0.1, 1.05]),
            offset: DVec3::new(0.02, -0.01, 0.03),
        };
        let changed = calibrated(&policy, &response).unwrap();
        let wanted = DVec3::new(0.6, -0.2, 0.4);
        let asked = response.matrix.inverse() * (wanted - response.offset);
        let of = |mut policy: &Policy, command: DVec3| {
            let mut seen: Vec<f32> = (0..12).map(|k| 0.1 * k as f32 - 0.5).collect();
            (0..3).for_each(|k| seen[COMMAND_AT + k] = command[k] as f32);
            let mut actions = [0.0; 2];
            policy.decide(1, &seen, &mut actions).unwrap();
            actions
        };
        let (plain, new) = (of(&policy, asked), of(&changed, wanted));
        assert!((plain[0] - new[0]).abs() < 1e-5 && (plain[1] - new[1]).abs() < 1e-5, "{plain:?} {new:?}");
        assert!((of(&policy, wanted)[0] - new[0]).abs() > 1e-4, "it changes something");
        assert!(calibrated(&policy, &Response { matrix: DMat3::ZERO, ..response }).is_none());
    }
}
