//! `contact.html`: one file with its pictures and plots inside, no network, light or dark as the reader's screen is.

use crate::ground::Ground;
use crate::report::{Region, Report, Status};
use qv_core::label_colour;
use qv_page::number::DASH;
use qv_page::parts::{self, Bars, card, grid, key, track};
use qv_page::{Band, Board, Line, Look, Page, Panel, Table, escape, fixed, percent};
use std::fmt::Write;

/// What this page has beside the style of all pages.
const STYLE: &str =
    ":root{--prior:#8a94a0;--slip:#c9184a}@media(prefers-color-scheme:dark){:root{--prior:#7d8894;--slip:#ff6f91}}";

fn colour(label: usize) -> String {
    let [r, g, b] = label_colour(label);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The page. `title` names the recordings; `lost` is what of them could not be used.
pub fn to_html(report: &Report, ground: &Ground, title: &str, lost: &[String]) -> String {
    let notes = if report.notes.is_empty() {
        String::new()
    } else {
        format!("<h2>What to know</h2>{}", card(&parts::list(&report.notes)))
    };
    let regions: String = report.regions.iter().enumerate().map(|(k, region)| of_region(k, region)).collect();
    let w = &report.windows;
    let body = [
        parts::notes(lost),
        table(report),
        "<h2>Error of the base in open-loop replay</h2>".into(),
        base_error(report),
        "<h2>What the recording says of each material</h2>".into(),
        grid(420, &regions),
        "<h2>Where the robot walked and slipped</h2>".into(),
        plan(report, ground),
        notes,
        format!(
            "<p class=\"soft small\">{} windows of {} s, {} of them for what is usual.</p>",
            w.count, w.length, w.background
        ),
    ];
    let (title, heading) = (format!("Friction from {title}"), format!("Friction of the ground from {}", escape(title)));
    Page { title: &title, heading: &heading, style: STYLE, body: &body.concat(), ..Page::default() }.to_html()
}

/// A label's colour before its name.
fn labelled(k: usize, name: &str) -> String {
    format!("<span class=\"swatch\" style=\"background:{}\"></span>{}", colour(k), escape(name))
}

fn table(report: &Report) -> String {
    let heads = [
        "material",
        "prior",
        "friction",
        "90 % interval",
        "grid search",
        "feet on it",
        "slipping",
        "evidence",
        "status",
    ];
    let mut table = Table::new(&heads);
    for (k, r) in report.regions.iter().enumerate() {
        let [low, high] = r.posterior.interval90.map(|x| fixed(x, 3));
        // A prior that is kept was not measured.
        let interval = if r.status == Status::Refined { format!("{low} to {high}") } else { DASH.into() };
        table.row(&[
            labelled(k, &r.label),
            fixed(r.prior.mean, 2),
            format!("<b>{}</b>", fixed(r.friction, 3)),
            interval,
            fixed(r.grid.as_ref().map_or(f64::NAN, |g| g.friction), 3),
            format!("{} s", fixed(r.contact_time, 1)),
            percent(r.slip_share),
            fixed(r.evidence, 1),
            r.status.words().into(),
        ]);
    }
    card(&format!(
        "{}<p class=\"soft small\">Evidence: log likelihood of the friction over that of the prior's mean, weighted as the posterior \
         weighs it. Feet on it: summed over feet.</p>",
        table.to_html()
    ))
}

fn base_error(report: &Report) -> String {
    let base = &report.base_error;
    let (what, Some(e)) = (match base.held_out {
        Some(e) => ("segments that no fit has seen", Some(e)),
        None => ("segments, none held out", base.all),
    }) else {
        return card("The recording is too short for a segment.");
    };
    let uniform = format!("{} everywhere", base.uniform_friction);
    let rows = [
        (uniform.as_str(), e.uniform, "prior"),
        ("prior", e.prior, "prior"),
        ("grid search", e.grid, "before"),
        ("posterior", e.posterior, "after"),
    ];
    let most = rows.iter().map(|r| r.1).fold(1e-9, f64::max);
    let mut bars = Bars::new();
    rows.iter().for_each(|(name, error, tone)| {
        bars.row(&escape(name), &track(error / most, tone), &format!("{} mm", fixed(1e3 * error, 1)));
    });
    card(&format!(
        "{}<p class=\"soft small\">Mean distance between simulated and measured base over {} s from a measured state, mean of {} {what}.{}</p>",
        bars.to_html(),
        base.segment,
        e.segments,
        unsearched(report)
    ))
}

/// Which labels the grid search left at their priors.
fn unsearched(report: &Report) -> String {
    let left: Vec<String> = report.regions.iter().filter(|r| r.grid.is_none()).map(|r| escape(&r.label)).collect();
    if left.is_empty() { String::new() } else { format!(" The grid search left {} at the prior.", left.join(", ")) }
}

/// Probability by friction before and after, and what the grid search found.
fn of_region(k: usize, r: &Region) -> String {
    let mut board = Board::new("friction");
    (board.link, board.log) = ("friction".into(), true);
    let friction = board.column(&r.curves.friction, 1e-5);
    let mut line = |name: &str, tone: &str, values: &[f64]| Line::new(name, tone, friction, board.column(values, 1e-4));
    let mut lines = vec![line("prior", "prior", &r.curves.prior)];
    let (mut bands, mut shaded) = (Vec::new(), "");
    if matches!(r.status, Status::Refined | Status::Grips) {
        lines.push(line("posterior", "after", &r.curves.posterior));
        bands.push(Band { x: r.posterior.interval90, tone: "after".into() });
        shaded = "; the 90 % interval of the posterior is shaded";
    }
    let title = "probability, relative to the greatest".into();
    board.panels.push(Panel { title, lines, bands, zero: true, ..Panel::default() });
    if let Some(grid) = &r.grid {
        let [at, off] = [0, 1].map(|k| grid.curve.iter().map(|c| c[k]).collect::<Vec<f64>>());
        let (at, off) = (board.column(&at, 1e-5), board.column(&off, 1e-5));
        let line = Line::new("grid search", "before", at, off).looking(Look::Dots).times(1e3);
        let title = "error of the base".into();
        board.panels.push(Panel { title, unit: "mm".into(), lines: vec![line], ..Panel::default() });
    }
    card(&format!(
        "<p><b>{}</b>: {}, {}</p>{}<p class=\"soft small\">Prior {} ± {} ({}){shaded}. {} windows; {} \
         nats of information; a tenth more friction moves a window by {} of its usual deviation.</p>",
        labelled(k, &r.label),
        fixed(r.friction, 3),
        r.status.words(),
        board.to_html(),
        fixed(r.prior.mean, 2),
        fixed(r.prior.sd, 2),
        escape(&r.prior.source),
        r.windows,
        fixed(r.information, 1),
        fixed(r.sensitivity[1], 2)
    ))
}

/// Squares along the longer side of the floor plan.
const SQUARES: f64 = 160.0;

fn plan(report: &Report, ground: &Ground) -> String {
    let places = || report.path.iter().map(|p| p.at).chain(report.slips.iter().map(|s| s.at));
    let bound = |axis: usize, start: f64, pick: fn(f64, f64) -> f64| places().map(|p| p[axis]).fold(start, pick);
    let (x0, x1) = (bound(0, f64::INFINITY, f64::min) - 0.4, bound(0, f64::NEG_INFINITY, f64::max) + 0.4);
    let (y0, y1) = (bound(1, f64::INFINITY, f64::min) - 0.4, bound(1, f64::NEG_INFINITY, f64::max) + 0.4);
    if !(x1 > x0 && y1 > y0) {
        return card("No path was measured.");
    }
    let scale = 900.0 / (x1 - x0).max(y1 - y0);
    let at = |p: [f64; 2]| (scale * (p[0] - x0), scale * (y1 - p[1]));
    let mut svg = format!(
        "<svg viewBox=\"0 0 {:.0} {:.0}\" role=\"img\" aria-label=\"floor plan\">",
        scale * (x1 - x0),
        scale * (y1 - y0)
    );
    svg += &floor(ground, [x0, x1, y0, y1], scale);
    for run in 0..=report.path.iter().map(|p| p.run).max().unwrap_or(0) {
        let points: Vec<String> = report
            .path
            .iter()
            .filter(|p| p.run == run)
            .map(|p| format!("{:.1},{:.1}", at(p.at).0, at(p.at).1))
            .collect();
        let _ = write!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"var(--ink)\" stroke-width=\"2\"><title>path of the base, run {}</title></polyline>",
            points.join(" "),
            run + 1
        );
        if let Some(p) = report.path.iter().find(|p| p.run == run) {
            let (x, y) = at(p.at);
            let start = format!("start of run {}", run + 1);
            let _ = write!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6\" fill=\"var(--ink)\"><title>{start}</title></circle>"
            );
        }
    }
    for slip in &report.slips {
        let (x, y) = at(slip.at);
        let r = (1.0 + 100.0 * slip.distance).min(5.0);
        let _ = write!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r:.1}\" fill=\"var(--slip)\" opacity=\"0.45\"><title>slipped {} mm</title></circle>",
            fixed(1e3 * slip.distance, 0)
        );
    }
    // A bar of half a metre.
    let y = scale * (y1 - y0) - 12.0;
    let _ = write!(
        svg,
        "<line x1=\"12\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"var(--ink)\" stroke-width=\"3\"/>\
         <text x=\"12\" y=\"{:.1}\">0.5 m</text></svg>",
        12.0 + 0.5 * scale,
        y - 6.0
    );
    let label = |(k, r): (usize, &Region)| format!("{} {} &nbsp; ", labelled(k, &r.label), fixed(r.friction, 2));
    let legend: String = report.regions.iter().enumerate().map(label).collect();
    card(&format!(
        "{svg}<p class=\"small\">{legend}{} (larger: farther) &nbsp; line: path of the base from the dot</p>",
        key("slip", "a foot that stood slipped")
    ))
}

/// The labels seen from above, as runs of equal squares in a row.
fn floor(ground: &Ground, [x0, x1, y0, y1]: [f64; 4], scale: f64) -> String {
    let side = (x1 - x0).max(y1 - y0) / SQUARES;
    let (columns, rows) = (((x1 - x0) / side).ceil() as usize, ((y1 - y0) / side).ceil() as usize);
    let mut svg = String::from("<g opacity=\"0.45\">");
    for row in 0..rows {
        let y = y1 - (row as f64 + 0.5) * side;
        let label = |c: usize| {
            ground.below(glam::DVec3::new(x0 + (c as f64 + 0.5) * side, y, f64::INFINITY)).map(|(label, _)| label)
        };
        let mut from = 0;
        while from < columns {
            let here = label(from);
            let mut to = from + 1;
            while to < columns && label(to) == here {
                to += 1;
            }
            if let Some(here) = here {
                let _ = write!(
                    svg,
                    "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
                    scale * side * from as f64,
                    scale * side * row as f64,
                    scale * side * (to - from) as f64 + 0.6,
                    // A little over the next row, so that no gap shines through.
                    scale * side + 0.6,
                    colour(here)
                );
            }
            from = to;
        }
    }
    svg + "</g>"
}
