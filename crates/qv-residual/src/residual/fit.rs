//! A net fitted to samples by Adam on minibatches; a minibatch has a fixed number of shards, so that the bits do not depend on threads.

use crate::ResidualError;
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::adam::Adam;
use qv_policy::net::{Mlp, Tape, padded};
use rayon::prelude::*;

/// Inputs and outputs, padded rows.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    pub inputs: Vec<f32>,
    pub outputs: Vec<f32>,
    pub count: usize,
}

impl Samples {
    /// Adds one, scaled already.
    pub fn push(&mut self, input: &[f32], output: &[f32]) {
        self.inputs.extend_from_slice(input);
        self.inputs.resize((self.count + 1) * padded(input.len()), 0.0);
        self.outputs.extend_from_slice(output);
        self.outputs.resize((self.count + 1) * padded(output.len()), 0.0);
        self.count += 1;
    }
}

/// Parts of a minibatch.
const SHARDS: usize = 4;
/// Rows of a part.
const ROWS: usize = 128;
/// Longest gradient, of outputs of the size of one.
const LONGEST: f32 = 1.0;

struct Shard {
    gradient: Vec<f32>,
    tape: Tape,
    rows: Vec<f32>,
    of_output: Vec<f32>,
    loss: f64,
}

/// Passes over the samples; the rate falls to zero along half a cosine. Returns the mean squared error of the last pass.
pub(super) fn fit(
    net: &Mlp,
    parameters: &mut [f32],
    samples: &Samples,
    passes: usize,
    rate: f32,
    random: &mut Xoshiro256PlusPlus,
) -> Result<f64, ResidualError> {
    if samples.count == 0 {
        return Err(ResidualError::input("samples of a net", "at least one", 0));
    }
    let (ins, outs) = (padded(net.inputs()), padded(net.outputs()));
    let (mut adam, mut turned) = (Adam::new(net.len()), net.turned());
    let shard = || Shard {
        gradient: vec![0.0; net.len()],
        tape: net.tape(ROWS),
        rows: vec![0.0; ROWS * ins],
        of_output: vec![0.0; ROWS * outs],
        loss: 0.0,
    };
    let mut shards: Vec<Shard> = (0..SHARDS).map(|_| shard()).collect();
    let mut order: Vec<u32> = (0..samples.count as u32).collect();
    let mut loss = 0.0;
    let steps = (passes * samples.count.div_ceil(SHARDS * ROWS)) as f32;
    let mut done = 0.0f32;
    for _ in 0..passes {
        (1..order.len()).rev().for_each(|i| order.swap(i, random.below(i + 1)));
        loss = 0.0;
        for batch in order.chunks(SHARDS * ROWS) {
            net.turn(parameters, &mut turned);
            let share = batch.len().div_ceil(SHARDS);
            let (now, turned) = (&*parameters, &turned);
            shards.par_iter_mut().enumerate().for_each(|(k, shard)| {
                shard.gradient.fill(0.0);
                shard.loss = 0.0;
                let part = batch.get(k * share..((k + 1) * share).min(batch.len())).unwrap_or(&[]);
                for (row, &sample) in shard.rows.chunks_exact_mut(ins).zip(part) {
                    row.copy_from_slice(&samples.inputs[sample as usize * ins..][..ins]);
                }
                let found = net.forward(now, part.len(), &shard.rows, &mut shard.tape);
                for (i, &sample) in part.iter().enumerate() {
                    let wanted = &samples.outputs[sample as usize * outs..][..outs];
                    for k in 0..net.outputs() {
                        let off = found[i * outs + k] - wanted[k];
                        shard.loss += f64::from(off * off);
                        shard.of_output[i * outs + k] = 2.0 * off / (batch.len() * net.outputs()) as f32;
                    }
                }
                let Shard { gradient, tape, rows, of_output, .. } = shard;
                net.backward(turned, part.len(), rows, of_output, tape, gradient);
            });
            let (first, others) = shards.split_at_mut(1);
            for other in others {
                first[0].gradient.iter_mut().zip(&other.gradient).for_each(|(sum, x)| *sum += x);
            }
            let slope = 0.5 * (1.0 + (std::f32::consts::PI * done / steps).cos());
            let length = adam.step(parameters, &first[0].gradient, rate * slope, LONGEST);
            loss += shards.iter().map(|s| s.loss).sum::<f64>();
            if !(length.is_finite() && loss.is_finite()) {
                return Err(ResidualError::input("training of a net", "a finite gradient", length));
            }
            done += 1.0;
        }
    }
    Ok(loss / (samples.count * net.outputs()) as f64)
}
