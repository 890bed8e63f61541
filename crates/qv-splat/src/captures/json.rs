//! JSON as people's tools write it: with a byte order mark, in UTF-16, with NaN.

use crate::SplatError;
use crate::error::off;
use serde_json::Value;
use std::borrow::Cow;

/// Numbers that Python writes and JSON does not know; each becomes a text, so that it is an error only where a number is needed.
const NO_NUMBERS: [&str; 3] = ["-Infinity", "Infinity", "NaN"];

/// The document in the bytes of a file called `place`.
///
/// # Errors
/// No text, or no JSON even so.
pub fn parse(bytes: &[u8], place: &str) -> Result<Value, SplatError> {
    let text = text_of(bytes).map_err(|found| off(place, "JSON as text", found))?;
    match serde_json::from_str(&text) {
        Ok(document) => Ok(document),
        Err(error) => serde_json::from_str(&quoted(&text)).map_err(|_| off(place, "JSON", error)),
    }
}

/// Text in UTF-8, or in UTF-16 with its mark, without the mark.
fn text_of(bytes: &[u8]) -> Result<Cow<'_, str>, String> {
    let wide = |swap: bool| {
        let units = bytes[2..].chunks_exact(2).map(|pair| {
            if swap { u16::from_be_bytes([pair[0], pair[1]]) } else { u16::from_le_bytes([pair[0], pair[1]]) }
        });
        char::decode_utf16(units).collect::<Result<String, _>>().map(Cow::Owned).map_err(|e| format!("UTF-16: {e}"))
    };
    match bytes {
        [0xff, 0xfe, ..] => wide(false),
        [0xfe, 0xff, ..] => wide(true),
        _ => {
            let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
            std::str::from_utf8(bytes).map(Cow::Borrowed).map_err(|e| e.to_string())
        }
    }
}

/// The text with quotes about what is no number, outside of texts.
fn quoted(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 16);
    let (mut rest, mut inside) = (text, false);
    while let Some(first) = rest.chars().next() {
        let word = NO_NUMBERS.iter().find(|word| !inside && rest.starts_with(**word));
        let taken = match (word, first) {
            (Some(word), _) => {
                out.push_str(&format!("\"{word}\""));
                rest = &rest[word.len()..];
                continue;
            }
            // What is escaped within a text does not end it.
            (None, '\\') if inside => first.len_utf8() + rest[1..].chars().next().map_or(0, char::len_utf8),
            (None, '"') => {
                inside = !inside;
                1
            }
            _ => first.len_utf8(),
        };
        out.push_str(&rest[..taken]);
        rest = &rest[taken..];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn marks_and_words_that_are_no_numbers_are_read() {
        let text = r#"{"a": NaN, "b": [-Infinity, 1], "c": "NaN \" NaN\\", "ü": Infinity}"#;
        let expected = json!({"a": "NaN", "b": ["-Infinity", 1], "c": "NaN \" NaN\\", "ü": "Infinity"});
        assert_eq!(parse(text.as_bytes(), "x").unwrap(), expected);
        let marked = [b"\xef\xbb\xbf", text.as_bytes()].concat();
        assert_eq!(parse(&marked, "x").unwrap(), expected);
        let mut wide = vec![0xff, 0xfe];
        wide.extend(text.encode_utf16().flat_map(u16::to_le_bytes));
        assert_eq!(parse(&wide, "x").unwrap(), expected);
        let mut wide = vec![0xfe, 0xff];
        wide.extend(text.encode_utf16().flat_map(u16::to_be_bytes));
        assert_eq!(parse(&wide, "x").unwrap(), expected);
        for (bad, word) in [(&b"{"[..], "expected JSON"), (b"\xff\xfe\x00\xd8", "UTF-16"), (b"{\"a\": \xff}", "utf-8")]
        {
            let error = parse(bad, "file.json").unwrap_err().to_string();
            assert!(error.contains("file.json") && error.contains(word), "{error}");
        }
    }
}
