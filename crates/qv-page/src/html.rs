//! Boards as HTML.

use crate::board::Board;
use crate::parts::card;
use crate::still::still;
use crate::text::script_data;

/// What marks the data of a board within a page.
pub(crate) const MARK: &str = "<script type=\"application/json\" class=\"board-data\">";

impl Board {
    /// The board as HTML: its data, and a drawing for readers without scripts. [`crate::Page`] adds the script. Nothing for a board
    /// without panels.
    pub fn to_html(&self) -> String {
        if self.panels.is_empty() {
            return String::new();
        }
        // Plain data: nothing can fail. Numbers of a page that are not finite are `null`, and taken for none by the script.
        let data = serde_json::to_string(self).unwrap_or_default();
        let lacks = if self.choices.is_empty() {
            ""
        } else {
            "<noscript><p class=\"soft small\">With scripts all the rest can be chosen.</p></noscript>"
        };
        format!("<div class=\"board\">{MARK}{}</script>{}{lacks}</div>", script_data(&data), still(self))
    }

    /// The same in a card.
    pub fn to_card(&self) -> String {
        let html = self.to_html();
        if html.is_empty() { html } else { card(&html) }
    }
}
