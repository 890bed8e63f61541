//! The history of a robot as a page: each parameter over days, and the last check as a table.

use super::check::{Check, p_value, rows};
use qv_gap::drift::{Answer, Difference};
use qv_page::parts::{self, Mood};
use qv_page::{Board, Choice, Look, Page, Panel, Table, escape, significant};

/// Nanoseconds of a day.
const DAY: f64 = 86_400e9;
/// What a board may hold: of every effect the part that shows it best.
type Key = (String, String, Vec<String>);

/// The page.
pub fn to_html(title: &str, checks: &[Check]) -> String {
    let last = checks.last();
    let head = last.map_or(String::new(), verdict);
    let table = last.map_or(String::new(), |check| parts::titled_card("Parameters", &parameters(check)));
    let body = head + &parts::titled_card("History", &history(checks)) + &boards(checks) + &table;
    Page { title, body: &body, ..Page::default() }.to_html()
}

fn name_of(answer: Answer) -> (&'static str, Mood) {
    match answer {
        Answer::Same => ("same", Mood::Good),
        Answer::Changed => ("changed", Mood::Bad),
        Answer::Inconclusive => ("inconclusive", Mood::Fair),
    }
}

fn verdict(check: &Check) -> String {
    let (badge, mood) = name_of(check.drift.answer);
    let text = format!("<p>{}</p><p class=\"soft\">{}</p>", escape(&check.drift.sentence), escape(&check.run));
    parts::verdict(mood, badge, &text)
}

fn history(checks: &[Check]) -> String {
    let mut table = Table::with_left(&["day", "recording", "answer", "what"], &[1, 2, 3]);
    for check in checks {
        let cells = [
            days(check, checks).map_or("-".into(), |d| significant(d, 3)),
            escape(&check.run),
            name_of(check.drift.answer).0.into(),
            escape(&check.drift.sentence),
        ];
        table.row(&cells);
    }
    table.to_html()
}

/// Days since the first recording whose date is known.
fn days(check: &Check, checks: &[Check]) -> Option<f64> {
    let first = checks.iter().map(|c| c.start_ns).filter(|ns| *ns > 0).min()?;
    (check.start_ns > 0).then(|| (check.start_ns - first) as f64 / DAY)
}

