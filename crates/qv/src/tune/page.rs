//! `tune.html`: what the tuning found, on one page without network.

use qv_page::number::DASH;
use qv_page::parts::{self, Mood, card, grid, key, track};
use qv_page::{Page, Table, escape, fixed};
use qv_residual::close::{PathPair, Report};
use qv_residual::paths::{KINDS, Path, PathScore, place};
use std::fmt::Write;

/// What this page has beside the style of all pages.
const STYLE: &str = ".paths figure svg{background:var(--track);border-radius:6px}\
.paths path{fill:none;stroke-width:2;vector-effect:non-scaling-stroke}path.commanded{stroke:var(--floor);stroke-dasharray:6 4}\
path.promised{stroke:var(--good);stroke-dasharray:2 3}path.before{stroke:var(--before)}path.after{stroke:var(--after)}\
td .track{min-width:140px;margin:3px 0}";

/// The page.
pub fn page(report: &Report) -> String {
    let mood = if report.chosen.is_some() { Mood::Good } else { Mood::Plain };
    let said = format!("<b>{}</b> {}", headline(report), escape(&report.why));
    let body = [
        parts::verdict(mood, "", &said),
        format!("<p>{} s of recordings were used.</p>", fixed(report.seconds, 0)),
        parts::list(&report.remarks),
        candidates(report),
        policies(report),
        paths(&report.paths),
        joints(report),
        parameters(report),
    ];
    let title = format!("Tuning of {}", report.robot);
    Page { title: &title, style: STYLE, body: &body.concat(), ..Page::default() }.to_html()
}

fn headline(report: &Report) -> String {
    match report.chosen {
        None => "The policy is unchanged.".into(),
        Some(_) => {
            let less = 100.0 * (1.0 - report.after.position / report.before.position);
            format!("Expected reduction of the path-tracking error: {less:.0} %.")
        }
    }
}

fn candidates(report: &Report) -> String {
    let heads = [
        "simulator",
        "joints off by [mrad]",
        "gain over the last that stayed [mrad]",
        "stays",
        "policy fine-tuned with it: path-tracking error [m]",
    ];
    let mut table = Table::new(&heads);
    for (k, candidate) in report.candidates.iter().enumerate() {
        let held = &candidate.held_out;
        let gain = if k == 0 { DASH.into() } else { plus_minus(1e3 * held.gain[0], 1e3 * held.gain[1], 2) };
        let mark = if report.chosen == Some(k) { " (chosen)" } else { "" };
        table.row(&[
            format!("{}{mark}", escape(&candidate.compensation.kind)),
            plus_minus(1e3 * held.error, 1e3 * held.error_se, 2),
            gain,
            if held.stays { "yes" } else { "no" }.into(),
            candidate.paths.map_or(DASH.into(), distance),
        ]);
    }
    format!(
        "<h2>What the recordings show</h2><p>Each row is a simulator. It replays {} s of held-out recordings at a time, from the measured \
         state, under the recorded targets. A row stays when its joints are off by less than those of the last row that stayed, by {} \
         standard errors.</p>{}",
        report.settings.window,
        report.settings.errors,
        card(&table.to_html())
    )
}

fn plus_minus(value: f64, error: f64, decimals: usize) -> String {
    format!("{} ± {}", fixed(value, decimals), fixed(error, decimals))
}

fn distance(score: PathScore) -> String {
    plus_minus(score.position.into(), score.position_se.into(), 3)
}

fn policies(report: &Report) -> String {
    let mut table = Table::new(&["policy", "distance [m]", "heading [rad]", "falls"]);
    let mut row = |name: &str, score: &PathScore| {
        let falls = format!("{} of {}", score.fell, score.walks);
        table.row(&[name.to_string(), distance(*score), fixed(score.heading.into(), 3), falls]);
    };
    row("as it was", &report.before);
    if let Some(control) = &report.control {
        row("fine-tuned as long in the uncorrected simulator (control)", control);
    }
    if report.chosen.is_some() {
        row("fine-tuned with what was found", &report.after);
    }
    format!(
        "<h2>What the robot gains</h2><p>Policies walk in a simulator that was fitted to the held-out recordings alone; no training has seen \
         it, other walks than those by which the policy above was chosen. Distances are from the path that the commands describe, mean over 8 s; ± one standard error over walks. A robot that falls \
         counts as one that stays where it fell.</p>{}",
        card(&table.to_html())
    )
}

fn paths(pairs: &[PathPair]) -> String {
    if pairs.is_empty() {
        return String::new();
    }
    let figures: String =
        pairs.iter().enumerate().map(|(k, pair)| card(&figure(KINDS[k % KINDS.len()].0, pair))).collect();
    let keys = [("floor", "commanded (dashed)"), ("good", "promised by the simulator as it was (dots)")];
    let keys: String = keys
        .into_iter()
        .chain([("before", "the policy as it was"), ("after", "fine-tuned")])
        .map(|(t, n)| key(t, n))
        .collect();
    format!(
        "<h2>Paths from above</h2><p class=\"soft\">{keys}. 8 s each; hover for the end.</p><div class=\"paths\">{}</div>",
        grid(280, &figures)
    )
}

