//! `contact.html`: one file with its pictures inside, no script and no network, light or dark as the reader's screen is.

use crate::ground::Ground;
use crate::report::{Region, Report, Status};
use qv_core::label_colour;
use qv_page::escape;
use std::fmt::Write;

const STYLE: &str = ":root{color-scheme:light dark;--ink:#1d2329;--soft:#5d6872;--line:#d8dee4;--card:#fff;--page:#f4f6f8;\
--prior:#8a94a0;--post:#0b6bcb;--grid:#c2571a;--slip:#c9184a}@media(prefers-color-scheme:dark){:root{--ink:#e6ebf0;\
--soft:#9aa6b2;--line:#333c46;--card:#1b2127;--page:#12161a;--prior:#7d8894;--post:#5aa9f5;--grid:#f0955a;--slip:#ff6f91}}\
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--page);max-width:1080px;margin:2rem auto;\
padding:0 1rem}h1{font-size:1.5rem;overflow-wrap:anywhere}h2{font-size:1.15rem;margin-top:2rem}.card{background:var(--card);border:1px solid \
var(--line);border-radius:10px;padding:1rem;margin:.6rem 0}.grid{display:grid;gap:.8rem;grid-template-columns:repeat(\
auto-fit,minmax(320px,1fr))}.grid .card{margin:0}.soft{color:var(--soft)}.small{font-size:.85rem}table{border-collapse:\
collapse;width:100%}td,th{text-align:right;padding:.25rem .5rem;border-bottom:1px solid var(--line);font-variant-numeric:\
tabular-nums}td:first-child,th:first-child{text-align:left}svg{width:100%;height:auto;display:block}svg text{fill:\
var(--soft);font-size:11px;font-family:inherit}.dot{display:inline-block;width:.8em;height:.8em;border-radius:2px;\
margin-right:.4em}.scroll{overflow-x:auto}";

fn colour(label: usize) -> String {
    let [r, g, b] = label_colour(label);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The page. `title` names the recordings; `lost` is what of them could not be used.
pub fn to_html(report: &Report, ground: &Ground, title: &str, lost: &[String]) -> String {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width,initial-scale=1\"><title>Friction from {0}</title><style>{STYLE}</style>\
         <h1>Friction of the ground from <b>{0}</b></h1>",
        escape(title)
    );
    for note in lost {
        let _ = write!(page, "<p class=\"soft\">{}</p>", escape(note));
    }
    page += &table(report);
    page += "<h2>Error of the base in open-loop replay</h2>";
    page += &base_error(report);
    page += "<h2>What the recording says of each material</h2><div class=\"grid\">";
    for (k, region) in report.regions.iter().enumerate() {
        page += &card(k, region);
    }
    page += "</div><h2>Where the robot walked and slipped</h2>";
    page += &plan(report, ground);
    if !report.notes.is_empty() {
        page += "<h2>What to know</h2><div class=\"card\"><ul>";
        report.notes.iter().for_each(|n| page += &format!("<li>{}</li>", escape(n)));
        page += "</ul></div>";
    }
    let w = &report.windows;
    let _ = writeln!(
        page,
        "<p class=\"soft small\">{} windows of {} s, {} of them for what is usual; {:.1} s.</p></html>",
        w.count, w.length, w.background, report.runtime_s
    );
    page
}

fn table(report: &Report) -> String {
    let mut text = String::from(
        "<div class=\"card scroll\"><table><tr><th>material</th><th>prior</th><th>friction</th><th>90 % interval</th>\
         <th>grid search</th><th>feet on it</th><th>slipping</th><th>evidence</th><th></th></tr>",
    );
    for (k, r) in report.regions.iter().enumerate() {
        let [low, high] = r.used().interval90;
        let _ = write!(
            text,
            "<tr><td><span class=\"dot\" style=\"background:{}\"></span>{}</td><td>{:.2}</td><td><b>{:.3}</b></td>\
             <td>{low:.3} to {high:.3}</td><td>{}</td><td>{:.1} s</td><td>{:.0} %</td><td>{:.1}</td><td>{}</td></tr>",
            colour(k),
            escape(&r.label),
            r.prior.mean,
            r.friction,
            r.grid.as_ref().map_or("-".into(), |g| format!("{:.3}", g.friction)),
            r.contact_time,
            100.0 * r.slip_share,
            r.evidence,
            r.status.words()
        );
    }
    text + "</table><p class=\"soft small\">Evidence: log likelihood of the friction over that of the prior's mean, \
            weighted as the posterior weighs it. Feet on it: summed over feet.</p></div>"
}

