//! What is being diagnosed: a robot, the ground, and the windows of a recording, with all that is looked up once.

pub mod columns;
pub(crate) mod command_cache;
pub mod data_quality;
pub mod excitation;
pub mod features;
pub mod library;
pub(crate) mod one_robot;
pub(crate) mod origin;
pub(crate) mod sizes;
pub(crate) mod start_cache;
pub(crate) mod torques;

use crate::GapError;
use crate::problem::command_cache::Told;
use crate::problem::start_cache::Kept;
pub use crate::problem::start_cache::measured;
use features::Channel;
use qv_core::JointSeries;
use qv_core::random::SplitMix64;
use qv_replay::faults::{FASTEST_BASE, jumped};
use qv_replay::median_interval;
use qv_replay::replay::{
    Command, Covered, Feet, Legs, SensorErrors, Starts, expand, feet_of, joint_columns, stated_parameters,
};
use qv_replay::run::{ActuatorKind, FaultKind};
use qv_replay::{ReplayError, Run};
use qv_sim::{Batch, Model, ParameterInfo, SimOptions, Terrain};
use std::collections::HashMap;

/// Values of parameters that are not nominal: index in the catalogue, value; sorted by index.
pub type Overrides = Vec<(usize, f64)>;

/// Fewest samples in a bin of a shortened window.
const FEWEST_SAMPLES: f64 = 5.0;

/// One window of so many on end is held out.
const HELD_OUT: usize = 4;
/// Seed of which one: the same recording is always divided alike.
const DRAW_SEED: u64 = 0x6865_6c64;

/// How windows are cut and compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowOptions {
    /// Length of a window \[s\].
    pub window: f64,
    /// Length of a bin, within which a channel becomes one number \[s\].
    pub bin: f64,
    /// Interval at which the simulation is looked at \[s\].
    pub sample: f64,
    /// What a window needs on either side of it to find its start \[s\].
    pub margin: f64,
    /// Most windows that are simulated; of a longer recording evenly spread ones are.
    pub most: usize,
}

/// Something outside that acts on the robot for a while.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Its forces or torques, start and duration.
    pub setting: Overrides,
    /// From and until \[s\].
    pub time: [f64; 2],
}

impl Default for WindowOptions {
    fn default() -> Self {
        Self { window: 0.3, bin: 0.05, sample: 0.005, margin: 0.5, most: 72 }
    }
}

impl WindowOptions {
    /// The same for a robot that is held and measured every `period` \[s\]: half as long where there are samples enough.
    /// Nothing bounds how fast an arm falls, as feet on the ground do, so that errors in the start soon are all there is.
    fn held(self, period: f64) -> Self {
        let half = Self { window: 0.5 * self.window, bin: 0.5 * self.bin, most: 2 * self.most, ..self };
        if period > 0.0 && half.bin >= FEWEST_SAMPLES * period { half } else { self }
    }

    /// Bins in a window.
    pub fn bins(&self) -> usize {
        (self.window / self.bin).round() as usize
    }

    /// Samples in a bin.
    pub fn samples_per_bin(&self) -> usize {
        (self.bin / self.sample).round() as usize
    }
}

/// Numbers of the simulator that no recording states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numerics {
    /// Time step \[s\]; the sample interval is a multiple of it.
    pub timestep: f64,
    /// See [`SimOptions::impratio`].
    pub impratio: f64,
    /// See [`SimOptions::implicit_actuator_damping`].
    pub implicit: bool,
}

impl Default for Numerics {
    fn default() -> Self {
        Self { timestep: 0.001, impratio: 10.0, implicit: true }
    }
}

impl Numerics {
    /// Options of a simulation that must remember commands of `latency` \[s\].
    pub fn options(&self, latency: f64) -> SimOptions {
        SimOptions {
            timestep: self.timestep,
            impratio: self.impratio,
            implicit_actuator_damping: self.implicit,
            max_command_latency: latency,
            ..Default::default()
        }
    }
}

