//! The frame around a page: title, viewport, style, script.

use crate::html::MARK;
use crate::policy::policy;
use crate::text::escape;

/// Colours by name, light and dark, of all pages: a page that fills the screen by itself has them, too.
pub const TOKENS: &str = include_str!("tokens.css");
/// The style of all pages.
const STYLE: &str = include_str!("style.css");
/// Draws the boards.
const PLOTS: &str = include_str!("plots.js");

/// A page.
#[derive(Debug, Clone, Copy, Default)]
pub struct Page<'a> {
    /// Its title, which is text.
    pub title: &'a str,
    /// Its heading as HTML; the title where it is empty.
    pub heading: &'a str,
    /// What this page has beside the style of all pages.
    pub style: &'a str,
    /// All below the heading, as HTML.
    pub body: &'a str,
    /// What this page does beside its plots; it may use `qvPlots`, see `plots.js`. No `</script` may be in it.
    pub script: &'a str,
}

impl Page<'_> {
    /// The whole file. The script of the plots is in it only where the body has a board.
    pub fn to_html(&self) -> String {
        let title = escape(self.title);
        let heading = if self.heading.is_empty() { &title } else { self.heading };
        let plots = if self.body.contains(MARK) { PLOTS } else { "" };
        let (script, policy) = if plots.is_empty() && self.script.is_empty() {
            (String::new(), policy(&[]))
        } else {
            let text = format!("\"use strict\";\n{plots}\n{}", self.script);
            (format!("<script>{text}</script>"), policy(&[&text]))
        };
        format!(
            "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">{policy}\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{title}</title>\
             <style>{TOKENS}{STYLE}{}</style><body><main><h1>{heading}</h1>{}</main>{script}</body></html>\n",
            self.style, self.body
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::{Board, Line, Panel};

    #[test]
    fn a_page_without_a_board_has_no_script_and_none_uses_a_network() {
        let plain = Page { title: "a < b", body: "<p>x</p>", ..Page::default() }.to_html();
        assert!(!plain.contains("<script") && plain.contains("<title>a &lt; b</title>"));
        assert!(plain.contains("<h1>a &lt; b</h1>") && plain.contains("prefers-color-scheme:dark"));
        let mut board = Board::new("time [s]");
        let x = board.column(&[0.0, 1.0], 0.1);
        board.panels.push(Panel { lines: vec![Line::new("a", "c0", x, x)], ..Panel::default() });
        let page =
            Page { title: "plots", heading: "<b>plots</b>", body: &board.to_card(), ..Page::default() }.to_html();
        assert_eq!((page.matches("<script").count(), page.matches("</script>").count()), (2, 2));
        let script = page.rsplit_once("<script>").and_then(|(_, rest)| rest.split_once("</script>")).unwrap().0;
        assert!(page.contains(&policy(&[script])) && plain.contains(&policy(&[])));
        for never in ["http:", "https:", "src=", "<link", "@import", "url(", "NaN", "import("] {
            assert!(!page.contains(never) && !plain.contains(never), "{never}");
        }
    }

    #[test]
    fn the_script_does_not_end_itself() {
        assert!(!PLOTS.contains("</script") && ![TOKENS, STYLE].concat().contains("</style"));
    }
}
