//! Channels that are logged more often than they are read: the log repeats the last reading, and between readings it is late by up to the time
//! between them.

use crate::clean::median_interval;
use crate::run::Run;
use qv_core::JointSeries;
use qv_core::statistics::median;

/// A joint that moves by this many steps of its encoder a row, or more, surely has another position in each row.
const SURELY: f64 = 3.0;
/// Share of the rows of a joint that surely moves that repeat a reading, from which on it is read less often than logged: half, where each
/// reading is logged twice. Noise of the size of an encoder's step repeats a fifth by chance.
const LEAST_SHARE: f64 = 0.4;
/// Readings lie so many rows apart, or they are a matter of chance.
const SLOWER: f64 = 1.5;
/// Fewer rows of a joint that surely moves show nothing.
const LEAST_ROWS: usize = 20;

/// The run with positions and velocities of joints that repeat a reading, while the joint moves, on a line between the readings; and in
/// words what that was. A joint that stands still repeats its reading rightly.
pub fn without_stale(mut run: Run) -> (Run, Vec<String>) {
    let m = &mut run.measured;
    let mut remarks = Vec::new();
    let Some(position) = &mut m.position else { return (run, remarks) };
    for column in 0..position.joints {
        let Some(between) = mend(position, column) else { continue };
        // A register is read whole; speeds of a joint whose positions are fresh may repeat by their coarse steps.
        if let Some(velocity) = m.velocity.as_mut().filter(|v| column < v.joints) {
            mend(velocity, column);
        }
        remarks.push(format!(
            "{} is logged every {:.0} ms and read every {:.0} ms: rows that repeat a reading are taken to lie on a line between readings",
            run.joint_names.get(column).map_or("a joint", String::as_str),
            1e3 * median_interval(&position.time),
            1e3 * between
        ));
    }
    (run, remarks)
}

/// Rows of one reading, the first of which is fresh, and how far the next reading is away.
struct Reading {
    first: usize,
    rows: usize,
    jump: f64,
}

/// Puts the repeated rows of a column on lines; the typical time between readings \[s\] where it is read less often than logged.
fn mend(series: &mut JointSeries, column: usize) -> Option<f64> {
    let joints = series.joints;
    let readings = readings(series, column);
    let steps = readings.iter().map(|r| r.jump).filter(|j| *j > 0.0);
    let step = steps.fold(f64::INFINITY, f64::min);
    let surely: Vec<&Reading> = readings.iter().filter(|r| r.jump >= SURELY * step * r.rows as f64).collect();
    let rows: usize = surely.iter().map(|r| r.rows).sum();
    let repeated = rows - surely.len();
    if rows < LEAST_ROWS || (repeated as f64) < LEAST_SHARE * rows as f64 {
        return None;
    }
    let mut apart: Vec<f64> = surely.iter().map(|r| series.time[r.first + r.rows] - series.time[r.first]).collect();
    let between = median(&mut apart);
    if between < SLOWER * median_interval(&series.time) {
        return None;
    }
    for reading in readings.iter().filter(|r| r.rows > 1 && r.jump >= step * r.rows as f64) {
        let (a, b) = (reading.first, reading.first + reading.rows);
        let [from, to] = [a, b].map(|i| (series.time[i], series.values[i * joints + column]));
        for i in a + 1..b {
            let share = (series.time[i] - from.0) / (to.0 - from.0);
            series.values[i * joints + column] = from.1 + share * (to.1 - from.1);
        }
    }
    Some(between)
}

/// The readings of a column but the last, whose end is not known, and those beside missing values.
fn readings(series: &JointSeries, column: usize) -> Vec<Reading> {
    let value = |i: usize| series.row(i)[column];
    let mut out = Vec::new();
    let mut first = 0;
    for i in 1..series.len() {
        if value(i) == value(first) {
            continue;
        }
        let jump = (value(i) - value(first)).abs();
        if jump.is_finite() {
            out.push(Reading { first, rows: i - first, jump });
        }
        first = i;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A joint that swings, then stands, logged at 100 Hz with steps of an encoder; read in every `every`th row.
    fn swing(every: usize, step: f64) -> JointSeries {
        let time: Vec<f64> = (0..600).map(|k| 0.01 * f64::from(k)).collect();
        let angle = |t: f64| if t < 4.0 { (2.0 * t).sin() } else { 0.3 };
        let read = |k: usize| (angle(time[k / every * every]) / step).round() * step;
        JointSeries { values: (0..600).map(read).collect(), time, joints: 1 }
    }

    #[test]
    fn readings_that_are_repeated_lie_on_a_line_afterwards() {
        let mut series = swing(4, 0.0015);
        let between = mend(&mut series, 0).unwrap();
        assert!((between - 0.04).abs() < 1e-9, "{between}");
        // Where the joint is slow a reading may be one that stands: a step of the encoder in each row.
        for k in 0..390 {
            let t = series.time[k];
            assert!((series.values[k] - (2.0 * t).sin()).abs() < 0.013, "{k}: {}", series.values[k]);
        }
        // What stands still is as it was.
        assert_eq!(series.values[450..], swing(4, 0.0015).values[450..]);
    }

    #[test]
    fn a_joint_that_is_read_in_each_row_stays_as_it_is() {
        for step in [1e-4, 0.0015, 0.02] {
            let mut series = swing(1, step);
            assert_eq!(mend(&mut series, 0), None, "{step}");
            assert_eq!(series, swing(1, step));
        }
        // Noise of two steps of the encoder, about a motion of as much.
        let mut random = qv_core::random::SplitMix64::of(5, 0);
        let value = |k: u32| ((f64::from(k) * 0.05).sin() * 4.0 + random.normal(2.0)).round() * 0.0055;
        let values: Vec<f64> = (0..2000).map(value).collect();
        let mut noisy = JointSeries { time: (0..2000).map(|k| 0.002 * f64::from(k)).collect(), values, joints: 1 };
        assert_eq!(mend(&mut noisy, 0), None);
        let mut still = JointSeries { time: (0..99).map(f64::from).collect(), values: vec![0.5; 99], joints: 1 };
        assert_eq!(mend(&mut still, 0), None);
        let mut missing = swing(4, 0.0015);
        missing.values[100] = f64::NAN;
        assert!(mend(&mut missing, 0).is_some() && missing.values[100].is_nan());
    }
}