/// What a parameter means to the measured side of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Only the simulator knows it.
    Dynamic,
    /// Bias of the encoder of a joint.
    EncoderBias(usize),
    /// Age of the state of a joint.
    EncoderLatency(usize),
    /// Tilt of the IMU, roll or pitch.
    Tilt(usize),
    /// Bias of the gyroscope about an axis.
    GyroBias(usize),
    /// Age of the pose.
    PoseDelay,
    /// Raises the ground.
    Height,
    /// Tilts the ground along x or y.
    Slope(usize),
    /// Radius of a shape.
    Radius(usize),
    /// Start of outside forces, on the clock of the run.
    ForceStart,
    /// Time since the start of the run at which it was recorded first: windows begin later.
    RunStart,
    /// Change of a motor's strength with time.
    Drift,
    /// Spring between the motor of a joint, on which its encoder sits, and the joint.
    Compliance(usize),
}

/// A stretch of the recording that is simulated from its measured start.
pub struct Window {
    /// Start on the clock of the run \[s\].
    pub start: f64,
    /// Start since that of its recording \[s\]: [`Problem::window`] takes the run that it is given for all of that.
    pub since: f64,
    /// What was recorded in and around it.
    pub view: Run,
    /// Attitude of the base at each sample, `world_from_base`, that small turns are counted from; empty with a fixed base.
    pub attitude: Vec<glam::DQuat>,
    /// Whether the robot moves much in it, against the rest of the recording.
    pub moving: bool,
    /// Whether it is kept away from every fit.
    pub held_out: bool,
    /// Which run it is of.
    pub run: usize,
    /// Where its simulation starts, once that was asked for.
    pub(crate) start_kept: Kept,
    /// What its robot was told, once that was asked for.
    pub(crate) told: Told,
}

impl Window {
    /// The same stretch where something else was recorded.
    pub fn seen_as(&self, view: Run) -> Self {
        let Self { start, since, moving, held_out, run, .. } = *self;
        let attitude = self.attitude.clone();
        Self { start, since, view, attitude, moving, held_out, run, start_kept: Kept::default(), told: Told::default() }
    }
}

/// A robot, the ground and the channels that can be compared.
#[derive(Clone)]
pub struct Problem<'a> {
    /// The robot.
    pub model: &'a Model,
    /// The ground; none for a robot that is held above a plane.
    pub terrain: Terrain,
    /// Column of the run for each joint, shape `[n]`.
    pub columns: Vec<usize>,
    /// Whether the base is free.
    pub free: bool,
    /// Whether no poses of a free base were measured, so that its legs tell where it goes.
    pub on_legs: bool,
    /// Its feet.
    pub feet: Feet,
    /// All parameters.
    pub catalogue: Vec<ParameterInfo>,
    /// Value of each parameter before the diagnosis.
    pub nominal: Vec<f64>,
    /// Parameters whose nominal value is not the catalogue's.
    pub stated: Overrides,
    /// Meaning of each parameter.
    pub roles: Vec<Role>,
    /// Channels, in the order of the features.
    pub channels: Vec<Channel>,
    /// Joints whose torque can be compared with the law of the actuator.
    pub law_joints: Vec<usize>,
    /// Parameter that says how long each link is, shape `[links]`.
    pub lengths: Vec<Option<usize>>,
    /// How windows are cut.
    pub cut: WindowOptions,
    /// Numbers of the simulator.
    pub numerics: Numerics,
    /// What has been found to act for a while, from outside.
    pub events: Vec<Event>,
    /// Depth to which the feet sink in when the robot stands on all of them \[m\].
    pub depth: f64,
    index: HashMap<String, usize>,
}

