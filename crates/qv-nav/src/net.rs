//! The network: four convolutions and a dense layer that say what is in the picture, then a dense layer that also sees what the robot recalls,
//! a gated recurrent unit, and a head that gives a command and what it knows of the cone.
//!
//! ```text
//! picture 80 x 60 x 3 -> 3x3/2 16 -> 3x3/2 16 -> 3x3/2 32 -> 3x3/2 32 -> (with the state) dense 192 -> 32 of the picture
//! dense 192 -> (with the recall) dense 192 -> GRU 192 -> dense 128 -> 7 + 6
//! ```
//! What it says of the picture comes from the picture alone, so that what a robot recalls of it ([`crate::recall`]) cannot confirm itself.
//! ELU follows each layer but the last. The goal's colour shifts the outcome of the first two convolutions before it ([`Tint`]), so that one
//! channel can be open for one colour alone. Convolutions are products of patches with the weights of a [`Dense`] layer, so that all products are
//! those of `qv_policy::net`, whose bits do not depend on the processor. Pictures lie as `[height][width][channels]`.

use crate::recall::RECALL;
pub use crate::sizes::{COLOUR, COMMAND, HEIGHT, HIDDEN, KNOWN, OUTPUTS, RAYS, SIGHT, STATE, WIDTH};
pub(crate) use crate::sizes::{RAW, RAW_SIGHT};
use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::net::{Dense, Gru, GruTape, GruTurned, elu, elu_back, padded, sigmoid, tanh};

const MIX: usize = 192;
const DENSE: usize = 192;
const HEAD: usize = 128;
/// Convolutions that the goal's colour shifts.
const TINTED: usize = 2;
/// Side, stride and channels of each convolution.
const CONVOLUTIONS: [(usize, usize, usize); 4] = [(3, 2, 16), (3, 2, 16), (3, 2, 32), (3, 2, 32)];

/// One convolution.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Conv {
    /// The weights: inputs are the patch, by rows, columns, channels.
    pub dense: Dense,
    /// Side of the patch; zeros of `side / 2` lie around the picture.
    pub side: usize,
    /// Pixels from one patch to the next.
    pub stride: usize,
    /// Rows, columns, channels that go in.
    pub from: [usize; 3],
    /// Rows, columns, channels that come out.
    pub to: [usize; 3],
}

impl Conv {
    fn new(from: [usize; 3], (side, stride, channels): (usize, usize, usize), start: usize) -> Self {
        let to = [from[0].div_ceil(stride), from[1].div_ceil(stride), channels];
        let dense = Dense { inputs: side * side * from[2], outputs: channels, start };
        Self { dense, side, stride, from, to }
    }

    fn pixels(&self) -> usize {
        self.to[0] * self.to[1]
    }

    /// Rows of the outcome that are worked on at once, so that their patches stay in the processor's first cache.
    fn strip(&self) -> usize {
        const NUMBERS: usize = 6000;
        (NUMBERS / (self.to[1] * padded(self.dense.inputs))).clamp(1, self.to[0])
    }

    /// For each patch of the rows `y` of the outcome and each of its own rows: calls `f` with the first number of that row in the patches,
    /// the first that lies within the picture, the first of the picture, and their count. Rows outside the picture have a count of 0.
    fn each(&self, y: std::ops::Range<usize>, mut f: impl FnMut(usize, usize, usize, usize)) {
        let [rows, columns, channels] = self.from;
        let (margin, width) = (self.side / 2, padded(self.dense.inputs));
        for (k, y) in y.enumerate() {
            for ky in 0..self.side {
                let at_y = (y * self.stride + ky).checked_sub(margin).filter(|&at| at < rows);
                for x in 0..self.to[1] {
                    let at_x = x * self.stride;
                    let (from, to) = (margin.saturating_sub(at_x), self.side.min(columns + margin - at_x));
                    let row = (k * self.to[1] + x) * width + ky * self.side * channels;
                    match at_y {
                        Some(at_y) => {
                            let picture = (at_y * columns + at_x + from - margin) * channels;
                            f(row, row + from * channels, picture, (to - from) * channels);
                        }
                        None => f(row, row, 0, 0),
                    }
                }
            }
        }
    }

