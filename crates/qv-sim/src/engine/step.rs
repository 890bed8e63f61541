//! One time step of a block, from forces to new positions.

use super::actuation::{actuate, external_share};
use super::block::{Block, KeptContact, Work};
use super::collide::{Colliders, collide, leave_prints, origin, sink};
use super::constraint::{RowSettings, build_rows};
use super::cost::{contact_force, normal_force};
use super::dynamics::{bias_forces, factor, mass_matrix, solve};
use super::friction::{keep_loads, servo_friction, springs};
use super::kinematics::kinematics;
use super::newton::newton;
use super::scratch::NewtonSettings;
use super::topology::Topology;
use super::vector::*;
use super::weights::Weights;
use crate::commands::JointCommand;
use crate::lanes::{Kernel, Mask, Real, sin_cos};
use crate::options::SimOptions;

/// What all blocks of a batch share.
#[derive(Clone)]
pub(crate) struct BlockContext {
    pub topology: Topology,
    pub colliders: Colliders,
    pub weights: Weights,
    pub limits: Vec<(f64, f64)>,
    pub options: SimOptions,
    pub tolerance: f64,
}

/// Steps a run of blocks with one work space.
pub(crate) struct StepBlocks<'a, L: Real> {
    pub shared: &'a BlockContext,
    pub blocks: &'a mut [Block<L>],
    /// Index of the first block in the batch.
    pub first: usize,
    /// Number of environments in the batch.
    pub count: usize,
    pub steps: usize,
    /// One for each step, or none to hold those that are set.
    pub commands: &'a [JointCommand<'a>],
    pub work: &'a mut Work<L>,
}

impl<L: Real> Kernel<L> for StepBlocks<'_, L> {
    #[inline(always)]
    fn run(self) {
        for (index, block) in self.blocks.iter_mut().enumerate() {
            let used = (self.count - (self.first + index) * L::LANES).min(L::LANES);
            for k in 0..self.steps {
                if let Some(command) = self.commands.get(k) {
                    block.command_all(self.shared.topology.joints, command);
                }
                step(self.shared, used, block, self.work);
            }
        }
    }
}

/// Advances one block by one time step.
#[inline(always)]
pub(crate) fn step<L: Real>(shared: &BlockContext, used: usize, block: &mut Block<L>, work: &mut Work<L>) {
    let BlockContext { topology, colliders, options, .. } = shared;
    kinematics(topology, block, work);
    forces(shared, block, work);
    collide(topology, colliders, used, block, work);
    if block.any_sinking {
        leave_prints(block, work);
    }
    let rows = RowSettings {
        topology,
        slots: &colliders.slots,
        weights: &shared.weights,
        limits: &shared.limits,
        impratio: options.impratio,
        timestep: options.timestep,
    };
    let solver = NewtonSettings {
        topology,
        slots: &colliders.slots,
        iterations: options.iterations,
        tolerance: shared.tolerance,
        line_search: options.line_search,
        line_search_iterations: options.line_search_iterations,
        warm_start: options.warm_start,
    };
    if options.contact_dimension == 3 {
        build_rows::<L, 3>(&rows, block, work);
        newton::<L, 3>(&solver, block, work);
    } else {
        build_rows::<L, 6>(&rows, block, work);
        newton::<L, 6>(&solver, block, work);
    }
    if block.any_servo {
        keep_loads(topology, block, work);
    }
    contact_forces(shared, block, work);
    if block.any_sinking {
        sink(colliders, options.timestep, block, work);
    }
    keep_contacts(shared, block, work);
    accelerate(shared, block, work);
    integrate(shared, block);
    remember(topology, block);
}

