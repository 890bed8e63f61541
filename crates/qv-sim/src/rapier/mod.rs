//! A second engine behind the same questions: rapier's reduced-coordinate multibodies, with actuators and sensors of
//! their own. Nothing is tuned against it and it is tuned against nothing: it shows which findings are the simulator's.
//!
//! It takes the model, terrain, states, commands and parameters of [`crate::Batch`], one environment at a time. What
//! differs: contacts are rapier's (velocity-level solver, several substeps per step, spring and damper of the contact's
//! own time constant), joint friction is rapier's, controllers act explicitly, and a fault of the numbers ends a run.

mod compare;
mod geometry;
mod ground;
mod motors;
mod options;
mod readings;
mod values;
mod world;

pub use compare::{EngineDifference, Motion, compare_engines};
pub use options::{LONGEST_DELAY, RapierOptions};

use crate::error::{finite, length};
use crate::parameters::{ActsOn, Catalogue, JointField, WorldField};
use crate::{BaseKind, JointCommand, Model, ParameterInfo, SensorReading, SimError, State, Terrain};
use motors::Motors;
use readings::History;
use std::collections::BTreeMap;
use values::Values;
use world::World;

/// One robot on one terrain in the second engine.
pub struct RapierEngine {
    model: Model,
    terrain: Terrain,
    options: RapierOptions,
    catalogue: Catalogue,
    /// Parameters that are not neutral.
    overrides: BTreeMap<usize, f64>,
    state: State,
    time: f64,
    faulty: bool,
    motors: Motors,
    history: History,
    ground: ground::GroundShape,
    /// Built when it is next needed: a parameter of bodies, joints or ground that changes drops it.
    world: Option<World>,
}

