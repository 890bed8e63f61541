//! `replay.html`: one file with its plots inside, no network, light or dark as the reader's screen is.

use crate::replay::errors::Errors;
use crate::replay::verdict::verdict;
use crate::replay::{Lag, Replay};
use std::fmt::Write;

/// Points of a line: more cannot be seen.
const POINTS: usize = 1500;

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1c2430;--soft:#5d6875;--paper:#fbfbf9;--card:#fff;--line:#dfe3e8;\
--rec:#1f6fb5;--sim:#d9601a;--bar:#8fb8d8}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ee;--soft:#9aa5b1;--paper:#14181d;--card:#1b2027;--line:#313a44;\
--rec:#6db3f2;--sim:#ff9d5c;--bar:#3d6a96}}\
*{box-sizing:border-box}body{margin:0 auto;max-width:1000px;padding:28px 20px 60px;background:var(--paper);\
color:var(--ink);font:15px/1.5 system-ui,sans-serif}\
h1{font-size:22px;margin:0 0 4px;overflow-wrap:anywhere}h2{font-size:16px;margin:34px 0 8px}p{margin:4px 0}.soft{color:var(--soft)}\
.verdict{background:var(--card);border:1px solid var(--line);border-left:4px solid var(--sim);border-radius:6px;\
padding:14px 18px;margin:14px 0;font-size:17px}\
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums;background:var(--card);\
border:1px solid var(--line);border-radius:6px}th,td{padding:4px 12px;text-align:right;border-top:1px solid var(--line)}\
th{font-weight:600;color:var(--soft);border-top:0}th:first-child,td:first-child{text-align:left}\
tr.units th{border-top:0;padding-top:0;font-weight:400}th[colspan]{text-align:center}\
td.bar{background:linear-gradient(var(--bar),var(--bar)) left bottom/var(--w) 4px no-repeat}\
.scroll{overflow-x:auto}.side{display:flex;flex-wrap:wrap;align-items:flex-start;gap:20px}.side table{width:auto;flex:1 1 260px}\
svg{display:block;width:100%;min-width:640px;height:auto;background:var(--card);border:1px solid var(--line);\
border-radius:6px}\
svg text{font:12px system-ui,sans-serif;fill:var(--soft)}.grid{stroke:var(--line)}\
.rec,.sim{fill:none;stroke-width:1.5}.rec{stroke:var(--rec)}.sim{stroke:var(--sim)}\
.key{display:inline-block;width:18px;height:3px;vertical-align:middle;margin:0 6px 0 14px}";

/// The page. `title` names the recording; `notes` are said under the verdict, one paragraph each, such as what was lost.
pub fn to_html(replay: &Replay, title: &str, notes: &[String]) -> String {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>Replay of {0}</title><style>{STYLE}</style><h1>Replay of {0}</h1>",
        escape(title)
    );
    let said = verdict(replay);
    let (first, rest) = said.split_once(". ").unwrap_or((said.trim_end_matches('.'), ""));
    let _ = write!(page, "<div class=\"verdict\"><b>{}.</b> {}</div>", escape(first), escape(rest));
    for note in notes {
        let _ = write!(page, "<p class=\"soft\">{}</p>", escape(note));
    }
    page += &joint_table(replay);
    page += &groups(&replay.window_errors);
    page += &error_over_time(replay);
    page += &worst_joint(replay);
    page += &base_path(replay);
    page += "</html>\n";
    page
}

fn number(x: f64, digits: usize) -> String {
    if x.is_finite() { format!("{x:.digits$}") } else { "–".into() }
}

fn joint_table(replay: &Replay) -> String {
    let largest =
        replay.window_errors.joints.iter().map(|j| j.position).filter(|x| x.is_finite()).fold(1e-12, f64::max);
    let mut text = format!(
        "<h2>By joint, root mean square</h2><div class=\"scroll\"><table>\
         <tr><th><th colspan=\"3\">restarted every {} s<th>whole run<th colspan=\"2\">robot's lag behind</tr>\
         <tr class=\"units\"><th>joint<th>position [mrad]<th>velocity [rad/s]<th>torque [N m]<th>position [mrad]\
         <th>command [ms]<th>simulation [ms]</tr>",
        replay.windows.length
    );
    for (j, name) in replay.joint_names.iter().enumerate() {
        let (w, e) = (&replay.window_errors.joints[j], &replay.errors.joints[j]);
        let lag = |lags: &[Lag]| lags.iter().find(|l| l.joint == *name).map_or(f64::NAN, |l| 1e3 * l.lag);
        let width = if w.position.is_finite() { 100.0 * w.position / largest } else { 0.0 };
        let _ = write!(
            text,
            "<tr><td>{}<td class=\"bar\" style=\"--w:{width:.0}%\">{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            escape(name),
            number(1e3 * w.position, 2),
            number(w.velocity, 3),
            number(w.torque, 2),
            number(1e3 * e.position, 1),
            number(lag(&replay.command_lags), 1),
            number(lag(&replay.model_lags), 1)
        );
    }
    text + "</table></div>"
}