/// Bias, mass matrix, actuators and outside forces.
#[inline(always)]
fn forces<L: Real>(shared: &BlockContext, block: &mut Block<L>, work: &mut Work<L>) {
    let BlockContext { topology, options, .. } = shared;
    bias_forces(topology, options.gravity, block, work);
    mass_matrix(topology, block, work);
    let outside = external_share(block, options.timestep);
    actuate(topology, outside, options.implicit_actuator_damping, block, work);
    if topology.free_base {
        let force = scale(block.ground.force, outside);
        let arm = rotate(&work.rotation[0], block.com[0]);
        let moment = rotate_back(&work.rotation[0], cross(arm, force));
        for k in 0..3 {
            work.smooth[k] += force[k];
            work.smooth[3 + k] += moment[k];
        }
    }
    if block.any_wrench {
        wrenches(topology, block, work);
    }
    if block.any_coulomb {
        work.rows.friction_limit.copy_from_slice(&block.coulomb);
    }
    if block.any_spring {
        springs(topology, block, work);
    }
    if block.any_servo {
        servo_friction(topology, block, work);
    }
}

/// Adds the wrenches that callers applied, as generalised forces.
#[inline(always)]
fn wrenches<L: Real>(topology: &Topology, block: &Block<L>, work: &mut Work<L>) {
    for (index, body) in topology.bodies.iter().enumerate() {
        let applied = &block.wrench[index];
        let at = add(work.position[index], rotate(&work.rotation[index], block.com[index]));
        let force = linear(applied);
        let about_origin = join(add(angular(applied), cross(at, force)), force);
        for &dof in body.path.iter() {
            work.smooth[dof] += dot6(&work.subspace[dof], &about_origin);
        }
    }
}

#[inline(always)]
fn contact_forces<L: Real>(shared: &BlockContext, block: &mut Block<L>, work: &mut Work<L>) {
    block.geom_force.fill(L::zero());
    block.geom_push.fill(L::zero());
    for &slot in &work.live {
        let geom = shared.colliders.slots[slot].geom;
        block.geom_force[geom] += normal_force(slot, work);
        let push = force_in_world(slot, work);
        for k in 0..3 {
            block.geom_push[3 * geom + k] += push[k];
        }
    }
}

/// Remembers each contact slot of the step, where the batch keeps them.
#[inline(always)]
fn keep_contacts<L: Real>(shared: &BlockContext, block: &mut Block<L>, work: &Work<L>) {
    if block.kept.is_empty() {
        return;
    }
    let origin = origin(&shared.topology, block);
    for kept in &mut block.kept {
        kept.active = L::Mask::splat(false);
    }
    for &slot in &work.live {
        let contact = &work.contacts[slot];
        let (point, force) = (add(origin, contact.point), force_in_world(slot, work));
        let (active, normal, distance) = (contact.active, contact.normal, contact.distance);
        block.kept[slot] = KeptContact { active, normal, point, distance, force };
    }
}

/// Force of a live contact on the robot \[N\], world axes.
#[inline(always)]
fn force_in_world<L: Real>(slot: usize, work: &Work<L>) -> V3<L> {
    let normal = work.contacts[slot].normal;
    let (first, second) = tangents(normal);
    let [along_normal, along_first, along_second] = contact_force(slot, work);
    add(scale(normal, along_normal), add(scale(first, along_first), scale(second, along_second)))
}

/// The acceleration with damping taken at the end of the step (MuJoCo's implicitfast):
/// `(M + h D) a = forces`, where the solver found `forces = M a_0`.
#[inline(always)]
fn accelerate<L: Real>(shared: &BlockContext, block: &mut Block<L>, work: &mut Work<L>) {
    let topology = &shared.topology;
    block.warm.copy_from_slice(&work.newton.a);
    block.acceleration.copy_from_slice(&work.newton.a);
    if !(block.any_viscous || shared.options.implicit_actuator_damping) {
        return;
    }
    let step = L::splat(shared.options.timestep);
    work.hessian.copy_from_slice(&work.mass_matrix);
    for i in topology.base_dofs..topology.nv {
        work.hessian[topology.row[i] + topology.columns[i].len() - 1] += step * work.implicit[i];
    }
    factor(topology, &mut work.hessian);
    block.acceleration.copy_from_slice(&work.newton.ma);
    solve(topology, &work.hessian, &mut block.acceleration);
}

