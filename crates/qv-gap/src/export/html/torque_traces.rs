//! Torques of each joint over time, and its friction over speed: recorded, predicted, and with what is named.

use qv_held::{Event, TorqueTrace};
use qv_page::{Band, Board, Choice, Line, Look, Panel};

/// Steps that numbers are rounded to: times \[s\], torques \[N m\], speeds \[rad/s\].
const STEPS: [f64; 3] = [1e-3, 1e-4, 1e-4];
/// Points of a friction curve, and fewest rows of one.
const POINTS: usize = 32;
const LEAST_ROWS: usize = 4;

/// The section; empty without traces.
pub(super) fn torque_traces(traces: &[TorqueTrace], events: &[Event]) -> String {
    if traces.is_empty() {
        return String::new();
    }
    let names: Vec<String> = traces.iter().map(|t| t.joint.clone()).collect();
    let choices = vec![Choice { name: "joint".into(), options: names, first: worst(traces) }];
    let (mut torques, mut curves) = (Board::new("time [s]"), Board::new("speed [rad/s]"));
    for (k, trace) in traces.iter().enumerate() {
        let panel = torque_panel(&mut torques, trace, (k, events));
        torques.panels.push(panel);
        let panel = friction_panel(&mut curves, trace, k);
        curves.panels.push(panel);
    }
    (torques.choices, curves.choices) = (choices.clone(), choices);
    format!(
        "<h2>Torques</h2><p class=\"soft\">Of the first recording, through the filter of the balance. Predicted is the robot as its references \
         show it, corrected is that with the cause. Marked: external torques.</p>{}<h3>Friction over speed</h3><p class=\"soft\">Torque less that of \
         links and rotor, means over equal numbers of samples.</p>{}",
        torques.to_card(),
        curves.to_card()
    )
}

/// Joint whose prediction is farthest off for its torque.
fn worst(traces: &[TorqueTrace]) -> usize {
    let off = |t: &TorqueTrace| {
        let left: f64 = t.measured.iter().zip(&t.predicted).map(|(a, b)| (a - b).powi(2)).sum();
        left / t.measured.iter().map(|x| x * x).sum::<f64>().max(1e-12)
    };
    (0..traces.len()).max_by(|&a, &b| off(&traces[a]).total_cmp(&off(&traces[b]))).unwrap_or(0)
}

fn torque_panel(board: &mut Board, trace: &TorqueTrace, (joint, events): (usize, &[Event])) -> Panel {
    // Recordings start their clocks anew, and an axis does not run back.
    let rows = trace.run.iter().take_while(|run| **run == 0).count();
    let time = board.column(&trace.time[..rows], STEPS[0]);
    let mut line = |name: &str, tone: &str, values: &[f64]| {
        (!values.is_empty()).then(|| Line::new(name, tone, time, board.column(&values[..rows], STEPS[1])))
    };
    let measured = line("measured", "measured", &trace.measured).map(|l| l.looking(Look::Wide));
    let lines = [measured, line("predicted", "before", &trace.predicted), line("corrected", "after", &trace.corrected)];
    let own = events.iter().filter(|e| e.joint == trace.joint && e.run == 0);
    Panel {
        title: "torque".into(),
        unit: "N m".into(),
        when: vec![vec![joint]],
        lines: lines.into_iter().flatten().collect(),
        bands: own.map(|e| Band { x: e.time, tone: "accent".into() }).collect(),
        ..Panel::default()
    }
}

fn friction_panel(board: &mut Board, trace: &TorqueTrace, joint: usize) -> Panel {
    let shifted = |by: &[f64]| -> Vec<f64> {
        trace.friction.iter().zip(&trace.measured).zip(by).map(|((f, m), p)| f - (m - p)).collect()
    };
    let series = [
        ("measured", "measured", Look::Dots, trace.friction.clone()),
        ("predicted", "before", Look::Plain, shifted(&trace.predicted)),
        ("corrected", "after", Look::Plain, shifted(&trace.corrected)),
    ];
    let bins = bins(&trace.speed);
    let mean = |of: &[f64], bin: &[usize]| bin.iter().map(|&k| of[k]).sum::<f64>() / bin.len() as f64;
    let speeds: Vec<f64> = bins.iter().map(|bin| mean(&trace.speed, bin)).collect();
    let speed = board.column(&speeds, STEPS[2]);
    let known = series.into_iter().filter(|s| !s.3.is_empty());
    let lines = known.map(|(name, tone, look, values)| {
        let means: Vec<f64> = bins.iter().map(|bin| mean(&values, bin)).collect();
        Line::new(name, tone, speed, board.column(&means, STEPS[1])).looking(look)
    });
    Panel {
        title: "friction".into(),
        unit: "N m".into(),
        when: vec![vec![joint]],
        lines: lines.collect(),
        ..Panel::default()
    }
}

/// Rows of each point, by rising speed.
fn bins(speed: &[f64]) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..speed.len()).collect();
    order.sort_by(|&a, &b| speed[a].total_cmp(&speed[b]));
    let size = speed.len().div_ceil(POINTS).max(LEAST_ROWS);
    order.chunks(size).map(<[usize]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_page::read;

    fn trace(joint: &str, off: f64, run: Vec<usize>) -> TorqueTrace {
        let rows = run.len();
        let ramp: Vec<f64> = (0..rows).map(|k| 0.1 * k as f64 - 1.0).collect();
        TorqueTrace {
            joint: joint.into(),
            time: (0..rows).map(|k| 0.04 * (k % 40) as f64).collect(),
            run,
            speed: ramp.clone(),
            measured: ramp.iter().map(|v| 2.0 * v + 1.0).collect(),
            predicted: ramp.iter().map(|v| 2.0 * v + 1.0 - off * v).collect(),
            corrected: Vec::new(),
            friction: ramp.iter().map(|v| 0.5 * v).collect(),
        }
    }

    #[test]
    fn each_joint_has_its_panels_and_the_worst_is_shown_first() {
        let event = Event { joint: "b".into(), run: 0, time: [0.4, 0.8], torque: 1.0, p: 1e-3 };
        let two = [vec![0; 40], vec![1; 40]].concat();
        let html = torque_traces(&[trace("a", 0.1, two.clone()), trace("b", 0.3, two)], &[event]);
        let boards = read::boards(&html);
        assert_eq!((boards.len(), boards[0].choices[0].first), (2, 1));
        let panel = &boards[0].panels[1];
        assert_eq!((panel.lines.len(), panel.bands.len()), (2, 1), "nothing is corrected");
        let (x, _) = boards[0].points(&panel.lines[0]);
        assert_eq!(x.len(), 40, "of the first run alone");
        // The predicted friction is off by what the prediction is.
        let (speed, friction) = boards[1].points(&boards[1].panels[1].lines[1]);
        assert!(speed.windows(2).all(|w| w[0] < w[1]));
        speed.iter().zip(&friction).for_each(|(v, f)| assert!((f - 0.2 * v).abs() < 1e-3, "{v} {f}"));
        assert!(torque_traces(&[], &[]).is_empty());
    }
}
