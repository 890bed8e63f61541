//! Parameters of the simulator drawn anew for each episode.

use super::settings::{Randomise, TaskSettings};
use crate::PolicyError;
use qv_core::random::Xoshiro256PlusPlus;
use qv_sim::{Batch, Precision};
use std::collections::BTreeMap;

/// One parameter, or several that share a value.
struct Draw {
    ids: Vec<usize>,
    range: [f64; 2],
}

/// Which parameters of a batch are drawn, and between which values.
pub(super) struct Draws(Vec<Draw>);

impl Draws {
    /// Finds the names of the settings in the catalogue. A name of a terrain's materials may fit none; any other must fit.
    pub fn new<T: Precision>(settings: &Randomise, batch: &Batch<T>) -> Result<Self, PolicyError> {
        let mut draws = Vec::new();
        for (name, &range) in &settings.parameters {
            draws.extend(fitting(name, batch)?.into_iter().map(|id| Draw { ids: vec![id], range }));
        }
        for (name, &range) in &settings.together {
            draws.push(Draw { ids: fitting(name, batch)?, range });
        }
        Ok(Self(draws))
    }

    /// Longest command latency that is known or may be drawn \[s\].
    pub fn longest_latency(settings: &TaskSettings) -> f64 {
        let drawn = settings.randomise.parameters.iter().chain(&settings.randomise.together);
        let named = drawn.map(|(name, range)| (name, range[1])).chain(settings.parameters.iter().map(|(n, x)| (n, *x)));
        named.filter(|(name, _)| name.ends_with(".command_latency")).map(|(_, most)| most).fold(0.0, f64::max)
    }

    /// Draws all for one environment.
    pub fn draw<T: Precision>(
        &self,
        env: usize,
        random: &mut Xoshiro256PlusPlus,
        batch: &mut Batch<T>,
    ) -> Result<(), PolicyError> {
        for draw in &self.0 {
            let share = f64::from(random.unit());
            let value = draw.range[0] + share * (draw.range[1] - draw.range[0]);
            for &id in &draw.ids {
                batch.set_parameter_at(env, id, value)?;
            }
        }
        Ok(())
    }
}

/// Sets the parameters that hold for all environments.
pub(super) fn set_known<T: Precision>(known: &BTreeMap<String, f64>, batch: &mut Batch<T>) -> Result<(), PolicyError> {
    for (name, &value) in known {
        for id in fitting(name, batch)? {
            (0..batch.len()).try_for_each(|env| batch.set_parameter_at(env, id, value))?;
        }
    }
    Ok(())
}

/// Indices of the parameters that a name with at most one `*` means.
fn fitting<T: Precision>(pattern: &str, batch: &Batch<T>) -> Result<Vec<usize>, PolicyError> {
    let Some((before, after)) = pattern.split_once('*') else {
        return Ok(vec![batch.parameter_index(pattern)?]);
    };
    let fits =
        |name: &str| name.len() >= before.len() + after.len() && name.starts_with(before) && name.ends_with(after);
    let found: Vec<usize> =
        batch.catalogue().iter().enumerate().filter(|(_, p)| fits(&p.name)).map(|(id, _)| id).collect();
    if found.is_empty() && !pattern.starts_with("material.") {
        return Err(PolicyError::setting(
            "randomise",
            "the name of a parameter (* for any joint, link, shape)",
            pattern,
        ));
    }
    Ok(found)
}
