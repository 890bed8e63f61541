//! Figures as Markdown.

use super::figures::{Figure, Figures, Goal};
use anyhow::{Context, Result};
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Markers between which a page holds the tables.
const BEGIN: &str = "<!-- blind: begin -->";
const END: &str = "<!-- blind: end -->";

fn number(value: Option<f64>) -> String {
    value.map_or("-".into(), |v| format!("{v:.3}"))
}

fn goal(figure: &Figure) -> String {
    match figure.goal {
        None => String::new(),
        Some(Goal::AtLeast(least)) => format!("≥ {least}"),
        Some(Goal::AtMost(most)) => format!("≤ {most}"),
        Some(Goal::Between(least, most)) => format!("{least} to {most}"),
    }
}

/// How the tables were measured: the command after `cargo xtask`, the commit, and how many recordings.
pub fn how(words: impl Iterator<Item = String>, commit: &str, figures: &Figures) -> String {
    let command = words.collect::<Vec<_>>().join(" ");
    let effects: usize = figures.effects.values().map(|row| row.count).sum();
    let all: usize = figures.confusion.values().flat_map(|said| said.values()).sum();
    format!("`cargo xtask {command}`, {commit}: {all} recordings, {effects} of them with one named effect.")
}

/// All tables.
pub fn markdown(figures: &Figures) -> String {
    let mut text = String::new();
    write_all(&mut text, figures).expect("writing to a String cannot fail");
    text
}

fn write_all(text: &mut String, figures: &Figures) -> std::fmt::Result {
    writeln!(text, "| figure | found | 95 % interval | of | goal | met |\n|---|---:|---|---:|---|---|")?;
    for figure in &figures.figures {
        let interval = figure.interval.map_or(String::new(), |[low, high]| format!("{low:.3} to {high:.3}"));
        let met = figure.met().map_or("", |met| if met { "yes" } else { "**no**" });
        let (found, goal) = (number(figure.value), goal(figure));
        writeln!(text, "| {} | {found} | {interval} | {} | {goal} | {met} |", figure.what, figure.count)?;
    }
    if !figures.by_origin.is_empty() {
        write_origins(text, figures)?;
    }
    if !figures.baselines.is_empty() {
        write_baselines(text, figures)?;
    }
    writeln!(text, "\n| effect | recordings | named first | among three | error over range | gap closed |")?;
    writeln!(text, "|---|---:|---:|---:|---:|---:|")?;
    for (name, row) in &figures.effects {
        let (error, closed) = (number(row.error), number(row.closed));
        writeln!(text, "| {name} | {} | {:.2} | {:.2} | {error} | {closed} |", row.count, row.named, row.among_three)?;
    }
    writeln!(text, "\n| what is there | what was said first, and how often |\n|---|---|")?;
    for (truth, said) in &figures.confusion {
        let mut said: Vec<(&String, &usize)> = said.iter().collect();
        said.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
        let said: Vec<String> = said.into_iter().map(|(name, count)| format!("{name} {count}")).collect();
        writeln!(text, "| {truth} | {} |", said.join(", "))?;
    }
    Ok(())
}

/// The same figures by what made the recordings, each with its count.
fn write_origins(text: &mut String, figures: &Figures) -> std::fmt::Result {
    let names: Vec<&str> = figures.by_origin.keys().map(String::as_str).collect();
    writeln!(text, "\n| figure | {} |\n|---|{}", names.join(" | "), "---:|".repeat(names.len()))?;
    for (row, figure) in figures.figures.iter().enumerate() {
        let of = |list: &Vec<Figure>| match list[row].value {
            Some(value) => format!("{value:.3} of {}", list[row].count),
            None => "-".into(),
        };
        let cells: Vec<String> = figures.by_origin.values().map(of).collect();
        writeln!(text, "| {} | {} |", figure.what, cells.join(" | "))?;
    }
    Ok(())
}

fn write_baselines(text: &mut String, figures: &Figures) -> std::fmt::Result {
    writeln!(
        text,
        "\n| method | named first | gap closed, median | no effect, identified | out-of-library, identified |"
    )?;
    writeln!(text, "|---|---:|---:|---:|---:|")?;
    let ours = |name: &str| number(figures.figures.iter().find(|f| f.name == name).and_then(|f| f.value));
    let [top, closed, none, withheld] = ["top_1", "closed", "none_accused", "withheld_accused"].map(ours);
    writeln!(text, "| qv diagnose | {top} | {closed} (where rightly named) | {none} | {withheld} |")?;
    for row in &figures.baselines {
        let [top, closed, none, withheld] = [row.named, row.closed, row.none_accused, row.withheld_accused].map(number);
        writeln!(text, "| {} | {top} | {closed} | {none} | {withheld} |", row.name.replace('_', " "))?;
    }
    Ok(())
}

/// Replaces what a page has between its markers.
///
/// # Errors
/// The page is missing or has no markers.
pub fn refresh(page: &Path, tables: &str) -> Result<()> {
    let text = fs::read_to_string(page).with_context(|| format!("reading {}", page.display()))?;
    let fresh = between_markers(&text, tables)
        .with_context(|| format!("{}: expected the lines {BEGIN} and {END}, found not both", page.display()))?;
    fs::write(page, fresh).with_context(|| format!("writing {}", page.display()))
}

fn between_markers(text: &str, tables: &str) -> Option<String> {
    let begin = text.find(BEGIN)? + BEGIN.len();
    let end = begin + text[begin..].find(END)?;
    Some(format!("{}\n\n{}\n\n{}", &text[..begin], tables.trim(), &text[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_how_it_was_measured() {
        let words = ["blind", "--full", "--seed", "7"].map(String::from);
        let remarks = how(words.into_iter(), "commit 0123456789", &super::super::figures::figures(Vec::new()));
        let expected =
            "`cargo xtask blind --full --seed 7`, commit 0123456789: 0 recordings, 0 of them with one named effect.";
        assert_eq!(remarks, expected);
    }

    #[test]
    fn only_what_is_between_the_markers_changes() {
        let page = format!("before\n{BEGIN}\nold\n{END}\nafter\n");
        let fresh = between_markers(&page, "| new |\n").unwrap();
        assert_eq!(fresh, format!("before\n{BEGIN}\n\n| new |\n\n{END}\nafter\n"));
        assert_eq!(between_markers(&fresh, "| new |\n").unwrap(), fresh);
        assert_eq!(between_markers("no markers", "x"), None);
        let page = include_str!("../../../docs/reference/results.md");
        assert!(between_markers(page, "| new |\n").is_some_and(|fresh| fresh.contains("| new |")));
        assert_eq!(between_markers(&format!("{END} {BEGIN}"), "x"), None);
    }
}
