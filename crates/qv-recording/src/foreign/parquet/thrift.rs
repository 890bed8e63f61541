//! Thrift's compact protocol (apache/thrift, `doc/specs/thrift-compact-protocol.md`), in which Parquet writes what is no data.

/// Structures inside each other that are followed.
const DEEPEST: usize = 32;

/// A value; of a structure its fields by number.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'a> {
    Bool(bool),
    Int(i64),
    Bytes(&'a [u8]),
    List(Vec<Value<'a>>),
    Struct(Vec<(i16, Value<'a>)>),
    /// A floating-point number or a map, of which Parquet needs none here.
    Other,
}

impl<'a> Value<'a> {
    /// The structure at the front of bytes, and how many it takes.
    pub fn read(bytes: &'a [u8]) -> Result<(Self, usize), String> {
        let mut reader = Reader { bytes, at: 0 };
        let value = reader.value(12, 0)?;
        Ok((value, reader.at))
    }

    /// A field of a structure.
    pub fn field(&self, number: i16) -> Option<&Self> {
        match self {
            Self::Struct(fields) => fields.iter().find(|(known, _)| *known == number).map(|(_, value)| value),
            _ => None,
        }
    }

    /// A field that is a whole number.
    pub fn int(&self, number: i16) -> Option<i64> {
        match self.field(number) {
            Some(Self::Int(value)) => Some(*value),
            _ => None,
        }
    }

    /// A field that is a whole number and no less than 0.
    pub fn count(&self, number: i16) -> Option<usize> {
        self.int(number).and_then(|value| usize::try_from(value).ok())
    }

    /// A field that is a list; an empty one where there is none.
    pub fn list(&self, number: i16) -> &[Self] {
        match self.field(number) {
            Some(Self::List(list)) => list,
            _ => &[],
        }
    }

    /// A field that is text.
    pub fn text(&self, number: i16) -> Option<&'a str> {
        match self.field(number) {
            Some(Self::Bytes(bytes)) => std::str::from_utf8(bytes).ok(),
            _ => None,
        }
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn byte(&mut self) -> Result<u8, String> {
        let byte = self.bytes.get(self.at).copied().ok_or("a description that is cut off")?;
        self.at += 1;
        Ok(byte)
    }

    fn take(&mut self, count: u64) -> Result<&'a [u8], String> {
        let end = usize::try_from(count).ok().and_then(|count| self.at.checked_add(count));
        let taken = end.and_then(|end| self.bytes.get(self.at..end)).ok_or("a description that is cut off")?;
        self.at += taken.len();
        Ok(taken)
    }

    fn varint(&mut self) -> Result<u64, String> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 127) << shift;
            if byte < 128 {
                return Ok(value);
            }
        }
        Err("a number of more than 64 bits".into())
    }

    fn zigzag(&mut self) -> Result<i64, String> {
        let value = self.varint()?;
        Ok((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// A value of a type, as the elements of lists have it.
    fn value(&mut self, kind: u8, depth: usize) -> Result<Value<'a>, String> {
        if depth > DEEPEST {
            return Err(format!("more than {DEEPEST} structures inside each other"));
        }
        Ok(match kind {
            1 | 2 => Value::Bool(self.byte()? == 1),
            3 => Value::Int(i64::from(self.byte()? as i8)),
            4..=6 => Value::Int(self.zigzag()?),
            7 => {
                self.take(8)?;
                Value::Other
            }
            8 => {
                let length = self.varint()?;
                Value::Bytes(self.take(length)?)
            }
            9 | 10 => {
                let head = self.byte()?;
                let count = if head >> 4 == 15 { self.varint()? } else { u64::from(head >> 4) };
                let mut list = Vec::new();
                // Each element takes a byte at least, so that the bytes end a false claim.
                for _ in 0..count {
                    list.push(self.value(head & 15, depth + 1)?);
                }
                Value::List(list)
            }
            11 => {
                let count = self.varint()?;
                let kinds = if count > 0 { self.byte()? } else { 0 };
                for _ in 0..count {
                    self.value(kinds >> 4, depth + 1)?;
                    self.value(kinds & 15, depth + 1)?;
                }
                Value::Other
            }
            12 => self.structure(depth)?,
            other => return Err(format!("type {other} of Thrift")),
        })
    }

    fn structure(&mut self, depth: usize) -> Result<Value<'a>, String> {
        let (mut fields, mut number) = (Vec::new(), 0i16);
        loop {
            let head = self.byte()?;
            let kind = head & 15;
            if kind == 0 {
                return Ok(Value::Struct(fields));
            }
            number = match head >> 4 {
                0 => self.zigzag()? as i16,
                step => number.wrapping_add(i16::from(step)),
            };
            // A field's truth is its type.
            let value = if kind < 3 { Value::Bool(kind == 1) } else { self.value(kind, depth + 1)? };
            fields.push((number, value));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn a_structure_is_read_field_by_field() {
        // 1: true, 2: -3, 4: [5, 6], 5: "hi", 20: {1: 7}.
        let bytes = [0x11, 0x15, 5, 0x29, 0x25, 10, 12, 0x18, 2, b'h', b'i', 0x0c, 40, 0x15, 14, 0, 0, 99];
        let (value, length) = Value::read(&bytes).unwrap();
        assert_eq!((value.field(1), value.int(2), value.text(5)), (Some(&Value::Bool(true)), Some(-3), Some("hi")));
        assert_eq!((value.list(4), length), (&[Value::Int(5), Value::Int(6)][..], 17));
        assert_eq!(value.field(20).and_then(|inner| inner.count(1)), Some(7));
        assert_eq!((value.count(2), value.field(3)), (None, None));
        for length in 0..16 {
            assert!(Value::read(&bytes[..length]).is_err(), "{length}");
        }
        assert!(Value::read(&[0x1c; 100]).unwrap_err().states("inside"));
        assert!(Value::read(&[0x19, 0xf5, 0xff, 0xff, 0xff, 0xff, 0x0f]).unwrap_err().states("cut"));
    }
}
