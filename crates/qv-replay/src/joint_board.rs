//! Every joint of traces of the same instants as plots that one can use: measured, simulated, and what lies between.

use qv_page::{Board, Choice, Column, Line, Look, Panel};
use qv_rollout::Trace;

/// Smallest difference of times that a page keeps \[s\].
pub(super) const TIME_STEP: f64 = 1e-5;

/// A channel of joints: name, unit, the smallest difference that is kept, factor and unit of errors.
struct Channel {
    name: &'static str,
    unit: &'static str,
    step: f64,
    factor: f64,
    error_unit: &'static str,
    of: fn(&Trace) -> &[f64],
}

const CHANNELS: [Channel; 3] = [
    Channel { name: "position", unit: "rad", step: 1e-5, factor: 1e3, error_unit: "mrad", of: |t| &t.position },
    Channel { name: "velocity", unit: "rad/s", step: 1e-3, factor: 1.0, error_unit: "rad/s", of: |t| &t.velocity },
    Channel { name: "torque", unit: "N m", step: 1e-3, factor: 1.0, error_unit: "N m", of: |t| &t.torque },
];

/// A trace with its name and its colour of the pages' style.
pub type NamedTrace<'a> = (&'a str, &'a str, &'a Trace);

/// Numbers of a board for each instant of this trace, where `lines` traces are drawn.
pub fn numbers_of_an_instant(measured: &Trace, lines: usize) -> usize {
    channels(measured).len() * measured.joints * lines
}

fn channels(measured: &Trace) -> Vec<&'static Channel> {
    CHANNELS.iter().filter(|channel| (channel.of)(measured).iter().any(|x| x.is_finite())).collect()
}

/// Plots over time \[s\] of all joints `names` of a measured trace and of `simulated` ones at the same instants, of the channels that were
/// measured; `first` is the joint that is shown at first. NaN breaks lines. Positions are kept to 0.01 mrad, velocities to 1 mrad/s, torques
/// to 1 mN m, times to 0.01 ms: a page holds no more.
pub fn joint_board(names: &[String], measured: NamedTrace, simulated: &[NamedTrace], first: usize) -> Board {
    let mut board = Board::new("time [s]");
    let channels = channels(measured.2);
    let time = board.column(&measured.2.time, TIME_STEP);
    for joint in 0..names.len() {
        for (k, channel) in channels.iter().enumerate() {
            let when = [vec![joint], vec![k, channels.len()]];
            let found = panels(&mut board, channel, (joint, time), (measured, simulated), &when);
            board.panels.extend(found);
        }
    }
    let options = channels.iter().map(|c| c.name.to_string());
    let options = options.chain((channels.len() > 1).then(|| "all".to_string())).collect();
    let choice = |name: &str, options, first| Choice { name: name.into(), options, first };
    board.choices = vec![choice("joint", names.to_vec(), first), choice("channel", options, 0)];
    board
}

/// A joint's channel, and what its simulations are off; nothing where it was not measured.
fn panels(
    board: &mut Board,
    channel: &Channel,
    (joint, time): (usize, Column),
    (measured, simulated): (NamedTrace, &[NamedTrace]),
    when: &[Vec<usize>],
) -> Vec<Panel> {
    let mut line = |(name, tone, trace): NamedTrace| {
        let values: Vec<f64> = (channel.of)(trace).iter().skip(joint).step_by(trace.joints.max(1)).copied().collect();
        let is_known = values.iter().any(|x| x.is_finite());
        is_known.then(|| Line::new(name, tone, time, board.column(&values, channel.step)))
    };
    let Some(measured) = line(measured) else { return Vec::new() };
    let simulated: Vec<Line> = simulated.iter().filter_map(|s| line(*s)).collect();
    let errors: Vec<Line> = simulated.iter().map(|line| line.clone().minus(measured.y, channel.factor)).collect();
    let error = format!("{}: simulated − {}", channel.name, measured.name);
    let lines = std::iter::once(measured.looking(Look::Wide)).chain(simulated).collect();
    let panel = |title: String, unit: &str, lines: Vec<Line>| Panel {
        title,
        unit: unit.into(),
        when: when.to_vec(),
        lines,
        ..Panel::default()
    };
    let mut panels = vec![panel(channel.name.into(), channel.unit, lines)];
    if !errors.is_empty() {
        panels.push(panel(error, channel.error_unit, errors));
    }
    panels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_measured_has_no_panel_and_what_ran_away_no_line() {
        let trace = |position: [f64; 4], torque: Vec<f64>| Trace {
            time: vec![0.0, 0.1],
            position: position.to_vec(),
            torque,
            joints: 2,
            ..Trace::default()
        };
        let measured = trace([0.0, 1.0, 0.5, 1.5], vec![7.0, f64::NAN, 8.0, f64::NAN]);
        let simulated = trace([0.1, 1.0, 0.4, 1.75], vec![7.5; 4]);
        let nothing = Trace { joints: 2, ..Trace::default() };
        let names = ["a", "b"].map(String::from);
        let simulated = [("before", "before", &simulated), ("after", "after", &nothing)];
        let board = joint_board(&names, ("measured", "measured", &measured), &simulated, 1);
        assert_eq!(board.choices[1].options, ["position", "torque", "all"]);
        let titles: Vec<&str> = board.panels.iter().map(|p| p.title.as_str()).collect();
        let [position, off, torque] = ["position", "position: simulated − measured", "torque"];
        assert_eq!(titles, [position, off, torque, "torque: simulated − measured", position, off]);
        assert_eq!(board.panels[0].lines.len(), 2, "after ran away");
        let (_, error) = board.points(&board.panels[5].lines[0]);
        assert!((error[1] - 250.0).abs() < 1e-6, "{error:?}");
        assert_eq!(numbers_of_an_instant(&measured, 3), 12);
        assert_eq!(joint_board(&names, ("m", "c0", &nothing), &[], 0).to_card(), "");
    }
}