impl<'a> Problem<'a> {
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
    ) -> Result<Self, GapError> {
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
            let found = || GapError::run("parameters", "a parameter of the simulator", unknown());
            nominal[*index.get(&name).ok_or_else(found)?] = value;
        }
        let stated =
            (0..nominal.len()).filter(|&i| nominal[i] != catalogue[i].neutral).map(|i| (i, nominal[i])).collect();
        let roles = catalogue.iter().map(|p| role(&p.name, model)).collect();
        let feet = feet_of(run, model);
        let on_legs = free && walks_unseen(run, &feet, &terrain)?;
        let lengths =
            model.links.iter().map(|l| index.get(&format!("link.{}.length_scale", l.name)).copied()).collect();
        let channels = features::channels(run, &columns, free);
        if channels.is_empty() {
            return Err(GapError::run("channels", "at least one that is measured and alive", "none"));
        }
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
            roles,
            channels,
            law_joints,
            lengths,
            cut,
            numerics,
            events: Vec::new(),
            depth: 0.0,
            index,
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

    /// Value under a setting of the parameter of a joint, such as `actuator.*.lag`.
    pub fn joint_value(&self, setting: &Overrides, pattern: &str, joint: usize) -> f64 {
        let name = pattern.replace('*', &self.model.joint_names()[joint]);
        self.parameter(&name).map_or(0.0, |id| self.value(setting, id))
    }

    /// The event that acts longest between two times \[s\]: the simulator knows one at a time.
    pub fn event_between(&self, from: f64, until: f64) -> Option<&Event> {
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
        let tries_one = setting.iter().any(|s| self.roles[s.0] == Role::ForceStart);
        let event = self.event_between(from, until).filter(|_| !tries_one);
        self.stated.iter().chain(setting).chain(event.into_iter().flat_map(|e| &e.setting)).copied()
    }

    /// How soft the springs between motors and joints are under a setting \[rad/(N m)\], shape `[joints]`; `None` where there are none.
    pub fn compliances(&self, setting: &Overrides) -> Option<Vec<f64>> {
        let mut all = vec![0.0; self.columns.len()];
        for &(id, value) in self.stated.iter().chain(setting) {
            if let Role::Compliance(joint) = self.roles[id] {
                all[joint] = value;
            }
        }
        all.iter().any(|c| *c > 0.0).then_some(all)
    }

    /// The parameter that says when in its run a simulation begins, and its value for one that begins `since` \[s\] the recording's start; `None`
    /// where nothing depends on it.
    pub fn run_start(&self, setting: &Overrides, since: f64) -> Option<(usize, f64)> {
        let drifts = self.stated.iter().chain(setting).any(|s| self.roles[s.0] == Role::Drift && s.1 != 0.0);
        let id = self.parameter("run.start").filter(|_| drifts)?;
        Some((id, self.value(setting, id) + since))
    }

    /// The errors of the sensors under a setting.
    pub fn sensor_errors(&self, setting: &Overrides) -> SensorErrors {
        let joints = self.columns.len();
        let mut errors =
            SensorErrors { encoder_bias: vec![0.0; joints], encoder_latency: vec![0.0; joints], ..Default::default() };
        for &(id, value) in self.stated.iter().chain(setting) {
            match self.roles[id] {
                Role::EncoderBias(j) => errors.encoder_bias[j] = value,
                Role::EncoderLatency(j) => errors.encoder_latency[j] = value,
                Role::Tilt(axis) => errors.imu_tilt[axis] = value,
                Role::GyroBias(axis) => errors.gyro_bias[axis] = value,
                Role::PoseDelay => errors.pose_delay = value,
                _ => {}
            }
        }
        errors
    }

    /// Windows of the run: whole ones, one after the other; of a long recording evenly spread ones. Of each four one is held
    /// out, drawn: every fourth could be in step with a gait or a motion that repeats.
    ///
    /// # Errors
    /// When there are fewer than eight whole ones.
    pub fn windows(&self, run: &Run) -> Result<Vec<Window>, GapError> {
        let [first, last] = run.span();
        let (cut, mut starts) = (self.cut, Vec::new());
        let needed = needed(run);
        // The margin may reach beyond the ends: the start is found from what there is.
        let mut from = first + 0.1_f64.min(cut.margin);
        while from + cut.window + 0.05 <= last {
            if self.is_usable(run, &needed, from) {
                starts.push(from);
            }
            from += cut.window;
        }
        let all = starts.len();
        if all > cut.most {
            starts = (0..cut.most).map(|k| starts[k * all / cut.most]).collect();
        }
        let is_held_out = |k: usize| k % HELD_OUT == drawn(k / HELD_OUT);
        let mut windows: Vec<Window> =
            starts.into_iter().enumerate().filter_map(|(k, start)| self.window(run, start, is_held_out(k))).collect();
        if windows.len() < 8 {
            let expected = format!("at least 8 windows of {} s with all channels", cut.window);
            let found = format!("{} in {:.1} s{}", windows.len(), last - first, self.why_so_few(run));
            return Err(GapError::run("recording", expected, found));
        }
        mark_moving(&mut windows, &self.columns);
        Ok(windows)
    }

    /// Why a run has too few windows, as far as that can be seen.
    fn why_so_few(&self, run: &Run) -> String {
        let [first, last] = run.span();
        let m = &run.measured;
        let mut why = Vec::new();
        let least = 8.0 * self.cut.window + 0.3;
        if last - first < least {
            why.push(format!("record {least:.1} s at least"));
        }
        if let Some(position) = &m.position {
            let names = self.columns.iter().filter(|c| !position.column(**c).any(f64::is_finite));
            let names: Vec<&str> = names.map(|c| run.joint_names[*c].as_str()).collect();
            if !names.is_empty() {
                why.push(format!("positions of {} were not measured", names.join(", ")));
            }
            if median_interval(&position.time) > 0.02 {
                why.push(format!("joint states are {:.2} s apart (0.02 at most)", median_interval(&position.time)));
            }
        }
        if why.is_empty() { String::new() } else { format!(": {}", why.join("; ")) }
    }

    fn is_usable(&self, run: &Run, needed: &[Needed], from: f64) -> bool {
        let (from, to) = (from - 0.05, from + self.cut.window + 0.05);
        // What is smoothed looks as far beyond the window as the margin.
        let margin = self.cut.margin;
        let jumps = run.measured.base_pose.as_ref().is_some_and(|pose| jumps(pose, from - margin, to + margin));
        needed.iter().all(|one| one.covered.is_whole(from, to) && has_values(one, from, to)) && !jumps
    }

    /// Smoothed states of a part of the recording, freed of the sensors' `errors`.
    ///
    /// # Errors
    /// When it lacks what states are told by.
    pub fn starts<'r>(&self, view: &'r Run, errors: SensorErrors) -> Result<Starts<'r>, ReplayError> {
        if self.on_legs {
            Starts::on_legs(view, &self.columns, errors, Legs { model: self.model, feet: &self.feet.geoms })
        } else {
            Starts::new(view, &self.columns, self.free, errors)
        }
    }

    /// One window; `None` when its start cannot be found.
    pub fn window(&self, run: &Run, start: f64, held_out: bool) -> Option<Window> {
        let view = features::snippet(run, start - self.cut.margin, start + self.cut.window + self.cut.margin);
        let starts = self.starts(&view, self.sensor_errors(&Vec::new())).ok()?;
        starts.at(start)?;
        let attitude = if self.free { features::attitudes(self, &view, &starts, start)? } else { Vec::new() };
        Some(Window {
            start,
            since: start - run.span()[0],
            view,
            attitude,
            moving: true,
            held_out,
            run: 0,
            start_kept: Kept::default(),
            told: Told::default(),
        })
    }

    /// The command for each tick of a window, of ticks before it, and how many those are.
    ///
    /// # Errors
    /// When the run has no commands.
    pub fn commands(&self, window: &Window, numerics: &Numerics, past: usize) -> Result<Vec<Command>, GapError> {
        let held = window.told.held(self, window)?;
        let ticks = (self.cut.window / numerics.timestep).round() as usize;
        let at = |k: usize| {
            let mut command = Command::default();
            let time = window.start + (k as f64 - past as f64) * numerics.timestep;
            held.at(time, numerics.timestep, &mut command);
            command
        };
        Ok((0..ticks + past).map(at).collect())
    }
}

