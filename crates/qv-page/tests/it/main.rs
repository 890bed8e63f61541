//! Every integration test of `qv-page`, as one program: a file is a subject, a folder serves several.

#[path = "../../../../fixtures/browser/mod.rs"]
mod browser;
mod browser_page;
mod size;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
