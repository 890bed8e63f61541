//! Many environments of one robot on one terrain: the public face of the engine.

mod bulk;
pub(crate) mod lanes_of;
pub(crate) mod quantities;
mod transfer;

pub use bulk::LaneState;
pub use lanes_of::Precision;
pub use quantities::ContactPoint;

use crate::SimError;
use crate::commands::JointCommand;
use crate::engine::block::{Block, Work};
use crate::engine::collide::Colliders;
use crate::engine::derive::Deriver;
use crate::engine::step::BlockContext;
use crate::engine::topology::Topology;
use crate::engine::weights::Weights;
use crate::error::{finite, length};
use crate::model::Model;
use crate::options::SimOptions;
use crate::parameters::{Catalogue, ParameterInfo};
use crate::sensors::SensorReading;
use crate::terrain::Terrain;
use lanes_of::Engine;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::OnceLock;

/// Positions and velocities of one environment.
///
/// A floating base takes the first seven positions (x, y, z \[m\], quaternion w, x, y, z) and the first six velocities
/// (linear in world \[m/s\], angular in the base \[rad/s\]); joints follow in model order.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Shape `[nq]`.
    pub q: Vec<f64>,
    /// Shape `[nv]`.
    pub v: Vec<f64>,
}

/// A copy of all states and parameters of a batch.
pub struct Snapshot<T: Precision> {
    blocks: Box<dyn std::any::Any + Send + Sync>,
    overrides: Vec<BTreeMap<usize, f64>>,
    /// Of the model and options that it was made with.
    identity: u64,
    precision: std::marker::PhantomData<T>,
}

/// `count` environments, stepped together.
pub struct Batch<T: Precision> {
    model: Model,
    shared: BlockContext,
    catalogue: Catalogue,
    engine: Box<dyn Engine>,
    /// Parameters that are not neutral, per environment.
    overrides: Vec<BTreeMap<usize, f64>>,
    /// All parameters of one environment, `loaded`; neutral ones if there is none.
    values: Vec<f64>,
    loaded: Option<usize>,
    imu: Option<usize>,
    /// Reports snapshots of another model or other options; found when the first is taken.
    identity: OnceLock<u64>,
    /// Where lanes pass through on their way to others.
    passing: Vec<f64>,
    precision: std::marker::PhantomData<T>,
}

impl<T: Precision> Batch<T> {
    /// `count` environments of `model` on `terrain`, at rest in the zero position, all parameters neutral.
    ///
    /// # Errors
    /// When an option means nothing, or `count` is zero.
    pub fn new(model: &Model, terrain: &Terrain, options: &SimOptions, count: usize) -> Result<Self, SimError> {
        options.check()?;
        if count == 0 {
            return Err(SimError::Value { what: "count".into(), expected: "at least 1".into(), found: 0.0 });
        }
        model.check_indices()?;
        let topology = Topology::new(model, options.self_collision);
        let catalogue = Catalogue::new(model, terrain);
        let weights = neutral_weights(model, &topology, &catalogue, options)?;
        let colliders = Colliders::new(model, terrain, &weights.body, options);
        let limits = model.joints.iter().map(|j| (j.lower, j.upper)).collect();
        let tolerance = options.tolerance.unwrap_or(T::TOLERANCE);
        let shared = BlockContext { topology, colliders, weights, limits, options: options.clone(), tolerance };
        let mut engine = T::engine(model, &shared, catalogue.materials(), count);
        let deriver = deriver(model, &shared, &catalogue);
        let neutral = catalogue.neutral();
        for env in 0..engine.padded() {
            engine.derive_all(&deriver, &neutral, env)?;
        }
        let imu = model.frames.iter().position(|f| f.name == "imu" || f.name == "imu_link");
        let overrides = vec![BTreeMap::new(); count];
        let mut batch = Self {
            model: model.clone(),
            shared,
            catalogue,
            engine,
            overrides,
            values: neutral,
            loaded: None,
            imu,
            identity: OnceLock::new(),
            passing: Vec::new(),
            precision: std::marker::PhantomData,
        };
        let rest = batch.rest_state();
        for env in 0..batch.engine.padded() {
            batch.engine.write_state(&batch.shared, env, &rest.q, &rest.v);
        }
        Ok(batch)
    }

    fn rest_state(&self) -> State {
        let mut q = vec![0.0; self.model.nq()];
        if self.shared.topology.free_base {
            q[3] = 1.0;
        }
        State { q, v: vec![0.0; self.model.nv()] }
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.overrides.len()
    }