fn groups(errors: &Errors) -> String {
    if errors.legs.is_empty() && errors.phases.is_empty() {
        return String::new();
    }
    let mut text = String::from("<h2>By leg and by phase, restarted</h2><div class=\"side\">");
    if !errors.legs.is_empty() {
        text += "<table><tr><th>leg<th>position [mrad]</tr>";
        for (name, rms) in &errors.legs {
            let _ = write!(text, "<tr><td>{}<td>{}</tr>", escape(name), number(1e3 * rms, 2));
        }
        text += "</table>";
    }
    if !errors.phases.is_empty() {
        text += "<table><tr><th>phase<th>position [mrad]<th>share of time</tr>";
        for p in &errors.phases {
            let (name, rms) = (p.phase.name(), number(1e3 * p.position, 2));
            let _ = write!(text, "<tr><td>{name}<td>{rms}<td>{:.0} %</tr>", 100.0 * p.share);
        }
        text += "</table>";
    }
    text + "</div>"
}

fn error_over_time(replay: &Replay) -> String {
    let line = |errors: &Errors| -> Vec<[f64; 2]> {
        errors.times.iter().map(|t| [0.5 * (t.start + t.end), 1e3 * t.position]).collect()
    };
    let lines = [("rec", line(&replay.window_errors)), ("sim", line(&replay.errors))];
    let key = "<span class=\"key\" style=\"background:var(--rec)\"></span>restarted\
        <span class=\"key\" style=\"background:var(--sim)\"></span>whole run, open loop";
    format!(
        "<h2>Position error over time</h2><p class=\"soft\">{key}</p>{}",
        plot(&lines, "time [s]", "rms over joints [mrad]", Axes::FromZero)
    )
}

const BOTH: &str = "<span class=\"key\" style=\"background:var(--rec)\"></span>recorded\
    <span class=\"key\" style=\"background:var(--sim)\"></span>simulated";

fn worst_joint(replay: &Replay) -> String {
    let (joint, n) = (replay.window_errors.worst(), replay.recorded.joints);
    let time = &replay.recorded.time;
    let recorded: Vec<[f64; 2]> =
        time.iter().enumerate().map(|(i, &t)| [t, replay.recorded.position[i * n + joint]]).collect();
    let mut simulated = Vec::new();
    for window in &replay.windows.windows {
        let trace = &window.trace;
        simulated.extend(trace.time.iter().enumerate().map(|(k, &t)| [t, trace.position[k * n + joint]]));
        // A break, so that no line joins one window to the next.
        simulated.push([f64::NAN; 2]);
    }
    let name = replay.joint_names.get(joint).map_or("", |n| n);
    let (from, to) = worst_stretch(&replay.window_errors);
    let near =
        |line: &[[f64; 2]]| -> Vec<[f64; 2]> { line.iter().copied().filter(|p| !(p[0] < from || p[0] > to)).collect() };
    let closer = [("rec", near(&recorded)), ("sim", near(&simulated))];
    let lines = [("rec", recorded), ("sim", simulated)];
    format!(
        "<h2>Worst joint: {}</h2><p class=\"soft\">{BOTH}, restarted every {} s</p>{}\
         <h2>The same around the largest error</h2><p class=\"soft\">{BOTH}, restarted every {} s</p>{}",
        escape(name),
        replay.windows.length,
        plot(&lines, "time [s]", "position [rad]", Axes::Free),
        replay.windows.length,
        plot(&closer, "time [s]", "position [rad]", Axes::Free)
    )
}

/// Two seconds around the time of the largest error.
fn worst_stretch(errors: &Errors) -> (f64, f64) {
    let worst = errors.times.iter().filter(|t| t.position.is_finite());
    let middle = worst.max_by(|a, b| a.position.total_cmp(&b.position)).map_or(0.0, |t| 0.5 * (t.start + t.end));
    (middle - 1.0, middle + 1.0)
}

fn base_path(replay: &Replay) -> String {
    if replay.recorded.base.is_empty() || replay.whole.base.is_empty() {
        return String::new();
    }
    let line = |base: &[[f64; 7]]| base.iter().map(|b| [b[0], b[1]]).collect::<Vec<_>>();
    let lines = [("rec", line(&replay.recorded.base)), ("sim", line(&replay.whole.base))];
    format!(
        "<h2>Path of the base from above</h2><p class=\"soft\">{BOTH}, open loop</p>{}",
        plot(&lines, "x [m]", "y [m]", Axes::Equal)
    )
}

/// How the ranges of a plot are chosen.
#[derive(Clone, Copy, PartialEq)]
enum Axes {
    /// Each by its data.
    Free,
    /// The vertical one starts at zero: a length there is an amount.
    FromZero,
    /// One scale for both.
    Equal,
}

