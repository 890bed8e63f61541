//! Data of one block of environments, one per lane.

use super::array::Array;
use super::rows::{ActsOn, Rows};
use super::scratch::Scratch;
use super::topology::Topology;
use super::transmission::{ServoFriction, SpringLanes};
use super::vector::{Inertia, M3, V3, V6};
use crate::commands::JointCommand;
use crate::lanes::{Mask, Real};
use crate::model::{Model, Shape};
pub(crate) use crate::motor::CommandLanes;
use crate::motor::Law;

/// Parameters of one joint in each environment, ready for use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointLanes<L> {
    pub law: Law<L>,
    /// Share of the way to the demanded torque in one step: 1 without lag.
    pub lag_gain: L,
    /// Command latency in steps.
    pub latency: L,
    pub encoder_bias: L,
    pub external_torque: L,
    /// Change of strength per time \[1/s\].
    pub drift: L,
    pub servo: ServoFriction<L>,
    pub constant_torque: L,
    pub spring: SpringLanes<L>,
}

/// Ground of each environment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroundLanes<L> {
    pub friction: L,
    /// Stiffness over impedance and damping of the reference acceleration.
    pub stiffness: L,
    pub damping: L,
    pub torsional: L,
    pub rolling: L,
    /// Share of friction that is gone at speed.
    pub drop: L,
    /// Slip at which 1 - 1/e of that is gone \[m/s\].
    pub drop_speed: L,
    /// Normal force beyond which a shape sinks in for good \[N\], and how fast \[m/(N s)\].
    pub yield_force: L,
    pub sink_rate: L,
    pub height: L,
    /// World from terrain rotation.
    pub tilt: M3<L>,
    /// x min, x max, y min, y max in terrain coordinates.
    pub patch: [L; 4],
    pub patch_friction: L,
    pub force: V3<L>,
    pub force_start: L,
    pub force_end: L,
}

/// What all motors of each environment are fed by.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SupplyLanes<L> {
    /// Time of the run at which the block's time is 0.
    pub start: L,
    /// Share of torque lost per power \[1/W\].
    pub sag: L,
}

/// Feet and other shapes of each environment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GeomLanes<L> {
    pub friction_scale: L,
    pub radius_offset: L,
}

impl<L: Real> CommandLanes<L> {
    pub fn zero() -> Self {
        let z = L::zero();
        Self { q: z, dq: z, kp: z, kd: z, tau: z }
    }
}

/// State and parameters of `L::LANES` environments.
#[derive(Debug, Clone)]
pub(crate) struct Block<L: Real> {
    // State.
    pub q: Array<L>,
    pub v: Array<L>,
    /// Acceleration before implicit damping, where the next solve starts.
    pub warm: Array<L>,
    /// Acceleration of the last step.
    pub acceleration: Array<L>,
    /// Torque of each joint after lag and limits.
    pub torque: Array<L>,
    pub lagged: Array<L>,
    /// Motor-side position behind the backlash.
    pub motor: Array<L>,
    pub time: L,
    /// Commands of the last steps, `[age slot][joint]`, newest at `head`.
    pub commands: Array<CommandLanes<L>>,
    pub head: usize,
    /// Positions and velocities of the last steps, `[age slot][nq + nv]`, newest at `seen_head`; joints where the encoders of their motors are.
    pub seen: Vec<L>,
    pub seen_head: usize,
    /// Normal force of each shape on the ground \[N\].
    pub geom_force: Array<L>,
    /// Force of the ground on each shape in the world \[N\], `[geom][3]`.
    pub geom_push: Array<L>,
    /// How deep each shape has pressed the ground under it for good \[m\].
    pub sunk: Array<L>,
    /// How fast it does \[m/s\].
    pub sinking: Array<L>,
    /// Torque of contacts and limits on each joint in the last step, kept where friction grows with load \[N m\].
    pub load: Array<L>,
    /// Torque that callers add to what each motor delivers \[N m\].
    pub added_torque: Array<L>,
    /// Torque, then force, that callers apply at each link's centre of mass, world axes.
    pub wrench: Array<V6<L>>,
    /// Contacts of the last step, one per slot; empty unless they are kept.
    pub kept: Vec<KeptContact<L>>,
    /// Lanes whose lags nobody watched since their state was set: they are taken to have settled.
    pub settled: L::Mask,
    /// Lanes that were not reported what was in force before: they take their first command as all earlier ones, too.
    pub pastless: L::Mask,
    /// Lanes whose numbers ran away.
    pub faulty: L::Mask,
    // Parameters.
    pub mass: Array<L>,
    pub com: Array<V3<L>>,
    /// True over modelled distance of what is fixed to a body from its own joint.
    pub length: Array<L>,
    /// xx, yy, zz, xy, xz, yz about the centre of mass, link axes.
    pub inertia: Array<[L; 6]>,
    /// Per degree of freedom.
    pub armature: Array<L>,
    pub viscous: Array<L>,
    pub coulomb: Array<L>,
    pub joints: Array<JointLanes<L>>,
    pub geoms: Array<GeomLanes<L>>,
    pub materials: Array<L>,
    pub ground: GroundLanes<L>,
    pub supply: SupplyLanes<L>,
    // Which of the costlier features any lane uses. They change the work, never the result.
    pub any_coulomb: bool,
    pub any_viscous: bool,
    pub any_servo: bool,
    pub any_spring: bool,
    pub any_latency: bool,
    pub any_compliance: bool,
    pub any_fading: bool,
    pub any_weakening: bool,
    pub any_sinking: bool,
    pub any_added: bool,
    pub any_wrench: bool,
}

