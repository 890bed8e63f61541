//! Series on an even grid: despiked, smoothed without a phase, differentiated.

use qv_core::JointSeries;

/// Half the length of a kernel in its deviations.
const REACH: f64 = 4.0;
/// A sample jumps if it is off both neighbours by this many times the largest usual step.
const JUMP: f64 = 8.0;
/// Intervals between stamps, in periods, from which on nothing is known in between.
const GAP: f64 = 2.5;
/// Deviation of a kernel [s] times its bandwidth [Hz] (3 dB): `sqrt(ln 2) / 2 pi`.
const DEVIATION: f64 = 0.132_505;

/// A Gaussian kernel on a grid: value, first and second derivative.
pub(crate) struct Kernel {
    /// Samples on either side.
    reach: usize,
    weights: [Vec<f64>; 3],
}

impl Kernel {
    /// Of a bandwidth \[Hz\] (3 dB) on samples that are `step` \[s\] apart; no narrower than a sample, where differences mean nothing.
    pub fn new(bandwidth: f64, step: f64) -> Self {
        let deviation = (DEVIATION / bandwidth).max(0.6 * step);
        let reach = (REACH * deviation / step).ceil() as usize;
        let at = |k: usize| (k as f64 - reach as f64) * step;
        let shape: Vec<f64> = (0..=2 * reach).map(|k| (-0.5 * (at(k) / deviation).powi(2)).exp()).collect();
        let total: f64 = shape.iter().sum();
        let value: Vec<f64> = shape.iter().map(|w| w / total).collect();
        // Scaled so that lines and parabolas have their derivatives exactly.
        let slope: Vec<f64> = (0..=2 * reach).map(|k| at(k) * value[k]).collect();
        let of_line: f64 = (0..=2 * reach).map(|k| at(k) * slope[k]).sum();
        let second = of_line;
        let curve: Vec<f64> = (0..=2 * reach).map(|k| (at(k).powi(2) - second) * value[k]).collect();
        let of_parabola: f64 = (0..=2 * reach).map(|k| 0.5 * at(k).powi(2) * curve[k]).sum();
        let scaled = |w: Vec<f64>, by: f64| w.into_iter().map(|w| w / by).collect();
        Self { reach, weights: [value, scaled(slope, of_line), scaled(curve, of_parabola)] }
    }

    /// Samples on either side that a value rests on.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// Smoothed values (`derivative` 0) or derivatives at `places` of a series; ends are held.
    pub fn apply(&self, values: &[f64], places: &[usize], derivative: usize) -> Vec<f64> {
        let weights = &self.weights[derivative];
        let last = values.len() - 1;
        let at = |place: usize| -> f64 {
            if place >= self.reach && place + self.reach <= last {
                let window = &values[place - self.reach..=place + self.reach];
                return qv_fit::linear::dot(weights, window);
            }
            let value = |k: usize| values[(place + k).saturating_sub(self.reach).min(last)];
            weights.iter().enumerate().map(|(k, w)| w * value(k)).sum()
        };
        places.iter().map(|&place| at(place)).collect()
    }
}

/// An even grid over a series.
pub(crate) struct Grid {
    /// First instant \[s\].
    pub start: f64,
    /// \[s\]
    pub step: f64,
    pub count: usize,
}

impl Grid {
    /// From the first to the last stamp, by the median interval; `None` for fewer than 50 samples.
    pub fn of(series: &JointSeries) -> Option<Self> {
        let step = qv_recording::median_interval(&series.time);
        if series.len() < 50 || step.is_nan() || step <= 0.0 {
            return None;
        }
        let span = series.time[series.len() - 1] - series.time[0];
        Some(Self { start: series.time[0], step, count: (span / step + 0.5) as usize + 1 })
    }

    pub fn time(&self, k: usize) -> f64 {
        self.start + self.step * k as f64
    }

    /// One column, `ahead` of the grid \[s\], between its finite samples, and whether each place is near such samples. `None` where fewer than half are.
    pub fn interpolate(&self, series: &JointSeries, column: usize, ahead: f64) -> Option<(Vec<f64>, Vec<bool>)> {
        let known: Vec<(f64, f64)> =
            series.time.iter().copied().zip(series.column(column)).filter(|(_, x)| x.is_finite()).collect();
        if known.len() < 2 || 2 * known.len() < self.count {
            return None;
        }
        let (mut values, mut valid) = (Vec::with_capacity(self.count), Vec::with_capacity(self.count));
        let mut after = 1;
        for k in 0..self.count {
            let time = self.time(k) + ahead;
            while after + 1 < known.len() && known[after].0 < time {
                after += 1;
            }
            let ((from, a), (to, b)) = (known[after - 1], known[after]);
            let share = ((time - from) / (to - from)).clamp(0.0, 1.0);
            values.push(a + share * (b - a));
            let is_near = time > from - GAP * self.step && time < to + GAP * self.step;
            valid.push(to - from < GAP * self.step && is_near);
        }
        Some((values, valid))
    }

