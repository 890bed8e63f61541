//! `replay.html`: one file with its plots inside, no network, light or dark as the reader's screen is.

use crate::Replay;
use crate::errors::Errors;
use crate::joint_board::{TIME_STEP, joint_board, numbers_of_an_instant};
use crate::verdict::{lag_remark, verdict};
use qv_page::parts::{self, Mood, Table, key};
use qv_page::picture::{Axis, axes, map, padded, path, range};
use qv_page::{Board, Line, Look, Page, Panel, Stretch, escape, fixed};
use qv_recording::lag::Lag;
use qv_rollout::Trace;

/// Name of what moves together on the page: everything over time.
const LINK: &str = "time";
/// Numbers of joints that a page holds: 20 s at 500 Hz of twelve joints, three channels, three lines. More make a file that nobody sends.
const MOST: usize = 1_100_000;
/// Lines of a joint's channel.
const SERIES: usize = 3;
/// Length of a stretch that one can go to \[s\].
const STRETCH: f64 = 2.0;

/// The page. `title` names the recording; `notes` are said under the verdict, one paragraph each, such as what was lost.
pub fn to_html(replay: &Replay, title: &str, notes: &[String]) -> String {
    let said = verdict(replay);
    let (first, rest) = said.split_once(". ").unwrap_or((said.trim_end_matches('.'), ""));
    let said = format!("<b>{}.</b> {}", escape(first), escape(rest));
    let body = [
        parts::verdict(Mood::Plain, "", &said),
        parts::notes(notes),
        joint_table(replay),
        groups(&replay.window_errors),
        error_over_time(replay),
        joints(replay),
        base_path(replay),
    ];
    let heading = format!("Replay of {}", escape(title));
    Page { title: &format!("Replay of {title}"), heading: &heading, body: &body.concat(), ..Page::default() }.to_html()
}

fn joint_table(replay: &Replay) -> String {
    let largest =
        replay.window_errors.joints.iter().map(|j| j.position).filter(|x| x.is_finite()).fold(1e-12, f64::max);
    let restarted = format!("restarted every {} s", replay.windows.length);
    let mut table = Table::grouped(
        &[("", 1), (&restarted, 3), ("whole run", 1), ("robot's lag behind", 2)],
        &[
            "joint",
            "position [mrad]",
            "velocity [rad/s]",
            "torque [N m]",
            "position [mrad]",
            "command [ms]",
            "simulation [ms]",
        ],
    );
    for (j, name) in replay.joint_names.iter().enumerate() {
        let (w, e) = (&replay.window_errors.joints[j], &replay.errors.joints[j]);
        let lag = |lags: &[Lag]| lags.iter().find(|l| l.joint == *name).map_or(f64::NAN, |l| 1e3 * l.lag);
        let cells = [
            escape(name),
            fixed(1e3 * w.position, 2),
            fixed(w.velocity, 3),
            fixed(w.torque, 2),
            fixed(1e3 * e.position, 1),
            fixed(lag(&replay.command_lags), 1),
            fixed(lag(&replay.model_lags), 1),
        ];
        table.row_with_bar(&cells, 1, w.position / largest);
    }
    let remark = parts::notes(lag_remark(replay).as_slice());
    format!("<h2>By joint, root mean square</h2>{}", parts::card(&(table.to_html() + &remark)))
}

fn groups(errors: &Errors) -> String {
    if errors.legs.is_empty() && errors.phases.is_empty() {
        return String::new();
    }
    let mut cards = String::new();
    if !errors.legs.is_empty() {
        let mut table = Table::new(&["leg", "position [mrad]"]);
        errors.legs.iter().for_each(|(name, rms)| _ = table.row(&[escape(name), fixed(1e3 * rms, 2)]));
        cards += &parts::card(&table.to_html());
    }
    if !errors.phases.is_empty() {
        let mut table = Table::new(&["phase", "position [mrad]", "share of time"]);
        for p in &errors.phases {
            table.row(&[p.phase.name().into(), fixed(1e3 * p.position, 2), format!("{} %", fixed(100.0 * p.share, 0))]);
        }
        cards += &parts::card(&table.to_html());
    }
    format!("<h2>By leg and by phase, restarted</h2>{}", parts::grid(300, &cards))
}

