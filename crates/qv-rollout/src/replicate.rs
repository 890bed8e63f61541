//! Recordings of a simulated robot: what noise and numerics alone look like.
//!
//! Each window is recorded anew: simulated from the measured state a little before it, seen by sensors with the noise of
//! the recording, its start found again from what they saw. The same pipeline then gives the features of that robot.

use crate::noise::{Noise, read};
use crate::residuals::are_near;
use crate::{HeldCommands, Numerics, Overrides, Rollout, RolloutError, Sensors, Simulation, Start, Window};
use glam::{DQuat, DVec3};
use qv_core::JointSeries;
use qv_core::random::SplitMix64;
use qv_recording::Run;
use qv_sim::{ActsOn, Batch, GeomField, Precision, SensorReading, WorldField};
use rayon::prelude::*;
use std::sync::Arc;

/// A robot to record windows of.
pub struct Replicate {
    /// What it is.
    pub setting: Overrides,
    /// How it is simulated.
    pub numerics: Numerics,
    /// Of its noise.
    pub seed: u64,
    /// Standard deviation of the height of the ground under each foot, drawn anew for each window \[m\].
    pub ground_error: f64,
}

/// Windows recorded of a replicate; `None` where it ran away.
///
/// # Errors
/// When a parameter has a value that means nothing.
pub fn record(
    rollout: &Rollout,
    windows: &[Window],
    noise: &Noise,
    replicates: &[Replicate],
) -> Result<Vec<Vec<Option<Window>>>, RolloutError> {
    const TOGETHER: usize = 16;
    let record_chunk = if are_near(rollout, windows) { record_chunk::<f32> } else { record_chunk::<f64> };
    replicates
        .iter()
        .map(|replicate| {
            let indexed: Vec<(usize, &Window)> = windows.iter().enumerate().collect();
            let chunks: Vec<Vec<Option<Window>>> = indexed
                .par_chunks(TOGETHER)
                .map(|chunk| record_chunk(rollout, chunk, noise, replicate))
                .collect::<Result<_, RolloutError>>()?;
            Ok(chunks.into_iter().flatten().collect())
        })
        .collect()
}

fn record_chunk<T: Precision>(
    rollout: &Rollout,
    windows: &[(usize, &Window)],
    noise: &Noise,
    replicate: &Replicate,
) -> Result<Vec<Option<Window>>, RolloutError> {
    let (numerics, setting) = (&replicate.numerics, &replicate.setting);
    let latencies = [rollout.longest_latency(setting), rollout.sensor_latency(setting)];
    let held: Vec<Arc<HeldCommands>> = windows.iter().map(|(_, w)| w.held(rollout)).collect::<Result<_, _>>()?;
    let mut simulation = Simulation::<T>::new(rollout, *numerics, latencies, windows.len())?;
    let mut recorders = Vec::new();
    for (env, ((index, window), held)) in windows.iter().zip(&held).enumerate() {
        recorders.push(Recorder::new(rollout, &mut simulation, env, (window, held), replicate, *index as u64)?);
    }
    let ticks = recorders.iter().flatten().map(|r| r.ticks(numerics.timestep)).max().unwrap_or(0);
    for tick in 0..=ticks {
        for (env, recorder) in recorders.iter_mut().enumerate() {
            if let Some(recorder) = recorder {
                recorder.look(&simulation.batch, env, tick, numerics.timestep, noise)?;
            }
        }
        simulation.step()?;
    }
    let finish = |(env, recorder): (usize, Option<Recorder>)| {
        let whole = !simulation.batch.is_faulty(env).unwrap_or(true);
        let view = recorder.filter(|_| whole)?.view;
        let (start, held_out) = (windows[env].1.start, windows[env].1.held_out);
        let seen = rollout.window(&view, start, held_out)?;
        let &Window { moving, since, .. } = windows[env].1;
        Some(seen.with(moving, since))
    };
    Ok(recorders.into_iter().enumerate().map(finish).collect())
}

/// Ground that is a little higher or lower under each foot than the simulator's, as larger or smaller feet.
fn uneven<T: Precision>(
    rollout: &Rollout,
    batch: &mut Batch<T>,
    env: usize,
    replicate: &Replicate,
    stream: u64,
) -> Result<(), RolloutError> {
    if !(rollout.free && replicate.ground_error > 0.0) {
        return Ok(());
    }
    let mut random = SplitMix64::of(replicate.seed ^ 0x6775_6e64, stream);
    for &geom in &rollout.feet.geoms {
        if let Some(id) = rollout.parameter_of(ActsOn::Geom(geom, GeomField::RadiusOffset)) {
            let value = rollout.value(&replicate.setting, id) + random.normal(replicate.ground_error);
            batch.set_parameter_at(env, id, value)?;
        }
    }
    Ok(())
}

/// Writes what the sensors of one environment see.
struct Recorder {
    view: Run,
    from: f64,
    to: f64,
    /// Next rows due of the state and pose streams: stamps of the recording.
    due: [Vec<f64>; 2],
    next: [usize; 2],
    random: SplitMix64,
    columns: Vec<usize>,
    /// A row that is written.
    row: Vec<f64>,
}

