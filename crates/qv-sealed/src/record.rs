//! A recipe carried out.

use crate::engine::Engine;
use crate::plant::Plant;
use crate::recipe::Recipe;
use crate::scout::Scout;
use crate::sections::SETTLING;
use crate::withheld::Disturbance;
use qv_core::random::SplitMix64;
use qv_go2::messages::{self, LowCmd};
use qv_go2::model;
use qv_go2::synthetic::{self, COMMAND_DELAY, INTERVAL, Message, START, STATES_PER_POSE, simulator};
use qv_recording::RecordingError;
use qv_sim::{SensorReading, State};

/// Time between two states \[s\].
const BETWEEN_STATES: f64 = 0.002;

/// How a recording went.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The robot stayed on its feet.
    Stood {
        /// Where the base ended \[m\].
        end: [f64; 3],
        /// Time that loaded feet spent in the region of an effect, summed over feet \[s\]; 0 without a region.
        in_region: f64,
    },
    /// It fell, or its numbers ran away.
    Fell {
        /// Time in the recording \[s\].
        at: f64,
    },
}

/// Carries a recipe out. The messages are those until the end or the fall.
///
/// # Errors
/// When a parameter means nothing, or the engine is not built in.
pub fn record(recipe: &Recipe) -> Result<(Outcome, Vec<Message>), RecordingError> {
    record_seen(recipe, |_, _, _| {})
}

/// The same, with the true reading and state of each 2 ms shown to `see`.
pub(crate) fn record_seen(
    recipe: &Recipe,
    mut see: impl FnMut(&Plant, &SensorReading, &State),
) -> Result<(Outcome, Vec<Message>), RecordingError> {
    let mut plant = Plant::on(&recipe.engine, recipe.ground.as_ref(), &recipe.parameters())?;
    let go2 = plant.model().clone();
    let mut draws = SplitMix64::new(recipe.seed);
    let mut messages = Vec::new();
    let outcome = follow(recipe, &mut plant, |plant, k, seen, true_state| {
        see(plant, seen, true_state);
        let time = START + INTERVAL * k;
        let state = synthetic::low_state(seen, &go2, 2 * k as u32, &recipe.deviations, &mut draws);
        messages.push(Message { topic: "/lowstate", time, data: messages::encode_low_state(&state) });
        if k % STATES_PER_POSE == 0 {
            messages.push(synthetic::pose(seen, time, &recipe.deviations, &mut draws));
        }
        // What was sent, whatever became of it on the way.
        let data = messages::encode_low_cmd(&command(recipe, k));
        messages.push(Message { topic: "/lowcmd", time: time + COMMAND_DELAY, data });
    })?;
    Ok((outcome, messages))
}

fn command(recipe: &Recipe, k: u64) -> LowCmd {
    let q = recipe.plan.target(k as f64 * BETWEEN_STATES);
    LowCmd { q, kp: [recipe.kp; 12], kd: [recipe.kd; 12], ..Default::default() }
}

/// Moves the plant through the motion and shows index, reading and true state of each 2 ms before its command is sent.
pub(crate) fn follow(
    recipe: &Recipe,
    plant: &mut Plant,
    mut see: impl FnMut(&Plant, u64, &SensorReading, &State),
) -> Result<Outcome, RecordingError> {
    let timestep = recipe.engine.timestep();
    let parameters = recipe.parameters();
    let steps = (BETWEEN_STATES / timestep).round().max(1.0) as usize;
    let mut disturbance = match &recipe.withheld {
        Some(effect) => Some(Disturbance::new(effect, plant, timestep).map_err(simulator)?),
        None => None,
    };
    plant.send(&command(recipe, 0)).map_err(simulator)?;
    for _ in 0..(SETTLING / timestep).round() as usize {
        if !plant.step().map_err(simulator)? {
            return Ok(Outcome::Fell { at: 0.0 });
        }
    }
    let (mut end, mut in_region) = ([0.0; 3], 0.0);
    for k in 0..(recipe.plan.duration() / BETWEEN_STATES).round() as u64 {
        let time = k as f64 * BETWEEN_STATES;
        let (seen, state) = (plant.sensors().map_err(simulator)?, plant.state().map_err(simulator)?);
        if has_fallen(&state, floor_height(&parameters, state.q[0], state.q[1])) {
            return Ok(Outcome::Fell { at: time });
        }
        see(plant, k, &seen, &state);
        in_region += BETWEEN_STATES * feet_in_region(recipe, plant, &seen, &state) as f64;
        end = [state.q[0], state.q[1], state.q[2]];
        let sent = command(recipe, k);
        let arrived = disturbance.as_mut().map_or(sent, |d| d.arriving(time, sent));
        plant.send(&arrived).map_err(simulator)?;
        for step in 0..steps {
            if let Some(disturbance) = disturbance.as_mut() {
                disturbance.act(plant, time + step as f64 * timestep).map_err(simulator)?;
            }
            if !plant.step().map_err(simulator)? {
                return Ok(Outcome::Fell { at: time });
            }
        }
    }
    Ok(Outcome::Stood { end, in_region })
}

