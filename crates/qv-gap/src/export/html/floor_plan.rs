//! The floor from above: the robot's way in the colours of the gap, and regions that were found.

use super::words::{escape, fixed, percent, significant};
use crate::report::{FloorPoint, RegionShare};
use qv_page::picture::{Axis, axes, legend, level, map, padded, range};
use std::fmt::Write;

/// Points of a way: more cannot be seen.
const POINTS: usize = 600;
const WIDTH: f64 = 500.0;
/// Left, right, top, bottom \[pixels\].
const EDGES: [f64; 4] = [46.0, 10.0, 10.0, 38.0];

/// Before and after side by side, one scale for x and y; empty when nowhere is known.
pub(super) fn floor_plan(points: &[FloorPoint], regions: &[RegionShare]) -> String {
    let known: Vec<&FloorPoint> = points.iter().filter(|p| p.x.is_finite() && p.y.is_finite()).collect();
    let regions: Vec<&RegionShare> = regions.iter().filter(|r| r.x.iter().chain(&r.y).all(|x| x.is_finite())).collect();
    if known.is_empty() {
        return String::new();
    }
    let values = || known.iter().flat_map(|p| [p.before, p.after]).filter(|x| *x > 0.0);
    let most = range(values()).map_or(2.0, |r| r[1].max(2.0));
    let mut text = String::from("<h3>Error along the path of the robot</h3><div class=\"grid wide\">");
    let before = |p: &FloorPoint| p.before;
    let after = |p: &FloorPoint| p.after;
    text += &plan("before", &known, before, &regions, most);
    if known.iter().any(|p| p.after.is_finite()) {
        text += &plan("after", &known, after, &regions, most);
    }
    let labels = [1.0, most.sqrt(), most].map(|x| significant(x, 2));
    text + "</div>" + &legend("1 = robot without a fault", labels)
}

/// Both axes and the height of the picture.
fn frame(points: &[&FloorPoint], regions: &[&RegionShare]) -> (Axis, Axis, f64) {
    let xs = points.iter().map(|p| p.x).chain(regions.iter().flat_map(|r| r.x));
    let ys = points.iter().map(|p| p.y).chain(regions.iter().flat_map(|r| r.y));
    let [x, y] = [range(xs), range(ys)].map(|r| padded(r.unwrap_or([0.0, 1.0])));
    let inner = WIDTH - EDGES[0] - EDGES[1];
    let (xs, ys, height) = map(x, y, inner, [150.0, 380.0], [EDGES[0], EDGES[2]]);
    (xs, ys, height + EDGES[2] + EDGES[3])
}

fn plan(
    name: &str,
    points: &[&FloorPoint],
    value: impl Fn(&FloorPoint) -> f64,
    regions: &[&RegionShare],
    most: f64,
) -> String {
    let (xs, ys, height) = frame(points, regions);
    let mut svg = format!(
        "<div class=\"card\"><h3>{name}</h3><svg class=\"half\" viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" \
         aria-label=\"gap on the floor, {name}\">"
    );
    svg += &axes(xs, ys, "x [m]", "y [m]");
    let stride = points.len().div_ceil(POINTS).max(1);
    let shown: Vec<&FloorPoint> = points.iter().step_by(stride).copied().collect();
    let _ = write!(svg, "<path class=\"way\" d=\"{}\"/>", way(&shown, xs, ys));
    let radius = if shown.len() > 200 { 3.0 } else { 4.5 };
    // The largest last, so that they are not hidden.
    let mut order = shown.clone();
    order.sort_by(|a, b| value(a).total_cmp(&value(b)));
    for p in order {
        let class = level(value(p).max(1.0).ln() / most.ln() + 0.0 * value(p));
        let _ = write!(
            svg,
            "<circle class=\"dot {class}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\"><title>{} m, {} m: {}</title></circle>",
            xs.at(p.x),
            ys.at(p.y),
            fixed(p.x, 2),
            fixed(p.y, 2),
            significant(value(p), 3)
        );
    }
    for r in regions {
        svg += &region(r, (name == "before").then(|| percent(r.share)), xs, ys);
    }
    let start = shown[0];
    let _ = write!(
        svg,
        "<text class=\"halo\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">start</text>",
        xs.at(start.x).max(EDGES[0] + 14.0),
        ys.at(start.y) - 9.0
    );
    svg + "</svg></div>"
}

/// The line through the points, broken where the next is far: another run begins there.
fn way(points: &[&FloorPoint], xs: Axis, ys: Axis) -> String {
    let step = |i: usize| (points[i].x - points[i - 1].x).hypot(points[i].y - points[i - 1].y);
    let mut steps: Vec<f64> = (1..points.len()).map(step).collect();
    steps.sort_by(f64::total_cmp);
    let far = steps.get(steps.len() / 2).map_or(0.0, |usual| (8.0 * usual).max(0.2));
    let command = |i: usize| if i == 0 || step(i) > far { 'M' } else { 'L' };
    let at = |(i, p): (usize, &&FloorPoint)| format!("{}{:.1} {:.1}", command(i), xs.at(p.x), ys.at(p.y));
    points.iter().enumerate().map(at).collect()
}

/// A part of the floor, with its share of the gap before anything is corrected.
fn region(r: &RegionShare, share: Option<String>, xs: Axis, ys: Axis) -> String {
    let [left, right] = [xs.at(r.x[0].min(r.x[1])), xs.at(r.x[0].max(r.x[1]))];
    let [bottom, top] = [ys.at(r.y[0].min(r.y[1])), ys.at(r.y[0].max(r.y[1]))];
    // Regions lie side by side: each name stays inside its own, as far as it fits.
    let whole = share.as_ref().map_or(r.name.clone(), |share| format!("{}, {share}", r.name));
    let title = if share.is_some() { format!("{whole} of the gap") } else { r.name.clone() };
    let fits = 6.2 * whole.chars().count() as f64 + 8.0 < right - left;
    let label = if fits { whole } else { share.unwrap_or_default() };
    format!(
        "<rect class=\"region\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>\
         <text class=\"label halo\" x=\"{:.1}\" y=\"{:.1}\">{}<title>{}</title></text>",
        right - left,
        bottom - top,
        left + 4.0,
        top + 13.0,
        escape(&label),
        escape(&title)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64) -> FloorPoint {
        FloorPoint { x, y, before: 20.0, after: f64::NAN }
    }

    #[test]
    fn standing_still_is_a_place_too() {
        let text = floor_plan(&[point(1.0, 1.0), point(f64::NAN, 0.0)], &[]);
        assert_eq!(text.matches("<circle").count(), 1);
        assert!(!text.contains("NaN") && !text.contains("inf"));
        assert!(floor_plan(&[], &[]).is_empty());
    }
}