impl Recorder {
    fn new<'a, T: Precision>(
        rollout: &Rollout,
        simulation: &mut Simulation<'a, T>,
        env: usize,
        (window, held): (&'a Window, &'a HeldCommands),
        replicate: &Replicate,
        stream: u64,
    ) -> Result<Option<Self>, RolloutError> {
        let stamps = |s: &Option<JointSeries>| s.as_ref().map_or(Vec::new(), |s| s.time.clone());
        let due = [stamps(&window.view.measured.position), stamps(&window.view.measured.base_pose)];
        let first = due[0].first().copied().unwrap_or(window.start);
        let last = due[0].last().copied().unwrap_or(window.start);
        let from = (window.start - rollout.cut.margin + 0.08).max(first);
        // On a stamp, so that rows fall on steps.
        let from = due[0].iter().copied().find(|&t| t >= from).unwrap_or(from);
        let Ok(starts) = rollout.starts(&window.view, rollout.sensor_errors(&replicate.setting)) else {
            return Ok(None);
        };
        let Some(seen) = starts.at(from) else { return Ok(None) };
        let since = window.since + (from - window.start);
        let start = Start { time: from, since, ..window.starting(rollout, held) };
        let (touching, state) =
            simulation.place(rollout, env, &replicate.setting, (&start, Sensors::AsTheyAre), &seen)?;
        uneven(rollout, &mut simulation.batch, env, replicate, stream)?;
        if let (true, Some(id)) = (rollout.free, rollout.parameter_of(ActsOn::World(WorldField::Height))) {
            // The replicate's ground is where its feet are; where the ground is expected is seen through the pose.
            let expected = rollout.value(&replicate.setting, id);
            let mut state = state.into_owned();
            state.q[2] += expected - touching;
            simulation.batch.set_parameter_at(env, id, expected)?;
            simulation.batch.set_state(env, &state)?;
        }
        simulation.remember(rollout, env, &replicate.setting, &start)?;
        let next = due.each_ref().map(|d| d.partition_point(|&t| t < from - 1e-9));
        let mut view = window.view.clone();
        empty(&mut view);
        let random = SplitMix64::of(replicate.seed, stream);
        let columns = rollout.columns.clone();
        Ok(Some(Self { view, from, to: last, due, next, random, columns, row: Vec::new() }))
    }

    fn ticks(&self, timestep: f64) -> usize {
        ((self.to - self.from) / timestep).ceil() as usize
    }

    /// Reads the sensors where a row is due.
    fn look<T: Precision>(
        &mut self,
        batch: &Batch<T>,
        env: usize,
        tick: usize,
        timestep: f64,
        noise: &Noise,
    ) -> Result<(), RolloutError> {
        let time = self.from + tick as f64 * timestep;
        let is_due = |k: usize| self.due[k].get(self.next[k]).is_some_and(|&t| t <= time + 0.5 * timestep);
        let (state, pose) = (is_due(0), is_due(1));
        if state || pose {
            let seen = batch.sensors(env)?;
            if state {
                self.next[0] += 1;
                self.write_state(time, &seen, noise);
            }
            if pose {
                self.next[1] += 1;
                self.write_pose(time, &seen, noise);
            }
        }
        Ok(())
    }

    fn write_state(&mut self, time: f64, seen: &SensorReading, noise: &Noise) {
        let (random, columns, row) = (&mut self.random, &self.columns, &mut self.row);
        let mut joints = |series: &mut Option<JointSeries>, values: &[f64], deviations: &[f64], steps: &[f64]| {
            if let Some(series) = series {
                row.clear();
                row.resize(series.joints, 0.0);
                for (j, &c) in columns.iter().enumerate() {
                    row[c] = read(values[j] + random.normal(deviations[j]), steps[j]);
                }
                push(series, time, row);
            }
        };
        let m = &mut self.view.measured;
        let [q, dq, tau] = &noise.steps;
        joints(&mut m.position, &seen.q, &noise.position, q);
        joints(&mut m.velocity, &seen.dq, &noise.velocity, dq);
        joints(&mut m.torque, &seen.tau, &noise.torque, tau);
        let mut vector = |series: &mut Option<JointSeries>, values: [f64; 3], deviation: f64| {
            if let Some(series) = series {
                push(series, time, &values.map(|x| x + random.normal(deviation)));
            }
        };
        vector(&mut m.gyro, seen.gyro, noise.gyro);
        vector(&mut m.acceleration, seen.acc, noise.acceleration);
        if let Some(series) = &mut m.orientation {
            push(series, time, &turned(seen.imu_orientation, noise.orientation, random));
        }
    }

    fn write_pose(&mut self, time: f64, seen: &SensorReading, noise: &Noise) {
        let random = &mut self.random;
        if let Some(series) = &mut self.view.measured.base_pose {
            let place = seen.base_position.map(|x| x + random.normal(noise.place));
            let turn = turned(seen.base_orientation, noise.pose, random);
            push(series, time, &[&place[..], &turn[..]].concat());
        }
    }
}

/// Takes all measured rows out.
fn empty(view: &mut Run) {
    let m = &mut view.measured;
    let all = [
        &mut m.position,
        &mut m.velocity,
        &mut m.torque,
        &mut m.gyro,
        &mut m.acceleration,
        &mut m.orientation,
        &mut m.base_pose,
    ];
    for series in all.into_iter().flatten() {
        series.time.clear();
        series.values.clear();
    }
    m.foot_force = None;
}

fn push(series: &mut JointSeries, time: f64, row: &[f64]) {
    // Two stamps nearer than a step fall on one: the first row stays.
    if series.time.last().is_none_or(|&last| time > last) {
        series.time.push(time);
        series.values.extend_from_slice(row);
    }
}

/// A quaternion w, x, y, z turned by noise about each of its axes.
fn turned(wxyz: [f64; 4], deviation: f64, random: &mut SplitMix64) -> [f64; 4] {
    let by = DVec3::new(random.normal(deviation), random.normal(deviation), random.normal(deviation));
    let q = DQuat::from_xyzw(wxyz[1], wxyz[2], wxyz[3], wxyz[0]) * DQuat::from_scaled_axis(by);
    [q.w, q.x, q.y, q.z]
}
