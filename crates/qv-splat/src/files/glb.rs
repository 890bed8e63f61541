//! The container of glTF 2.0, GLB: a header and two chunks.

use crate::SplatError;
use crate::cursor::Cursor;
use crate::error::off;
use serde_json::Value;

/// The document and the binary chunk, which is empty when there is none.
pub fn open(bytes: &[u8]) -> Result<(Value, &[u8]), SplatError> {
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