impl RapierEngine {
    /// A robot at rest in the zero position, all parameters neutral.
    ///
    /// # Errors
    /// When an option means nothing, a link has no mass, or the ground's triangles cannot be used.
    pub fn new(model: &Model, terrain: &Terrain, options: &RapierOptions) -> Result<Self, SimError> {
        options.check()?;
        if let Some(link) = model.links.iter().find(|link| link.mass <= 0.0) {
            let (expected, found) = ("a mass above 0 kg (second engine)".into(), format!("{} kg", link.mass));
            return Err(SimError::Link { link: link.name.clone(), expected, found });
        }
        let mut q = vec![0.0; model.nq()];
        if model.base == BaseKind::Floating {
            q[3] = 1.0;
        }
        let state = State { q, v: vec![0.0; model.nv()] };
        Ok(Self {
            model: model.clone(),
            terrain: terrain.clone(),
            options: options.clone(),
            catalogue: Catalogue::new(model, terrain),
            overrides: BTreeMap::new(),
            time: 0.0,
            faulty: false,
            motors: Motors::new(&state.q[model.nq() - model.joints.len()..]),
            history: History::new(&state, model),
            ground: ground::GroundShape::new(terrain)?,
            world: None,
            state,
        })
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The ground.
    pub fn terrain(&self) -> &Terrain {
        &self.terrain
    }

    /// The settings.
    pub fn options(&self) -> &RapierOptions {
        &self.options
    }

    /// All parameters by name, those that this engine lacks included.
    pub fn catalogue(&self) -> &[ParameterInfo] {
        &self.catalogue.infos
    }

    /// Sets positions and velocities, sets the time to zero and forgets commands, lags and a fault. The quaternion is
    /// normalised.
    ///
    /// # Errors
    /// When a length is off, a number is not finite, or the quaternion is zero.
    pub fn set_state(&mut self, state: &State) -> Result<(), SimError> {
        length("positions", self.model.nq(), state.q.len())?;
        length("velocities", self.model.nv(), state.v.len())?;
        finite("position", &state.q)?;
        finite("velocity", &state.v)?;
        let mut state = state.clone();
        if self.model.base == BaseKind::Floating {
            let norm = state.q[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm < 1e-6 {
                let (what, expected) = ("length of the base quaternion".into(), "1".into());
                return Err(SimError::Value { what, expected, found: norm });
            }
            state.q[3..7].iter_mut().for_each(|x| *x /= norm);
        }
        self.motors = Motors::new(&state.q[self.model.nq() - self.model.joints.len()..]);
        self.history = History::new(&state, &self.model);
        self.state = state;
        self.time = 0.0;
        self.faulty = false;
        self.world = None;
        Ok(())
    }

    /// Positions and velocities, as in [`crate::Batch::state`].
    pub fn state(&self) -> State {
        self.state.clone()
    }

    /// Sets the command that is held from the next step on.
    ///
    /// # Errors
    /// When a length is off or a number is not finite.
    pub fn set_command(&mut self, command: &JointCommand) -> Result<(), SimError> {
        command.check(self.model.joints.len())?;
        self.motors.hold(command);
        Ok(())
    }

    /// Sets a parameter of the catalogue; it acts from the next step on. What belongs to bodies, joints or ground makes
    /// the next step build its world anew, and the contact solver forget; motors, sensors and outside forces may change
    /// at every step.
    ///
    /// # Errors
    /// When the name is unknown, the value means nothing, or the parameter has no counterpart in this engine (a
    /// neutral value is then accepted).
    pub fn set_parameter(&mut self, name: &str, value: f64) -> Result<(), SimError> {
        let id = self.catalogue.find(name)?;
        self.set_parameter_at(id, value)
    }

    /// Index of a parameter in the catalogue, for [`RapierEngine::set_parameter_at`].
    ///
    /// # Errors
    /// When the name is unknown; the error suggests the nearest one.
    pub fn parameter_index(&self, name: &str) -> Result<usize, SimError> {
        self.catalogue.find(name)
    }

    /// Sets a parameter by its index in the catalogue.
    ///
    /// # Errors
    /// As [`RapierEngine::set_parameter`], and when there is no such index.
    pub fn set_parameter_at(&mut self, id: usize, value: f64) -> Result<(), SimError> {
        let Some(info) = self.catalogue.infos.get(id) else {
            return Err(SimError::Length { what: "catalogue", expected: self.catalogue.infos.len(), found: id });
        };
        self.catalogue.check(id, value)?;
        let (slot, neutral) = (info.acts_on, value == info.neutral);
        if !neutral && let Some(reason) = lacking(slot) {
            return Err(SimError::NotInSecondEngine { name: info.name.clone(), reason });
        }
        let before = if neutral { self.overrides.remove(&id) } else { self.overrides.insert(id, value) };
        if !is_built_in(slot) && !is_delay(slot) {
            return Ok(());
        }
        let checked = self.check_values();
        if checked.is_err() {
            match before {
                Some(value) => self.overrides.insert(id, value),
                None => self.overrides.remove(&id),
            };
        }
        if is_built_in(slot) {
            self.world = None;
        }
        checked
    }

    /// Value of a parameter.
    ///
    /// # Errors
    /// When the name is unknown.
    pub fn parameter(&self, name: &str) -> Result<f64, SimError> {
        let id = self.catalogue.find(name)?;
        Ok(self.overrides.get(&id).copied().unwrap_or(self.catalogue.infos[id].neutral))
    }

    fn values(&self) -> Values<'_> {
        Values::new(&self.catalogue, &self.overrides)
    }

    /// Bodies that can exist, delays that are kept, shapes that have a radius left.
    fn check_values(&self) -> Result<(), SimError> {
        let values = self.values();
        for link in 0..self.model.links.len() {
            values.body(&self.model, link)?;
        }
        values.delays(&self.model)
    }

    /// One time step. After a fault (see [`RapierEngine::is_faulty`]) nothing moves until the next state is set.
    ///
    /// # Errors
    /// When the world cannot be built from the parameters that are set.
    pub fn step(&mut self) -> Result<(), SimError> {
        if self.faulty {
            return Ok(());
        }
        let values = Values::new(&self.catalogue, &self.overrides);
        let mut world = match self.world.take() {
            Some(world) => world,
            None => World::new(&self.model, &self.ground, &values, &self.options, &self.state)?,
        };
        let offset = self.model.nq() - self.model.joints.len();
        let (q, dq) = (&self.state.q[offset..], &self.state.v[self.model.base_dofs()..]);
        let mut torque = self.motors.torques(&values, self.time, self.options.timestep, q, dq);
        let reported = torque.clone();
        let share = values.external_share(self.time, self.options.timestep);
        values.add_external_torques(share, &mut torque);
        world.apply(&self.model, &torque, values.external_force() * share);
        world.step();
        let state = world.state(&self.model);
        let runaway = |x: &f64| !(x.is_finite() && x.abs() < 1e6);
        if state.q.iter().chain(&state.v).any(runaway) {
            self.faulty = true;
            return Ok(());
        }
        let force = world.ground_forces(self.model.geoms.len());
        self.state = state;
        self.time += self.options.timestep;
        let values = Values::new(&self.catalogue, &self.overrides);
        self.history.push(&self.state, &values, self.options.timestep, reported, force);
        self.world = Some(world);
        Ok(())
    }

    /// Whether the numbers ran away; the robot then stays where it last was finite until [`RapierEngine::set_state`].
    pub fn is_faulty(&self) -> bool {
        self.faulty
    }

    /// What the robot's sensors report, as [`crate::Batch::sensors`] does, from this engine's motion.
    pub fn sensors(&self) -> SensorReading {
        self.history.read(&self.model, &self.values(), &self.options)
    }
}

/// Why a parameter has no counterpart in rapier; `None` when it has one.
fn lacking(acts_on: ActsOn) -> Option<&'static str> {
    match acts_on {
        ActsOn::World(WorldField::Torsional) => Some("contacts without torsional friction of a given length"),
        ActsOn::World(WorldField::Rolling) => Some("contacts without rolling friction"),
        ActsOn::World(WorldField::FrictionDrop | WorldField::FrictionSpeed) => {
            Some("contacts whose friction does not change with slip")
        }
        ActsOn::World(WorldField::YieldForce | WorldField::SinkRate) => Some("ground that does not give way for good"),
        ActsOn::Joint(_, field) => {
            use JointField::*;
            let of_servo = matches!(
                field,
                StribeckFriction
                    | StribeckSpeed
                    | StribeckExponent
                    | LoadMotor
                    | LoadExternal
                    | StribeckLoadMotor
                    | StribeckLoadExternal
                    | QuadraticLoadMotor
                    | QuadraticLoadExternal
                    | QuadraticDrag
            );
            let beside = matches!(field, ConstantTorque | SpringStiffness | SpringRest | SpringSlack);
            of_servo
                .then_some("joints without friction of geared servos")
                .or(beside.then_some("joints without springs and constant torques"))
        }
        _ => None,
    }
}

/// Whether it delays a command or what a sensor reports.
fn is_delay(acts_on: ActsOn) -> bool {
    acts_on.is_sensor_latency() || matches!(acts_on, ActsOn::Joint(_, JointField::CommandLatency))
}

/// Whether bodies, joints and ground are made of it. The rest is read at every step.
fn is_built_in(acts_on: ActsOn) -> bool {
    use WorldField::*;
    match acts_on {
        ActsOn::Joint(_, field) => matches!(field, JointField::Armature | JointField::Viscous | JointField::Coulomb),
        ActsOn::Link(..) | ActsOn::Geom(..) | ActsOn::Material(_) => true,
        ActsOn::World(Friction | TimeConstant | DampingRatio | Restitution | Torsional | Rolling) => true,
        ActsOn::World(Height | SlopeX | SlopeY) => true,
        ActsOn::World(PatchXMin | PatchXMax | PatchYMin | PatchYMax | PatchFriction) => true,
        ActsOn::World(_) => false,
    }
}
