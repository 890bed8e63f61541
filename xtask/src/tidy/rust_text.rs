//! Rust text with parts blanked out, so that rules see code and not what is written about it. Line breaks stay, so that
//! line numbers do, too.

/// What to keep of the text of literals.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Strings {
    /// Blank them.
    Blank,
    /// Keep them.
    Keep,
}

/// The code: comments blanked, strings as asked.
pub fn code(text: &str, strings: Strings) -> String {
    let bytes = text.as_bytes();
    let mut out = bytes.to_vec();
    let mut at = 0;
    while at < bytes.len() {
        let end = match bytes[at] {
            b'/' if bytes[at..].starts_with(b"//") => end_of_line(bytes, at),
            b'/' if bytes[at..].starts_with(b"/*") => end_of_block_comment(bytes, at),
            b'"' => end_of_string(bytes, at),
            b'r' if !in_word(bytes, at) => match raw_string(bytes, at) {
                Some(end) => end,
                None => at + 1,
            },
            b'\'' => end_of_char(bytes, at),
            _ => at + 1,
        };
        let comment = bytes[at] == b'/' && end > at + 1;
        let literal = end > at + 1 && !comment;
        if comment || (literal && strings == Strings::Blank) {
            blank(&mut out[at..end]);
        }
        at = end;
    }
    String::from_utf8(out).unwrap_or_default()
}

/// String literals with the byte that each begins at, quotes included; comments and characters have none.
pub fn literals(text: &str) -> Vec<(usize, &str)> {
    let bytes = text.as_bytes();
    let (mut at, mut found) = (0, Vec::new());
    while at < bytes.len() {
        let (end, is_string) = match bytes[at] {
            b'/' if bytes[at..].starts_with(b"//") => (end_of_line(bytes, at), false),
            b'/' if bytes[at..].starts_with(b"/*") => (end_of_block_comment(bytes, at), false),
            b'"' => (end_of_string(bytes, at), true),
            b'r' if !in_word(bytes, at) => raw_string(bytes, at).map_or((at + 1, false), |end| (end, true)),
            b'\'' => (end_of_char(bytes, at), false),
            _ => (at + 1, false),
        };
        if is_string {
            found.extend(text.get(at..end).map(|literal| (at, literal)));
        }
        at = end;
    }
    found
}

/// `code` without its test modules: each item after `#[cfg(test)]` or `#[cfg(all(test, ...))]`, to its closing brace or
/// semicolon, is blanked.
/// Expects comments and strings to be blanked already, since braces are counted.
pub fn without_tests(code: &str) -> String {
    let mut out = code.as_bytes().to_vec();
    let mut from = 0;
    let marks = ["#[cfg(test)]", "#[cfg(all(test,"];
    while let Some(found) = marks.iter().filter_map(|mark| code[from..].find(mark)).min() {
        let start = from + found;
        let end = end_of_item(code.as_bytes(), start);
        blank(&mut out[start..end]);
        from = end;
    }
    String::from_utf8(out).unwrap_or_default()
}

fn blank(bytes: &mut [u8]) {
    for byte in bytes {
        if *byte != b'\n' {
            *byte = b' ';
        }
    }
}

fn in_word(bytes: &[u8], at: usize) -> bool {
    at > 0 && (bytes[at - 1].is_ascii_alphanumeric() || bytes[at - 1] == b'_')
}

fn end_of_line(bytes: &[u8], at: usize) -> usize {
    bytes[at..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |n| at + n)
}

/// Block comments nest.
fn end_of_block_comment(bytes: &[u8], at: usize) -> usize {
    let (mut depth, mut i) = (0, at);
    while i < bytes.len() {
        if bytes[i..].starts_with(b"/*") {
            (depth, i) = (depth + 1, i + 2);
        } else if bytes[i..].starts_with(b"*/") {
            (depth, i) = (depth - 1, i + 2);
            if depth == 0 {
                return i;
            }
        } else {
            i += 1;
        }
    }
    bytes.len()
}

