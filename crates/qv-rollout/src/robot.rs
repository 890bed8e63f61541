//! The robot, its ground and what is known of both, looked up once.

use crate::RolloutError;
use crate::channels::{Channel, channels, law_joints};
use crate::feet::{Feet, feet_of};
use crate::legs::Legs;
use crate::options::{Numerics, WindowOptions};
use crate::parameters::{Overrides, expand, joint_columns, stated_parameters};
use crate::sensors::SensorErrors;
use crate::start::Starts;
use qv_core::JointSeries;
use qv_recording::{Run, median_interval};
use qv_sim::{ActsOn, Batch, JointField, Model, ParameterInfo, SimOptions, Terrain, WorldField};
use std::collections::HashMap;

/// Ground is looked for from so far above a foot on \[m\].
const ABOVE: f64 = 1.0;

/// Something outside that acts on the robot for a while.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Its forces or torques, start and duration.
    pub setting: Overrides,
    /// From and until \[s\].
    pub time: [f64; 2],
}

/// A robot, the ground and the channels that can be compared.
#[derive(Clone)]
pub struct Rollout<'a> {
    /// The robot.
    pub model: &'a Model,
    /// The ground; none for a robot that is held above a plane.
    pub terrain: Terrain,
    /// Column of the run for each joint, shape `[n]`.
    pub columns: Vec<usize>,
    /// Whether the base is free.
    pub free: bool,
    /// Whether no poses of a free base were measured, so that its legs show where it goes.
    pub on_legs: bool,
    /// Its feet.
    pub feet: Feet,
    /// All parameters.
    pub catalogue: Vec<ParameterInfo>,
    /// Value of each parameter before the diagnosis.
    pub nominal: Vec<f64>,
    /// Parameters whose nominal value is not the catalogue's.
    pub stated: Overrides,
    /// Channels, in the order of the features.
    pub channels: Vec<Channel>,
    /// Joints whose torque can be compared with the law of the actuator.
    pub law_joints: Vec<usize>,
    /// How windows are cut.
    pub cut: WindowOptions,
    /// Numbers of the simulator.
    pub numerics: Numerics,
    /// What has been found to act for a while, from outside.
    pub events: Vec<Event>,
    /// Whether the ground of each simulation is moved to the feet that stand at its start.
    pub anchors: bool,
    /// How far above a foot the ground may begin that it stands on \[m\]: as much as poses and ground may be off.
    pub above: f64,
    /// Depth to which the feet sink in when the robot stands on all of them \[m\].
    pub depth: f64,
    index: HashMap<String, usize>,
    of_part: HashMap<ActsOn, usize>,
}

impl<'a> Rollout<'a> {
    /// Looks at what `run` has; `given` are parameters that are known already.
    ///
    /// # Errors
    /// When the run is not one of this model, or a parameter is unknown.
    pub fn new(
        run: &Run,
        model: &'a Model,
        terrain: &Terrain,
        given: &[(String, f64)],
        cut: WindowOptions,
    ) -> Result<Self, RolloutError> {
        let (columns, free) = joint_columns(run, model)?;
        let terrain = if !free && terrain.is_plane() { Terrain::none() } else { terrain.clone() };
        let probe = Batch::<f64>::new(model, &terrain, &SimOptions::default(), 1)?;
        let catalogue = probe.catalogue().to_vec();
        let index: HashMap<String, usize> = catalogue.iter().enumerate().map(|(i, p)| (p.name.clone(), i)).collect();
        let mut nominal: Vec<f64> = catalogue.iter().map(|p| p.neutral).collect();
        let mut known = stated_parameters(run, model);
        known.extend(expand(model, &terrain, given)?);
        for (name, value) in known {
            let known = || catalogue.iter().map(|p| p.name.as_str());
            let unknown = || qv_sim::names::unknown("parameter", &name, known());
            let found = || RolloutError::run("parameters", "a parameter of the simulator", unknown());
            nominal[*index.get(&name).ok_or_else(found)?] = value;
        }
        let stated =
            (0..nominal.len()).filter(|&i| nominal[i] != catalogue[i].neutral).map(|i| (i, nominal[i])).collect();
        let of_part = catalogue.iter().enumerate().map(|(i, p)| (p.acts_on, i)).collect();
        let feet = feet_of(run, model);
        let on_legs = free && run.measured.base_pose.as_ref().is_none_or(JointSeries::is_empty);
        let channels = channels(run, &columns, free);
        let law_joints = law_joints(run, &columns);
        let period = run.measured.position.as_ref().map_or(0.0, |p| median_interval(&p.time));
        let cut = if free { cut } else { cut.held(period) };
        let numerics = Numerics::default();
        Ok(Self {
            model,
            terrain,
            columns,
            free,
            on_legs,
            feet,
            catalogue,
            nominal,
            stated,
            channels,
            law_joints,
            cut,
            numerics,
            events: Vec::new(),
            anchors: true,
            above: ABOVE,
            depth: 0.0,
            index,
            of_part,
        })
    }

    /// Index of a parameter.
    pub fn parameter(&self, name: &str) -> Option<usize> {
        self.index.get(name).copied()
    }

    /// Value of a parameter under a setting.
    pub fn value(&self, setting: &Overrides, id: usize) -> f64 {
        setting.binary_search_by_key(&id, |s| s.0).map_or(self.nominal[id], |i| setting[i].1)
    }

