//! One robot as a rapier multibody on its ground.

use super::geometry::{RapierPose, axis_frame, rapier_pose, shape};
use super::ground::{ContactRules, GroundShape, world_from_terrain};
use super::options::RapierOptions;
use super::values::Values;
use crate::model::inertia::MassProperties;
use crate::parameters::{GeomField, JointField, WorldField};
use crate::{BaseKind, JointKind, Model, SimError, State};
use glam::{DQuat, DVec3};
use rapier3d_f64::dynamics::{
    CoefficientCombineRule, FrictionModel, GenericJoint, GenericJointBuilder, IntegrationParameters, JointAxesMask,
    JointAxis, Multibody, MultibodyIndex, RigidBodyBuilder, RigidBodyHandle, SpringCoefficients,
};
use rapier3d_f64::geometry::{ColliderBuilder, ColliderHandle, Group, InteractionGroups, InteractionTestMode};
use rapier3d_f64::pipeline::{ActiveHooks, PhysicsWorld};

/// Everything that rapier needs to step one robot.
pub(super) struct World {
    physics: PhysicsWorld,
    rules: ContactRules,
    links: Vec<RigidBodyHandle>,
    /// `None` for a free body without joints, which is no multibody.
    multibody: Option<MultibodyIndex>,
    /// First degree of freedom of each joint in the multibody.
    dofs: Vec<usize>,
    geoms: Vec<ColliderHandle>,
    /// Centre of mass of the floating base in its link frame: rapier's root frame sits there, since a root whose
    /// centre of mass lies elsewhere drifts.
    base_com: DVec3,
}

impl World {
    /// The robot in `state`, parameters as in `values`.
    ///
    /// # Errors
    /// When a body or shape cannot exist, or rapier does not take a joint.
    pub fn new(
        model: &Model,
        ground: &GroundShape,
        values: &Values,
        options: &RapierOptions,
        state: &State,
    ) -> Result<Self, SimError> {
        let bodies = (0..model.links.len()).map(|l| values.body(model, l)).collect::<Result<Vec<_>, _>>()?;
        let floating = model.base == BaseKind::Floating;
        let mut world = Self {
            physics: PhysicsWorld::new(),
            rules: ground.rules(values, model.geoms.len()),
            links: Vec::new(),
            multibody: None,
            dofs: Vec::new(),
            geoms: Vec::new(),
            base_com: if floating { bodies[0].com } else { DVec3::ZERO },
        };
        world.physics.gravity = DVec3::from_array(options.gravity);
        world.physics.integration_parameters = integration(values, options);
        world.add_ground(ground, values);
        world.add_links(model, values, &bodies, state)?;
        world.add_shapes(model, values)?;
        world.add_joint_properties(model, values);
        world.write_state(model, state);
        Ok(world)
    }

    fn add_ground(&mut self, ground: &GroundShape, values: &Values) {
        let Some(shape) = &ground.shape else { return };
        let collider = ColliderBuilder::new(shape.clone())
            .position(world_from_terrain(values))
            .collision_groups(groups(Group::GROUP_1, Group::GROUP_2));
        self.rules.ground = self.physics.colliders.insert(collider);
    }

