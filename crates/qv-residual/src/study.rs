//! Windows of recordings in rollouts at the recording's own rate, as a diagnosis has them: what motors, base and ground are, whatever the step of
//! a training does to them.

use crate::ResidualError;
use crate::fitting::Windows;
use crate::identify::{Coordinate, values};
use crate::log::Log;
use qv_fit::Blocks;
use qv_policy::velocity::TaskRobot;
use qv_rollout::channels::width;
use qv_rollout::replicate::{Noise, Replicate, record};
use qv_rollout::{Channel, Overrides, Rollout, Window, WindowOptions, compare};
use qv_sim::Terrain;
use rayon::prelude::*;

/// Recordings of each window that are simulated for the null.
const REPLICATES: u64 = 3;
/// Time that a window keeps from the ends of its stretch \[s\].
const MARGIN: f64 = 0.1;

/// A robot on its ground and windows of its recordings.
pub struct Study<'a> {
    rollout: Rollout<'a>,
    windows: Vec<Window>,
    noise: Noise,
}

impl<'a> Study<'a> {
    /// At most `most` windows, evenly spread over the stretches of `log` that `wanted` picks and times \[s\] that `is_known` lets pass: recording
    /// by name, begin and end of the window.
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
        let none = || ResidualError::input("recordings", "windows to fit", "none");
        let (_, first) = log.runs.first().ok_or_else(none)?;
        let mut rollout = Rollout::new(first, &robot.model, terrain, &[], WindowOptions::default())?;
        let length = rollout.cut.window;
        let mut starts = Vec::new();
        for (k, stretch) in log.stretches.iter().enumerate() {
            let Some(run) = log.runs.iter().position(|(name, _)| *name == stretch.recording) else { continue };
            let end = stretch.start + stretch.decisions(log.joints) as f64 / f64::from(log.rate);
            let begins = (0..).map(|n| stretch.start + MARGIN + f64::from(n) * length);
            let begins = begins.take_while(|at| at + length + MARGIN <= end);
            starts.extend(begins.filter(|&at| wanted(k, [at, at + length])).map(|at| (run, at)));
        }
        let all = starts.len();
        if all > most {
            starts = (0..most).map(|k| starts[k * all / most]).collect();
        }
        let window = |&(run, at): &(usize, f64)| rollout.window(&log.runs[run].1, at, false);
        let windows: Vec<Window> = starts.par_iter().filter_map(window).collect();
        rollout.settle_in(windows.first().ok_or_else(none)?)?;
        let noise = Noise::of(first, &rollout.columns);
        Ok(Self { rollout, windows, noise })
    }

    fn setting(&self, coordinates: &[Coordinate], point: &[f64]) -> Overrides {
        let mut all = values(coordinates, point);
        all.sort_by_key(|s| s.0);
        all
    }
}

impl Windows for Study<'_> {
    fn residuals(&self, coordinates: &[Coordinate], points: &[Vec<f64>]) -> Result<Vec<Blocks>, ResidualError> {
        let settings: Vec<Overrides> = points.iter().map(|p| self.setting(coordinates, p)).collect();
        let windows: Vec<&Window> = self.windows.iter().collect();
        Ok(compare(&self.rollout, &self.rollout.numerics, &windows, &settings)?.values)
    }

    fn null(&self, coordinates: &[Coordinate], point: &[f64]) -> Result<Blocks, ResidualError> {
        let setting = self.setting(coordinates, point);
        let numerics = self.rollout.numerics;
        let replicate = |seed| Replicate { setting: setting.clone(), numerics, seed, ground_error: 0.0 };
        let replicates: Vec<Replicate> = (0..REPLICATES).map(replicate).collect();
        let recorded = record(&self.rollout, &self.windows, &self.noise, &replicates)?;
        let whole: Vec<&Window> = recorded.iter().flatten().flatten().collect();
        Ok(compare(&self.rollout, &numerics, &whole, std::slice::from_ref(&setting))?.values.remove(0))
    }

    /// Position and speed of a joint; turn and its speed about an axis; each other channel. What is not simulated is left out.
    fn groups(&self) -> Vec<Vec<usize>> {
        let (mut groups, mut first) = (Vec::<(Channel, Vec<usize>)>::new(), 0);
        for &channel in &self.rollout.channels {
            let features = first..first + width(channel, self.rollout.cut.bins());
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
