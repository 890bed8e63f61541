//! Anyone's ONNX policy, run on the CPU.
//!
//! The interpreter is `rten` 0.27. Compared on one machine, each in a crate of its own:
//!
//! | | rten 0.27.0 | tract-onnx 0.23.9 |
//! |---|---|---|
//! | reads `.onnx` itself | yes, since 0.24 | yes |
//! | licence | MIT or Apache-2.0 | MIT or Apache-2.0 |
//! | crates | 23 | 115 |
//! | release build, processor time | 67 s | 468 s |
//!
//! Both run the multilayer perceptrons and GRUs that policies are made of; rten was taken for its size. It reads one
//! variable of the environment, `RTEN_TIMING`, which makes it print times and changes no number.

use super::OnnxError;
use super::graph::check;
use super::model::{OnnxModel, numbers};
use rten::{DataType, Dimension, Model, NodeId, ValueType, ValueView};

/// Name and shape of an input or output.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TensorInfo {
    /// Name in the file.
    pub name: String,
    /// Sizes; `None` where the file leaves them open, as it often does with the batch. Empty when it states no shape.
    pub shape: Vec<Option<usize>>,
}

impl TensorInfo {
    /// Numbers in it when open sizes are 1.
    fn len(&self) -> Option<usize> {
        self.shape.iter().try_fold(1_usize, |product, size| product.checked_mul(size.unwrap_or(1)))
    }
}

/// More numbers than this in all inputs are no policy's: a damaged file must not ask for all memory.
const MOST_NUMBERS: usize = 1 << 20;

/// What computes a step of a policy. A caller who does not trust a file gives one that runs in another process.
pub trait Step: Send {
    /// The numbers of the first outputs, one for each input, row-major; `inputs` are the observation and the state, row-major.
    ///
    /// # Errors
    /// The model cannot be run on them.
    fn step(&mut self, inputs: &[&[f32]]) -> Result<Vec<Vec<f32>>, OnnxError>;
}

/// A policy from an ONNX file. Its first input takes the observation, its first output is the action. Further inputs
/// and outputs are a recurrent state: the second output of one step is the second input of the next, and so on; they
/// start at zero.
pub struct OnnxPolicy {
    model: Box<dyn Step>,
    inputs: Vec<TensorInfo>,
    outputs: Vec<TensorInfo>,
    /// Inputs after the first one.
    state: Vec<Vec<f32>>,
}

impl std::fmt::Debug for OnnxPolicy {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("OnnxPolicy").field("inputs", &self.inputs).field("outputs", &self.outputs).finish()
    }
}

impl OnnxPolicy {
    /// Reads a model.
    ///
    /// # Errors
    /// When the bytes are not an ONNX model, hold an operator that the interpreter lacks, or have inputs and outputs
    /// that are no policy's: none, other types than f32, or a state of which not every input has its output.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, OnnxError> {
        let loaded = ReadModel::from_bytes(bytes)?;
        let (inputs, outputs) = (loaded.inputs.clone(), loaded.outputs.clone());
        Self::of(Box::new(loaded), inputs, outputs)
    }

    /// A policy whose steps something else computes.
    ///
    /// # Errors
    /// When inputs and outputs are no policy's.
    pub fn of(model: Box<dyn Step>, inputs: Vec<TensorInfo>, outputs: Vec<TensorInfo>) -> Result<Self, OnnxError> {
        check_signature(&inputs, &outputs)?;
        let state = initial_state(&inputs)?;
        Ok(Self { model, inputs, outputs, state })
    }

    /// Inputs, the observation first.
    pub fn inputs(&self) -> &[TensorInfo] {
        &self.inputs
    }

    /// Outputs, the action first.
    pub fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    /// Sets the recurrent state to zero; without one, does nothing.
    pub fn reset(&mut self) {
        self.state.iter_mut().for_each(|state| state.fill(0.0));
    }

    /// One step: an observation to an action, which replaces what is in `out`.
    ///
    /// # Errors
    /// When the observation has another length than the model's input or is not finite, the interpreter fails, or what
    /// comes out is not f32 or not finite. The recurrent state is then what it was.
    pub fn run(&mut self, observation: &[f32], out: &mut Vec<f32>) -> Result<(), OnnxError> {
        observation_shape(&self.inputs[0], observation.len())?;
        check("observation", observation.len(), observation)?;
        let inputs: Vec<&[f32]> = [observation].into_iter().chain(self.state.iter().map(Vec::as_slice)).collect();
        let mut results = self.model.step(&inputs)?.into_iter();
        let action = results.next().ok_or_else(|| OnnxError::Run("no output".to_owned()))?;
        check(&format!("output `{}`", self.outputs[0].name), action.len(), &action)?;
        let state: Vec<Vec<f32>> = results.collect();
        if state.len() != self.state.len() {
            return Err(OnnxError::Run(format!("{} outputs of state, expected {}", state.len(), self.state.len())));
        }
        for (k, (next, now)) in state.iter().zip(&self.state).enumerate() {
            check(&format!("output `{}`", self.outputs[k + 1].name), now.len(), next)?;
        }
        self.state = state;
        *out = action;
        Ok(())
    }
}

