//! Pieces of a recording in time.

use qv_core::JointSeries;
use qv_recording::Run;

/// Recordings that stand for several: those that there are, or pieces of equal length of a single one.
pub(crate) fn pieces(runs: &[Run], count: usize) -> Vec<Run> {
    let [run] = runs else { return runs.to_vec() };
    let [from, until] = run.span();
    let at = |k: usize| from + (until - from) * k as f64 / count as f64;
    (0..count).map(|k| cut(run, [at(k), at(k + 1)])).collect()
}

/// What was measured between two times \[s\]; commands stay, for they are held.
pub(crate) fn cut(run: &Run, span: [f64; 2]) -> Run {
    let mut cut = run.clone();
    let m = &mut cut.measured;
    let all = [&mut m.position, &mut m.velocity, &mut m.torque];
    all.into_iter().flatten().for_each(|series| *series = between(series, span));
    if run.measured.torque.is_none() {
        // The torque that was reported is weighed, and belongs to the rows that are left.
        return cut;
    }
    cut
}

fn between(series: &JointSeries, [from, until]: [f64; 2]) -> JointSeries {
    let rows = series.time.partition_point(|t| *t < from)..series.time.partition_point(|t| *t <= until);
    JointSeries {
        time: series.time[rows.clone()].to_vec(),
        values: series.values[rows.start * series.joints..rows.end * series.joints].to_vec(),
        joints: series.joints,
    }
}
