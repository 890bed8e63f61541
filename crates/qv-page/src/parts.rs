//! Cards, tables, badges and bars as HTML. What is given as `html` is put in as it is: callers escape text of others.

use crate::number::percent;
use crate::text::escape;
use std::fmt::Write;

/// A card.
pub fn card(html: &str) -> String {
    format!("<div class=\"card\">{html}</div>")
}

/// A card with a small heading, which is text.
pub fn titled_card(title: &str, html: &str) -> String {
    format!("<div class=\"card\"><h3>{}</h3>{html}</div>", escape(title))
}

/// Cards beside each other where there is room for `least` pixels each.
pub fn grid(least: usize, html: &str) -> String {
    format!("<div class=\"grid\" style=\"--min:{least}px\">{html}</div>")
}

/// What is wider than a narrow screen, in a box that scrolls by pointer and by keyboard; `name` is text.
pub fn scroll(name: &str, html: &str) -> String {
    format!("<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{}\">{html}</div>", escape(name))
}

/// How good news are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mood {
    /// All is well.
    Good,
    /// Something is left.
    Fair,
    /// Something is wrong.
    Bad,
    /// Neither good nor bad.
    Plain,
}

impl Mood {
    /// Its class in the style.
    pub fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Bad => "bad",
            Self::Plain => "plain",
        }
    }
}

/// The card that says what came out: a badge (text; none where it is empty) above words.
pub fn verdict(mood: Mood, badge: &str, html: &str) -> String {
    let badge =
        if badge.is_empty() { String::new() } else { format!("<span class=\"badge\">{}</span>", escape(badge)) };
    format!("<div class=\"card verdict {}\">{badge}<div>{html}</div></div>", mood.class())
}

/// Questions with their answers beside each other, for the first screen: names are text, answers are HTML. Empty answers take no room.
pub fn answers(rows: &[(&str, String)]) -> String {
    let answered = rows.iter().filter(|(_, answer)| !answer.is_empty());
    let one = |(name, answer): &(&str, String)| format!("<div><dt>{}</dt><dd>{answer}</dd></div>", escape(name));
    let all: String = answered.map(one).collect();
    if all.is_empty() { all } else { format!("<dl class=\"answers\">{all}</dl>") }
}

/// Paragraphs of notes, which are text.
pub fn notes(notes: &[String]) -> String {
    notes.iter().map(|note| format!("<p class=\"soft\">{}</p>", escape(note))).collect()
}

/// A list of sentences, which are text; empty without any.
pub fn list(sentences: &[String]) -> String {
    let items: String = sentences.iter().map(|s| format!("<li>{}</li>", escape(s))).collect();
    if items.is_empty() { items } else { format!("<ul>{items}</ul>") }
}

/// What a colour stands for, in one of the style's colours (`measured`, `before`, `after`, `c0` …).
pub fn key(tone: &str, name: &str) -> String {
    format!("<span class=\"key\" style=\"background:var(--{tone})\"></span>{}", escape(name))
}

/// Width of a bar for a share of its track, in percent of it.
pub fn width(share: f64) -> f64 {
    if share.is_finite() { (100.0 * share).clamp(0.0, 100.0) } else { 0.0 }
}

/// A bar on a track; `share` of its width, 0 to 1, which a pointer is reported.
pub fn track(share: f64, tone: &str) -> String {
    let (width, title) = (width(share), percent(share));
    format!(
        "<div class=\"track\" style=\"--fill:var(--{tone})\" title=\"{title}\"><i style=\"width:{width:.1}%\"></i></div>"
    )
}

/// The same with an interval.
pub fn track_with_interval(share: f64, interval: [f64; 2], tone: &str) -> String {
    let [low, high] = interval.map(width);
    if !(interval.iter().all(|x| x.is_finite()) && high >= low) {
        return track(share, tone);
    }
    let title = format!("{} ({} to {})", percent(share), percent(interval[0]), percent(interval[1]));
    format!(
        "<div class=\"track\" style=\"--fill:var(--{tone})\" title=\"{title}\"><i style=\"width:{:.1}%\"></i>\
         <u style=\"left:{low:.1}%;width:{:.1}%\"></u></div>",
        width(share),
        high - low
    )
}

/// A table that scrolls within its card on a narrow screen.
#[derive(Debug, Clone, Default)]
pub struct Table {
    head: String,
    body: String,
    left: Vec<usize>,
}

impl Table {
    /// With one row of headings, which are text. The first column is aligned to the left, all others to the right.
    pub fn new(heads: &[&str]) -> Self {
        Self::with_left(heads, &[])
    }

    /// The same with more columns that are aligned to the left, since they hold words.
    pub fn with_left(heads: &[&str], left: &[usize]) -> Self {
        let mut table = Self { left: left.to_vec(), ..Self::default() };
        let cells: String = heads.iter().enumerate().map(|(k, h)| table.cell("th", k, "", &escape(h))).collect();
        table.head = format!("<tr>{cells}</tr>");
        table
    }

