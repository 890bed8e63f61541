//! The start of a window, kept for all settings with the same sensor errors: smoothing it takes as long as some hundred steps.

use crate::features;
use crate::parameters::Overrides;
use crate::robot::Rollout;
use crate::sensors::SensorErrors;
use crate::start::Starts;
use crate::window::{PreparedCache, PreparedWindow, Window};
use std::sync::Arc;

impl PreparedCache {
    /// `others` are starts of the same window under other errors, some of which these may share; theirs are added.
    pub fn get<'w>(
        &self,
        rollout: &Rollout,
        window: &'w Window,
        errors: &SensorErrors,
        others: &mut Vec<Starts<'w>>,
    ) -> Option<Arc<PreparedWindow>> {
        if let Some((_, _, kept)) = self.0.get().filter(|k| k.0 == *errors && k.1 == rollout.cut) {
            return kept.clone();
        }
        let new = prepare_one(rollout, window, errors, others).map(Arc::new);
        // Another thread may have been first, with the same or with other errors: its own stays.
        let _ = self.0.set((errors.clone(), rollout.cut, new.clone()));
        new
    }
}

/// Measured features of a window as they are, shape `[features]`; `None` where something is missing.
pub fn measured(rollout: &Rollout, window: &Window) -> Option<Vec<f64>> {
    prepare_one(rollout, window, &rollout.sensor_errors(&Overrides::new()), &mut Vec::new()).map(|p| p.measured)
}

pub(crate) fn prepare_one<'w>(
    rollout: &Rollout,
    window: &'w Window,
    errors: &SensorErrors,
    others: &mut Vec<Starts<'w>>,
) -> Option<PreparedWindow> {
    let starts = match others.iter().find_map(|other| other.with_errors(errors)) {
        Some(starts) => starts,
        None => {
            let starts = rollout.starts(&window.view, errors.clone()).ok()?;
            // Nothing where none can be shared.
            others.extend(starts.with_errors(errors));
            starts
        }
    };
    let state = starts.at(window.start)?;
    let measured = features::features(rollout, window, &starts, errors);
    measured.iter().all(|x| x.is_finite()).then_some(PreparedWindow { measured, state })
}
