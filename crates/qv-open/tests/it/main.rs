//! Every integration test of `qv-open`, as one program: a file is a subject, a folder serves several.

mod files;
mod ground;
mod parameters;
mod recordings;
