//! Picks the register width and hides it behind an object.

use super::quantities::{BaseMotion, ContactPoint, GeomMotion, Quantity};
use super::transfer;
use crate::SimError;
use crate::commands::{BatchCommand, JointCommand};
use crate::engine::block::{Block, CommandLanes, KeptContact, Work};
use crate::engine::derive::Deriver;
use crate::engine::step::{BlockContext, StepBlocks};
use crate::lanes::{Real, Scalar, set, set_mask};
use crate::model::Model;
use crate::parameters::ActsOn;
use rayon::prelude::*;
use std::any::Any;

/// A batch whose lane width is not known to its owner.
pub(crate) trait Engine: Send + Sync {
    fn lanes(&self) -> usize;
    /// Environments, padding included.
    fn padded(&self) -> usize;
    fn bytes(&self) -> usize;
    /// Steps with held commands, or with one of `commands` (as many as steps) for all in each step.
    fn step(&mut self, shared: &BlockContext, steps: usize, commands: &[JointCommand], parallel: bool);
    fn write_state(&mut self, shared: &BlockContext, env: usize, q: &[f64], v: &[f64]);
    fn read_state(&self, env: usize, q: &mut [f64], v: &mut [f64]);
    /// State of `age` steps ago (not whole: interpolated), as far back as is kept.
    fn read_past_state(&self, env: usize, age: f64, q: &mut [f64], v: &mut [f64]);
    fn past_joint(&self, env: usize, age: f64, sizes: [usize; 2], at: [usize; 2]) -> [f64; 2];
    fn write_command(&mut self, shared: &BlockContext, env: usize, age: Option<usize>, command: &JointCommand);
    fn write_command_to_all(&mut self, shared: &BlockContext, command: &JointCommand);
    fn derive(&mut self, deriver: &Deriver, acts_on: ActsOn, values: &[f64], env: usize) -> Result<(), SimError>;
    fn derive_all(&mut self, deriver: &Deriver, values: &[f64], env: usize) -> Result<(), SimError>;
    fn torque(&self, env: usize) -> Vec<f64>;
    fn acceleration(&self, env: usize) -> Vec<f64>;
    fn geom_force(&self, env: usize) -> Vec<f64>;
    fn sunk(&self, env: usize) -> Vec<f64>;
    fn faulty(&self, env: usize) -> bool;
    fn copy_blocks(&self) -> Box<dyn Any + Send + Sync>;
    fn restore_blocks(&mut self, blocks: &(dyn Any + Send + Sync)) -> bool;
    fn read_bulk(&self, quantity: Quantity, count: usize, out: &mut [f32]);
    fn base_motion(&self, env: usize) -> BaseMotion;
    fn write_commands(&mut self, shared: &BlockContext, commands: &BatchCommand);
    fn write_added_torques(&mut self, torques: &[f32]);
    fn write_lagged_torques(&mut self, env: usize, torques: &[f64]);
    fn write_wrench(&mut self, env: usize, link: usize, wrench: [f64; 6]);
    fn add_velocity(&mut self, env: usize, change: &[f64]);
    fn read_geoms(&mut self, shared: &BlockContext, geoms: &[usize], out: GeomMotion);
    fn contacts(&self, shared: &BlockContext, env: usize) -> Vec<ContactPoint>;
    fn read_lane(&self, shared: &BlockContext, env: usize, values: &mut Vec<f64>);
    fn write_lane(&mut self, shared: &BlockContext, env: usize, values: &[f64]);
}

/// Chooses an engine for a precision.
pub trait Dispatch: Scalar {
    #[doc(hidden)]
    #[allow(private_interfaces)]
    fn engine(model: &Model, shared: &BlockContext, materials: usize, count: usize) -> Box<dyn Engine>;
}

/// The precision of a simulation: `f64` or `f32`.
pub trait Precision: Dispatch {}
impl Precision for f64 {}
impl Precision for f32 {}

macro_rules! dispatch {
    ($scalar:ty, $wide:ident, $narrow:ident) => {
        impl Dispatch for $scalar {
            #[allow(private_interfaces)]
            fn engine(model: &Model, shared: &BlockContext, materials: usize, count: usize) -> Box<dyn Engine> {
                #[cfg(target_arch = "x86_64")]
                {
                    use crate::lanes::{$narrow, $wide};
                    let wanted = shared.options.lanes.unwrap_or(if count == 1 { 1 } else { $wide::LANES });
                    let wide = is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq");
                    if wanted >= $wide::LANES && wide {
                        return Box::new(Lanes::<$wide>::new(model, shared, materials, count));
                    }
                    if wanted >= $narrow::LANES && is_x86_feature_detected!("avx2") {
                        return Box::new(Lanes::<$narrow>::new(model, shared, materials, count));
                    }
                }
                Box::new(Lanes::<$scalar>::new(model, shared, materials, count))
            }
        }
    };
}

