//! What is accused: each cause with its size, place, and what speaks against it.

use super::bars::ranking;
use super::words::{escape, fixed, percent, size, words};
use crate::problem::library::{Effect, Scope};
use crate::report::{Cause, Report, Verdict};
use qv_page::parts::track;
use std::fmt::Write;

/// Names of a scope that are shown.
const NAMES: usize = 8;

/// The section.
pub(super) fn causes(report: &Report, library: &[Effect]) -> String {
    let mut text = String::from("<h2>Causes</h2>");
    if report.causes.is_empty() {
        let why = match report.verdict {
            Verdict::NoGap => "No effect is identified: there is no gap.",
            _ => "No effect is identified: none of the library explains this gap. The nearest candidates follow.",
        };
        let _ = write!(text, "<p>{why}</p>");
    }
    for (place, c) in report.causes.iter().enumerate() {
        text += &cause(place + 1, c, library, &certainty(report, c));
    }
    // What passed tests at an error rate has no score.
    if report.is_balanced() { text } else { text + &ranking(&report.ranking, &report.causes) }
}

/// How sure a cause is: its score, or the rate of false alarms of the tests that it passed.
fn certainty(report: &Report, c: &Cause) -> String {
    if report.is_balanced() {
        let rate = percent(report.policy.held.alpha);
        return format!("<span class=\"soft\">false alarms of these tests</span> <b>{rate}</b>");
    }
    let (bar, score) = (track(c.score, "accent"), fixed(c.score, 2));
    format!("{bar}<span><span class=\"soft\">score</span> <b>{score}</b></span>")
}

fn cause(place: usize, c: &Cause, library: &[Effect], certainty: &str) -> String {
    let mut text = format!(
        "<article class=\"card cause\"><header><span><span class=\"title\">{place}. {}</span> <code>{}</code></span>{certainty}</header><dl>",
        escape(&words(&c.effect)),
        escape(&c.effect),
    );
    let mut row = |name: &str, value: String| {
        let _ = write!(text, "<dt>{name}</dt><dd>{value}</dd>");
    };
    let sizes = sizes(c);
    if !sizes.is_empty() {
        let note = if has_interval(c) { " <span class=\"soft small\">95 % interval</span>" } else { "" };
        row("size", sizes.join("<br>") + note);
    }
    if !c.scope.is_empty() {
        row("scope", scope(c, library));
    }
    let of_what = if c.scope == ["region"] { "the error of windows of 0.1 s in that region" } else { "the gap" };
    if c.closed_alone.is_finite() {
        row("removes alone", format!("{} of {of_what}", percent(c.closed_alone)));
    }
    if !c.confusable_with.is_empty() {
        let names: Vec<String> = c.confusable_with.iter().map(|n| escape(&words(n))).collect();
        row("looks like", names.join(", "));
    }
    if !c.separating_experiment.is_empty() {
        row("to separate them", escape(&c.separating_experiment));
    }
    text + "</dl></article>"
}

/// Whether a size has an interval.
pub(super) fn has_interval(c: &Cause) -> bool {
    c.parameters.iter().any(|p| p.ci95.iter().all(|x| x.is_finite()))
}

/// Each size with its interval, as HTML; several have their names and, where each part has one, their parts.
pub(super) fn sizes(c: &Cause) -> Vec<String> {
    let sizes = c.parameters.iter().map(|p| format!("<b>{}</b>", escape(&size(p))));
    if c.parameters.len() == 1 {
        // One value needs no name beside the effect's.
        return sizes.collect();
    }
    let name = |label: String| escape(&words(&label).to_lowercase());
    c.parameter_labels()
        .into_iter()
        .zip(sizes)
        .map(|((label, part), size)| {
            let of = part.map_or(String::new(), |part| format!(" of {}", escape(part)));
            format!("{}{of} {size}", name(label.into()))
        })
        .collect()
}

fn scope(c: &Cause, library: &[Effect]) -> String {
    // What an effect acts on says what all of it is.
    let all = match library.iter().find(|e| e.name == c.effect).map(|e| e.scope) {
        Some(Scope::Joints) => "all joints",
        Some(Scope::Links) => "all links",
        Some(Scope::Feet) => "all feet",
        Some(Scope::Ground) => "the whole floor",
        Some(Scope::Base | Scope::World) => "the whole robot",
        None => "everywhere",
    };
    let names = &c.scope;
    let mut text = String::new();
    for name in names.iter().take(NAMES) {
        let _ = write!(text, "<span class=\"chip\">{}</span>", escape(if name == "all" { all } else { name }));
    }
    if names.len() > NAMES {
        let _ = write!(text, "<span class=\"soft\">and {} more</span>", names.len() - NAMES);
    }
    text
}
