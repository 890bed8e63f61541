//! The error of this crate.

/// What can be wrong with a model, a terrain or a request.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimError {
    /// The text is not a URDF.
    #[error("URDF: expected a <robot> element with links and joints, found: {0}")]
    UrdfSyntax(String),
    /// One link of the URDF cannot be simulated.
    #[error("URDF link `{link}`: expected {expected}, found {found}")]
    Link {
        /// Name of the link.
        link: String,
        /// What the simulator needs.
        expected: String,
        /// What the file says.
        found: String,
    },
    /// One joint of the URDF cannot be simulated.
    #[error("URDF joint `{joint}`: expected {expected}, found {found}")]
    Joint {
        /// Name of the joint.
        joint: String,
        /// What the simulator needs.
        expected: String,
        /// What the file says.
        found: String,
    },
    /// An element of an MJCF that means nothing here.
    #[error("MJCF {element}: expected {expected}, found {found}")]
    Mjcf {
        /// The element: its tag, its name where it has one; the body or joint that it makes.
        element: String,
        /// What the simulator needs.
        expected: String,
        /// What the file says, with the line, and the file where that is an included one.
        found: String,
    },
    /// A terrain that cannot be stood on.
    #[error("terrain: expected {expected}, found {found}")]
    Terrain {
        /// What the simulator needs.
        expected: String,
        /// What was given.
        found: String,
    },
    /// An array of the wrong length.
    #[error("{what}: expected length {expected}, found {found}")]
    Length {
        /// The array that is off.
        what: &'static str,
        /// Length that was expected.
        expected: usize,
        /// Length that was found.
        found: usize,
    },
    /// A number that is out of range or not finite.
    #[error("{what}: expected {expected}, found {found}")]
    Value {
        /// The quantity.
        what: String,
        /// The values that are allowed.
        expected: String,
        /// The value that was given.
        found: f64,
    },
    /// A parameter name that the model does not have.
    #[error("unknown parameter \"{name}\"; nearest: {nearest}")]
    UnknownParameter {
        /// The name that was asked for.
        name: String,
        /// The closest existing name.
        nearest: String,
    },
    /// A parameter that this engine has no counterpart of.
    #[error("parameter `{name}`: expected one that the second engine has, found one of qv-sim alone: {reason}")]
    NotInSecondEngine {
        /// The name that was asked for.
        name: String,
        /// What the second engine lacks.
        reason: &'static str,
    },
    /// An environment index beyond the batch.
    #[error("environment {index}: expected an index below {count}")]
    Environment {
        /// The index that was asked for.
        index: usize,
        /// Number of environments in the batch.
        count: usize,
    },
    /// A snapshot of another batch.
    #[error("snapshot: expected one of this batch (same model, count, precision), found another")]
    Snapshot,
}

/// Complains of an array of another length.
pub(crate) fn length(what: &'static str, expected: usize, found: usize) -> Result<(), SimError> {
    if expected == found { Ok(()) } else { Err(SimError::Length { what, expected, found }) }
}

/// Complains of the first number that is none.
pub(crate) fn finite(what: &str, values: &[f64]) -> Result<(), SimError> {
    // Any number times zero is zero, but for NaN and infinities; a sum is checked faster than each.
    if values.iter().fold(0.0, |sum, v| sum + v * 0.0) == 0.0 {
        return Ok(());
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => {
            Err(SimError::Value { what: format!("{what} {i}"), expected: "a finite number".into(), found: values[i] })
        }
        None => Ok(()),
    }
}
