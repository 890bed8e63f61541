//! An ONNX model whose inputs and outputs have names, run on the CPU.

use super::OnnxError;
use super::graph::check;
use super::scan::scan;
use rten::{Dimension, Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueOrView, ValueView};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// Numbers that go into a model, row-major.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Numbers<'a> {
    /// f32.
    Floats(&'a [f32]),
    /// u8, such as pixels.
    Bytes(&'a [u8]),
}

/// A model that keeps nothing from one run to the next.
pub struct OnnxModel {
    pub(super) model: Model,
    threads: Arc<ThreadPool>,
}

impl OnnxModel {
    /// Reads a model.
    ///
    /// # Errors
    /// When the bytes are not an ONNX model, or hold an operator that the interpreter lacks.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, OnnxError> {
        Self::with_files(bytes, &[])
    }

    /// The same of a model whose weights lie in files beside it: names as the model has them ([`super::external_files`]), and contents.
    ///
    /// # Errors
    /// As [`Self::from_bytes`], and when a file is not given.
    pub fn with_files(bytes: &[u8], files: &[(String, Vec<u8>)]) -> Result<Self, OnnxError> {
        if bytes.is_empty() {
            return Err(OnnxError::Load("no bytes".to_owned()));
        }
        scan(bytes)?;
        // The interpreter means not to panic on damaged files; this makes it sure.
        let model = catch_unwind(|| {
            let mut options = ModelOptions::with_all_ops();
            for (name, contents) in files {
                options.external_data(name, contents.clone());
            }
            options.load(bytes.to_vec())
        })
        .map_err(|_| OnnxError::Load("damage that made the interpreter panic".to_owned()))?
        .map_err(|error| OnnxError::Load(error.to_string()))?;
        // One thread: the matrices are small, and what a model says must not depend on the machine.
        Ok(Self { model, threads: Arc::new(ThreadPool::with_num_threads(1)) })
    }

    /// What the file says under a key of its own.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.model.metadata().get(key)
    }

    /// One run: the numbers of each output that is named, row-major, all finite. Sizes that the file leaves open are 1.
    ///
    /// # Errors
    /// When a name is not in the model, an input is missing, has another length or is not finite, the interpreter fails, or an output is not f32
    /// or not finite.
    pub fn run(&self, inputs: &[(&str, Numbers)], outputs: &[&str]) -> Result<Vec<Vec<f32>>, OnnxError> {
        let given = inputs.iter().map(|(name, numbers)| self.input(name, *numbers)).collect::<Result<_, _>>()?;
        let wanted = outputs.iter().map(|name| self.id(name, false)).collect::<Result<Vec<_>, _>>()?;
        let values = self.run_ids(given, &wanted)?;
        values.into_iter().zip(outputs).map(|(value, name)| numbers(value, name)).collect()
    }

    pub(super) fn run_ids(
        &self,
        inputs: Vec<(NodeId, ValueOrView<'_>)>,
        outputs: &[NodeId],
    ) -> Result<Vec<Value>, OnnxError> {
        let options = RunOptions::default().with_thread_pool(Some(self.threads.clone()));
        catch_unwind(AssertUnwindSafe(|| self.model.run(inputs, outputs, Some(options))))
            .map_err(|_| OnnxError::Run("the interpreter panicked".to_owned()))?
            .map_err(|error| OnnxError::Run(error.to_string()))
    }

    fn input<'a>(&self, name: &str, numbers: Numbers<'a>) -> Result<(NodeId, ValueOrView<'a>), OnnxError> {
        let id = self.id(name, true)?;
        let sizes = self.model.node_info(id).and_then(|node| node.shape()).unwrap_or_default();
        let size = |dimension: &Dimension| match dimension {
            Dimension::Fixed(size) => *size,
            Dimension::Symbolic(_) => 1,
        };
        let shape: Vec<usize> = sizes.iter().map(size).collect();
        let expected = shape.iter().try_fold(1_usize, |product, &size| product.checked_mul(size)).unwrap_or(usize::MAX);
        let what = format!("input `{name}`");
        match numbers {
            Numbers::Floats(floats) => check(&what, expected, floats)?,
            Numbers::Bytes(bytes) if bytes.len() == expected => {}
            Numbers::Bytes(bytes) => return Err(OnnxError::Length { what, expected, found: bytes.len() }),
        }
        let view = match numbers {
            Numbers::Floats(floats) => ValueView::from_shape(shape, floats).map_err(|error| error.to_string()),
            Numbers::Bytes(bytes) => ValueView::from_shape(shape, bytes).map_err(|error| error.to_string()),
        };
        Ok((id, view.map_err(OnnxError::Run)?.into()))
    }

    /// The input or output of a name.
    fn id(&self, name: &str, is_input: bool) -> Result<NodeId, OnnxError> {
        let (ids, what) = match is_input {
            true => (self.model.input_ids(), "input"),
            false => (self.model.output_ids(), "output"),
        };
        let name_of = |id: NodeId| self.model.node_info(id).and_then(|node| node.name()).unwrap_or_default();
        ids.iter().copied().find(|&id| name_of(id) == name).ok_or_else(|| OnnxError::Signature {
            expected: format!("an {what} `{name}`"),
            found: ids.iter().map(|&id| name_of(id)).collect::<Vec<_>>().join(", "),
        })
    }
}