    fn add_links(
        &mut self,
        model: &Model,
        values: &Values,
        bodies: &[MassProperties],
        state: &State,
    ) -> Result<(), SimError> {
        let fixed = (model.base == BaseKind::Fixed).then(|| self.physics.insert_body(RigidBodyBuilder::fixed()));
        for (index, link) in model.links.iter().enumerate() {
            let body = &bodies[index];
            let shift = if link.joint.is_none() { self.base_com } else { DVec3::ZERO };
            let length = link.parent.map_or(1.0, |p| values.length(p));
            let properties =
                rapier3d_f64::dynamics::MassProperties::with_inertia_matrix(body.com - shift, body.mass, body.inertia);
            let mut builder = RigidBodyBuilder::dynamic()
                .additional_mass_properties(properties)
                .can_sleep(false)
                .gyroscopic_forces_enabled(true);
            if link.joint.is_none() {
                builder = builder.pose(self.root_pose(&state.q));
            }
            let handle = self.physics.insert_body(builder);
            self.links.push(handle);
            let Some(joint) = link.joint else { continue };
            let parent = link.parent.map(|p| self.links[p]).or(fixed);
            let from =
                if link.parent.is_some_and(|p| model.links[p].joint.is_none()) { self.base_com } else { DVec3::ZERO };
            let added = parent
                .and_then(|p| self.physics.insert_multibody_joint(p, handle, joint_data(model, joint, from, length)));
            if added.is_none() {
                return Err(SimError::Joint {
                    joint: model.joints[joint].name.clone(),
                    expected: "a joint of a tree (second engine)".into(),
                    found: "one that rapier refused".into(),
                });
            }
        }
        // Mass properties given by hand only count once rapier has been through them.
        for &handle in &self.links {
            self.physics.bodies[handle].recompute_mass_properties_from_colliders(&self.physics.colliders);
        }
        self.multibody = self
            .links
            .first()
            .and_then(|&h| self.physics.multibody_joints.rigid_body_link(h))
            .map(|link| link.multibody);
        Ok(())
    }

    fn add_shapes(&mut self, model: &Model, values: &Values) -> Result<(), SimError> {
        let restitution = values.world(WorldField::Restitution);
        for (index, geom) in model.geoms.iter().enumerate() {
            let skinned = shape(model, geom, values.geom(index, GeomField::RadiusOffset), values.length(geom.link))?;
            let shift = if model.links[geom.link].joint.is_none() { self.base_com } else { DVec3::ZERO };
            let body_from_link = RapierPose::from_translation(-shift);
            let collider = ColliderBuilder::new(skinned.shape)
                .position(body_from_link * skinned.link_from_shape)
                .contact_skin(skinned.skin)
                .density(0.0)
                .restitution(restitution)
                .restitution_combine_rule(CoefficientCombineRule::Max)
                .collision_groups(groups(Group::GROUP_2, Group::GROUP_1))
                .active_hooks(ActiveHooks::MODIFY_SOLVER_CONTACTS)
                .user_data(index as u128);
            let (colliders, bodies) = (&mut self.physics.colliders, &mut self.physics.bodies);
            self.geoms.push(colliders.insert_with_parent(collider, self.links[geom.link], bodies));
        }
        Ok(())
    }

    fn multibody_mut(&mut self) -> Option<&mut Multibody> {
        self.physics.multibody_joints.get_multibody_mut(self.multibody?)
    }

    /// Armature and friction of the joints; nothing damps but what is asked for (rapier's default is 0.1 everywhere).
    fn add_joint_properties(&mut self, model: &Model, values: &Values) {
        let Some(index) = self.multibody else { return };
        let Some(multibody) = self.physics.multibody_joints.get_multibody_mut(index) else { return };
        // Only now does rapier learn whether the root moves, and count degrees of freedom accordingly.
        multibody.forward_kinematics(&self.physics.bodies, true);
        multibody.damping_mut().fill(0.0);
        self.dofs = vec![0; model.joints.len()];
        for (joint, nominal) in model.joints.iter().enumerate() {
            let handle = self.links[nominal.link];
            let own = multibody.links().find(|link| link.rigid_body_handle() == handle).map(|link| link.assembly_id());
            let Some(dof) = own else { continue };
            self.dofs[joint] = dof;
            multibody.armature_mut()[dof] = values.joint(joint, JointField::Armature);
            multibody.damping_mut()[dof] = values.joint(joint, JointField::Viscous);
            multibody.frictions_mut()[dof] = values.joint(joint, JointField::Coulomb);
        }
    }

    /// Pose of the root body: at the base's centre of mass, along its axes.
    fn root_pose(&self, q: &[f64]) -> RapierPose {
        let rotation = DQuat::from_xyzw(q[4], q[5], q[6], q[3]);
        RapierPose::from_parts(DVec3::new(q[0], q[1], q[2]) + rotation * self.base_com, rotation)
    }

