//! ONNX files: policies [written](PolicyGraph) for others to run, and, with the feature `onnx`, others' policies read
//! and run ([`reader`]), and any model with names for what goes in and out ([`OnnxModel`]).

mod error;
mod graph;
#[cfg(feature = "onnx")]
mod model;
mod policy_graph;
mod protobuf;
#[cfg(feature = "onnx")]
pub mod reader;
#[cfg(feature = "onnx")]
mod scan;

pub use error::OnnxError;
pub use graph::{GraphBuilder, Gru, Tensor};
#[cfg(feature = "onnx")]
pub use model::{Numbers, OnnxModel};
pub use policy_graph::{Dense, PolicyGraph};
#[cfg(feature = "onnx")]
pub use reader::OnnxPolicy;
#[cfg(feature = "onnx")]
pub use scan::external_files;