/// The numbers of an output, row-major, all finite.
pub(super) fn numbers(value: Value, name: &str) -> Result<Vec<f32>, OnnxError> {
    let (kind, what) = (value.dtype(), format!("output `{name}`"));
    let Some(tensor) = value.into_tensor::<f32>() else {
        return Err(OnnxError::Signature { expected: format!("{what} of type f32"), found: format!("{kind:?}") });
    };
    let data = tensor.into_data();
    check(&what, data.len(), &data)?;
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::onnx::GraphBuilder;

    /// Bytes as floats, and twice them.
    fn model() -> OnnxModel {
        let mut graph = GraphBuilder::new();
        let (bytes, floats) = (graph.input_bytes("bytes", &[1, 2]).unwrap(), graph.input("floats", 2).unwrap());
        let plain = graph.to_float(&bytes);
        let plain = graph.flatten(&plain);
        let sum = graph.add(&plain, &floats);
        graph.output(&plain, "plain", 2).unwrap();
        graph.output(&sum, "sum", 2).unwrap();
        graph.metadata("answer", "42");
        OnnxModel::from_bytes(&graph.finish()).unwrap()
    }

    #[test]
    fn names_choose_inputs_and_outputs() {
        let model = model();
        let inputs = [("floats", Numbers::Floats(&[0.5, -1.0])), ("bytes", Numbers::Bytes(&[3, 255]))];
        assert_eq!(model.run(&inputs, &["sum", "plain"]).unwrap(), [[3.5, 254.0], [3.0, 255.0]]);
        assert_eq!((model.metadata("answer"), model.metadata("question")), (Some("42"), None));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let model = model();
        let said = |inputs: &[(&str, Numbers)], output| model.run(inputs, &[output]).unwrap_err().to_string();
        let (bytes, floats) = (("bytes", Numbers::Bytes(&[1, 2])), ("floats", Numbers::Floats(&[0.0; 2])));
        let short = said(&[("bytes", Numbers::Bytes(&[1])), floats], "sum");
        assert!(short.states("`bytes` 2 1"), "{short}");
        let bad = said(&[bytes, ("floats", Numbers::Floats(&[0.0, f32::NAN]))], "sum");
        assert!(bad.states("`floats`"), "{bad}");
        assert!(said(&[bytes, floats], "mean").states("`mean`"));
        assert!(said(&[bytes, ("gloats", Numbers::Floats(&[0.0; 2]))], "sum").states("`gloats`"));
        assert!(said(&[bytes], "sum").states("ONNX"), "an input is missing");
        assert!(said(&[floats, ("bytes", Numbers::Floats(&[0.0; 2]))], "sum").states("ONNX"));
        assert!(OnnxModel::from_bytes(b"no model").is_err());
    }
}
