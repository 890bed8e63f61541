//! Motors: from commands to joint torques, as the robot's motor drivers compute them (`motor`), with delayed commands and the encoder's bias.

use super::block::{Block, CommandLanes, Work};
use super::topology::Topology;
use crate::lanes::{Real, Scalar};
use crate::motor::drifted;

/// Fills `block.torque`, `work.smooth` (all forces but those of constraints) and `work.implicit` (their damping).
/// `outside` is the share of the step during which outside torques act.
#[inline(always)]
pub(crate) fn actuate<L: Real>(
    topology: &Topology,
    outside: L,
    implicit: bool,
    block: &mut Block<L>,
    work: &mut Work<L>,
) {
    let sagged = if block.any_fading { sagged(topology, block) } else { L::one() };
    for j in 0..topology.joints {
        let dof = topology.joint_dof(j);
        let parameters = &block.joints[j];
        let command = command(topology, block, j);
        let q = block.q[topology.base_positions + j];
        let dq = block.v[dof];
        let weakened;
        let mut law = &parameters.law;
        if block.any_fading {
            weakened = law.weakened(sagged * drifted(parameters.drift, block.supply.start + block.time));
            law = &weakened;
        }
        let motor = law.within_play(block.motor[j], q);
        block.motor[j] = motor;
        let mut gain = law.kd_scale * command.kd * law.strength;
        let seen = motor + parameters.encoder_bias;
        let demand = law.demand(&command, seen, dq);
        // A lag that was not watched before is taken to have settled.
        let approach = block.lagged[j] + parameters.lag_gain * (demand - block.lagged[j]);
        let mut lagged = L::select(block.settled, demand, approach);
        let (least, most) = law.limits(dq);
        if block.any_compliance {
            let share = L::select(block.settled, L::one(), parameters.lag_gain);
            let sprung = law.sprung(&command, seen, dq, block.lagged[j], share, (least, most));
            let has_spring = L::zero().lt(law.compliance);
            lagged = L::select(has_spring, sprung.lagged, lagged);
            gain = L::select(has_spring, gain * sprung.softening, gain);
        }
        block.lagged[j] = lagged;
        let torque = lagged.max(least).min(most);
        block.torque[j] = torque;
        let viscous = block.viscous[dof];
        work.smooth[dof] = torque - viscous * dq + outside * parameters.external_torque - work.bias[dof];
        let mut damping = viscous;
        if implicit {
            // Only a torque that follows the speed at once and is not at its limit damps.
            let follows = L::one().le(parameters.lag_gain) & least.lt(lagged) & lagged.lt(most);
            damping += L::select(follows, gain, L::zero());
        }
        work.implicit[dof] = damping;
    }
    if block.any_added {
        for j in 0..topology.joints {
            work.smooth[topology.joint_dof(j)] += block.added_torque[j];
        }
    }
    for dof in 0..topology.base_dofs {
        work.smooth[dof] = -work.bias[dof];
        work.implicit[dof] = L::zero();
    }
}

/// Share of their torque that the supply lets all motors give, under the power that they drew: the torques of the step before, still there, at
/// the present speeds. Motors that brake draw none.
#[inline(always)]
fn sagged<L: Real>(topology: &Topology, block: &Block<L>) -> L {
    let mut power = L::zero();
    for j in 0..topology.joints {
        power += (block.torque[j] * block.v[topology.joint_dof(j)]).max(L::zero());
    }
    (L::one() - block.supply.sag * power).max(L::zero())
}

/// Share of the coming step during which the outside force acts.
#[inline(always)]
pub(crate) fn external_share<L: Real>(block: &Block<L>, timestep: f64) -> L {
    let ground = &block.ground;
    let step = L::splat(timestep);
    let from = ground.force_start.max(block.time);
    let to = ground.force_end.min(block.time + step);
    ((to - from) / step).max(L::zero()).min(L::one())
}

/// The command that is in force, delayed by a time that need not be a whole number of steps.
#[inline(always)]
fn command<L: Real>(topology: &Topology, block: &Block<L>, joint: usize) -> CommandLanes<L> {
    let newest = block.commands[block.head * topology.joints + joint];
    if !block.any_latency {
        return newest;
    }
    delayed(topology, block, joint, newest)
}

/// Lanes with the same latency take one pass together.
#[inline(always)]
fn delayed<L: Real>(topology: &Topology, block: &Block<L>, joint: usize, newest: CommandLanes<L>) -> CommandLanes<L> {
    let slots = block.commands.len() / topology.joints;
    let latency = block.joints[joint].latency;
    let mut out = newest;
    for lane in 0..L::LANES {
        let steps = latency.lane(lane).to_f64();
        if steps <= 0.0 || (0..lane).any(|before| latency.lane(before).to_f64() == steps) {
            continue;
        }
        let of_all = L::splat(steps);
        let alike = latency.le(of_all) & of_all.le(latency);
        let whole = steps.floor();
        let share = L::splat(steps - whole);
        let at = |age: usize| {
            // Not by the remainder, which takes longer than all else here.
            let slot = if age <= block.head { block.head - age } else { block.head + slots - age };
            &block.commands[slot * topology.joints + joint]
        };
        let age = (whole as usize).min(slots - 1);
        let (young, old) = (at(age), at((age + 1).min(slots - 1)));
        let mix = |out: L, a: L, b: L| L::select(alike, a + share * (b - a), out);
        out.q = mix(out.q, young.q, old.q);
        out.dq = mix(out.dq, young.dq, old.dq);
        out.kp = mix(out.kp, young.kp, old.kp);
        out.kd = mix(out.kd, young.kd, old.kd);
        out.tau = mix(out.tau, young.tau, old.tau);
    }
    out
}
