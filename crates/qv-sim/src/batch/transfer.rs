//! Numbers of many lanes to flat arrays and back, for [`super::bulk`].

use super::quantities::{ContactPoint, GeomMotion, Quantity};
use crate::commands::BatchCommand;
use crate::engine::block::{Block, CommandLanes, Work};
use crate::engine::collide::origin;
use crate::engine::kinematics::kinematics;
use crate::engine::step::BlockContext;
use crate::engine::topology::Topology;
use crate::engine::vector::{add, angular, cross, linear};
use crate::lanes::{Kernel, Real, Scalar, set, set_mask};

/// One quantity of the first `count` environments as `[count][width]`.
pub(super) fn gather<L: Real>(blocks: &[Block<L>], quantity: Quantity, count: usize, out: &mut [f32]) {
    let width = out.len() / count;
    let joints = blocks[0].torque.len();
    let (positions, speeds) = (blocks[0].q.len() - joints, blocks[0].v.len() - joints);
    for (index, block) in blocks.iter().enumerate() {
        let used = (count - index * L::LANES).min(L::LANES);
        for k in 0..width {
            let value = match quantity {
                Quantity::Positions => block.q[k],
                Quantity::Velocities => block.v[k],
                Quantity::Accelerations => block.acceleration[k],
                Quantity::Torques => block.torque[k],
                Quantity::GeomForces => block.geom_push[k],
                Quantity::JointPositions if block.any_compliance => {
                    block.q[positions + k] + block.joints[k].encoder_bias + block.deflection(k)
                }
                Quantity::JointPositions => block.q[positions + k] + block.joints[k].encoder_bias,
                Quantity::JointSpeeds => block.v[speeds + k],
            };
            for lane in 0..used {
                out[(index * L::LANES + lane) * width + k] = value.lane(lane).to_f64() as f32;
            }
        }
    }
}

/// Holds a command in every environment from the next step on.
pub(super) fn write_commands<L: Real>(blocks: &mut [Block<L>], joints: usize, count: usize, command: &BatchCommand) {
    for (index, block) in blocks.iter_mut().enumerate() {
        let used = (count - index * L::LANES).min(L::LANES);
        let slots = (block.commands.len() / joints.max(1)).max(1);
        for j in 0..joints {
            let mut next = block.commands[block.head * joints + j];
            for lane in 0..used {
                let env = index * L::LANES + lane;
                let pick =
                    |values: &[f32]| f64::from(values[if values.len() == joints { j } else { env * joints + j }]);
                set(&mut next.q, lane, f64::from(command.q[env * joints + j]));
                set(&mut next.dq, lane, command.dq.map_or(0.0, pick));
                set(&mut next.kp, lane, pick(command.kp));
                set(&mut next.kd, lane, pick(command.kd));
                set(&mut next.tau, lane, command.tau.map_or(0.0, pick));
            }
            block.commands[block.head * joints + j] = next;
            for age in 1..slots {
                let slot = (block.head + slots - age) % slots;
                let old = &mut block.commands[slot * joints + j];
                old.q = L::select(block.pastless, next.q, old.q);
                old.dq = L::select(block.pastless, next.dq, old.dq);
                old.kp = L::select(block.pastless, next.kp, old.kp);
                old.kd = L::select(block.pastless, next.kd, old.kd);
                old.tau = L::select(block.pastless, next.tau, old.tau);
            }
        }
    }
}

pub(super) fn write_added_torques<L: Real>(blocks: &mut [Block<L>], count: usize, torques: &[f32]) {
    let joints = torques.len() / count;
    for (index, block) in blocks.iter_mut().enumerate() {
        let used = (count - index * L::LANES).min(L::LANES);
        block.any_added = true;
        for j in 0..joints {
            for lane in 0..used {
                let torque = f64::from(torques[(index * L::LANES + lane) * joints + j]);
                set(&mut block.added_torque[j], lane, torque);
            }
        }
    }
}

/// Where shapes are and how fast their centres move, from the present positions and velocities.
pub(super) struct ReadGeoms<'a, L: Real> {
    pub shared: &'a BlockContext,
    pub blocks: &'a [Block<L>],
    pub work: &'a mut Work<L>,
    pub geoms: &'a [usize],
    pub count: usize,
    pub out: GeomMotion<'a>,
}

impl<L: Real> Kernel<L> for ReadGeoms<'_, L> {
    #[inline(always)]
    fn run(self) {
        let Self { shared, blocks, work, geoms, count, out } = self;
        for (index, block) in blocks.iter().enumerate() {
            let used = (count - index * L::LANES).min(L::LANES);
            kinematics(&shared.topology, block, work);
            let origin = origin(&shared.topology, block);
            for (at, &geom) in geoms.iter().enumerate() {
                let (body, centre) = shared.colliders.centre(geom, block, work);
                let motion = &work.velocity[body];
                let velocity = add(linear(motion), cross(angular(motion), centre));
                let position = add(origin, centre);
                for lane in 0..used {
                    let start = ((index * L::LANES + lane) * geoms.len() + at) * 3;
                    for k in 0..3 {
                        out.positions[start + k] = position[k].lane(lane).to_f64() as f32;
                        out.velocities[start + k] = velocity[k].lane(lane).to_f64() as f32;
                    }
                }
            }
        }
    }
}

