//! Tosses of a box as a table of measured states, and the same tosses in the simulator.

use glam::{DQuat, DVec3};
use qv_sim::{BaseKind, Batch, Model, ModelOptions, SimError, SimOptions, State, Terrain};

const COLUMNS: [&str; 15] = ["toss", "time", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz"];

/// The box. Its inertia is that of a cube: the same about every axis.
#[derive(Debug, Clone, Copy)]
pub struct Cube {
    /// Edge \[m\].
    pub edge: f64,
    /// Mass \[kg\].
    pub mass: f64,
    /// Moment of inertia about the centre \[kg m²\].
    pub inertia: f64,
}

/// One measured state.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Time since the start of the toss \[s\].
    pub time: f64,
    /// Centre in the world \[m\].
    pub position: DVec3,
    /// World from box.
    pub rotation: DQuat,
    /// Velocity of the centre in the world \[m/s\].
    pub velocity: DVec3,
    /// Angular velocity as written \[rad/s\].
    pub turning: DVec3,
}

/// One toss: its number in the table and its samples in order of time, at least [`FEWEST`].
#[derive(Debug, Clone)]
pub struct Toss {
    pub number: usize,
    pub samples: Vec<Sample>,
}

/// Fewest samples of a toss.
pub const FEWEST: usize = 4;

/// Reads a table with the columns toss, time, x, y, z, qw, qx, qy, qz, vx, vy, vz, wx, wy, wz in any order.
///
/// # Errors
/// Names the line and what is wrong with it, or the toss that is too short.
pub fn parse(text: &str) -> Result<Vec<Toss>, String> {
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line)).filter(|(_, line)| !line.trim().is_empty());
    let (_, header) = lines.next().ok_or("expected a header line, found an empty table")?;
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let mut columns = [0; COLUMNS.len()];
    for (column, name) in columns.iter_mut().zip(COLUMNS) {
        *column = names
            .iter()
            .position(|n| *n == name)
            .ok_or_else(|| format!("line 1: expected a column `{name}`, found {header:?}"))?;
    }
    let mut tosses: Vec<Toss> = Vec::new();
    for (number, line) in lines {
        let (toss, sample) = row(line, &columns).map_err(|error| format!("line {number}: {error}"))?;
        let last = tosses.last_mut().filter(|last| last.number == toss);
        match last {
            Some(last) if last.samples.last().is_some_and(|before| before.time >= sample.time) => {
                return Err(format!("line {number}: expected a time after the line before, found {}", sample.time));
            }
            Some(last) => last.samples.push(sample),
            None => tosses.push(Toss { number: toss, samples: vec![sample] }),
        }
    }
    match tosses.iter().find(|toss| toss.samples.len() < FEWEST) {
        Some(short) => {
            Err(format!("toss {}: expected at least {FEWEST} samples, found {}", short.number, short.samples.len()))
        }
        None if tosses.is_empty() => Err("expected rows under the header, found none".into()),
        None => Ok(tosses),
    }
}

fn row(line: &str, columns: &[usize; COLUMNS.len()]) -> Result<(usize, Sample), String> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let mut value = [0.0; COLUMNS.len()];
    for (k, &column) in columns.iter().enumerate() {
        let text = fields.get(column).copied().unwrap_or("");
        let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
        value[k] = number.ok_or_else(|| format!("expected a finite number as {}, found {text:?}", COLUMNS[k]))?;
    }
    let [toss, time, x, y, z, qw, qx, qy, qz, vx, vy, vz, wx, wy, wz] = value;
    if toss < 0.0 || toss.fract() != 0.0 {
        return Err(format!("expected a whole number as toss, found {toss}"));
    }
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    if (rotation.length() - 1.0).abs() > 0.01 {
        return Err(format!("expected a unit quaternion, found one of length {}", rotation.length()));
    }
    let sample = Sample {
        time,
        position: DVec3::new(x, y, z),
        rotation: rotation.normalize(),
        velocity: DVec3::new(vx, vy, vz),
        turning: DVec3::new(wx, wy, wz),
    };
    Ok((toss as usize, sample))
}