    /// With groups of columns (name and number of columns) above a row of names or units; all are text.
    pub fn grouped(groups: &[(&str, usize)], heads: &[&str]) -> Self {
        let group = |(name, columns): &(&str, usize)| match columns {
            _ if name.is_empty() => format!("<td class=\"blank\" colspan=\"{columns}\"></td>"),
            1 => format!("<th>{}</th>", escape(name)),
            n => format!("<th colspan=\"{n}\">{}</th>", escape(name)),
        };
        let groups: String = groups.iter().map(group).collect();
        let own = Self::default();
        let heads: String = heads.iter().enumerate().map(|(k, h)| own.cell("th", k, "", &escape(h))).collect();
        Self { head: format!("<tr>{groups}</tr><tr class=\"units\">{heads}</tr>"), ..Self::default() }
    }

    fn cell(&self, tag: &str, column: usize, more: &str, html: &str) -> String {
        if tag == "th" && html.is_empty() {
            // A heading without words heads nothing.
            return "<td class=\"blank\"></td>".into();
        }
        let class = if self.left.contains(&column) { " class=\"left\"" } else { "" };
        format!("<{tag}{class}{more}>{html}</{tag}>")
    }

    /// A row of cells, each HTML.
    pub fn row<S: AsRef<str>>(&mut self, cells: &[S]) -> &mut Self {
        self.row_with_bar(cells, usize::MAX, 0.0)
    }

    /// A row in which a line under one cell is as long as its `share` of that cell, 0 to 1.
    pub fn row_with_bar<S: AsRef<str>>(&mut self, cells: &[S], column: usize, share: f64) -> &mut Self {
        self.body += "<tr>";
        for (k, html) in cells.iter().enumerate() {
            let bar = format!(" style=\"--w:{:.0}%\" data-bar", width(share));
            let cell = self.cell("td", k, if k == column { &bar } else { "" }, html.as_ref());
            self.body += &cell;
        }
        self.body += "</tr>";
        self
    }

    /// Whether it has no rows.
    pub fn is_empty(&self) -> bool {
        self.body.is_empty()
    }

    /// The table, in a box that scrolls.
    pub fn to_html(&self) -> String {
        self.to_html_as("")
    }

    /// The same with a class of the style, such as `facts`.
    pub fn to_html_as(&self, class: &str) -> String {
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        scroll("table", &format!("<table{class}>{}{}</table>", self.head, self.body))
    }
}

/// Rows of a name, a bar and a value, in columns that all rows share.
#[derive(Debug, Clone, Default)]
pub struct Bars {
    rows: String,
    four: bool,
}

impl Bars {
    /// Without rows.
    pub fn new() -> Self {
        Self::default()
    }

    /// A row: `name` and `value` are HTML, `bar` comes from [`track`].
    pub fn row(&mut self, name: &str, bar: &str, value: &str) -> &mut Self {
        let _ = write!(self.rows, "<span class=\"name\">{name}</span>{bar}<span class=\"value\">{value}</span>");
        self
    }

    /// A row with a second value. All rows of one list have one, or none has.
    pub fn row_of_four(&mut self, name: &str, bar: &str, value: &str, second: &str) -> &mut Self {
        self.four = true;
        self.row(name, bar, value);
        let _ = write!(self.rows, "<span class=\"value soft\">{second}</span>");
        self
    }

    /// The list.
    pub fn to_html(&self) -> String {
        format!("<div class=\"bars{}\">{}</div>", if self.four { " four" } else { "" }, self.rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_have_as_many_tags_closed_as_opened() {
        let mut table = Table::with_left(&["joint", "where <", "error [mrad]"], &[1]);
        table.row(&["a", "b", "1"]).row_with_bar(&["c", "d", "2"], 2, 0.5);
        let html = table.to_html();
        for tag in ["div", "table", "tr", "td", "th"] {
            let opened = html.matches(&format!("<{tag}>")).count() + html.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
        assert!(html.contains("&lt;") && html.contains("<td class=\"left\">b</td>"));
        assert!(html.contains("<td style=\"--w:50%\" data-bar>2</td>"));
        let grouped = Table::grouped(&[("", 1), ("torque", 2)], &["joint", "mean", "most"]).to_html();
        assert!(grouped.contains("<th colspan=\"2\">torque</th>") && Table::default().is_empty());
    }

    #[test]
    fn bars_stay_within_their_tracks() {
        assert!(track(7.0, "accent").contains("width:100.0%") && track(f64::NAN, "accent").contains("width:0.0%"));
        assert!(track_with_interval(0.5, [0.4, 0.7], "after").contains("left:40.0%;width:30.0%"));
        assert!(!track_with_interval(0.5, [f64::NAN, 0.7], "after").contains("<u"));
        let mut bars = Bars::new();
        bars.row_of_four("a", &track(0.1, "accent"), "1", "2");
        assert!(bars.to_html().starts_with("<div class=\"bars four\">"));
        assert_eq!(list(&[]), "");
        assert!(verdict(Mood::Bad, "<", "x").contains("verdict bad\"><span class=\"badge\">&lt;"));
    }
}
