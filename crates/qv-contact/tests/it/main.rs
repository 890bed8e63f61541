//! Every integration test of `qv-contact`, as one program: a file is a subject, a folder serves several.

mod recording;
mod replayed;
mod statistics;
mod strips;
