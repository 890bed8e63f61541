//! CDR (the plain encoding of ROS 2, XCDR1): reading primitives, decoding whole messages, and writing.
//!
//! A message starts with four bytes of encapsulation (representation, options); alignment counts from after them.
//! Source: OMG DDS-XTypes 1.3, clause 7.4.

use crate::RecordingError;
use crate::schema::{Arity, Element, Field, Primitive, Schema};

/// A decoded value of any message.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)]
pub enum Value {
    Bool(bool),
    Unsigned(u64),
    Signed(i64),
    Float(f64),
    String(String),
    /// A sequence or array of bytes.
    Bytes(Vec<u8>),
    Array(Vec<Value>),
    /// Fields in the order of the definition.
    Message(Vec<(String, Value)>),
}

impl Value {
    /// The field at a dotted path such as `pose.position.x`.
    pub fn get(&self, path: &str) -> Option<&Value> {
        path.split('.').try_fold(self, |value, name| match value {
            Value::Message(fields) => fields.iter().find(|(n, _)| n == name).map(|(_, v)| v),
            _ => None,
        })
    }

    /// As a number, when it is one.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Value::Bool(b) => Some(f64::from(u8::from(*b))),
            Value::Unsigned(n) => Some(*n as f64),
            Value::Signed(n) => Some(*n as f64),
            Value::Float(x) => Some(*x),
            _ => None,
        }
    }
}

/// A cursor over the bytes of one message.
#[derive(Debug, Clone)]
pub(crate) struct Cursor<'a> {
    body: &'a [u8],
    at: usize,
    big_endian: bool,
    /// Elements that may still be visited: arrays of messages without bytes would otherwise multiply without end.
    budget: usize,
}

/// Bytes before the body: representation identifier and options.
const ENCAPSULATION: usize = 4;

impl<'a> Cursor<'a> {
    /// Reads the encapsulation header.
    pub(crate) fn new(message: &'a [u8]) -> Result<Self, RecordingError> {
        let Some((header, body)) = message.split_at_checked(ENCAPSULATION) else {
            let found = format!("{} bytes", message.len());
            return Err(RecordingError::cdr("encapsulation", 0, "4 bytes", found));
        };
        let big_endian = match (header[0], header[1]) {
            (0, 0) => true,
            (0, 1) => false,
            (a, b) => {
                let found = format!("representation {a:02x} {b:02x}");
                return Err(RecordingError::cdr("encapsulation", 0, "plain CDR (00 00 or 00 01)", found));
            }
        };
        Ok(Self { body, at: 0, big_endian, budget: 1024 + 4 * body.len() })
    }

    pub(crate) fn offset(&self) -> usize {
        self.at + ENCAPSULATION
    }

    pub(crate) fn remaining(&self) -> usize {
        self.body.len().saturating_sub(self.at)
    }

    /// Counts one visited element.
    pub(crate) fn visit(&mut self, field: &str) -> Result<(), RecordingError> {
        let Some(left) = self.budget.checked_sub(1) else {
            return Err(RecordingError::cdr(
                field,
                self.offset(),
                "elements that take bytes",
                "endless empty elements",
            ));
        };
        self.budget = left;
        Ok(())
    }

