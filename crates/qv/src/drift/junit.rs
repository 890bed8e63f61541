//! Checks as JUnit XML: a suite for each recording, a case for each parameter of each effect.

use super::check::{Check, rows};
use qv_gap::drift::{Answer, Difference};
use std::fmt::Write;

/// The text of the file.
pub fn to_xml(checks: &[Check]) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"qv drift\">\n");
    for check in checks {
        let drift = &check.drift;
        let rows = rows(drift);
        let failures = rows.iter().filter(|row| row.changed).count();
        let is_skipped = |row: &&&Difference| !row.changed && drift.not_shown.contains(&row.effect);
        let skipped = rows.iter().filter(is_skipped).count() + usize::from(drift.answer == Answer::Inconclusive);
        let tests = rows.len() + 1;
        _ = writeln!(
            text,
            "  <testsuite name=\"{}\" tests=\"{tests}\" failures=\"{failures}\" errors=\"0\" skipped=\"{skipped}\">",
            escaped(&check.run)
        );
        let verdict = match drift.answer {
            Answer::Inconclusive => format!("<skipped message=\"{}\"/>", escaped(&drift.sentence)),
            _ => format!("<system-out>{}</system-out>", escaped(&drift.sentence)),
        };
        _ = writeln!(text, "    <testcase classname=\"drift\" name=\"recording\">{verdict}</testcase>");
        for row in &rows {
            let name = format!("{} {} ({})", row.effect, row.parameter, row.scope.join(", "));
            _ = write!(text, "    <testcase classname=\"drift.{}\" name=\"{}\">", escaped(&row.effect), escaped(&name));
            text += &case(row, is_skipped(&row));
            text += "</testcase>\n";
        }
        text += "  </testsuite>\n";
    }
    text + "</testsuites>\n"
}

fn case(row: &Difference, is_skipped: bool) -> String {
    let unit = if row.unit == "1" { String::new() } else { format!(" {}", row.unit) };
    let [low, high] = row.ci95;
    let values = format!(
        "then {}{unit}, now {}{unit}, difference {}{unit} (95 % CI {low} to {high}), p {:.2e} corrected for the number of tests",
        row.then, row.now, row.difference, row.p_corrected
    );
    match (row.changed, is_skipped) {
        (true, _) => {
            let kind = if row.matters { "changed beyond what robots of its kind differ by" } else { "changed" };
            format!("<failure type=\"changed\" message=\"{kind}\">{}</failure>", escaped(&values))
        }
        (_, true) => "<skipped message=\"this recording no longer shows it\"/>".into(),
        _ => format!("<system-out>{}</system-out>", escaped(&values)),
    }
}

/// Text as XML 1.0 takes it: of control characters only tab and line ends.
fn escaped(text: &str) -> String {
    let allowed = text.chars().filter(|c| !c.is_control() || matches!(c, '\t' | '\n' | '\r'));
    let plain: String = allowed.filter(|c| !matches!(c, '\u{fffe}' | '\u{ffff}')).collect();
    plain.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