    /// The picture cut into the patches of some rows of the outcome, padded rows; what lies outside is zero.
    fn patches(&self, picture: &[f32], y: std::ops::Range<usize>, out: &mut [f32]) {
        let long = self.side * self.from[2];
        self.each(y, |row, first, from, count| {
            if count < long {
                out[row..][..long].fill(0.0);
            }
            out[first..][..count].copy_from_slice(&picture[from..][..count]);
        });
    }

    /// Adds patches up to a picture: [`Conv::patches`] turned round.
    fn gather(&self, patches: &[f32], y: std::ops::Range<usize>, picture: &mut [f32]) {
        self.each(y, |_, first, to, count| {
            let part = &patches[first..][..count];
            picture[to..][..count].iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
        });
    }

    /// Calls `f` with the rows of each strip, their pixels and the first number of the outcome.
    fn strips(&self, mut f: impl FnMut(std::ops::Range<usize>, usize, usize)) {
        let strip = self.strip();
        for first in (0..self.to[0]).step_by(strip) {
            let rows = first..(first + strip).min(self.to[0]);
            let (pixels, at) = (rows.len() * self.to[1], first * self.to[1] * padded(self.to[2]));
            f(rows, pixels, at);
        }
    }

    /// The outcome before ELU.
    fn forward(&self, parameters: &[f32], picture: &[f32], patches: &mut [f32], out: &mut [f32]) {
        self.strips(|rows, pixels, at| {
            self.patches(picture, rows, patches);
            self.dense.forward(parameters, pixels, patches, &mut out[at..]);
        });
    }

    /// Adds the gradient of the weights.
    fn gradient(&self, picture: &[f32], of_out: &[f32], patches: &mut [f32], gradient: &mut [f32]) {
        self.strips(|rows, pixels, at| {
            self.patches(picture, rows, patches);
            self.dense.gradient(pixels, patches, &of_out[at..], gradient);
        });
    }

    /// The gradient of the picture.
    fn back(&self, turned: &[f32], of_out: &[f32], patches: &mut [f32], of_picture: &mut [f32]) {
        of_picture.fill(0.0);
        self.strips(|rows, pixels, at| {
            self.dense.back(pixels, turned, &of_out[at..], patches);
            self.gather(patches, rows, of_picture);
        });
    }
}

/// What the goal's colour adds to each pixel of a convolution's outcome: `[COLOUR][channels]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tint {
    /// First number in the flat array.
    pub start: usize,
    /// Channels of the convolution.
    pub channels: usize,
}

impl Tint {
    /// Its numbers.
    pub fn of<'a>(&self, parameters: &'a [f32]) -> &'a [f32] {
        &parameters[self.start..][..COLOUR * self.channels]
    }

    /// Adds what a state's colour says to all pixels.
    fn add(&self, parameters: &[f32], state: &[f32], out: &mut [f32]) {
        let mut shift = vec![0.0; self.channels];
        for (row, share) in self.of(parameters).chunks_exact(self.channels).zip(state) {
            shift.iter_mut().zip(row).for_each(|(sum, x)| *sum += share * x);
        }
        for pixel in out.chunks_exact_mut(self.channels) {
            pixel.iter_mut().zip(&shift).for_each(|(sum, x)| *sum += x);
        }
    }

    /// Adds its gradient, given that of the outcome.
    fn gradient(&self, state: &[f32], of_out: &[f32], gradient: &mut [f32]) {
        let mut sums = vec![0.0; self.channels];
        for pixel in of_out.chunks_exact(self.channels) {
            sums.iter_mut().zip(pixel).for_each(|(sum, x)| *sum += x);
        }
        let rows = gradient[self.start..][..COLOUR * self.channels].chunks_exact_mut(self.channels);
        for (row, share) in rows.zip(state) {
            row.iter_mut().zip(&sums).for_each(|(sum, x)| *sum += share * x);
        }
    }
}

/// The network: where its numbers lie in one flat array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Net {
    /// The convolutions.
    pub convolutions: Vec<Conv>,
    /// What the goal's colour adds to the first of them.
    pub tints: Vec<Tint>,
    /// From the last picture and the state.
    pub dense: Dense,
    /// What it says of the picture.
    pub sight: Dense,
    /// From the picture's dense layer and what the robot recalls.
    pub mix: Dense,
    /// The memory.
    pub gru: Gru,
    /// From the memory.
    pub head: Dense,
    /// The output.
    pub last: Dense,
}

/// Room for patches and pictures on the way through the convolutions.
#[derive(Debug, Clone)]
pub struct Scratch {
    patches: Vec<f32>,
    pictures: Vec<Vec<f32>>,
    of_pictures: [Vec<f32>; 2],
    gru: GruTape,
}

