//! ROS 2 message definitions (`ros2msg` schemas, as a bag carries them) parsed into plain data.
//!
//! A definition is the text of the message, then, after lines of `=`, the text of each message that it needs, each
//! headed `MSG: package/Type`. Source: the ROS 2 interface definition pages and the MCAP registry entry `ros2msg`.

use crate::RecordingError;
use std::collections::BTreeMap;

/// A primitive type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Primitive {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    String,
    WString,
}

impl Primitive {
    /// Size in bytes, which is also the alignment; `None` for strings.
    pub fn size(self) -> Option<usize> {
        match self {
            Self::Bool | Self::U8 | Self::I8 => Some(1),
            Self::U16 | Self::I16 => Some(2),
            Self::U32 | Self::I32 | Self::F32 => Some(4),
            Self::U64 | Self::I64 | Self::F64 => Some(8),
            Self::String | Self::WString => None,
        }
    }

    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "bool" => Self::Bool,
            "byte" | "char" | "uint8" => Self::U8,
            "int8" => Self::I8,
            "uint16" => Self::U16,
            "int16" => Self::I16,
            "uint32" => Self::U32,
            "int32" => Self::I32,
            "uint64" => Self::U64,
            "int64" => Self::I64,
            "float32" => Self::F32,
            "float64" => Self::F64,
            "string" => Self::String,
            "wstring" => Self::WString,
            _ => return None,
        })
    }
}

/// The type of one element of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// A number, truth value or string.
    Primitive(Primitive),
    /// Another message: index into [`Schema::types`].
    Message(usize),
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// Exactly one, not an array.
    One,
    /// A fixed array.
    Array(usize),
    /// A sequence, its length in the bytes; at most so many elements when bounded.
    Sequence(Option<usize>),
}

/// One field of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Name of the field.
    pub name: String,
    /// Type of one element.
    pub element: Element,
    /// Number of elements.
    pub arity: Arity,
}

/// One message type: its fields in order (constants are left out: they take no bytes).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MessageType {
    /// Full name such as `geometry_msgs/Pose`.
    pub name: String,
    /// Fields in the order of the bytes.
    pub fields: Vec<Field>,
}

/// A message type with all types that it needs; `types[0]` is the message itself. No type contains itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    /// All types.
    pub types: Vec<MessageType>,
}

/// Nested messages deeper than this are refused: real ones have at most 6 levels.
const MAX_DEPTH: usize = 32;

struct RawField {
    line: usize,
    type_text: String,
    name: String,
}

impl Schema {
    /// Parses the definition `text` of the message `name` (such as `unitree_go/msg/LowState`).
    ///
    /// # Errors
    /// [`RecordingError::Schema`] names the type and line: an unknown type, a bad array length, a type within itself.
    pub fn parse(name: &str, text: &str) -> Result<Self, RecordingError> {
        let mut sections: Vec<(String, Vec<RawField>)> = vec![(short_name(name), Vec::new())];
        let mut expect_heading = false;
        for (index, raw) in text.lines().enumerate() {
            let line = strip_comment(raw).trim();
            if is_separator(line) {
                expect_heading = true;
            } else if expect_heading && !line.is_empty() {
                let heading = line.strip_prefix("MSG:").ok_or_else(|| Self::error(name, index, "`MSG: type`", line))?;
                sections.push((short_name(heading.trim()), Vec::new()));
                expect_heading = false;
            } else if !line.is_empty() {
                let field = parse_line(line, index).map_err(|e| Self::error(name, index, &e, line))?;
                sections.last_mut().expect("one section exists").1.extend(field);
            }
        }
        resolve(name, sections)
    }

    fn error(name: &str, index: usize, expected: &str, found: &str) -> RecordingError {
        RecordingError::Schema {
            type_name: name.to_string(),
            line: index + 1,
            expected: expected.to_string(),
            found: format!("`{}`", found.chars().take(80).collect::<String>()),
        }
    }

