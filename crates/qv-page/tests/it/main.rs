//! Every integration test of `qv-page`, as one program: a file is a subject, a folder serves several.

mod size;
