//! Every integration test of `qv-baselines`, as one program: a file is a subject, a folder serves several.

mod baselines;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
#[path = "../../../qv-gap/tests/it/recorded/mod.rs"]
mod recorded;