/// A choice of parameters with their values and intervals over days, or over recordings where dates are not known.
fn boards(checks: &[Check]) -> String {
    let mut keys: Vec<Key> = Vec::new();
    for row in checks.iter().rev().flat_map(|check| rows(&check.drift)) {
        let whole = (row.effect.clone(), row.parameter.clone());
        if row.changed || !keys.iter().any(|k| (&k.0, &k.1) == (&whole.0, &whole.1)) {
            let key = (whole.0, whole.1, row.scope.clone());
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
    }
    let is_dated = checks.iter().all(|check| check.start_ns > 0);
    let mut board = Board::new(if is_dated { "days since the first recording" } else { "recording" });
    let x: Vec<f64> = match is_dated {
        true => checks.iter().filter_map(|check| days(check, checks)).collect(),
        false => (0..checks.len()).map(|k| k as f64).collect(),
    };
    let at = board.column(&x, 1e-4);
    let mut options = Vec::new();
    for (k, key) in keys.iter().enumerate() {
        let of = |check: &Check| check.drift.parameters.iter().find(|p| is_of(p, key)).cloned();
        let found: Vec<Option<Difference>> = checks.iter().map(of).collect();
        let Some(unit) = found.iter().flatten().map(|p| p.unit.clone()).next() else { continue };
        options.push(format!("{} {} ({})", key.0, key.1, key.2.join(", ")));
        let mut panel = Panel { title: key.1.clone(), unit, when: vec![vec![k]], ..Panel::default() };
        let values = |value: &dyn Fn(&Difference) -> f64| -> Vec<f64> {
            found.iter().map(|p| p.as_ref().map_or(f64::NAN, value)).collect()
        };
        let [now, low, high] = [values(&|p| p.now), values(&|p| p.then + p.ci95[0]), values(&|p| p.then + p.ci95[1])];
        let then = values(&|p| p.then);
        for (name, tone, look, y) in [
            ("calibration", "floor", Look::Dashed, then),
            ("now", "accent", Look::Dots, now),
            ("95 % interval", "c3", Look::Plain, low),
            ("95 % interval", "c3", Look::Plain, high),
        ] {
            let largest = y.iter().filter(|v| v.is_finite()).fold(0.0f64, |m, v| m.max(v.abs()));
            let column = board.column(&y, (1e-4 * largest).max(1e-12));
            panel.lines.push(qv_page::Line::new(name, tone, at, column).looking(look));
        }
        board.panels.push(panel);
    }
    if board.panels.is_empty() {
        return String::new();
    }
    board.choices = vec![Choice { name: "parameter".into(), options, first: 0 }];
    board.to_card()
}

fn is_of(row: &Difference, key: &Key) -> bool {
    row.effect == key.0 && row.parameter == key.1 && row.scope == key.2
}

fn parameters(check: &Check) -> String {
    let heads = ["parameter", "on", "unit", "then", "now", "difference", "95 % interval", "p", "visible", "matters"];
    let mut table = Table::with_left(&heads, &[0, 1, 2]);
    for row in rows(&check.drift) {
        let of = |x: f64| significant(x, 3);
        let matters = if row.matters {
            "yes"
        } else if row.changed {
            "no"
        } else {
            ""
        };
        table.row(&[
            escape(&format!("{} {}", row.effect, row.parameter)),
            escape(&row.scope.join(", ")),
            escape(if row.unit == "1" { "" } else { &row.unit }),
            of(row.then),
            of(row.now),
            of(row.difference),
            format!("{} to {}", of(row.ci95[0]), of(row.ci95[1])),
            p_value(row.p_corrected),
            row.visible.map_or("-".into(), of),
            matters.into(),
        ]);
    }
    let note = "p is corrected for the number of parameters that are tested. Visible: size of a change that is found in 95 % of recordings like \
                this one. Matters: larger than what robots of one kind differ by.";
    format!("<p class=\"soft\">{note}</p>{}", table.to_html())
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_gap::drift::Drift;

    fn check(run: &str, now: f64, answer: Answer) -> Check {
        let row = |scope: &str, changed: bool| Difference {
            effect: "joint_coulomb_friction".into(),
            scope: vec![scope.into()],
            parameter: "torque".into(),
            unit: "N m".into(),
            then: 0.1,
            now,
            difference: now - 0.1,
            ci95: [now - 0.15, now - 0.05],
            p: if changed { 1e-6 } else { 0.4 },
            p_corrected: if changed { 1e-4 } else { 1.0 },
            visible: Some(0.08),
            tolerance: 0.0,
            changed,
            matters: changed,
        };
        let drift = Drift {
            answer,
            sentence: "Friction of FL_hip_joint rose by 0.2 N m.".into(),
            parameters: vec![row("FL_hip_joint", answer == Answer::Changed), row("FR_hip_joint", false)],
            tests: 40,
            alarm: 0.01,
            not_shown: vec!["backlash".into()],
            levels: [1.0, 1.4],
        };
        let start_ns = 1_700_000_000_000_000_000 + (now * DAY) as u64;
        Check { run: run.into(), sha256: Vec::new(), start_ns, lost: Vec::new(), drift }
    }

    #[test]
    fn a_browser_shows_the_page() {
        let checks = [check("monday.mcap", 0.1, Answer::Same), check("tuesday.mcap", 0.3, Answer::Changed)];
        let html = to_html("Drift of go2", &checks);
        assert!(html.contains("tuesday.mcap") && html.contains("changed"));
        crate::browser::check("drift", &html);
    }
}
