//! A gated recurrent unit (Cho et al. 2014), in the form that PyTorch and ONNX (`linear_before_reset = 1`) compute:
//!
//! ```text
//! r = sigmoid(x Wr + br + h Ur + cr)      z = sigmoid(x Wz + bz + h Uz + cz)
//! n = tanh(x Wn + bn + r (h Un + cn))     h' = (1 - z) n + z h
//! ```

use super::elementwise::{sigmoid, tanh};
use super::{Dense, padded};
use qv_core::random::Xoshiro256PlusPlus;

/// Where the unit's numbers lie in a flat array: two dense layers onto three gates, r, z, n.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gru {
    /// Length of the state.
    pub hidden: usize,
    /// From the input, `3 padded(hidden)` outputs.
    pub from_input: Dense,
    /// From the state before, the same outputs.
    pub from_state: Dense,
}

/// What one step leaves for the way back.
#[derive(Debug, Clone)]
pub struct GruTape {
    /// r, z, n after their functions, padded rows of three gates.
    gates: Vec<f32>,
    /// `h Un + cn`, padded rows.
    candidate: Vec<f32>,
    state_part: Vec<f32>,
    of_input_gates: Vec<f32>,
    of_state_gates: Vec<f32>,
}

/// Weights of a [`Gru`] by output, which the way back reads: made anew after each step of the optimiser.
#[derive(Debug, Clone)]
pub struct GruTurned {
    from_input: Vec<f32>,
    from_state: Vec<f32>,
}

impl Gru {
    /// A unit for `inputs` numbers with a state of `hidden`, whose numbers begin at `start` of a flat array.
    pub fn new(inputs: usize, hidden: usize, start: usize) -> Self {
        let from_input = Dense { inputs, outputs: 3 * padded(hidden), start };
        let from_state = Dense { inputs: hidden, outputs: 3 * padded(hidden), start: start + from_input.len() };
        Self { hidden, from_input, from_state }
    }

    /// Numbers in the flat array.
    pub fn len(&self) -> usize {
        self.from_input.len() + self.from_state.len()
    }

    /// Never true: a unit has numbers.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Random weights within one over the root of the state's length, PyTorch's default; those of padding are zero.
    pub fn draw(&self, random: &mut Xoshiro256PlusPlus, parameters: &mut [f32]) {
        let bound = 1.0 / (self.hidden as f32).sqrt();
        for layer in [&self.from_input, &self.from_state] {
            for i in 0..layer.inputs {
                for o in (0..layer.outputs).filter(|o| o % padded(self.hidden) < self.hidden) {
                    parameters[layer.start + i * layer.outputs + o] = random.between(-bound, bound);
                }
            }
        }
    }

    /// Room for steps of `rows` rows.
    pub fn tape(&self, rows: usize) -> GruTape {
        let width = padded(self.hidden);
        let gates = || vec![0.0; rows * 3 * width];
        GruTape {
            gates: gates(),
            candidate: vec![0.0; rows * width],
            state_part: gates(),
            of_input_gates: gates(),
            of_state_gates: gates(),
        }
    }

    /// One step: `state` (padded rows) becomes the next one.
    pub fn forward(&self, parameters: &[f32], rows: usize, input: &[f32], state: &mut [f32], tape: &mut GruTape) {
        let width = padded(self.hidden);
        self.from_input.forward(parameters, rows, input, &mut tape.gates);
        self.from_state.forward(parameters, rows, state, &mut tape.state_part);
        for row in 0..rows {
            let (gates, part) = (&mut tape.gates[row * 3 * width..][..3 * width], &tape.state_part[row * 3 * width..]);
            for k in 0..2 * width {
                gates[k] += part[k];
            }
            sigmoid(&mut gates[..2 * width]);
            tape.candidate[row * width..][..width].copy_from_slice(&part[2 * width..3 * width]);
            for k in 0..width {
                gates[2 * width + k] += gates[k] * part[2 * width + k];
            }
            tanh(&mut gates[2 * width..]);
            // Padding of the state is zero and stays so: its candidate is tanh(0).
            for (k, h) in state[row * width..][..width].iter_mut().enumerate() {
                let (z, n) = (gates[width + k], gates[2 * width + k]);
                *h = (1.0 - z) * n + z * *h;
            }
        }
    }

    /// The weights as [`Gru::backward`] reads them.
    pub fn turned(&self, parameters: &[f32]) -> GruTurned {
        let turned = |layer: &Dense| {
            let mut turned = vec![0.0; padded(layer.inputs) * layer.outputs];
            layer.turn(parameters, &mut turned);
            turned
        };
        GruTurned { from_input: turned(&self.from_input), from_state: turned(&self.from_state) }
    }

