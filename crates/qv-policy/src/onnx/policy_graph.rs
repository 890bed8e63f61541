//! A multilayer perceptron with scaled input and clipped output, as an ONNX file.

use super::graph::check;
use super::{GraphBuilder, OnnxError};
use crate::net::Mlp;

/// One layer: `y = W x + b`, then ELU where `elu` is set.
#[derive(Debug, Clone, Copy)]
pub struct Dense<'a> {
    /// Shape `[outputs][inputs]`, row-major.
    pub weights: &'a [f32],
    /// Shape `[outputs]`.
    pub bias: &'a [f32],
    /// Length of x.
    pub inputs: usize,
    /// Length of y.
    pub outputs: usize,
    /// Whether an exponential linear unit (alpha 1) follows.
    pub elu: bool,
}

impl<'a> Dense<'a> {
    /// The layers of a network, given its numbers without padding ([`Mlp::unpadded`]): an exponential linear unit follows all but the last.
    pub fn of(net: &Mlp, plain: &'a [(Vec<f32>, Vec<f32>)]) -> Vec<Self> {
        let last = net.layers.len() - 1;
        let pairs = net.layers.iter().zip(plain).enumerate();
        pairs
            .map(|(k, (layer, (weights, bias)))| Self {
                weights,
                bias,
                inputs: layer.inputs,
                outputs: layer.outputs,
                elu: k < last,
            })
            .collect()
    }
}

/// A policy: `clip(output_offset + output_scale · mlp((x - offset) · scale), lower, upper)`, element by element.
///
/// The contract of a `policy.onnx` of this project: input `observation`, f32, shape `[n, inputs]`, for the Go2 47 numbers (45 without a clock);
/// output `targets`, f32, shape `[n, joints]`, joint angles \[rad\].
#[derive(Debug, Clone, Copy)]
pub struct PolicyGraph<'a> {
    /// Name of the input.
    pub input: &'a str,
    /// Name of the output.
    pub output: &'a str,
    /// Mean of the observations, shape `[inputs]`.
    pub offset: &'a [f32],
    /// One over their spread, shape `[inputs]`.
    pub scale: &'a [f32],
    /// The layers, first to last; at least one.
    pub layers: &'a [Dense<'a>],
    /// What an output of 1 means, shape `[outputs]`.
    pub output_scale: &'a [f32],
    /// What an output of 0 means, shape `[outputs]`.
    pub output_offset: &'a [f32],
    /// Least output, shape `[outputs]`.
    pub lower: &'a [f32],
    /// Largest output, shape `[outputs]`.
    pub upper: &'a [f32],
    /// Kept in the file as text, key and value.
    pub metadata: &'a [(String, String)],
}

impl PolicyGraph<'_> {
    /// Writes the file: ONNX, operator set 13, IR version 8, batch dimension `n`.
    ///
    /// # Errors
    /// Names the array or layer: no layer, a width of zero, a length that does not fit, a number that is not finite, a
    /// lower bound above its upper one, or one name for input and output.
    pub fn to_bytes(&self) -> Result<Vec<u8>, OnnxError> {
        let (inputs, outputs) = self.check()?;
        let mut graph = GraphBuilder::new();
        let observation = graph.input(self.input, inputs)?;
        let offset = graph.constant("offset", &[inputs], self.offset)?;
        let scale = graph.constant("scale", &[inputs], self.scale)?;
        let centred = graph.sub(&observation, &offset);
        let mut x = graph.mul(&centred, &scale);
        for (k, layer) in self.layers.iter().enumerate() {
            let shape = [layer.outputs, layer.inputs];
            let weights = graph.constant(&format!("layer_{k}.weights"), &shape, layer.weights)?;
            let bias = graph.constant(&format!("layer_{k}.bias"), &[layer.outputs], layer.bias)?;
            x = graph.gemm(&x, &weights, &bias);
            if layer.elu {
                x = graph.elu(&x);
            }
        }
        let scale = graph.constant("output_scale", &[outputs], self.output_scale)?;
        let offset = graph.constant("output_offset", &[outputs], self.output_offset)?;
        let lower = graph.constant("lower", &[outputs], self.lower)?;
        let upper = graph.constant("upper", &[outputs], self.upper)?;
        let scaled = graph.mul(&x, &scale);
        let moved = graph.add(&scaled, &offset);
        let above = graph.max(&moved, &lower);
        let clipped = graph.min(&above, &upper);
        graph.output(&clipped, self.output, outputs)?;
        self.metadata.iter().for_each(|(key, value)| graph.metadata(key, value));
        Ok(graph.finish())
    }

    /// Lengths of the first layer's input and of the last one's output.
    fn check(&self) -> Result<(usize, usize), OnnxError> {
        let (Some(first), Some(last)) = (self.layers.first(), self.layers.last()) else {
            return Err(OnnxError::Empty { what: "layers" });
        };
        let mut width = first.inputs;
        for (k, layer) in self.layers.iter().enumerate() {
            if layer.inputs == 0 || layer.outputs == 0 {
                return Err(OnnxError::Empty { what: "width of a layer" });
            }
            if layer.inputs != width {
                let what = format!("inputs of layer {k}");
                return Err(OnnxError::Length { what, expected: width, found: layer.inputs });
            }
            let weights = layer.inputs.saturating_mul(layer.outputs);
            check(&format!("weights of layer {k}"), weights, layer.weights)?;
            check(&format!("bias of layer {k}"), layer.outputs, layer.bias)?;
            width = layer.outputs;
        }
        check("offset", first.inputs, self.offset)?;
        check("scale", first.inputs, self.scale)?;
        check("output_scale", last.outputs, self.output_scale)?;
        check("output_offset", last.outputs, self.output_offset)?;
        check("lower", last.outputs, self.lower)?;
        check("upper", last.outputs, self.upper)?;
        for (index, (&lower, &upper)) in self.lower.iter().zip(self.upper).enumerate() {
            if lower > upper {
                return Err(OnnxError::Bounds { index, lower, upper });
            }
        }
        Ok((first.inputs, last.outputs))
    }
}
