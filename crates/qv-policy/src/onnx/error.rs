//! What can be wrong with an ONNX file, or with numbers that should become one.

/// The error of writing and of running ONNX files.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OnnxError {
    /// An array of the wrong length.
    #[error("{what}: expected {expected} numbers, found {found}")]
    Length {
        /// The array that is off.
        what: String,
        /// Length that was expected.
        expected: usize,
        /// Length that was found.
        found: usize,
    },
    /// A number that is NaN or infinite.
    #[error("{what}: expected finite numbers, found {found} at index {index}")]
    NotFinite {
        /// The array that holds it.
        what: String,
        /// Where in the array.
        index: usize,
        /// The number.
        found: f32,
    },
    /// A lower bound above its upper one.
    #[error("bounds of output {index}: expected lower <= upper, found {lower} > {upper}")]
    Bounds {
        /// Which output.
        index: usize,
        /// The lower bound.
        lower: f32,
        /// The upper bound.
        upper: f32,
    },
    /// A policy without layers, or a dimension of zero.
    #[error("{what}: expected at least 1, found 0")]
    Empty {
        /// What there is none of.
        what: &'static str,
    },
    /// Two tensors of one name, or a name that is empty.
    #[error("tensor name `{0}`: expected names that are not empty and each given once")]
    Name(String),
    /// Not a file of ONNX, or one that the interpreter cannot run.
    #[error("ONNX file: expected a model that can be run, found: {0}")]
    Load(String),
    /// A model whose inputs or outputs are not those of a policy.
    #[error("ONNX model: expected {expected}, found {found}")]
    Signature {
        /// What a policy has.
        expected: String,
        /// What the file says.
        found: String,
    },
    /// The interpreter failed while it ran.
    #[error("running the ONNX model: {0}")]
    Run(String),
}
