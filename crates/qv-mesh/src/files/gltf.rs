//! The part of glTF 2.0 that a terrain needs: the document of a GLB, its nodes, and its accessors, which are held against the bytes
//! that are there before they are read.

use crate::MeshError;
use crate::error::off;
use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;

const PLACE: &str = "GLB";
/// Component types.
const U8: u64 = 5121;
const U16: u64 = 5123;
const U32: u64 = 5125;
const F32: u64 = 5126;

/// A GLB: its document and its own buffer.
pub struct Document<'a> {
    json: Value,
    buffer: &'a [u8],
}

/// The numbers of an accessor as they lie in the file.
struct Items<'a> {
    bytes: &'a [u8],
    count: usize,
    stride: usize,
    component: u64,
}

impl<'a> Document<'a> {
    /// # Errors
    /// Says what is no GLB of version 2.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, MeshError> {
        let wrong = |found: String| off(PLACE, "a GLB file", found);
        let header = bytes.get(..12).filter(|header| header.starts_with(b"glTF"));
        let header = header.ok_or_else(|| wrong("other bytes".into()))?;
        let (version, length) = (u32_at(header, 4), u32_at(header, 8) as usize);
        if version != 2 {
            return Err(wrong(format!("version {version}")));
        }
        let mut rest = bytes.get(12..length).ok_or_else(|| wrong(format!("{} bytes of {length}", bytes.len())))?;
        let (mut json, mut buffer) = (None, &bytes[..0]);
        while let Some((head, after)) = rest.split_at_checked(8) {
            let size = u32_at(head, 0) as usize;
            let cut = || wrong(format!("a chunk of {size} bytes where {} are left", after.len()));
            let (chunk, after) = after.split_at_checked(size).ok_or_else(cut)?;
            match &head[4..] {
                b"JSON" if json.is_none() => {
                    json = Some(serde_json::from_slice(chunk).map_err(|e| wrong(e.to_string()))?)
                }
                b"BIN\0" if buffer.is_empty() => buffer = chunk,
                // Chunks of other kinds are to be passed over.
                _ => {}
            }
            rest = after;
        }
        if !rest.is_empty() {
            return Err(wrong(format!("{} bytes after the last chunk", rest.len())));
        }
        let json = json.ok_or_else(|| wrong("no chunk JSON".into()))?;
        Ok(Self { json, buffer })
    }

    /// A list of the document; empty where there is none.
    pub fn list(&self, name: &str) -> &[Value] {
        list(&self.json, name)
    }

    /// The scene that is shown.
    ///
    /// # Errors
    /// There is none.
    pub fn scene(&self) -> Result<&Value, MeshError> {
        match number(&self.json, "scene")? {
            Some(index) => self.entry("scenes", index),
            None => self.list("scenes").first().ok_or_else(|| off(PLACE, "a scene", "none")),
        }
    }

    /// # Errors
    /// There is no such entry.
    pub fn entry(&self, name: &str, index: usize) -> Result<&Value, MeshError> {
        let all = self.list(name);
        all.get(index).ok_or_else(|| off(format!("{PLACE}, {name}"), format!("an index below {}", all.len()), index))
    }

    /// Positions of an accessor of three floats.
    ///
    /// # Errors
    /// Says what is no position, or lies beyond the file's own buffer.
    pub fn positions(&self, accessor: usize) -> Result<Vec<DVec3>, MeshError> {
        let items = self.items(accessor, "VEC3", &[(F32, 12)])?;
        let one = |k: usize| {
            let item = &items.bytes[k * items.stride..];
            let float = |at: usize| f64::from(f32::from_bits(u32_at(item, at)));
            DVec3::new(float(0), float(4), float(8))
        };
        Ok((0..items.count).map(one).collect())
    }

    /// Vertex indices of an accessor of whole numbers.
    ///
    /// # Errors
    /// As [`Document::positions`].
    pub fn indices(&self, accessor: usize) -> Result<Vec<u32>, MeshError> {
        let items = self.items(accessor, "SCALAR", &[(U8, 1), (U16, 2), (U32, 4)])?;
        let one = |k: usize| {
            let item = &items.bytes[k * items.stride..];
            match items.component {
                U8 => u32::from(item[0]),
                U16 => u32::from(u16::from_le_bytes([item[0], item[1]])),
                _ => u32_at(item, 0),
            }
        };
        Ok((0..items.count).map(one).collect())
    }

    /// An accessor of a type, and of one of some component types, each with the bytes of an item.
    fn items(&self, index: usize, kind: &str, components: &[(u64, usize)]) -> Result<Items<'a>, MeshError> {
        let place = format!("{PLACE}, accessor {index}");
        let accessor = self.entry("accessors", index)?;
        let found = accessor.get("type").and_then(Value::as_str).unwrap_or("nothing");
        if found != kind {
            return Err(off(place, format!("type {kind}"), found));
        }
        if accessor.get("sparse").is_some() {
            return Err(off(place, "numbers that are all there", "a sparse accessor"));
        }
        let found = number(accessor, "componentType")?.unwrap_or(0) as u64;
        let known = components.iter().find(|(component, _)| *component == found);
        let &(component, item) = known.ok_or_else(|| {
            let expected: Vec<String> = components.iter().map(|(component, _)| component.to_string()).collect();
            off(&place, format!("componentType {}", expected.join(" or ")), found)
        })?;
        let view = number(accessor, "bufferView")?.ok_or_else(|| off(&place, "a bufferView", "none"))?;
        let view = self.entry("bufferViews", view)?;
        let buffer = number(view, "buffer")?.unwrap_or(0);
        let has_uri = self.list("buffers").first().is_some_and(|first| first.get("uri").is_some());
        if buffer != 0 || has_uri {
            return Err(off(place, "numbers in the file's own buffer", format!("buffer {buffer}")));
        }
        let count = number(accessor, "count")?.unwrap_or(0);
        let stride = number(view, "byteStride")?.unwrap_or(item);
        if stride < item {
            return Err(off(place, format!("a byteStride of at least {item}"), stride));
        }
        // In 128 bits nothing overflows.
        let wide = |value: &Value, key: &str| Ok::<_, MeshError>(number(value, key)?.unwrap_or(0) as u128);
        let start = wide(view, "byteOffset")?;
        let end = (start + wide(view, "byteLength")?).min(self.buffer.len() as u128);
        let first = start + wide(accessor, "byteOffset")?;
        let last = if count == 0 { first } else { first + (count as u128 - 1) * stride as u128 + item as u128 };
        if last > end {
            return Err(off(place, format!("{count} items within {end} bytes"), format!("an end at byte {last}")));
        }
        Ok(Items { bytes: &self.buffer[first as usize..last as usize], count, stride, component })
    }
}