/// A contact as it was solved.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KeptContact<L: Real> {
    pub active: L::Mask,
    pub normal: V3<L>,
    /// In the world.
    pub point: V3<L>,
    pub distance: L,
    /// On the robot, in the world.
    pub force: V3<L>,
}

impl<L: Real> KeptContact<L> {
    pub fn none() -> Self {
        let zero = [L::zero(); 3];
        Self { active: L::Mask::splat(false), normal: zero, point: zero, distance: L::zero(), force: zero }
    }
}

/// One point at which a shape can touch something.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contact<L: Real> {
    pub active: L::Mask,
    /// From terrain (or the second body) to the robot.
    pub normal: V3<L>,
    /// Relative to the base origin.
    pub point: V3<L>,
    pub distance: L,
    pub friction: L,
}

/// Scratch space of one thread.
#[derive(Debug, Clone)]
pub(crate) struct Work<L: Real> {
    pub rotation: Array<M3<L>>,
    pub position: Array<V3<L>>,
    /// Joint axes as spatial vectors, per degree of freedom.
    pub subspace: Array<V6<L>>,
    pub velocity: Array<V6<L>>,
    pub acceleration: Array<V6<L>>,
    pub force: Array<V6<L>>,
    pub inertia: Array<Inertia<L>>,
    pub bias: Array<L>,
    pub mass_matrix: Array<L>,
    pub hessian: Array<L>,
    /// Damping that the integrator treats implicitly, per degree of freedom.
    pub implicit: Array<L>,
    /// All forces but those of constraints.
    pub smooth: Array<L>,
    pub contacts: Array<Contact<L>>,
    /// Slots with a contact in any lane.
    pub live: Vec<usize>,
    /// Of each shape, where ground may give way: its least distance from the ground as it was, then its normal force on the ground.
    pub of_geom: Array<L>,
    pub rows: Rows<L>,
    pub newton: Scratch<L>,
    pub triangles: Vec<crate::terrain::Triangle>,
    pub found: Vec<crate::terrain::SurfaceContact>,
}

impl<L: Real> Work<L> {
    pub fn new(topology: &Topology, slots: &[ActsOn], geoms: usize, dimension: usize) -> Self {
        let zero = L::zero();
        let (bodies, nv) = (topology.bodies.len(), topology.nv);
        let none = Contact {
            active: L::Mask::splat(false),
            normal: [zero; 3],
            point: [zero; 3],
            distance: zero,
            friction: zero,
        };
        Self {
            rotation: vec![[zero; 9]; bodies].into(),
            position: vec![[zero; 3]; bodies].into(),
            subspace: vec![[zero; 6]; nv].into(),
            velocity: vec![[zero; 6]; bodies].into(),
            acceleration: vec![[zero; 6]; bodies].into(),
            force: vec![[zero; 6]; bodies].into(),
            inertia: vec![[zero; 10]; bodies].into(),
            bias: vec![zero; nv].into(),
            mass_matrix: vec![zero; topology.packed].into(),
            hessian: vec![zero; topology.packed].into(),
            implicit: vec![zero; nv].into(),
            smooth: vec![zero; nv].into(),
            contacts: vec![none; slots.len()].into(),
            live: Vec::with_capacity(slots.len()),
            of_geom: vec![zero; geoms].into(),
            rows: Rows::new(topology, slots, dimension),
            newton: Scratch::new(topology, slots.len()),
            triangles: Vec::new(),
            found: Vec::new(),
        }
    }
}

impl<L: Real> Block<L> {
    /// The kept rows of `width` numbers before and after `age` \[steps\], and how far the age is from the first to the second.
    pub fn past_rows(&self, age: f64, width: usize) -> ([&[L]; 2], f64) {
        let kept = self.seen.len() / width;
        let whole = (age.floor() as usize).min(kept - 1);
        let share = (age - whole as f64).clamp(0.0, 1.0);
        let row = |age: usize| &self.seen[((self.seen_head + kept - age.min(kept - 1)) % kept) * width..][..width];
        ([row(whole), row(whole + 1)], share)
    }