fn figure(name: &str, pair: &PathPair) -> String {
    let count = pair.before.len().max(pair.after.len()).max(2);
    // Decisions are evenly spread over the walk.
    let seconds = qv_residual::paths::SECONDS;
    let wanted: Path = (0..=count).map(|k| place(pair.command, seconds * k as f32 / count as f32)).collect();
    let all = [
        ("commanded", "commanded", &wanted),
        ("promised", "promised", &pair.promised),
        ("before", "as it was", &pair.before),
        ("after", "fine-tuned", &pair.after),
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
    let mut table = Table::with_left(&["joint", "as it was [mrad]", "corrected [mrad]", ""], &[3]);
    for ((name, before), after) in
        first.compensation.joints.iter().zip(&first.held_out.joints).zip(&last.held_out.joints)
    {
        table.row(&[
            escape(name),
            fixed(1e3 * before, 1),
            fixed(1e3 * after, 1),
            track(before / most, "before") + &track(after / most, "after"),
        ]);
    }
    format!(
        "<h2>Each joint</h2><p>Mean size of the error on held-out recordings, in the simulator as it was and with {}.</p>{}",
        escape(&last.compensation.kind),
        card(&table.to_html())
    )
}

fn parameters(report: &Report) -> String {
    let Some(chosen) = report.chosen.map(|k| &report.candidates[k].compensation) else { return String::new() };
    let mut table = Table::new(&["parameter", "value", "range"]);
    for (name, x) in &chosen.parameters {
        let range = chosen
            .ranges
            .get(name)
            .map_or(DASH.into(), |[low, high]| format!("{} to {}", fixed(*low, 4), fixed(*high, 4)));
        table.row(&[escape(name), fixed(*x, 4), range]);
    }
    format!(
        "<h2>What was corrected</h2>{}",
        card(&format!(
            "<details><summary>parameters of the simulator, with the range within which robots differed in training</summary>{}</details>",
            table.to_html()
        ))
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use qv_residual::close::{Candidate, HeldOut};
    use qv_residual::compensation::Compensation;

    fn made_up(nasty: &str) -> Report {
        let score = |position: f32| PathScore { walks: 64, position, position_se: 0.01, heading: 0.1, fell: 2 };
        let candidate = |kind: &str, error: f64| Candidate {
            compensation: Compensation {
                joints: vec![nasty.into(), "knee".into()],
                kind: kind.into(),
                parameters: [(format!("joint.{nasty}.armature"), 0.01)].into(),
                ..Compensation::default()
            },
            held_out: HeldOut {
                error,
                error_se: 0.001,
                joints: vec![error, f64::NAN],
                gain: [0.002, 0.001],
                stays: true,
            },
            paths: Some(score(error as f32)),
        };
        let path = |turn: f32| (1..200).map(|k| place([0.5, 0.0, turn], 0.04 * k as f32)).collect();
        Report {
            robot: nasty.into(),
            seconds: 600.0,
            remarks: vec![nasty.into()],
            candidates: vec![candidate("as it was", 0.02), candidate(nasty, 0.01)],
            calibrated: 0,
            chosen: Some(1),
            why: "It has the least path error.".into(),
            before: score(0.4),
            after: score(0.2),
            control: Some(score(0.39)),
            paths: vec![PathPair {
                command: [0.5, 0.0, 0.2],
                before: path(0.1),
                after: path(0.19),
                promised: path(0.2),
            }],
            settings: Default::default(),
        }
    }

    #[test]
    fn a_browser_shows_the_page() {
        crate::browser::check("tune", &page(&made_up("go2")));
    }

    #[test]
    fn candidates_policies_paths_and_joints_are_told_and_no_name_breaks_the_page() {
        let nasty = "</style><script>alert(\"1\" & '2')</script>";
        let text = page(&made_up(nasty));
        for part in [
            "path-tracking error: 50 %",
            "20.00 ± 1.00",
            "0.200 ± 0.010",
            "2 of 64",
            "(chosen)",
            "fine-tuned: ends at",
            "0.0100",
        ] {
            assert!(text.contains(part), "{part}");
        }
        for never in ["<script", "NaN", "inf", "http:", "https:", "src=", "url("] {
            assert!(!text.contains(never), "{never}");
        }
        for tag in ["div", "table", "tr", "td", "th", "svg", "h2", "p", "figure", "details"] {
            let opened = text.matches(&format!("<{tag}>")).count() + text.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, text.matches(&format!("</{tag}>")).count(), "{tag}");
        }
        let mut kept = made_up("go2");
        (kept.chosen, kept.paths) = (None, vec![]);
        let text = page(&kept);
        assert!(text.states("policy") && !text.contains("Paths from above"));
        assert!(!text.contains("What was corrected"));
    }
}
