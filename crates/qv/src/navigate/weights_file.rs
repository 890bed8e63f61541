//! Weights of a network in a file.

use crate::Failure;
use crate::outcome::about;
use qv_nav::goals::GoalSet;
use qv_nav::net::Net;
use qv_nav::teacher::World;
use qv_nav::weights::{self, GoalInput};
use sha2::{Digest, Sha256};
use std::fs;
use std::path::Path;

/// What weights are distinguished by: the beginning of their SHA-256.
pub(super) fn fingerprint(parameters: &[f32]) -> String {
    let hash = Sha256::digest(weights::to_bytes(parameters));
    hash.iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}

/// The weights of a file, for the network, and how it is commanded.
pub(super) fn network_at(path: &Path, net: &Net) -> Result<(Vec<f32>, GoalInput), Failure> {
    let bytes = fs::read(path).map_err(|e| about(path, e))?;
    weights::read(&bytes, net).map_err(|e| about(path, e))
}

/// A place for a network that is commanded in some way: cones of three colours, by their names or by their colours.
pub(super) fn commanded(world: World, input: GoalInput) -> World {
    match input {
        GoalInput::Name => world,
        GoalInput::Colour => world.among_many(GoalSet::coloured()),
    }
}
