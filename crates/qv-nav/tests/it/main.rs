//! Every integration test of `qv-nav`, as one program: a file is a subject, a folder serves several.

#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod learns;
#[cfg(feature = "onnx")]
mod navigator_python;
mod onnx;
mod recall_python;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod student;
mod yard;