    /// One column held from the sample before, such as a command, and late by `delay` \[s\]. Parts of a step are a mean of two steps: what is
    /// smoothed later comes late by just as much.
    pub fn hold(&self, series: &JointSeries, column: usize, delay: f64) -> Vec<f64> {
        let mut before = 0.0;
        let held: Vec<f64> = (0..self.count)
            .map(|k| {
                // Stamps of one row of a log may differ in their last digits.
                let x = series.hold(self.time(k) + 0.05 * self.step)[column];
                before = if x.is_finite() { x } else { before };
                before
            })
            .collect();
        let (whole, part) = ((delay / self.step).floor(), (delay / self.step).fract());
        let late = |k: usize, by: usize| held[k.saturating_sub(by)];
        (0..self.count).map(|k| (1.0 - part) * late(k, whole as usize) + part * late(k, whole as usize + 1)).collect()
    }
}

/// Takes out single samples that jump out and straight back; returns how many.
pub(crate) fn despike(values: &mut [f64]) -> usize {
    let mut steps: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    if steps.len() < 3 {
        return 0;
    }
    let (least, usual) = (1e-9, steps.len() * 99 / 100);
    let usual = *steps.select_nth_unstable_by(usual, f64::total_cmp).1;
    let limit = JUMP * usual.max(least);
    let mut found = 0;
    for k in 1..values.len() - 1 {
        let [out, back] = [values[k] - values[k - 1], values[k + 1] - values[k]];
        if out * back < 0.0 && out.abs().min(back.abs()) > limit {
            values[k] = 0.5 * (values[k - 1] + values[k + 1]);
            found += 1;
        }
    }
    found
}

/// The value below which a share of all lies.
pub(crate) fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let place = (((values.len() - 1) as f64) * share) as usize;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_differentiate_parabolas_exactly_and_halve_the_power_at_their_bandwidth() {
        let step = 0.002;
        let kernel = Kernel::new(20.0, step);
        let parabola: Vec<f64> =
            (0..400).map(|k| 1.0 + 3.0 * step * k as f64 + 5.0 * (step * k as f64).powi(2)).collect();
        let slope = kernel.apply(&parabola, &[200], 1)[0];
        assert!((slope - (3.0 + 10.0 * 0.4)).abs() < 1e-9, "{slope}");
        assert!((kernel.apply(&parabola, &[200], 2)[0] - 10.0).abs() < 1e-7);
        let wave: Vec<f64> = (0..4000).map(|k| (std::f64::consts::TAU * 20.0 * step * k as f64).sin()).collect();
        let places: Vec<usize> = (1000..3000).collect();
        let smooth = kernel.apply(&wave, &places, 0);
        let gain = smooth.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        assert!((gain - 0.5f64.sqrt()).abs() < 5e-3, "{gain}");
    }

    #[test]
    fn one_sample_that_jumps_out_and_back_is_taken_out() {
        let mut values: Vec<f64> = (0..500).map(|k| (0.02 * f64::from(k)).sin()).collect();
        let whole = values.clone();
        values[77] = -3.2;
        assert_eq!(despike(&mut values), 1);
        assert!((values[77] - whole[77]).abs() < 1e-3);
        let mut step: Vec<f64> = (0..500).map(|k| if k < 250 { 0.0 } else { 1.0 }).collect();
        assert_eq!(despike(&mut step), 0, "a step is none");
    }

    #[test]
    fn gaps_are_not_valid() {
        let time: Vec<f64> = (0..200).map(|k| 0.01 * f64::from(k) + if k < 100 { 0.0 } else { 0.2 }).collect();
        let series = JointSeries { values: time.clone(), time, joints: 1 };
        let grid = Grid::of(&series).unwrap();
        let (values, valid) = grid.interpolate(&series, 0, 0.0).unwrap();
        assert!((values[110] - grid.time(110)).abs() < 1e-9);
        assert!(valid[50] && !valid[110] && valid[150]);
    }
}
