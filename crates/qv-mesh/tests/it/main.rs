//! Every integration test of `qv-mesh`, as one program: a file is a subject, a folder serves several.

#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod python;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod yard;