    /// The message itself.
    pub fn root(&self) -> &MessageType {
        &self.types[0]
    }
}

/// `pkg/msg/Type` and `pkg/Type` both become `pkg/Type`.
fn short_name(name: &str) -> String {
    let parts: Vec<&str> = name.split('/').collect();
    match parts.as_slice() {
        [package, .., last] => format!("{package}/{last}"),
        _ => name.to_string(),
    }
}

fn is_separator(line: &str) -> bool {
    line.len() >= 3 && line.bytes().all(|b| b == b'=')
}

/// Cuts a comment; a `#` within quotes belongs to a default value.
fn strip_comment(line: &str) -> &str {
    let mut quote = None;
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (None, '#') => return &line[..at],
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), c) if c == open => quote = None,
            _ => {}
        }
    }
    line
}

/// One line of a definition; `None` for a constant.
fn parse_line(line: &str, index: usize) -> Result<Option<RawField>, String> {
    let (type_text, rest) = line.split_once(char::is_whitespace).ok_or("`type name`")?;
    let rest = rest.trim_start();
    let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let (name, tail) = rest.split_at(end);
    if name.is_empty() || name.starts_with(|c: char| c.is_ascii_digit()) {
        return Err("a field name".into());
    }
    if tail.trim_start().starts_with('=') {
        return Ok(None);
    }
    if !tail.is_empty() && !tail.starts_with(char::is_whitespace) {
        return Err("a field name of letters, digits and `_`".into());
    }
    Ok(Some(RawField { line: index, type_text: type_text.to_string(), name: name.to_string() }))
}

/// Splits `type[3]`, `type[]`, `type[<=3]`, `string<=8` into base name and arity.
fn split_arity(text: &str) -> Result<(&str, Arity), String> {
    let (base, arity) = match text.split_once('[') {
        None => (text, Arity::One),
        Some((base, rest)) => {
            let inner = rest.strip_suffix(']').ok_or("`]` at the end of an array type")?;
            let number = |t: &str| t.parse::<u32>().map(|n| n as usize).map_err(|_| "an array length".to_string());
            let arity = match inner.strip_prefix("<=") {
                _ if inner.is_empty() => Arity::Sequence(None),
                Some(bound) => Arity::Sequence(Some(number(bound)?)),
                None => Arity::Array(number(inner)?),
            };
            (base, arity)
        }
    };
    match base.split_once("<=") {
        None => Ok((base, arity)),
        Some((string @ ("string" | "wstring"), bound)) if bound.parse::<u32>().is_ok() => Ok((string, arity)),
        Some(_) => Err("a bound on a string".into()),
    }
}

fn resolve(name: &str, mut sections: Vec<(String, Vec<RawField>)>) -> Result<Schema, RecordingError> {
    // Writers may leave out the two types that every ROS 2 installation has.
    for known in ["Time", "Duration"] {
        let full = format!("builtin_interfaces/{known}");
        if !sections.iter().any(|(n, _)| *n == full) {
            let field =
                |type_text: &str, name: &str| RawField { line: 0, type_text: type_text.into(), name: name.into() };
            sections.push((full, vec![field("int32", "sec"), field("uint32", "nanosec")]));
        }
    }
    let mut by_name = BTreeMap::new();
    for (index, (section, _)) in sections.iter().enumerate() {
        by_name.entry(section.clone()).or_insert(index);
    }
    let mut types = Vec::with_capacity(sections.len());
    for (section, raw_fields) in &sections {
        let mut fields = Vec::with_capacity(raw_fields.len());
        for raw in raw_fields {
            let (base, arity) =
                split_arity(&raw.type_text).map_err(|e| Schema::error(section, raw.line, &e, &raw.type_text))?;
            let element = match Primitive::from_name(base) {
                Some(primitive) => Element::Primitive(primitive),
                None => Element::Message(find_type(&by_name, section, base).ok_or_else(|| {
                    Schema::error(section, raw.line, "a type that the schema defines", &raw.type_text)
                })?),
            };
            fields.push(Field { name: raw.name.clone(), element, arity });
        }
        types.push(MessageType { name: section.clone(), fields });
    }
    let schema = Schema { types };
    check_nesting(name, &schema)?;
    Ok(schema)
}

