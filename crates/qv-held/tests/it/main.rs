//! Every integration test of `qv-held`, as one program: a file is a subject.

#[path = "../../examples/weigh.rs"]
#[allow(dead_code)]
mod weigh;

mod verdicts;
