//! Every integration test of `qv-sealed`, as one program: a file is a subject, a folder serves several.

mod mistakes;
mod sealed;