/// The model of a policy in this process.
pub struct ReadModel {
    model: OnnxModel,
    inputs: Vec<TensorInfo>,
    outputs: Vec<TensorInfo>,
    input_ids: Vec<NodeId>,
    output_ids: Vec<NodeId>,
}

impl ReadModel {
    /// Reads a model.
    ///
    /// # Errors
    /// When the bytes are not an ONNX model, hold an operator that the interpreter lacks, or an input or output is not f32.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, OnnxError> {
        Self::with_files(bytes, &[])
    }

    /// The same with files beside the model: see [`OnnxModel::with_files`].
    ///
    /// # Errors
    /// As [`Self::from_bytes`], and when a file is not given.
    pub fn with_files(bytes: &[u8], files: &[(String, Vec<u8>)]) -> Result<Self, OnnxError> {
        let whole = OnnxModel::with_files(bytes, files)?;
        let model = &whole.model;
        let (input_ids, output_ids) = (model.input_ids().to_vec(), model.output_ids().to_vec());
        let infos = |ids: &[NodeId]| ids.iter().map(|&id| info(model, id)).collect::<Result<Vec<_>, _>>();
        let (inputs, outputs) = (infos(&input_ids)?, infos(&output_ids)?);
        Ok(Self { model: whole, inputs, outputs, input_ids, output_ids })
    }

    /// Its inputs.
    pub fn inputs(&self) -> &[TensorInfo] {
        &self.inputs
    }

    /// Its outputs.
    pub fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }
}

impl Step for ReadModel {
    fn step(&mut self, given: &[&[f32]]) -> Result<Vec<Vec<f32>>, OnnxError> {
        let mut inputs = Vec::with_capacity(given.len());
        for (k, (numbers, info)) in given.iter().zip(&self.inputs).enumerate() {
            let shape = match k {
                0 => observation_shape(info, numbers.len())?,
                _ => info.shape.iter().map(|size| size.unwrap_or(1)).collect(),
            };
            inputs.push((self.input_ids[k], view(shape, numbers)?.into()));
        }
        let wanted = given.len().min(self.output_ids.len());
        let results = self.model.run_ids(inputs, &self.output_ids[..wanted])?;
        results.into_iter().zip(&self.outputs).map(|(value, info)| numbers(value, &info.name)).collect()
    }
}

fn info(model: &Model, id: NodeId) -> Result<TensorInfo, OnnxError> {
    let node = model.node_info(id).ok_or_else(|| OnnxError::Load("an input or output without a node".to_owned()))?;
    let name = node.name().unwrap_or_default().to_owned();
    if node.dtype().is_some_and(|kind| kind != ValueType::Tensor(DataType::Float)) {
        let found = format!("`{name}` of type {:?}", node.dtype());
        return Err(OnnxError::Signature { expected: "inputs and outputs of type f32".to_owned(), found });
    }
    let size = |dimension: &Dimension| match dimension {
        Dimension::Fixed(size) => Some(*size),
        Dimension::Symbolic(_) => None,
    };
    Ok(TensorInfo { name, shape: node.shape().unwrap_or_default().iter().map(size).collect() })
}

fn check_signature(inputs: &[TensorInfo], outputs: &[TensorInfo]) -> Result<(), OnnxError> {
    if inputs.is_empty() || outputs.is_empty() {
        let found = format!("{} inputs and {} outputs", inputs.len(), outputs.len());
        return Err(OnnxError::Signature { expected: "an input and an output".to_owned(), found });
    }
    if inputs.len() > outputs.len() {
        let names = |infos: &[TensorInfo]| infos.iter().map(|i| i.name.clone()).collect::<Vec<_>>().join(", ");
        let found = format!("inputs {} and outputs {}", names(inputs), names(outputs));
        return Err(OnnxError::Signature { expected: "an output for every input".to_owned(), found });
    }
    Ok(())
}

fn initial_state(inputs: &[TensorInfo]) -> Result<Vec<Vec<f32>>, OnnxError> {
    let mut left = MOST_NUMBERS;
    let zeros = |info: &TensorInfo| match info.len().filter(|len| (1..=left).contains(len)) {
        Some(len) => {
            left -= len;
            Ok(vec![0.0; len])
        }
        None => Err(OnnxError::Signature {
            expected: format!("a state `{}` of 1 to {left} numbers", info.name),
            found: format!("shape {:?}", info.shape),
        }),
    };
    inputs[1..].iter().map(zeros).collect()
}

/// The input's shape with open sizes 1, but for the last, which takes the observation.
fn observation_shape(info: &TensorInfo, found: usize) -> Result<Vec<usize>, OnnxError> {
    let Some((&last, front)) = info.shape.split_last() else { return Ok(vec![1, found]) };
    let mut shape: Vec<usize> = front.iter().map(|size| size.unwrap_or(1)).collect();
    shape.push(last.unwrap_or(found));
    let expected = shape.iter().try_fold(1_usize, |product, &size| product.checked_mul(size));
    match expected == Some(found) {
        true => Ok(shape),
        false => Err(OnnxError::Length {
            what: format!("observation for input `{}`", info.name),
            expected: expected.unwrap_or(usize::MAX),
            found,
        }),
    }
}

fn view(shape: Vec<usize>, data: &[f32]) -> Result<ValueView<'_>, OnnxError> {
    ValueView::from_shape(shape, data).map_err(|error| OnnxError::Run(error.to_string()))
}
