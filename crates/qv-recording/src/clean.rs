//! Raw samples put in order: sorted stamps, none twice, gaps instead of values that are not finite.

use crate::run::{Fault, FaultKind};
use qv_core::JointSeries;
use qv_core::statistics::median;

/// Rows as they came, shape `[T, width]`, with their stamps \[s\].
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    pub time: Vec<f64>,
    pub rows: Vec<f64>,
    pub width: usize,
}

/// A stamp farther than this from the median of all is no stamp of this recording \[s\].
const LONGEST: f64 = 12.0 * 3600.0;
/// Samples that are usually closer than this are not of a robot, whatever their stamps are \[s\].
const SHORTEST: f64 = 1e-6;

/// Sorts rows by stamp, drops rows with the stamp of the one before, and turns infinities into NaN.
/// `channel` names the source in the faults. `blank_is_nan`: NaN stands for "not measured" and is no fault.
pub(crate) fn put_in_order(
    mut samples: Samples,
    channel: &str,
    blank_is_nan: bool,
    faults: &mut Vec<Fault>,
) -> Samples {
    drop_bad_stamps(&mut samples, channel, faults);
    sort(&mut samples, channel, faults);
    drop_repeated_stamps(&mut samples, channel, faults);
    drop_impossible(&mut samples, channel, faults);
    let mut bad = 0;
    let mut first = None;
    for (row, values) in samples.rows.chunks_exact_mut(samples.width.max(1)).enumerate() {
        let before = bad;
        for x in values.iter_mut().filter(|x| !x.is_finite()) {
            bad += usize::from(x.is_infinite() || !blank_is_nan);
            *x = f64::NAN;
        }
        if bad > before {
            first.get_or_insert(samples.time[row]);
        }
    }
    if let Some(time) = first {
        let detail = format!("{bad} values are not finite: kept as gaps");
        faults.push(Fault { kind: FaultKind::NotFinite, channel: channel.into(), time, count: bad, detail });
    }
    samples
}

fn drop_bad_stamps(samples: &mut Samples, channel: &str, faults: &mut Vec<Fault>) {
    let mut sorted: Vec<f64> = samples.time.iter().copied().filter(|t| t.is_finite()).collect();
    let middle = median(&mut sorted);
    let is_good = |t: f64| t.is_finite() && (t - middle).abs() < LONGEST;
    let bad = samples.time.iter().filter(|t| !is_good(**t)).count();
    if bad > 0 {
        let time = samples.time.iter().copied().find(|t| is_good(*t)).unwrap_or(0.0);
        let detail = format!("{bad} samples without a finite stamp, or half a day off the rest, were dropped");
        faults.push(Fault { kind: FaultKind::NotFinite, channel: channel.into(), time, count: bad, detail });
        keep(samples, |s, i| is_good(s.time[i]));
    }
}

fn sort(samples: &mut Samples, channel: &str, faults: &mut Vec<Fault>) {
    let time = &samples.time;
    let late: Vec<usize> = (1..time.len()).filter(|&i| time[i] < time[i - 1]).collect();
    let Some(&first) = late.first() else { return };
    let fault_time = time[first];
    let mut order: Vec<usize> = (0..time.len()).collect();
    order.sort_by(|&a, &b| time[a].total_cmp(&time[b]));
    samples.time = order.iter().map(|&i| time[i]).collect();
    let width = samples.width;
    samples.rows = order.iter().flat_map(|&i| samples.rows[i * width..(i + 1) * width].iter().copied()).collect();
    let detail = format!("{} samples came with an earlier stamp than the one before: sorted", late.len());
    let kind = FaultKind::OutOfOrder;
    faults.push(Fault { kind, channel: channel.into(), time: fault_time, count: late.len(), detail });
}

fn drop_repeated_stamps(samples: &mut Samples, channel: &str, faults: &mut Vec<Fault>) {
    let time = &samples.time;
    let repeated: Vec<usize> = (1..time.len()).filter(|&i| time[i] <= time[i - 1]).collect();
    let Some(&first) = repeated.first() else { return };
    let detail = format!("{} samples have the stamp of the one before: the first of each was kept", repeated.len());
    let kind = FaultKind::RepeatedStamp;
    faults.push(Fault { kind, channel: channel.into(), time: time[first], count: repeated.len(), detail });
    keep(samples, |s, i| i == 0 || s.time[i] > s.time[i - 1]);
}

fn drop_impossible(samples: &mut Samples, channel: &str, faults: &mut Vec<Fault>) {
    let interval = median_interval(&samples.time);
    if interval >= SHORTEST || interval.is_nan() {
        return;
    }
    let (count, time) = (samples.time.len(), samples.time[0]);
    let detail =
        format!("{count} samples are {interval:e} s apart: their stamps are no seconds, and they were dropped");
    faults.push(Fault { kind: FaultKind::NotFinite, channel: channel.into(), time, count, detail });
    (samples.time, samples.rows) = (Vec::new(), Vec::new());
}

fn keep(samples: &mut Samples, good: impl Fn(&Samples, usize) -> bool) {
    let width = samples.width;
    let kept: Vec<usize> = (0..samples.time.len()).filter(|&i| good(samples, i)).collect();
    samples.rows = kept.iter().flat_map(|&i| samples.rows[i * width..(i + 1) * width].iter().copied()).collect();
    samples.time = kept.iter().map(|&i| samples.time[i]).collect();
}

/// Some columns of ordered samples as a series; `None` when there is no sample, or nothing but gaps.
/// Rows that are gaps in all of these columns are left out.
pub(crate) fn columns(samples: &Samples, first: usize, count: usize) -> Option<JointSeries> {
    if count == 0 {
        return None;
    }
    let mut time = Vec::with_capacity(samples.time.len());
    let mut values = Vec::with_capacity(samples.time.len() * count);
    for (t, row) in samples.time.iter().zip(samples.rows.chunks_exact(samples.width)) {
        let part = &row[first..first + count];
        if part.iter().any(|x| !x.is_nan()) {
            time.push(*t);
            values.extend_from_slice(part);
        }
    }
    if time.is_empty() {
        return None;
    }
    time.shrink_to_fit();
    values.shrink_to_fit();
    JointSeries::new(time, values, count).ok()
}

/// Median of the intervals \[s\]; NaN with fewer than two stamps.
pub fn median_interval(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    median(&mut steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_that_are_no_seconds_are_dropped() {
        let of = |step: f64| {
            let time: Vec<f64> = (0..100).map(|k| step * f64::from(k)).collect();
            let mut faults = Vec::new();
            let samples = Samples { rows: time.clone(), time, width: 1 };
            (put_in_order(samples, "a", false, &mut faults).time.len(), faults.len())
        };
        assert_eq!(of(0.002), (100, 0));
        assert_eq!([of(5e-324), of(1e-300), of(1e-7)], [(0, 1); 3]);
    }
}