    fn write_state(&mut self, model: &Model, state: &State) {
        let floating = model.base == BaseKind::Floating;
        let offset = model.nq() - model.joints.len();
        let mut root = (DVec3::ZERO, DVec3::ZERO);
        if floating {
            let v = &state.v;
            let rotation = self.root_pose(&state.q).rotation;
            let turning = rotation * DVec3::new(v[3], v[4], v[5]);
            root = (DVec3::new(v[0], v[1], v[2]) + turning.cross(rotation * self.base_com), turning);
        }
        let dofs = self.dofs.clone();
        let Some(index) = self.multibody else {
            let body = &mut self.physics.bodies[self.links[0]];
            body.set_linvel(root.0, true);
            body.set_angvel(root.1, true);
            return;
        };
        let Some(multibody) = self.physics.multibody_joints.get_multibody_mut(index) else { return };
        let mut displacement = vec![0.0; multibody.ndofs()];
        let mut speed = vec![0.0; multibody.ndofs()];
        if floating {
            speed[..3].copy_from_slice(&root.0.to_array());
            speed[3..6].copy_from_slice(&root.1.to_array());
        }
        for (joint, &dof) in dofs.iter().enumerate() {
            displacement[dof] = state.q[offset + joint];
            speed[dof] = state.v[model.base_dofs() + joint];
        }
        multibody.apply_displacements(&displacement);
        multibody.generalized_velocity_mut().copy_from_slice(&speed);
        multibody.forward_kinematics(&self.physics.bodies, false);
        multibody.update_rigid_bodies(&mut self.physics.bodies, true);
    }

    /// Positions and velocities after the last step.
    pub fn state(&mut self, model: &Model) -> State {
        let (mut q, mut v) = (Vec::with_capacity(model.nq()), Vec::with_capacity(model.nv()));
        if model.base == BaseKind::Floating {
            let body = &self.physics.bodies[self.links[0]];
            let (pose, mut moving, mut turning) = (*body.position(), body.linvel(), body.angvel());
            if let Some(multibody) = self.multibody_mut() {
                // A body's own velocity lags behind the multibody's by a substep.
                let speed = multibody.generalized_velocity();
                moving = DVec3::new(speed[0], speed[1], speed[2]);
                turning = DVec3::new(speed[3], speed[4], speed[5]);
            }
            let rotation = pose.rotation.normalize();
            let arm = rotation * self.base_com;
            let origin = pose.translation - arm;
            q.extend(origin.to_array());
            q.extend([rotation.w, rotation.x, rotation.y, rotation.z]);
            v.extend((moving - turning.cross(arm)).to_array());
            v.extend((rotation.conjugate() * turning).to_array());
        }
        let dofs = self.dofs.clone();
        let links: Vec<RigidBodyHandle> = model.joints.iter().map(|joint| self.links[joint.link]).collect();
        if let Some(multibody) = self.multibody_mut() {
            for (joint, handle) in model.joints.iter().zip(&links) {
                let own = multibody.links().find(|link| link.rigid_body_handle() == *handle);
                let coords = own.map(|link| link.joint().coords());
                let axis = if joint.kind == JointKind::Revolute { 3 } else { 0 };
                q.push(coords.map_or(f64::NAN, |coords| coords[axis]));
            }
            v.extend(dofs.iter().map(|&dof| multibody.generalized_velocity()[dof]));
        }
        State { q, v }
    }

    /// Torques \[N m\] of all joints and the outside force \[N\] on the base for the coming step. Rapier has no
    /// torque on a joint: the moved link gets it, the other one its opposite.
    pub fn apply(&mut self, model: &Model, torque: &[f64], outside: DVec3) {
        let bodies = &mut self.physics.bodies;
        for &handle in &self.links {
            bodies[handle].reset_forces(true);
            bodies[handle].reset_torques(true);
        }
        for (joint, &torque) in model.joints.iter().zip(torque) {
            let handle = self.links[joint.link];
            let parent = model.links[joint.link].parent.map(|p| self.links[p]);
            let pose = *bodies[handle].position();
            let push = pose.rotation * joint.axis * torque;
            let at = pose.translation;
            match joint.kind {
                JointKind::Revolute => {
                    bodies[handle].add_torque(push, true);
                    if let Some(parent) = parent {
                        bodies[parent].add_torque(-push, true);
                    }
                }
                JointKind::Prismatic => {
                    bodies[handle].add_force_at_point(push, at, true);
                    if let Some(parent) = parent {
                        bodies[parent].add_force_at_point(-push, at, true);
                    }
                }
            }
        }
        if model.base == BaseKind::Floating {
            bodies[self.links[0]].add_force(outside, true);
        }
    }