    /// Skips `count` elements of `size` bytes, aligned; nothing is aligned when there is none.
    #[inline]
    pub(crate) fn take(&mut self, size: usize, count: usize, field: &str) -> Result<&'a [u8], RecordingError> {
        if count == 0 {
            return Ok(&[]);
        }
        let start = self.at.next_multiple_of(size);
        let end = size.checked_mul(count).and_then(|n| start.checked_add(n));
        match end.and_then(|end| self.body.get(start..end)) {
            Some(bytes) => {
                self.at = start + bytes.len();
                Ok(bytes)
            }
            None => Err(RecordingError::cdr(
                field,
                self.offset(),
                format!("{count} x {size} bytes"),
                format!("{} bytes left", self.remaining()),
            )),
        }
    }

    pub(crate) fn u32(&mut self, field: &str) -> Result<u32, RecordingError> {
        let bytes: [u8; 4] = self.take(4, 1, field)?.try_into().expect("four bytes were taken");
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// The length of a sequence, refused when so many elements of at least `least` bytes cannot follow.
    pub(crate) fn sequence(
        &mut self,
        bound: Option<usize>,
        least: usize,
        field: &str,
    ) -> Result<usize, RecordingError> {
        let offset = self.offset();
        let count = self.u32(field)? as usize;
        if let Some(bound) = bound.filter(|&b| count > b) {
            return Err(RecordingError::cdr(field, offset, format!("at most {bound} elements"), count.to_string()));
        }
        if count.saturating_mul(least) > self.remaining() {
            let expected = format!("a sequence that fits the {} bytes left", self.remaining());
            return Err(RecordingError::cdr(field, offset, expected, format!("a claim of {count} elements")));
        }
        Ok(count)
    }

    /// The bytes of a string, without the terminating zero.
    pub(crate) fn string(&mut self, field: &str) -> Result<&'a [u8], RecordingError> {
        let count = self.sequence(None, 1, field)?;
        let bytes = self.take(1, count, field)?;
        Ok(bytes.strip_suffix(&[0]).unwrap_or(bytes))
    }

    /// One number as f64 (64-bit integers beyond 2^53 are rounded).
    #[inline]
    pub(crate) fn number(&self, primitive: Primitive, bytes: &[u8]) -> f64 {
        macro_rules! read {
            ($t:ty) => {{
                let bytes = bytes.try_into().expect("as many bytes as the type has");
                (if self.big_endian { <$t>::from_be_bytes(bytes) } else { <$t>::from_le_bytes(bytes) }) as f64
            }};
        }
        match primitive {
            Primitive::Bool | Primitive::U8 => f64::from(bytes[0]),
            Primitive::I8 => f64::from(bytes[0] as i8),
            Primitive::U16 => read!(u16),
            Primitive::I16 => read!(i16),
            Primitive::U32 => read!(u32),
            Primitive::I32 => read!(i32),
            Primitive::U64 => read!(u64),
            Primitive::I64 => read!(i64),
            Primitive::F32 => read!(f32),
            Primitive::F64 => read!(f64),
            Primitive::String | Primitive::WString => f64::NAN,
        }
    }

    fn exact(&self, primitive: Primitive, bytes: &[u8]) -> Value {
        match primitive {
            Primitive::Bool => Value::Bool(bytes[0] != 0),
            Primitive::U64 => Value::Unsigned(self.integer(bytes)),
            Primitive::I64 => Value::Signed(self.integer(bytes) as i64),
            Primitive::U8 | Primitive::U16 | Primitive::U32 => Value::Unsigned(self.number(primitive, bytes) as u64),
            Primitive::I8 | Primitive::I16 | Primitive::I32 => Value::Signed(self.number(primitive, bytes) as i64),
            _ => Value::Float(self.number(primitive, bytes)),
        }
    }

    fn integer(&self, bytes: &[u8]) -> u64 {
        let bytes: [u8; 8] = bytes.try_into().expect("eight bytes");
        if self.big_endian { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) }
    }
}

/// Decodes a whole message into a tree.
///
/// # Errors
/// [`RecordingError::Cdr`] names field, byte, and what was there: bytes that end early, claims of more elements than can
/// follow, `wstring` (whose encoding differs between vendors), an encapsulation other than plain CDR.
pub fn decode(schema: &Schema, message: &[u8]) -> Result<Value, RecordingError> {
    let mut cursor = Cursor::new(message)?;
    decode_message(schema, 0, &mut cursor)
}

fn decode_message(schema: &Schema, index: usize, cursor: &mut Cursor) -> Result<Value, RecordingError> {
    let message = &schema.types[index];
    if message.fields.is_empty() {
        // An empty message carries one byte, since its C structure must have a member.
        cursor.take(1, 1, &message.name)?;
    }
    let fields = message.fields.iter().map(|field| Ok((field.name.clone(), decode_field(schema, field, cursor)?)));
    Ok(Value::Message(fields.collect::<Result<_, RecordingError>>()?))
}