/// Which of some windows on end is held out.
fn drawn(some: usize) -> usize {
    (SplitMix64::of(DRAW_SEED, some as u64).uniform() * HELD_OUT as f64) as usize
}

/// Whether a free base has no measured poses.
///
/// # Errors
/// When it has none, and neither its legs nor the ground can make up for them.
fn walks_unseen(run: &Run, feet: &Feet, terrain: &Terrain) -> Result<bool, GapError> {
    let m = &run.measured;
    let lacks = |series: &Option<JointSeries>| series.as_ref().is_none_or(JointSeries::is_empty);
    if !lacks(&m.base_pose) {
        return Ok(false);
    }
    let without = |expected: &str| {
        let found = "none (`base = \"fixed\"` in run.toml is for a robot that is held)";
        Err(GapError::run("poses of the free base", expected, found))
    };
    if feet.geoms.is_empty() {
        return without("poses, or feet to follow: spheres on links that begin with a name of a foot");
    }
    if lacks(&m.orientation) {
        return without("poses, or the IMU's orientation, with which its legs tell where it goes");
    }
    if !terrain.is_plane() {
        return without("poses, since this ground is not a plane and only they tell where on it the robot walks");
    }
    Ok(true)
}

/// A pose that moves by less from one sample to the next may be noise \[m\].
const FAR: f64 = 0.1;