/// Weights as the way back reads them.
#[derive(Debug, Clone)]
pub struct TransposedWeights {
    convolutions: Vec<Vec<f32>>,
    dense: Vec<f32>,
    sight: Vec<f32>,
    mix: Vec<f32>,
    gru: GruTurned,
    head: Vec<f32>,
    last: Vec<f32>,
}

/// What a network sees at a decision.
#[derive(Debug, Clone, Copy)]
pub struct NetInput<'a> {
    /// 0 to 255, `[height][width][3]`, fractions allowed.
    pub picture: &'a [f32],
    /// [`STATE`] numbers.
    pub state: &'a [f32],
    /// [`RECALL`] numbers.
    pub recall: &'a [f32],
}

/// What it says, each number within its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetOutput {
    /// [`OUTPUTS`] and [`KNOWN`].
    pub out: [f32; OUTPUTS + KNOWN],
    /// See [`SIGHT`].
    pub sight: [f32; SIGHT],
}

/// A stretch of sequences that begin together, the longest first, so that at each step those that still run come first.
#[derive(Debug, Clone, Default)]
pub struct Stretch {
    /// Sequences at each step, never growing.
    pub rows: Vec<usize>,
    /// Pictures 0 to 255, `[samples][height][width][3]`; samples by step, then by sequence.
    pub pictures: Vec<u8>,
    /// `[samples][STATE]`.
    pub states: Vec<f32>,
    /// `[samples][RECALL]`.
    pub recalls: Vec<f32>,
}

impl Stretch {
    /// Pictures in it.
    pub fn samples(&self) -> usize {
        self.rows.iter().sum()
    }
}

/// What a pass over a [`Stretch`] leaves for the way back.
pub struct Pass {
    /// Output of each convolution of each sample.
    pictures: Vec<Vec<Vec<f32>>>,
    dense_in: Vec<f32>,
    dense_out: Vec<f32>,
    /// Rows of the picture's dense layer, then of what the robot recalls.
    mix_in: Vec<f32>,
    mix_out: Vec<f32>,
    /// Memory before each step.
    before: Vec<Vec<f32>>,
    tapes: Vec<GruTape>,
    memory: Vec<f32>,
    head: Vec<f32>,
    /// `[samples][RAW]`, before tanh and the logistic function.
    pub raw: Vec<f32>,
    /// `[samples][padded SIGHT]`, before the logistic function.
    pub sight: Vec<f32>,
}

impl Default for Net {
    fn default() -> Self {
        Self::of_size(HEIGHT, WIDTH)
    }
}

impl Net {
    /// For pictures of another size: for tests.
    pub(crate) fn of_size(height: usize, width: usize) -> Self {
        let (mut from, mut start, mut convolutions) = ([height, width, 3], 0, Vec::new());
        for shape in CONVOLUTIONS {
            let conv = Conv::new(from, shape, start);
            (from, start) = (conv.to, start + conv.dense.len());
            convolutions.push(conv);
        }
        let dense = Dense { inputs: from.iter().product::<usize>() + STATE, outputs: DENSE, start };
        let sight = Dense { inputs: DENSE, outputs: SIGHT, start: start + dense.len() };
        let mix = Dense { inputs: DENSE + RECALL, outputs: MIX, start: sight.start + sight.len() };
        let gru = Gru::new(MIX, HIDDEN, mix.start + mix.len());
        let head = Dense { inputs: HIDDEN, outputs: HEAD, start: mix.start + mix.len() + gru.len() };
        let last = Dense { inputs: HEAD, outputs: OUTPUTS + KNOWN, start: head.start + head.len() };
        let mut start = last.start + last.len();
        let mut tints = Vec::new();
        for conv in &convolutions[..TINTED] {
            // Rows of channels have no padding: all are multiples of sixteen.
            tints.push(Tint { start, channels: conv.to[2] });
            start += COLOUR * conv.to[2];
        }
        Self { convolutions, tints, dense, sight, mix, gru, head, last }
    }

    /// Numbers in the flat array.
    pub fn len(&self) -> usize {
        let ends = self.tints.iter().map(|t| t.start + COLOUR * t.channels);
        ends.fold(self.last.start + self.last.len(), usize::max)
    }