/// One plot.
fn plot(lines: &[(&str, Vec<[f64; 2]>)], x_label: &str, y_label: &str, axes: Axes) -> String {
    const SIZE: [f64; 2] = [960.0, 300.0];
    const EDGE: [f64; 4] = [62.0, 12.0, 40.0, 14.0];
    let finite = || lines.iter().flat_map(|l| &l.1).filter(|p| p[0].is_finite() && p[1].is_finite());
    if finite().next().is_none() {
        return "<p class=\"soft\">nothing to draw</p>".into();
    }
    let range = |k: usize| {
        let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[k]), h.max(p[k])));
        let pad = 0.04 * (high - low).max(1e-9);
        [low - pad, high + pad]
    };
    let (mut xs, mut ys) = (range(0), range(1));
    if axes == Axes::FromZero {
        ys[0] = 0.0;
    }
    let width = SIZE[0] - EDGE[0] - EDGE[1];
    // A straight walk needs no square.
    let wanted = width * (ys[1] - ys[0]) / (xs[1] - xs[0]) + EDGE[2] + EDGE[3];
    let height = if axes == Axes::Equal { wanted.clamp(220.0, 520.0).round() } else { SIZE[1] };
    let inner = [width, height - EDGE[2] - EDGE[3]];
    if axes == Axes::Equal {
        let scale = ((xs[1] - xs[0]) / inner[0]).max((ys[1] - ys[0]) / inner[1]);
        let widen = |r: [f64; 2], pixels: f64| {
            let extra = 0.5 * (scale * pixels - (r[1] - r[0]));
            [r[0] - extra, r[1] + extra]
        };
        (xs, ys) = (widen(xs, inner[0]), widen(ys, inner[1]));
    }
    let px = |x: f64| EDGE[0] + (x - xs[0]) / (xs[1] - xs[0]) * inner[0];
    let py = |y: f64| EDGE[3] + (ys[1] - y) / (ys[1] - ys[0]) * inner[1];
    let mut svg = format!(
        "<div class=\"scroll\"><svg viewBox=\"0 0 {} {height}\" role=\"img\" aria-label=\"{y_label} over {x_label}\">",
        SIZE[0]
    );
    for x in ticks(xs) {
        let at = px(x);
        let (top, bottom) = (EDGE[3], height - EDGE[2]);
        let _ = write!(svg, "<path class=\"grid\" d=\"M{at:.1} {top}V{bottom}\"/>");
        let _ = write!(svg, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>", bottom + 16.0, tick(x));
    }
    for y in ticks(ys) {
        let at = py(y);
        let _ = write!(svg, "<path class=\"grid\" d=\"M{} {at:.1}H{}\"/>", EDGE[0], SIZE[0] - EDGE[1]);
        let _ =
            write!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>", EDGE[0] - 6.0, at + 4.0, tick(y));
    }
    let (middle, bottom) = (0.5 * SIZE[0], height - 6.0);
    let _ = write!(svg, "<text x=\"{middle}\" y=\"{bottom}\" text-anchor=\"middle\">{x_label}</text>");
    let _ = write!(
        svg,
        "<text transform=\"translate(14 {}) rotate(-90)\" text-anchor=\"middle\">{y_label}</text>",
        0.5 * height
    );
    for (class, points) in lines {
        let _ = write!(svg, "<path class=\"{class}\" d=\"{}\"/>", path(points, px, py));
    }
    svg + "</svg></div>"
}

/// Line commands for the points; breaks where they are not finite.
fn path(points: &[[f64; 2]], px: impl Fn(f64) -> f64, py: impl Fn(f64) -> f64) -> String {
    let stride = points.len().div_ceil(POINTS).max(1);
    let mut text = String::new();
    let mut pen_up = true;
    for (i, p) in points.iter().enumerate() {
        if !(p[0].is_finite() && p[1].is_finite()) {
            pen_up = true;
        } else if i % stride == 0 || pen_up {
            let _ = write!(text, "{}{:.1} {:.1}", if pen_up { 'M' } else { 'L' }, px(p[0]), py(p[1]));
            pen_up = false;
        }
    }
    text
}

/// Round numbers within a range, at most eight.
fn ticks(range: [f64; 2]) -> Vec<f64> {
    let raw = (range[1] - range[0]) / 6.0;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= raw).unwrap_or(10.0 * power);
    let first = (range[0] / step).ceil();
    (0..8).map(|k| (first + f64::from(k)) * step).filter(|x| *x <= range[1]).collect()
}

fn tick(x: f64) -> String {
    let text = format!("{:.4}", if x.abs() < 1e-12 { 0.0 } else { x });
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// Text that is text in HTML and XML, and in their attributes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c => out.push(c),
        }
    }
    out
}
