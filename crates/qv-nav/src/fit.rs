//! How well a network says what the teacher said, output by output, beside the best constant answer: whether it learns at all.

use crate::net::{COMMAND, HIDDEN, Net, NetInput, NetOutput, OUTPUTS, RAYS};
use crate::recall::RECALL;
use crate::roll::Record;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Errors over decisions that were not learnt from (or were: then it is the fit).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// Decisions.
    pub decisions: usize,
    /// Mean square error of the command (forwards, to the left, turning) in shares of its limits.
    pub command: [f64; 3],
    /// The same of the best constant answer: the variance of the teacher's command.
    pub command_constant: [f64; 3],
    /// Mean angle between the bearing said and the true one, over decisions at which the cone was in view \[rad\].
    pub bearing: f64,
    /// The same for decisions at which it had been seen before, but was not in view \[rad\].
    pub bearing_remembered: f64,
    /// Mean error of the logarithm of the distance of a cone in view: about the relative error.
    pub distance: f64,
    /// Share of decisions at which it is wrong about whether the cone is in view.
    pub visible: f64,
    /// The same of the best constant answer.
    pub visible_constant: f64,
    /// Mean error of the place that it says of a picture, in shares of the map's half sides.
    pub place: f64,
    /// Mean error of the heading that it says of a picture \[rad\].
    pub heading: f64,
    /// Mean error of the logarithm of the distance to what blocks, and of that to where the view ends.
    pub rays: [f64; 2],
}

impl Fit {
    /// Of a network over whole episodes, its memory running as it does when it drives.
    pub fn of(net: &Net, parameters: &[f32], records: &[Record]) -> Self {
        let outputs: Vec<Vec<NetOutput>> = records.par_iter().map(|r| outputs(net, parameters, r)).collect();
        let pairs =
            || outputs.iter().zip(records).flat_map(|(out, r)| out.iter().enumerate().map(move |(t, o)| (o, r, t)));
        let decisions = pairs().count();
        let mean = |sum: f64, count: usize| if count > 0 { sum / count as f64 } else { 0.0 };
        let over_all =
            |f: &dyn Fn(&NetOutput, &Record, usize) -> f64| mean(pairs().map(|(o, r, t)| f(o, r, t)).sum(), decisions);
        let means: [f64; COMMAND] = [0, 1, 2].map(|k| over_all(&|_, r, t| f64::from(r.commands[t][k])));
        let error = |k: usize| over_all(&|o, r, t| f64::from(o.out[k] - r.commands[t][k]).powi(2));
        let spread = |k: usize| over_all(&|_, r, t| (f64::from(r.commands[t][k]) - means[k]).powi(2));
        let visible = |r: &Record, t: usize| r.cones[t][3] > 0.5;
        let over = |of: &dyn Fn(&Record, usize) -> bool, f: &dyn Fn(&NetOutput, &[f32; 4]) -> f64| {
            let chosen: Vec<f64> = pairs().filter(|(_, r, t)| of(r, *t)).map(|(o, r, t)| f(o, &r.cones[t])).collect();
            mean(chosen.iter().sum(), chosen.len())
        };
        let off_rays = |first: usize| {
            let off = |o: &NetOutput, r: &Record, t: usize| -> f64 {
                let rays = first..first + RAYS;
                rays.map(|k| f64::from((o.sight[k] - r.sights[t][k]).abs())).sum::<f64>() / RAYS as f64
            };
            over_all(&off)
        };
        let in_view = over_all(&|_, r, t| if visible(r, t) { 1.0 } else { 0.0 });
        Self {
            decisions,
            command: [0, 1, 2].map(error),
            command_constant: [0, 1, 2].map(spread),
            bearing: over(&visible, &off_bearing),
            bearing_remembered: over(&|r, t| r.found[t] && !visible(r, t), &off_bearing),
            distance: over(&visible, &|o, cone| f64::from((o.out[COMMAND + 2] - cone[2]).abs())),
            visible: over_all(&|o, r, t| if (o.out[OUTPUTS - 1] > 0.5) == visible(r, t) { 0.0 } else { 1.0 }),
            visible_constant: in_view.min(1.0 - in_view),
            place: over_all(&|o, r, t| {
                let off = |k: usize| f64::from(o.sight[k] - r.sights[t][k]);
                off(4).hypot(off(5))
            }),
            heading: over_all(&|o, r, t| between([o.sight[6], o.sight[7]], [r.sights[t][6], r.sights[t][7]])),
            rays: [off_rays(8), off_rays(8 + RAYS)],
        }
    }
}

/// What the network says at each decision of an episode.
fn outputs(net: &Net, parameters: &[f32], record: &Record) -> Vec<NetOutput> {
    let (mut scratch, mut memory) = (net.scratch(), vec![0.0; HIDDEN]);
    let states = record.states.chunks_exact(crate::net::STATE).zip(record.recalls.chunks_exact(RECALL));
    let pictures = record.pictures.chunks_exact(net.picture_len());
    pictures
        .zip(states)
        .map(|(bytes, (state, recall))| {
            let picture: Vec<f32> = bytes.iter().map(|&b| f32::from(b)).collect();
            net.step(parameters, &NetInput { picture: &picture, state, recall }, &mut memory, &mut scratch)
        })
        .collect()
}

fn off_bearing(says: &NetOutput, cone: &[f32; 4]) -> f64 {
    between([says.out[COMMAND], says.out[COMMAND + 1]], [cone[0], cone[1]])
}

/// Angle between two directions, each a sine and a cosine of any length.
fn between(a: [f32; 2], b: [f32; 2]) -> f64 {
    let ([sine, cosine], [s, c]) = (a.map(f64::from), b.map(f64::from));
    (sine * c - cosine * s).atan2(cosine * c + sine * s).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::{KNOWN, SIGHT, STATE};
    use std::f32::consts::FRAC_PI_2;

    #[test]
    fn a_network_of_zeros_is_as_wrong_as_what_it_says() {
        let net = Net::default();
        let mut record = Record::default();
        for step in 0..4 {
            record.pictures.extend(std::iter::repeat_n(90, net.picture_len()));
            record.states.extend([0.0; STATE]);
            record.recalls.extend([0.0; RECALL]);
            record.sights.push([0.3; SIGHT]);
            record.commands.push([1.0, 0.0, if step < 2 { 0.5 } else { -0.5 }]);
            record.cones.push([FRAC_PI_2.sin(), FRAC_PI_2.cos(), 0.4, if step == 0 { 1.0 } else { 0.0 }]);
            record.found.push(true);
            record.known.push([0.3; KNOWN]);
        }
        let fit = Fit::of(&net, &vec![0.0; net.len()], &[record]);
        assert_eq!(fit.decisions, 4);
        assert!((fit.command[0] - 1.0).abs() < 1e-9 && (fit.command[2] - 0.25).abs() < 1e-9, "{fit:?}");
        assert!(fit.command_constant[0] < 1e-12 && (fit.command_constant[2] - 0.25).abs() < 1e-9, "{fit:?}");
        // A logistic function of 0 is not above a half: it says that nothing is in view, which is wrong once.
        assert!((fit.visible - 0.25).abs() < 1e-9 && (fit.visible_constant - 0.25).abs() < 1e-9, "{fit:?}");
        assert!((fit.distance - 0.4).abs() < 1e-6 && (fit.place - 0.3 * 2f64.sqrt()).abs() < 1e-6, "{fit:?}");
        assert!((fit.rays[0] - 0.3).abs() < 1e-6 && (fit.rays[1] - 0.3).abs() < 1e-6, "{fit:?}");
    }
}
