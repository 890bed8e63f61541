//! Reading a golden of `fixtures/mujoco/golden`, and repeating its run in qv-sim.

use qv_go2::gait::{Chirp, Trot};
use qv_go2::model;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, State, Terrain};
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A golden. What one of them lacks is empty.
#[derive(Deserialize)]
pub struct Golden {
    pub name: String,
    pub mujoco: String,
    pub options: Options,
    pub tolerance: BTreeMap<String, f64>,
    pub base: String,
    #[serde(default)]
    pub joint: Joint,
    #[serde(default)]
    pub joint_names: Vec<String>,
    #[serde(default)]
    pub stand: Vec<f64>,
    #[serde(default)]
    pub effort: Vec<f64>,
    pub gains: Option<Gains>,
    pub friction: Option<f64>,
    #[serde(default)]
    pub duration: f64,
    #[serde(default)]
    pub sample_interval: f64,
    #[serde(default)]
    pub initial_q: Vec<f64>,
    #[serde(default)]
    pub initial_v: Vec<f64>,
    #[serde(default)]
    pub q: Vec<Vec<f64>>,
    #[serde(default)]
    pub heights: Vec<Vec<f64>>,
    pub terrain: Option<Grid>,
    pub trot: Option<TrotInput>,
    pub chirp: Option<ChirpInput>,
    pub urdf: Option<String>,
    /// All that only one test reads.
    #[serde(flatten)]
    pub rest: BTreeMap<String, Value>,
}

#[derive(Deserialize)]
pub struct Options {
    pub timestep: f64,
    pub gravity: [f64; 3],
    pub impratio: f64,
    pub contact_solref: [f64; 2],
}

#[derive(Deserialize, Default, Clone, Copy)]
pub struct Joint {
    pub armature: f64,
    pub damping: f64,
    pub frictionloss: f64,
}

#[derive(Deserialize, Clone, Copy)]
pub struct Gains {
    pub kp: f64,
    pub kd: f64,
}

#[derive(Deserialize)]
pub struct Grid {
    pub cell: f64,
    pub x0: f64,
    pub y0: f64,
}

