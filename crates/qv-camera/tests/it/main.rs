//! Every integration test of `qv-camera`, as one program: a file is a subject, a folder serves several.

mod footage;
mod visual;