fn error_over_time(replay: &Replay) -> String {
    let mut board = Board::new("time [s]");
    board.link = LINK.into();
    let mut line = |name: &str, tone: &str, errors: &Errors| {
        let middles: Vec<f64> = errors.times.iter().map(|t| 0.5 * (t.start + t.end)).collect();
        let errors: Vec<f64> = errors.times.iter().map(|t| 1e3 * t.position).collect();
        Line::new(name, tone, board.column(&middles, TIME_STEP), board.column(&errors, 1e-3)).looking(Look::Dots)
    };
    let lines =
        vec![line("restarted", "c0", &replay.window_errors), line("whole run, open loop", "c1", &replay.errors)];
    // An amount: its height counts from zero.
    let (title, unit) = ("position error, rms over joints".into(), "mrad".into());
    board.panels.push(Panel { title, unit, lines, zero: true, ..Panel::default() });
    format!("<h2>Position error over time</h2>{}", board.to_card())
}

/// Every joint, recorded and simulated, with what lies between; of position, velocity and torque those that were recorded.
fn joints(replay: &Replay) -> String {
    let recorded = &replay.recorded;
    let all = stretches(&replay.window_errors);
    let (stretches, instants) = shown(replay, &all, numbers_of_an_instant(recorded, SERIES));
    let window = |[window, k]: [usize; 2]| (&replay.windows.windows[window].trace, k);
    let [recorded, restarted, whole] = [
        picked(&instants, recorded, |i| Some((recorded, i.at))),
        picked(&instants, recorded, |i| i.window.map(window)),
        picked(&instants, recorded, |i| Some((&replay.whole, i.at))),
    ];
    let simulated = [("restarted", "c0", &restarted), ("whole run", "c1", &whole)];
    let first = replay.window_errors.worst();
    let mut board = joint_board(&replay.joint_names, ("recorded", "measured", &recorded), &simulated, first);
    board.link = LINK.into();
    let left_out = if stretches.len() < all.len() {
        format!(" Of this long recording the {} s with the largest errors are shown.", STRETCH * stretches.len() as f64)
    } else {
        String::new()
    };
    board.stretches = stretches;
    format!(
        "<h2>Joint by joint</h2><p class=\"soft\">At first the joint with the largest error. Restarted: from the measured state every \
         {} s; whole run: open loop from the first state.{left_out}</p>{}",
        replay.windows.length,
        board.to_card()
    )
}

/// The joints at some instants, from the trace and the row in it that `from` names; NaN where there is none.
fn picked<'t>(instants: &[Instant], recorded: &Trace, from: impl Fn(&Instant) -> Option<(&'t Trace, usize)>) -> Trace {
    let channel = |of: fn(&Trace) -> &[f64]| -> Vec<f64> {
        let value = |from: Option<(&Trace, usize)>, j: usize| {
            from.and_then(|(trace, row)| of(trace).get(row * trace.joints + j)).copied().unwrap_or(f64::NAN)
        };
        let row = |i| {
            let from = from(i);
            (0..recorded.joints).map(move |j| value(from, j))
        };
        instants.iter().flat_map(row).collect()
    };
    Trace {
        time: instants.iter().map(|i| recorded.time[i.at]).collect(),
        position: channel(|t| &t.position),
        velocity: channel(|t| &t.velocity),
        torque: channel(|t| &t.torque),
        joints: recorded.joints,
        ..Trace::default()
    }
}

/// An instant that is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Instant {
    /// Which of the recorded ones.
    at: usize,
    /// Window and place in it; none between windows. After the last instant of a window comes the same instant without one, so that no
    /// line joins a window to the next.
    window: Option<[usize; 2]>,
}

/// Which stretches and instants are shown where each instant costs so many numbers: those with the largest errors of a recording that is
/// too long for all.
fn shown(replay: &Replay, all: &[(Stretch, f64)], numbers: usize) -> (Vec<Stretch>, Vec<Instant>) {
    let time = &replay.recorded.time;
    let count = |s: &Stretch| time.iter().filter(|t| is_in(s, **t)).count();
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|&a, &b| all[b].1.total_cmp(&all[a].1));
    let mut spent = 0;
    order.retain(|&k| {
        spent += numbers * count(&all[k].0);
        spent <= MOST
    });
    order.sort_unstable();
    let stretches: Vec<Stretch> = order.iter().map(|&k| all[k].0.clone()).collect();
    let mut window = vec![None; time.len()];
    for (w, of) in replay.windows.windows.iter().enumerate() {
        let place = window.iter_mut().skip(of.first).take(of.trace.time.len());
        place.enumerate().for_each(|(k, place)| *place = Some([w, k]));
    }
    let mut instants = Vec::new();
    for (at, &t) in time.iter().enumerate().filter(|(_, t)| stretches.iter().any(|s| is_in(s, **t))) {
        instants.push(Instant { at, window: window[at] });
        let next = window.get(at + 1).copied().flatten();
        let is_last = window[at].is_some() && next.map(|n| n[0]) != window[at].map(|w| w[0]);
        let ends_here = stretches.iter().any(|s| is_in(s, t) && time.get(at + 1).is_some_and(|next| !is_in(s, *next)));
        if is_last || ends_here {
            instants.push(Instant { at, window: None });
        }
    }
    (stretches, instants)
}

