//! Pages read back: their boards, and what of them is no script. For tests of pages.

use crate::board::Board;
use crate::html::MARK;

/// All boards of a page, in order; one that cannot be read is left out.
pub fn boards(html: &str) -> Vec<Board> {
    let data = html.split(MARK).skip(1).filter_map(|rest| rest.split_once("</script>"));
    data.filter_map(|(json, _)| serde_json::from_str(json).ok()).collect()
}

/// The page without the contents of its scripts, in which chance may write any word: what a reader without scripts gets.
pub fn without_scripts(html: &str) -> String {
    let mut out = String::with_capacity(html.len() / 2);
    for (k, part) in html.split("<script").enumerate() {
        match part.split_once("</script>") {
            Some((_, rest)) if k > 0 => out += rest,
            _ if k == 0 => out += part,
            _ => {}
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_are_left_out() {
        let page = "<p>a</p><script>let x = 1;</script><p>b</p><script type=\"x\">2</script>";
        assert_eq!(without_scripts(page), "<p>a</p><p>b</p>");
        assert!(boards(page).is_empty() && boards(&format!("{MARK}{{}}</script>")).is_empty());
    }
}
