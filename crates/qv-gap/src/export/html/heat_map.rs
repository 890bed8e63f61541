//! Errors on joints by time, before and after, and how the gap is spread over time.

use super::words::{escape, fixed, percent};
use crate::report::{HeatMap, TimeShare};
use qv_page::parts::scroll;
use qv_page::picture::{Axis, legend, level, shortened, ticks, top};
use std::fmt::Write;

/// Columns of a map: narrower ones cannot be seen.
const COLUMNS: usize = 110;
const WIDTH: f64 = 500.0;
const LEFT: f64 = 112.0;
const ROW: f64 = 17.0;
const TIME: &str = "time [s]";

/// A column of the map: when, and which windows it shows.
struct Column {
    start: f64,
    end: f64,
    windows: std::ops::Range<usize>,
}

/// Before and after side by side in the same colours; empty without windows or joints.
pub(super) fn heat_map(map: &HeatMap) -> String {
    let (times, label) = axis_of(&map.times);
    let columns = columns(&times);
    if map.joints.is_empty() || columns.is_empty() {
        return String::new();
    }
    let all = map.before.iter().chain(&map.after).flatten().copied();
    let scale = top(all).max(1e-9);
    let mut text = String::from("<h3>Error of joint positions by joint and time</h3><div class=\"grid wide\">");
    for (name, values) in [("before", &map.before), ("after", &map.after)] {
        if !values.is_empty() {
            let _ = write!(
                text,
                "<div class=\"card\"><h3>{name}</h3>{}</div>",
                one(map, values, &columns, scale, [name, label])
            );
        }
    }
    let labels = [0.0, 0.5, 1.0].map(|share| fixed(1e3 * share * scale, 1));
    text + "</div>" + &legend("mrad, rms", labels)
}

/// Windows of several runs share no time: they are numbered, run after run.
fn axis_of(times: &[f64]) -> (Vec<f64>, &'static str) {
    if times.windows(2).any(|w| w[1] < w[0]) {
        ((0..times.len()).map(|k| k as f64).collect(), "window, run after run")
    } else {
        (times.to_vec(), TIME)
    }
}

/// Windows, several to a column when there are many. A column ends where the next begins, or after a usual length where
/// windows are missing.
fn columns(times: &[f64]) -> Vec<Column> {
    let known = times.iter().take_while(|t| t.is_finite()).count();
    let mut steps: Vec<f64> = times[..known].windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    let usual = steps.get(steps.len() / 2).copied().unwrap_or(1.0);
    let pooled = known.div_ceil(COLUMNS).max(1);
    let column = |first: usize| {
        let windows = first..(first + pooled).min(known);
        let last = times[windows.end - 1];
        let next = times[..known].get(windows.end).copied().unwrap_or(f64::INFINITY);
        let end = if next - last > 0.0 && next - last < 1.6 * usual { next } else { last + usual };
        Column { start: times[first], end, windows }
    };
    (0..known).step_by(pooled).map(column).collect()
}

fn one(map: &HeatMap, values: &[Vec<f64>], columns: &[Column], scale: f64, [name, label]: [&str; 2]) -> String {
    let bottom = ROW * map.joints.len() as f64;
    let height = bottom + 34.0;
    let first = columns[0].start;
    let last = columns.iter().map(|c| c.end).fold(first, f64::max);
    let xs = Axis { from: [first, last.max(first + 1e-9)], to: [LEFT, WIDTH - 4.0] };
    let mut svg = format!(
        "<svg class=\"half\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"error by joint and time, {name}\">\
         <rect class=\"hn\" x=\"{LEFT}\" y=\"0\" width=\"{:.1}\" height=\"{bottom}\"/>",
        WIDTH - 4.0 - LEFT
    );
    for (j, joint) in map.joints.iter().enumerate() {
        let y = ROW * j as f64;
        let _ = write!(
            svg,
            "<text class=\"label\" x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}<title>{}</title></text>",
            LEFT - 6.0,
            y + 12.5,
            escape(&shortened(joint, 17)),
            escape(joint)
        );
        let values = values.get(j).map_or(&[][..], Vec::as_slice);
        svg += &row((joint, values), columns, xs, y, scale);
    }
    for (t, label) in ticks(xs.from, 6.0) {
        let x = xs.at(t);
        let _ = write!(svg, "<path class=\"zero\" d=\"M{x:.1} {bottom}v4\"/>");
        let _ = write!(svg, "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>", bottom + 16.0);
    }
    let _ = write!(svg, "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{label}</text>", WIDTH - 4.0, bottom + 31.0);
    svg + "</svg>"
}

/// Columns beside each other in one colour.
struct Cell {
    class: String,
    from: f64,
    to: f64,
    errors: Vec<f64>,
}

/// Cells of a joint; neighbours of one colour are one rectangle.
fn row((joint, values): (&str, &[f64]), columns: &[Column], xs: Axis, y: f64, scale: f64) -> String {
    let mut cells: Vec<Cell> = Vec::new();
    for column in columns {
        let error = rms(values, column);
        let class = level(error / scale);
        match cells.last_mut() {
            Some(cell) if cell.class == class && cell.to >= column.start => {
                cell.to = column.end;
                cell.errors.push(error);
            }
            _ => cells.push(Cell { class, from: column.start, to: column.end, errors: vec![error] }),
        }
    }
    let rectangle = |cell: &Cell| {
        let (x, width) = (xs.at(cell.from), xs.at(cell.to) - xs.at(cell.from));
        let square = cell.errors.iter().map(|e| e * e).sum::<f64>() / cell.errors.len() as f64;
        let [from, to] = [cell.from, cell.to].map(|x| fixed(x, 1));
        format!(
            "<rect class=\"{}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{:.1}\"><title>{}, {from} to {to}: {} \
             mrad</title></rect>",
            cell.class,
            ROW - 1.0,
            escape(joint),
            fixed(1e3 * square.sqrt(), 1)
        )
    };
    cells.iter().map(rectangle).collect()
}

