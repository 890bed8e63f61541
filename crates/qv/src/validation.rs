//! What the corrections of a diagnosis close in another recording of the same robot, beside what the report states.

use qv_gap::report::Gap;
use qv_page::{Table, percent, significant};

/// One sentence.
pub fn sentence(stated: &Gap, other: &Gap) -> String {
    format!(
        "Other recordings: the corrections remove {} of the error ({} to {}), {} in held-out windows of these; {} -> {}, noise floor {}.",
        percent(other.closed),
        percent(other.closed_ci95[0]),
        percent(other.closed_ci95[1]),
        percent(stated.closed),
        significant(other.before, 3),
        significant(other.after, 3),
        significant(other.floor, 3),
    )
}

/// A section of the report's page.
pub fn section(stated: &Gap, other: &Gap) -> String {
    let mut table =
        Table::new(&["recordings", "normalized error before", "after", "noise floor", "removed", "95 % interval"]);
    for (name, gap) in [("these, held-out windows", stated), ("others, all windows", other)] {
        let [low, high] = gap.closed_ci95.map(percent);
        let numbers = [gap.before, gap.after, gap.floor].map(|x| significant(x, 3));
        let [before, after, floor] = numbers;
        table.row(&[name.to_owned(), before, after, floor, percent(gap.closed), format!("{low} to {high}")]);
    }
    format!("<h2>Validation on other recordings</h2><div class=\"card\">{}</div>", table.to_html())
}
