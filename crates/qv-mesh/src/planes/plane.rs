//! A plane.

use glam::DVec3;

/// A plane of the world: `normal` · p = `offset`, in metres; the normal is a unit one and points to where cameras see it from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal.
    pub normal: DVec3,
    /// Distance of the origin from the plane, against the normal \[m\].
    pub offset: f64,
}
