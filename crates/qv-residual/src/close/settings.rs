//! How the loop is closed.

use crate::ResidualError;
use crate::identify::FitSettings;
use crate::tune::TuneSettings;
use serde::{Deserialize, Serialize};

/// How the loop is closed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoopSettings {
    /// Of so many stretches one is held out.
    pub held_every: usize,
    /// Length of the windows by which candidates are compared \[s\].
    pub window: f32,
    /// Most by which feet and a ground that is no plane may contradict each other in a window, see [`crate::footing`] \[m\]: about what a
    /// reconstruction is off by where it is good.
    pub footing: f64,
    /// Standard errors by which a candidate must be better.
    pub errors: f64,
    /// Walks by which policies are compared.
    pub walks: usize,
    /// Fits.
    pub fit: FitSettings,
    /// Training.
    pub tune: TuneSettings,
}

impl Default for LoopSettings {
    fn default() -> Self {
        Self {
            held_every: 5,
            window: 1.0,
            footing: 0.01,
            errors: 2.0,
            walks: 96,
            fit: FitSettings::default(),
            tune: TuneSettings::default(),
        }
    }
}

impl LoopSettings {
    /// # Errors
    /// Names the first setting that means nothing.
    pub fn check(&self) -> Result<(), ResidualError> {
        let (fit, tune) = (&self.fit, &self.tune);
        let within = |what: &str, x: f64, low: f64, high: f64| {
            let expected = format!("{low} to {high}");
            if (low..=high).contains(&x) { Ok(()) } else { Err(ResidualError::input(what, expected, x)) }
        };
        within("held_every", self.held_every as f64, 2.0, 100.0)?;
        within("window", f64::from(self.window), 0.1, 4.0)?;
        within("footing", self.footing, 1e-4, 1.0)?;
        within("errors", self.errors, 0.0, 100.0)?;
        within("walks", self.walks as f64, 6.0, 1e5)?;
        within("fit.windows", fit.windows as f64, 10.0, 1e5)?;
        within("fit.length", fit.length as f64, 2.0, 100.0)?;
        within("fit.steps", fit.steps as f64, 1.0, 100.0)?;
        within("tune.iterations", tune.iterations as f64, 1.0, 1e6)?;
        within("tune.robots", tune.robots as f64, 1.0, 1048576.0)?;
        within("tune.rate", f64::from(tune.rate), 1e-8, 1.0)?;
        within("tune.std", f64::from(tune.std), 1e-3, 10.0)?;
        within("tune.entropy", f64::from(tune.entropy), 0.0, 1.0)?;
        within("tune.spread", tune.spread, 0.0, 10.0)?;
        within("tune.averaged", f64::from(tune.averaged), 1.0, 1e6)?;
        within("tune.steady", f64::from(tune.steady), 0.0, 1e3)?;
        within("tune.steady_width", f64::from(tune.steady_width), 1e-4, 10.0)?;
        within("tune.calibration", tune.calibration as f64, 0.0, 1e5)?;
        within("tune.walks", tune.walks as f64, 6.0, 1e5)?;
        let p = &fit.prior;
        let spreads = [
            p.latency, p.lag, p.strength, p.kd_scale, p.coulomb, p.viscous, p.bias, p.backlash, p.limit, p.mass, p.com,
            p.friction,
        ];
        spreads.iter().chain(&p.contact).chain(&p.shapes).try_for_each(|&x| within("fit.prior", x, 1e-9, 1e3))
    }
}

/// Whether a stretch is held out.
pub fn is_held(settings: &LoopSettings, stretch: usize) -> bool {
    stretch % settings.held_every == settings.held_every - 1
}