    /// Never true: a batch has at least one environment.
    pub fn is_empty(&self) -> bool {
        self.overrides.is_empty()
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The settings.
    pub fn options(&self) -> &SimOptions {
        &self.shared.options
    }

    /// The ground.
    pub fn terrain(&self) -> &Terrain {
        &self.shared.colliders.terrain
    }

    /// Lanes of the register in use: 1, 4, 8 or 16.
    pub fn lanes(&self) -> usize {
        self.engine.lanes()
    }

    /// Heap bytes of one environment: its share of the blocks, without what all share.
    pub fn bytes_per_environment(&self) -> usize {
        self.engine.bytes() / self.engine.padded()
    }

    fn check_index(&self, env: usize) -> Result<(), SimError> {
        if env < self.len() { Ok(()) } else { Err(SimError::Environment { index: env, count: self.len() }) }
    }

    /// Sets positions and velocities, sets the time to zero and forgets commands, lags and faults of the environment.
    /// The quaternion is normalised.
    ///
    /// # Errors
    /// When a length is off, a number is not finite, or the quaternion is zero.
    pub fn set_state(&mut self, env: usize, state: &State) -> Result<(), SimError> {
        self.check_index(env)?;
        length("positions", self.model.nq(), state.q.len())?;
        length("velocities", self.model.nv(), state.v.len())?;
        finite("position", &state.q)?;
        finite("velocity", &state.v)?;
        let mut q = state.q.clone();
        if self.shared.topology.free_base {
            let norm = q[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm < 1e-6 {
                let (what, expected) = ("length of the base quaternion".into(), "1".into());
                return Err(SimError::Value { what, expected, found: norm });
            }
            q[3..7].iter_mut().for_each(|x| *x /= norm);
        }
        self.engine.write_state(&self.shared, env, &q, &state.v);
        Ok(())
    }

    /// Positions and velocities.
    ///
    /// # Errors
    /// When there is no such environment.
    pub fn state(&self, env: usize) -> Result<State, SimError> {
        self.check_index(env)?;
        let mut state = self.rest_state();
        self.engine.read_state(env, &mut state.q, &mut state.v);
        Ok(state)
    }

    /// [`Batch::state`] into a state that is there, which saves making one.
    ///
    /// # Errors
    /// When there is no such environment, or the state is of another robot.
    pub fn read_state(&self, env: usize, state: &mut State) -> Result<(), SimError> {
        self.check_index(env)?;
        length("positions", self.model.nq(), state.q.len())?;
        length("velocities", self.model.nv(), state.v.len())?;
        self.engine.read_state(env, &mut state.q, &mut state.v);
        Ok(())
    }

    /// Sets the command that is held from the next step on. The first one after [`Batch::set_state`] also counts as
    /// all earlier ones, for joints with latency.
    ///
    /// # Errors
    /// When a length is off or a number is not finite.
    pub fn set_command(&mut self, env: usize, command: &JointCommand) -> Result<(), SimError> {
        self.check_command(env, command)?;
        self.engine.write_command(&self.shared, env, None, command);
        Ok(())
    }

    /// [`Batch::set_command`] with one command for some environments that follow each other.
    ///
    /// # Errors
    /// As [`Batch::set_command`], and when there are not that many environments.
    pub fn set_command_in(&mut self, environments: Range<usize>, command: &JointCommand) -> Result<(), SimError> {
        let Some(last) = environments.clone().next_back() else { return Ok(()) };
        self.check_command(last, command)?;
        environments.for_each(|env| self.engine.write_command(&self.shared, env, None, command));
        Ok(())
    }

    /// [`Batch::set_command`] with one command for all environments, in less time.
    ///
    /// # Errors
    /// When a length is off or a number is not finite.
    pub fn set_command_for_all(&mut self, command: &JointCommand) -> Result<(), SimError> {
        command.check(self.model.joints.len())?;
        self.engine.write_command_to_all(&self.shared, command);
        Ok(())
    }

    /// Sets the command that was in force `age` steps before the next one (0 is the present), for joints with latency. After
    /// [`Batch::set_state`]: where none is set, the first command counts as all earlier ones.
    ///
    /// # Errors
    /// As [`Batch::set_command`], and when `age` lies beyond `max_command_latency`.
    pub fn set_past_command(&mut self, env: usize, age: usize, command: &JointCommand) -> Result<(), SimError> {
        self.check_command(env, command)?;
        let kept = self.shared.options.ring(self.shared.options.max_command_latency);
        if age >= kept {
            let expected = format!("less than {kept} steps (max_command_latency)");
            return Err(SimError::Value { what: "age of a command".into(), expected, found: age as f64 });
        }
        self.engine.write_command(&self.shared, env, Some(age), command);
        Ok(())
    }

    /// Sets the torques behind the lag of each joint \[N m\], before the limits of the motors, shape `[joints]`: a lag goes on
    /// from there. After [`Batch::set_state`]: where none are set, lags are taken to have settled on what is asked for in the first step.
    ///
    /// # Errors
    /// When there is no such environment, the length is off, or a number is not finite.
    pub fn set_lagged_torques(&mut self, env: usize, torques: &[f64]) -> Result<(), SimError> {
        self.check_index(env)?;
        length("torques behind lags", self.model.joints.len(), torques.len())?;
        finite("torque behind a lag", torques)?;
        self.engine.write_lagged_torques(env, torques);
        Ok(())
    }

    fn check_command(&self, env: usize, command: &JointCommand) -> Result<(), SimError> {
        self.check_index(env)?;
        command.check(self.model.joints.len())
    }

    /// One time step of all environments on this thread.
    pub fn step(&mut self) {
        self.step_many(1);
    }

    /// Several time steps with held commands, on this thread.
    pub fn step_many(&mut self, steps: usize) {
        self.engine.step(&self.shared, steps, &[], false);
    }

    /// One time step on all threads of the current rayon pool. Same bits as [`Batch::step`].
    pub fn step_parallel(&mut self) {
        self.step_many_parallel(1);
    }

    /// Several time steps with held commands on all threads. Same bits as [`Batch::step_many`].
    pub fn step_many_parallel(&mut self, steps: usize) {
        self.engine.step(&self.shared, steps, &[], true);
    }

    /// One step for each command, given to all environments. With `parallel`, threads take environments through the whole
    /// sequence without waiting for each other. Same bits as [`Batch::set_command_for_all`] and [`Batch::step`] in turn.
    ///
    /// # Errors
    /// When a length is off or a number is not finite; nothing has moved then.
    pub fn follow(&mut self, commands: &[JointCommand], parallel: bool) -> Result<(), SimError> {
        commands.iter().try_for_each(|command| command.check(self.model.joints.len()))?;
        self.engine.step(&self.shared, commands.len(), commands, parallel);
        Ok(())
    }

    /// Whether the numbers of an environment ran away (not finite, or a speed above 1e6 m/s or rad/s); it then stays where it last was finite until
    /// [`Batch::set_state`].
    ///
    /// # Errors
    /// When there is no such environment.
    pub fn is_faulty(&self, env: usize) -> Result<bool, SimError> {
        self.check_index(env)?;
        Ok(self.engine.faulty(env))
    }

    /// All parameters by name.
    pub fn catalogue(&self) -> &[ParameterInfo] {
        &self.catalogue.infos
    }

    /// Index of a parameter in the catalogue, for [`Batch::set_parameter_at`].
    ///
    /// # Errors
    /// When the name is unknown; the error suggests the nearest one.
    pub fn parameter_index(&self, name: &str) -> Result<usize, SimError> {
        self.catalogue.find(name)
    }

    /// Sets a parameter of one environment.
    ///
    /// # Errors
    /// When the name is unknown or the value means nothing.
    pub fn set_parameter(&mut self, env: usize, name: &str, value: f64) -> Result<(), SimError> {
        let id = self.catalogue.find(name)?;
        self.set_parameter_at(env, id, value)
    }

    /// Sets a parameter by its index in the catalogue.
    ///
    /// # Errors
    /// As [`Batch::set_parameter`].
    pub fn set_parameter_at(&mut self, env: usize, id: usize, value: f64) -> Result<(), SimError> {
        self.check_index(env)?;
        if id >= self.catalogue.infos.len() {
            return Err(SimError::Length { what: "catalogue", expected: self.catalogue.infos.len(), found: id });
        }
        self.catalogue.check(id, value)?;
        self.check_sensor_latency(id, value)?;
        self.load(env);
        let before = self.overrides[env].insert(id, value);
        self.values[id] = value;
        let slot = self.catalogue.infos[id].acts_on;
        let deriver = deriver(&self.model, &self.shared, &self.catalogue);
        let result = self.engine.derive(&deriver, slot, &self.values, env);
        if result.is_err() {
            match before {
                Some(value) => self.overrides[env].insert(id, value),
                None => self.overrides[env].remove(&id),
            };
            self.values[id] = self.value(env, id);
        }
        result
    }

    /// Fills `values` with those of an environment: settings of many parameters go from one environment to the next.
    fn load(&mut self, env: usize) {
        if self.loaded != Some(env) {
            self.unload();
            self.overrides[env].iter().for_each(|(&id, &value)| self.values[id] = value);
            self.loaded = Some(env);
        }
    }

    /// Makes all `values` neutral.
    fn unload(&mut self) {
        let Some(env) = self.loaded.take() else { return };
        self.overrides[env].keys().for_each(|&id| self.values[id] = self.catalogue.infos[id].neutral);
    }

    /// A latency of sensors must be within what the batch remembers.
    fn check_sensor_latency(&self, id: usize, value: f64) -> Result<(), SimError> {
        let info = &self.catalogue.infos[id];
        let most = self.shared.options.max_sensor_latency;
        if !info.acts_on.is_sensor_latency() || value <= most {
            return Ok(());
        }
        let expected = format!("at most max_sensor_latency of the options, {most} s");
        Err(SimError::Value { what: info.name.clone(), expected, found: value })
    }

    /// Makes all parameters of one environment neutral.
    ///
    /// # Errors
    /// When there is no such environment.
    pub fn reset_parameters(&mut self, env: usize) -> Result<(), SimError> {
        self.check_index(env)?;
        self.unload();
        self.overrides[env].clear();
        let deriver = deriver(&self.model, &self.shared, &self.catalogue);
        self.engine.derive_all(&deriver, &self.values, env)
    }

    /// Value of a parameter.
    ///
    /// # Errors
    /// When the environment or the name is unknown.
    pub fn parameter(&self, env: usize, name: &str) -> Result<f64, SimError> {
        self.check_index(env)?;
        let id = self.catalogue.find(name)?;
        Ok(self.value(env, id))
    }

    fn value(&self, env: usize, id: usize) -> f64 {
        self.overrides[env].get(&id).copied().unwrap_or(self.catalogue.infos[id].neutral)
    }

    /// What the robot's sensors report.
    ///
    /// # Errors
    /// When there is no such environment, or a latency exceeds `max_sensor_latency`.
    pub fn sensors(&self, env: usize) -> Result<SensorReading, SimError> {
        self.check_index(env)?;
        crate::sensors::read(&self.model, &self.shared, &self.catalogue, &*self.engine, self.imu, env, |id| {
            self.value(env, id)
        })
    }

    /// How deep each shape has pressed the ground under it for good \[m\], shape `[geoms]` (see `contact.yield_force`).
    ///
    /// # Errors
    /// When there is no such environment.
    pub fn sunk_depths(&self, env: usize) -> Result<Vec<f64>, SimError> {
        self.check_index(env)?;
        Ok(self.engine.sunk(env))
    }

    /// A copy of all states and parameters.
    pub fn snapshot(&self) -> Snapshot<T> {
        let precision = std::marker::PhantomData;
        Snapshot {
            blocks: self.engine.copy_blocks(),
            overrides: self.overrides.clone(),
            identity: self.identity(),
            precision,
        }
    }

    /// Back to a copy.
    ///
    /// # Errors
    /// When the snapshot is of another model, count, precision or other options.
    pub fn restore(&mut self, snapshot: &Snapshot<T>) -> Result<(), SimError> {
        let same = snapshot.identity == self.identity() && snapshot.overrides.len() == self.len();
        if !same || !self.engine.restore_blocks(&*snapshot.blocks) {
            return Err(SimError::Snapshot);
        }
        self.unload();
        self.overrides.clone_from(&snapshot.overrides);
        Ok(())
    }

    fn identity(&self) -> u64 {
        *self.identity.get_or_init(|| identity(&self.model, &self.shared.options))
    }

    /// Accelerations of the last step, in the order of [`State::v`].
    ///
    /// # Errors
    /// When there is no such environment.
    pub fn acceleration(&self, env: usize) -> Result<Vec<f64>, SimError> {
        self.check_index(env)?;
        Ok(self.engine.acceleration(env))
    }
}

/// A hash of all that a block's numbers depend on beside parameters and state.
fn identity(model: &Model, options: &SimOptions) -> u64 {
    let mut hasher = std::hash::DefaultHasher::new();
    std::hash::Hash::hash(&format!("{model:?} {options:?}"), &mut hasher);
    std::hash::Hasher::finish(&hasher)
}

fn deriver<'a>(model: &'a Model, shared: &'a BlockContext, catalogue: &'a Catalogue) -> Deriver<'a> {
    Deriver {
        model,
        topology: &shared.topology,
        catalogue,
        timestep: shared.options.timestep,
        max_latency: shared.options.max_command_latency,
    }
}

/// Inverse weights of the neutral model, found with a scalar block of its own.
fn neutral_weights(
    model: &Model,
    topology: &Topology,
    catalogue: &Catalogue,
    options: &SimOptions,
) -> Result<Weights, SimError> {
    let mut block = Block::<f64>::new(model, topology, catalogue.materials(), 1, 0);
    let deriver = Deriver { model, topology, catalogue, timestep: options.timestep, max_latency: 0.0 };
    deriver.apply_all(&catalogue.neutral(), 0, &mut block)?;
    let mut work = Work::new(topology, &[], 0, options.contact_dimension);
    Ok(Weights::new(topology, &block, &mut work))
}