impl Cube {
    /// The free box as a model.
    pub fn model(&self) -> Result<Model, SimError> {
        let Self { edge, mass, inertia } = self;
        let urdf = format!(
            r#"<robot name="box"><link name="box"><inertial><mass value="{mass}"/>
            <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>
            <collision><geometry><box size="{edge} {edge} {edge}"/></geometry></collision></link></robot>"#
        );
        Model::from_urdf(&urdf, &ModelOptions { base: BaseKind::Floating, ..Default::default() })
    }

    /// Height of the lowest corner \[m\].
    pub fn lowest_corner(&self, sample: &Sample) -> f64 {
        let half = 0.5 * self.edge;
        let up = sample.rotation.conjugate() * DVec3::Z;
        sample.position.z - half * (up.x.abs() + up.y.abs() + up.z.abs())
    }
}

impl Toss {
    /// Number of samples at the start, at most `most`, in which every corner is `clearance` \[m\] above the plane.
    pub fn flight(&self, cube: &Cube, clearance: f64, most: usize) -> usize {
        self.samples.iter().take(most).take_while(|sample| cube.lowest_corner(sample) > clearance).count()
    }

    /// The first row as it is written, its angular velocity taken to be in the box.
    pub fn start_as_written(&self) -> State {
        let first = &self.samples[0];
        state(first.position, first.rotation, first.velocity, first.turning)
    }

    /// State at the first sample that fits the given poses best: free fall, and a constant angular velocity (as of a
    /// body with the same inertia about every axis). With fewer than three poses, as written.
    pub fn start_fitted(&self, poses: &[Sample]) -> State {
        if poses.len() < 3 {
            return self.start_as_written();
        }
        let first = &self.samples[0];
        let fall = DVec3::new(0.0, 0.0, -gravity());
        let time = |s: &Sample| s.time - first.time;
        let flown = poses.iter().map(|s| (time(s), s.position - fall * (0.5 * time(s) * time(s))));
        let turned = poses.iter().map(|s| (time(s), rotation_vector(first.rotation.conjugate() * s.rotation)));
        let (position, velocity) = line(flown);
        let (offset, turning) = line(turned);
        state(position, first.rotation * DQuat::from_scaled_axis(offset), velocity, turning)
    }
}

/// Gravity of the simulation \[m/s²\].
fn gravity() -> f64 {
    -SimOptions::default().gravity[2]
}

fn state(position: DVec3, rotation: DQuat, velocity: DVec3, turning: DVec3) -> State {
    let q = [position.to_array().as_slice(), &[rotation.w, rotation.x, rotation.y, rotation.z]].concat();
    State { q, v: [velocity.to_array(), turning.to_array()].concat() }
}

/// Shortest rotation vector \[rad\].
pub fn rotation_vector(rotation: DQuat) -> DVec3 {
    (if rotation.w < 0.0 { -rotation } else { rotation }).to_scaled_axis()
}

/// Least squares of `value = offset + slope * time`.
fn line(points: impl Iterator<Item = (f64, DVec3)> + Clone) -> (DVec3, DVec3) {
    let count = points.clone().count() as f64;
    let (time, value) = points.clone().fold((0.0, DVec3::ZERO), |(t, v), p| (t + p.0 / count, v + p.1 / count));
    let (square, product) = points.fold((0.0, DVec3::ZERO), |(s, c), p| {
        let from_mean = p.0 - time;
        (s + from_mean * from_mean, c + (p.1 - value) * from_mean)
    });
    let slope = product / square;
    (value - slope * time, slope)
}

