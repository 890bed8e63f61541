//! What can be wrong with a description, or go wrong in a roll.

use qv_sim::SimError;

/// The error of descriptions and rolls.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RollError {
    /// Not TOML, or an unknown or missing key.
    #[error("description: {0}")]
    Toml(String),
    /// A key with a value that means nothing.
    #[error("description, `{key}`: expected {expected}, found {found}")]
    Value {
        /// The key.
        key: String,
        /// What is allowed.
        expected: String,
        /// What the file says.
        found: String,
    },
    /// A joint that the robot does not have.
    #[error("description, `joints`: expected joints of the robot `{robot}`, found `{joint}`; it has {known}")]
    Joint {
        /// Name of the model.
        robot: String,
        /// The joint that was asked for.
        joint: String,
        /// The joints that it has.
        known: String,
    },
    /// The policy failed.
    #[error("policy, at {time:.3} s: {reason}")]
    Policy {
        /// Time since the start \[s\].
        time: f64,
        /// What it said.
        reason: String,
    },
    /// An action of the wrong length, or with a number that is not finite.
    #[error("action at {time:.3} s: expected {expected} finite numbers, found {found}")]
    Action {
        /// Time since the start \[s\].
        time: f64,
        /// Joints of the description.
        expected: usize,
        /// What the policy gave.
        found: String,
    },
    /// The simulation's numbers ran away.
    #[error("simulation at {time:.3} s: expected finite numbers, found some that ran away")]
    RanAway {
        /// Time since the start \[s\].
        time: f64,
    },
    /// The simulator refused something.
    #[error(transparent)]
    Sim(#[from] SimError),
}