    /// Index of the parameter of a part.
    pub fn parameter_of(&self, part: ActsOn) -> Option<usize> {
        self.of_part.get(&part).copied()
    }

    /// What a parameter acts on.
    pub fn acts_on(&self, id: usize) -> ActsOn {
        self.catalogue[id].acts_on
    }

    /// Value of a part's parameter under a setting; 0 for a part that is not there.
    pub(crate) fn value_of(&self, setting: &Overrides, part: ActsOn) -> f64 {
        self.parameter_of(part).map_or(0.0, |id| self.value(setting, id))
    }

    /// The parameters of a kind that are stated or set: what each acts on, and its value.
    fn set<'p>(&'p self, setting: &'p Overrides) -> impl Iterator<Item = (ActsOn, f64)> + 'p {
        self.stated.iter().chain(setting).map(|&(id, value)| (self.acts_on(id), value))
    }

    /// Longest latency of commands under a setting \[s\].
    pub fn longest_latency(&self, setting: &Overrides) -> f64 {
        let latencies = self.set(setting).filter(|s| matches!(s.0, ActsOn::Joint(_, JointField::CommandLatency)));
        latencies.map(|s| s.1).fold(0.0, f64::max)
    }

    /// Longest latency of sensors under a setting \[s\].
    pub fn sensor_latency(&self, setting: &Overrides) -> f64 {
        self.set(setting).filter(|s| s.0.is_sensor_latency()).map(|s| s.1).fold(0.0, f64::max)
    }

    /// The event that acts longest between two times \[s\]: the simulator knows one at a time.
    pub(crate) fn event_between(&self, from: f64, until: f64) -> Option<&Event> {
        let shared = |e: &&Event| e.time[1].min(until) - e.time[0].max(from);
        self.events.iter().filter(|e| shared(e) > 0.0).max_by(|a, b| shared(a).total_cmp(&shared(b)))
    }

    /// All parameters that a robot under `setting` does not have from the catalogue, in the order in which they are set:
    /// what is stated, what is tried, and the event between two times unless one is tried.
    pub fn acting<'p>(
        &'p self,
        setting: &'p Overrides,
        from: f64,
        until: f64,
    ) -> impl Iterator<Item = (usize, f64)> + 'p {
        let tries_one = setting.iter().any(|s| self.acts_on(s.0) == ActsOn::World(WorldField::ForceStart));
        let event = self.event_between(from, until).filter(|_| !tries_one);
        self.stated.iter().chain(setting).chain(event.into_iter().flat_map(|e| &e.setting)).copied()
    }

    /// How soft the springs between motors and joints are under a setting \[rad/(N m)\], shape `[joints]`; `None` where there are none.
    pub fn compliances(&self, setting: &Overrides) -> Option<Vec<f64>> {
        let mut all = vec![0.0; self.columns.len()];
        for (part, value) in self.set(setting) {
            if let ActsOn::Joint(joint, JointField::SeriesCompliance) = part {
                all[joint] = value;
            }
        }
        all.iter().any(|c| *c > 0.0).then_some(all)
    }

    /// The parameter that says when in its run a simulation begins, and its value for one that begins `since` \[s\] the recording's start; `None`
    /// where nothing depends on it.
    pub(crate) fn run_start(&self, setting: &Overrides, since: f64) -> Option<(usize, f64)> {
        let is_drift = |part| matches!(part, ActsOn::Joint(_, JointField::StrengthDrift));
        let drifts = self.set(setting).any(|s| is_drift(s.0) && s.1 != 0.0);
        let id = self.parameter_of(ActsOn::World(WorldField::RunStart)).filter(|_| drifts)?;
        Some((id, self.value(setting, id) + since))
    }

    /// The errors of the sensors under a setting.
    pub fn sensor_errors(&self, setting: &Overrides) -> SensorErrors {
        let joints = self.columns.len();
        let mut errors =
            SensorErrors { encoder_bias: vec![0.0; joints], encoder_latency: vec![0.0; joints], ..Default::default() };
        for (part, value) in self.set(setting) {
            match part {
                ActsOn::Joint(j, JointField::EncoderBias) => errors.encoder_bias[j] = value,
                ActsOn::Joint(j, JointField::EncoderLatency) => errors.encoder_latency[j] = value,
                ActsOn::World(WorldField::TiltRoll) => errors.imu_tilt[0] = value,
                ActsOn::World(WorldField::TiltPitch) => errors.imu_tilt[1] = value,
                ActsOn::World(WorldField::GyroBiasX) => errors.gyro_bias[0] = value,
                ActsOn::World(WorldField::GyroBiasY) => errors.gyro_bias[1] = value,
                ActsOn::World(WorldField::GyroBiasZ) => errors.gyro_bias[2] = value,
                ActsOn::World(WorldField::PoseDelay) => errors.pose_delay = value,
                _ => {}
            }
        }
        errors
    }

    /// Smoothed states of a part of the recording, freed of the sensors' `errors`.
    ///
    /// # Errors
    /// When it lacks what states are given by.
    pub fn starts<'r>(&self, view: &'r Run, errors: SensorErrors) -> Result<Starts<'r>, RolloutError> {
        if self.on_legs {
            Starts::on_legs(view, &self.columns, errors, Legs { model: self.model, feet: &self.feet.geoms })
        } else {
            Starts::new(view, &self.columns, self.free, errors)
        }
    }
}
