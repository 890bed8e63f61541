//! Bytes of an XML file become text.

use crate::SimError;
use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE};

/// The text of an XML file in the encoding of its byte order mark, else the one that it declares, else UTF-8; and a
/// sentence where bytes mean nothing in that encoding (they become U+FFFD; in a comment they cost nothing).
///
/// # Errors
/// When the declared encoding is unknown.
pub fn decode(bytes: &[u8]) -> Result<(String, Option<String>), SimError> {
    let encoding = match Encoding::for_bom(bytes) {
        Some((encoding, _)) => encoding,
        // Without a mark, the first character of UTF-16 still is `<`.
        None if bytes.starts_with(b"<\0") => UTF_16LE,
        None if bytes.starts_with(b"\0<") => UTF_16BE,
        None => match declared(bytes) {
            Some(label) => Encoding::for_label(label).ok_or_else(|| {
                let label = String::from_utf8_lossy(label);
                SimError::UrdfSyntax(format!("a text in the encoding `{label}`, which is unknown"))
            })?,
            None => UTF_8,
        },
    };
    // A file that declares UTF-16 in single bytes is not UTF-16: the declaration was copied.
    let encoding =
        if [UTF_16LE, UTF_16BE].contains(&encoding) && bytes.starts_with(b"<?xml") { UTF_8 } else { encoding };
    let (text, _, malformed) = encoding.decode(bytes);
    let remarks = malformed.then(|| {
        let line = 1 + text.split('\u{fffd}').next().unwrap_or_default().matches('\n').count();
        format!("bytes that are not {} (line {line}) are read as \u{fffd}", encoding.name())
    });
    Ok((text.into_owned(), remarks))
}

/// The value of `encoding` in the XML declaration.
fn declared(bytes: &[u8]) -> Option<&[u8]> {
    let head = bytes.strip_prefix(b"<?xml")?;
    let head = &head[..find(head, b"?>")?];
    let rest = head[find(head, b"encoding")? + b"encoding".len()..].trim_ascii_start().strip_prefix(b"=")?;
    let (quote, rest) = rest.trim_ascii_start().split_first()?;
    Some(&rest[..rest.iter().position(|b| b == quote)?])
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|w| w == what)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    const NAME: &str = "<robot name=\"Größe\"/>";

    #[test]
    fn marks_and_declarations_are_followed() {
        let latin = |s: &str| s.chars().map(|c| c as u8).collect::<Vec<_>>();
        let utf16 = |s: &str, little: bool| {
            let bytes = |u: u16| if little { u.to_le_bytes() } else { u.to_be_bytes() };
            s.encode_utf16().flat_map(bytes).collect::<Vec<_>>()
        };
        let with = |label: &str| format!("<?xml version=\"1.0\" encoding = '{label}'?>{NAME}");
        let marked = format!("\u{feff}{}", with("UTF-16"));
        let cases = [
            ("plain", NAME.as_bytes().to_vec()),
            ("UTF-8 mark", format!("\u{feff}{NAME}").into_bytes()),
            ("Latin 1", latin(&with("ISO-8859-1"))),
            ("little UTF-16 with a mark", utf16(&marked, true)),
            ("big UTF-16 with a mark", utf16(&marked, false)),
            ("little UTF-16 without", utf16(&with("utf-16"), true)),
            ("UTF-16 declared, UTF-8 meant", with("UTF-16").into_bytes()),
        ];
        for (what, bytes) in cases {
            let (text, remarks) = decode(&bytes).expect(what);
            assert!(text.ends_with(NAME) && remarks.is_none(), "{what}: {text}, {remarks:?}");
        }
        let mut chinese = b"<?xml version=\"1.0\" encoding=\"GBK\"?><robot name=\"".to_vec();
        chinese.extend([0xbb, 0xfa, 0xc6, 0xf7]);
        assert!(decode(&chinese).unwrap().0.ends_with("name=\"机器"));
    }

    #[test]
    fn what_is_not_in_the_encoding_is_told() {
        let (text, remarks) = decode(b"<robot>\n<!-- Gr\xf6\xdfe --></robot>").unwrap();
        assert!(text.ends_with("--></robot>") && remarks.unwrap().states("line 2"));
        let error = decode(b"<?xml version=\"1.0\" encoding=\"klingon\"?><robot/>").unwrap_err().to_string();
        assert!(error.contains("klingon"), "{error}");
    }
}
