//! The simulator driven by a recording: one environment for the whole run, one for each window.

use crate::ReplayError;
use crate::replay::commands::{Command, HeldCommands};
use crate::replay::legs::Legs;
use crate::replay::start::{Covered, SensorErrors, Starts};
use crate::run::{Base, Run};
use qv_core::JointSeries;
use qv_sim::{BaseKind, Batch, Model, Shape, SimError, SimOptions, State, Terrain};

/// How to replay.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayOptions {
    /// Length of a window \[s\].
    pub window: f64,
    /// Parameters by name and value; a `*` in a name stands for every joint, link or shape that fits.
    pub parameters: Vec<(String, f64)>,
    /// Time step of the simulation \[s\].
    pub timestep: f64,
    /// Whether the ground of each window is moved to the loaded feet.
    pub anchor_ground: bool,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        Self { window: 0.3, parameters: Vec::new(), timestep: 0.001, anchor_ground: true }
    }
}

/// Joint and base quantities over time. Empty arrays = not there; NaN = not there then.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace {
    /// Times \[s\], shape `[T]`.
    pub time: Vec<f64>,
    /// Positions \[rad\], shape `[T, n]`.
    pub position: Vec<f64>,
    /// Velocities \[rad/s\], shape `[T, n]`.
    pub velocity: Vec<f64>,
    /// Torques \[N m\], shape `[T, n]`.
    pub torque: Vec<f64>,
    /// Forces on the feet \[N\], shape `[T, feet]`.
    pub foot_force: Vec<f64>,
    /// `world_from_base` as x, y, z \[m\], w, x, y, z, shape `[T]`.
    pub base: Vec<[f64; 7]>,
    /// Number of joints `n`.
    pub joints: usize,
}

/// One window.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Index into the recorded times of its first instant.
    pub first: usize,
    /// What the simulator did, from that instant on.
    pub trace: Trace,
}

/// All windows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Windows {
    /// Length \[s\].
    pub length: f64,
    /// Windows that were simulated.
    pub windows: Vec<Window>,
    /// Windows left out, since something is missing in them.
    pub skipped: usize,
    /// Windows left out, since the simulation ran away in them.
    pub ran_away: usize,
}

/// Feet of a robot: shapes that touch the ground.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Feet {
    /// Names, such as `FL`.
    pub names: Vec<String>,
    /// Shape of each foot in the model.
    pub geoms: Vec<usize>,
    /// Foot of each joint; `None` for a joint of no leg.
    pub of_joint: Vec<Option<usize>>,
}

/// What the simulator did, beside what was recorded at the same times.
pub struct Simulated {
    /// Column of the run for each joint of the model.
    pub columns: Vec<usize>,
    /// Feet.
    pub feet: Feet,
    /// Recorded.
    pub recorded: Trace,
    /// Whole run.
    pub whole: Trace,
    /// Windows.
    pub windows: Windows,
    /// Time at which the simulation of the whole run ran away \[s\]; there is no whole run to compare then.
    pub ran_away: Option<f64>,
    /// Simulated time of all environments \[s\].
    pub seconds: f64,
}

/// Parameters from the text of a TOML file: numbers under their dotted names, below an optional table `parameters`.
///
/// # Errors
/// When the text is no TOML, or holds something that is no number.
pub fn parameters_from_toml(text: &str) -> Result<Vec<(String, f64)>, ReplayError> {
    let wrong = |found: String| ReplayError::file("parameters", "numbers under parameter names", found);
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| wrong(e.to_string()))?;
    let inner = table.get("parameters").and_then(toml::Value::as_table).unwrap_or(&table);
    let mut found = Vec::new();
    flatten(inner, "", &mut found).map_err(wrong)?;
    Ok(found)
}

fn flatten(table: &toml::Table, prefix: &str, found: &mut Vec<(String, f64)>) -> Result<(), String> {
    for (key, value) in table {
        let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            toml::Value::Float(x) => found.push((name, *x)),
            toml::Value::Integer(x) => found.push((name, *x as f64)),
            toml::Value::Table(inner) => flatten(inner, &name, found)?,
            other => return Err(format!("`{name}` is a {}", other.type_str())),
        }
    }
    Ok(())
}