fn find_type(by_name: &BTreeMap<String, usize>, enclosing: &str, name: &str) -> Option<usize> {
    if let Some(&index) = by_name.get(&short_name(name)) {
        return Some(index);
    }
    let package = enclosing.split('/').next().unwrap_or_default();
    let sibling = by_name.get(&format!("{package}/{name}"));
    let anywhere = || by_name.iter().find(|(full, _)| full.rsplit('/').next() == Some(name)).map(|(_, index)| index);
    sibling.or_else(anywhere).copied()
}

/// Refuses a type within itself and absurd depth. Depths are found children first, each type once.
fn check_nesting(name: &str, schema: &Schema) -> Result<(), RecordingError> {
    let mut depth = vec![1usize; schema.types.len()];
    for _ in 0..=MAX_DEPTH {
        let mut changed = false;
        for index in 0..schema.types.len() {
            let below = schema.types[index].fields.iter().filter_map(|f| match f.element {
                Element::Message(inner) => Some(depth[inner] + 1),
                Element::Primitive(_) => None,
            });
            let new = below.max().unwrap_or(1);
            changed |= new != depth[index];
            depth[index] = new;
        }
        if !changed {
            return Ok(());
        }
    }
    let found = "a type that contains itself, or deeper nesting".to_string();
    Err(RecordingError::Schema {
        type_name: name.to_string(),
        line: 0,
        expected: format!("at most {MAX_DEPTH} levels of nested messages"),
        found,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    const TEXT: &str = "# a comment\nstd_msgs/Header header\nuint8 A=1\nstring NAME = \"x # y\"\nint32[<=5] few 3\n\
        string<=8[] names [\"a#\", \"b\"]\nPart[2] parts\nbool ok true # yes\n\
        ================================================================================\nMSG: std_msgs/Header\n\
        builtin_interfaces/Time stamp\nstring frame_id\n===\nMSG: my/msg/Part\nfloat64[3] x\nwstring w\n";

    #[test]
    fn fields_constants_and_defaults() {
        let schema = Schema::parse("my/msg/Thing", TEXT).unwrap();
        let root = schema.root();
        let names: Vec<&str> = root.fields.iter().map(|f| f.name.as_str()).collect();
        assert_eq!(names, ["header", "few", "names", "parts", "ok"]);
        assert_eq!(root.fields[1].arity, Arity::Sequence(Some(5)));
        assert_eq!(root.fields[2].element, Element::Primitive(Primitive::String));
        let Element::Message(part) = root.fields[3].element else { panic!("parts is a message") };
        assert_eq!(schema.types[part].name, "my/Part");
        assert_eq!(schema.types[part].fields[0].arity, Arity::Array(3));
    }

    #[test]
    fn bad_definitions_are_errors_with_a_line() {
        for (text, line, word) in [
            ("int32 a\nNothing b", 2, "defines"),
            ("int32[x] a", 1, "array length"),
            ("int32[3 a", 1, "`]`"),
            ("justone", 1, "type name"),
            ("int32 a\n===\nint32 b", 3, "MSG"),
            ("int32 9a", 1, "field name"),
        ] {
            let error = Schema::parse("p/T", text).unwrap_err().to_string();
            assert!(error.contains(&format!("line {line}")) && error.contains(word), "{text:?} gave {error}");
        }
    }

    #[test]
    fn recursion_is_refused() {
        let error = Schema::parse("p/T", "U u\n===\nMSG: p/U\nT[] t").unwrap_err().to_string();
        assert!(error.states("contains"), "{error}");
    }
}
