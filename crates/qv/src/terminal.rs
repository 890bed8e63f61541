//! The one way by which text reaches the terminal. Names come from files and messages of others: what they hold can move no cursor, set no
//! title, and fill no screen.

use std::fmt::Write as _;
use std::io::{self, Write};

/// Longest line on standard error \[characters\].
const MESSAGE: usize = 200;
/// Longest line on standard output, but for JSON, which others read \[characters\].
const RESULT: usize = 4000;
/// Characters of the end of a line that stay where its middle is cut out: hints stand there.
const END: usize = 100;

/// A message on standard error, after the name of the program.
macro_rules! print_message {
    ($($part:tt)*) => { $crate::terminal::message(&format!($($part)*)) };
}
pub(crate) use print_message;

/// Prints a message on standard error, after the name of the program. What cannot be printed is no failure.
pub fn message(text: &str) {
    _ = io::stderr().write_all(format!("qv: {}\n", shown(text)).as_bytes());
}

/// Text for a line of a message, or of a bar.
pub fn shown(text: &str) -> String {
    plain(text, MESSAGE, false)
}

/// Prints results to standard output.
///
/// # Errors
/// It is closed or full.
pub fn result(text: &str) -> io::Result<()> {
    io::stdout().write_all(plain(text, RESULT, true).as_bytes())
}

/// The text without what acts on a terminal, in lines of at most so many characters. JSON has nothing that acts, and stays whole.
fn plain(text: &str, longest: usize, may_be_json: bool) -> String {
    let mut out = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let (line, end) = line.strip_suffix('\n').map_or((line, ""), |line| (line, "\n"));
        if may_be_json && line.starts_with('{') && !line.chars().any(acts) {
            out += line;
        } else {
            add_line(&mut out, line, longest);
        }
        out += end;
    }
    out
}

fn add_line(out: &mut String, line: &str, longest: usize) {
    let count = line.chars().count();
    if count <= longest {
        return add_escaped(out, line.chars());
    }
    add_escaped(out, line.chars().take(longest - END));
    _ = write!(out, " [{} characters] ", count - longest);
    add_escaped(out, line.chars().skip(count - END));
}

fn add_escaped(out: &mut String, text: impl Iterator<Item = char>) {
    for c in text {
        if acts(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
}

/// Whether a character acts on a terminal, or on the order in which others are read.
fn acts(c: char) -> bool {
    let is_control = c.is_control() && c != '\t' && c != '\n';
    is_control || matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_acts_on_a_terminal_is_escaped() {
        assert_eq!(shown("a\u{1b}]0;x\u{7}b\r\u{9b}2Jc\u{202e}d"), "a\\u{1b}]0;x\\u{7}b\\r\\u{9b}2Jc\\u{202e}d");
        assert_eq!(shown("two\nlines\tand ä 日本"), "two\nlines\tand ä 日本");
    }

    #[test]
    fn long_lines_are_cut_and_their_end_stays() {
        let long = format!("start{}end\nnext", "é".repeat(30_000));
        let short = shown(&long);
        assert!(short.starts_with("start") && short.ends_with("end\nnext"), "{short}");
        assert!(short.lines().all(|line| line.chars().count() <= MESSAGE + 30), "{short}");
        let json = format!("{{\"a\":\"{}\"}}\n", "x".repeat(30_000));
        assert_eq!(plain(&json, RESULT, true), json);
        assert!(plain(&json, RESULT, false).len() < 5000 && plain(&format!(" {json}"), RESULT, true).len() < 5000);
    }
}