fn is_in(stretch: &Stretch, time: f64) -> bool {
    stretch.x[0] <= time && time < stretch.x[1]
}

/// Parts of the recording, one after the other, and their errors; the one with the largest says so.
fn stretches(errors: &Errors) -> Vec<(Stretch, f64)> {
    let (Some(first), Some(last)) = (errors.times.first(), errors.times.last()) else { return Vec::new() };
    let count = ((last.end - first.start) / STRETCH).floor() as usize + 1;
    let stretch = |k: usize| {
        let x = [first.start + STRETCH * k as f64, first.start + STRETCH * (k + 1) as f64];
        let within = errors.times.iter().filter(|t| x[0] <= t.start && t.start < x[1]).map(|t| t.position);
        let error = within.filter(|e| e.is_finite()).fold(0.0, f64::max);
        (Stretch { name: format!("{} to {} s", fixed(x[0], 1), fixed(x[1], 1)), x }, error)
    };
    let mut all: Vec<(Stretch, f64)> = (0..count).map(stretch).collect();
    if let Some(worst) = all.iter_mut().max_by(|a, b| a.1.total_cmp(&b.1)) {
        worst.0.name += ": largest error";
    }
    all
}

fn base_path(replay: &Replay) -> String {
    if replay.recorded.base.is_empty() || replay.whole.base.is_empty() {
        return String::new();
    }
    let places = |trace: &Trace, axis: usize| trace.base.iter().map(|b| b[axis]).collect::<Vec<f64>>();
    let paths = [("recorded", "measured", &replay.recorded), ("simulated", "c1", &replay.whole)]
        .map(|(name, tone, trace)| (name, tone, [places(trace, 0), places(trace, 1)]));
    let ends = |axis: usize| range(paths.iter().flat_map(|p| &p.2[axis]).copied());
    let (Some(x), Some(y)) = (ends(0), ends(1)) else { return String::new() };
    let (xs, ys, height) = map(padded(x), padded(y), 448.0, [150.0, 400.0], [62.0, 10.0]);
    let mut svg = format!(
        "<svg class=\"half\" viewBox=\"0 0 520 {:.0}\" role=\"img\" aria-label=\"path of the base from above\">{}",
        height + 48.0,
        axes(xs, ys, "x [m]", "y [m]")
    );
    for (name, tone, [x, y]) in &paths {
        svg += &way(name, tone, (x, y), xs, ys);
    }
    format!(
        "<h2>Path of the base from above</h2><div class=\"card\"><p class=\"soft\">{}{}, open loop</p>{svg}</svg></div>",
        key("measured", "recorded"),
        key("c1", "simulated")
    )
}

