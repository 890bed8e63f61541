//! An ONNX graph built node by node, and written as a file.
//!
//! Field numbers are those of `onnx.proto` (ONNX 1.13, IR version 8); operators are those of operator set 13. Every
//! tensor that flows has rows: its first dimension is the batch, named `n`.

use super::OnnxError;
use super::protobuf::Message;
use std::collections::HashSet;

/// Version of the file format.
const IR_VERSION: i64 = 8;
/// Version of the operators.
const OPERATOR_SET: i64 = 13;
/// `TensorProto.DataType`.
const FLOAT: i64 = 1;
const BYTE: i64 = 2;
const INT64: i64 = 7;

/// A tensor of a graph, by its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tensor(String);

impl Tensor {
    /// Its name in the file.
    pub fn name(&self) -> &str {
        &self.0
    }
}

/// Weights of a gated recurrent unit, gates in the order z, r, h (ONNX).
#[derive(Debug, Clone, Copy)]
pub struct Gru<'a> {
    /// Length of an input row.
    pub inputs: usize,
    /// Length of the state.
    pub hidden: usize,
    /// Shape `[3 hidden][inputs]`, row-major.
    pub input_weights: &'a [f32],
    /// Shape `[3 hidden][hidden]`, row-major.
    pub state_weights: &'a [f32],
    /// Of the inputs, shape `[3 hidden]`.
    pub input_bias: &'a [f32],
    /// Of the state, shape `[3 hidden]`.
    pub state_bias: &'a [f32],
}