    /// Never true: a network has numbers.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Numbers of a picture.
    pub(crate) fn picture_len(&self) -> usize {
        self.convolutions[0].from.iter().product()
    }

    fn features(&self) -> usize {
        self.dense.inputs - STATE
    }

    /// Random weights.
    pub fn draw(&self, random: &mut Xoshiro256PlusPlus) -> Vec<f32> {
        let mut parameters = vec![0.0; self.len()];
        // Twice PyTorch's bound keeps the size of signals through ELU.
        self.convolutions.iter().for_each(|c| c.dense.draw(2.0, random, &mut parameters));
        self.dense.draw(2.0, random, &mut parameters);
        self.sight.draw(0.3, random, &mut parameters);
        self.mix.draw(2.0, random, &mut parameters);
        self.gru.draw(random, &mut parameters);
        self.head.draw(2.0, random, &mut parameters);
        self.last.draw(0.3, random, &mut parameters);
        for tint in &self.tints {
            parameters[tint.start..][..COLOUR * tint.channels].fill_with(|| random.between(-0.5, 0.5));
        }
        parameters
    }

    /// Room for the way through the convolutions.
    pub fn scratch(&self) -> Scratch {
        let strip = |c: &Conv| c.strip() * c.to[1] * padded(c.dense.inputs);
        let patches = self.convolutions.iter().map(strip).max().unwrap_or(0);
        let largest = self.convolutions.iter().map(|c| c.from.iter().product::<usize>()).max().unwrap_or(0);
        Scratch {
            patches: vec![0.0; patches],
            pictures: self.blank(),
            of_pictures: [vec![0.0; largest], vec![0.0; largest]],
            gru: self.gru.tape(1),
        }
    }

    fn blank(&self) -> Vec<Vec<f32>> {
        self.convolutions.iter().map(|c| vec![0.0; c.pixels() * padded(c.to[2])]).collect()
    }

    /// The weights as the way back reads them.
    pub fn turned(&self, parameters: &[f32]) -> TransposedWeights {
        let turn = |layer: &Dense| {
            let mut out = vec![0.0; padded(layer.inputs) * padded(layer.outputs)];
            layer.turn(parameters, &mut out);
            out
        };
        let (gru, (dense, head)) =
            rayon::join(|| self.gru.turned(parameters), || (turn(&self.dense), turn(&self.head)));
        let convolutions = self.convolutions.iter().map(|c| turn(&c.dense)).collect();
        TransposedWeights {
            convolutions,
            dense,
            sight: turn(&self.sight),
            mix: turn(&self.mix),
            gru,
            head,
            last: turn(&self.last),
        }
    }

    /// A picture of -1 to 1 through the convolutions.
    fn see(
        &self,
        parameters: &[f32],
        (picture, state): (&[f32], &[f32]),
        patches: &mut [f32],
        outputs: &mut [Vec<f32>],
    ) {
        for (k, conv) in self.convolutions.iter().enumerate() {
            let (before, after) = outputs.split_at_mut(k);
            conv.forward(parameters, if k == 0 { picture } else { &before[k - 1] }, patches, &mut after[0]);
            if let Some(tint) = self.tints.get(k) {
                tint.add(parameters, state, &mut after[0]);
            }
            elu(&mut after[0]);
        }
    }

    /// One decision. `memory`, [`HIDDEN`] numbers that begin as zeros, becomes the next one.
    pub fn step(&self, parameters: &[f32], sees: &NetInput, memory: &mut [f32], scratch: &mut Scratch) -> NetOutput {
        let picture: Vec<f32> = sees.picture.iter().map(|&x| scaled(x)).collect();
        let Scratch { patches, pictures, gru, .. } = scratch;
        self.see(parameters, (&picture, sees.state), patches, pictures);
        let mut input = vec![0.0; padded(self.dense.inputs)];
        input[..self.features()].copy_from_slice(&pictures[pictures.len() - 1]);
        input[self.features()..][..STATE].copy_from_slice(sees.state);
        let mut mix_in = vec![0.0; padded(self.mix.inputs)];
        self.dense.forward(parameters, 1, &input, &mut mix_in[..DENSE]);
        elu(&mut mix_in[..DENSE]);
        let mut sight = vec![0.0; RAW_SIGHT];
        self.sight.forward(parameters, 1, &mix_in[..DENSE], &mut sight);
        finish_sight(&mut sight);
        mix_in[DENSE..][..RECALL].copy_from_slice(sees.recall);
        let mut mix = vec![0.0; MIX];
        self.mix.forward(parameters, 1, &mix_in, &mut mix);
        elu(&mut mix);
        self.gru.forward(parameters, 1, &mix, memory, gru);
        let (mut head, mut out) = (vec![0.0; HEAD], vec![0.0; RAW]);
        self.head.forward(parameters, 1, memory, &mut head);
        elu(&mut head);
        self.last.forward(parameters, 1, &head, &mut out);
        finish(&mut out);
        NetOutput { out: std::array::from_fn(|k| out[k]), sight: std::array::from_fn(|k| sight[k]) }
    }

