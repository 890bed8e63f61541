//! Every integration test of `qv`, as one program: a file is a subject, a folder serves several.

mod bad_input;
mod bag_kinds;
mod bags;
mod big_bag;
#[path = "../../../../fixtures/browser/mod.rs"]
mod browser;
mod captures;
mod check;
mod contact;
mod drift;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod fleet;
#[path = "../../../qv-camera/tests/it/footage/mod.rs"]
mod footage;
mod foreign;
mod hostile;
mod mesh;
mod messages;
mod mistakes;
mod names;
mod navigate;
mod outputs;
mod pipeline;
mod reconstruct;
mod render;
mod replay;
mod reproduce;
mod robots;
mod safety;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod tables;
mod view;
mod visual;
