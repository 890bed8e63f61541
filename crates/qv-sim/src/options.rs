//! Settings of a simulation that all its environments share.

use crate::SimError;

/// How time, contact and memory are handled.
#[derive(Debug, Clone, PartialEq)]
pub struct SimOptions {
    /// Time step \[s\].
    pub timestep: f64,
    /// Gravity in the world \[m/s²\].
    pub gravity: [f64; 3],
    /// Ratio of frictional to normal constraint impedance (MuJoCo's impratio): larger slips less.
    pub impratio: f64,
    /// Rows of a contact: 3 slides, 4 also resists torsion, 6 also rolling.
    pub contact_dimension: usize,
    /// Whether a foot that crosses an edge inside the ground's surface feels it, as in MuJoCo's height fields. Real
    /// ground has no such edges: off, only true ridges are felt.
    pub inner_edges: bool,
    /// Whether shapes of the robot collide with each other (not those of one link or of parent and child).
    pub self_collision: bool,
    /// Whether the controller's velocity gain is integrated implicitly, as MuJoCo's implicitfast does with an affine
    /// actuator; else it acts with the speed at the start of the step.
    pub implicit_actuator_damping: bool,
    /// Most Newton iterations of the contact solver.
    pub iterations: usize,
    /// Ends a solve when the gradient is this small beside the forces; `None` picks it by precision.
    pub tolerance: Option<f64>,
    /// Longest `command_latency` that can be set \[s\]; commands of that long are kept.
    pub max_command_latency: f64,
    /// Longest `encoder_latency` and `pose.delay` that can be read \[s\]; states of that long are kept.
    pub max_sensor_latency: f64,
    /// Whether the contacts of the last step are kept for [`crate::Batch::contacts`].
    pub keep_contacts: bool,
    /// Widest register to use, in lanes (1, 4, 8 or 16); `None` picks it by processor and batch. The bits are the same.
    pub lanes: Option<usize>,
}

impl Default for SimOptions {
    fn default() -> Self {
        Self {
            timestep: 0.001,
            gravity: [0.0, 0.0, -qv_core::GRAVITY],
            impratio: 10.0,
            contact_dimension: 3,
            inner_edges: false,
            self_collision: false,
            implicit_actuator_damping: true,
            iterations: 30,
            tolerance: None,
            max_command_latency: 0.0,
            max_sensor_latency: 0.0,
            keep_contacts: false,
            lanes: None,
        }
    }
}

impl SimOptions {
    /// # Errors
    /// Names the first setting that means nothing.
    pub(crate) fn check(&self) -> Result<(), SimError> {
        let value = |what: &str, expected: &str, found: f64, good: bool| {
            if good { Ok(()) } else { Err(SimError::Value { what: what.into(), expected: expected.into(), found }) }
        };
        let within = |x: f64, low: f64, high: f64| x >= low && x <= high;
        value("timestep", "1e-6 to 0.1 s", self.timestep, within(self.timestep, 1e-6, 0.1))?;
        for g in self.gravity {
            value("gravity", "finite m/s²", g, g.is_finite())?;
        }
        value("impratio", "0.01 to 10000", self.impratio, within(self.impratio, 0.01, 1e4))?;
        let dimension = self.contact_dimension;
        value("contact_dimension", "3, 4 or 6", dimension as f64, matches!(dimension, 3 | 4 | 6))?;
        value("iterations", "1 to 1000", self.iterations as f64, (1..=1000).contains(&self.iterations))?;
        let tolerance = self.tolerance.unwrap_or(1e-8);
        value("tolerance", "1e-15 to 0.1", tolerance, within(tolerance, 1e-15, 0.1))?;
        for latency in [self.max_command_latency, self.max_sensor_latency] {
            value("latency", "0 to 1 s", latency, within(latency, 0.0, 1.0))?;
        }
        Ok(())
    }

    /// Slots of a ring that looks back `latency`; 1 keeps only the present.
    pub(crate) fn ring(&self, latency: f64) -> usize {
        if latency <= 0.0 { 1 } else { (latency / self.timestep).ceil() as usize + 2 }
    }
}
