//! What is hidden in a robot: parameters that the simulator knows, and effects that it lacks.

use qv_core::random::Xoshiro256PlusPlus;
use qv_policy::velocity::TaskRobot;
use qv_sim::{SensorReading, State};

/// An effect that no parameter of the simulator describes, on all joints. Torques in N m, angles in rad.
#[derive(Debug, Clone, PartialEq)]
pub enum Outside {
    /// Friction that falls with speed: torque at rest and the speed at which it has fallen to 1/e.
    Stribeck(f64, f64),
    /// Friction as a share of the motor's torque.
    Load(f64),
    /// Strength falls by this share as the motor heats up, with this time constant \[s\].
    Thermal(f64, f64),
    /// The motor sees its own side of a spring of this stiffness \[N m/rad\] (without inertia of its own).
    Elastic(f64),
    /// Torque that goes round with the joint: its size, and periods per radian.
    Ripple(f64, f64),
}

/// A robot with hidden effects.
#[derive(Debug, Clone, PartialEq)]
pub struct HiddenRobot {
    /// What it is called in tables.
    pub name: String,
    /// Parameters of the simulator.
    pub parameters: Vec<(String, f64)>,
    /// Effects beside them.
    pub outside: Vec<Outside>,
    /// Engine.
    pub engine: Engine,
}

impl HiddenRobot {
    /// A robot in which nothing is wrong.
    pub fn nothing(engine: Engine) -> Self {
        Self { name: "nothing".into(), parameters: Vec::new(), outside: Vec::new(), engine }
    }

    /// A robot whose actuators have effects of the catalogue: latency, lag, friction and strength always; for every other seed also
    /// encoder biases, play and joints that differ.
    pub fn inside(robot: &TaskRobot, engine: Engine, seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::of(seed, 53, 0);
        let mut between = |low: f64, high: f64| low + (high - low) * f64::from(random.unit());
        let scale = f64::from(robot.torque_scale());
        let is_mixed = seed % 2 == 1;
        let shared = [
            between(0.008, 0.018),
            between(0.004, 0.012),
            between(0.02, 0.06),
            between(0.005, 0.015),
            between(0.75, 0.9),
        ];
        let mut parameters = Vec::new();
        let play = between(0.005, 0.02);
        for name in robot.model.joint_names() {
            let own = if is_mixed { between(0.5, 1.5) } else { 1.0 };
            let strength = if is_mixed { between(0.75, 1.0) } else { shared[4] };
            parameters.push((format!("actuator.{name}.command_latency"), shared[0]));
            parameters.push((format!("actuator.{name}.lag"), shared[1]));
            parameters.push((format!("joint.{name}.coulomb_friction"), shared[2] * scale * own));
            parameters.push((format!("joint.{name}.viscous_friction"), shared[3] * scale * own));
            parameters.push((format!("actuator.{name}.strength"), strength));
            if is_mixed {
                parameters.push((format!("sensor.{name}.encoder_bias"), between(-0.03, 0.03)));
                parameters.push((format!("actuator.{name}.backlash"), play));
            }
        }
        let name = format!("inside {seed} ({})", if is_mixed { "mixed" } else { "plain" });
        Self { name, parameters, outside: Vec::new(), engine }
    }

    /// A robot with latency and lag, and one effect that the catalogue lacks, in turn.
    pub fn outside(robot: &TaskRobot, engine: Engine, seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::of(seed, 59, 0);
        let mut between = |low: f64, high: f64| low + (high - low) * f64::from(random.unit());
        let scale = f64::from(robot.torque_scale());
        let (latency, lag) = (between(0.008, 0.015), between(0.004, 0.01));
        let parameters = robot.model.joint_names().iter().flat_map(|name| {
            [(format!("actuator.{name}.command_latency"), latency), (format!("actuator.{name}.lag"), lag)]
        });
        let (name, effect) = match seed % 5 {
            0 => ("Stribeck", Outside::Stribeck(between(0.07, 0.12) * scale, between(0.5, 1.5))),
            1 => ("load-dependent", Outside::Load(between(0.15, 0.25))),
            2 => ("thermal", Outside::Thermal(between(0.2, 0.35), between(20.0, 60.0))),
            3 => ("series elasticity", Outside::Elastic(between(8.0, 15.0) * scale)),
            _ => ("ripple", Outside::Ripple(between(0.07, 0.12) * scale, between(8.0, 24.0))),
        };
        Self {
            name: format!("outside {seed} ({name})"),
            parameters: parameters.collect(),
            outside: vec![effect],
            engine,
        }
    }

    pub(super) fn acting(&self, joints: usize) -> Acting<'_> {
        Acting { effects: &self.outside, heat: vec![0.0; joints], motor: vec![0.0; joints], torques: vec![0.0; joints] }
    }
}

/// The outside effects of one walk.
pub(super) struct Acting<'a> {
    effects: &'a [Outside],
    /// Share of the way to the last temperature.
    heat: Vec<f64>,
    motor: Vec<f64>,
    torques: Vec<f64>,
}

impl Acting<'_> {
    pub fn is_any(&self) -> bool {
        !self.effects.is_empty()
    }

    /// What the encoders report: the motor's side of a spring.
    pub fn seen(&self, mut sensed: SensorReading) -> SensorReading {
        for effect in self.effects {
            if let Outside::Elastic(stiffness) = effect {
                sensed.q.iter_mut().zip(&self.motor).for_each(|(q, torque)| *q += torque / stiffness);
            }
        }
        sensed
    }

    /// Torques of the coming step, given what the motors delivered in the last.
    pub fn torques(&mut self, state: &State, motor: &[f64], kp: &[f64], step: f64) -> &[f64] {
        // Friction turns over within this speed: a torque that is held for a step must not throw a light joint past rest.
        let against = |most: f64, dq: f64| -most * (dq / 0.1).tanh();
        let joints = motor.len();
        self.torques.fill(0.0);
        for effect in self.effects {
            for j in 0..joints {
                let (q, dq, load) = (state.q[7 + j], state.v[6 + j], motor[j]);
                self.torques[j] += match *effect {
                    Outside::Stribeck(most, speed) => against(most * (-(dq / speed).powi(2)).exp(), dq),
                    Outside::Load(share) => against(share * load.abs(), dq),
                    Outside::Thermal(loss, time) => {
                        self.heat[j] += step / time * (1.0 - self.heat[j]);
                        -loss * self.heat[j] * load
                    }
                    Outside::Elastic(stiffness) => {
                        // Followed through a few milliseconds: a motor has some inertia.
                        self.motor[j] += step / 0.004 * (load - self.motor[j]);
                        -kp[j] * self.motor[j] / stiffness
                    }
                    Outside::Ripple(most, periods) => most * (periods * q + j as f64).sin(),
                };
            }
        }
        &self.torques
    }
}

/// Which engine moves a hidden robot. Both at 1 ms; policies are trained at 5 ms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Engine {
    /// Ours, in double precision and converged.
    Ours,
    /// Rapier; a build without the feature `rapier` has ours in its place.
    Second,
}
