//! A look at the structure of an ONNX file before the interpreter sees it.
//!
//! rten 0.27 waits for ever where a varint has ten bytes that all say that more follow, and follows nested graphs as deep
//! as the stack is. Both are damage, which is found here: lengths stay within their message, varints end within ten
//! bytes, and graphs lie at most [`MOST_NESTED`] messages deep.

use super::OnnxError;
use std::collections::BTreeSet;

/// A policy's file has a depth of 6 (model, graph, input, type, shape, dimension); a branch of an `If` adds 3.
const MOST_NESTED: usize = 32;

/// What a message is, as far as its fields hold messages.
#[derive(Clone, Copy)]
enum Kind {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    ValueInfo,
    Type,
    TypedShape,
    Shape,
    /// Only numbers and text.
    Flat,
    /// Varints one after the other.
    Packed,
}

/// What a field of bytes holds; `None` for text, raw numbers, and what the interpreter skips. Numbers as in `onnx.proto`.
fn child(kind: Kind, field: u64) -> Option<Kind> {
    Some(match (kind, field) {
        (Kind::Model, 7) | (Kind::Attribute, 6) => Kind::Graph,
        (Kind::Model, 8 | 14) | (Kind::Tensor, 13) | (Kind::Shape, 1) => Kind::Flat,
        (Kind::Graph, 1) => Kind::Node,
        (Kind::Graph, 5) | (Kind::Attribute, 5) => Kind::Tensor,
        (Kind::Graph, 11..=13) => Kind::ValueInfo,
        (Kind::Node, 5) => Kind::Attribute,
        (Kind::ValueInfo, 2) => Kind::Type,
        // A sequence's element is a type again.
        (Kind::Type, 1) => Kind::TypedShape,
        (Kind::Type, 4) => Kind::Type,
        (Kind::TypedShape, 1) => Kind::Type,
        (Kind::TypedShape, 2) => Kind::Shape,
        (Kind::Tensor, 1 | 5 | 7) | (Kind::Attribute, 8) => Kind::Packed,
        _ => return None,
    })
}

/// # Errors
/// Says what is damaged, and at which byte of the file.
pub(super) fn scan(bytes: &[u8]) -> Result<(), OnnxError> {
    walk(bytes, &mut |_| ()).map(drop)
}

/// Files beside the model that hold weights, as its tensors name them (`external_data`, key `location`).
///
/// # Errors
/// The bytes are no ONNX file: says what is damaged.
pub fn external_files(bytes: &[u8]) -> Result<BTreeSet<String>, OnnxError> {
    let mut files = BTreeSet::new();
    walk(bytes, &mut |entry| files.extend(location(entry)))?;
    Ok(files)
}

/// The value of an entry of text whose key is `location`.
fn location(entry: &[u8]) -> Option<String> {
    let mut reader = Reader { bytes: entry, at: 0 };
    let (mut key, mut value) = (None, None);
    while reader.at < entry.len() {
        let tag = reader.varint().ok()?;
        let length = reader.varint().ok()?;
        let start = reader.at;
        reader.skip(length).ok()?;
        let text = std::str::from_utf8(&entry[start..reader.at]).ok()?;
        if tag >> 3 == 1 { key = Some(text) } else { value = Some(text) }
    }
    (key == Some("location")).then_some(value).flatten().map(String::from)
}

/// Looks at all messages, and shows the entries of text of tensors, which say where their numbers lie.
fn walk(bytes: &[u8], entry: &mut dyn FnMut(&[u8])) -> Result<(), OnnxError> {
    // Messages still to be read: what they are, where they begin and end, how deep they lie.
    let mut pending = vec![(Kind::Model, 0, bytes.len(), 1)];
    while let Some((kind, start, end, depth)) = pending.pop() {
        if depth > MOST_NESTED {
            return Err(damage("messages nested too deep", start));
        }
        let mut reader = Reader { bytes: &bytes[..end], at: start };
        while reader.at < end {
            let first = reader.varint()?;
            if matches!(kind, Kind::Packed) {
                continue;
            }
            let (field, wire_type) = (first >> 3, first & 7);
            match wire_type {
                0 => drop(reader.varint()?),
                1 => reader.skip(8)?,
                5 => reader.skip(4)?,
                2 => {
                    let length = reader.varint()?;
                    let start = reader.at;
                    reader.skip(length)?;
                    if let (Kind::Tensor, 13) = (kind, field) {
                        entry(&bytes[start..reader.at]);
                    }
                    if let Some(kind) = child(kind, field) {
                        pending.push((kind, start, reader.at, depth + 1));
                    }
                }
                _ => return Err(damage("a field of an unknown kind", reader.at)),
            }
        }
    }
    Ok(())
}

fn damage(what: &str, at: usize) -> OnnxError {
    OnnxError::Load(format!("{what}, at byte {at}"))
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn varint(&mut self) -> Result<u64, OnnxError> {
        let mut value = 0;
        for k in 0..10 {
            let byte =
                *self.bytes.get(self.at).ok_or_else(|| damage("the end of a message within a number", self.at))?;
            self.at += 1;
            value |= u64::from(byte & 0x7f) << (7 * k);
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(damage("a number of more than ten bytes", self.at))
    }

    fn skip(&mut self, length: u64) -> Result<(), OnnxError> {
        let left = self.bytes.len() - self.at;
        match usize::try_from(length) {
            Ok(length) if length <= left => {
                self.at += length;
                Ok(())
            }
            _ => Err(damage(&format!("a field of {length} bytes where {left} are left"), self.at)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn damage_is_named() {
        let found = |bytes: &[u8]| scan(bytes).map_err(|error| error.to_string());
        // Field 1, a varint: 8.
        assert_eq!(found(&[0x08, 0x08]), Ok(()));
        assert!(found(&[0x08]).unwrap_err().states("message 1"));
        assert!(found(&[0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]).is_err());
        // A graph (field 7) of 9 bytes, of which 1 is there.
        assert!(found(&[0x3a, 0x09, 0x00]).unwrap_err().states("field 9 1"));
        assert!(found(&[0x0b]).unwrap_err().states("unknown"));
        // A number of eleven bytes in the dimensions of an initialiser: model, graph, tensor, packed numbers.
        let numbers = [0xff; 11];
        let wrap = |field: u8, inner: &[u8]| [&[field << 3 | 2, inner.len() as u8], inner].concat();
        assert!(found(&wrap(7, &wrap(5, &wrap(1, &numbers)))).unwrap_err().states("bytes"));
        // The same bytes are raw numbers in field 9.
        assert_eq!(found(&wrap(7, &wrap(5, &wrap(9, &numbers)))), Ok(()));
        let mut nested = Vec::new();
        for _ in 0..12 {
            nested = wrap(1, &wrap(5, &wrap(6, &nested)));
        }
        assert!(found(&wrap(7, &nested)).unwrap_err().states("nested"));
    }
}
