//! What this recording can show: the least size of each effect that is found in most such recordings.

use super::words::{amount, escape, words};
use crate::report::CanTell;
use qv_page::Table;
use qv_page::parts::{card, track};

/// A row for each effect and size; nothing where nothing was measured of it.
/// `found` says in how many.
pub(super) fn sizes(all: &[CanTell], found: &str) -> String {
    if all.is_empty() {
        return String::new();
    }
    let mut seen: Vec<(&str, &str)> = Vec::new();
    let mut table =
        Table::with_left(&["effect", "of all", "of one part", "share of the search range", "looks like"], &[4]);
    for one in all {
        let key = (one.effect.as_str(), one.parameter.as_str());
        if seen.contains(&key) {
            continue;
        }
        seen.push(key);
        let same: Vec<&CanTell> =
            all.iter().filter(|c| (c.effect.as_str(), c.parameter.as_str()) == key && c.scope.len() == 1).collect();
        let (whole, parts): (Vec<&CanTell>, Vec<&CanTell>) = same.into_iter().partition(|c| c.scope == ["all"]);
        let most = one.range.iter().fold(0.0_f64, |most, limit| most.max(limit.abs()));
        // Effects whose sizes have no bound have no share either.
        let share = whole.iter().find_map(|c| c.least_size).map_or(1.0, |size| (size / most).min(1.0));
        let share = if most > 0.0 { track(share, "accent") } else { "–".into() };
        let axis =
            if one.effect.ends_with(&one.parameter) { String::new() } else { format!(" ({})", words(&one.parameter)) };
        table.row(&[
            escape(&format!("{}{axis}", words(&one.effect))),
            escape(&span(&whole)),
            escape(&span(&parts)),
            share,
            escape(&one.confusable_with.iter().map(|e| words(e)).collect::<Vec<_>>().join(", ")),
        ]);
    }
    let html = format!(
        "<details><summary>Smallest detectable size of each effect</summary><p class=\"soft small\">Found in {found} such \
         recordings, if nothing else is wrong with the simulator. A full bar: not even the largest that is looked for.</p>\
         {}</details>",
        table.to_html()
    );
    format!("<h2>Detectable effects</h2>{}", card(&html))
}

/// The smallest and the largest of these least sizes, and how many parts show nothing.
fn span(of: &[&CanTell]) -> String {
    let mut sizes: Vec<f64> = of.iter().filter_map(|c| c.least_size).collect();
    sizes.sort_by(f64::total_cmp);
    let (Some(first), Some(&least), Some(&most)) = (of.first(), sizes.first(), sizes.last()) else {
        return if of.is_empty() { "–".into() } else { "none".into() };
    };
    let write = |x: f64| amount(&first.parameter, x, &first.unit);
    let unseen = of.len() - sizes.len();
    let more = if unseen > 0 { format!(", {unseen} none") } else { String::new() };
    if of.len() == 1 || least == most {
        format!("{}{more}", write(least))
    } else {
        format!("{} to {}{more}", write(least), write(most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn an_effect_has_one_row_with_all_and_with_parts() {
        let one = |scope: &str, least_size: Option<f64>| CanTell {
            effect: "command_latency".into(),
            scope: vec![scope.into()],
            parameter: "latency".into(),
            unit: "s".into(),
            least_size,
            tolerance: 0.0004,
            range: [0.0, 0.025],
            confusable_with: vec!["actuator_lag".into()],
        };
        let html = sizes(&[one("all", Some(0.005)), one("hip", Some(0.006)), one("knee", None)], "nine of ten");
        assert_eq!(html.matches("Command latency").count(), 1, "{html}");
        assert!(html.states("ms 5") && html.states("none 6 1") && html.states("Actuator"), "{html}");
        assert_eq!(sizes(&[], "nine of ten"), "");
    }
}