enum Attribute {
    Float(&'static str, f32),
    Integer(&'static str, i64),
    Integers(&'static str, Vec<i64>),
}

/// A graph that grows node by node. Names that are not given are made up from the operator and a count.
#[derive(Debug, Default)]
pub struct GraphBuilder {
    nodes: Vec<Message>,
    initialisers: Vec<Message>,
    inputs: Vec<Message>,
    outputs: Vec<Message>,
    metadata: Vec<Message>,
    names: HashSet<String>,
}

impl GraphBuilder {
    /// An empty graph.
    pub fn new() -> Self {
        Self::default()
    }

    /// An input of shape `[n, width]`.
    ///
    /// # Errors
    /// When the name is empty or taken.
    pub fn input(&mut self, name: &str, width: usize) -> Result<Tensor, OnnxError> {
        let tensor = self.take(name)?;
        self.inputs.push(value_info(name, FLOAT, &[width]));
        Ok(tensor)
    }

    /// An input of bytes of shape `[n, ...shape]`, such as pictures `[n, height, width, 3]`.
    ///
    /// # Errors
    /// When the name is empty or taken.
    pub fn input_bytes(&mut self, name: &str, shape: &[usize]) -> Result<Tensor, OnnxError> {
        let tensor = self.take(name)?;
        self.inputs.push(value_info(name, BYTE, shape));
        Ok(tensor)
    }

    /// Makes `tensor`, of shape `[n, width]`, an output under the name `name`.
    ///
    /// # Errors
    /// When the name is empty or taken.
    pub fn output(&mut self, tensor: &Tensor, name: &str, width: usize) -> Result<(), OnnxError> {
        let named = self.take(name)?;
        self.push("Identity", &[tensor.name()], &[named.name()], &[]);
        self.outputs.push(value_info(name, FLOAT, &[width]));
        Ok(())
    }

    /// A constant tensor, row-major.
    ///
    /// # Errors
    /// When the name is empty or taken, `values` does not fill `shape`, or a value is not finite.
    pub fn constant(&mut self, name: &str, shape: &[usize], values: &[f32]) -> Result<Tensor, OnnxError> {
        let expected = shape.iter().fold(1_usize, |product, &size| product.saturating_mul(size));
        check(name, expected, values)?;
        let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initialiser(name, FLOAT, shape, &raw)
    }

    /// Text kept in the file beside the graph (`metadata_props`).
    pub fn metadata(&mut self, key: &str, value: &str) {
        let mut entry = Message::default();
        entry.bytes(1, key.as_bytes());
        entry.bytes(2, value.as_bytes());
        self.metadata.push(entry);
    }

    /// `a - b`, with ONNX's broadcasting, as for all operators of two tensors.
    pub fn sub(&mut self, a: &Tensor, b: &Tensor) -> Tensor {
        self.node("Sub", &[a, b], &[])
    }

    /// `a b`, element by element.
    pub fn mul(&mut self, a: &Tensor, b: &Tensor) -> Tensor {
        self.node("Mul", &[a, b], &[])
    }

    /// `a + b`.
    pub fn add(&mut self, a: &Tensor, b: &Tensor) -> Tensor {
        self.node("Add", &[a, b], &[])
    }

    /// `a / b`.
    pub fn div(&mut self, a: &Tensor, b: &Tensor) -> Tensor {
        self.node("Div", &[a, b], &[])
    }

    /// Square root, element by element.
    pub fn sqrt(&mut self, x: &Tensor) -> Tensor {
        self.node("Sqrt", &[x], &[])
    }

    /// Size without sign, element by element.
    pub fn abs(&mut self, x: &Tensor) -> Tensor {
        self.node("Abs", &[x], &[])
    }

    /// The larger of two, element by element.
    pub fn max(&mut self, a: &Tensor, b: &Tensor) -> Tensor {
        self.node("Max", &[a, b], &[])
    }

    /// The smaller of two, element by element.
    pub fn min(&mut self, a: &Tensor, b: &Tensor) -> Tensor {
        self.node("Min", &[a, b], &[])
    }

    /// `x Wᵀ + b` for rows x, weights `[out][in]` and bias `[out]`.
    pub fn gemm(&mut self, x: &Tensor, weights: &Tensor, bias: &Tensor) -> Tensor {
        self.node("Gemm", &[x, weights, bias], &[Attribute::Integer("transB", 1)])
    }

    /// `x` above zero, `exp(x) - 1` below.
    pub fn elu(&mut self, x: &Tensor) -> Tensor {
        self.node("Elu", &[x], &[Attribute::Float("alpha", 1.0)])
    }

    /// Hyperbolic tangent.
    pub fn tanh(&mut self, x: &Tensor) -> Tensor {
        self.node("Tanh", &[x], &[])
    }

    /// Bytes as numbers.
    pub fn to_float(&mut self, x: &Tensor) -> Tensor {
        self.node("Cast", &[x], &[Attribute::Integer("to", FLOAT)])
    }

    /// Dimensions in another order: `order[k]` is the one that becomes the `k`-th.
    pub fn transpose(&mut self, x: &Tensor, order: &[usize]) -> Tensor {
        let order = order.iter().map(|&k| k as i64).collect();
        self.node("Transpose", &[x], &[Attribute::Integers("perm", order)])
    }

    /// Means of squares of `side` pixels of pictures `[n, channels, height, width]`.
    pub fn average_pool(&mut self, x: &Tensor, side: usize) -> Tensor {
        let square = || vec![side as i64; 2];
        let attributes = [Attribute::Integers("kernel_shape", square()), Attribute::Integers("strides", square())];
        self.node("AveragePool", &[x], &attributes)
    }

    /// Convolution of pictures `[n, channels, height, width]` with weights `[out][channels][side][side]` and bias `[out]`; `margin` zeros around.
    pub fn conv(
        &mut self,
        x: &Tensor,
        [weights, bias]: [&Tensor; 2],
        side: usize,
        stride: usize,
        margin: usize,
    ) -> Tensor {
        let attributes = [
            Attribute::Integers("kernel_shape", vec![side as i64; 2]),
            Attribute::Integers("strides", vec![stride as i64; 2]),
            Attribute::Integers("pads", vec![margin as i64; 4]),
        ];
        self.node("Conv", &[x, weights, bias], &attributes)
    }

    /// All dimensions but the first made one.
    pub fn flatten(&mut self, x: &Tensor) -> Tensor {
        self.node("Flatten", &[x], &[Attribute::Integer("axis", 1)])
    }

    /// The logistic function.
    pub fn sigmoid(&mut self, x: &Tensor) -> Tensor {
        self.node("Sigmoid", &[x], &[])
    }

    /// Rows put side by side.
    pub fn concat(&mut self, parts: &[&Tensor]) -> Tensor {
        self.node("Concat", parts, &[Attribute::Integer("axis", 1)])
    }

    /// Columns `from` up to, not including, `to`.
    ///
    /// # Errors
    /// When there are none.
    pub fn slice(&mut self, x: &Tensor, from: usize, to: usize) -> Result<Tensor, OnnxError> {
        if from >= to {
            return Err(OnnxError::Empty { what: "columns of a slice" });
        }
        let bounds = [from, to, 1].map(|value| self.integers("bound", &[value as i64]));
        let [from, to, axis] = bounds;
        Ok(self.node("Slice", &[x, &from?, &to?, &axis?], &[]))
    }

    /// One step of a gated recurrent unit: rows `x` of shape `[n, inputs]` and state `[n, hidden]` to the next state.
    /// The reset gate acts on the state's product with its weights (`linear_before_reset`), as in PyTorch.
    ///
    /// # Errors
    /// When a length is off or a number is not finite.
    pub fn gru(&mut self, name: &str, gru: &Gru, x: &Tensor, state: &Tensor) -> Result<Tensor, OnnxError> {
        let (inputs, hidden) = (gru.inputs, gru.hidden);
        check(&format!("{name}, bias of inputs"), 3 * hidden, gru.input_bias)?;
        let w = self.constant(&format!("{name}.input_weights"), &[1, 3 * hidden, inputs], gru.input_weights)?;
        let r = self.constant(&format!("{name}.state_weights"), &[1, 3 * hidden, hidden], gru.state_weights)?;
        let bias = [gru.input_bias, gru.state_bias].concat();
        let b = self.constant(&format!("{name}.bias"), &[1, 6 * hidden], &bias)?;
        let axis = self.integers("axis", &[0])?;
        let (x, state) = (self.node("Unsqueeze", &[x, &axis], &[]), self.node("Unsqueeze", &[state, &axis], &[]));
        let next = self.fresh("GRU");
        // The fifth input, lengths of sequences, and the first output, all states, are left out.
        let tensors = [x.name(), w.name(), r.name(), b.name(), "", state.name()];
        let attributes =
            [Attribute::Integer("hidden_size", hidden as i64), Attribute::Integer("linear_before_reset", 1)];
        self.push("GRU", &tensors, &["", next.name()], &attributes);
        Ok(self.node("Squeeze", &[&next, &axis], &[]))
    }

    /// The file.
    pub fn finish(self) -> Vec<u8> {
        let mut graph = Message::default();
        self.nodes.iter().for_each(|node| graph.message(1, node));
        graph.bytes(2, b"policy");
        self.initialisers.iter().for_each(|tensor| graph.message(5, tensor));
        self.inputs.iter().for_each(|input| graph.message(11, input));
        self.outputs.iter().for_each(|output| graph.message(12, output));
        let mut operators = Message::default();
        operators.bytes(1, b"");
        operators.integer(2, OPERATOR_SET);
        let mut model = Message::default();
        model.integer(1, IR_VERSION);
        model.bytes(2, b"QuadVerse-RS");
        model.message(7, &graph);
        model.message(8, &operators);
        self.metadata.iter().for_each(|entry| model.message(14, entry));
        model.into_bytes()
    }

    fn take(&mut self, name: &str) -> Result<Tensor, OnnxError> {
        if name.is_empty() || !self.names.insert(name.to_owned()) {
            return Err(OnnxError::Name(name.to_owned()));
        }
        Ok(Tensor(name.to_owned()))
    }

    /// A tensor with a name that nobody has.
    fn fresh(&mut self, stem: &str) -> Tensor {
        let mut count = self.names.len();
        loop {
            let name = format!("{stem}_{count}");
            if self.names.insert(name.clone()) {
                return Tensor(name);
            }
            count += 1;
        }
    }

    fn integers(&mut self, stem: &str, values: &[i64]) -> Result<Tensor, OnnxError> {
        let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let tensor = self.fresh(stem);
        self.push_initialiser(tensor.name(), INT64, &[values.len()], &raw);
        Ok(tensor)
    }

    fn initialiser(&mut self, name: &str, kind: i64, shape: &[usize], raw: &[u8]) -> Result<Tensor, OnnxError> {
        let tensor = self.take(name)?;
        self.push_initialiser(name, kind, shape, raw);
        Ok(tensor)
    }

    fn push_initialiser(&mut self, name: &str, kind: i64, shape: &[usize], raw: &[u8]) {
        let mut tensor = Message::default();
        shape.iter().for_each(|&size| tensor.integer(1, size as i64));
        tensor.integer(2, kind);
        tensor.bytes(8, name.as_bytes());
        tensor.bytes(9, raw);
        self.initialisers.push(tensor);
    }

    fn node(&mut self, operator: &str, inputs: &[&Tensor], attributes: &[Attribute]) -> Tensor {
        let output = self.fresh(operator);
        let names: Vec<&str> = inputs.iter().map(|tensor| tensor.name()).collect();
        self.push(operator, &names, &[output.name()], attributes);
        output
    }

    fn push(&mut self, operator: &str, inputs: &[&str], outputs: &[&str], attributes: &[Attribute]) {
        let mut node = Message::default();
        inputs.iter().for_each(|name| node.bytes(1, name.as_bytes()));
        outputs.iter().for_each(|name| node.bytes(2, name.as_bytes()));
        node.bytes(3, format!("{operator}.{}", self.nodes.len()).as_bytes());
        node.bytes(4, operator.as_bytes());
        for attribute in attributes {
            let mut message = Message::default();
            // 1, 2 and 7 are `AttributeProto.FLOAT`, `INT` and `INTS`.
            let (name, kind) = match attribute {
                &Attribute::Float(name, value) => {
                    message.float(2, value);
                    (name, 1)
                }
                &Attribute::Integer(name, value) => {
                    message.integer(3, value);
                    (name, 2)
                }
                Attribute::Integers(name, values) => {
                    values.iter().for_each(|&value| message.integer(8, value));
                    (*name, 7)
                }
            };
            message.bytes(1, name.as_bytes());
            message.integer(20, kind);
            node.message(5, &message);
        }
        self.nodes.push(node);
    }
}

/// That there are `expected` numbers, all finite.
pub(crate) fn check(what: &str, expected: usize, values: &[f32]) -> Result<(), OnnxError> {
    if values.len() != expected {
        return Err(OnnxError::Length { what: what.to_owned(), expected, found: values.len() });
    }
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(OnnxError::NotFinite { what: what.to_owned(), index, found: values[index] }),
        None => Ok(()),
    }
}

/// `ValueInfoProto` of a kind of number and shape `[n, ...shape]`.
fn value_info(name: &str, number: i64, sizes: &[usize]) -> Message {
    let mut rows = Message::default();
    rows.bytes(2, b"n");
    let mut shape = Message::default();
    shape.message(1, &rows);
    for &size in sizes {
        let mut dimension = Message::default();
        dimension.integer(1, size as i64);
        shape.message(1, &dimension);
    }
    let mut tensor = Message::default();
    tensor.integer(1, number);
    tensor.message(2, &shape);
    let mut kind = Message::default();
    kind.message(1, &tensor);
    let mut info = Message::default();
    info.bytes(1, name.as_bytes());
    info.message(2, &kind);
    info
}
