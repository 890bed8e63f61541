//! The same motion in both engines.

use super::{RapierEngine, RapierOptions};
use crate::{BaseKind, Batch, JointCommand, Model, SimError, SimOptions, State, Terrain};
use std::fmt;

/// A commanded motion: target angles \[rad\] of all joints as a function of time \[s\], held with gains.
pub struct Motion<'a> {
    /// State at the start.
    pub start: &'a State,
    /// Length \[s\].
    pub duration: f64,
    /// Position gain of every joint \[N m/rad\].
    pub kp: f64,
    /// Velocity gain of every joint \[N m s/rad\].
    pub kd: f64,
    /// Target angles in joint order.
    pub target: &'a dyn Fn(f64) -> Vec<f64>,
    /// Parameters that differ from neutral, by name, in both engines.
    pub parameters: &'a [(&'a str, f64)],
}

/// How far the engines are from each other on one motion.
#[derive(Debug, Clone, PartialEq)]
pub struct EngineDifference {
    /// Final state in qv-sim.
    pub first: State,
    /// Final state in the second engine.
    pub second: State,
    /// Distance between the final base positions \[m\]; 0 with a fixed base.
    pub end_position: f64,
    /// Root mean square of the difference of joint positions over all joints and steps \[rad\].
    pub joint_rms: f64,
}

impl fmt::Display for EngineDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "end position differs by {:.2} mm, joints by {:.3} mrad rms",
            1e3 * self.end_position,
            1e3 * self.joint_rms
        )
    }
}

/// Runs one motion in qv-sim and in the second engine and measures the difference.
///
/// # Errors
/// When an option, the state, a parameter or a target means nothing, the second engine lacks a parameter, or an engine's numbers run away.
pub fn compare_engines(
    model: &Model,
    terrain: &Terrain,
    options: &SimOptions,
    motion: &Motion,
) -> Result<EngineDifference, SimError> {
    let mut first = Batch::<f64>::new(model, terrain, options, 1)?;
    first.set_state(0, motion.start)?;
    let settings = RapierOptions { timestep: options.timestep, gravity: options.gravity, ..Default::default() };
    let mut second = RapierEngine::new(model, terrain, &settings)?;
    second.set_state(motion.start)?;
    for (name, value) in motion.parameters {
        first.set_parameter(0, name, *value)?;
        second.set_parameter(name, *value)?;
    }
    let joints = model.joints.len();
    let (kp, kd, zero) = (vec![motion.kp; joints], vec![motion.kd; joints], vec![0.0; joints]);
    let steps = (motion.duration / options.timestep).round().max(0.0) as usize;
    let offset = model.nq() - joints;
    let mut squares = 0.0;
    for step in 0..steps {
        let q = (motion.target)(step as f64 * options.timestep);
        let command = JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero };
        first.set_command(0, &command)?;
        second.set_command(&command)?;
        first.step();
        second.step()?;
        let fault = |what: &str| SimError::Value {
            what: format!("state in {what}"),
            expected: "finite".into(),
            found: f64::NAN,
        };
        if first.is_faulty(0)? {
            return Err(fault("qv-sim"));
        }
        if second.is_faulty() {
            return Err(fault("the second engine"));
        }
        let (a, b) = (first.state(0)?, second.state());
        squares += a.q[offset..].iter().zip(&b.q[offset..]).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    }
    let (first, second) = (first.state(0)?, second.state());
    let end_position = match model.base {
        BaseKind::Floating => (0..3).map(|k| (first.q[k] - second.q[k]).powi(2)).sum::<f64>().sqrt(),
        BaseKind::Fixed => 0.0,
    };
    let joint_rms = (squares / (steps * joints).max(1) as f64).sqrt();
    Ok(EngineDifference { first, second, end_position, joint_rms })
}
