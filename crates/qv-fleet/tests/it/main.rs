//! Every integration test of `qv-fleet`, as one program: a file is a subject, a folder serves several.

#[path = "../../../../fixtures/browser/mod.rs"]
mod browser;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod summary;
