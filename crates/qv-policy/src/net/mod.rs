//! Networks: dense layers with ELU ([`Mlp`]), a gated recurrent unit ([`Gru`]).
//!
//! All parameters of a network are one flat array, so that an optimiser, a file or a sum over threads needs to know nothing of layers.
//! Rows of numbers are padded with zeros to multiples of sixteen ([`padded`]): padding has no weight and gets no gradient.

mod elementwise;
mod gru;
mod product;
mod simd;

pub(crate) use elementwise::{AdamStep, adam};
pub use elementwise::{elu, elu_back, sigmoid, tanh};
pub use gru::{Gru, GruTape, GruTurned};

use product::{StridedMatrix, add_product};
use qv_core::random::Xoshiro256PlusPlus;

/// Length of a row of `count` numbers with its padding.
pub const fn padded(count: usize) -> usize {
    count.next_multiple_of(simd::WIDTH)
}

/// One dense layer: where its numbers lie in the flat array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Dense {
    /// Numbers that go in.
    pub inputs: usize,
    /// Numbers that come out.
    pub outputs: usize,
    /// First weight; weights lie as `[padded inputs][padded outputs]`, the biases behind them as `[padded outputs]`.
    pub start: usize,
}

impl Dense {
    /// Numbers in the flat array.
    pub fn len(&self) -> usize {
        (padded(self.inputs) + 1) * padded(self.outputs)
    }

    /// Never true: a layer has numbers.
    pub fn is_empty(&self) -> bool {
        false
    }

    fn bias_at(&self) -> usize {
        self.start + padded(self.inputs) * padded(self.outputs)
    }

    /// The weights as `[outputs][inputs]` and the biases as `[outputs]`, without padding.
    pub fn unpadded(&self, parameters: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let width = padded(self.outputs);
        let at = |i: usize, o: usize| parameters[self.start + i * width + o];
        let weights = (0..self.outputs).flat_map(|o| (0..self.inputs).map(move |i| (i, o)));
        let bias = self.bias_at();
        (weights.map(|(i, o)| at(i, o)).collect(), parameters[bias..bias + self.outputs].to_vec())
    }

    /// Uniform within one over the root of the number of inputs, times `gain` (PyTorch's default for gain 1); no bias.
    pub fn draw(&self, gain: f32, random: &mut Xoshiro256PlusPlus, parameters: &mut [f32]) {
        let bound = gain / (self.inputs as f32).sqrt();
        for i in 0..self.inputs {
            for o in 0..self.outputs {
                parameters[self.start + i * padded(self.outputs) + o] = random.between(-bound, bound);
            }
        }
    }

    /// `out = bias + input W`, both with padded rows.
    pub fn forward(&self, parameters: &[f32], rows: usize, input: &[f32], out: &mut [f32]) {
        let (depth, width) = (padded(self.inputs), padded(self.outputs));
        let bias = &parameters[self.bias_at()..][..width];
        out[..rows * width].chunks_exact_mut(width).for_each(|row| row.copy_from_slice(bias));
        // Padding of the input is zero: those products are left out.
        let input = StridedMatrix { values: input, steps: [depth, 1] };
        add_product(rows, self.inputs, width, input, &parameters[self.start..][..depth * width], out);
    }

    /// Adds to `gradient` what `of_out`, the gradient of the output, makes of weights and biases.
    pub fn gradient(&self, rows: usize, input: &[f32], of_out: &[f32], gradient: &mut [f32]) {
        let (depth, width) = (padded(self.inputs), padded(self.outputs));
        let bias = self.bias_at();
        let turned = StridedMatrix { values: input, steps: [1, depth] };
        add_product(self.inputs, rows, width, turned, of_out, &mut gradient[self.start..bias]);
        let sums = &mut gradient[bias..bias + width];
        for row in of_out[..rows * width].chunks_exact(width) {
            sums.iter_mut().zip(row).for_each(|(sum, &x)| *sum += x);
        }
    }

    /// `of_input = of_out Wᵀ`, with `turned` the weights as `[padded outputs][padded inputs]`.
    pub fn back(&self, rows: usize, turned: &[f32], of_out: &[f32], of_input: &mut [f32]) {
        let (depth, width) = (padded(self.outputs), padded(self.inputs));
        of_input[..rows * width].fill(0.0);
        let of_out = StridedMatrix { values: of_out, steps: [depth, 1] };
        add_product(rows, self.outputs, width, of_out, turned, of_input);
    }

    /// Fills `turned` with the weights as `[padded outputs][padded inputs]`.
    pub fn turn(&self, parameters: &[f32], turned: &mut [f32]) {
        let (rows, columns) = (padded(self.inputs), padded(self.outputs));
        let weights = &parameters[self.start..][..rows * columns];
        // By squares, so that both sides stay in the processor's cache; rows and columns are multiples of the side.
        for (i0, o0) in
            (0..rows).step_by(simd::WIDTH).flat_map(|i| (0..columns).step_by(simd::WIDTH).map(move |o| (i, o)))
        {
            for o in o0..o0 + simd::WIDTH {
                for i in i0..i0 + simd::WIDTH {
                    turned[o * rows + i] = weights[i * columns + o];
                }
            }
        }
    }
}

/// Dense layers with ELU between them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mlp {
    /// In order from the input to the output.
    pub layers: Vec<Dense>,
}

