//! What a run says about the robot on a grid of instants: its state, where its feet stand, on what, and where they slip.

use crate::ContactError;
use crate::ground::Ground;
use glam::{DQuat, DVec3};
use qv_recording::Run;
use qv_rollout::{CoveredSeries, HeldCommands, Overrides, Rollout, Start, Starts};
use qv_sim::{Shape, State};
use rayon::prelude::*;
use serde::Serialize;

/// Interval of the grid \[s\].
pub const TICK: f64 = 0.05;
/// A foot no higher than this above the lowest ones stands \[m\].
const STANDING: f64 = 0.008;
/// Ground is looked for from so far above a foot on: as much as poses and mesh may be off \[m\].
pub(crate) const ABOVE: f64 = 0.15;
/// A standing foot that moves farther than this in a tick slips \[m\].
const SLIPPING: f64 = 0.006;
/// What the state at an instant needs to be recorded before and after it \[s\].
const MARGIN: f64 = 0.1;

/// A foot at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// Where its sole is \[m\], in the world.
    pub sole: DVec3,
    /// Label of the ground below it.
    pub label: Option<usize>,
    /// Whether it stands.
    pub stands: bool,
}

/// The robot at an instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Instant {
    /// Its smoothed measured state.
    pub state: State,
    /// Its feet.
    pub feet: Vec<Foot>,
}

/// A place where a standing foot slipped.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SlipPlace {
    /// Run that it is of.
    pub run: usize,
    /// Time \[s\].
    pub time: f64,
    /// Where the foot was, in the world \[m\].
    pub at: [f64; 2],
    /// How far it slipped within 0.05 s \[m\].
    pub distance: f64,
    /// Label below it.
    pub label: usize,
}

/// One run, prepared.
pub struct Recording<'r> {
    run: &'r Run,
    /// Instants at `start + k` ticks; `None` where something is missing.
    pub instants: Vec<Option<Instant>>,
    /// Time of the first one \[s\].
    pub start: f64,
    /// The commands.
    pub commands: HeldCommands,
    starts: Starts<'r>,
}

impl<'r> Recording<'r> {
    /// Looks at `run` of a robot with a free base.
    ///
    /// # Errors
    /// When the run is not one of this robot, or lacks poses or commands.
    pub fn new(run: &'r Run, rollout: &Rollout, ground: &Ground) -> Result<Self, ContactError> {
        if !rollout.free {
            return Err(ContactError::run("base", "a robot that walks", "a base that is held"));
        }
        if rollout.feet.geoms.is_empty() {
            return Err(ContactError::run("feet", "spheres at the ends of the legs", "none"));
        }
        let (columns, _) = qv_rollout::joint_columns(run, rollout.model)?;
        if columns != rollout.columns {
            let found = run.joint_names.join(", ");
            return Err(ContactError::run("joints", "those of the first recording, in its order", found));
        }
        let commands = HeldCommands::new(run, &columns)?;
        let errors = rollout.sensor_errors(&Overrides::new());
        let starts = Starts::new(run, &columns, rollout.free, errors)?;
        let [first, last] = run.span();
        let start = first + MARGIN;
        let count = ((last - MARGIN - start) / TICK).floor().max(0.0) as usize + 1;
        let needed = needed(run, &commands);
        let at = |k: usize| {
            let time = start + k as f64 * TICK;
            let whole = needed.iter().all(|series| series.is_whole(time - TICK, time + TICK));
            let state = whole.then(|| starts.at(time)).flatten()?;
            Some(instant(rollout, ground, state))
        };
        let instants = (0..count).into_par_iter().map(at).collect();
        Ok(Self { run, instants, start, commands, starts })
    }

    /// The start of a simulation of so long \[s\] at an instant.
    pub(crate) fn start_at<'a>(&'a self, index: usize, length: f64) -> Start<'a> {
        let time = self.time(index);
        let since = time - self.run.span()[0];
        Start {
            view: self.run,
            held: &self.commands,
            time,
            since,
            during: [time, time + length],
            starts: Some(&self.starts),
        }
    }

    /// Time of an instant \[s\].
    pub fn time(&self, index: usize) -> f64 {
        self.start + index as f64 * TICK
    }

    /// Labels under standing feet at instants `from` to `to`; `None` where one of them is missing.
    pub fn touched(&self, from: usize, to: usize) -> Option<Vec<usize>> {
        let mut labels = Vec::new();
        for instant in self.instants.get(from..=to)? {
            let standing = instant.as_ref()?.feet.iter().filter(|f| f.stands);
            labels.extend(standing.filter_map(|f| f.label));
        }
        labels.sort_unstable();
        labels.dedup();
        Some(labels)
    }

    /// Where standing feet slipped.
    pub fn slips(&self, run: usize) -> Vec<SlipPlace> {
        let mut slips = Vec::new();
        for (k, pair) in self.instants.windows(2).enumerate() {
            let [Some(a), Some(b)] = pair else { continue };
            for (before, after) in a.feet.iter().zip(&b.feet) {
                let distance = (after.sole - before.sole).truncate().length();
                let Some(label) = before.label.filter(|_| before.stands && after.stands) else { continue };
                if distance > SLIPPING {
                    let at = [before.sole.x, before.sole.y];
                    slips.push(SlipPlace { run, time: self.time(k), at, distance, label });
                }
            }
        }
        slips
    }

    /// Time that feet stood on each of `labels` labels, summed over feet \[s\].
    pub fn contact_time(&self, labels: usize) -> Vec<f64> {
        let mut time = vec![0.0; labels];
        for foot in self.instants.iter().flatten().flat_map(|i| &i.feet).filter(|f| f.stands) {
            if let Some(label) = foot.label {
                time[label] += TICK;
            }
        }
        time
    }
}