pub(super) fn contacts<L: Real>(block: &Block<L>, lane: usize, shared: &BlockContext) -> Vec<ContactPoint> {
    let read = |v: &[L; 3]| [v[0].lane(lane).to_f64(), v[1].lane(lane).to_f64(), v[2].lane(lane).to_f64()];
    let kept = block.kept.iter().zip(&shared.colliders.slots).filter(|(kept, _)| L::mask_lane(kept.active, lane));
    kept.map(|(kept, slot)| ContactPoint {
        geom: slot.geom,
        link: slot.body,
        other: slot.other,
        point: read(&kept.point),
        normal: read(&kept.normal),
        force: read(&kept.force),
        distance: kept.distance.lane(lane).to_f64(),
    })
    .collect()
}

/// All that a lane's future depends on beside its parameters, in a fixed order; what is kept of the past by age.
pub(super) fn read_lane<L: Real>(block: &Block<L>, lane: usize, topology: &Topology, values: &mut Vec<f64>) {
    values.clear();
    values.push(f64::from(L::mask_lane(block.settled, lane)));
    values.push(f64::from(L::mask_lane(block.pastless, lane)));
    values.push(f64::from(L::mask_lane(block.faulty, lane)));
    let mut take = |x: &L| values.push(x.lane(lane).to_f64());
    take(&block.time);
    block.q.iter().chain(&block.v).chain(&block.warm).chain(&block.acceleration).for_each(&mut take);
    block.torque.iter().chain(&block.lagged).chain(&block.motor).for_each(&mut take);
    block.load.iter().chain(&block.added_torque).for_each(&mut take);
    block.sunk.iter().chain(&block.sinking).for_each(&mut take);
    block.geom_force.iter().chain(&block.geom_push).chain(block.wrench.iter().flatten()).for_each(&mut take);
    for at in commands_by_age(block, topology) {
        let CommandLanes { q, dq, kp, kd, tau } = &block.commands[at];
        [q, dq, kp, kd, tau].into_iter().for_each(&mut take);
    }
    seen_by_age(block, topology).for_each(|at| take(&block.seen[at]));
}

/// Writes what [`read_lane`] read, of the same length.
pub(super) fn write_lane<L: Real>(block: &mut Block<L>, lane: usize, topology: &Topology, values: &[f64]) {
    let mut values = values.iter().copied();
    let mut next = || values.next().unwrap_or(0.0);
    set_mask::<L>(&mut block.settled, lane, next() > 0.5);
    set_mask::<L>(&mut block.pastless, lane, next() > 0.5);
    set_mask::<L>(&mut block.faulty, lane, next() > 0.5);
    let mut put = |x: &mut L| set(x, lane, next());
    put(&mut block.time);
    let moving = block.q.iter_mut().chain(&mut block.v).chain(&mut block.warm).chain(&mut block.acceleration);
    moving.for_each(&mut put);
    let motors = block.torque.iter_mut().chain(&mut block.lagged).chain(&mut block.motor);
    motors.chain(&mut block.load).chain(&mut block.added_torque).for_each(&mut put);
    block.sunk.iter_mut().chain(&mut block.sinking).for_each(&mut put);
    let forces = block.geom_force.iter_mut().chain(&mut block.geom_push).chain(block.wrench.iter_mut().flatten());
    forces.for_each(&mut put);
    for at in commands_by_age(block, topology) {
        let CommandLanes { q, dq, kp, kd, tau } = &mut block.commands[at];
        [q, dq, kp, kd, tau].into_iter().for_each(&mut put);
    }
    for at in seen_by_age(block, topology) {
        put(&mut block.seen[at]);
    }
    let is_set = |x: &L| x.lane(lane).to_f64() != 0.0;
    block.any_added |= block.added_torque.iter().any(is_set);
    block.any_wrench |= block.wrench.iter().flatten().any(is_set);
    block.any_sinking |= block.sunk.iter().any(is_set);
}

/// Indices of the kept commands, newest first: rings of two blocks may begin at different slots.
fn commands_by_age<L: Real>(block: &Block<L>, topology: &Topology) -> impl Iterator<Item = usize> + use<L> {
    by_age(block.commands.len(), topology.joints, block.head)
}

/// Indices of the kept positions and velocities, newest first.
fn seen_by_age<L: Real>(block: &Block<L>, topology: &Topology) -> impl Iterator<Item = usize> + use<L> {
    by_age(block.seen.len(), topology.nq + topology.nv, block.seen_head)
}

fn by_age(length: usize, width: usize, head: usize) -> impl Iterator<Item = usize> {
    let slots = length / width.max(1);
    (0..slots).flat_map(move |age| (0..width).map(move |k| (head + slots - age) % slots * width + k))
}
