//! Every integration test of `qv-camera`, as one program: a file is a subject, a folder serves several.

#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod footage;
mod visual;
