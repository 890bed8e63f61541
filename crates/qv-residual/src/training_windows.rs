//! Windows in the simulator that a policy is trained in, with its step and its solver: torques that stand for what it lacks are fitted there.

use crate::ResidualError;
use crate::fitting::Windows;
use crate::identify::{Coordinate, lane_of, shapes_of};
use crate::windows::{BASE_CHANNELS, Errors, Lane, Replayer, Window};
use qv_fit::Blocks;
use qv_policy::shape_torques::ShapeTorques;

/// Lanes at once: more would not fit the cache and memory better.
const LANES: usize = 8192;

/// Windows of a log.
pub struct TrainingWindows<'a> {
    /// Replays.
    pub replayer: &'a Replayer<'a>,
    /// Where they begin.
    pub windows: Vec<Window>,
    /// Decisions of a window.
    pub length: usize,
}

impl TrainingWindows<'_> {
    /// Errors of some windows, the first of which is `first`, at each of some points, `[windows][points]`.
    fn errors(
        &self,
        coordinates: &[Coordinate],
        points: &[Vec<f64>],
        (first, count): (usize, usize),
    ) -> Result<Errors, ResidualError> {
        let joints = self.replayer.log.joints;
        let each = (first..first + count).flat_map(|window| points.iter().map(move |point| (window, point)));
        let lanes: Vec<Lane> = each.clone().map(|(w, p)| lane_of(coordinates, p, w, joints)).collect();
        let numbers: Vec<f32> = each.flat_map(|(_, p)| shapes_of(coordinates, p, joints)).collect();
        let torques = (!numbers.is_empty()).then(|| ShapeTorques::new(self.replayer.robot, numbers));
        self.replayer.replay(&self.windows, &lanes, self.length, torques.as_ref())
    }
}

impl Windows for TrainingWindows<'_> {
    fn residuals(&self, coordinates: &[Coordinate], points: &[Vec<f64>]) -> Result<Vec<Blocks>, ResidualError> {
        let mut all = vec![Blocks::new(); points.len()];
        let each = (LANES / points.len()).max(1);
        for first in (0..self.windows.len()).step_by(each) {
            let count = each.min(self.windows.len() - first);
            let errors = self.errors(coordinates, points, (first, count))?;
            for lane in 0..errors.lanes {
                all[lane % points.len()].push(errors.lane(lane).iter().map(|&x| f64::from(x)).collect());
            }
        }
        Ok(all)
    }

    /// What is left of the recordings at the point: the step of a training leaves more than noise.
    fn null(&self, coordinates: &[Coordinate], point: &[f64]) -> Result<Blocks, ResidualError> {
        Ok(self.residuals(coordinates, &[point.to_vec()])?.remove(0))
    }

    /// Each channel over time.
    fn groups(&self) -> Vec<Vec<usize>> {
        let channels = self.replayer.log.joints + BASE_CHANNELS;
        (0..channels).map(|channel| (0..self.length).map(|k| k * channels + channel).collect()).collect()
    }
}