dispatch!(f64, F64x8, F64x4);
dispatch!(f32, F32x16, F32x8);

struct Lanes<L: Real> {
    blocks: Vec<Block<L>>,
    /// One per share of the blocks that a thread takes at a time.
    works: Vec<Work<L>>,
    count: usize,
}

impl<L: Real> Lanes<L> {
    fn new(model: &Model, shared: &BlockContext, materials: usize, count: usize) -> Self {
        let options = &shared.options;
        let seen = if options.max_sensor_latency > 0.0 { options.ring(options.max_sensor_latency) } else { 0 };
        let commands = options.ring(options.max_command_latency);
        let mut block = Block::new(model, &shared.topology, materials, commands, seen);
        if options.keep_contacts {
            block.kept = vec![KeptContact::none(); shared.colliders.slots.len()];
        }
        let blocks = vec![block; count.div_ceil(L::LANES)];
        let geoms = model.geoms.len();
        let work = Work::new(&shared.topology, &shared.colliders.slots, geoms, options.contact_dimension);
        Self { blocks, works: vec![work], count }
    }

    fn at(&self, env: usize) -> (&Block<L>, usize) {
        (&self.blocks[env / L::LANES], env % L::LANES)
    }

    fn at_mut(&mut self, env: usize) -> (&mut Block<L>, usize) {
        (&mut self.blocks[env / L::LANES], env % L::LANES)
    }
}

fn lane_values<L: Real>(values: &[L], lane: usize) -> Vec<f64> {
    values.iter().map(|x| x.lane(lane).to_f64()).collect()
}

impl<L: Real> Engine for Lanes<L> {
    fn lanes(&self) -> usize {
        L::LANES
    }

    fn padded(&self) -> usize {
        self.blocks.len() * L::LANES
    }

    fn bytes(&self) -> usize {
        self.blocks.iter().map(Block::bytes).sum()
    }

    fn step(&mut self, shared: &BlockContext, steps: usize, commands: &[JointCommand], parallel: bool) {
        let threads = if parallel { rayon::current_num_threads() } else { 1 };
        // A few shares per thread, so that a thread that finishes early takes another.
        let shares = if threads == 1 { 1 } else { (4 * threads).min(self.blocks.len()) };
        let size = self.blocks.len().div_ceil(shares);
        if self.works.len() < shares {
            let work = self.works[0].clone();
            self.works.resize(shares, work);
        }
        let count = self.count;
        let run = |(share, (blocks, work)): (usize, (&mut [Block<L>], &mut Work<L>))| {
            let body = StepBlocks { shared, blocks, first: share * size, count, steps, commands, work };
            // Values of a register type exist only where its features were detected (`Dispatch::engine`).
            unsafe { L::with_features(body) }
        };
        if shares == 1 {
            run((0, (&mut self.blocks, &mut self.works[0])));
        } else {
            self.blocks.par_chunks_mut(size).zip(&mut self.works).enumerate().for_each(run);
        }
    }

    fn write_state(&mut self, shared: &BlockContext, env: usize, q: &[f64], v: &[f64]) {
        let topology = &shared.topology;
        let (block, lane) = self.at_mut(env);
        q.iter().zip(&mut block.q).for_each(|(&x, target)| set(target, lane, x));
        v.iter().zip(&mut block.v).for_each(|(&x, target)| set(target, lane, x));
        block.warm.iter_mut().chain(&mut block.acceleration).for_each(|x| set(x, lane, 0.0));
        block.torque.iter_mut().chain(&mut block.lagged).for_each(|x| set(x, lane, 0.0));
        block.geom_force.iter_mut().chain(&mut block.geom_push).for_each(|x| set(x, lane, 0.0));
        block.load.iter_mut().chain(&mut block.sunk).chain(&mut block.sinking).for_each(|x| set(x, lane, 0.0));
        block.added_torque.iter_mut().chain(block.wrench.iter_mut().flatten()).for_each(|x| set(x, lane, 0.0));
        for kept in &mut block.kept {
            set_mask::<L>(&mut kept.active, lane, false);
        }
        for j in 0..topology.joints {
            set(&mut block.motor[j], lane, q[topology.base_positions + j]);
        }
        set(&mut block.time, lane, 0.0);
        for command in &mut block.commands {
            for value in [&mut command.q, &mut command.dq, &mut command.kp, &mut command.kd, &mut command.tau] {
                set(value, lane, 0.0);
            }
        }
        set_mask::<L>(&mut block.settled, lane, true);
        set_mask::<L>(&mut block.pastless, lane, true);
        set_mask::<L>(&mut block.faulty, lane, false);
        let width = topology.nq + topology.nv;
        for slot in block.seen.chunks_mut(width) {
            q.iter().chain(v).zip(slot).for_each(|(&x, target)| set(target, lane, x));
        }
    }