/// Replays `run`: whole, and in windows.
///
/// # Errors
/// See [`crate::replay::replay`].
pub fn simulate(
    run: &Run,
    model: &Model,
    terrain: &Terrain,
    options: &ReplayOptions,
) -> Result<Simulated, ReplayError> {
    let (columns, free) = check(run, model, options)?;
    let feet = feet_of(run, model);
    let commands = HeldCommands::new(run, &columns)?;
    let parameters = all_parameters(run, model, terrain, options)?;
    let errors = sensor_errors(model, &parameters);
    let starts = if free && run.measured.base_pose.as_ref().is_none_or(JointSeries::is_empty) {
        Starts::on_legs(run, &columns, errors, Legs { model, feet: &feet.geoms })?
    } else {
        Starts::new(run, &columns, free, errors)?
    };
    let recorded = recorded(run, &columns, &feet, starts.velocities());
    // A robot that is held hangs clear of the floor, wherever its root is put; a mesh that is given is meant.
    let air = Terrain::none();
    let terrain = if !free && terrain.is_plane() { &air } else { terrain };
    let drive = Drive { model, terrain, options, feet: &feet, commands: &commands, parameters: &parameters };
    let times = &recorded.time;
    let whole_start = (0..times.len()).find_map(|i| starts.at(times[i]).map(|s| (i, s)));
    let Some((first, state)) = whole_start else {
        return Err(ReplayError::run("replay", "a stretch with all joints (and poses) measured", "none"));
    };
    let whole = drive.run(times, &[(first, times.len(), state)], free)?.remove(0);
    // A trace ends where its state is no longer finite.
    let ran_away = (whole.time.len() < times.len() - first).then(|| times[first + whole.time.len()]);
    let whole = if ran_away.is_some() { Trace { joints: columns.len(), ..Default::default() } } else { whole };
    let (plan, skipped) = plan_windows(run, times, &starts, &commands, options);
    let traces = if plan.is_empty() { Vec::new() } else { drive.run(times, &plan, free)? };
    let (mut windows, mut lost) = (Vec::new(), 0);
    for ((first, end, _), trace) in plan.iter().zip(traces) {
        if trace.time.len() == end - first {
            windows.push(Window { first: *first, trace });
        } else {
            lost += 1;
        }
    }
    let length = |t: &Trace| t.time.last().unwrap_or(&0.0) - t.time.first().unwrap_or(&0.0);
    let seconds = length(&whole) + windows.iter().map(|w| length(&w.trace)).sum::<f64>();
    let whole = padded(whole, first, times, columns.len(), feet.names.len());
    let windows = Windows { length: options.window, windows, skipped, ran_away: lost };
    Ok(Simulated { columns, feet, recorded, whole, windows, ran_away, seconds })
}

/// Column of `run` for each joint of `model`, shape `[n]`, and whether the base is free.
///
/// # Errors
/// When the positions look like degrees, a joint of the model is not in the run, or only one of them has a free base.
pub fn joint_columns(run: &Run, model: &Model) -> Result<(Vec<usize>, bool), ReplayError> {
    check(run, model, &ReplayOptions::default())
}

fn check(run: &Run, model: &Model, options: &ReplayOptions) -> Result<(Vec<usize>, bool), ReplayError> {
    if !(options.window > 2.0 * options.timestep && options.window < 1e4) {
        return Err(ReplayError::run(
            "window",
            "a length above two time steps and below 10000 s",
            format!("{} s", options.window),
        ));
    }
    if let Some(fault) = run.faults.iter().find(|f| f.kind == crate::run::FaultKind::DegreesSuspected) {
        // A table can say so; a bag's messages are in radians by their definitions.
        let found =
            format!("{}: {} (position_unit = \"deg\" in run.toml, where they are)", fault.channel, fault.detail);
        return Err(ReplayError::run("positions", "radians", found));
    }
    let mut columns = Vec::new();
    for name in model.joint_names() {
        let found = || {
            let known = run.joint_names.iter().map(String::as_str);
            let nearest = qv_sim::names::nearest(name, known).unwrap_or("none");
            format!("{} (nearest: {nearest})", run.joint_names.join(", "))
        };
        let column = run.joint_names.iter().position(|n| n == name);
        columns.push(column.ok_or_else(|| ReplayError::run("joints", format!("joint {name} of the model"), found()))?);
    }
    if columns.is_empty() {
        return Err(ReplayError::run("model", "at least one joint", "none"));
    }
    let free = model.base == BaseKind::Floating;
    if free != (run.base == Base::Free) {
        let word = |free: bool| if free { "free" } else { "fixed" };
        let expected = format!("a model with a {} base, as in the run", word(!free));
        return Err(ReplayError::run("base", expected, word(free)));
    }
    Ok((columns, free))
}

