//! Every integration test of `qv-mesh`, as one program: a file is a subject, a folder serves several.

mod python;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod yard;