    fn read_state(&self, env: usize, q: &mut [f64], v: &mut [f64]) {
        let (block, lane) = self.at(env);
        q.iter_mut().zip(&block.q).for_each(|(target, x)| *target = x.lane(lane).to_f64());
        v.iter_mut().zip(&block.v).for_each(|(target, x)| *target = x.lane(lane).to_f64());
    }

    fn read_past_state(&self, env: usize, age: f64, q: &mut [f64], v: &mut [f64]) {
        let (block, lane) = self.at(env);
        let width = q.len() + v.len();
        let kept = block.seen.len() / width;
        if kept == 0 || age <= 0.0 {
            return self.read_state(env, q, v);
        }
        let ([young, old], share) = block.past_rows(age, width);
        for (target, (young, old)) in q.iter_mut().chain(v).zip(young.iter().zip(old)) {
            let (young, old) = (young.lane(lane).to_f64(), old.lane(lane).to_f64());
            *target = young + share * (old - young);
        }
    }

    /// One position and one speed of a past state, of `sizes` positions and speeds those `at`.
    fn past_joint(&self, env: usize, age: f64, [positions, dofs]: [usize; 2], [q, v]: [usize; 2]) -> [f64; 2] {
        let (block, lane) = self.at(env);
        if block.seen.is_empty() || age <= 0.0 {
            let (mut all_q, mut all_v) = (vec![0.0; positions], vec![0.0; dofs]);
            self.read_state(env, &mut all_q, &mut all_v);
            return [all_q[q], all_v[v]];
        }
        let ([young, old], share) = block.past_rows(age, positions + dofs);
        [q, positions + v].map(|k| {
            let (young, old) = (young[k].lane(lane).to_f64(), old[k].lane(lane).to_f64());
            young + share * (old - young)
        })
    }

    fn write_command(&mut self, shared: &BlockContext, env: usize, age: Option<usize>, command: &JointCommand) {
        let joints = shared.topology.joints;
        let (block, lane) = self.at_mut(env);
        let slots = (block.commands.len() / joints.max(1)).max(1);
        if age.is_some_and(|age| age > 0) {
            set_mask::<L>(&mut block.pastless, lane, false);
        }
        let ages = match age {
            Some(age) => age..age + 1,
            None if L::mask_lane(block.pastless, lane) => 0..slots,
            None => 0..1,
        };
        for age in ages {
            let slot = (block.head + slots - age) % slots;
            for j in 0..joints {
                let target: &mut CommandLanes<L> = &mut block.commands[slot * joints + j];
                set(&mut target.q, lane, command.q[j]);
                set(&mut target.dq, lane, command.dq[j]);
                set(&mut target.kp, lane, command.kp[j]);
                set(&mut target.kd, lane, command.kd[j]);
                set(&mut target.tau, lane, command.tau[j]);
            }
        }
    }

    fn write_command_to_all(&mut self, shared: &BlockContext, command: &JointCommand) {
        let joints = shared.topology.joints;
        for block in &mut self.blocks {
            block.command_all(joints, command);
        }
    }

    fn derive(&mut self, deriver: &Deriver, acts_on: ActsOn, values: &[f64], env: usize) -> Result<(), SimError> {
        let (block, lane) = self.at_mut(env);
        deriver.apply(acts_on, values, lane, block)
    }

    fn derive_all(&mut self, deriver: &Deriver, values: &[f64], env: usize) -> Result<(), SimError> {
        let (block, lane) = self.at_mut(env);
        deriver.apply_all(values, lane, block)
    }

    fn torque(&self, env: usize) -> Vec<f64> {
        let (block, lane) = self.at(env);
        lane_values(&block.torque, lane)
    }