fn end_of_string(bytes: &[u8], at: usize) -> usize {
    let mut i = at + 1;
    while i < bytes.len() {
        match bytes[i] {
            b'\\' => i += 2,
            b'"' => return i + 1,
            _ => i += 1,
        }
    }
    bytes.len()
}

/// End of a raw string that starts at the `r`, if one does.
fn raw_string(bytes: &[u8], at: usize) -> Option<usize> {
    let hashes = bytes[at + 1..].iter().take_while(|b| **b == b'#').count();
    if bytes.get(at + 1 + hashes) != Some(&b'"') {
        return None;
    }
    let mut close = vec![b'"'];
    close.resize(1 + hashes, b'#');
    let body = at + 2 + hashes;
    let end = bytes[body..].windows(close.len()).position(|window| window == close);
    Some(end.map_or(bytes.len(), |n| body + n + close.len()))
}

/// A character literal ends within a few bytes; a lifetime does not end at all and is one mark long here.
fn end_of_char(bytes: &[u8], at: usize) -> usize {
    if bytes.get(at + 1) == Some(&b'\\') {
        let close = bytes.iter().skip(at + 3).position(|b| *b == b'\'');
        return close.map_or(bytes.len(), |n| at + 3 + n + 1);
    }
    // One character of up to four bytes, then the closing mark.
    (2..=5)
        .map(|n| at + n)
        .find(|&i| bytes.get(i) == Some(&b'\''))
        .filter(|&i| one_character(&bytes[at + 1..i]))
        .map_or(at + 1, |i| i + 1)
}

fn one_character(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_ok_and(|text| text.chars().count() == 1)
}

fn end_of_item(bytes: &[u8], at: usize) -> usize {
    let mut depth = 0usize;
    for (i, byte) in bytes.iter().enumerate().skip(at) {
        match byte {
            b'{' => depth += 1,
            b'}' => {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    return i + 1;
                }
            }
            b';' if depth == 0 => return i + 1,
            _ => {}
        }
    }
    bytes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_strings_go_and_lines_stay() {
        let text = "let a = \"x // y\"; // note\n/* two /* nested */\nlines */ let b = 'c';\nfn f<'a>(x: &'a str) {}\nr#\"raw \" one\"#;";
        let blanked = code(text, Strings::Blank);
        assert_eq!(blanked.lines().count(), text.lines().count());
        for gone in ["note", "nested", "// y", "raw", "'c'"] {
            assert!(!blanked.contains(gone), "{gone}: {blanked}");
        }
        for kept in ["let a", "let b", "fn f<'a>(x: &'a str) {}"] {
            assert!(blanked.contains(kept), "{kept}: {blanked}");
        }
        let kept = code(text, Strings::Keep);
        assert!(kept.contains("x // y") && kept.contains("raw \" one") && !kept.contains("note"));
    }

    #[test]
    fn literals_are_those_of_code() {
        let text = "let a = \"one\"; // \"no\"\nlet b = \"two\\\n  lines\"; let c = '\"';\nlet d = r#\"three\"#;";
        let found: Vec<&str> = literals(text).iter().map(|(_, literal)| *literal).collect();
        assert_eq!(found, ["\"one\"", "\"two\\\n  lines\"", "r#\"three\"#"]);
        assert_eq!(literals(text)[0].0, 8);
    }

    #[test]
    fn awkward_characters_do_not_derail() {
        let text = "let q = '\"'; let e = '\\''; let b = '\\\\'; let u = '\u{e9}'; call(); // \"\nmore();";
        let blanked = code(text, Strings::Blank);
        assert!(blanked.contains("call();") && blanked.contains("more();"), "{blanked}");
    }

    #[test]
    fn test_modules_go() {
        let text =
            "fn a() {}\n#[cfg(test)]\nmod tests { fn b() { {} } }\nfn c() {}\n#[cfg(test)]\nuse x::y;\nfn d() {}";
        let kept = without_tests(text);
        assert!(kept.contains("fn a") && kept.contains("fn c") && kept.contains("fn d"));
        assert!(!kept.contains("fn b") && !kept.contains("x::y"));
    }
}
