//! Every integration test of `qv-fit`, as one program: a file is a subject.

mod closed_forms;
mod descents;
mod intervals;
mod problems;