/// Feet by the run's names (the shape on a link of that prefix that reaches lowest; joints by the same prefix), or, where it names
/// none and the base is free, the spheres at the ends of the model's legs.
pub fn feet_of(run: &Run, model: &Model) -> Feet {
    if run.foot_names.is_empty() && model.base == BaseKind::Floating {
        return feet_of_model(model);
    }
    let mut feet = Feet { of_joint: vec![None; model.joints.len()], ..Default::default() };
    for name in &run.foot_names {
        let prefix = format!("{name}_");
        let Some(geom) = lowest_sphere(model, |link| model.links[link].name.starts_with(&prefix)) else { continue };
        for (_, foot) in model.joint_names().iter().zip(&mut feet.of_joint).filter(|(n, _)| n.starts_with(&prefix)) {
            *foot = Some(feet.names.len());
        }
        feet.names.push(name.clone());
        feet.geoms.push(geom);
    }
    feet
}

/// A foot for each chain of joints that ends in a sphere, called by the first word of its link (`FL` of `FL_calf`) where that is no other's.
fn feet_of_model(model: &Model) -> Feet {
    let mut feet = Feet { of_joint: vec![None; model.joints.len()], ..Default::default() };
    let ends = (1..model.links.len()).filter(|&l| model.links.iter().all(|other| other.parent != Some(l)));
    let ends: Vec<(usize, usize)> = ends.filter_map(|l| Some((l, lowest_sphere(model, |link| link == l)?))).collect();
    let word = |link: usize| model.links[link].name.split('_').next().unwrap_or_default();
    for &(end, geom) in &ends {
        let is_own = ends.iter().filter(|(other, _)| word(*other) == word(end)).count() == 1;
        let name = if is_own { word(end) } else { &model.links[end].name };
        let mut link = Some(end);
        while let Some(l) = link {
            if let Some(joint) = model.links[l].joint.filter(|j| feet.of_joint[*j].is_none()) {
                feet.of_joint[joint] = Some(feet.names.len());
            }
            link = model.links[l].parent;
        }
        feet.names.push(name.to_string());
        feet.geoms.push(geom);
    }
    feet
}

/// The sphere on the wanted links that reaches lowest when all joints are at zero.
fn lowest_sphere(model: &Model, wanted: impl Fn(usize) -> bool) -> Option<usize> {
    let poses = model.world_from_links(&vec![0.0; model.nq()]);
    let depth = |g: &usize| {
        let geom = &model.geoms[*g];
        poses[geom.link].transform_point(geom.link_from_geom.position).z
    };
    let spheres = (0..model.geoms.len())
        .filter(|&g| wanted(model.geoms[g].link) && matches!(model.geoms[g].shape, Shape::Sphere(_)));
    spheres.min_by(|a, b| depth(a).total_cmp(&depth(b)))
}

/// What the run states about its joints, then what the caller sets; names with `*` spelt out.
fn all_parameters(
    run: &Run,
    model: &Model,
    terrain: &Terrain,
    options: &ReplayOptions,
) -> Result<Vec<(String, f64)>, ReplayError> {
    let mut all = stated_parameters(run, model);
    all.extend(expand(model, terrain, &options.parameters)?);
    Ok(all)
}

/// Gives the joints of a model the rotor inertias that the run states: the model is then that of the robot, and constraints are as soft as its
/// inertias make them.
pub fn with_stated_rotors(run: &Run, model: &mut Model) {
    for joint in &mut model.joints {
        let column = run.joint_names.iter().position(|name| *name == joint.name);
        let stated = column.and_then(|column| run.joint_parameters[column].armature);
        joint.armature = stated.unwrap_or(joint.armature);
    }
}