fn base_error(report: &Report) -> String {
    let base = &report.base_error;
    let (what, Some(e)) = (match base.held_out {
        Some(e) => ("segments that no fit has seen", Some(e)),
        None => ("segments, none held out", base.all),
    }) else {
        return "<div class=\"card\">The recording is too short for a segment.</div>".into();
    };
    let uniform = format!("{} everywhere", base.uniform_friction);
    let rows = [
        (uniform.as_str(), e.uniform, "var(--prior)"),
        ("prior", e.prior, "var(--prior)"),
        ("grid search", e.grid, "var(--grid)"),
        ("posterior", e.posterior, "var(--post)"),
    ];
    let most = rows.iter().map(|r| r.1).fold(1e-9, f64::max);
    let mut svg = String::from("<svg viewBox=\"0 0 640 118\" role=\"img\" aria-label=\"mean error of the base\">");
    for (k, (name, error, fill)) in rows.iter().enumerate() {
        let (y, width) = (6 + 28 * k, 440.0 * error / most);
        let _ = write!(
            svg,
            "<text x=\"104\" y=\"{}\" text-anchor=\"end\">{name}</text><rect x=\"112\" y=\"{y}\" width=\"{width:.1}\" \
             height=\"20\" rx=\"3\" fill=\"{fill}\"/><text x=\"{:.1}\" y=\"{}\">{:.1} mm</text>",
            y + 14,
            120.0 + width,
            y + 14,
            1e3 * error
        );
    }
    format!(
        "<div class=\"card\">{svg}</svg><p class=\"soft small\">Mean distance between simulated and measured base over \
         {} s from a measured state, mean of {} {what}.{}</p></div>",
        base.segment,
        e.segments,
        unsearched(report)
    )
}

/// Which labels the grid search left at their priors.
fn unsearched(report: &Report) -> String {
    let left: Vec<String> = report.regions.iter().filter(|r| r.grid.is_none()).map(|r| escape(&r.label)).collect();
    if left.is_empty() { String::new() } else { format!(" The grid search left {} at the prior.", left.join(", ")) }
}

/// A plot's frame in pixels, with logarithmic friction along x.
const LEFT: f64 = 10.0;
const RIGHT: f64 = 390.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 130.0;

fn x_of(friction: f64) -> f64 {
    let [low, high] = crate::RANGE;
    LEFT + (RIGHT - LEFT) * ((friction / low).ln() / (high / low).ln()).clamp(0.0, 1.0)
}