/// Whether a pose moves faster between two times \[s\] than any robot: where its estimate corrects itself, or recordings were joined.
fn jumps(pose: &JointSeries, from: f64, to: f64) -> bool {
    let (first, last) = (pose.time.partition_point(|&t| t < from), pose.time.partition_point(|&t| t <= to));
    (first.max(1)..last).any(|i| jumped(pose, 0..3, i, FASTEST_BASE, FAR))
}

/// Most values on end that may be missing of a column.
const MOST_MISSING: usize = 5;

/// A channel that windows need.
struct Needed<'a> {
    covered: Covered<'a>,
    /// Columns that have values somewhere.
    columns: Vec<usize>,
}

fn needed(run: &Run) -> Vec<Needed<'_>> {
    let (m, c) = (&run.measured, &run.commands);
    let all = [&m.position, &m.velocity, &m.torque, &m.gyro, &m.orientation, &m.base_pose, &c.position, &c.torque];
    let one = |series| {
        let has_some = |column: &usize| JointSeries::column(series, *column).any(f64::is_finite);
        Needed { covered: Covered::new(series), columns: (0..series.joints).filter(has_some).collect() }
    };
    all.into_iter().flatten().filter(|series| !series.is_empty()).map(one).collect()
}

/// Whether no column that has values elsewhere lacks more than [`MOST_MISSING`] of them on end between two times \[s\].
fn has_values(needed: &Needed, from: f64, to: f64) -> bool {
    let series = needed.covered.series;
    let (first, last) = (series.time.partition_point(|&t| t < from), series.time.partition_point(|&t| t <= to));
    let lacks = |column: usize| {
        let mut missing = 0;
        (first..last).any(|i| {
            missing = if series.row(i)[column].is_nan() { missing + 1 } else { 0 };
            missing > MOST_MISSING
        })
    };
    !needed.columns.iter().any(|column| lacks(*column))
}

