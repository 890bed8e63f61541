//! Boards as drawings, for readers without scripts.

use crate::board::{Board, Line, Look, Panel};
use crate::picture::{Axis, axes, padded, path, range, shortened};
use crate::text::escape;
use std::fmt::Write;

const WIDTH: f64 = 720.0;
/// Left, right, top, bottom \[pixels\].
const EDGES: [f64; 4] = [58.0, 10.0, 8.0, 38.0];
const HEIGHT: f64 = 200.0;
/// Height of a row of bars \[pixels\].
const ROW: f64 = 22.0;

/// The panels of the first choice.
pub(crate) fn still(board: &Board) -> String {
    let panels: String = board.at_first().map(|panel| one(board, panel)).collect();
    format!("<div class=\"panels\">{panels}</div>")
}

fn one(board: &Board, panel: &Panel) -> String {
    let unit = if panel.unit.is_empty() { String::new() } else { format!(" [{}]", escape(&panel.unit)) };
    let names: String = panel
        .lines
        .iter()
        .map(|l| {
            format!(
                "<span class=\"line\"><i style=\"background:var(--{})\"></i>{}</span> ",
                escape(&l.tone),
                escape(&l.name)
            )
        })
        .collect();
    let class = if panel.half { "panel half" } else { "panel" };
    format!(
        "<div class=\"{class}\"><h3>{}<span class=\"soft\">{unit}</span></h3><div class=\"lines\">{names}</div>{}</div>",
        escape(&panel.title),
        drawing(board, panel)
    )
}

/// A line in the units of the picture's axes.
struct PlotLine<'a> {
    line: &'a Line,
    x: Vec<f64>,
    y: Vec<f64>,
}

fn drawing(board: &Board, panel: &Panel) -> String {
    let begin = board.begin.and_then(|k| board.stretches.get(k)).map(|stretch| stretch.x);
    let level = |log: bool, x: f64| if log { x.log10() } else { x };
    let drawn = |line| {
        let (x, mut y) = board.points(line);
        // Nothing beside what is shown at first.
        if let Some([from, to]) = begin {
            y.iter_mut().zip(&x).filter(|(_, x)| **x < from || **x > to).for_each(|(y, _)| *y = f64::NAN);
        }
        let log = panel.log && line.look != Look::Bar;
        let levels = |log, values: Vec<f64>| values.into_iter().map(|v| level(log, v)).collect();
        PlotLine { line, x: levels(board.log, x), y: levels(log, y) }
    };
    let lines: Vec<PlotLine> = panel.lines.iter().map(drawn).collect();
    let of_x = range(lines.iter().flat_map(|l| l.x.iter().copied()));
    let of_x = begin.map(|x| x.map(|x| level(board.log, x))).or(of_x);
    let Some(across) = of_x.filter(|[low, high]| high > low) else {
        return "<p class=\"soft\">nothing to draw</p>".into();
    };
    let is_bars = panel.lines.iter().all(|l| l.look == Look::Bar);
    let height = if is_bars { ROW * lines.len() as f64 + EDGES[2] + EDGES[3] } else { HEIGHT };
    let zero = panel.zero.then_some(0.0);
    let found = range(lines.iter().flat_map(|l| l.y.iter().copied()).chain(zero));
    let Some(up) = found.map(padded) else { return "<p class=\"soft\">nothing to draw</p>".into() };
    let xs = Axis { from: across, to: [EDGES[0], WIDTH - EDGES[1]] };
    let ys = Axis { from: up, to: [height - EDGES[3], EDGES[2]] };
    // Logarithms say so: a drawing without a script has no room for more.
    let name = |log: bool, name: &str| if log { format!("log10 of {}", escape(name)) } else { escape(name) };
    let mut svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{} over {}\">",
        escape(&panel.title),
        escape(&board.x)
    );
    svg += &axes(
        xs,
        if is_bars { Axis { from: [0.0; 2], ..ys } } else { ys },
        &name(board.log, &board.x),
        if panel.log { "log10" } else { "" },
    );
    for band in &panel.bands {
        let [a, b] = band.x.map(|x| xs.at(level(board.log, x)).clamp(EDGES[0], WIDTH - EDGES[1]));
        let (tone, top) = (escape(&band.tone), EDGES[2]);
        let _ = write!(
            svg,
            "<rect style=\"fill:var(--{tone})\" opacity=\"0.15\" x=\"{a:.1}\" y=\"{top}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            (b - a).max(0.0),
            height - EDGES[2] - EDGES[3]
        );
    }
    for (k, PlotLine { line, x, y }) in lines.iter().enumerate() {
        svg +=
            &if is_bars { bars(line, x, y, xs, EDGES[2] + ROW * k as f64) } else { curve(line, &path(x, y, xs, ys)) };
    }
    svg + "</svg>"
}

fn curve(line: &Line, d: &str) -> String {
    let more = match line.look {
        Look::Wide => " stroke-width=\"2.6\" opacity=\"0.55\"",
        Look::Dashed => " stroke-width=\"1.6\" stroke-dasharray=\"6 4\"",
        _ => " stroke-width=\"1.6\"",
    };
    if d.is_empty() {
        return String::new();
    }
    format!("<path fill=\"none\" style=\"stroke:var(--{})\"{more} d=\"{d}\"/>", escape(&line.tone))
}

fn bars(line: &Line, x: &[f64], y: &[f64], xs: Axis, top: f64) -> String {
    let mut svg = format!(
        "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
        EDGES[0] - 5.0,
        top + 15.0,
        escape(&shortened(&line.name, 9))
    );
    let places: Vec<usize> = (0..x.len()).filter(|&k| x[k].is_finite()).collect();
    for run in places.chunk_by(|&a, &b| (y[a] > 0.0) == (y[b] > 0.0)).filter(|run| y[run[0]] > 0.0) {
        let (a, b) = (xs.at(x[run[0]]), xs.at(x[run[run.len() - 1]]));
        let _ = write!(
            svg,
            "<rect style=\"fill:var(--{})\" x=\"{a:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            escape(&line.tone),
            top + 3.0,
            (b - a).max(0.5),
            ROW - 6.0
        );
    }
    svg
}