    /// A stretch of sequences; `memory` holds a row for each of them and becomes those after the stretch.
    pub fn forward(&self, parameters: &[f32], stretch: &Stretch, memory: &mut [f32], scratch: &mut Scratch) -> Pass {
        let samples = stretch.samples();
        let (width, features) = (padded(self.dense.inputs), self.features());
        let mix_width = padded(self.mix.inputs);
        let mut pass = Pass {
            pictures: Vec::with_capacity(samples),
            dense_in: vec![0.0; samples * width],
            dense_out: Vec::new(),
            mix_in: vec![0.0; samples * mix_width],
            mix_out: vec![0.0; samples * MIX],
            before: Vec::new(),
            tapes: Vec::new(),
            memory: Vec::with_capacity(samples * HIDDEN),
            head: vec![0.0; samples * HEAD],
            raw: vec![0.0; samples * RAW],
            sight: vec![0.0; samples * RAW_SIGHT],
        };
        for (sample, bytes) in stretch.pictures.chunks_exact(self.picture_len()).enumerate() {
            let picture: Vec<f32> = bytes.iter().map(|&b| scaled(f32::from(b))).collect();
            let mut outputs = self.blank();
            let state = &stretch.states[sample * STATE..][..STATE];
            self.see(parameters, (&picture, state), &mut scratch.patches, &mut outputs);
            let row = &mut pass.dense_in[sample * width..][..width];
            row[..features].copy_from_slice(&outputs[outputs.len() - 1]);
            row[features..][..STATE].copy_from_slice(state);
            pass.pictures.push(outputs);
        }
        let mut dense = vec![0.0; samples * DENSE];
        self.dense.forward(parameters, samples, &pass.dense_in, &mut dense);
        elu(&mut dense);
        self.sight.forward(parameters, samples, &dense, &mut pass.sight);
        let parts = dense.chunks_exact(DENSE).zip(stretch.recalls.chunks_exact(RECALL));
        for (row, (dense, recall)) in pass.mix_in.chunks_exact_mut(mix_width).zip(parts) {
            row[..DENSE].copy_from_slice(dense);
            row[DENSE..][..RECALL].copy_from_slice(recall);
        }
        self.mix.forward(parameters, samples, &pass.mix_in, &mut pass.mix_out);
        elu(&mut pass.mix_out);
        pass.dense_out = dense;
        let mut first = 0;
        for &rows in &stretch.rows {
            let mut tape = self.gru.tape(rows);
            pass.before.push(memory[..rows * HIDDEN].to_vec());
            let input = &pass.mix_out[first * MIX..][..rows * MIX];
            self.gru.forward(parameters, rows, input, memory, &mut tape);
            pass.memory.extend_from_slice(&memory[..rows * HIDDEN]);
            pass.tapes.push(tape);
            first += rows;
        }
        self.head.forward(parameters, samples, &pass.memory, &mut pass.head);
        elu(&mut pass.head);
        self.last.forward(parameters, samples, &pass.head, &mut pass.raw);
        pass
    }