    fn acceleration(&self, env: usize) -> Vec<f64> {
        let (block, lane) = self.at(env);
        lane_values(&block.acceleration, lane)
    }

    fn geom_force(&self, env: usize) -> Vec<f64> {
        let (block, lane) = self.at(env);
        lane_values(&block.geom_force, lane)
    }

    fn sunk(&self, env: usize) -> Vec<f64> {
        let (block, lane) = self.at(env);
        lane_values(&block.sunk, lane)
    }

    fn faulty(&self, env: usize) -> bool {
        let (block, lane) = self.at(env);
        L::mask_lane(block.faulty, lane)
    }

    fn copy_blocks(&self) -> Box<dyn Any + Send + Sync> {
        Box::new(self.blocks.clone())
    }

    fn restore_blocks(&mut self, blocks: &(dyn Any + Send + Sync)) -> bool {
        match blocks.downcast_ref::<Vec<Block<L>>>() {
            Some(blocks) if blocks.len() == self.blocks.len() && same_shape(&blocks[0], &self.blocks[0]) => {
                self.blocks.clone_from(blocks);
                true
            }
            _ => false,
        }
    }

    fn read_bulk(&self, quantity: Quantity, count: usize, out: &mut [f32]) {
        transfer::gather(&self.blocks, quantity, count, out);
    }

    fn base_motion(&self, env: usize) -> BaseMotion {
        let (block, lane) = self.at(env);
        let mut motion = BaseMotion { q: [0.0; 7], v: [0.0; 6], a: [0.0; 6] };
        motion.q.iter_mut().zip(&block.q).for_each(|(target, x)| *target = x.lane(lane).to_f64());
        motion.v.iter_mut().zip(&block.v).for_each(|(target, x)| *target = x.lane(lane).to_f64());
        motion.a.iter_mut().zip(&block.acceleration).for_each(|(target, x)| *target = x.lane(lane).to_f64());
        motion
    }

    fn write_commands(&mut self, shared: &BlockContext, commands: &BatchCommand) {
        transfer::write_commands(&mut self.blocks, shared.topology.joints, self.count, commands);
    }

    fn write_added_torques(&mut self, torques: &[f32]) {
        transfer::write_added_torques(&mut self.blocks, self.count, torques);
    }

    fn write_lagged_torques(&mut self, env: usize, torques: &[f64]) {
        let (block, lane) = self.at_mut(env);
        block.lagged.iter_mut().zip(torques).for_each(|(target, &x)| set(target, lane, x));
        set_mask::<L>(&mut block.settled, lane, false);
    }

    fn write_wrench(&mut self, env: usize, link: usize, wrench: [f64; 6]) {
        let (block, lane) = self.at_mut(env);
        block.any_wrench = true;
        block.wrench[link].iter_mut().zip(wrench).for_each(|(target, x)| set(target, lane, x));
    }

    fn add_velocity(&mut self, env: usize, change: &[f64]) {
        let (block, lane) = self.at_mut(env);
        for (target, &change) in block.v.iter_mut().zip(change) {
            let sum = target.lane(lane).to_f64() + change;
            set(target, lane, sum);
        }
    }

    fn read_geoms(&mut self, shared: &BlockContext, geoms: &[usize], out: GeomMotion) {
        let body = transfer::ReadGeoms {
            shared,
            blocks: &self.blocks,
            work: &mut self.works[0],
            geoms,
            count: self.count,
            out,
        };
        // Values of a register type exist only where its features were detected (`Dispatch::engine`).
        unsafe { L::with_features(body) }
    }

    fn contacts(&self, shared: &BlockContext, env: usize) -> Vec<ContactPoint> {
        let (block, lane) = self.at(env);
        transfer::contacts(block, lane, shared)
    }

    fn read_lane(&self, shared: &BlockContext, env: usize, values: &mut Vec<f64>) {
        let (block, lane) = self.at(env);
        transfer::read_lane(block, lane, &shared.topology, values);
    }

    fn write_lane(&mut self, shared: &BlockContext, env: usize, values: &[f64]) {
        let (block, lane) = self.at_mut(env);
        transfer::write_lane(block, lane, &shared.topology, values);
    }
}

fn same_shape<L: Real>(a: &Block<L>, b: &Block<L>) -> bool {
    a.q.len() == b.q.len()
        && a.v.len() == b.v.len()
        && a.commands.len() == b.commands.len()
        && a.seen.len() == b.seen.len()
        && a.geoms.len() == b.geoms.len()
        && a.materials.len() == b.materials.len()
}
