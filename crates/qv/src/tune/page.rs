//! `tune.html`: what the tuning found, on one page without network.

use qv_page::escape;
use qv_residual::close::{PathPair, Report};
use qv_residual::paths::{KINDS, Path, PathScore, place};
use std::fmt::Write;

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#222;background:#fff}\
table{border-collapse:collapse}td,th{padding:.25rem .6rem;text-align:right;border-bottom:1px solid #8884}td:first-child,th:first-child{text-align:left}\
.scroll{overflow-x:auto}.soft{opacity:.75}.verdict{border-left:6px solid #2a7;padding:.5rem 1rem;background:#2a71}.verdict.none{border-color:#888}\
.paths{display:flex;flex-wrap:wrap;gap:1rem}.paths figure{margin:0;flex:1 1 18rem}svg{width:100%;height:auto;background:#8881}\
.bar{display:inline-block;height:.7rem;vertical-align:middle}.a{background:#c63;stroke:#c63}.b{background:#27c;stroke:#27c}.c{stroke:#888}.d{stroke:#2a7}\
path{fill:none;stroke-width:2;vector-effect:non-scaling-stroke}path.c{stroke-dasharray:6 4}path.d{stroke-dasharray:2 3}\
@media (prefers-color-scheme:dark){body{color:#ddd;background:#181a1d}}";

/// The page.
pub fn page(report: &Report) -> String {
    let title = format!("Tuning of {}", escape(&report.robot));
    let class = if report.chosen.is_some() { "verdict" } else { "verdict none" };
    let mut text = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{title}</title><style>{STYLE}</style><h1>{title}</h1><div class=\"{class}\"><b>{}</b> {}</div>",
        headline(report),
        escape(&report.why)
    );
    _ = write!(text, "<p>{:.0} s of recordings were used.</p>", report.seconds);
    text += &list(&report.told);
    text += &candidates(report);
    text += &policies(report);
    text += &paths(&report.paths);
    text += &joints(report);
    text += &parameters(report);
    text + "</html>\n"
}

fn headline(report: &Report) -> String {
    match report.chosen {
        None => "The policy is as it was.".into(),
        Some(_) => {
            let less = 100.0 * (1.0 - report.after.position / report.before.position);
            format!("The robot is expected to stray {less:.0} % less.")
        }
    }
}

fn list(told: &[String]) -> String {
    let items: String = told.iter().map(|one| format!("<li>{}", escape(one))).collect();
    if items.is_empty() { items } else { format!("<ul class=\"soft\">{items}</ul>") }
}

fn candidates(report: &Report) -> String {
    let mut text = format!(
        "<h2>What the recordings show</h2><p>Each row is a simulator. It replays {} s of held-out recordings at a time, from the measured \
         state, under the recorded targets. A row stays when its joints are off by less than those of the last row that stayed, by {} \
         standard errors.</p><div class=\"scroll\"><table><tr><th>simulator<th>joints off by [mrad]<th>gain over the last that stayed [mrad]<th>stays\
         <th>policy trained on with it: distance from the commanded path [m]</tr>",
        report.settings.window, report.settings.errors
    );
    for (k, candidate) in report.candidates.iter().enumerate() {
        let held = &candidate.held_out;
        let gain =
            if k == 0 { "–".into() } else { format!("{:.2} ± {:.2}", 1e3 * held.gain[0], 1e3 * held.gain[1]) };
        let mark = if report.chosen == Some(k) { " (chosen)" } else { "" };
        _ = write!(
            text,
            "<tr><td>{}{mark}<td>{:.2} ± {:.2}<td>{gain}<td>{}<td>{}</tr>",
            escape(&candidate.compensation.kind),
            1e3 * held.error,
            1e3 * held.error_se,
            if held.stays { "yes" } else { "no" },
            candidate.paths.map_or("–".into(), distance)
        );
    }
    text + "</table></div>"
}

fn distance(score: PathScore) -> String {
    format!("{:.3} ± {:.3}", score.position, score.position_se)
}

fn policies(report: &Report) -> String {
    let mut text = String::from(
        "<h2>What the robot gains</h2><p>Policies walk in a simulator that was fitted to the held-out recordings alone; no training has seen \
         it, other walks than those by which the policy above was chosen. Distances are from the path that the commands describe, mean over 8 s; ± one standard error over walks. A robot that falls \
         counts as one that stays where it fell.</p><div class=\"scroll\"><table><tr><th>policy<th>distance [m]<th>heading [rad]<th>falls</tr>",
    );
    let mut row = |name: &str, score: &PathScore| {
        _ = write!(
            text,
            "<tr><td>{name}<td>{}<td>{:.3}<td>{} of {}</tr>",
            distance(*score),
            score.heading,
            score.fell,
            score.walks
        );
    };
    row("as it was", &report.before);
    if let Some(control) = &report.control {
        row("trained on as long in the simulator as it was (control)", control);
    }
    if report.chosen.is_some() {
        row("trained on under what was found", &report.after);
    }
    text + "</table></div>"
}

fn paths(pairs: &[PathPair]) -> String {
    if pairs.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "<h2>Paths from above</h2><p><span class=\"c\">- - -</span> grey: commanded. Green dots: what the simulator as it was promised. \
         Orange: the policy as it was. Blue: trained on. 8 s each; hover for the end.</p><div class=\"paths\">",
    );
    for (k, pair) in pairs.iter().enumerate() {
        text += &figure(KINDS[k % KINDS.len()].0, pair);
    }
    text + "</div>"
}

fn figure(name: &str, pair: &PathPair) -> String {
    let count = pair.before.len().max(pair.after.len()).max(2);
    // Decisions are evenly spread over the walk.
    let seconds = qv_residual::tune::SECONDS;
    let wanted: Path = (0..=count).map(|k| place(pair.command, seconds * k as f32 / count as f32)).collect();
    let all = [
        ("c", "commanded", &wanted),
        ("d", "promised", &pair.promised),
        ("a", "as it was", &pair.before),
        ("b", "trained on", &pair.after),
    ];
    let ends = |axis: usize| {
        let values = all.iter().flat_map(|(_, _, path)| path.iter().map(move |p| p[axis])).chain([0.0]);
        values.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
    };
    let ([x0, x1], [y0, y1]) = (ends(0), ends(1));
    let size = (x1 - x0).max(y1 - y0).max(0.5) * 1.1;
    let (cx, cy) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
    let mut svg = format!(
        "<svg viewBox=\"{} {} {size} {size}\" role=\"img\" aria-label=\"{}\">",
        cx - 0.5 * size,
        -cy - 0.5 * size,
        escape(name)
    );
    for (class, what, path) in all {
        let Some(last) = path.last() else { continue };
        let points: Vec<String> = path.iter().step_by(4).map(|p| format!("{:.3},{:.3}", p[0], -p[1])).collect();
        _ = write!(
            svg,
            "<path class=\"{class}\" d=\"M0,0 {}\"><title>{what}: ends at {:.2} m ahead, {:.2} m to the left</title></path>",
            points.iter().map(|p| format!("L{p}")).collect::<Vec<_>>().join(" "),
            last[0],
            last[1]
        );
    }
    let [vx, vy, wz] = pair.command;
    format!(
        "<figure>{svg}</svg><figcaption>{} ({vx:.2} m/s, {vy:.2} m/s, {wz:.2} rad/s); the side is {size:.1} m</figcaption></figure>",
        escape(name)
    )
}

fn joints(report: &Report) -> String {
    let (Some(first), Some(last)) =
        (report.candidates.first(), report.candidates.iter().rev().find(|c| c.held_out.stays))
    else {
        return String::new();
    };
    let most = first.held_out.joints.iter().copied().fold(1e-9, f64::max);
    let mut text = format!(
        "<h2>Each joint</h2><p>Mean size of the error on held-out recordings, in the simulator as it was and with {}.</p>\
         <div class=\"scroll\"><table><tr><th>joint<th>as it was [mrad]<th>corrected [mrad]<th></tr>",
        escape(&last.compensation.kind)
    );
    for ((name, before), after) in
        first.compensation.joints.iter().zip(&first.held_out.joints).zip(&last.held_out.joints)
    {
        let bar = |class: &str, x: f64| {
            format!("<span class=\"bar {class}\" style=\"width:{:.1}rem\"></span>", 12.0 * x / most)
        };
        _ = write!(
            text,
            "<tr><td>{}<td>{:.1}<td>{:.1}<td style=\"text-align:left\">{}<br>{}</tr>",
            escape(name),
            1e3 * before,
            1e3 * after,
            bar("a", *before),
            bar("b", *after)
        );
    }
    text + "</table></div>"
}

fn parameters(report: &Report) -> String {
    let Some(chosen) = report.chosen.map(|k| &report.candidates[k].compensation) else { return String::new() };
    let mut text = String::from(
        "<h2>What was corrected</h2><details><summary>parameters of the simulator, with the range within which robots differed in training\
         </summary><div class=\"scroll\"><table><tr><th>parameter<th>value<th>range</tr>",
    );
    for (name, x) in &chosen.parameters {
        let range = chosen.ranges.get(name).map_or("–".into(), |[low, high]| format!("{low:.4} to {high:.4}"));
        _ = write!(text, "<tr><td>{}<td>{x:.4}<td>{range}</tr>", escape(name));
    }
    text + "</table></div></details>"
}