/// Joints, poses and commands, which may have no hole about a time that is looked at.
fn needed<'a>(run: &'a Run, commands: &'a HeldCommands) -> Vec<CoveredSeries<'a>> {
    let m = &run.measured;
    let series = [&m.position, &m.velocity, &m.gyro, &m.orientation, &m.base_pose];
    series.into_iter().flatten().chain(commands.pace()).filter(|s| !s.is_empty()).map(CoveredSeries::new).collect()
}

fn instant(rollout: &Rollout, ground: &Ground, state: State) -> Instant {
    let model = rollout.model;
    let poses = model.world_from_links(&state.q);
    let place = |&g: &usize| {
        let geom = &model.geoms[g];
        let centre = poses[geom.link].transform_point(geom.link_from_geom.position);
        let radius = if let Shape::Sphere(radius) = geom.shape { radius } else { 0.0 };
        // No higher: a table above the robot is not what it stands on.
        let below = ground.below(centre + ABOVE * DVec3::Z);
        let height = below.map_or(f64::INFINITY, |(_, height)| centre.z - radius - height);
        (Foot { sole: centre - radius * DVec3::Z, label: below.map(|b| b.0), stands: false }, height)
    };
    let mut places: Vec<(Foot, f64)> = rollout.feet.geoms.iter().map(place).collect();
    let lowest = places.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
    places.iter_mut().for_each(|(foot, height)| foot.stands = *height < lowest + STANDING);
    Instant { state, feet: places.into_iter().map(|p| p.0).collect() }
}

/// Numbers in which two states differ, seen from `heading` (yaw of the base \[rad\]): base position, turn, velocity, each
/// forward, left, up; rates of the base in its own axes; joint positions, joint velocities. Shape `[12 + 2 joints]`.
pub fn difference(measured: &State, simulated: &State, heading: f64) -> Vec<f64> {
    let turn = DQuat::from_rotation_z(-heading);
    let vector = |v: &[f64], i: usize| DVec3::new(v[i], v[i + 1], v[i + 2]);
    let rotation = |s: &State| DQuat::from_xyzw(s.q[4], s.q[5], s.q[6], s.q[3]);
    let relative = rotation(measured) * rotation(simulated).conjugate();
    let relative = if relative.w < 0.0 { -relative } else { relative };
    let mut out = Vec::with_capacity(measured.q.len() + measured.v.len());
    out.extend((turn * (vector(&measured.q, 0) - vector(&simulated.q, 0))).to_array());
    out.extend((turn * relative.to_scaled_axis()).to_array());
    out.extend((turn * (vector(&measured.v, 0) - vector(&simulated.v, 0))).to_array());
    out.extend(measured.v[3..6].iter().zip(&simulated.v[3..6]).map(|(a, b)| a - b));
    out.extend(measured.q[7..].iter().zip(&simulated.q[7..]).map(|(a, b)| a - b));
    out.extend(measured.v[6..].iter().zip(&simulated.v[6..]).map(|(a, b)| a - b));
    out
}

/// Yaw of a base \[rad\].
pub fn heading(state: &State) -> f64 {
    let (w, x, y, z) = (state.q[3], state.q[4], state.q[5], state.q[6]);
    (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(yaw: f64, x: f64) -> State {
        let q = DQuat::from_rotation_z(yaw);
        State { q: vec![x, 0.0, 0.3, q.w, q.x, q.y, q.z, 0.5], v: vec![0.0; 7] }
    }

    #[test]
    fn states_differ_forward_and_left() {
        let (a, b) = (state(1.5, 0.1), state(1.4, 0.0));
        let apart = difference(&a, &b, heading(&b));
        assert!((heading(&b) - 1.4).abs() < 1e-12);
        assert!((apart[0] - 0.1 * 1.4_f64.cos()).abs() < 1e-12 && (apart[1] + 0.1 * 1.4_f64.sin()).abs() < 1e-12);
        assert!((apart[5] - 0.1).abs() < 1e-12 && apart[3].abs() < 1e-12);
        assert_eq!(apart.len(), 14);
        assert!(difference(&a, &a, 0.3).iter().all(|x| x.abs() < 1e-12));
    }
}