/// A list of an entry; empty where there is none.
pub fn list<'v>(value: &'v Value, name: &str) -> &'v [Value] {
    value.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// A whole number of an entry; `None` where there is none.
///
/// # Errors
/// It is something else.
pub fn number(value: &Value, key: &str) -> Result<Option<usize>, MeshError> {
    value.get(key).map(|found| index(found, key)).transpose()
}

/// # Errors
/// The value is no whole number.
pub fn index(value: &Value, key: &str) -> Result<usize, MeshError> {
    let number = value.as_u64().and_then(|number| usize::try_from(number).ok());
    number.ok_or_else(|| off(format!("{PLACE}, {key}"), "a whole number", value))
}

/// `parent_from_node` of a node.
///
/// # Errors
/// A transform has another number of numbers.
pub fn transform(node: &Value) -> Result<DMat4, MeshError> {
    if node.get("matrix").is_some() {
        return Ok(DMat4::from_cols_array(&numbers(node, "matrix", [0.0; 16])?));
    }
    let scale = DVec3::from_array(numbers(node, "scale", [1.0; 3])?);
    let rotation = DQuat::from_array(numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0])?).normalize();
    let translation = DVec3::from_array(numbers(node, "translation", [0.0; 3])?);
    if !rotation.is_finite() {
        return Err(off(format!("{PLACE}, rotation of a node"), "a quaternion", "zeros"));
    }
    Ok(DMat4::from_scale_rotation_translation(scale, rotation, translation))
}

fn numbers<const N: usize>(node: &Value, key: &str, standard: [f64; N]) -> Result<[f64; N], MeshError> {
    let Some(found) = node.get(key) else { return Ok(standard) };
    let all: Option<Vec<f64>> = found.as_array().and_then(|all| all.iter().map(Value::as_f64).collect());
    let all = all.and_then(|all| <[f64; N]>::try_from(all).ok());
    // Files hold numbers of 32 bits.
    let all = all.map(|all| all.map(|x| f64::from(x as f32)));
    all.ok_or_else(|| off(format!("{PLACE}, {key} of a node"), format!("{N} numbers"), "something else"))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}
