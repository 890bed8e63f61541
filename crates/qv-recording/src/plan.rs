//! A message definition compiled into a plan that reads only the wanted numbers from the bytes.
//!
//! A path names a number field: `header.stamp.sec`, `imu_state.gyroscope` (all elements of the array), or
//! `motor_state[].q` (that field of every element); case and underscores do not count. Building no tree keeps the
//! reader at tens of nanoseconds per field.

use crate::RecordingError;
use crate::cdr::{Cursor, wstring};
use crate::schema::{Arity, Element, Primitive, Schema};

/// Numbers wanted from a message: one path and which elements of it, in the order in which they are put out.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldSelection {
    /// Field path; `[]` marks the array whose elements are picked.
    pub path: String,
    /// Index on the wire of each number put out; `[0]` for a field that is no array.
    pub elements: Vec<usize>,
}

#[derive(Debug, Clone)]
enum Op {
    /// Primitives passed over.
    Skip {
        size: usize,
        count: usize,
    },
    /// Primitives read into the slot.
    Read {
        primitive: Primitive,
        count: Count,
        slot: usize,
    },
    SkipSequence {
        size: usize,
        bound: Option<usize>,
        field: String,
    },
    SkipString {
        field: String,
    },
    WString {
        field: String,
    },
    /// Messages in an array; reads inside pick the element by the loop's index.
    Loop {
        count: Count,
        field: String,
        body: Vec<Op>,
    },
}

#[derive(Debug, Clone, Copy)]
enum Count {
    Fixed(usize),
    Sequence(Option<usize>),
    /// A single number: its element is the index of the loop around it.
    One,
}

/// Where the elements of one path go.
#[derive(Debug, Clone)]
struct Slot {
    path: String,
    /// Output position of each wire index.
    position: Vec<Option<usize>>,
    needed: usize,
}

/// A compiled reader for one message type.
#[derive(Debug, Clone)]
pub struct Plan {
    type_name: String,
    ops: Vec<Op>,
    slots: Vec<Slot>,
    width: usize,
}

/// More operations than this come from a hostile schema: real ones need some hundreds.
const MAX_OPS: usize = 20_000;

impl Plan {
    /// Compiles `schema` for the wanted numbers, which are put out one after the other.
    ///
    /// # Errors
    /// [`RecordingError::Field`] when a path does not lead to numbers, or a fixed array is too short for its elements.
    pub fn compile(schema: &Schema, wanted: &[FieldSelection]) -> Result<Self, RecordingError> {
        let mut offset = 0;
        let mut slots = Vec::new();
        for want in wanted {
            let needed = want.elements.iter().map(|e| e + 1).max().unwrap_or(0);
            let mut position = vec![None; needed];
            for (k, &element) in want.elements.iter().enumerate() {
                position[element] = Some(offset + k);
            }
            offset += want.elements.len();
            slots.push(Slot { path: want.path.clone(), position, needed });
        }
        let mut compiler = Compiler { schema, slots: &slots, found: vec![false; slots.len()], ops: 0 };
        let mut ops = compiler.message(0, "")?;
        let found = compiler.found;
        if let Some(missing) = found.iter().position(|f| !f) {
            return Err(RecordingError::Field {
                type_name: schema.root().name.clone(),
                expected: format!("a number at `{}`", slots[missing].path),
                found: format!("fields {}", names(schema)),
            });
        }
        drop_tail(&mut ops);
        Ok(Self { type_name: schema.root().name.clone(), ops, slots, width: offset })
    }

    /// How many numbers a message gives.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Reads one message into `out`, shape `[width]`.
    ///
    /// # Errors
    /// [`RecordingError::Cdr`] when the bytes end early or claim the impossible; [`RecordingError::Field`] when a sequence has
    /// fewer elements than wanted.
    pub fn read(&self, message: &[u8], out: &mut [f64]) -> Result<(), RecordingError> {
        out.fill(f64::NAN);
        let mut cursor = Cursor::new(message)?;
        self.run(&self.ops, &mut cursor, 0, out)
    }