fn role(name: &str, model: &Model) -> Role {
    let joint = |name: &str| model.joint_names().iter().position(|j| j == name);
    // Names of joints, links and shapes may have dots.
    let (kind, rest) = name.split_once('.').unwrap_or((name, ""));
    let parts: Vec<&str> = match rest.rsplit_once('.') {
        Some((member, field)) => vec![kind, member, field],
        None => vec![kind, rest],
    };
    match parts[..] {
        ["sensor", name, "encoder_bias"] => joint(name).map_or(Role::Dynamic, Role::EncoderBias),
        ["sensor", name, "encoder_latency"] => joint(name).map_or(Role::Dynamic, Role::EncoderLatency),
        ["sensor", "imu", "tilt_roll"] => Role::Tilt(0),
        ["sensor", "imu", "tilt_pitch"] => Role::Tilt(1),
        ["sensor", "imu", "gyro_bias_x"] => Role::GyroBias(0),
        ["sensor", "imu", "gyro_bias_y"] => Role::GyroBias(1),
        ["sensor", "imu", "gyro_bias_z"] => Role::GyroBias(2),
        ["sensor", "pose", "delay"] => Role::PoseDelay,
        ["terrain", "height"] => Role::Height,
        ["terrain", "slope_x"] => Role::Slope(0),
        ["terrain", "slope_y"] => Role::Slope(1),
        ["external", "start"] => Role::ForceStart,
        ["run", "start"] => Role::RunStart,
        ["actuator", _, "strength_drift"] => Role::Drift,
        ["actuator", name, "series_compliance"] => joint(name).map_or(Role::Dynamic, Role::Compliance),
        ["geom", geom, "radius_offset"] => {
            model.geoms.iter().position(|g| g.name == geom).map_or(Role::Dynamic, Role::Radius)
        }
        _ => Role::Dynamic,
    }
}

/// Joints with measured torque, speed and a controller's law to compare them with.
fn law_joints(run: &Run, columns: &[usize]) -> Vec<usize> {
    let m = &run.measured;
    let (Some(torque), Some(_), Some(_)) = (&m.torque, &m.velocity, &m.position) else { return Vec::new() };
    if run.actuator.kind != ActuatorKind::Pd || run.commands.position.is_none() {
        return Vec::new();
    }
    (0..columns.len())
        .filter(|&j| torque.column(columns[j]).any(|x| x != 0.0) && is_alive(run, "torque", j, columns))
        .collect()
}

/// Whether no fault says that a channel of a joint stood still, or that its torque is of another convention (velocities that are have been replaced).
pub fn is_alive(run: &Run, channel: &str, joint: usize, columns: &[usize]) -> bool {
    let name = format!("{channel} {}", run.joint_names[columns[joint]]);
    let is_dead = |kind: FaultKind| kind == FaultKind::Frozen || (kind == FaultKind::Convention && channel == "torque");
    !run.faults.iter().any(|f| is_dead(f.kind) && f.channel == name)
}

/// Windows with more than half of the recording's typical joint speed count as moving.
fn mark_moving(windows: &mut [Window], columns: &[usize]) {
    let speed = |w: &Window| {
        let position = w.view.measured.position.as_ref();
        let rows = position.map_or(0, |p| p.len());
        let mut sum = 0.0;
        for i in 1..rows {
            let (a, b) = (position.map(|p| p.row(i - 1)), position.map(|p| p.row(i)));
            let (Some(a), Some(b)) = (a, b) else { continue };
            sum += columns.iter().map(|&c| (b[c] - a[c]).abs()).filter(|x| x.is_finite()).sum::<f64>();
        }
        sum / rows.max(1) as f64
    };
    let speeds: Vec<f64> = windows.iter().map(speed).collect();
    let mut sorted = speeds.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = 0.5 * sorted[(sorted.len() * 9) / 10];
    windows.iter_mut().zip(speeds).for_each(|(w, s)| w.moving = s > middle);
    // A mode with hardly a window has no statistics of its own.
    let moving = windows.iter().filter(|w| w.moving).count();
    if moving < 6 || windows.len() - moving < 6 {
        windows.iter_mut().for_each(|w| w.moving = true);
    }
}