    /// One step back. `of_state` is the gradient of the state after the step and becomes that of the state before, `before`; the
    /// gradient of the input is written to `of_input` (padded rows), that of the parameters is added.
    pub fn backward(
        &self,
        turned: &GruTurned,
        rows: usize,
        (input, before): (&[f32], &[f32]),
        tape: &mut GruTape,
        of_state: &mut [f32],
        of_input: &mut [f32],
        gradient: &mut [f32],
    ) {
        let width = padded(self.hidden);
        for row in 0..rows {
            let gates = &tape.gates[row * 3 * width..][..3 * width];
            let (of_x, of_h) =
                (&mut tape.of_input_gates[row * 3 * width..], &mut tape.of_state_gates[row * 3 * width..]);
            for k in 0..width {
                let (r, z, n) = (gates[k], gates[width + k], gates[2 * width + k]);
                let at = row * width + k;
                let after = of_state[at];
                let of_n = after * (1.0 - z) * (1.0 - n * n);
                let of_z = after * (before[at] - n) * z * (1.0 - z);
                let of_r = of_n * tape.candidate[at] * r * (1.0 - r);
                (of_x[k], of_x[width + k], of_x[2 * width + k]) = (of_r, of_z, of_n);
                (of_h[k], of_h[width + k], of_h[2 * width + k]) = (of_r, of_z, of_n * r);
                of_state[at] = after * z;
            }
        }
        self.from_input.gradient(rows, input, &tape.of_input_gates, gradient);
        self.from_state.gradient(rows, before, &tape.of_state_gates, gradient);
        self.from_input.back(rows, &turned.from_input, &tape.of_input_gates, of_input);
        let mut through = vec![0.0; rows * width];
        self.from_state.back(rows, &turned.from_state, &tape.of_state_gates, &mut through);
        of_state.iter_mut().zip(through).for_each(|(sum, x)| *sum += x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The equations above for one row, in double precision.
    fn slow(unit: &Gru, parameters: &[f32], x: &[f64], h: &[f64]) -> Vec<f64> {
        let width = padded(unit.hidden);
        let gate = |layer: &Dense, from: &[f64], g: usize, k: usize| -> f64 {
            let (weights, bias) = layer.unpadded(parameters);
            let o = g * width + k;
            f64::from(bias[o])
                + from.iter().enumerate().map(|(i, v)| v * f64::from(weights[o * layer.inputs + i])).sum::<f64>()
        };
        let s = |x: f64| 1.0 / (1.0 + (-x).exp());
        (0..unit.hidden)
            .map(|k| {
                let r = s(gate(&unit.from_input, x, 0, k) + gate(&unit.from_state, h, 0, k));
                let z = s(gate(&unit.from_input, x, 1, k) + gate(&unit.from_state, h, 1, k));
                let n = (gate(&unit.from_input, x, 2, k) + r * gate(&unit.from_state, h, 2, k)).tanh();
                (1.0 - z) * n + z * h[k]
            })
            .collect()
    }

    #[test]
    fn two_steps_and_their_slopes() {
        let unit = Gru::new(5, 7, 0);
        let (rows, width, steps) = (3, padded(7), 2);
        let mut random = Xoshiro256PlusPlus::new(2);
        let mut parameters = vec![0.0; unit.len()];
        unit.draw(&mut random, &mut parameters);
        let inputs: Vec<Vec<f32>> = (0..steps * rows).map(|_| (0..5).map(|_| random.normal()).collect()).collect();
        let weight: Vec<f32> = (0..7).map(|_| random.normal()).collect();
        // Loss: a weighted sum of the last state.
        let run = |parameters: &[f32], inputs: &[Vec<f32>]| -> f64 {
            (0..rows)
                .map(|row| {
                    let mut h = vec![0.0; 7];
                    for step in 0..steps {
                        let x: Vec<f64> = inputs[step * rows + row].iter().map(|&x| f64::from(x)).collect();
                        h = slow(&unit, parameters, &x, &h);
                    }
                    h.iter().zip(&weight).map(|(h, &w)| h * f64::from(w)).sum::<f64>()
                })
                .sum()
        };
        let flat = |step: usize| {
            let mut out = vec![0.0; rows * padded(5)];
            (0..rows).for_each(|row| out[row * padded(5)..][..5].copy_from_slice(&inputs[step * rows + row]));
            out
        };
        let mut states = vec![vec![0.0f32; rows * width]];
        let mut tapes = Vec::new();
        for step in 0..steps {
            let (mut state, mut tape) = (states[step].clone(), unit.tape(rows));
            unit.forward(&parameters, rows, &flat(step), &mut state, &mut tape);
            states.push(state);
            tapes.push(tape);
        }
        let last = &states[steps];
        let found: f64 =
            (0..rows).map(|row| (0..7).map(|k| f64::from(last[row * width + k] * weight[k])).sum::<f64>()).sum();
        assert!((found - run(&parameters, &inputs)).abs() < 1e-5);
        assert!((0..rows).all(|row| last[row * width + 7..][..width - 7].iter().all(|&x| x == 0.0)), "padding");
        let mut of_state = vec![0.0; rows * width];
        (0..rows).for_each(|row| of_state[row * width..][..7].copy_from_slice(&weight));
        let (mut gradient, mut of_input) = (vec![0.0; unit.len()], vec![0.0; rows * padded(5)]);
        let turned = unit.turned(&parameters);
        for step in (0..steps).rev() {
            let (input, before) = (flat(step), states[step].clone());
            let tape = &mut tapes[step];
            unit.backward(&turned, rows, (&input, &before), tape, &mut of_state, &mut of_input, &mut gradient);
        }
        for (layer, i) in [(&unit.from_input, 2), (&unit.from_state, 3)] {
            for o in [1, width + 4, 2 * width + 6] {
                let at = layer.start + i * layer.outputs + o;
                let mut moved = parameters.clone();
                moved[at] += 1e-2;
                let above = run(&moved, &inputs);
                moved[at] = parameters[at] - 1e-2;
                let slope = (above - run(&moved, &inputs)) / 2e-2;
                assert!((f64::from(gradient[at]) - slope).abs() < 1e-3, "{} for {slope}", gradient[at]);
            }
        }
        // The gradient of the first input, row 1, number 4.
        let moved = |by: f32| {
            let mut inputs = inputs.clone();
            inputs[1][4] += by;
            run(&parameters, &inputs)
        };
        let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
        assert!((f64::from(of_input[padded(5) + 4]) - slope).abs() < 1e-3);
    }
}
