//! Joints in windows that no fit has seen: measured, and simulated before and after.

use super::axes::{Axis, padded, path, range, ticks};
use super::words::escape;
use crate::report::Curve;
use std::fmt::Write;

/// Curves that are shown.
const MOST: usize = 8;
const WIDTH: f64 = 500.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 8.0;
/// Top and bottom of the positions, then of the errors \[pixels\].
const POSITIONS: [f64; 2] = [18.0, 158.0];
const ERRORS: [f64; 2] = [188.0, 258.0];
const HEIGHT: f64 = 294.0;
/// Fewer points than this are marked each.
const FEW: usize = 40;

/// The section; empty without curves.
pub(super) fn curves(curves: &[Curve]) -> String {
    let pictures: Vec<String> = curves.iter().filter_map(one).take(MOST).collect();
    if pictures.is_empty() {
        return String::new();
    }
    let key = |name: &str| format!("<span class=\"key\" style=\"background:var(--{name})\"></span>{name}");
    format!(
        "<h2>Before and after</h2><p class=\"soft\">{}{}{} &emsp;in windows that no fit has seen</p><div class=\"grid wide\">{}</div>",
        key("measured"),
        key("before"),
        if curves.iter().any(|c| !c.after.is_empty()) { key("after") } else { String::new() },
        pictures.concat()
    )
}

fn one(curve: &Curve) -> Option<String> {
    let time = range(curve.time.iter().copied()).filter(|t| t[1] > t[0])?;
    let positions = [&curve.measured, &curve.before, &curve.after];
    let position = padded(range(positions.into_iter().flatten().copied())?);
    let xs = Axis { from: time, to: [LEFT, WIDTH - RIGHT] };
    let mut svg = format!(
        "<div class=\"card\"><h3>{0}</h3><svg class=\"half\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0} over time\">",
        escape(&curve.joint)
    );
    svg += &axes(xs, Axis { from: position, to: [POSITIONS[1], POSITIONS[0]] }, "position [rad]");
    let ys = Axis { from: position, to: [POSITIONS[1], POSITIONS[0]] };
    for (class, values) in [("measured", &curve.measured), ("before", &curve.before), ("after", &curve.after)] {
        svg += &line(class, &curve.time, values, xs, ys);
    }
    svg += &errors(curve, xs);
    for (t, label) in ticks(time, 6.0) {
        let _ =
            write!(svg, "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>", xs.at(t), ERRORS[1] + 15.0);
    }
    let _ = write!(svg, "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">time [s]</text>", WIDTH - RIGHT, HEIGHT - 5.0);
    Some(svg + "</svg></div>")
}

/// Simulated minus measured, which the eye cannot take from the positions.
fn errors(curve: &Curve, xs: Axis) -> String {
    let minus =
        |simulated: &[f64]| -> Vec<f64> { simulated.iter().zip(&curve.measured).map(|(s, m)| 1e3 * (s - m)).collect() };
    let (before, after) = (minus(&curve.before), minus(&curve.after));
    let Some(found) = range(before.iter().chain(&after).copied().chain([0.0])) else { return String::new() };
    let ys = Axis { from: padded(found), to: [ERRORS[1], ERRORS[0]] };
    let mut svg = axes(xs, ys, "simulated − measured [mrad]");
    let _ = write!(svg, "<path class=\"zero\" d=\"M{LEFT} {:.1}H{}\"/>", ys.at(0.0), WIDTH - RIGHT);
    for (class, values) in [("before", before), ("after", after)] {
        svg += &line(class, &curve.time, &values, xs, ys);
    }
    svg
}

/// A line, with its points where they are few.
fn line(class: &str, time: &[f64], values: &[f64], xs: Axis, ys: Axis) -> String {
    let drawn = path(time, values, xs, ys);
    if drawn.is_empty() {
        return drawn;
    }
    let mut svg = format!("<path class=\"line l-{class}\" d=\"{drawn}\"/>");
    let known = time.iter().zip(values).filter(|(t, v)| t.is_finite() && v.is_finite());
    if values.len() <= FEW {
        let points: String = known.map(|(t, v)| format!("M{:.1} {:.1}h0", xs.at(*t), ys.at(*v))).collect();
        let _ = write!(svg, "<path class=\"line points l-{class}\" d=\"{points}\"/>");
    }
    svg
}

fn axes(xs: Axis, ys: Axis, label: &str) -> String {
    let (bottom, top) = (ys.to[0], ys.to[1]);
    let mut svg = String::new();
    for (y, text) in ticks(ys.from, if bottom - top > 100.0 { 5.0 } else { 3.0 }) {
        let at = ys.at(y);
        let _ = write!(svg, "<path class=\"axis\" d=\"M{LEFT} {at:.1}H{}\"/>", WIDTH - RIGHT);
        let _ = write!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>", LEFT - 5.0, at + 4.0);
    }
    for (t, _) in ticks(xs.from, 6.0) {
        let _ = write!(svg, "<path class=\"axis\" d=\"M{:.1} {top}V{bottom}\"/>", xs.at(t));
    }
    let _ = write!(svg, "<text x=\"{LEFT}\" y=\"{}\">{label}</text>", top - 6.0);
    svg
}
