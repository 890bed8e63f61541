//! Noise of a recording's channels, and the steps in which they are read.

use qv_core::JointSeries;
use qv_core::statistics::median;
use qv_recording::Run;

/// Standard deviations of white noise on each channel, as found in the recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Noise {
    /// Of joint positions \[rad\], shape `[joints]`.
    pub position: Vec<f64>,
    /// Of joint speeds \[rad/s\], shape `[joints]`.
    pub velocity: Vec<f64>,
    /// Of joint torques \[N m\], shape `[joints]`.
    pub torque: Vec<f64>,
    /// Steps that positions, speeds and torques are read in, each of shape `[joints]`; 0 where they are read as they are. Noise is what is
    /// there beside them.
    pub steps: [Vec<f64>; 3],
    /// Of the gyroscope \[rad/s\].
    pub gyro: f64,
    /// Of the accelerometer \[m/s²\].
    pub acceleration: f64,
    /// Of the IMU's orientation \[rad\].
    pub orientation: f64,
    /// Of the base's place \[m\].
    pub place: f64,
    /// Of the base's measured orientation \[rad\].
    pub pose: f64,
}

impl Noise {
    /// From what three smooth neighbours do not foretell: third differences, robustly.
    pub fn of(run: &Run, columns: &[usize]) -> Self {
        let m = &run.measured;
        let joints =
            |s: &Option<JointSeries>| -> (Vec<f64>, Vec<f64>) { columns.iter().map(|&c| noise_and_step(s, c)).unzip() };
        let [(position, of_position), (velocity, of_velocity), (torque, of_torque)] =
            [joints(&m.position), joints(&m.velocity), joints(&m.torque)];
        let mean = |s: &Option<JointSeries>, from: usize, to: usize| {
            (from..to).map(|c| of_column(s, c)).sum::<f64>() / (to - from) as f64
        };
        Self {
            position,
            velocity,
            torque,
            steps: [of_position, of_velocity, of_torque],
            gyro: mean(&m.gyro, 0, 3),
            acceleration: mean(&m.acceleration, 0, 3),
            // A quaternion holds half of each angle.
            orientation: 2.0 * mean(&m.orientation, 0, 4),
            place: mean(&m.base_pose, 0, 3),
            pose: 2.0 * mean(&m.base_pose, 3, 7),
        }
    }
}

/// What a sensor says that reads in steps; of 0, the value.
pub fn read(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

/// The step in which a column is read, and the noise beside its error, which is uniform; the noise first.
fn noise_and_step(series: &Option<JointSeries>, column: usize) -> (f64, f64) {
    let (noise, step) = (of_column(series, column), step_of(series, column));
    ((noise * noise - step * step / 12.0).max(0.0).sqrt(), step)
}

/// Changes of a reading that must be whole steps, as a share of all, and how near to whole.
const WHOLE: f64 = 0.95;
const NEARLY_WHOLE: f64 = 0.1;
/// Steps of a usual change at most: of more, any change is nearly whole once the step is rounded.
const USUAL: f64 = 30.0;

/// The step in which a column is read: the least change from one sample to the next, if others are multiples of it; else 0.
fn step_of(series: &Option<JointSeries>, column: usize) -> f64 {
    let Some(series) = series.as_ref().filter(|s| s.len() > 8 && column < s.joints) else { return 0.0 };
    let x: Vec<f64> = series.column(column).collect();
    let mut changes: Vec<f64> = x.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| d.is_finite()).collect();
    let size = x.iter().map(|x| x.abs()).filter(|x| x.is_finite()).fold(0.0, f64::max);
    // Less is the rounding of a number.
    changes.retain(|d| *d > 1e-9 * size);
    if changes.len() < 8 {
        return 0.0;
    }
    let usual = median(&mut changes);
    let least = changes.iter().copied().fold(f64::INFINITY, f64::min);
    // The least few say more exactly what one step is: text rounds them.
    let single: Vec<f64> = changes.iter().copied().filter(|d| *d < 1.5 * least).collect();
    let step = single.iter().sum::<f64>() / single.len() as f64;
    let is_whole = |d: &&f64| (*d / step - (*d / step).round()).abs() < NEARLY_WHOLE;
    let whole = changes.iter().filter(is_whole).count();
    if usual <= USUAL * step && whole as f64 >= WHOLE * changes.len() as f64 { step } else { 0.0 }
}

fn of_column(series: &Option<JointSeries>, column: usize) -> f64 {
    let Some(series) = series.as_ref().filter(|s| s.len() > 8 && column < s.joints) else { return 0.0 };
    let x: Vec<f64> = series.column(column).collect();
    let third = |w: &[f64]| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]) / 20f64.sqrt();
    let mut all: Vec<f64> = x.windows(4).map(third).map(f64::abs).filter(|d| d.is_finite()).collect();
    if all.is_empty() {
        return 0.0;
    }
    let rms = (all.iter().map(|d| d * d).sum::<f64>() / all.len() as f64).sqrt();
    // Coarse steps of an encoder leave most differences at zero: their mean square still shows.
    let robust = 1.4826 * median(&mut all);
    if robust > 0.0 { robust } else { rms }
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::SplitMix64;

    fn noisy(deviation: f64, step: f64) -> Option<JointSeries> {
        let mut random = SplitMix64::of(3, 0);
        let time: Vec<f64> = (0..4000).map(|k| 0.002 * k as f64).collect();
        let value = |t: &f64| (5.0 * t).sin() + random.normal(deviation);
        let values: Vec<f64> = time.iter().map(value).collect();
        let values = values.into_iter().map(|x| if step > 0.0 { (x / step).round() * step } else { x }).collect();
        Some(JointSeries { time, values, joints: 1 })
    }

    #[test]
    fn noise_is_told_from_motion() {
        assert!((of_column(&noisy(0.01, 0.0), 0) - 0.01).abs() < 0.001);
        assert!(of_column(&noisy(0.0, 0.0), 0) < 1e-6);
        // An encoder with steps of 5 mrad and no noise.
        let coarse = of_column(&noisy(0.0, 0.005), 0);
        assert!((0.0003..0.004).contains(&coarse), "{coarse}");
        assert_eq!(of_column(&None, 0), 0.0);
    }

    #[test]
    fn the_steps_of_a_reading_are_told() {
        for (noise, step) in [(0.0, 0.005), (0.01, 0.005), (0.001, 0.005)] {
            let read = noisy(noise, step);
            assert!((step_of(&read, 0) - step).abs() < 1e-6, "{noise} {}", step_of(&read, 0));
            let (beside, _) = noise_and_step(&read, 0);
            assert!((beside - noise).abs() < 0.3 * step, "{noise} {beside}");
        }
        for noise in [0.0, 0.01] {
            assert_eq!(step_of(&noisy(noise, 0.0), 0), 0.0);
        }
        assert_eq!(step_of(&None, 0), 0.0);
    }
}
