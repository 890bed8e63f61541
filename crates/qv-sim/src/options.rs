//! Settings of a simulation that all its environments share.

use crate::SimError;

/// Where a contact solve starts. It changes the work, and the result by what the solve leaves undone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WarmStart {
    /// The acceleration of the last step.
    Last,
    /// That, or the acceleration without constraints, whichever costs less, as MuJoCo does.
    Cheaper,
}

/// Where a line search of the contact solver looks when a Newton step would leave the bracket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineSearch {
    /// In the bracket's middle.
    Halving,
    /// Where the sliding of a contact turns round, if that lies in the bracket: friction changes sign there within a short
    /// step, which halving finds late. The solution is the same, found in fewer steps.
    Apex,
}

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
    /// Where a line search looks.
    pub line_search: LineSearch,
    /// Most steps of a line search (MuJoCo's ls_iterations). Lanes of a register wait for the slowest.
    pub line_search_iterations: usize,
    /// Where a contact solve starts.
    pub warm_start: WarmStart,
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
            line_search: LineSearch::Halving,
            line_search_iterations: 12,
            warm_start: WarmStart::Last,
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
        let steps = self.line_search_iterations;
        value("line_search_iterations", "1 to 100", steps as f64, (1..=100).contains(&steps))?;
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
