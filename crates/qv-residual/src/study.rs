//! Windows of recordings in rollouts at the recording's own rate, as a diagnosis has them: what motors, base and ground are, whatever the step of
//! a training does to them.

use crate::ResidualError;
use crate::fitting::Windows;
use crate::identify::{Coordinate, values};
use crate::log::{Log, Stretch};
use qv_fit::Blocks;
use qv_policy::velocity::TaskRobot;
use qv_recording::Run;
use qv_rollout::channels::width;
use qv_rollout::noise::Noise;
use qv_rollout::replicate::{Replicate, record};
use qv_rollout::{Channel, Overrides, Rollout, Window, WindowOptions, compare};
use qv_sim::Terrain;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Recordings of each window that are simulated for the null.
const REPLICATES: u64 = 3;
/// Time that a window keeps from the ends of its stretch \[s\].
const MARGIN: f64 = 0.1;

/// A recording of the robot: joints may be in another order than in others.
struct RunWindows<'a> {
    rollout: Rollout<'a>,
    noise: Noise,
    windows: Vec<Window>,
}

impl<'a> RunWindows<'a> {
    fn new(run: &Run, robot: &'a TaskRobot, terrain: &Terrain) -> Result<Self, ResidualError> {
        let mut rollout = Rollout::new(run, &robot.model, terrain, &[], WindowOptions::default())?;
        // The simulator of the training knows nothing of what a recording states, and corrections are differences from that simulator.
        rollout.nominal = rollout.catalogue.iter().map(|p| p.neutral).collect();
        rollout.stated.clear();
        let noise = Noise::of(run, &rollout.columns);
        Ok(Self { rollout, noise, windows: Vec::new() })
    }

    /// Simulated against measured, `[settings][windows][numbers]`.
    fn residuals(&self, settings: &[Overrides]) -> Result<Vec<Blocks>, ResidualError> {
        let windows: Vec<&Window> = self.windows.iter().collect();
        Ok(compare(&self.rollout, &self.rollout.numerics, &windows, settings)?.values)
    }

    /// Windows of a robot without anything to find.
    fn null(&self, seed: u64) -> Result<Blocks, ResidualError> {
        let numerics = self.rollout.numerics;
        let replicate = Replicate { setting: Overrides::new(), numerics, seed, ground_error: 0.0 };
        let recorded = record(&self.rollout, &self.windows, &self.noise, &[replicate])?;
        let whole: Vec<&Window> = recorded.iter().flatten().flatten().collect();
        Ok(compare(&self.rollout, &numerics, &whole, &[Overrides::new()])?.values.remove(0))
    }
}

/// A robot on its ground and windows of its recordings.
pub struct Study<'a> {
    parts: Vec<RunWindows<'a>>,
    null: OnceLock<Blocks>,
    /// Recordings that lack a channel which most windows have: they are left out.
    pub left_out: Vec<String>,
}

impl<'a> Study<'a> {
    /// At most `most` windows, evenly spread over the stretches of `log` that `wanted` picks: number of the stretch, begin and end of the
    /// window \[s\].
    ///
    /// # Errors
    /// When a recording is not one of this robot, or no window is left.
    pub fn new(
        log: &Log,
        robot: &'a TaskRobot,
        terrain: &Terrain,
        most: usize,
        wanted: &dyn Fn(usize, [f64; 2]) -> bool,
    ) -> Result<Self, ResidualError> {
        let part = |(_, run): &(String, Run)| RunWindows::new(run, robot, terrain);
        let mut parts = log.runs.iter().map(part).collect::<Result<Vec<_>, _>>()?;
        let starts: Vec<Vec<f64>> = parts.iter().enumerate().map(|(k, part)| starts(log, k, part, wanted)).collect();
        let (channels, left_out) = shared_channels(log, &parts, &starts);
        let all: Vec<(usize, f64)> = (0..parts.len())
            .filter(|&k| parts[k].rollout.channels == channels)
            .flat_map(|k| starts[k].iter().map(move |&at| (k, at)))
            .collect();
        let count = all.len().min(most);
        let chosen: Vec<(usize, f64)> = (0..count).map(|k| all[k * all.len() / count]).collect();
        let window = |&(k, at): &(usize, f64)| Some((k, parts[k].rollout.window(&log.runs[k].1, at, false)?));
        let windows: Vec<(usize, Window)> = chosen.par_iter().filter_map(window).collect();
        windows.into_iter().for_each(|(k, window)| parts[k].windows.push(window));
        parts.retain(|part| !part.windows.is_empty());
        let first = parts.first_mut().ok_or_else(|| ResidualError::input("recordings", "windows to fit", "none"))?;
        first.rollout.settle_in(&first.windows[0])?;
        let depth = first.rollout.depth;
        parts.iter_mut().for_each(|part| part.rollout.depth = depth);
        Ok(Self { parts, null: OnceLock::new(), left_out })
    }
}

