//! Every integration test of `qv-gap`, as one program: a file is a subject, a folder serves several.

mod actuator_law;
mod arm;
#[path = "../../../../fixtures/browser/mod.rs"]
mod browser;
mod conventions;
mod evidence;
mod exports;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod ground;
mod made_up;
mod output;
mod python;
mod recorded;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod two_links;
mod urdf_witness;
mod walking;
