//! Every integration test of `qv-splat`, as one program: a file is a subject, a folder serves several.

mod bad_files;
mod biker;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod made_up;
mod made_up_bytes;
mod of_others;
mod python;
mod round_trips;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