fn decode_field(schema: &Schema, field: &Field, cursor: &mut Cursor) -> Result<Value, RecordingError> {
    let count = match field.arity {
        Arity::One => return decode_element(schema, field, cursor),
        Arity::Array(count) if count > cursor.remaining() => {
            let found = format!("{} bytes left", cursor.remaining());
            return Err(RecordingError::cdr(&field.name, cursor.offset(), format!("{count} elements"), found));
        }
        Arity::Array(count) => count,
        Arity::Sequence(bound) => cursor.sequence(bound, 1, &field.name)?,
    };
    if field.element == Element::Primitive(Primitive::U8) {
        return Ok(Value::Bytes(cursor.take(1, count, &field.name)?.to_vec()));
    }
    (0..count).map(|_| decode_element(schema, field, cursor)).collect::<Result<_, _>>().map(Value::Array)
}

fn decode_element(schema: &Schema, field: &Field, cursor: &mut Cursor) -> Result<Value, RecordingError> {
    cursor.visit(&field.name)?;
    match field.element {
        Element::Message(index) => decode_message(schema, index, cursor),
        Element::Primitive(Primitive::WString) => Err(wstring(&field.name, cursor.offset())),
        Element::Primitive(Primitive::String) => {
            Ok(Value::String(String::from_utf8_lossy(cursor.string(&field.name)?).into_owned()))
        }
        Element::Primitive(primitive) => {
            let size = primitive.size().expect("strings were handled");
            let bytes = cursor.take(size, 1, &field.name)?;
            Ok(cursor.exact(primitive, bytes))
        }
    }
}

pub(crate) fn wstring(field: &str, offset: usize) -> RecordingError {
    RecordingError::cdr(field, offset, "any type but wstring", "wstring, whose encoding differs between vendors")
}

/// Writes little-endian CDR. Fields are written in the order of the definition; alignment is kept.
#[derive(Debug, Clone)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Default for Writer {
    fn default() -> Self {
        Self::new()
    }
}

impl Writer {
    /// Starts a message with its encapsulation header.
    pub fn new() -> Self {
        Self { bytes: vec![0, 1, 0, 0] }
    }

    fn aligned(&mut self, bytes: &[u8]) -> &mut Self {
        while !(self.bytes.len() - ENCAPSULATION).is_multiple_of(bytes.len()) {
            self.bytes.push(0);
        }
        self.bytes.extend_from_slice(bytes);
        self
    }

    /// One byte: `uint8`, `byte`, `char`, `bool`.
    pub fn u8(&mut self, x: u8) -> &mut Self {
        self.aligned(&[x])
    }

    /// `int16`.
    pub fn i16(&mut self, x: i16) -> &mut Self {
        self.aligned(&x.to_le_bytes())
    }

    /// `uint16`.
    pub fn u16(&mut self, x: u16) -> &mut Self {
        self.aligned(&x.to_le_bytes())
    }

    /// `int32`.
    pub fn i32(&mut self, x: i32) -> &mut Self {
        self.aligned(&x.to_le_bytes())
    }

    /// `uint32`, also the length of a sequence.
    pub fn u32(&mut self, x: u32) -> &mut Self {
        self.aligned(&x.to_le_bytes())
    }

    /// `float32`.
    pub fn f32(&mut self, x: f32) -> &mut Self {
        self.aligned(&x.to_le_bytes())
    }

    /// `float64`.
    pub fn f64(&mut self, x: f64) -> &mut Self {
        self.aligned(&x.to_le_bytes())
    }

    /// `string`.
    pub fn string(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.u8(0)
    }

    /// A sequence of `float64`.
    pub fn f64_sequence(&mut self, values: &[f64]) -> &mut Self {
        self.u32(values.len() as u32);
        values.iter().for_each(|&x| {
            self.f64(x);
        });
        self
    }

    /// `builtin_interfaces/Time` from nanoseconds since the epoch.
    pub fn time(&mut self, nanoseconds: u64) -> &mut Self {
        self.i32((nanoseconds / 1_000_000_000) as i32).u32((nanoseconds % 1_000_000_000) as u32)
    }

    /// The message.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }
}
