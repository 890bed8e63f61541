//! Every integration test of `qv-go2`, as one program: a file is a subject, a folder serves several.

mod inertia;
mod meshed_ground;
mod mujoco;
#[cfg(feature = "rapier")]
mod second_engine;
mod shapes;
