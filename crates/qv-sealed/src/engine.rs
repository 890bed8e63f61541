//! What moves the robot of a recording.

use qv_core::random::SplitMix64;

/// The engine that a recording is made with, and its numerics.
#[derive(Debug, Clone, PartialEq)]
pub enum Engine {
    /// qv-sim with other numerics than its defaults.
    Ours {
        /// Step \[s\].
        timestep: f64,
        /// Ratio of frictional to normal impedance.
        impratio: f64,
        /// Rows of a contact: 3 or 4.
        contact_dimension: usize,
        /// Time constant of the contact \[s\], unless an effect sets it.
        time_constant: f64,
    },
    /// The second engine (feature `rapier`).
    Second {
        /// Step \[s\].
        timestep: f64,
        /// Substeps of the dynamics in a step.
        substeps: usize,
    },
}

impl Engine {
    /// Name in answers.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Ours { .. } => "ours",
            Self::Second { .. } => "second",
        }
    }

    /// Step \[s\].
    pub fn timestep(&self) -> f64 {
        match self {
            Self::Ours { timestep, .. } | Self::Second { timestep, .. } => *timestep,
        }
    }

    /// qv-sim with numerics drawn from the seed.
    pub fn ours(draws: &mut SplitMix64) -> Self {
        Self::Ours {
            timestep: if draws.chance(0.5) { 0.0005 } else { 0.002 },
            impratio: draws.between(1.0, 10.0),
            contact_dimension: 3 + draws.index(2),
            time_constant: draws.between(0.004, 0.016),
        }
    }

    /// The same with steps of at most 1 ms.
    pub(crate) fn with_short_steps(self) -> Self {
        match self {
            Self::Ours { timestep, impratio, contact_dimension, time_constant } => {
                Self::Ours { timestep: timestep.min(0.001), impratio, contact_dimension, time_constant }
            }
            second @ Self::Second { .. } => second,
        }
    }

    /// The second engine with numerics drawn from the seed.
    pub fn second(draws: &mut SplitMix64) -> Self {
        Self::Second { timestep: if draws.chance(0.5) { 0.0005 } else { 0.001 }, substeps: 2 + draws.index(3) }
    }
}
