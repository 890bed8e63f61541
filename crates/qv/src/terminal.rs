//! The one way by which text reaches the terminal. Names come from files and messages of others: what they hold can move no cursor, set no
//! title, and fill no screen.

use qv_recording::RecordingError;
use std::io::{self, ErrorKind, Write};

/// Longest line on standard error, and longest word in one \[characters\]: a header of a table, or a name, has no more than a line of the screen or two.
const MESSAGE: usize = 600;
const WORD: usize = 200;
/// Lines of one message.
const LINES: usize = 60;
/// Longest line on standard output, but for JSON, which others read \[characters\].
const RESULT: usize = 4000;

/// A message on standard error, after the name of the program.
macro_rules! print_message {
    ($($part:tt)*) => { $crate::terminal::message(&format!($($part)*)) };
}
pub(crate) use print_message;

/// Prints a message on standard error, after the name of the program. What cannot be printed is no failure.
pub fn message(text: &str) {
    _ = io::stderr().write_all(format!("qv: {}\n", shown(text)).as_bytes());
}

/// Prints an error and its hint on standard error.
pub fn error(text: &str) {
    _ = io::stderr().write_all(format!("{}\n", shown(text)).as_bytes());
}

/// Text for a line of a message, or of a bar.
pub fn shown(text: &str) -> String {
    let with_short_words = |line: &str| {
        let words: Vec<String> = line.split(' ').map(|word| cut(word, WORD)).collect();
        words.join(" ")
    };
    let all = text.split('\n').count();
    let short = text.split('\n').take(LINES).map(|line| escaped(&cut(&with_short_words(line), MESSAGE)));
    let mut lines: Vec<String> = short.collect();
    if all > LINES {
        lines.push(format!("[{} lines]", all - LINES));
    }
    lines.join("\n")
}

/// Prints results to standard output.
///
/// # Errors
/// It is closed or full.
pub fn result(text: &str) -> io::Result<()> {
    io::stdout().write_all(plain(text).as_bytes())
}

/// Results without what acts on a terminal, in lines that end. JSON stays whole: it has nothing that acts.
fn plain(text: &str) -> String {
    let one = |line: &str| match line.starts_with('{') {
        true => escaped_json(line),
        false => escaped(&cut(line, RESULT)),
    };
    let lines: Vec<String> = text.split('\n').map(one).collect();
    lines.join("\n")
}

/// A text of at most `longest` characters, and how many of its middle are left out: its end may say what to do.
fn cut(text: &str, longest: usize) -> String {
    let count = text.chars().count();
    if count <= longest {
        return text.to_owned();
    }
    let (begin, end) = (longest - longest / 3, longest / 3);
    let first: String = text.chars().take(begin).collect();
    let last: String = text.chars().skip(count - end).collect();
    format!("{first}[{} characters]{last}", count - longest)
}

fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if acts(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    out
}

/// The same in a line of JSON, as JSON writes it.
fn escaped_json(line: &str) -> String {
    let mut out = String::with_capacity(line.len());
    for c in line.chars() {
        // All that act lie in the first plane of Unicode.
        if acts(c) { out.push_str(&format!("\\u{:04x}", u32::from(c))) } else { out.push(c) }
    }
    out
}

/// Whether a character acts on a terminal, or on the order in which others are read.
fn acts(c: char) -> bool {
    let is_control = c.is_control() && c != '\t' && c != '\n';
    is_control || matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Prints to standard output. A reader that left early, such as `head`, is no failure.
pub fn say(text: &str) -> Result<(), RecordingError> {
    match result(text) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(RecordingError::Write { what: "standard output".into(), reason: e.to_string() })
        }
        _ => Ok(()),
    }
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
    fn long_words_and_lines_are_cut_and_their_ends_stay() {
        for middle in ["é".repeat(30_000), "a b ".repeat(30_000)] {
            let short = shown(&format!("start {middle} end\nnext"));
            assert!(short.starts_with("start ") && short.ends_with(" end\nnext"), "{short}");
            assert!(short.lines().all(|line| line.chars().count() < MESSAGE + 30), "{short}");
        }
        assert!(shown(&"\n".repeat(30_000)).lines().count() <= LINES + 1);
        let own = "twenty characters or ".repeat(20);
        assert_eq!(shown(&own), own);
        let json = format!("{{\"a\":\"{}\"}}\n", "x".repeat(30_000));
        assert_eq!(plain(&json), json);
        let marks = plain("{\"a\":\"x\u{200f}y\u{7f}\"}\n");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&marks).unwrap()["a"], "x\u{200f}y\u{7f}");
        assert!(plain(&format!(" {json}")).len() < 5000);
    }
}
