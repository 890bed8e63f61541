//! Motors of the second engine: from commands to torques, one joint after the other.

use super::options::LONGEST_DELAY;
use super::values::Values;
use crate::JointCommand;
use crate::parameters::JointField::*;
use crate::parameters::WorldField;
use std::collections::VecDeque;

/// Command of one joint: position, speed, gains, feed-forward.
#[derive(Debug, Clone, Copy, Default)]
struct Order {
    q: f64,
    dq: f64,
    kp: f64,
    kd: f64,
    tau: f64,
}

impl Order {
    /// Between this order and an older one.
    fn mixed(&self, older: &Self, share: f64) -> Self {
        let mix = |young: f64, old: f64| young + share * (old - young);
        Self {
            q: mix(self.q, older.q),
            dq: mix(self.dq, older.dq),
            kp: mix(self.kp, older.kp),
            kd: mix(self.kd, older.kd),
            tau: mix(self.tau, older.tau),
        }
    }
}

/// What motors remember.
#[derive(Debug, Clone)]
pub(super) struct Motors {
    present: Vec<Order>,
    /// Orders in force at past steps, the newest first.
    past: VecDeque<Vec<Order>>,
    /// Position of each rotor behind its gear \[rad\].
    rotor: Vec<f64>,
    /// Torque behind the lag \[N m\]; empty before the first step.
    lagged: Vec<f64>,
    /// Torque of the last step \[N m\].
    given: Vec<f64>,
}

impl Motors {
    /// Motors at rest at joint positions `q`, commanded nothing.
    pub fn new(q: &[f64]) -> Self {
        Self {
            present: vec![Order::default(); q.len()],
            past: VecDeque::new(),
            rotor: q.to_vec(),
            lagged: Vec::new(),
            given: vec![0.0; q.len()],
        }
    }

    /// Holds a command from now on; lengths are the caller's to check.
    pub fn hold(&mut self, command: &JointCommand) {
        for (j, order) in self.present.iter_mut().enumerate() {
            let [q, dq, kp, kd, tau] = [command.q, command.dq, command.kp, command.kd, command.tau].map(|x| x[j]);
            *order = Order { q, dq, kp, kd, tau };
        }
    }

    /// Torques \[N m\] of the coming step, `time` after the state was set, at joint positions `q` and speeds `dq`.
    pub fn torques(&mut self, values: &Values, time: f64, timestep: f64, q: &[f64], dq: &[f64]) -> Vec<f64> {
        self.past.push_front(self.present.clone());
        self.past.truncate((LONGEST_DELAY / timestep).ceil() as usize + 2);
        let fresh = self.lagged.is_empty();
        self.lagged.resize(q.len(), 0.0);
        let power: f64 = self.given.iter().zip(dq).map(|(torque, speed)| (torque * speed).max(0.0)).sum();
        let supply = (1.0 - values.world(WorldField::SupplySag) * power).max(0.0);
        let given = (0..q.len())
            .map(|j| {
                let play = 0.5 * values.joint(j, Backlash);
                self.rotor[j] = self.rotor[j].clamp(q[j] - play, q[j] + play);
                let order = self.order(j, values.joint(j, CommandLatency) / timestep);
                let (lag, before) = (values.joint(j, Lag), self.lagged[j]);
                let seen = self.rotor[j] + values.joint(j, EncoderBias);
                let since = values.world(WorldField::RunStart) + time;
                let share = supply * (1.0 + values.joint(j, StrengthDrift) * since).max(0.0);
                let lagged = |deflection: f64| {
                    let wanted = share * wanted(values, j, &order, seen + deflection, dq[j]);
                    if fresh || lag <= 0.0 { wanted } else { wanted + (before - wanted) * (-timestep / lag).exp() }
                };
                // The speed takes torque along the motion, not from a motor that brakes.
                let (full, along) = (values.joint(j, TorqueLimit), limit(values, j, dq[j]));
                let limited = |t: f64| if dq[j] > 0.0 { t.clamp(-full, along) } else { t.clamp(-along, full) };
                let compliance = values.joint(j, SeriesCompliance);
                let deflection =
                    if compliance > 0.0 { compliance * balance(|t| limited(lagged(compliance * t))) } else { 0.0 };
                self.lagged[j] = lagged(deflection);
                limited(self.lagged[j])
            })
            .collect();
        self.given = given;
        self.given.clone()
    }

    /// The order given `age` steps ago, between steps by interpolation; the first one also counts as all before it.
    fn order(&self, joint: usize, age: f64) -> Order {
        let at = |steps: usize| &self.past[steps.min(self.past.len() - 1)][joint];
        let whole = age.floor();
        at(whole as usize).mixed(at(whole as usize + 1), age - whole)
    }
}

/// The torque that is what a motor gives once its spring is twisted by it, where more twist never gives more: by halving.
fn balance(given: impl Fn(f64) -> f64) -> f64 {
    let (mut inner, mut outer) = (0.0, given(0.0));
    for _ in 0..60 {
        let middle = 0.5 * (inner + outer);
        // On the side of nothing the motor gives more, in the direction of `outer`, than the spring bears.
        if (given(middle) - middle) * outer > 0.0 { inner = middle } else { outer = middle }
    }
    0.5 * (inner + outer)
}

/// Torque that the controller asks of the motor \[N m\].
fn wanted(values: &Values, joint: usize, order: &Order, q: f64, dq: f64) -> f64 {
    let get = |field| values.joint(joint, field);
    let most = get(PositionTorqueLimit);
    let spring = (get(KpScale) * order.kp * (order.q - q) + order.tau).clamp(-most, most);
    let asked = spring + get(KdScale) * order.kd * (order.dq - dq);
    get(Strength) * asked + get(StrengthAsymmetry) * asked.abs()
}

/// Largest torque along the motion at a speed \[N m\]: constant up to the knee, falling to nothing at the zero.
fn limit(values: &Values, joint: usize, dq: f64) -> f64 {
    let (knee, zero) = (values.joint(joint, SpeedKnee), values.joint(joint, SpeedZero));
    let most = values.joint(joint, TorqueLimit);
    let speed = dq.abs();
    if speed <= knee {
        most
    } else if speed >= zero {
        0.0
    } else {
        most * (zero - speed) / (zero - knee)
    }
}
