//! The container of glTF 2.0, GLB: a header and two chunks.

use super::format::{Beside, is_json};
use crate::SplatError;
use crate::captures::json;
use crate::cursor::Cursor;
use crate::error::off;
use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde_json::Value;
use std::borrow::Cow;

/// The document and the binary chunk, which is empty when there is none; of glTF as JSON, the document.
pub fn open(bytes: &[u8]) -> Result<(Value, &[u8]), SplatError> {
    if is_json(bytes) {
        return Ok((json::parse(bytes, "glTF")?, &bytes[..0]));
    }
    let mut cursor = Cursor::new(bytes, "GLB");
    if cursor.take(4, "header")? != b"glTF" {
        return Err(off("GLB header, byte 0", "glTF", "something else"));
    }
    let (version, length) = (cursor.u32("header")?, cursor.u32("header")?);
    if version != 2 {
        return Err(off("GLB header, byte 4", "version 2", version));
    }
    if length as usize != bytes.len() {
        return Err(off("GLB header, byte 8", format!("{} bytes, as the file has", bytes.len()), length));
    }
    let (mut document, mut binary) = (None, &bytes[..0]);
    while cursor.left() > 0 {
        let size = cursor.u32("chunk")?;
        let kind = cursor.take(4, "chunk")?;
        let chunk = cursor.take(u64::from(size), "chunk")?;
        match kind {
            b"JSON" if document.is_none() => {
                let parsed = serde_json::from_slice::<Value>(chunk);
                document = Some(parsed.map_err(|error| off("GLB, chunk JSON", "JSON", error))?);
            }
            b"BIN\0" if binary.is_empty() => binary = chunk,
            // Chunks of other kinds are to be passed over.
            _ => {}
        }
    }
    let document = document.ok_or_else(|| off("GLB", "a chunk JSON", "none"))?;
    Ok((document, binary))
}

/// Bytes of each buffer of a document: the chunk of a GLB, a `data:` URI's own, or a file's beside it.
///
/// # Errors
/// A buffer has no bytes, no Base64, fewer bytes than the document says, or its file is missing.
pub fn buffers<'a>(document: &Value, chunk: &'a [u8], beside: Beside) -> Result<Vec<Cow<'a, [u8]>>, SplatError> {
    let list = document.get("buffers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let one = |(index, buffer): (usize, &Value)| {
        let place = || format!("glTF buffer {index}");
        let bytes = match buffer.get("uri").and_then(Value::as_str) {
            // The chunk of a GLB is the first buffer, and only that (glTF 2.0, section 4.4.3.3).
            None if index == 0 => Cow::Borrowed(chunk),
            None => return Err(off(place(), "a uri", "none")),
            Some(uri) => Cow::Owned(match uri.strip_prefix("data:") {
                Some(data) => {
                    let text = data.split_once(";base64,").map(|(_, text)| text);
                    let text = text.ok_or_else(|| off(place(), "Base64 in its data: URI", "another encoding"))?;
                    BASE64.decode(text.trim_end_matches('=')).map_err(|e| off(place(), "Base64", e))?
                }
                None => beside(&plain_name(uri)).map_err(|found| off(place(), format!("file {uri}"), found))?,
            }),
        };
        let length = buffer.get("byteLength").and_then(Value::as_u64).unwrap_or(0);
        if (bytes.len() as u64) < length {
            let found = bytes.len() as u64;
            return Err(SplatError::CutOff { place: place(), byte: 0, expected: length, found });
        }
        Ok(bytes)
    };
    list.iter().enumerate().map(one).collect()
}

/// Base64 whose padding may be missing.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::RequireNone),
);

/// A file of both chunks, each padded to four bytes as the format demands.
pub fn close(document: &Value, mut binary: Vec<u8>) -> Result<Vec<u8>, SplatError> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = 12 + 8 + text.len() + 8 + binary.len();
    let found = length as u64;
    let place = "GLB, bytes".to_string();
    let length = u32::try_from(length).map_err(|_| SplatError::TooLarge { place, limit: u32::MAX.into(), found })?;
    let mut out = Vec::with_capacity(length as usize);
    out.extend(b"glTF\x02\0\0\0");
    out.extend(length.to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &binary)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    Ok(out)
}
/// The name that a relative URI means: `%20` is a blank (RFC 3986, section 2.1). What is no escape stays as it is.
fn plain_name(uri: &str) -> String {
    let digit = |b: Option<&u8>| b.and_then(|b| char::from(*b).to_digit(16));
    let (all, mut name, mut k) = (uri.as_bytes(), Vec::new(), 0);
    while let Some(&byte) = all.get(k) {
        match (byte, digit(all.get(k + 1)), digit(all.get(k + 2))) {
            (b'%', Some(high), Some(low)) => {
                name.push((16 * high + low) as u8);
                k += 3;
            }
            _ => {
                name.push(byte);
                k += 1;
            }
        }
    }
    String::from_utf8(name).unwrap_or_else(|_| uri.to_string())
}
