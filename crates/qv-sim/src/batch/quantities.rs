//! What is read of environments.

/// What [`Batch`] hands out of all environments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quantity {
    Positions,
    Velocities,
    Accelerations,
    Torques,
    GeomForces,
    JointPositions,
    JointSpeeds,
}

/// Where the centres of shapes are, and how fast they move, `[environments][geoms][3]` each.
pub(crate) struct GeomMotion<'a> {
    pub positions: &'a mut [f32],
    pub velocities: &'a mut [f32],
}

/// A point at which the robot touched the ground, or itself, in the last step.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactPoint {
    /// Index of the shape in [`crate::Model::geoms`].
    pub geom: usize,
    /// Index of its link.
    pub link: usize,
    /// The other link, where the robot touched itself.
    pub other: Option<usize>,
    /// In the world \[m\].
    pub point: [f64; 3],
    /// Unit normal in the world, from the ground (or the other link) to the shape.
    pub normal: [f64; 3],
    /// Force on the shape in the world \[N\].
    pub force: [f64; 3],
    /// Distance \[m\]; negative is penetration.
    pub distance: f64,
}

/// How the base moves: positions, velocities and accelerations of its seven and six coordinates.
pub(crate) struct BaseMotion {
    pub q: [f64; 7],
    pub v: [f64; 6],
    pub a: [f64; 6],
}

impl BaseMotion {
    pub fn of(q: &[f64], v: &[f64], a: &[f64]) -> Self {
        let mut out = Self { q: [0.0; 7], v: [0.0; 6], a: [0.0; 6] };
        out.q.copy_from_slice(&q[..7]);
        out.v.copy_from_slice(&v[..6]);
        out.a.copy_from_slice(&a[..6]);
        out
    }
}