/// What a pass through an [`Mlp`] leaves for the way back: for at most a fixed number of rows.
#[derive(Debug, Clone)]
pub struct Tape {
    /// Output of each layer, padded rows.
    outputs: Vec<Vec<f32>>,
    gradients: [Vec<f32>; 2],
}

/// Weights of an [`Mlp`] by output, which the way back reads: made anew after each step of the optimiser.
#[derive(Debug, Clone)]
pub struct TransposedWeights(Vec<Vec<f32>>);

impl Mlp {
    /// Layers of `sizes` numbers, the first being the input; at least two.
    ///
    /// # Panics
    /// With less than two sizes, or one that is zero.
    pub fn new(sizes: &[usize]) -> Self {
        assert!(sizes.len() >= 2 && !sizes.contains(&0), "a network has an input and an output: {sizes:?}");
        let mut layers: Vec<Dense> = Vec::new();
        for pair in sizes.windows(2) {
            let start = layers.last().map_or(0, |l| l.start + l.len());
            layers.push(Dense { inputs: pair[0], outputs: pair[1], start });
        }
        Self { layers }
    }

    /// Numbers in the flat array.
    pub fn len(&self) -> usize {
        self.layers.iter().map(Dense::len).sum()
    }

    /// Never true: a network has layers.
    pub fn is_empty(&self) -> bool {
        self.layers.is_empty()
    }

    /// Numbers that go in.
    pub fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Numbers that come out.
    pub fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Random weights; those of the last layer times `last_gain`.
    pub fn draw(&self, last_gain: f32, random: &mut Xoshiro256PlusPlus) -> Vec<f32> {
        let mut parameters = vec![0.0; self.len()];
        for (k, layer) in self.layers.iter().enumerate() {
            let gain = if k + 1 == self.layers.len() { last_gain } else { 1.0 };
            layer.draw(gain, random, &mut parameters);
        }
        parameters
    }

    /// Room for passes of up to `rows` rows.
    pub fn tape(&self, rows: usize) -> Tape {
        let widest = self.layers.iter().map(|l| padded(l.inputs).max(padded(l.outputs))).max().unwrap_or(0);
        Tape {
            outputs: self.layers.iter().map(|l| vec![0.0; rows * padded(l.outputs)]).collect(),
            gradients: [vec![0.0; rows * widest], vec![0.0; rows * widest]],
        }
    }

    /// The weights as [`Mlp::backward`] reads them.
    pub fn turned(&self) -> TransposedWeights {
        TransposedWeights(self.layers.iter().map(|l| vec![0.0; padded(l.inputs) * padded(l.outputs)]).collect())
    }

    /// Fills `turned` from the parameters.
    pub fn turn(&self, parameters: &[f32], turned: &mut TransposedWeights) {
        // Nothing asks for the gradient of the network's input.
        for (layer, turned) in self.layers.iter().zip(&mut turned.0).skip(1) {
            layer.turn(parameters, turned);
        }
    }

    /// The network's output for `rows` padded rows of input, as padded rows; it stays in the tape.
    pub fn forward<'a>(&self, parameters: &[f32], rows: usize, input: &[f32], tape: &'a mut Tape) -> &'a [f32] {
        let last = self.layers.len() - 1;
        for (k, layer) in self.layers.iter().enumerate() {
            let (before, after) = tape.outputs.split_at_mut(k);
            let input = if k == 0 { input } else { &before[k - 1] };
            layer.forward(parameters, rows, input, &mut after[0]);
            if k < last {
                elu(&mut after[0][..rows * padded(layer.outputs)]);
            }
        }
        &tape.outputs[last][..rows * padded(self.outputs())]
    }

    /// Adds the gradient of the parameters, given that of the output (padded rows) and the tape of the pass over `input`.
    pub fn backward(
        &self,
        turned: &TransposedWeights,
        rows: usize,
        input: &[f32],
        of_output: &[f32],
        tape: &mut Tape,
        gradient: &mut [f32],
    ) {
        let [now, next] = &mut tape.gradients;
        let last = self.layers.len() - 1;
        now[..rows * padded(self.outputs())].copy_from_slice(&of_output[..rows * padded(self.outputs())]);
        for k in (0..=last).rev() {
            let layer = &self.layers[k];
            let from = if k == 0 { input } else { &tape.outputs[k - 1] };
            layer.gradient(rows, from, now, gradient);
            if k > 0 {
                layer.back(rows, &turned.0[k], now, next);
                let count = rows * padded(layer.inputs);
                elu_back(&mut next[..count], &tape.outputs[k - 1][..count]);
                std::mem::swap(now, next);
            }
        }
    }

    /// Weights `[outputs][inputs]` and biases `[outputs]` of each layer, without padding.
    pub fn unpadded(&self, parameters: &[f32]) -> Vec<(Vec<f32>, Vec<f32>)> {
        self.layers.iter().map(|layer| layer.unpadded(parameters)).collect()
    }

    /// The output for one row without padding: for deployment and tests, not for speed.
    pub fn evaluate(&self, parameters: &[f32], input: &[f32]) -> Vec<f32> {
        let mut row = vec![0.0; padded(self.inputs())];
        row[..self.inputs()].copy_from_slice(input);
        let mut tape = self.tape(1);
        self.forward(parameters, 1, &row, &mut tape)[..self.outputs()].to_vec()
    }
}

#[cfg(test)]
mod tests;
