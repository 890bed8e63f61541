//! Messages that name their joints: each may have other ones, in another order.

use crate::RecordingError;
use crate::cdr::{Value, decode};
use crate::clean::Samples;
use crate::schema::{Arity, Element, Primitive, Schema};

/// What was read of a topic whose messages name their joints.
pub(crate) struct NamedJoints {
    schema: Schema,
    names: String,
    /// A list of numbers for each channel.
    paths: Vec<String>,
    has_header: bool,
    /// Lists of names, as they came; most topics have one.
    lists: Vec<Vec<String>>,
    /// Of each message its list, and where its values begin.
    messages: Vec<(usize, usize)>,
    /// Channel by channel, in the order of the list; NaN where the message leaves a channel empty.
    values: Vec<f64>,
}

impl NamedJoints {
    /// A reader of the lists at `paths`, whose elements are named by the list at `names`.
    ///
    /// # Errors
    /// [`RecordingError::Field`] when a path leads to no list.
    pub fn new(schema: Schema, names: &str, paths: Vec<String>) -> Result<Self, RecordingError> {
        check(&schema, names, true)?;
        paths.iter().try_for_each(|path| check(&schema, path, false))?;
        let has_header = schema.root().fields.first().is_some_and(|f| f.name == "header");
        let names = names.to_owned();
        Ok(Self { schema, names, paths, has_header, lists: Vec::new(), messages: Vec::new(), values: Vec::new() })
    }

    /// Reads one message; returns the stamp of its header \[s, ns\], where it has one that is set.
    ///
    /// # Errors
    /// The bytes do not fit the definition, or lists differ in length.
    pub fn read(&mut self, message: &[u8]) -> Result<Option<(f64, f64)>, RecordingError> {
        let value = decode(&self.schema, message)?;
        let names = strings(&value, &self.names);
        let list = match self.lists.iter().position(|known| *known == names) {
            Some(list) => list,
            None => {
                self.lists.push(names);
                self.lists.len() - 1
            }
        };
        let count = self.lists[list].len();
        let start = self.values.len();
        for path in &self.paths {
            match numbers(&value, path) {
                Ok(found) if found.len() == count => self.values.extend(found),
                Ok(found) if found.is_empty() => self.values.extend(std::iter::repeat_n(f64::NAN, count)),
                other => {
                    self.values.truncate(start);
                    let found = other
                        .map_or_else(|points| format!("{points} points"), |found| format!("{} numbers", found.len()));
                    let expected = match path.split_once("[].") {
                        Some((of, _)) => format!("one point in `{of}` with a number for each of {count} names"),
                        None => format!("a number for each of {count} names at `{path}`"),
                    };
                    return Err(RecordingError::Field { type_name: self.schema.root().name.clone(), expected, found });
                }
            }
        }
        self.messages.push((list, start));
        let stamp = |part: &str| value.get(&format!("header.stamp.{part}")).and_then(Value::as_f64);
        Ok(if self.has_header { stamp("sec").zip(stamp("nanosec")) } else { None })
    }

    /// Every name, in the order in which they came.
    pub fn all_names(&self) -> Vec<String> {
        let mut all: Vec<String> = Vec::new();
        for name in self.lists.iter().flatten() {
            if !all.contains(name) {
                all.push(name.clone());
            }
        }
        all
    }

    /// Names that a list has more than once: the last value of each counts.
    pub fn names_twice(&self) -> Vec<String> {
        let mut twice: Vec<String> = Vec::new();
        for list in &self.lists {
            for (at, name) in list.iter().enumerate() {
                if list[..at].contains(name) && !twice.contains(name) {
                    twice.push(name.clone());
                }
            }
        }
        twice
    }

    /// The messages as rows: each channel with a column for each of `joints`, NaN where a message does not have it.
    pub fn samples(&self, time: Vec<f64>, joints: &[String]) -> Samples {
        let n = joints.len();
        let width = n * self.paths.len();
        let columns: Vec<Vec<Option<usize>>> = self
            .lists
            .iter()
            .map(|list| list.iter().map(|name| joints.iter().position(|joint| joint == name)).collect())
            .collect();
        let mut rows = vec![f64::NAN; width * self.messages.len()];
        for (row, (list, start)) in rows.chunks_exact_mut(width.max(1)).zip(&self.messages) {
            let columns = &columns[*list];
            for channel in 0..self.paths.len() {
                let values = &self.values[start + channel * columns.len()..];
                for (column, value) in columns.iter().zip(values) {
                    if let Some(column) = column {
                        row[channel * n + column] = *value;
                    }
                }
            }
        }
        Samples { time, rows, width }
    }
}

/// Whether a path leads to a list of strings (`is_text`) or numbers.
fn check(schema: &Schema, path: &str, is_text: bool) -> Result<(), RecordingError> {
    let wrong = || {
        let kind = if is_text { "strings" } else { "numbers" };
        let names: Vec<&str> = schema.root().fields.iter().take(24).map(|f| f.name.as_str()).collect();
        RecordingError::Field {
            type_name: schema.root().name.clone(),
            expected: format!("a list of {kind} at `{path}`"),
            found: format!("fields {}", names.join(", ")),
        }
    };
    let mut message = schema.root();
    let mut parts = path.split('.').peekable();
    while let Some(part) = parts.next() {
        let name = part.trim_end_matches("[]");
        let field = message.fields.iter().find(|f| f.name == name).ok_or_else(wrong)?;
        match (field.element, parts.peek()) {
            (Element::Message(inner), Some(_)) => message = &schema.types[inner],
            (Element::Primitive(primitive), None) if field.arity != Arity::One => {
                let is_string = primitive == Primitive::String;
                return if is_string == is_text && (is_string || primitive.size().is_some()) {
                    Ok(())
                } else {
                    Err(wrong())
                };
            }
            _ => return Err(wrong()),
        }
    }
    Err(wrong())
}

fn strings(value: &Value, path: &str) -> Vec<String> {
    let Some(Value::Array(list)) = value.get(path) else { return Vec::new() };
    let text = |v: &Value| match v {
        Value::String(text) => text.clone(),
        _ => String::new(),
    };
    list.iter().map(text).collect()
}

/// The numbers at `list`, or at `points[].list` of a message with one point; the error is how many points there are.
fn numbers(value: &Value, path: &str) -> Result<Vec<f64>, usize> {
    let value = match path.split_once("[].") {
        None => value.get(path),
        Some((outer, inner)) => match value.get(outer) {
            Some(Value::Array(points)) if points.len() == 1 => points[0].get(inner),
            Some(Value::Array(points)) => return Err(points.len()),
            _ => None,
        },
    };
    Ok(match value {
        Some(Value::Array(list)) => list.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect(),
        _ => Vec::new(),
    })
}
