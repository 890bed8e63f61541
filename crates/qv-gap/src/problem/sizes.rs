//! How large the effects of the library are on one robot: a twentieth of a newton metre is nothing to a leg and half of what a hobby servo has.

use crate::problem::library::Effect;
use crate::problem::torques::largest_torques;
use qv_recording::Run;
use qv_rollout::Rollout;

/// Share of a robot's mass by which masses are tolerated to differ, at most.
const MASS_TOLERANCE: f64 = 0.02;
/// Largest torque of the motors that the library's sizes are those of: hips and thighs of a Go2 \[N m\].
const MOTOR: f64 = 23.7;
/// Mass of the robot that they are those of \[kg\].
const WEIGHT: f64 = 15.0;
/// A model may state a limit that no motor has. One that is used to a fifth of what it can do is used little.
const LEAST_USED: f64 = 0.2;

/// What sizes are multiplied by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    /// Those of torques, dampings and inertias of joints.
    pub torque: f64,
    /// The same for the ends of ranges: what is usual in the strongest joint lies within them, too.
    pub largest_torque: f64,
    /// Those of masses.
    pub mass: f64,
}

impl Sizes {
    /// Those of a robot: of one that is held by its middle motor and the mass of what moves, of one that walks 1.
    pub fn new(rollout: &Rollout, run: &Run) -> Self {
        if rollout.free {
            return Self { torque: 1.0, largest_torque: 1.0, mass: 1.0 };
        }
        let used = largest_torques(rollout, run);
        let limit = |joint: usize| match rollout.parameter(&format!("actuator.{}.torque_limit", name(rollout, joint))) {
            Some(id) => rollout.nominal[id],
            None => f64::INFINITY,
        };
        let mut motors: Vec<f64> =
            used.iter().enumerate().filter(|(_, u)| **u > 0.0).map(|(j, u)| limit(j).min(u / LEAST_USED)).collect();
        motors.sort_by(f64::total_cmp);
        // Of two middle ones the smaller: nothing is hidden by a size that is too small.
        let middle = motors.get(motors.len().saturating_sub(1) / 2).copied().unwrap_or(MOTOR);
        let mass: f64 = rollout.model.links.iter().skip(1).map(|l| l.mass).sum();
        let largest = motors.last().copied().unwrap_or(MOTOR);
        Self {
            torque: middle / MOTOR,
            largest_torque: largest / MOTOR,
            mass: if mass > 0.0 { mass / WEIGHT } else { 1.0 },
        }
    }

    /// The effect as it is for a robot of these sizes.
    pub fn of(&self, rollout: &Rollout, effect: &Effect, masses: impl Iterator<Item = usize>) -> Effect {
        let mut sized = effect.clone();
        if !rollout.free {
            sized.range = effect.held_range.unwrap_or(effect.range);
        }
        let [factor, of_range] = match effect.unit.as_str() {
            "N m" | "N m/rad" | "N m s/rad" | "N m s²/rad²" | "kg m²" => [self.torque, self.largest_torque],
            // What yields to a torque, or is lost by one, is larger where motors are small.
            "rad/(N m)" | "1/W" => [1.0 / self.torque; 2],
            "kg" => [self.mass; 2],
            _ => [1.0; 2],
        };
        sized.tolerance *= factor;
        sized.usual_span = effect.span() * factor;
        sized.range.iter_mut().for_each(|end| *end *= of_range);
        if effect.levels_of.is_none() {
            sized.levels.iter_mut().for_each(|level| *level *= factor);
        }
        if effect.unit == "kg" {
            sized.tolerance = mass_tolerance(rollout, sized.tolerance, masses);
        }
        sized
    }
}

/// At most a share of what the robot weighs, and so small that three of it lie within the range of each of the parameters `masses`: the jaw
/// of an arm may weigh less than a leg is off by.
fn mass_tolerance(rollout: &Rollout, tolerance: f64, masses: impl Iterator<Item = usize>) -> f64 {
    let weight: f64 = rollout.model.links.iter().map(|l| l.mass).sum();
    let room = |id: usize| rollout.nominal[id] - rollout.catalogue[id].range.0;
    let rooms = masses.map(room).filter(|room| *room > 0.0).map(|room| room / 3.0);
    rooms.fold(tolerance.min(MASS_TOLERANCE * weight), f64::min)
}

fn name<'p>(rollout: &'p Rollout, joint: usize) -> &'p str {
    &rollout.model.joint_names()[joint]
}
