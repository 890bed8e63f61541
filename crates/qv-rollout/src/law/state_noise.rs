//! What noise of the measured positions and speeds leaves in the torque that a law expects of them.
//!
//! The law is fed with measurements, and a lag, a late encoder or a lower gain takes part of their noise away: its residual falls though no
//! torque is explained. The sum of squares of each law is therefore corrected by what its noise alone leaves, which makes it unbiased under
//! any setting (corrected scores: Nakamura, Biometrika 77, 1990).

use super::{ActuatorModel, Alignment, Channels, RowInterpolation, bins};
use crate::noise::Noise;
use crate::robot::Rollout;
use crate::window::Window;
use qv_sim::lag_gain;

/// Share of a lag's impulse below which its past is left out.
const FORGOTTEN: f64 = 1e-4;
/// Most ticks of that past.
const LONGEST: usize = 200;

/// How the laws of a run are read: its alignment, and the noise that their sums of squares are corrected by; `None` where nothing is corrected.
#[derive(Debug, Clone, Copy)]
pub struct Reading<'a> {
    /// How stamps lie.
    pub alignment: Alignment,
    /// Noise of the run.
    pub noise: Option<&'a Noise>,
}

impl Reading<'_> {
    /// [`state_noise`] of a law; 0 where nothing is corrected.
    pub fn left_by_noise(&self, rollout: &Rollout, window: &Window, law: &ActuatorModel) -> f64 {
        self.noise.map_or(0.0, |noise| state_noise(rollout, window, law, self.alignment, noise))
    }
}

/// Sum over the bins of a window of the variance that noise of positions and speeds alone leaves in the expected torque of one joint \[N² m²\];
/// 0 where nothing was measured. Gains are taken to be those of the middle of the window.
pub fn state_noise(
    rollout: &Rollout,
    window: &Window,
    law: &ActuatorModel,
    alignment: Alignment,
    noise: &Noise,
) -> f64 {
    let joint = law.joint;
    let Some(channels) = Channels::new(&window.view, rollout.columns[joint]) else { return 0.0 };
    let Some(torque) = window.view.measured.torque.as_ref() else { return 0.0 };
    let first = torque.time.partition_point(|&t| t < window.start);
    let last = torque.time.partition_point(|&t| t <= window.start + rollout.cut.window);
    if last < first + 2 {
        return 0.0;
    }
    let stamps = &torque.time[first..last];
    let ticks = stamps.len() - 1;
    let tick = (stamps[ticks] - stamps[0]) / ticks as f64;
    let middle = stamps[stamps.len() / 2];
    let (mut rows, seen) = ([0; 2], middle - alignment.state + law.seen_late);
    let asked = channels.asked(middle - alignment.command - law.latency, &mut rows[0]);
    let state = channels.state(seen, &mut rows[1]);
    let slope = |q: f64, dq: f64| {
        let at = |sign: f64| law.motor.demand(&asked, state.q + sign * q, state.dq + sign * dq);
        0.5 * law.torque_scale * (at(1.0) - at(-1.0))
    };
    let [of_position, of_velocity, _] = &noise.steps;
    let error = |noise: &[f64], steps: &[f64]| (noise[joint].powi(2) + steps[joint].powi(2) / 12.0).sqrt();
    let variance = slope(error(&noise.position, of_position), 0.0).powi(2)
        + slope(0.0, error(&noise.velocity, of_velocity)).powi(2);
    let share = RowInterpolation::new(channels.q, seen, rows[1]).share;
    let gain = if law.lag > 0.0 { lag_gain(tick, law.lag) } else { 1.0 };
    let all = bins(rollout);
    let in_bin = ((stamps.len() as f64 / all as f64).round() as usize).max(1);
    if variance.is_finite() { all as f64 * variance * kept(share, gain, in_bin) } else { 0.0 }
}

/// Share of the variance of white noise that is left in the mean of `count` values in a row, each read between two of a series at a `share` of the
/// way, behind a lag that goes a share `gain` of the way in a tick.
fn kept(share: f64, gain: f64, count: usize) -> f64 {
    let mut lag = vec![gain];
    while lag[lag.len() - 1] * (1.0 - gain) > FORGOTTEN && lag.len() < LONGEST {
        lag.push(lag[lag.len() - 1] * (1.0 - gain));
    }
    let read = convolve(&lag, &[1.0 - share, share]);
    convolve(&read, &vec![1.0 / count as f64; count]).iter().map(|x| x * x).sum()
}

fn convolve(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        b.iter().enumerate().for_each(|(k, y)| out[i + k] += x * y);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::SplitMix64;

    #[test]
    fn noise_that_is_kept_is_that_of_a_filter_run_on_noise() {
        let mut random = SplitMix64::new(5);
        let white: Vec<f64> = (0..200_000).map(|_| random.normal(1.0)).collect();
        for (share, gain, count) in [(0.0, 1.0, 5), (0.5, 1.0, 5), (0.0, 0.4, 5), (0.3, 0.2, 1)] {
            let mut y = 0.0;
            let filtered: Vec<f64> = white
                .windows(2)
                .map(|w| {
                    y += gain * ((1.0 - share) * w[0] + share * w[1] - y);
                    y
                })
                .collect();
            let means: Vec<f64> = filtered.chunks_exact(count).map(|c| c.iter().sum::<f64>() / count as f64).collect();
            let square = means.iter().map(|m| m * m).sum::<f64>() / means.len() as f64;
            let expected = kept(share, gain, count);
            assert!((square / expected - 1.0).abs() < 0.03, "{share} {gain} {count}: {square} {expected}");
        }
    }
}
