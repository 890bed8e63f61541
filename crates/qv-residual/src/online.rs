//! Parameters that follow a robot while it walks: the most probable ones given the last seconds of a stream, each fit begun where the last
//! one ended (a moving horizon, Rawlings and Mayne 2009, chapter 4, with the prior in the place of an arrival cost).
//!
//! A recursive filter that fades was tried first: after a change errors are large, their spread with them, and so what the new pieces tell
//! weighs next to nothing. A horizon forgets what is older whole.

use crate::ResidualError;
use crate::identify::{Coordinate, FitSettings, Fitter, leading};
use crate::log::Log;
use crate::windows::{Replayer, windows};
use qv_policy::velocity::{TaskRobot, TaskSettings};
use qv_sim::Terrain;

/// A parameter as it is thought to be now.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Name, with `*` for all joints or feet.
    pub name: String,
    /// Value.
    pub value: f64,
    /// 90 % interval.
    pub interval: [f64; 2],
}

/// Follows the leading parameters of a robot.
pub struct Online<'a> {
    robot: &'a TaskRobot,
    terrain: &'a Terrain,
    task: TaskSettings,
    settings: FitSettings,
    /// Length of the horizon \[s\].
    memory: f64,
    coordinates: Vec<Coordinate>,
    point: Vec<f64>,
    /// The last pieces.
    recent: Log,
}

impl<'a> Online<'a> {
    /// A robot of which nothing is known; what is older than `memory` \[s\] is forgotten.
    ///
    /// # Errors
    /// When the memory is no time, or the simulator lacks a parameter.
    pub fn new(
        robot: &'a TaskRobot,
        terrain: &'a Terrain,
        task: &TaskSettings,
        settings: &FitSettings,
        memory: f64,
    ) -> Result<Self, ResidualError> {
        if !(0.1..=1e6).contains(&memory) {
            return Err(ResidualError::input("memory", "0.1 to 1000000 s", memory));
        }
        let recent = Log::new(robot, task);
        let coordinates = leading(&Replayer::new(&recent, robot, terrain, task), &settings.prior)?;
        let point = coordinates.iter().map(|c| c.neutral).collect();
        Ok(Self { robot, terrain, task: task.clone(), settings: settings.clone(), memory, point, coordinates, recent })
    }

    /// Learns from what came in since the last push, and tells what holds now.
    ///
    /// # Errors
    /// When the piece is too short for a window, or the simulator refuses a number.
    pub fn push(&mut self, piece: &Log) -> Result<Vec<Estimate>, ResidualError> {
        if windows(piece, self.settings.length, |_| true).is_empty() {
            let expected = format!("at least {} decisions", self.settings.length + crate::windows::WARM);
            return Err(ResidualError::input("piece of a stream", expected, format!("{:.2} s", piece.seconds())));
        }
        self.recent.stretches.extend(piece.stretches.iter().cloned());
        while self.recent.stretches.len() > piece.stretches.len() && self.recent.seconds() > self.memory {
            self.recent.stretches.remove(0);
        }
        let replayer = Replayer::new(&self.recent, self.robot, self.terrain, &self.task);
        let all = windows(&self.recent, self.settings.length, |_| true);
        let (coordinates, settings) = (self.coordinates.clone(), &self.settings);
        let fit = Fitter { replayer: &replayer, coordinates, windows: all, settings }.fit(&self.point, |_, _| {})?;
        self.point = fit.point;
        Ok(self.estimates(&fit.deviations))
    }

    fn estimates(&self, deviations: &[f64]) -> Vec<Estimate> {
        let of = |((c, &value), d): ((&Coordinate, &f64), &f64)| Estimate {
            name: c.name.clone(),
            value,
            interval: [(value - 1.645 * d).max(c.least), (value + 1.645 * d).min(c.most)],
        };
        self.coordinates.iter().zip(&self.point).zip(deviations).map(of).collect()
    }
}
