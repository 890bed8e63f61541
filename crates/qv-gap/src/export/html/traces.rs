//! Joints in windows that no fit has seen: measured, and simulated before and after, all of them to choose from.

use crate::report::{TracedWindow, Traces};
use qv_page::{Stretch, fixed};
use qv_rollout::Trace;

use qv_replay::joint_board;

/// The section, with a board for each recording; empty without traces.
pub(super) fn traces(traces: &Traces) -> String {
    let runs: Vec<&[TracedWindow]> = traces.windows.chunk_by(|a, b| a.run == b.run).collect();
    let boards: Vec<String> = runs.iter().map(|windows| board(&traces.joints, windows)).collect();
    if boards.iter().all(String::is_empty) {
        return String::new();
    }
    let named = |(windows, board): (&&[TracedWindow], String)| match runs.len() {
        1 => board,
        _ if board.is_empty() => board,
        _ => format!("<h3>recording {}</h3>{board}", windows[0].run + 1),
    };
    format!(
        "<h2>Before and after</h2><p class=\"soft\">Every joint in held-out windows, at the recorded rate. Each window is \
         simulated from its measured start; the largest error is shown first.</p>{}",
        runs.iter().zip(boards).map(named).collect::<String>()
    )
}

fn board(joints: &[String], windows: &[TracedWindow]) -> String {
    let [measured, before, after] =
        [joined(windows, |w| &w.measured), joined(windows, |w| &w.before), joined(windows, |w| &w.after)];
    let Some((joint, worst)) = worst(joints.len(), windows) else { return String::new() };
    let simulated = [("before", "before", &before), ("after", "after", &after)];
    let mut board = joint_board(joints, ("measured", "measured", &measured), &simulated, joint);
    board.stretches = windows.iter().enumerate().filter_map(|(k, w)| stretch(w, k == worst)).collect();
    let start = windows[worst].measured.time[0];
    board.begin = board.stretches.iter().position(|s| s.x[0] == start);
    board.to_card()
}

fn stretch(window: &TracedWindow, is_worst: bool) -> Option<Stretch> {
    let (first, last) = (*window.measured.time.first()?, *window.measured.time.last()?);
    let name = format!("{} to {} s{}", fixed(first, 1), fixed(last, 1), if is_worst { ": largest error" } else { "" });
    (last > first).then_some(Stretch { name, x: [first, last] })
}

/// One after the other; after each a row of gaps, so that no line joins it to the next.
fn joined(windows: &[TracedWindow], of: fn(&TracedWindow) -> &Trace) -> Trace {
    let joints = windows.first().map_or(0, |w| w.measured.joints);
    let mut all = Trace { joints, ..Trace::default() };
    for window in windows {
        let (trace, time) = (of(window), &window.measured.time);
        let Some(last) = time.last() else { continue };
        let rows = |values: &[f64], out: &mut Vec<f64>| {
            out.extend(values.iter().take(time.len() * joints));
            // What is not there is a gap as well.
            out.resize(out.len() + (time.len() + 1) * joints - values.len().min(time.len() * joints), f64::NAN);
        };
        rows(&trace.position, &mut all.position);
        rows(&trace.velocity, &mut all.velocity);
        rows(&trace.torque, &mut all.torque);
        all.time.extend(time);
        all.time.push(*last);
    }
    all
}

/// Joint and window with the largest error of positions before, root mean square; `None` where none is known.
fn worst(joints: usize, windows: &[TracedWindow]) -> Option<(usize, usize)> {
    let error = |joint: usize, w: &TracedWindow| {
        let of =
            |trace: &'_ Trace| trace.position.iter().skip(joint).step_by(joints.max(1)).copied().collect::<Vec<f64>>();
        let squares: Vec<f64> = of(&w.measured).iter().zip(of(&w.before)).map(|(m, s)| (m - s).powi(2)).collect();
        let known: Vec<f64> = squares.into_iter().filter(|x| x.is_finite()).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    };
    let timed = windows.iter().enumerate().filter(|(_, w)| !w.measured.time.is_empty());
    let all = timed.flat_map(|(k, w)| (0..joints).map(move |j| (j, k, w)));
    let known = all.filter_map(|(j, k, w)| Some((error(j, w)?, (j, k))));
    known.max_by(|a, b| a.0.total_cmp(&b.0)).map(|found| found.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_page::read;

    fn window(run: usize, start: f64, off: f64) -> TracedWindow {
        let trace = |by: f64| Trace {
            time: (0..30).map(|k| start + 0.01 * f64::from(k)).collect(),
            position: (0..30).flat_map(|k| [0.01 * f64::from(k), 0.02 * f64::from(k) + by]).collect(),
            joints: 2,
            ..Trace::default()
        };
        TracedWindow { run, measured: trace(0.0), before: trace(off), after: Trace::default() }
    }

    #[test]
    fn each_recording_has_its_board_which_begins_where_most_is_wrong() {
        let windows = vec![window(0, 1.0, 0.01), window(0, 3.0, 0.02), window(1, 1.0, 0.03)];
        let html = traces(&Traces { joints: vec!["a".into(), "b".into()], windows });
        let boards = read::boards(&html);
        assert_eq!((boards.len(), html.matches("<h3>recording").count()), (2, 2));
        let board = &boards[0];
        assert_eq!((board.choices[0].first, board.begin), (1, Some(1)));
        assert_eq!(board.stretches[1].name, "3.0 to 3.3 s: largest error");
        assert_eq!(board.panels[0].lines.len(), 2, "nothing is known of after");
        let (x, y) = board.points(&board.panels[2].lines[1]);
        assert!(x.len() == 62 && y[30].is_nan() && y[61].is_nan() && (y[29] - 0.59).abs() < 1e-5, "{y:?}");
        assert!(traces(&Traces::default()).is_empty());
    }

    #[test]
    fn windows_that_ran_away_or_are_empty_are_no_disaster() {
        let mut gone = window(0, 1.0, 0.01);
        gone.before = Trace::default();
        let mut short = window(0, 2.0, 0.01);
        short.before.position.truncate(7);
        let empty = TracedWindow::default();
        let of = |windows: Vec<TracedWindow>| traces(&Traces { joints: vec!["a".into(), "b".into()], windows });
        assert!(of(vec![gone.clone()]).is_empty() && of(vec![empty.clone()]).is_empty());
        let html = of(vec![gone, empty, short]);
        assert_eq!(read::boards(&html)[0].begin, Some(1));
    }
}