/// Speed \[m/s, rad/s\] above which a lane has run away.
const RUNAWAY: f64 = 1e6;

/// Velocities first, then positions with the new velocities. A lane whose numbers ran away stays where it was.
#[inline(always)]
fn integrate<L: Real>(shared: &BlockContext, block: &mut Block<L>) {
    let topology = &shared.topology;
    let step = L::splat(shared.options.timestep);
    let mut fine = !block.faulty;
    for i in 0..topology.nv {
        // Comparisons are false on NaN.
        let velocity = block.v[i] + step * block.acceleration[i];
        fine = fine & velocity.abs().lt(L::splat(RUNAWAY));
    }
    block.faulty = !fine;
    let zero = L::zero();
    for i in 0..topology.nv {
        // Adding zero turns -0 into +0: lanes next to this one may have skipped work that leaves either.
        let velocity = block.v[i] + step * block.acceleration[i] + zero;
        block.v[i] = L::select(fine, velocity, zero);
        block.warm[i] = L::select(fine, block.warm[i] + zero, zero);
        block.acceleration[i] = L::select(fine, block.acceleration[i], zero);
    }
    for j in 0..topology.joints {
        let i = topology.base_positions + j;
        block.q[i] += step * block.v[topology.joint_dof(j)];
    }
    if topology.free_base {
        for k in 0..3 {
            let moved = step * block.v[k];
            block.q[k] += moved;
        }
        let turn = scale([block.v[3], block.v[4], block.v[5]], step);
        let q = [block.q[3], block.q[4], block.q[5], block.q[6]];
        let turned = turn_quaternion(q, turn);
        *block.q.chunk_mut(3) = turned;
    }
    block.time += step;
    block.settled = L::Mask::splat(false);
    block.pastless = L::Mask::splat(false);
}

/// `q * exp(turn / 2)`, turn in body axes \[rad\], normalised.
#[inline(always)]
fn turn_quaternion<L: Real>(q: [L; 4], turn: V3<L>) -> [L; 4] {
    let angle = dot(turn, turn).sqrt();
    let (sin, cos) = sin_cos(angle * L::splat(0.5));
    let still = angle.lt(L::splat(1e-12));
    let ratio = L::select(still, L::splat(0.5), sin / L::select(still, L::one(), angle));
    let [w, x, y, z] = q;
    let [a, b, c] = scale(turn, ratio);
    let out = [
        w * cos - x * a - y * b - z * c,
        w * a + x * cos + y * c - z * b,
        w * b - x * c + y * cos + z * a,
        w * c + x * b - y * a + z * cos,
    ];
    let squared = (out[0] * out[0] + out[1] * out[1]) + (out[2] * out[2] + out[3] * out[3]);
    let inverse = L::one() / squared.sqrt();
    [out[0] * inverse, out[1] * inverse, out[2] * inverse, out[3] * inverse]
}

/// Shifts the rings of commands and of what sensors saw.
#[inline(always)]
fn remember<L: Real>(topology: &Topology, block: &mut Block<L>) {
    let slots = block.commands.len() / topology.joints.max(1);
    if slots > 1 {
        let next = (block.head + 1) % slots;
        for j in 0..topology.joints {
            block.commands[next * topology.joints + j] = block.commands[block.head * topology.joints + j];
        }
        block.head = next;
    }
    let width = topology.nq + topology.nv;
    let seen = block.seen.len() / width;
    if seen > 0 {
        block.seen_head = (block.seen_head + 1) % seen;
        let target = &mut block.seen[block.seen_head * width..][..width];
        target[..topology.nq].copy_from_slice(&block.q);
        target[topology.nq..].copy_from_slice(&block.v);
        if block.any_compliance {
            for j in 0..topology.joints {
                let deflection = block.deflection(j);
                block.seen[block.seen_head * width + topology.base_positions + j] += deflection;
            }
        }
    }
}