    fn run(&self, ops: &[Op], cursor: &mut Cursor, index: usize, out: &mut [f64]) -> Result<(), RecordingError> {
        for op in ops {
            match op {
                Op::Skip { size, count } => {
                    cursor.take(*size, *count, &self.type_name)?;
                }
                Op::Read { primitive, count, slot } => {
                    self.read_numbers(cursor, *primitive, *count, *slot, index, out)?
                }
                Op::SkipSequence { size, bound, field } => {
                    let count = cursor.sequence(*bound, *size, field)?;
                    cursor.take(*size, count, field)?;
                }
                Op::SkipString { field } => {
                    cursor.string(field)?;
                }
                Op::WString { field } => return Err(wstring(field, cursor.offset())),
                Op::Loop { count, field, body } => {
                    let count = match count {
                        Count::Fixed(n) => *n,
                        Count::One => 1,
                        Count::Sequence(bound) => {
                            let count = cursor.sequence(*bound, 1, field)?;
                            self.check_loop(body, count)?;
                            count
                        }
                    };
                    for k in 0..count {
                        cursor.visit(field)?;
                        self.run(body, cursor, k, out)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn read_numbers(
        &self,
        cursor: &mut Cursor,
        primitive: Primitive,
        count: Count,
        slot: usize,
        index: usize,
        out: &mut [f64],
    ) -> Result<(), RecordingError> {
        let slot = &self.slots[slot];
        let size = primitive.size().expect("only numbers are compiled into reads");
        let (count, first) = match count {
            Count::One => (1, index),
            Count::Fixed(count) => (count, 0),
            Count::Sequence(bound) => {
                let count = cursor.sequence(bound, size, &slot.path)?;
                self.check_length(slot, count)?;
                (count, 0)
            }
        };
        let bytes = cursor.take(size, count, &slot.path)?;
        for (k, chunk) in bytes.chunks_exact(size).enumerate() {
            if let Some(Some(at)) = slot.position.get(first + k) {
                out[*at] = cursor.number(primitive, chunk);
            }
        }
        Ok(())
    }

    fn check_loop(&self, body: &[Op], count: usize) -> Result<(), RecordingError> {
        for op in body {
            if let Op::Read { count: Count::One, slot, .. } = op {
                self.check_length(&self.slots[*slot], count)?;
            }
        }
        Ok(())
    }

    fn check_length(&self, slot: &Slot, count: usize) -> Result<(), RecordingError> {
        if count >= slot.needed {
            return Ok(());
        }
        Err(too_short(&self.type_name, slot, count))
    }
}

fn too_short(type_name: &str, slot: &Slot, count: usize) -> RecordingError {
    RecordingError::Field {
        type_name: type_name.to_string(),
        expected: format!("at least {} elements at `{}`", slot.needed, slot.path),
        found: count.to_string(),
    }
}

/// Whether two paths name one field. ROS 1 has `tauEst` where ROS 2, which allows lower case alone, has `tau_est`.
fn same_field(a: &str, b: &str) -> bool {
    let letters = |path: &str| path.chars().filter(|c| *c != '_').map(|c| c.to_ascii_lowercase()).collect::<Vec<_>>();
    a == b || letters(a) == letters(b)
}

fn names(schema: &Schema) -> String {
    schema.root().fields.iter().take(24).map(|f| f.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// Operations after the last read need not run.
fn drop_tail(ops: &mut Vec<Op>) {
    while let Some(last) = ops.last() {
        let reads = match last {
            Op::Read { .. } => true,
            Op::Loop { body, .. } => has_read(body),
            _ => false,
        };
        if reads {
            break;
        }
        ops.pop();
    }
}

fn has_read(ops: &[Op]) -> bool {
    ops.iter().any(|op| match op {
        Op::Read { .. } => true,
        Op::Loop { body, .. } => has_read(body),
        _ => false,
    })
}

struct Compiler<'a> {
    schema: &'a Schema,
    slots: &'a [Slot],
    found: Vec<bool>,
    ops: usize,
}

impl Compiler<'_> {
    fn message(&mut self, index: usize, prefix: &str) -> Result<Vec<Op>, RecordingError> {
        let message = &self.schema.types[index];
        let mut ops = Vec::new();
        if message.fields.is_empty() {
            push(&mut ops, Op::Skip { size: 1, count: 1 });
        }
        for field in &message.fields {
            self.ops += 1;
            if self.ops > MAX_OPS {
                return Err(RecordingError::Field {
                    type_name: self.schema.root().name.clone(),
                    expected: format!("at most {MAX_OPS} nested fields"),
                    found: "more".into(),
                });
            }
            let dot = if prefix.is_empty() { "" } else { "." };
            let path = format!("{prefix}{dot}{}", field.name);
            match field.element {
                Element::Message(inner) => self.nested(&mut ops, inner, field.arity, &path)?,
                Element::Primitive(primitive) => self.primitive(&mut ops, primitive, field.arity, &path)?,
            }
        }
        Ok(ops)
    }

    fn nested(&mut self, ops: &mut Vec<Op>, inner: usize, arity: Arity, path: &str) -> Result<(), RecordingError> {
        match arity {
            Arity::One => self.message(inner, path)?.into_iter().for_each(|op| push(ops, op)),
            Arity::Array(n) => {
                let first = self.found.clone();
                let body = self.message(inner, &format!("{path}[]"))?;
                for slot in (0..first.len()).filter(|&k| self.found[k] && !first[k]) {
                    self.check_fixed(slot, n)?;
                }
                ops.push(Op::Loop { count: Count::Fixed(n), field: path.to_string(), body });
            }
            Arity::Sequence(bound) => {
                let body = self.message(inner, &format!("{path}[]"))?;
                ops.push(Op::Loop { count: Count::Sequence(bound), field: path.to_string(), body });
            }
        }
        Ok(())
    }

    fn check_fixed(&self, slot: usize, count: usize) -> Result<(), RecordingError> {
        if count >= self.slots[slot].needed {
            return Ok(());
        }
        Err(too_short(&self.schema.root().name, &self.slots[slot], count))
    }

    fn primitive(
        &mut self,
        ops: &mut Vec<Op>,
        primitive: Primitive,
        arity: Arity,
        path: &str,
    ) -> Result<(), RecordingError> {
        let field = path.to_string();
        let Some(size) = primitive.size() else {
            let one = match primitive {
                Primitive::WString => Op::WString { field: field.clone() },
                _ => Op::SkipString { field: field.clone() },
            };
            match arity {
                Arity::One => ops.push(one),
                Arity::Array(n) => ops.push(Op::Loop { count: Count::Fixed(n), field, body: vec![one] }),
                Arity::Sequence(b) => ops.push(Op::Loop { count: Count::Sequence(b), field, body: vec![one] }),
            }
            return Ok(());
        };
        let count = match arity {
            Arity::One => Count::One,
            Arity::Array(n) => Count::Fixed(n),
            Arity::Sequence(bound) => Count::Sequence(bound),
        };
        let is_wanted = |s: &Slot| same_field(s.path.strip_suffix("[]").unwrap_or(&s.path), path);
        match (self.slots.iter().position(is_wanted), count) {
            // Two slots may not want the same path: the second is reported as missing.
            (Some(slot), _) => {
                if path.matches("[]").count() + usize::from(!matches!(count, Count::One)) > 1 {
                    return Err(RecordingError::Field {
                        type_name: self.schema.root().name.clone(),
                        expected: "a path through one array".into(),
                        found: format!("an array within an array at `{path}`"),
                    });
                }
                if let Count::Fixed(n) = count {
                    self.check_fixed(slot, n)?;
                }
                self.found[slot] = true;
                ops.push(Op::Read { primitive, count, slot });
            }
            (None, Count::One) => push(ops, Op::Skip { size, count: 1 }),
            (None, Count::Fixed(n)) => push(ops, Op::Skip { size, count: n }),
            (None, Count::Sequence(bound)) => ops.push(Op::SkipSequence { size, bound, field }),
        }
        Ok(())
    }
}

/// Adds an operation; neighbouring skips of one size become one.
fn push(ops: &mut Vec<Op>, op: Op) {
    match (ops.last_mut(), &op) {
        (Some(Op::Skip { size, count }), Op::Skip { size: same, count: more }) if size == same => {
            *count = count.saturating_add(*more);
        }
        _ => ops.push(op),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::{Value, Writer, decode};
    use crate::facts::States;

    const TEXT: &str = "string name\nuint8 kind\nPart[] parts\nfloat32[3] gyro\nuint8[] blob\nint64 big\n===\n\
        MSG: p/Part\nuint8 mode\nfloat64 q\nint16[2] raw\n";

    fn message() -> Vec<u8> {
        let mut w = Writer::new();
        w.string("abc").u8(7).u32(2);
        for k in 0..2 {
            w.u8(k).f64(1.5 + f64::from(k)).i16(-1).i16(2);
        }
        w.f32(0.1).f32(0.2).f32(0.3).u32(3).u8(1).u8(2).u8(3);
        let mut bytes = w.finish();
        // int64 at an 8-byte boundary of the body.
        while !(bytes.len() - 4).is_multiple_of(8) {
            bytes.push(0);
        }
        bytes.extend_from_slice(&(-5i64).to_le_bytes());
        bytes
    }

    fn wanted(path: &str, elements: &[usize]) -> FieldSelection {
        FieldSelection { path: path.into(), elements: elements.to_vec() }
    }

    #[test]
    fn plan_and_tree_agree() {
        let schema = Schema::parse("p/T", TEXT).unwrap();
        let plan = Plan::compile(
            &schema,
            &[wanted("gyro", &[2, 0]), wanted("parts[].q", &[1, 0]), wanted("big", &[0]), wanted("kind", &[0])],
        )
        .unwrap();
        let mut out = [0.0; 6];
        plan.read(&message(), &mut out).unwrap();
        assert_eq!(out, [f64::from(0.3f32), f64::from(0.1f32), 2.5, 1.5, -5.0, 7.0]);
        let tree = decode(&schema, &message()).unwrap();
        assert_eq!(tree.get("big"), Some(&Value::Signed(-5)));
        assert_eq!(tree.get("blob"), Some(&Value::Bytes(vec![1, 2, 3])));
        assert_eq!(tree.get("name"), Some(&Value::String("abc".into())));
        let Some(Value::Array(parts)) = tree.get("parts") else { panic!("parts is an array") };
        assert_eq!(parts[1].get("q").and_then(Value::as_f64), Some(2.5));
    }

    #[test]
    fn big_endian_is_read() {
        let schema = Schema::parse("p/T", "uint8 a\nfloat64 x").unwrap();
        let mut bytes = vec![0, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0];
        bytes.extend_from_slice(&2.25f64.to_be_bytes());
        let plan = Plan::compile(&schema, &[wanted("x", &[0])]).unwrap();
        let mut out = [0.0];
        plan.read(&bytes, &mut out).unwrap();
        assert_eq!(out, [2.25]);
    }

    #[test]
    fn every_cut_is_an_error() {
        let schema = Schema::parse("p/T", TEXT).unwrap();
        let plan = Plan::compile(&schema, &[wanted("big", &[0])]).unwrap();
        let full = message();
        for length in 0..full.len() {
            assert!(plan.read(&full[..length], &mut [0.0]).is_err(), "{length} bytes");
            assert!(decode(&schema, &full[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn huge_claims_and_short_arrays_are_named() {
        let schema = Schema::parse("p/T", "float64[] x\nP[] p\n===\nMSG: p/P\nfloat32 q").unwrap();
        let mut w = Writer::new();
        w.u32(4_000_000_000);
        let error = decode(&schema, &w.finish()).unwrap_err().to_string();
        assert!(error.states("4000000000 4000000000"), "{error}");
        let plan = Plan::compile(&schema, &[wanted("p[].q", &[0, 1])]).unwrap();
        let mut w = Writer::new();
        w.u32(0).u32(1).f32(1.0);
        let error = plan.read(&w.finish(), &mut [0.0; 2]).unwrap_err().to_string();
        assert!(error.states("2 `p[].q` 1"), "{error}");
        let fixed = Schema::parse("p/T", "P[11] p\n===\nMSG: p/P\nfloat32 q").unwrap();
        let error = Plan::compile(&fixed, &[wanted("p[].q", &[11])]).unwrap_err().to_string();
        assert!(error.states("12 `p[].q` 11"), "{error}");
        let error = Plan::compile(&fixed, &[wanted("nothing", &[0])]).unwrap_err().to_string();
        assert!(error.contains("`nothing`"), "{error}");
    }

    #[test]
    fn endless_empty_elements_and_fields_are_refused() {
        let nest = "A[4] a\n===\nMSG: p/A\nB[1000] b\n===\nMSG: p/B\nC[1000] c\n===\nMSG: p/C\nint32[0] x";
        let schema = Schema::parse("p/T", nest).unwrap();
        assert!(decode(&schema, &[0, 1, 0, 0, 0, 0, 0, 0, 0, 0]).is_err());
        let mut text = String::from("M0 a");
        for k in 0..25 {
            text += &format!("\n===\nMSG: p/M{k}\nM{0} a\nM{0} b", k + 1);
        }
        text += "\n===\nMSG: p/M25\nint32 x";
        let schema = Schema::parse("p/T", &text).unwrap();
        assert!(Plan::compile(&schema, &[wanted("z", &[0])]).is_err());
    }
}