/// Median distance between the written angular velocities and those of the poses, read in box and in world axes
/// \[rad/s\]. The smaller one shows the convention.
pub fn turning_convention(tosses: &[Toss]) -> (f64, f64) {
    let (mut in_box, mut in_world) = (Vec::new(), Vec::new());
    for pair in tosses.iter().flat_map(|toss| toss.samples.windows(2)) {
        let step = pair[1].time - pair[0].time;
        let written = (pair[0].turning + pair[1].turning) * 0.5;
        in_box.push((rotation_vector(pair[0].rotation.conjugate() * pair[1].rotation) / step - written).length());
        in_world.push((rotation_vector(pair[1].rotation * pair[0].rotation.conjugate()) / step - written).length());
    }
    (median(in_box), median(in_world))
}

/// Middle value; not a number when there is none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Parameters that differ from neutral, by name.
pub type Setting = Vec<(&'static str, f64)>;

/// Position errors of one toss \[m\].
#[derive(Debug, Clone, Copy)]
pub struct TossError {
    /// Mean over the samples.
    pub mean: f64,
    /// At the last sample.
    pub last: f64,
}

/// Position errors of simulated tosses.
pub fn errors(tosses: &[Toss], paths: &[Vec<DVec3>]) -> Vec<TossError> {
    let of = |(toss, path): (&Toss, &Vec<DVec3>)| {
        let off: Vec<f64> = path.iter().zip(&toss.samples).map(|(p, s)| (*p - s.position).length()).collect();
        TossError { mean: off.iter().sum::<f64>() / off.len() as f64, last: off[off.len() - 1] }
    };
    tosses.iter().zip(paths).map(of).collect()
}

/// Simulates all tosses from their starts as one batch; gives the centre's positions \[m\] at every sample.
///
/// # Errors
/// When the table's samples are not evenly spaced, or the simulator refuses a value.
pub fn simulate(
    model: &Model,
    tosses: &[Toss],
    starts: &[State],
    setting: &[(&str, f64)],
) -> Result<Vec<Vec<DVec3>>, String> {
    let said = |error: SimError| error.to_string();
    let interval = even_interval(tosses)?;
    let per_sample = (interval / 0.001).ceil();
    let options = SimOptions { timestep: interval / per_sample, ..Default::default() };
    let mut sim = Batch::<f64>::new(model, &Terrain::plane(), &options, tosses.len()).map_err(said)?;
    for (env, start) in starts.iter().enumerate() {
        for (name, value) in setting {
            sim.set_parameter(env, name, *value).map_err(said)?;
        }
        sim.set_state(env, start).map_err(said)?;
    }
    let longest = tosses.iter().map(|toss| toss.samples.len()).max().unwrap_or(0);
    let mut paths = vec![Vec::new(); tosses.len()];
    for index in 0..longest {
        for (env, _) in tosses.iter().enumerate().filter(|(_, toss)| index < toss.samples.len()) {
            let q = sim.state(env).map_err(said)?.q;
            paths[env].push(DVec3::new(q[0], q[1], q[2]));
        }
        sim.step_many_parallel(per_sample as usize);
    }
    match (0..tosses.len()).find(|&env| sim.is_faulty(env) == Ok(true)) {
        Some(env) => Err(format!("toss {}: expected finite numbers, found that they ran away", tosses[env].number)),
        None => Ok(paths),
    }
}

/// Time between samples \[s\], the same throughout.
fn even_interval(tosses: &[Toss]) -> Result<f64, String> {
    let (mut sum, mut count) = (0.0, 0.0);
    for toss in tosses {
        sum += toss.samples[toss.samples.len() - 1].time - toss.samples[0].time;
        count += (toss.samples.len() - 1) as f64;
    }
    let interval: f64 = sum / count;
    for toss in tosses {
        for (index, sample) in toss.samples.iter().enumerate() {
            let expected = toss.samples[0].time + index as f64 * interval;
            if (sample.time - expected).abs() > 0.05 * interval {
                let number = toss.number;
                return Err(format!("toss {number}, sample {index}: expected time {expected}, found {}", sample.time));
            }
        }
    }
    Ok(interval)
}

/// Mean over the tosses of their mean errors \[m\].
pub fn mean(errors: &[TossError]) -> f64 {
    errors.iter().map(|error| error.mean).sum::<f64>() / errors.len() as f64
}