/// What the run states about its joints, as parameters of the simulator.
pub fn stated_parameters(run: &Run, model: &Model) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for name in model.joint_names() {
        let Some(column) = run.joint_names.iter().position(|n| n == name) else { continue };
        let stated = &run.joint_parameters[column];
        let mut push = |name: String, value: Option<f64>| all.extend(value.map(|v| (name, v)));
        push(format!("joint.{name}.armature"), stated.armature);
        push(format!("joint.{name}.coulomb_friction"), stated.coulomb_friction);
        push(format!("joint.{name}.viscous_friction"), stated.viscous_friction);
        push(format!("sensor.{name}.encoder_bias"), stated.position_offset);
        stated.servo.iter().for_each(|(key, value)| push(format!("joint.{name}.{key}"), Some(*value)));
        push(format!("actuator.{name}.position_torque_limit"), stated.tau_max.or(run.actuator.tau_max));
    }
    all
}

/// Parameters with each `*` in a name spelt out.
///
/// # Errors
/// When no parameter fits a name with `*`.
pub fn expand(model: &Model, terrain: &Terrain, given: &[(String, f64)]) -> Result<Vec<(String, f64)>, ReplayError> {
    let mut all = Vec::new();
    if given.iter().any(|(name, _)| name.contains('*')) {
        let probe = Batch::<f64>::new(model, terrain, &SimOptions::default(), 1).map_err(simulator)?;
        for (name, value) in given {
            let fits: Vec<String> =
                probe.catalogue().iter().map(|p| p.name.clone()).filter(|n| matches(name, n)).collect();
            if fits.is_empty() {
                // As names with a star are written: the member, between two dots, stands for all.
                let mut known: Vec<String> = probe.catalogue().iter().filter_map(|p| with_star(&p.name)).collect();
                known.dedup();
                let found = qv_sim::names::unknown("parameter", name, known.iter().map(String::as_str));
                return Err(ReplayError::run("parameters", "parameters of this robot", found));
            }
            all.extend(fits.into_iter().map(|n| (n, *value)));
        }
    } else {
        all.extend(given.iter().cloned());
    }
    Ok(all)
}

/// Kind, member and field of a name such as `joint.FL_calf_joint.armature`, or kind and field. Names of members may have dots.
fn parts(name: &str) -> Vec<&str> {
    let Some((kind, rest)) = name.split_once('.') else { return vec![name] };
    match rest.rsplit_once('.') {
        Some((member, field)) => vec![kind, member, field],
        None => vec![kind, rest],
    }
}

/// `joint.*.armature` for `joint.FL_calf_joint.armature`; none for a name without a member.
fn with_star(name: &str) -> Option<String> {
    match parts(name)[..] {
        [kind, _, field] => Some(format!("{kind}.*.{field}")),
        _ => None,
    }
}

/// Whether `name` is `pattern` with any text for its `*`, within one part of the name.
fn matches(pattern: &str, name: &str) -> bool {
    let (pattern, name) = (parts(pattern), parts(name));
    let fits = |pattern: &str, part: &str| match pattern.split_once('*') {
        None => pattern == part,
        Some((head, tail)) => part.strip_prefix(head).is_some_and(|rest| rest.ends_with(tail)),
    };
    pattern.len() == name.len() && pattern.iter().zip(&name).all(|(pattern, part)| fits(pattern, part))
}

/// What the sensors get wrong by these parameters (`sensor.*`, of which the last one set holds): angles \[rad\], rates \[rad/s\], delays \[s\], joints
/// in the model's order; 0 for what is not among them.
pub fn sensor_errors(model: &Model, parameters: &[(String, f64)]) -> SensorErrors {
    let value = |name: &str| parameters.iter().rev().find(|(n, _)| n == name).map_or(0.0, |(_, v)| *v);
    SensorErrors {
        encoder_bias: model.joint_names().iter().map(|n| value(&format!("sensor.{n}.encoder_bias"))).collect(),
        imu_tilt: ["roll", "pitch"].map(|a| value(&format!("sensor.imu.tilt_{a}"))),
        gyro_bias: ["x", "y", "z"].map(|a| value(&format!("sensor.imu.gyro_bias_{a}"))),
        pose_delay: value("sensor.pose.delay"),
        encoder_latency: model.joint_names().iter().map(|n| value(&format!("sensor.{n}.encoder_latency"))).collect(),
    }
}