    /// Adds the gradient of the parameters, given those of [`Pass::raw`] and [`Pass::sight`] (padded rows).
    pub fn backward(
        &self,
        turned: &TransposedWeights,
        stretch: &Stretch,
        pass: &mut Pass,
        [of_raw, of_sight]: [&[f32]; 2],
        scratch: &mut Scratch,
        gradient: &mut [f32],
    ) {
        let samples = stretch.samples();
        let mut of_head = vec![0.0; samples * HEAD];
        self.last.gradient(samples, &pass.head, of_raw, gradient);
        self.last.back(samples, &turned.last, of_raw, &mut of_head);
        elu_back(&mut of_head, &pass.head);
        let mut of_memory = vec![0.0; samples * HIDDEN];
        self.head.gradient(samples, &pass.memory, &of_head, gradient);
        self.head.back(samples, &turned.head, &of_head, &mut of_memory);
        let mut of_mix = vec![0.0; samples * MIX];
        let most = stretch.rows.first().copied().unwrap_or(0);
        // What later steps say of the memory after this one; nothing of sequences that had ended.
        let mut later = vec![0.0; most * HIDDEN];
        let mut first = samples;
        for (step, &rows) in stretch.rows.iter().enumerate().rev() {
            first -= rows;
            let now = &of_memory[first * HIDDEN..][..rows * HIDDEN];
            later.iter_mut().zip(now).for_each(|(sum, x)| *sum += x);
            let range = first * MIX..(first + rows) * MIX;
            let input = (&pass.mix_out[range.clone()], &pass.before[step][..]);
            let tape = &mut pass.tapes[step];
            self.gru.backward(&turned.gru, rows, input, tape, &mut later, &mut of_mix[range], gradient);
        }
        elu_back(&mut of_mix, &pass.mix_out);
        self.mix.gradient(samples, &pass.mix_in, &of_mix, gradient);
        let mix_width = padded(self.mix.inputs);
        let mut of_mix_in = vec![0.0; samples * mix_width];
        self.mix.back(samples, &turned.mix, &of_mix, &mut of_mix_in);
        let mut of_dense = vec![0.0; samples * DENSE];
        self.sight.gradient(samples, &pass.dense_out, of_sight, gradient);
        self.sight.back(samples, &turned.sight, of_sight, &mut of_dense);
        for (sum, row) in of_dense.chunks_exact_mut(DENSE).zip(of_mix_in.chunks_exact(mix_width)) {
            sum.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
        }
        elu_back(&mut of_dense, &pass.dense_out);
        self.dense.gradient(samples, &pass.dense_in, &of_dense, gradient);
        let width = padded(self.dense.inputs);
        let mut of_in = vec![0.0; samples * width];
        self.dense.back(samples, &turned.dense, &of_dense, &mut of_in);
        for (sample, bytes) in stretch.pictures.chunks_exact(self.picture_len()).enumerate() {
            let of_features = &of_in[sample * width..][..self.features()];
            let seen = (bytes, &stretch.states[sample * STATE..][..STATE]);
            self.see_back(turned, seen, &pass.pictures[sample], of_features, scratch, gradient);
        }
    }

    fn see_back(
        &self,
        turned: &TransposedWeights,
        (bytes, state): (&[u8], &[f32]),
        outputs: &[Vec<f32>],
        of_features: &[f32],
        scratch: &mut Scratch,
        gradient: &mut [f32],
    ) {
        let Scratch { patches, of_pictures: [now, next], .. } = scratch;
        now[..of_features.len()].copy_from_slice(of_features);
        for (k, conv) in self.convolutions.iter().enumerate().rev() {
            let count = outputs[k].len();
            elu_back(&mut now[..count], &outputs[k]);
            if let Some(tint) = self.tints.get(k) {
                tint.gradient(state, &now[..count], gradient);
            }
            if k == 0 {
                let picture: Vec<f32> = bytes.iter().map(|&b| scaled(f32::from(b))).collect();
                conv.gradient(&picture, now, patches, gradient);
                break;
            }
            conv.gradient(&outputs[k - 1], now, patches, gradient);
            let from = outputs[k - 1].len();
            conv.back(&turned.convolutions[k], now, patches, &mut next[..from]);
            std::mem::swap(now, next);
        }
    }
}

/// 0 to 255 as -1 to 1.
fn scaled(byte: f32) -> f32 {
    byte * (2.0 / 255.0) - 1.0
}

/// Brings the output into its ranges: tanh of the command, the logistic function of the visibility.
pub fn finish(row: &mut [f32]) {
    tanh(&mut row[..COMMAND]);
    sigmoid(&mut row[OUTPUTS - 1..OUTPUTS]);
}