    /// Advances by one time step.
    pub fn step(&mut self) {
        self.physics.step_with_events(&self.rules, &());
    }

    /// Normal force of each shape on the ground \[N\], mean over the last step.
    pub fn ground_forces(&self, count: usize) -> Vec<f64> {
        let step = self.physics.integration_parameters.dt;
        (0..count)
            .map(|g| {
                let pair = self.physics.narrow_phase.contact_pair(self.rules.ground, self.geoms[g]);
                pair.map_or(0.0, |pair| pair.total_impulse_magnitude() / step)
            })
            .collect()
    }
}

fn groups(own: Group, others: Group) -> InteractionGroups {
    InteractionGroups::new(own, others, InteractionTestMode::And)
}

/// A joint of one degree of freedom; `parent_com` is how far the parent's frame was moved, `parent_length` its `length_scale`.
fn joint_data(model: &Model, index: usize, parent_com: DVec3, parent_length: f64) -> GenericJoint {
    let joint = &model.joints[index];
    let frame = axis_frame(joint.axis);
    let mut parent_from_link = rapier_pose(&model.links[joint.link].parent_from_link);
    parent_from_link.translation = parent_from_link.translation * parent_length - parent_com;
    let turned = RapierPose::from_parts(DVec3::ZERO, frame);
    let (mask, axis) = match joint.kind {
        JointKind::Revolute => (JointAxesMask::LOCKED_REVOLUTE_AXES, JointAxis::AngX),
        JointKind::Prismatic => (JointAxesMask::LOCKED_PRISMATIC_AXES, JointAxis::LinX),
    };
    let mut builder = GenericJointBuilder::new(mask)
        .local_frame1(parent_from_link * turned)
        .local_frame2(turned)
        .contacts_enabled(false);
    if joint.lower.is_finite() || joint.upper.is_finite() {
        builder = builder.limits(axis, [joint.lower.max(-1e9), joint.upper.min(1e9)]);
    }
    builder.build()
}

/// Share of the constraint that a contact of the catalogue's terms fulfils at once (MuJoCo's largest impedance).
const IMPEDANCE: f64 = 0.95;

/// Solver settings. A contact of the catalogue, of time constant T and damping ratio z, pushes back with stiffness
/// k / (T z)² and damping 2 k / T per unit of mass, k = d / (1 - d) of its impedance d; rapier is given the spring and
/// damper of the same two numbers, frequency √k / (T z) and damping ratio √k z.
fn integration(values: &Values, options: &RapierOptions) -> IntegrationParameters {
    let (time_constant, ratio) = (values.world(WorldField::TimeConstant), values.world(WorldField::DampingRatio));
    let firmness = (IMPEDANCE / (1.0 - IMPEDANCE)).sqrt();
    let frequency = firmness / (std::f64::consts::TAU * time_constant * ratio);
    IntegrationParameters {
        dt: options.timestep,
        num_solver_iterations: options.substeps,
        static_contact_softness: SpringCoefficients::new(frequency, firmness * ratio),
        // Defaults are for bodies of a metre: half a centimetre of overlap is a lot for a foot.
        normalized_allowed_linear_error: 1e-5,
        normalized_prediction_distance: 0.005,
        // Both are approximations to save time.
        contact_clustering: false,
        contact_recycling: false,
        // The other model slips at nine tenths of the friction of a box.
        friction_model: FrictionModel::Simplified,
        ..Default::default()
    }
}
