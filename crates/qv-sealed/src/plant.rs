//! Either engine behind the few questions that a recorder asks.

use crate::engine::Engine;
use qv_core::TriangleMesh;
use qv_go2::messages::LowCmd;
use qv_go2::synthetic::simulator;
use qv_go2::{model, synthetic};
use qv_recording::RecordingError;
#[cfg(feature = "rapier")]
use qv_sim::rapier::{RapierEngine, RapierOptions};
use qv_sim::{BaseKind, Batch, Model, ModelOptions, SensorReading, SimError, SimOptions, State, Terrain};

/// A simulated Go2 on the nominal floor.
pub(crate) enum Plant {
    Ours(Box<Batch<f64>>),
    #[cfg(feature = "rapier")]
    Second(Box<RapierEngine>),
}

/// The robot of the model.
pub(crate) fn nominal() -> Result<Model, SimError> {
    let options = ModelOptions { base: BaseKind::Floating, armature: model::ARMATURE, ..Default::default() };
    Model::from_urdf(&model::urdf(), &options)
}

/// The floor that recordings are made on.
pub(crate) fn floor() -> Result<Terrain, SimError> {
    Terrain::plane().with_friction(model::FLOOR_FRICTION)
}

/// On its feet at rest, just above a floor that `parameters` raise, tilt, or meet with larger feet.
pub(crate) fn standing(parameters: &[(String, f64)]) -> State {
    let of = |name: &str| parameters.iter().find(|(n, _)| n == name).map_or(0.0, |(_, value)| *value);
    let swollen = parameters.iter().filter(|(n, _)| n.ends_with(".radius_offset")).map(|(_, v)| *v).fold(0.0, f64::max);
    // Feet stand up to 0.3 m from the origin about which the floor tilts.
    let tilted = 0.3 * (of("terrain.slope_x").abs() + of("terrain.slope_y").abs());
    let height = model::touching_height(&model::STAND) + of("terrain.height") + tilted + swollen;
    let mut q = vec![0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0];
    q.extend(model::STAND);
    State { q, v: vec![0.0; 18] }
}

/// The floor of a recording: labelled ground, or the nominal one.
pub(crate) fn ground_of(ground: Option<&TriangleMesh>) -> Result<Terrain, SimError> {
    ground.map_or_else(floor, Terrain::from_mesh)
}

fn ours(engine: &Engine, terrain: &Terrain, parameters: &[(String, f64)]) -> Result<Plant, SimError> {
    let longest = |ends: &[&str]| {
        let fits = parameters.iter().filter(|(name, _)| ends.iter().any(|end| name.ends_with(end)));
        fits.map(|(_, value)| *value).fold(0.0, f64::max)
    };
    let mut options = SimOptions {
        timestep: engine.timestep(),
        max_command_latency: longest(&[".command_latency"]),
        max_sensor_latency: longest(&[".encoder_latency", "pose.delay"]),
        ..Default::default()
    };
    if let Engine::Ours { impratio, contact_dimension, .. } = engine {
        (options.impratio, options.contact_dimension) = (*impratio, *contact_dimension);
    }
    let mut sim = Batch::new(&nominal()?, terrain, &options, 1)?;
    for (name, value) in parameters {
        sim.set_parameter(0, name, *value)?;
    }
    sim.set_state(0, &standing(parameters))?;
    Ok(Plant::Ours(Box::new(sim)))
}

#[cfg(feature = "rapier")]
fn second(engine: &Engine, terrain: &Terrain, parameters: &[(String, f64)]) -> Result<Plant, SimError> {
    let mut options = RapierOptions { timestep: engine.timestep(), ..Default::default() };
    if let Engine::Second { substeps, .. } = engine {
        options.substeps = *substeps;
    }
    let mut sim = RapierEngine::new(&nominal()?, terrain, &options)?;
    for (name, value) in parameters {
        sim.set_parameter(name, *value)?;
    }
    sim.set_state(&standing(parameters))?;
    Ok(Plant::Second(Box::new(sim)))
}

impl Plant {
    /// On the nominal floor.
    ///
    /// # Errors
    /// When a parameter means nothing, or the engine is not built in.
    #[cfg(test)]
    pub fn new(engine: &Engine, parameters: &[(String, f64)]) -> Result<Self, RecordingError> {
        Self::on(engine, None, parameters)
    }

    /// On labelled ground, else on the nominal floor.
    ///
    /// # Errors
    /// When a parameter or the ground means nothing, or the engine is not built in.
    pub fn on(
        engine: &Engine,
        ground: Option<&TriangleMesh>,
        parameters: &[(String, f64)],
    ) -> Result<Self, RecordingError> {
        let terrain = ground_of(ground).map_err(simulator)?;
        match engine {
            Engine::Ours { .. } => ours(engine, &terrain, parameters).map_err(simulator),
            #[cfg(feature = "rapier")]
            Engine::Second { .. } => second(engine, &terrain, parameters).map_err(simulator),
            #[cfg(not(feature = "rapier"))]
            Engine::Second { .. } => Err(qv_core::Mismatch::new(
                "engine of a recording",
                "qv-go2 built with the feature `rapier` for the second engine",
                "a build without it",
            )
            .into()),
        }
    }

    pub fn model(&self) -> &Model {
        match self {
            Self::Ours(sim) => sim.model(),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => sim.model(),
        }
    }

    pub fn send(&mut self, command: &LowCmd) -> Result<(), SimError> {
        synthetic::as_sent(command, |command| match self {
            Self::Ours(sim) => sim.set_command(0, command),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => sim.set_command(command),
        })
    }

    /// One step of the engine; false when its numbers ran away.
    pub fn step(&mut self) -> Result<bool, SimError> {
        match self {
            Self::Ours(sim) => {
                sim.step();
                Ok(!sim.is_faulty(0)?)
            }
            #[cfg(feature = "rapier")]
            Self::Second(sim) => {
                sim.step()?;
                Ok(!sim.is_faulty())
            }
        }
    }

    pub fn state(&self) -> Result<State, SimError> {
        match self {
            Self::Ours(sim) => sim.state(0),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => Ok(sim.state()),
        }
    }

    pub fn sensors(&self) -> Result<SensorReading, SimError> {
        match self {
            Self::Ours(sim) => sim.sensors(0),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => Ok(sim.sensors()),
        }
    }

    pub fn index(&self, name: &str) -> Result<usize, SimError> {
        match self {
            Self::Ours(sim) => sim.parameter_index(name),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => sim.parameter_index(name),
        }
    }

    pub fn set(&mut self, id: usize, value: f64) -> Result<(), SimError> {
        match self {
            Self::Ours(sim) => sim.set_parameter_at(0, id, value),
            #[cfg(feature = "rapier")]
            Self::Second(sim) => sim.set_parameter_at(id, value),
        }
    }
}
