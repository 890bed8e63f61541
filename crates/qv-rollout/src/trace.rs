//! What joints and base did over time.

/// Joint and base quantities over time. Empty arrays = not there; NaN = not there then.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace {
    /// Times \[s\], shape `[T]`.
    pub time: Vec<f64>,
    /// Positions \[rad\], shape `[T, n]`.
    pub position: Vec<f64>,
    /// Velocities \[rad/s\], shape `[T, n]`.
    pub velocity: Vec<f64>,
    /// Torques \[N m\], shape `[T, n]`.
    pub torque: Vec<f64>,
    /// Forces on the feet \[N\], shape `[T, feet]`.
    pub foot_force: Vec<f64>,
    /// `world_from_base` as x, y, z \[m\], w, x, y, z, shape `[T]`.
    pub base: Vec<[f64; 7]>,
    /// Number of joints `n`.
    pub joints: usize,
}
