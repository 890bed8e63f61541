//! The wire format of protobuf, as far as writing an ONNX file needs it: fields of type varint, 32 bits, and bytes.
//!
//! Source: Protocol Buffers documentation, *Encoding*. A field is a tag `number << 3 | wire type`, then its value; a
//! message within a message is a field of bytes.

/// A message that grows field by field.
#[derive(Debug, Default, Clone)]
pub(crate) struct Message {
    bytes: Vec<u8>,
}

const VARINT: u64 = 0;
const BYTES: u64 = 2;
const FIXED_32: u64 = 5;

impl Message {
    /// Bytes of the message so far.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Seven bits a byte, least first; the high bit says that more follow.
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.bytes.push((value & 0x7f) as u8 | 0x80);
            value >>= 7;
        }
        self.bytes.push(value as u8);
    }

    fn tag(&mut self, field: u64, wire_type: u64) {
        self.varint(field << 3 | wire_type);
    }

    /// A field of type int32, int64 or enum. Negative numbers take ten bytes, as the format says.
    pub fn integer(&mut self, field: u64, value: i64) {
        self.tag(field, VARINT);
        self.varint(value as u64);
    }

    /// A field of type float.
    pub fn float(&mut self, field: u64, value: f32) {
        self.tag(field, FIXED_32);
        self.bytes.extend(value.to_le_bytes());
    }

    /// A field of type bytes or string.
    pub fn bytes(&mut self, field: u64, value: &[u8]) {
        self.tag(field, BYTES);
        self.varint(value.len() as u64);
        self.bytes.extend(value);
    }

    /// A field that is a message of its own.
    pub fn message(&mut self, field: u64, value: &Message) {
        self.bytes(field, &value.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_of_the_documentation() {
        // `message Test1 { int32 a = 1; }` with 150; `message Test2 { string b = 2; }` with "testing"; Test1 in field 3.
        let mut one = Message::default();
        one.integer(1, 150);
        assert_eq!(one.clone().into_bytes(), [0x08, 0x96, 0x01]);
        let mut two = Message::default();
        two.bytes(2, b"testing");
        assert_eq!(two.into_bytes(), [0x12, 0x07, 0x74, 0x65, 0x73, 0x74, 0x69, 0x6e, 0x67]);
        let mut three = Message::default();
        three.message(3, &one);
        assert_eq!(three.into_bytes(), [0x1a, 0x03, 0x08, 0x96, 0x01]);
    }

    #[test]
    fn negative_integers_take_ten_bytes() {
        let mut message = Message::default();
        message.integer(1, -2);
        let expected = [0x08, 0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01];
        assert_eq!(message.into_bytes(), expected);
    }

    #[test]
    fn floats_are_little_endian() {
        let mut message = Message::default();
        message.float(2, 1.0);
        assert_eq!(message.into_bytes(), [0x15, 0, 0, 0x80, 0x3f]);
    }
}