/// Of the windows of a column that are known.
fn rms(values: &[f64], column: &Column) -> f64 {
    let known = || column.windows.clone().filter_map(|w| values.get(w)).filter(|x| x.is_finite());
    let count = known().count();
    if count == 0 { f64::NAN } else { (known().map(|x| x * x).sum::<f64>() / count as f64).sqrt() }
}

/// Where a bar stands in the picture, and what it shows.
struct Bar {
    from: f64,
    to: f64,
    start: f64,
    end: f64,
    share: f64,
}

/// Shares of the gap over time as bars; empty without any.
pub(super) fn times(times: &[TimeShare]) -> String {
    let known = times.iter().filter(|t| t.start.is_finite() && t.end > t.start && t.end.is_finite());
    let mut known: Vec<TimeShare> = known.cloned().collect();
    let (starts, label) = axis_of(&known.iter().map(|t| t.start).collect::<Vec<_>>());
    let numbered = label != TIME;
    for (t, start) in known.iter_mut().zip(starts) {
        // A window that is numbered is one wide.
        (t.start, t.end) = (start, if numbered { start + 1.0 } else { t.end });
    }
    let largest = known.iter().map(|t| t.share).filter(|s| s.is_finite()).fold(0.0, f64::max);
    let (Some(first), true) = (known.first(), largest > 0.0) else { return String::new() };
    let last = known.iter().map(|t| t.end).fold(first.end, f64::max);
    let xs = Axis { from: [first.start, last], to: [44.0, 996.0] };
    let mut svg = String::from(
        "<svg class=\"long\" viewBox=\"0 0 1000 112\" role=\"img\" aria-label=\"share of the gap over time\">",
    );
    for share in [0.0, largest] {
        let y = 80.0 - 70.0 * share / largest;
        let _ = write!(svg, "<path class=\"axis\" d=\"M44 {y}H996\"/>");
        let label = fixed(100.0 * share, if largest < 0.1 { 1 } else { 0 });
        let _ = write!(svg, "<text x=\"38\" y=\"{}\" text-anchor=\"end\">{label}</text>", y + 4.0);
    }
    // One bar for what falls on the same place of the picture, as high as the highest there.
    let mut bars: Vec<Bar> = Vec::new();
    for t in known.iter().filter(|t| t.share.is_finite()) {
        let (from, to) = (xs.at(t.start), xs.at(t.end));
        match bars.last_mut() {
            Some(bar) if to - bar.from < 2.5 => {
                (bar.to, bar.end, bar.share) = (to, t.end, bar.share.max(t.share));
            }
            _ => bars.push(Bar { from, to, start: t.start, end: t.end, share: t.share }),
        }
    }
    for Bar { from, to, start, end, share } in bars {
        let height = 70.0 * share.max(0.0) / largest;
        let _ = write!(
            svg,
            "<rect class=\"bar\" x=\"{from:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\"><title>{} to {}: {}</title></rect>",
            80.0 - height,
            if to - from > 4.0 { to - from - 0.5 } else { to - from + 0.1 },
            fixed(start, 1),
            fixed(end, 1),
            percent(share)
        );
    }
    for (t, label) in ticks(xs.from, 10.0) {
        let _ = write!(svg, "<text x=\"{:.1}\" y=\"96\" text-anchor=\"middle\">{label}</text>", xs.at(t));
    }
    format!(
        "<div class=\"card\"><h3>Share of the error by window [%]</h3>{}</div>",
        scroll("shares over time", &format!("{svg}<text x=\"996\" y=\"110\" text-anchor=\"end\">{label}</text></svg>"))
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn many_windows_share_columns_and_gaps_stay_open() {
        let times: Vec<f64> = (0..1000).map(|k| 0.3 * f64::from(k)).collect();
        let found = columns(&times);
        assert!(found.len() <= COLUMNS && found.iter().map(|c| c.windows.len()).sum::<usize>() == 1000);
        let gap = columns(&[0.0, 0.3, 0.6, 5.0]);
        assert!((gap[2].end - 0.9).abs() < 1e-12 && (gap[3].end - 5.3).abs() < 1e-12);
        assert_eq!(columns(&[2.0])[0].end, 3.0);
        assert!(columns(&[]).is_empty() && columns(&[f64::NAN]).is_empty());
    }

    #[test]
    fn windows_of_several_runs_are_numbered() {
        assert_eq!(axis_of(&[0.0, 0.3, f64::NAN]).1, "time [s]");
        assert_eq!(axis_of(&[5.0, 9.0, 5.0]), (vec![0.0, 1.0, 2.0], "window, run after run"));
        let share = |start: f64| TimeShare { start, end: start + 0.3, share: 0.5 };
        assert!(times(&[share(0.0), share(4.0), share(0.0)]).states("after"));
    }

    #[test]
    fn cells_of_one_colour_are_one() {
        let found = columns(&[0.0, 1.0, 2.0, 3.0]);
        let xs = Axis { from: [0.0, 4.0], to: [0.0, 400.0] };
        let text = row(("a<b", &[1.0, 1.0, 0.1, f64::NAN]), &found, xs, 0.0, 1.0);
        assert_eq!(text.matches("<rect").count(), 3);
        assert!(text.contains("<title>a&lt;b, 0.0 to 2.0: 1000.0 mrad</title>") && text.states("mrad"), "{text}");
        assert!(text.states("class=\"h8\" x=\"0.0\" y=\"0.0\" width=\"200.0\"") && text.contains("hn"));
    }
}
