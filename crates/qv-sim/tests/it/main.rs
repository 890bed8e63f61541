//! Every integration test of `qv-sim`, as one program: a file is a subject, a folder serves several.

mod against_mujoco;
mod batch;
mod bulk;
mod contact;
mod cube_tosses;
#[path = "../../../../fixtures/facts.rs"]
mod facts;
mod foreign_urdfs;
mod mjcf;
mod motors;
mod parameters;
mod real_machines;
mod robots;
mod servo_friction;
#[path = "../../../../fixtures/skipped.rs"]
mod skipped;
#[allow(dead_code)]
#[path = "../../examples/cube_tosses/tosses.rs"]
mod tosses;
mod urdf;
