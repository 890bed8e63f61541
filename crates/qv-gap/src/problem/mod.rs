//! What is being diagnosed: a robot on its ground, and the effects that may act on it, with all that is looked up once.

pub mod columns;
pub(crate) mod data_quality;
pub mod excitation;
pub mod library;
pub(crate) mod one_robot;
pub(crate) mod origin;
pub(crate) mod sizes;
pub(crate) mod torques;

use crate::GapError;
use qv_core::JointSeries;
use qv_recording::Run;
use qv_rollout::{Rollout, WindowOptions};
use qv_sim::{Model, Terrain};

/// Looks at what `run` has; `given` are parameters that are known already.
///
/// # Errors
/// When the run is not one of this model, a parameter is unknown, or the run has nothing that can be compared.
pub fn rollout_of<'a>(
    run: &Run,
    model: &'a Model,
    terrain: &Terrain,
    given: &[(String, f64)],
    cut: WindowOptions,
) -> Result<Rollout<'a>, GapError> {
    let rollout = Rollout::new(run, model, terrain, given, cut)?;
    if rollout.channels.is_empty() {
        return Err(GapError::run("channels", "at least one that is measured and alive", "none"));
    }
    if rollout.on_legs {
        check_legs(run, &rollout)?;
    }
    Ok(rollout)
}

/// Whether legs and ground can make up for the poses that a free base lacks.
///
/// # Errors
/// When they cannot.
fn check_legs(run: &Run, Rollout { feet, terrain, .. }: &Rollout) -> Result<(), GapError> {
    let without = |expected: &str| {
        let found = "none (`base = \"fixed\"` in run.toml is for a robot that is held)";
        Err(GapError::run("poses of the free base", expected, found))
    };
    if feet.geoms.is_empty() {
        return without("poses, or feet to follow: spheres on links that begin with a name of a foot");
    }
    if run.measured.orientation.as_ref().is_none_or(JointSeries::is_empty) {
        return without("poses, or the IMU's orientation for leg odometry");
    }
    if !terrain.is_plane() {
        return without("poses, which locate the robot on a terrain that is not a plane");
    }
    Ok(())
}
