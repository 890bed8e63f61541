//! ONNX files: policies [written](PolicyGraph) for others to run, and, with the feature `onnx`, others' policies read
//! and run ([`reader`]).

mod error;
mod graph;
mod policy_graph;
mod protobuf;
#[cfg(feature = "onnx")]
pub mod reader;
#[cfg(feature = "onnx")]
mod scan;

pub use error::OnnxError;
pub use graph::{GraphBuilder, Gru, Tensor};
pub use policy_graph::{Dense, PolicyGraph};
#[cfg(feature = "onnx")]
pub use reader::OnnxPolicy;
