//! Every integration test of `qv-policy`, as one program: a file is a subject, a folder serves several.

#[cfg(feature = "onnx")]
mod external_data;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod onnx;
#[cfg(feature = "onnx")]
mod policies_of_others;
mod robots;
mod roll;
mod short;
mod short_training;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod training;
mod walks_in_mujoco;