/// The same for what it says of the picture.
pub fn finish_sight(row: &mut [f32]) {
    sigmoid(&mut row[3..4]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made_up(net: &Net) -> (Vec<f32>, Stretch) {
        let mut random = Xoshiro256PlusPlus::new(3);
        let parameters = net.draw(&mut random);
        let rows = vec![3, 3, 2, 1];
        let samples: usize = rows.iter().sum();
        let pictures = (0..samples * net.picture_len()).map(|_| random.below(256) as u8).collect();
        let states = (0..samples * STATE).map(|_| random.normal()).collect();
        let recalls = (0..samples * RECALL).map(|_| random.normal()).collect();
        (parameters, Stretch { rows, pictures, states, recalls })
    }

    #[test]
    fn sequences_are_single_steps() {
        let net = Net::of_size(20, 28);
        let (parameters, stretch) = made_up(&net);
        let (mut scratch, mut memory) = (net.scratch(), vec![0.0; 3 * HIDDEN]);
        let pass = net.forward(&parameters, &stretch, &mut memory, &mut scratch);
        // The second sequence has three steps.
        let mut own = vec![0.0; HIDDEN];
        for sample in [1, 4, 7] {
            let picture: Vec<f32> = stretch.pictures[sample * net.picture_len()..][..net.picture_len()]
                .iter()
                .map(|&b| f32::from(b))
                .collect();
            let (state, recall) =
                (&stretch.states[sample * STATE..][..STATE], &stretch.recalls[sample * RECALL..][..RECALL]);
            let says = net.step(&parameters, &NetInput { picture: &picture, state, recall }, &mut own, &mut scratch);
            let mut expected = pass.raw[sample * RAW..][..RAW].to_vec();
            finish(&mut expected);
            assert_eq!(says.out[..], expected[..OUTPUTS + KNOWN], "sample {sample}");
            let mut expected = pass.sight[sample * RAW_SIGHT..][..RAW_SIGHT].to_vec();
            finish_sight(&mut expected);
            assert_eq!(says.sight[..], expected[..SIGHT], "sample {sample}");
        }
        assert_eq!(own, memory[HIDDEN..2 * HIDDEN]);
    }

    #[test]
    fn backward_is_the_slope_of_forward() {
        let net = Net::of_size(20, 28);
        let (parameters, stretch) = made_up(&net);
        let mut random = Xoshiro256PlusPlus::new(9);
        let samples = stretch.samples();
        let mut of_raw = vec![0.0; samples * RAW];
        of_raw.chunks_exact_mut(RAW).for_each(|row| row[..OUTPUTS + KNOWN].fill_with(|| random.normal()));
        let of_sight: Vec<f32> = (0..samples * RAW_SIGHT).map(|_| 0.3 * random.normal()).collect();
        let mut scratch = net.scratch();
        let mut loss = |parameters: &[f32]| -> f64 {
            let mut memory = vec![0.1; 3 * HIDDEN];
            let pass = net.forward(parameters, &stretch, &mut memory, &mut scratch);
            let pairs = pass.raw.iter().zip(&of_raw).chain(pass.sight.iter().zip(&of_sight));
            pairs.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let (mut back_scratch, mut memory, mut gradient) = (net.scratch(), vec![0.1; 3 * HIDDEN], vec![0.0; net.len()]);
        let mut pass = net.forward(&parameters, &stretch, &mut memory, &mut back_scratch);
        let turned = net.turned(&parameters);
        net.backward(&turned, &stretch, &mut pass, [&of_raw, &of_sight], &mut back_scratch, &mut gradient);
        let mut layers: Vec<&Dense> = net.convolutions.iter().map(|c| &c.dense).collect();
        layers.extend([
            &net.dense,
            &net.sight,
            &net.mix,
            &net.gru.from_input,
            &net.gru.from_state,
            &net.head,
            &net.last,
        ]);
        let mut ranges: Vec<_> = layers.iter().map(|layer| layer.start..layer.start + layer.len()).collect();
        ranges.extend(net.tints.iter().map(|t| t.start..t.start + COLOUR * t.channels));
        for (k, range) in ranges.into_iter().enumerate() {
            // Along the gradient of one layer, weights and biases: the slope is the gradient's length squared.
            let squared: f64 = gradient[range.clone()].iter().map(|g| f64::from(*g).powi(2)).sum();
            assert!(squared > 0.0, "layer {k} has a gradient");
            let size = 2e-3 / squared.sqrt();
            let mut moved = |sign: f64| {
                let mut moved = parameters.clone();
                for at in range.clone() {
                    moved[at] += (sign * size * f64::from(gradient[at])) as f32;
                }
                loss(&moved)
            };
            let slope = (moved(1.0) - moved(-1.0)) / (2.0 * size);
            assert!((slope / squared - 1.0).abs() < 0.02, "layer {k}: {slope} for {squared}");
        }
    }
}