/// The measured channels at the stamps of the positions.
fn recorded(run: &Run, columns: &[usize], feet: &Feet, velocity: Option<&JointSeries>) -> Trace {
    let m = &run.measured;
    let position = m.position.as_ref().expect("checked before");
    let time = position.time.clone();
    let pick = |series: Option<&JointSeries>, columns: &[usize]| match series {
        None => Vec::new(),
        Some(series) => {
            let mut row = vec![0.0; series.joints];
            let mut values = Vec::with_capacity(time.len() * columns.len());
            for &t in &time {
                series.interpolate(t, &mut row);
                values.extend(columns.iter().map(|&c| row[c]));
            }
            values
        }
    };
    let foot_columns: Vec<usize> =
        feet.names.iter().filter_map(|name| run.foot_names.iter().position(|n| n == name)).collect();
    let base = pick(m.base_pose.as_ref(), &[0, 1, 2, 3, 4, 5, 6]);
    Trace {
        position: pick(Some(position), columns),
        velocity: pick(velocity, columns),
        torque: pick(m.torque.as_ref(), columns),
        foot_force: if feet.names.is_empty() { Vec::new() } else { pick(m.foot_force.as_ref(), &foot_columns) },
        base: base.chunks_exact(7).map(|c| c.try_into().expect("seven columns")).collect(),
        joints: columns.len(),
        time,
    }
}

/// First instant, end, and start state of each window.
fn plan_windows(
    run: &Run,
    times: &[f64],
    starts: &Starts,
    commands: &HeldCommands,
    options: &ReplayOptions,
) -> (Vec<(usize, usize, State)>, usize) {
    let (mut plan, mut skipped) = (Vec::new(), 0);
    let position = Covered::new(run.measured.position.as_ref().expect("checked before"));
    let pace = commands.pace().map(Covered::new);
    let mut from = times[0];
    while from + options.window <= times[times.len() - 1] + 1e-9 {
        let to = from + options.window;
        let first = times.partition_point(|&t| t < from - 1e-9);
        let end = times.partition_point(|&t| t < to - 1e-9);
        let whole = position.is_whole(from, to) && pace.is_some_and(|pace| pace.is_whole(from, to));
        match (end > first + 1 && whole).then(|| starts.at(times[first])).flatten() {
            Some(state) => plan.push((first, end, state)),
            None => skipped += 1,
        }
        from = to;
    }
    (plan, skipped)
}

fn simulator(error: SimError) -> ReplayError {
    ReplayError::run("simulator", "a simulation", error.to_string())
}

/// What all environments of a replay share.
struct Drive<'a> {
    model: &'a Model,
    terrain: &'a Terrain,
    options: &'a ReplayOptions,
    feet: &'a Feet,
    commands: &'a HeldCommands,
    parameters: &'a [(String, f64)],
}

