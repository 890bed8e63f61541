//! Every integration test of `qv-raster`, as one program: a file is a subject, a folder serves several.

mod dense;
mod edges;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
#[cfg(feature = "gpu")]
mod gpu;
mod groups;
mod gsplat;
mod reference;
mod shaders;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
mod workload;
