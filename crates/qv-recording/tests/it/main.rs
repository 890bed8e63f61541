//! Every integration test of `qv-recording`, as one program: a file is a subject, a folder serves several.

mod any_bytes;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod robots;
mod tables;