    /// All lanes at rest in the model's zero position, with parameters still to be derived.
    pub fn new(model: &Model, topology: &Topology, materials: usize, commands: usize, seen: usize) -> Self {
        let zero = L::zero();
        let mut q = vec![zero; topology.nq];
        if topology.free_base {
            q[3] = L::one();
        }
        let law = Law {
            strength: zero,
            asymmetry: zero,
            kp_scale: zero,
            kd_scale: zero,
            torque_limit: zero,
            position_torque_limit: zero,
            speed_knee: zero,
            speed_slope: zero,
            half_backlash: zero,
            compliance: zero,
        };
        let joint = JointLanes {
            law,
            lag_gain: zero,
            latency: zero,
            encoder_bias: zero,
            external_torque: zero,
            drift: zero,
            servo: ServoFriction::none(),
            constant_torque: zero,
            spring: SpringLanes::none(),
        };
        let ground = GroundLanes {
            friction: zero,
            stiffness: zero,
            damping: zero,
            torsional: zero,
            rolling: zero,
            drop: zero,
            drop_speed: L::one(),
            yield_force: zero,
            sink_rate: zero,
            height: zero,
            tilt: [zero; 9],
            patch: [zero; 4],
            patch_friction: zero,
            force: [zero; 3],
            force_start: zero,
            force_end: zero,
        };
        let (nv, joints, links) = (topology.nv, topology.joints, model.links.len());
        Self {
            q: q.into(),
            v: vec![zero; nv].into(),
            warm: vec![zero; nv].into(),
            acceleration: vec![zero; nv].into(),
            torque: vec![zero; joints].into(),
            lagged: vec![zero; joints].into(),
            motor: vec![zero; joints].into(),
            time: zero,
            commands: vec![CommandLanes::zero(); commands * joints].into(),
            head: 0,
            seen: vec![zero; seen * (topology.nq + nv)],
            seen_head: 0,
            geom_force: vec![zero; model.geoms.len()].into(),
            geom_push: vec![zero; 3 * model.geoms.len()].into(),
            sunk: vec![zero; model.geoms.len()].into(),
            sinking: vec![zero; model.geoms.len()].into(),
            load: vec![zero; joints].into(),
            added_torque: vec![zero; joints].into(),
            wrench: vec![[zero; 6]; links].into(),
            kept: Vec::new(),
            settled: L::Mask::splat(true),
            pastless: L::Mask::splat(true),
            faulty: L::Mask::splat(false),
            mass: vec![zero; links].into(),
            com: vec![[zero; 3]; links].into(),
            length: vec![zero; links].into(),
            inertia: vec![[zero; 6]; links].into(),
            armature: vec![zero; nv].into(),
            viscous: vec![zero; nv].into(),
            coulomb: vec![zero; nv].into(),
            joints: vec![joint; joints].into(),
            geoms: vec![GeomLanes { friction_scale: zero, radius_offset: zero }; model.geoms.len()].into(),
            materials: vec![zero; materials].into(),
            ground,
            supply: SupplyLanes { start: zero, sag: zero },
            any_coulomb: false,
            any_viscous: false,
            any_servo: false,
            any_spring: false,
            any_latency: false,
            any_compliance: false,
            any_fading: false,
            any_weakening: false,
            any_sinking: false,
            any_added: false,
            any_wrench: false,
        }
    }

    /// How far the encoder of a motor is ahead of its joint, under the torque of the last step; nothing without a spring between them.
    #[inline(always)]
    pub fn deflection(&self, joint: usize) -> L {
        self.joints[joint].law.compliance * self.torque[joint]
    }

    /// Gives all lanes one command.
    pub fn command_all(&mut self, joints: usize, command: &JointCommand) {
        let slots = (self.commands.len() / joints.max(1)).max(1);
        let ages = if self.pastless.any() { slots } else { 1 };
        for age in 0..ages {
            let every = L::Mask::splat(age == 0) | self.pastless;
            let slot = (self.head + slots - age) % slots;
            for j in 0..joints {
                let target = &mut self.commands[slot * joints + j];
                target.q = L::select(every, L::splat(command.q[j]), target.q);
                target.dq = L::select(every, L::splat(command.dq[j]), target.dq);
                target.kp = L::select(every, L::splat(command.kp[j]), target.kp);
                target.kd = L::select(every, L::splat(command.kd[j]), target.kd);
                target.tau = L::select(every, L::splat(command.tau[j]), target.tau);
            }
        }
    }

    /// Bytes that this block holds on the heap.
    pub fn bytes(&self) -> usize {
        let lanes = self.q.len()
            + 4 * self.v.len()
            + 3 * self.torque.len()
            + 5 * self.commands.len()
            + self.seen.len()
            + self.geom_force.len()
            + self.geom_push.len()
            + 2 * self.sunk.len()
            + self.load.len()
            + self.added_torque.len()
            + 6 * self.wrench.len()
            + 10 * self.kept.len()
            + 10 * self.mass.len()
            + 3 * self.armature.len()
            + (size_of::<JointLanes<L>>() / size_of::<L>()) * self.joints.len()
            + 2 * self.geoms.len()
            + self.materials.len();
        lanes * size_of::<L>() + size_of::<Self>()
    }
}

/// How many points of a shape can touch a plane, or a surface of triangles, at once. Where inner edges are felt, a
/// sphere near a corner of the grid touches all six triangles around it.
pub(crate) fn contact_points(shape: &Shape, plane: bool, inner_edges: bool) -> usize {
    match shape {
        Shape::Sphere(_) if plane => 1,
        Shape::Capsule { .. } if plane => 2,
        Shape::Sphere(_) | Shape::Capsule { .. } if !inner_edges => 4,
        _ => 8,
    }
}
