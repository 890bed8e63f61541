//! Sampled joint quantities.

use crate::CoreError;

/// One quantity of `n` joints sampled at `T` instants, such as positions \[rad\] or torques \[N m\].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointSeries {
    /// Sample times \[s\], strictly increasing, shape `[T]`.
    pub time: Vec<f64>,
    /// Values, row-major, shape `[T, n]`. NaN marks a value that was not measured.
    pub values: Vec<f64>,
    /// Number of joints `n`.
    pub joints: usize,
}

impl JointSeries {
    /// A series of the given shape.
    ///
    /// # Errors
    /// When lengths disagree, or stamps are not finite and strictly increasing.
    pub fn new(time: Vec<f64>, values: Vec<f64>, joints: usize) -> Result<Self, CoreError> {
        if values.len() != time.len() * joints {
            return Err(CoreError::Length { what: "joint series", expected: time.len() * joints, found: values.len() });
        }
        if let Some(index) = time.iter().position(|t| !t.is_finite()) {
            return Err(CoreError::NotFinite { what: "time stamp", index, found: time[index].to_string() });
        }
        if let Some(index) = (1..time.len()).find(|&i| time[i] <= time[i - 1]) {
            return Err(CoreError::TimeOrder { index, previous: time[index - 1], found: time[index] });
        }
        Ok(Self { time, values, joints })
    }

    /// Number of samples `T`.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// All joints at one sample, shape `[n]`.
    pub fn row(&self, sample: usize) -> &[f64] {
        &self.values[sample * self.joints..(sample + 1) * self.joints]
    }

    /// One joint over time, shape `[T]`.
    pub fn column(&self, joint: usize) -> impl Iterator<Item = f64> + '_ {
        self.values.iter().skip(joint).step_by(self.joints.max(1)).copied()
    }

    /// Index of the last sample at or before `time` \[s\]; `None` before the first one.
    pub fn index_at(&self, time: f64) -> Option<usize> {
        self.count_until(time).checked_sub(1)
    }

    /// Number of samples at or before `time`. Recorders stamp nearly evenly, so that the place is guessed, and searched
    /// for only where the guess is off.
    fn count_until(&self, time: f64) -> usize {
        let (Some(first), Some(last)) = (self.time.first(), self.time.last()) else { return 0 };
        let share = (time - first) / (last - first);
        let end = self.len() - 1;
        let guess = ((share * end as f64) as usize).min(end);
        for index in guess.saturating_sub(1)..(guess + 2).min(end) {
            if self.time[index] <= time && time < self.time[index + 1] {
                return index + 1;
            }
        }
        self.time.partition_point(|&t| t <= time)
    }

    /// Values at `time` \[s\] held from the last sample before it (as a command is held); the first row before that.
    ///
    /// # Panics
    /// When the series is empty.
    pub fn hold(&self, time: f64) -> &[f64] {
        self.row(self.index_at(time).unwrap_or(0))
    }

    /// Linear interpolation at `time` \[s\] into `out`, shape `[n]`; the end rows outside the range.
    ///
    /// # Panics
    /// When the series is empty or `out` has another length than `n`.
    pub fn interpolate(&self, time: f64, out: &mut [f64]) {
        let (before, after, fraction) = match self.index_at(time) {
            None => (0, 0, 0.0),
            Some(i) if i + 1 >= self.len() => (i, i, 0.0),
            Some(i) => (i, i + 1, (time - self.time[i]) / (self.time[i + 1] - self.time[i])),
        };
        let (a, b) = (self.row(before), self.row(after));
        assert_eq!(out.len(), self.joints, "output length must be the number of joints");
        for j in 0..self.joints {
            out[j] = a[j] + fraction * (b[j] - a[j]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> JointSeries {
        JointSeries::new(vec![0.0, 1.0, 3.0], vec![0.0, 10.0, 1.0, 11.0, 3.0, 13.0], 2).unwrap()
    }

    #[test]
    fn interpolates_and_holds() {
        let mut out = [0.0; 2];
        ramp().interpolate(2.0, &mut out);
        assert_eq!(out, [2.0, 12.0]);
        ramp().interpolate(9.0, &mut out);
        assert_eq!(out, [3.0, 13.0]);
        assert_eq!(ramp().hold(2.9), [1.0, 11.0]);
        assert_eq!(ramp().hold(-1.0), [0.0, 10.0]);
        assert_eq!(ramp().column(1).collect::<Vec<_>>(), [10.0, 11.0, 13.0]);
    }

    #[test]
    fn samples_are_found_however_unevenly_they_are_stamped() {
        let even: Vec<f64> = (0..40).map(|k| 0.002 * k as f64).collect();
        let uneven: Vec<f64> = (0..40).map(|k| (k as f64).powi(3) * 1e-3 + f64::from(k % 7) * 1e-4).collect();
        for time in [even, uneven, vec![0.5], vec![]] {
            let series = JointSeries::new(time.clone(), vec![0.0; time.len()], 1).unwrap();
            let mut asked: Vec<f64> = time.iter().flat_map(|&t| [t - 1e-9, t, t + 1e-9, t + 0.7e-3]).collect();
            asked.extend([f64::NEG_INFINITY, -1.0, 1e9, f64::INFINITY, f64::NAN]);
            for t in asked {
                assert_eq!(series.index_at(t), time.iter().filter(|&&s| s <= t).count().checked_sub(1), "{t}");
            }
        }
    }

    #[test]
    fn faults_are_named() {
        assert!(matches!(
            JointSeries::new(vec![0.0, 0.0], vec![1.0, 2.0], 1),
            Err(CoreError::TimeOrder { index: 1, .. })
        ));
        assert!(matches!(JointSeries::new(vec![0.0], vec![1.0], 2), Err(CoreError::Length { expected: 2, .. })));
        assert!(matches!(JointSeries::new(vec![f64::NAN], vec![1.0], 1), Err(CoreError::NotFinite { .. })));
    }
}