/// Runs a recipe's motion ahead, without effects and in our engine; `None` when the robot falls even so.
///
/// # Errors
/// When a parameter means nothing.
pub(crate) fn scout(recipe: &Recipe) -> Result<Option<Scout>, RecordingError> {
    let engine = Engine::Ours { timestep: 0.001, impratio: 10.0, contact_dimension: 3, time_constant: 0.008 };
    let nominal = Recipe { engine, ..recipe.without_effects() };
    let mut plant = Plant::on(&nominal.engine, nominal.ground.as_ref(), &nominal.parameters())?;
    let mut scout = Scout { torque: Vec::new(), speed: Vec::new(), path: Vec::new() };
    let outcome = follow(&nominal, &mut plant, |_, _, seen, state| {
        scout.torque.push(std::array::from_fn(|j| seen.tau[j]));
        scout.speed.push(std::array::from_fn(|j| state.v[6 + j]));
        scout.path.push([state.q[0], state.q[1]]);
    })?;
    Ok(matches!(outcome, Outcome::Stood { .. }).then_some(scout))
}

/// Lower than this over the floor the trunk lies on its legs: the deepest squat has it at 0.23 m \[m\].
const LEAST_HEIGHT: f64 = 0.17;

/// Whether the trunk leans by more than 0.6 rad, or lies lower than any squat brings it.
fn has_fallen(state: &State, floor: f64) -> bool {
    let (x, y) = (state.q[4], state.q[5]);
    let upright = 1.0 - 2.0 * (x * x + y * y);
    // Also true of what is not a number.
    !(upright > 0.6_f64.cos() && state.q[2] - floor > LEAST_HEIGHT)
}

/// Height \[m\] of the floor under a place, as the parameters raise and tilt it.
fn floor_height(parameters: &[(String, f64)], x: f64, y: f64) -> f64 {
    let of = |name: &str| parameters.iter().find(|(n, _)| n == name).map_or(0.0, |(_, value)| *value);
    of("terrain.height") + x * of("terrain.slope_x").tan() + y * of("terrain.slope_y").tan()
}

/// Loaded feet inside the region that an effect is confined to.
fn feet_in_region(recipe: &Recipe, plant: &Plant, seen: &SensorReading, state: &State) -> usize {
    let Some(region) = recipe.causes.iter().find_map(|cause| cause.region) else { return 0 };
    let q = &state.q;
    let turn = glam::DQuat::from_xyzw(q[4], q[5], q[6], q[3]);
    let feet = model::foot_positions(&std::array::from_fn(|j| q[7 + j]));
    let loaded = |leg: usize| {
        let geoms = plant.model().geoms.iter().zip(&seen.foot_force);
        geoms.filter(|(g, _)| plant.model().links[g.link].name == model::FOOT_LINKS[leg]).any(|(_, f)| *f > 5.0)
    };
    (0..4)
        .filter(|&leg| {
            let foot = glam::DVec3::new(q[0], q[1], q[2]) + turn * feet[leg];
            loaded(leg) && region.contains(foot.x, foot.y)
        })
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_on_its_side_or_its_belly_has_fallen() {
        let upright = crate::plant::standing(&[]);
        assert!(!has_fallen(&upright, 0.0) && has_fallen(&upright, 0.2));
        let mut lying = upright.clone();
        (lying.q[3], lying.q[4]) = (0.8, 0.6);
        assert!(has_fallen(&lying, 0.0));
        let mut lost = upright;
        lost.q[2] = f64::NAN;
        assert!(has_fallen(&lost, 0.0));
    }

    #[test]
    fn the_floor_rises_along_x() {
        let parameters = [("terrain.height".to_string(), 0.05), ("terrain.slope_x".to_string(), 0.1)];
        assert!((floor_height(&parameters, 2.0, 9.0) - 0.05 - 2.0 * 0.1_f64.tan()).abs() < 1e-12);
    }
}