impl Drive<'_> {
    fn options(&self) -> SimOptions {
        let longest = |suffixes: &[&str]| {
            let fits = self.parameters.iter().filter(|(n, _)| suffixes.iter().any(|s| n.ends_with(s)));
            fits.map(|(_, v)| *v).fold(0.0, f64::max).min(1.0)
        };
        SimOptions {
            timestep: self.options.timestep,
            max_command_latency: longest(&[".command_latency"]),
            max_sensor_latency: longest(&[".encoder_latency", "pose.delay"]),
            ..Default::default()
        }
    }

    /// Simulates stretches of the recorded times, each from its own state, side by side.
    fn run(&self, times: &[f64], stretches: &[(usize, usize, State)], free: bool) -> Result<Vec<Trace>, ReplayError> {
        let options = self.options();
        let mut batch = Batch::<f64>::new(self.model, self.terrain, &options, stretches.len()).map_err(simulator)?;
        let mut command = Command::default();
        for (env, (first, _, state)) in stretches.iter().enumerate() {
            for (name, value) in self.parameters {
                batch.set_parameter(env, name, *value).map_err(simulator)?;
            }
            // A window begins later in the run than its first stretch: motors that drift have drifted.
            if self.parameters.iter().any(|(name, value)| name.ends_with(".strength_drift") && *value != 0.0) {
                let start = batch.parameter(env, "run.start").map_err(simulator)? + times[*first] - times[0];
                batch.set_parameter(env, "run.start", start).map_err(simulator)?;
            }
            if free && self.options.anchor_ground {
                let height = batch.parameter(env, "terrain.height").map_err(simulator)? + self.ground(&state.q);
                batch.set_parameter(env, "terrain.height", height).map_err(simulator)?;
            }
            batch.set_state(env, state).map_err(simulator)?;
            let steps = (options.max_command_latency / options.timestep).ceil() as usize;
            for age in (0..=steps).rev().filter(|_| steps > 0) {
                let time = times[*first] - age as f64 * options.timestep;
                self.commands.at(time, options.timestep, &mut command);
                batch.set_past_command(env, age, &command.view()).map_err(simulator)?;
            }
        }
        let mut traces = vec![Trace { joints: self.model.joints.len(), ..Default::default() }; stretches.len()];
        let due = |(first, _, _): &(usize, usize, State), index: usize| {
            ((times[index] - times[*first]) / options.timestep).round() as u64
        };
        let last = stretches.iter().map(|s| due(s, s.1 - 1)).max().unwrap_or(0);
        let mut next: Vec<usize> = stretches.iter().map(|s| s.0).collect();
        // Stamps may be uneven: each environment is read at the step nearest to its own next stamp.
        for step in 0..=last {
            for (env, stretch) in stretches.iter().enumerate() {
                while next[env] < stretch.1 && due(stretch, next[env]) <= step {
                    if batch.is_faulty(env).map_err(simulator)? {
                        next[env] = stretch.1;
                    } else {
                        self.record(&batch, env, times[next[env]], free, &mut traces[env])?;
                        next[env] += 1;
                    }
                }
                if next[env] < stretch.1 {
                    let time = times[stretch.0] + step as f64 * options.timestep;
                    self.commands.at(time, options.timestep, &mut command);
                    batch.set_command(env, &command.view()).map_err(simulator)?;
                }
            }
            batch.step_parallel();
        }
        Ok(traces)
    }

    fn record(
        &self,
        batch: &Batch<f64>,
        env: usize,
        time: f64,
        free: bool,
        trace: &mut Trace,
    ) -> Result<(), ReplayError> {
        let sensed = batch.sensors(env).map_err(simulator)?;
        trace.time.push(time);
        trace.position.extend(&sensed.q);
        trace.velocity.extend(&sensed.dq);
        trace.torque.extend(&sensed.tau);
        trace.foot_force.extend(self.feet.geoms.iter().map(|&g| sensed.foot_force[g]));
        if free {
            let ([x, y, z], [qw, qx, qy, qz]) = (sensed.base_position, sensed.base_orientation);
            trace.base.push([x, y, z, qw, qx, qy, qz]);
        }
        Ok(())
    }

    /// How far the ground must rise \[m\] to touch the lowest feet at positions `q`: their mean height, those within
    /// 5 mm of the lowest.
    fn ground(&self, q: &[f64]) -> f64 {
        let poses = self.model.world_from_links(q);
        let gap = |g: &usize| {
            let geom = &self.model.geoms[*g];
            let centre = poses[geom.link].transform_point(geom.link_from_geom.position);
            let Shape::Sphere(radius) = geom.shape else { return None };
            let ground = self.terrain.height_below(centre.x, centre.y, centre.z + 1.0)?;
            Some(centre.z - radius - ground)
        };
        let gaps: Vec<f64> = self.feet.geoms.iter().filter_map(gap).collect();
        let lowest = gaps.iter().copied().fold(f64::INFINITY, f64::min);
        let near: Vec<f64> = gaps.into_iter().filter(|g| *g < lowest + 0.005).collect();
        if near.is_empty() { 0.0 } else { near.iter().sum::<f64>() / near.len() as f64 }
    }
}

/// The trace on all recorded times: NaN before its start and after it ended.
fn padded(trace: Trace, first: usize, times: &[f64], joints: usize, feet: usize) -> Trace {
    if first == 0 && trace.time.len() == times.len() {
        return trace;
    }
    let pad = |values: &[f64], width: usize| {
        let mut all = vec![f64::NAN; times.len() * width];
        let from = first * width;
        all[from..from + values.len()].copy_from_slice(values);
        all
    };
    let mut base = Vec::new();
    if !trace.base.is_empty() {
        base = vec![[f64::NAN; 7]; times.len()];
        base[first..first + trace.base.len()].copy_from_slice(&trace.base);
    }
    Trace {
        time: times.to_vec(),
        position: pad(&trace.position, joints),
        velocity: pad(&trace.velocity, joints),
        torque: pad(&trace.torque, joints),
        foot_force: pad(&trace.foot_force, feet),
        base,
        joints,
    }
}