/// A line on the map, which says where it ends.
fn way(name: &str, tone: &str, (x, y): (&[f64], &[f64]), xs: Axis, ys: Axis) -> String {
    let end = x.iter().zip(y).rev().find(|(x, y)| x.is_finite() && y.is_finite());
    let end = end.map_or(String::new(), |(x, y)| format!(": ends at {} m, {} m", fixed(*x, 2), fixed(*y, 2)));
    format!(
        "<path fill=\"none\" stroke-width=\"1.8\" style=\"stroke:var(--{tone})\" d=\"{}\"><title>{name}{end}</title></path>",
        path(x, y, xs, ys)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{JointErrors, TimeErrors};
    use crate::facts::States;
    use crate::{Window, Windows};
    use qv_page::read;

    /// A joint and its neighbour for `seconds` at 100 Hz, restarted every second; nothing was measured of torque.
    fn made_up(seconds: usize, names: [&str; 2]) -> Replay {
        let trace = |from: usize, to: usize, late: f64| {
            let time: Vec<f64> = (from..to).map(|i| 0.01 * i as f64).collect();
            let position = time.iter().flat_map(|t| [(t - late).sin(), (t - late).cos()]).collect();
            let velocity = time.iter().flat_map(|t| [(t - late).cos(), -(t - late).sin()]).collect();
            Trace { time, position, velocity, joints: 2, ..Trace::default() }
        };
        let window = |k: usize| Window { first: 100 * k, trace: trace(100 * k, 100 * (k + 1), 0.02) };
        let bin = |k: usize| TimeErrors {
            start: 0.5 * k as f64,
            end: 0.5 * (k + 1) as f64,
            position: if k == 6 { 0.02 } else { 0.01 },
        };
        let joint = |position: f64| JointErrors { position, velocity: 0.1, torque: f64::NAN };
        let errors = Errors {
            joints: vec![joint(0.01), joint(0.02)],
            legs: vec![],
            phases: vec![],
            times: (0..2 * seconds).map(bin).collect(),
            base: None,
        };
        Replay {
            joint_names: names.map(String::from).to_vec(),
            feet: qv_rollout::Feet::default(),
            recorded: trace(0, 100 * seconds, 0.0),
            whole: trace(0, 100 * seconds, 0.03),
            windows: Windows { length: 1.0, windows: (0..seconds).map(window).collect(), skipped: 0, ran_away: 0 },
            window_errors: errors.clone(),
            errors,
            command_lags: vec![],
            model_lags: vec![],
            ran_away: None,
            simulated: 0.0,
        }
    }

    #[test]
    fn a_browser_shows_the_page() {
        let mut replay = made_up(4, ["FL_hip_joint", "a_joint_with_a_long_name"]);
        let ways: Vec<[f64; 7]> = (0..400).map(|k| [0.01 * f64::from(k), 0.1, 0.3, 1.0, 0.0, 0.0, 0.0]).collect();
        (replay.recorded.base, replay.whole.base) = (ways.clone(), ways);
        crate::browser::check("replay", &to_html(&replay, "recordings/walk.mcap", &["One message was lost.".into()]));
    }

    #[test]
    fn every_joint_can_be_chosen_and_windows_are_not_joined() {
        let page = to_html(&made_up(4, ["hip", "knee"]), "walk", &["One message was lost.".into()]);
        assert!(page.states("message lost") && page.contains("<title>Replay of walk</title>"));
        let boards = read::boards(&page);
        assert_eq!((boards.len(), boards[0].link.as_str(), boards[1].link.as_str()), (2, "time", "time"));
        let board = &boards[1];
        assert_eq!(board.choices[0].options, ["hip", "knee"]);
        assert_eq!(
            (board.choices[0].first, &board.choices[1].options[..]),
            (1, &["position", "velocity", "all"].map(String::from)[..])
        );
        assert_eq!(board.panels.len(), 2 * 2 * 2);
        let [recorded, restarted, whole] = [0, 1, 2].map(|k| board.points(&board.panels[0].lines[k]).1);
        assert_eq!((restarted.len(), restarted.iter().filter(|x| x.is_nan()).count()), (404, 4));
        assert!(restarted[100].is_nan() && (restarted[101] - 0.98_f64.sin()).abs() < 2e-5);
        assert!(recorded.iter().chain(&whole).all(|x| x.is_finite()));
        let error = board.points(&board.panels[1].lines[1]).1;
        assert!((error[50] - 1e3 * (0.47_f64.sin() - 0.5_f64.sin())).abs() < 0.03);
        assert_eq!(board.stretches[1].name, "2.0 to 4.0 s: largest error");
    }

    #[test]
    fn of_a_recording_that_is_too_long_the_worst_is_shown() {
        let replay = made_up(8, ["hip", "knee"]);
        let all = stretches(&replay.window_errors);
        let (some, instants) = shown(&replay, &all, MOST / 420);
        assert_eq!(some.iter().map(|s| s.x[0]).collect::<Vec<_>>(), [0.0, 2.0]);
        assert_eq!(instants.iter().filter(|i| i.window.is_none()).count(), 4);
        assert_eq!(shown(&replay, &all, MOST / 5).1, []);
    }

    #[test]
    fn no_name_breaks_the_page_and_nothing_comes_from_elsewhere() {
        let nasty = "</script><script>alert(\"1\" & '2')</script>";
        let mut replay = made_up(3, [nasty, "knee"]);
        replay.whole = Trace { joints: 2, ..Trace::default() };
        replay.windows.windows.truncate(1);
        let page = to_html(&replay, nasty, &[nasty.into()]);
        assert_eq!(page.matches("</script>").count(), 3, "two boards and what draws them");
        assert!(!page.contains("<script>alert"));
        let text = read::without_scripts(&page);
        for never in ["NaN", "inf<", "http:", "https:", "src=", "<link", "@import", "url("] {
            assert!(!text.contains(never), "{never}");
        }
        for tag in ["div", "table", "tr", "td", "svg", "h2", "p", "span"] {
            let opened = text.matches(&format!("<{tag}>")).count() + text.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, text.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