/// Begins \[s\] of the windows of a recording in which nothing is missing, one after the other in its stretches.
fn starts(log: &Log, run: usize, part: &RunWindows, wanted: &dyn Fn(usize, [f64; 2]) -> bool) -> Vec<f64> {
    let (name, run) = &log.runs[run];
    let length = part.rollout.cut.window;
    let of_stretch = |(k, stretch): (usize, &Stretch)| {
        let end = stretch.start + stretch.decisions(log.joints) as f64 / f64::from(log.rate);
        let begins = (0..).map(|n| stretch.start + MARGIN + f64::from(n) * length);
        let begins = begins.take_while(|at| at + length + MARGIN <= end);
        begins.filter(|&at| wanted(k, [at, at + length])).collect::<Vec<f64>>()
    };
    let own = log.stretches.iter().enumerate().filter(|(_, stretch)| stretch.recording == *name);
    part.rollout.usable(run, own.flat_map(of_stretch).collect())
}

/// The channels that most windows have, and the recordings with others.
fn shared_channels(log: &Log, parts: &[RunWindows], starts: &[Vec<f64>]) -> (Vec<Channel>, Vec<String>) {
    let with = |channels: &[Channel]| -> usize {
        parts.iter().zip(starts).filter(|(part, _)| part.rollout.channels == channels).map(|(_, s)| s.len()).sum()
    };
    let best = parts.iter().rev().map(|part| &part.rollout.channels).max_by_key(|channels| with(channels));
    let channels = best.cloned().unwrap_or_default();
    let others = parts.iter().zip(&log.runs).filter(|(part, _)| part.rollout.channels != channels);
    (channels.clone(), others.map(|(_, (name, _))| name.clone()).collect())
}

fn setting(coordinates: &[Coordinate], point: &[f64]) -> Overrides {
    let mut all = values(coordinates, point);
    all.sort_by_key(|s| s.0);
    all
}

impl Windows for Study<'_> {
    fn residuals(&self, coordinates: &[Coordinate], points: &[Vec<f64>]) -> Result<Vec<Blocks>, ResidualError> {
        let settings: Vec<Overrides> = points.iter().map(|p| setting(coordinates, p)).collect();
        let found: Vec<Vec<Blocks>> =
            self.parts.par_iter().map(|part| part.residuals(&settings)).collect::<Result<_, _>>()?;
        let mut all = vec![Blocks::new(); points.len()];
        for part in found {
            all.iter_mut().zip(part).for_each(|(all, blocks)| all.extend(blocks));
        }
        Ok(all)
    }

    /// Recorded once, of the robot as the simulator has it: what noise leaves hardly depends on the parameters.
    fn null(&self, _coordinates: &[Coordinate], _point: &[f64]) -> Result<Blocks, ResidualError> {
        if let Some(known) = self.null.get() {
            return Ok(known.clone());
        }
        let each: Vec<(&RunWindows, u64)> =
            self.parts.iter().flat_map(|p| (0..REPLICATES).map(move |seed| (p, seed))).collect();
        let recorded = each.into_par_iter().map(|(part, seed)| part.null(seed)).collect::<Result<Vec<_>, _>>()?;
        Ok(self.null.get_or_init(|| recorded.into_iter().flatten().collect()).clone())
    }

    /// Position and speed of a joint; turn and its speed about an axis; each other channel. What is not simulated is left out.
    fn groups(&self) -> Vec<Vec<usize>> {
        let (mut groups, mut first) = (Vec::<(Channel, Vec<usize>)>::new(), 0);
        let rollout = &self.parts[0].rollout;
        for &channel in &rollout.channels {
            let features = first..first + width(channel, rollout.cut.bins());
            first = features.end;
            let of = match channel {
                Channel::PoseAgainstImu(_) | Channel::Ground => continue,
                Channel::Velocity(joint) => Channel::Position(joint),
                Channel::Attitude(axis) => Channel::Gyro(axis),
                other => other,
            };
            match groups.iter_mut().find(|group| group.0 == of) {
                Some(group) => group.1.extend(features),
                None => groups.push((of, features.collect())),
            }
        }
        groups.into_iter().map(|group| group.1).collect()
    }
}
