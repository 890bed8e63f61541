//! Parameters that follow a robot while it walks: recursive Gauss and Newton steps with exponential forgetting (Ljung 1999, section 11.2).
//!
//! Every push is a piece of the stream. What earlier pieces told is kept as information about the present point, and fades with the time
//! constant of the memory; the prior does not fade, so that what the motion does not show goes back to it.

use crate::ResidualError;
use crate::identify::{Coordinate, FitSettings, Fitter, Normal, leading};
use crate::log::Log;
use crate::windows::{Replayer, windows};
use nalgebra::{DMatrix, DVector};
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
    /// Time constant of the memory \[s\].
    memory: f64,
    coordinates: Vec<Coordinate>,
    point: Vec<f64>,
    information: DMatrix<f64>,
    spread: DMatrix<f64>,
}

/// Steps for each piece: the second begins where the first led.
const STEPS: usize = 3;

impl<'a> Online<'a> {
    /// A robot of which nothing is known; `memory` is the time after which 1/e of what was told remains \[s\].
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
        let log = Log::new(robot, task);
        let coordinates = leading(&Replayer::new(&log, robot, terrain, task), &settings.prior)?;
        let count = coordinates.len();
        Ok(Self {
            robot,
            terrain,
            task: task.clone(),
            settings: settings.clone(),
            memory,
            point: coordinates.iter().map(|c| c.neutral).collect(),
            coordinates,
            information: DMatrix::zeros(count, count),
            spread: DMatrix::zeros(count, count),
        })
    }

    /// Learns from what came in since the last push, and tells what holds now.
    ///
    /// # Errors
    /// When the piece is too short for a window, or the simulator refuses a number.
    pub fn push(&mut self, piece: &Log) -> Result<Vec<Estimate>, ResidualError> {
        let replayer = Replayer::new(piece, self.robot, self.terrain, &self.task);
        let all = windows(piece, self.settings.length, |_| true);
        if all.is_empty() {
            let expected = format!("at least {} decisions", self.settings.length + crate::windows::WARM);
            return Err(ResidualError::input("piece of a stream", expected, format!("{:.2} s", piece.seconds())));
        }
        let fading = (-piece.seconds() / self.memory).exp();
        self.information *= fading;
        self.spread *= fading;
        let (coordinates, settings) = (self.coordinates.clone(), &self.settings);
        let fitter = Fitter { replayer: &replayer, coordinates, windows: all, settings };
        let known = DVector::from_vec(self.point.clone());
        let mut told = None;
        for _ in 0..STEPS {
            let now = fitter.normal_at(&self.point)?;
            // What was told before pulls to where the point was then.
            let away = DVector::from_vec(self.point.clone()) - &known;
            let both = Normal {
                hessian: &now.hessian + &self.information,
                gradient: &now.gradient + &self.information * away,
                spread: &now.spread + &self.spread,
            };
            self.point = fitter.solve(&both, &self.point);
            told = Some(both);
        }
        let mut deviations = self.coordinates.iter().map(|c| c.spread).collect();
        if let Some(both) = told {
            deviations = fitter.deviations(&both);
            (self.information, self.spread) = (both.hessian, both.spread);
        }
        Ok(self.estimates(&deviations))
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