#[derive(Deserialize)]
pub struct TrotInput {
    frequency: f64,
    ramp: f64,
    swing: f64,
    lift: f64,
    lift_delay: f64,
    phases: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
pub struct ChirpInput {
    start: f64,
    end: f64,
    duration: f64,
    ramp: f64,
    amplitude: f64,
    phase_step: f64,
}

impl TrotInput {
    /// The gait with the constants of the golden, which must not drift apart from those of this crate.
    pub fn gait(&self) -> Trot {
        let phases = model::LEGS.map(|leg| self.phases[leg]);
        let Self { frequency, ramp, swing, lift, lift_delay, .. } = *self;
        Trot { frequency, ramp, swing, lift, lift_delay, phases }
    }
}

impl ChirpInput {
    /// The motion with the constants of the golden.
    pub fn motion(&self) -> Chirp {
        let Self { start, end, duration, ramp, amplitude, phase_step } = *self;
        Chirp { start, end, duration, ramp, amplitude, phase_step }
    }
}

/// Reads `fixtures/mujoco/golden/<name>.json`.
pub fn read(name: &str) -> Golden {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/mujoco/golden");
    let path = root.join(format!("{name}.json"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let golden: Golden = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!((golden.name.as_str(), golden.mujoco.as_str()), (name, "4.0.0"));
    if !golden.joint_names.is_empty() {
        assert_eq!(golden.joint_names, model::JOINT_NAMES, "{name}");
        assert_eq!(golden.stand, model::STAND, "{name}");
        assert_eq!(golden.effort, model::effort_limits(), "{name}");
    }
    golden
}

impl Golden {
    /// The bound that the golden carries for one measure.
    pub fn bound(&self, measure: &str) -> f64 {
        *self.tolerance.get(measure).unwrap_or_else(|| panic!("{}: no tolerance {measure}", self.name))
    }

    /// The model that the golden was made with.
    pub fn model(&self) -> Model {
        let base = if self.base == "free" { BaseKind::Floating } else { BaseKind::Fixed };
        let options = ModelOptions { base, armature: self.joint.armature, ..Default::default() };
        let urdf = self.urdf.clone().unwrap_or_else(model::urdf);
        Model::from_urdf(&urdf, &options).expect("the URDF of a golden is good")
    }

    /// One environment with the ground, options and joint properties of the golden, at `q` and `v`.
    pub fn environment(&self, joint: Joint, q: &[f64], v: &[f64]) -> Batch<f64> {
        let model = self.model();
        let terrain = match &self.terrain {
            Some(grid) => {
                let (rows, columns) = (self.heights.len(), self.heights[0].len());
                let spacing = [grid.cell, grid.cell];
                Terrain::height_field([grid.x0, grid.y0], spacing, columns, rows, self.heights.concat()).unwrap()
            }
            None => Terrain::plane(),
        };
        let terrain = terrain.with_friction(self.friction.unwrap_or(0.8)).unwrap();
        let options = SimOptions {
            timestep: self.options.timestep,
            gravity: self.options.gravity,
            impratio: self.options.impratio,
            ..Default::default()
        };
        let mut sim = Batch::new(&model, &terrain, &options, 1).unwrap();
        if self.friction.is_none() {
            // A golden without ground: ours is put out of reach.
            sim.set_parameter(0, "terrain.height", -1000.0).unwrap();
        }
        sim.set_parameter(0, "contact.time_constant", self.options.contact_solref[0]).unwrap();
        sim.set_parameter(0, "contact.damping_ratio", self.options.contact_solref[1]).unwrap();
        for name in model.joint_names() {
            sim.set_parameter(0, &format!("joint.{name}.armature"), joint.armature).unwrap();
            sim.set_parameter(0, &format!("joint.{name}.viscous_friction"), joint.damping).unwrap();
            sim.set_parameter(0, &format!("joint.{name}.coulomb_friction"), joint.frictionloss).unwrap();
        }
        sim.set_state(0, &State { q: q.to_vec(), v: v.to_vec() }).unwrap();
        sim
    }

    /// Commands `target` \[rad\] with the gains of the golden.
    pub fn command(&self, sim: &mut Batch<f64>, target: &[f64]) {
        let gains = self.gains.expect("a golden with targets has gains");
        let n = target.len();
        let (zero, kp, kd) = (vec![0.0; n], vec![gains.kp; n], vec![gains.kd; n]);
        sim.set_command(0, &JointCommand { q: target, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
    }

    /// The run, sampled as the golden is: states at 0, `sample_interval`, ... `target` gives the command at a time.
    pub fn repeat(&self, target: Option<&dyn Fn(f64) -> [f64; 12]>) -> Vec<State> {
        let mut sim = self.environment(self.joint, &self.initial_q, &self.initial_v);
        let steps = (self.duration / self.options.timestep).round() as usize;
        let every = (self.sample_interval / self.options.timestep).round() as usize;
        let mut states = vec![sim.state(0).unwrap()];
        for step in 0..steps {
            if let Some(target) = target {
                self.command(&mut sim, &target(step as f64 * self.options.timestep));
            }
            sim.step();
            if (step + 1) % every == 0 {
                states.push(sim.state(0).unwrap());
            }
        }
        assert!(!sim.is_faulty(0).unwrap(), "{}", self.name);
        states
    }

    /// An array of numbers by its key.
    pub fn numbers(&self, key: &str) -> Vec<f64> {
        numbers(&self.rest, key)
    }

    /// A table of numbers by its key.
    pub fn table(&self, key: &str) -> Vec<Vec<f64>> {
        let value = self.rest.get(key).unwrap_or_else(|| panic!("{}: no {key}", self.name));
        serde_json::from_value(value.clone()).unwrap_or_else(|error| panic!("{}: {key}: {error}", self.name))
    }
}

/// An array of numbers by its key.
pub fn numbers(object: &BTreeMap<String, Value>, key: &str) -> Vec<f64> {
    let value = object.get(key).unwrap_or_else(|| panic!("no {key}"));
    serde_json::from_value(value.clone()).unwrap_or_else(|error| panic!("{key}: {error}"))
}

/// Root of the mean square of all differences of the columns `from..to`.
pub fn rms(found: &[State], expected: &[Vec<f64>], from: usize, to: usize) -> f64 {
    assert_eq!(found.len(), expected.len());
    let differences = found.iter().zip(expected).flat_map(|(f, e)| (from..to).map(move |i| f.q[i] - e[i]));
    let (sum, count) = differences.fold((0.0, 0usize), |(sum, count), d| (sum + d * d, count + 1));
    assert!(count > 0);
    (sum / count as f64).sqrt()
}