fn card(k: usize, r: &Region) -> String {
    let curve = |values: &[f64]| {
        let point =
            |(mu, v): (&f64, &f64)| format!("{:.1},{:.1}", x_of(*mu), BOTTOM - (BOTTOM - TOP) * v.clamp(0.0, 1.0));
        r.curves.friction.iter().zip(values).map(point).collect::<Vec<_>>().join(" ")
    };
    let mut svg = format!(
        "<svg viewBox=\"0 0 400 150\" role=\"img\" aria-label=\"prior and posterior of {}\">\
         <line x1=\"{LEFT}\" x2=\"{RIGHT}\" y1=\"{BOTTOM}\" y2=\"{BOTTOM}\" stroke=\"var(--line)\"/>",
        escape(&r.label)
    );
    for tick in [0.05, 0.1, 0.2, 0.4, 0.8] {
        let x = x_of(tick);
        let _ = write!(
            svg,
            "<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{BOTTOM}\" y2=\"{:.1}\" stroke=\"var(--line)\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{tick}</text>",
            BOTTOM + 4.0,
            BOTTOM + 16.0
        );
    }
    if let Some(grid) = &r.grid {
        let most = grid.curve.iter().map(|c| c[1]).fold(1e-12, f64::max);
        let points: Vec<String> = grid
            .curve
            .iter()
            .map(|[mu, d]| format!("{:.1},{:.1}", x_of(*mu), BOTTOM - 0.9 * (BOTTOM - TOP) * d / most))
            .collect();
        let _ = write!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"var(--grid)\" stroke-width=\"1.5\" stroke-dasharray=\"4 3\"/>",
            points.join(" ")
        );
    }
    let _ = write!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"var(--prior)\" stroke-width=\"2\"/>",
        curve(&r.curves.prior)
    );
    if matches!(r.status, Status::Refined | Status::Grips) {
        let [low, high] = r.posterior.interval90.map(x_of);
        let _ = write!(
            svg,
            "<rect x=\"{low:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"var(--post)\" opacity=\"0.15\"/>\
             <polyline points=\"{}\" fill=\"none\" stroke=\"var(--post)\" stroke-width=\"2\"/>",
            high - low,
            BOTTOM - TOP,
            curve(&r.curves.posterior)
        );
    }
    let search = r.grid.as_ref().map_or(String::new(), |g| {
        let least = g.curve.iter().map(|c| c[1]).fold(f64::INFINITY, f64::min);
        let most = g.curve.iter().map(|c| c[1]).fold(0.0, f64::max);
        format!(
            " <span style=\"color:var(--grid)\">grid search</span> (base {:.0} to {:.0} mm).",
            1e3 * least,
            1e3 * most
        )
    });
    format!(
        "<div class=\"card\"><b><span class=\"dot\" style=\"background:{}\"></span>{}</b>: {:.3}, {}{}</svg>\
         <p class=\"soft small\"><span style=\"color:var(--prior)\">prior</span> {:.2} &plusmn; {:.2} ({}), \
         <span style=\"color:var(--post)\">posterior</span>, 90 % interval shaded.{search} {} windows; {:.1} nats of \
         information; a tenth more friction moves a window by {:.2} of its usual deviation.</p></div>",
        colour(k),
        escape(&r.label),
        r.friction,
        r.status.words(),
        svg,
        r.prior.mean,
        r.prior.sd,
        escape(&r.prior.source),
        r.windows,
        r.information,
        r.sensitivity[1]
    )
}

/// Squares along the longer side of the floor plan.
const SQUARES: f64 = 160.0;

fn plan(report: &Report, ground: &Ground) -> String {
    let places = || report.path.iter().map(|p| p.at).chain(report.slips.iter().map(|s| s.at));
    let bound = |axis: usize, start: f64, pick: fn(f64, f64) -> f64| places().map(|p| p[axis]).fold(start, pick);
    let (x0, x1) = (bound(0, f64::INFINITY, f64::min) - 0.4, bound(0, f64::NEG_INFINITY, f64::max) + 0.4);
    let (y0, y1) = (bound(1, f64::INFINITY, f64::min) - 0.4, bound(1, f64::NEG_INFINITY, f64::max) + 0.4);
    if !(x1 > x0 && y1 > y0) {
        return "<div class=\"card\">No path was measured.</div>".into();
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
            "<polyline points=\"{}\" fill=\"none\" stroke=\"var(--ink)\" stroke-width=\"2\"/>",
            points.join(" ")
        );
        if let Some(p) = report.path.iter().find(|p| p.run == run) {
            let (x, y) = at(p.at);
            let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6\" fill=\"var(--ink)\"/>");
        }
    }
    for slip in &report.slips {
        let (x, y) = at(slip.at);
        let r = (1.0 + 100.0 * slip.distance).min(5.0);
        let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r:.1}\" fill=\"var(--slip)\" opacity=\"0.45\"/>");
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
    let mut legend = String::new();
    for (k, r) in report.regions.iter().enumerate() {
        let _ = write!(
            legend,
            "<span class=\"dot\" style=\"background:{}\"></span>{} {:.2} &nbsp; ",
            colour(k),
            escape(&r.label),
            r.friction
        );
    }
    format!(
        "<div class=\"card\">{svg}<p class=\"small\">{legend}<span class=\"dot\" style=\"background:var(--slip)\"></span>\
         a foot that stood slipped (larger: farther) &nbsp; line: path of the base from the dot</p></div>"
    )
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
