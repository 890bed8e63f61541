//! Accessors of glTF 2.0: numbers in the buffers, held against its length before they are read.

use crate::SplatError;
use crate::cursor::f32_at;
use crate::error::off;
use serde_json::Value;
use std::borrow::Cow;

/// Types of items with one to four components.
pub const TYPES: [&str; 4] = ["SCALAR", "VEC2", "VEC3", "VEC4"];

/// Where the numbers of an attribute are.
#[derive(Debug, Clone, Copy)]
pub struct Accessor<'a> {
    bytes: &'a [u8],
    /// Items.
    pub count: usize,
    stride: usize,
    component: u64,
    normalised: bool,
    width: usize,
}

/// A number of the document; `None` when it is absent.
pub fn number(value: &Value, key: &str, place: &str) -> Result<Option<u64>, SplatError> {
    match value.get(key) {
        None => Ok(None),
        Some(found) => match found.as_u64() {
            Some(number) => Ok(Some(number)),
            None => Err(off(format!("{place}, {key}"), "a number that is not negative", found)),
        },
    }
}

/// An entry of one of the document's lists.
pub fn entry<'v>(document: &'v Value, list: &str, index: u64) -> Result<&'v Value, SplatError> {
    let items = document.get(list).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let found = usize::try_from(index).ok().and_then(|index| items.get(index));
    found.ok_or_else(|| off(format!("glTF {list}"), format!("index below {}", items.len()), index))
}

impl<'a> Accessor<'a> {
    /// Accessor `index` of `document`, whose items have `width` components.
    ///
    /// # Errors
    /// Names what is off: index, type, data in no buffer, or beyond its end.
    pub fn new(document: &Value, buffers: &'a [Cow<'a, [u8]>], index: u64, width: usize) -> Result<Self, SplatError> {
        let place = format!("glTF accessor {index}");
        let accessor = entry(document, "accessors", index)?;
        let expected = TYPES[width - 1];
        let kind = accessor.get("type").and_then(Value::as_str).unwrap_or("nothing");
        if kind != expected {
            return Err(off(format!("{place}, type"), expected, kind));
        }
        if accessor.get("sparse").is_some() {
            return Err(off(place, "numbers that are all there", "a sparse accessor"));
        }
        let get = |value: &Value, key: &str| number(value, key, &place);
        let component = get(accessor, "componentType")?.unwrap_or(0);
        let size = match component {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            5126 => 4,
            found => return Err(off(format!("{place}, componentType"), "5120 to 5123 or 5126", found)),
        };
        let view = get(accessor, "bufferView")?.ok_or_else(|| off(&*place, "a bufferView", "none"))?;
        let view = entry(document, "bufferViews", view)?;
        let buffer = get(view, "buffer")?.unwrap_or(0);
        let binary: &[u8] = usize::try_from(buffer)
            .ok()
            .and_then(|at| buffers.get(at))
            .ok_or_else(|| off(&*place, format!("a buffer below {}", buffers.len()), buffer))?;
        let item = (width * size) as u64;
        let count = get(accessor, "count")?.unwrap_or(0);
        let stride = get(view, "byteStride")?.unwrap_or(item);
        let start = u128::from(get(view, "byteOffset")?.unwrap_or(0));
        let end_of_view = start + u128::from(get(view, "byteLength")?.unwrap_or(0));
        let first = start + u128::from(get(accessor, "byteOffset")?.unwrap_or(0));
        if stride < item {
            return Err(off(format!("{place}, byteStride"), format!("at least {item}"), stride));
        }
        let last = match count {
            0 => first,
            _ => first + u128::from(count - 1) * u128::from(stride) + u128::from(item),
        };
        let limit = end_of_view.min(binary.len() as u128);
        if last > limit {
            let place = format!("{place}, {count} items of {stride} bytes");
            let narrow = |x: u128| u64::try_from(x).unwrap_or(u64::MAX);
            let (expected, found) = (narrow(last - first), narrow(limit.saturating_sub(first)));
            return Err(SplatError::CutOff { place, byte: narrow(first), expected, found });
        }
        let normalised = accessor.get("normalized").and_then(Value::as_bool).unwrap_or(false);
        let bytes = &binary[first as usize..last as usize];
        Ok(Self { bytes, count: count as usize, stride: stride as usize, component, normalised, width })
    }

    /// The first `N` components of an item.
    pub fn get<const N: usize>(&self, item: usize) -> [f32; N] {
        std::array::from_fn(|k| if k < self.width { self.component(item, k) } else { 0.0 })
    }

    /// One component; integers that are normalised become fractions of their largest (glTF 2.0, section 3.6.2.2).
    fn component(&self, item: usize, k: usize) -> f32 {
        let at = item * self.stride;
        let (value, most) = match self.component {
            5120 => (f32::from(self.bytes[at + k] as i8), 127.0),
            5121 => (f32::from(self.bytes[at + k]), 255.0),
            5122 => (f32::from(i16::from_le_bytes([self.bytes[at + 2 * k], self.bytes[at + 2 * k + 1]])), 32767.0),
            5123 => (f32::from(u16::from_le_bytes([self.bytes[at + 2 * k], self.bytes[at + 2 * k + 1]])), 65535.0),
            _ => return f32_at(self.bytes, at + 4 * k),
        };
        if self.normalised { (value / most).max(-1.0) } else { value }
    }
}
