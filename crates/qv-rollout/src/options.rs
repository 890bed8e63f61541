//! How windows are cut, and numbers of the simulator that no recording states.

use qv_sim::SimOptions;

/// Fewest samples in a bin of a shortened window.
const FEWEST_SAMPLES: f64 = 5.0;

/// Share of a value by which another engine's recording puts it off (one standard deviation): contacts and steps of engines differ, and so does
/// the real robot from each.
pub const ENGINE_ERROR: f64 = 0.08;

/// How windows are cut and compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowOptions {
    /// Length of a window \[s\].
    pub window: f64,
    /// Length of a bin, within which a channel becomes one number \[s\].
    pub bin: f64,
    /// Interval at which the simulation is looked at \[s\].
    pub sample: f64,
    /// What a window needs on either side of it to find its start \[s\].
    pub margin: f64,
    /// Most windows that are simulated; of a longer recording evenly spread ones are.
    pub most: usize,
}

impl Default for WindowOptions {
    fn default() -> Self {
        Self { window: 0.3, bin: 0.05, sample: 0.005, margin: 0.5, most: 72 }
    }
}

impl WindowOptions {
    /// The same for a robot that is held and measured every `period` \[s\]: half as long where there are samples enough.
    /// Nothing bounds how fast an arm falls, as feet on the ground do, so that errors in the start soon are all there is.
    pub(crate) fn held(self, period: f64) -> Self {
        let half = Self { window: 0.5 * self.window, bin: 0.5 * self.bin, most: 2 * self.most, ..self };
        if period > 0.0 && half.bin >= FEWEST_SAMPLES * period { half } else { self }
    }

    /// Bins in a window.
    pub fn bins(&self) -> usize {
        (self.window / self.bin).round() as usize
    }

    /// Samples in a bin.
    pub(crate) fn samples_per_bin(&self) -> usize {
        (self.bin / self.sample).round() as usize
    }
}

/// Numbers of the simulator that no recording states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numerics {
    /// Time step \[s\]; the sample interval is a multiple of it.
    pub timestep: f64,
    /// See [`SimOptions::impratio`].
    pub impratio: f64,
    /// See [`SimOptions::implicit_actuator_damping`].
    pub implicit: bool,
}

impl Default for Numerics {
    fn default() -> Self {
        Self { timestep: 0.001, impratio: 10.0, implicit: true }
    }
}

impl Numerics {
    /// Options of a simulation that must remember commands of `latency` \[s\].
    pub fn options(&self, latency: f64) -> SimOptions {
        SimOptions {
            timestep: self.timestep,
            impratio: self.impratio,
            implicit_actuator_damping: self.implicit,
            max_command_latency: latency.min(1.0),
            ..Default::default()
        }
    }
}
