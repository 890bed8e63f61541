//! Every integration test of `qv-residual`, as one program: a file is a subject, a folder serves several.

mod closing;
mod exported;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod squats;
mod values;
