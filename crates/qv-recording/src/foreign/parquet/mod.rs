//! Columns of numbers, or of lists of numbers, of a Parquet file (apache/parquet-format, `README.md`, `Encodings.md`, `parquet.thrift`, 2.11).
//!
//! Read are booleans, integers and floats, plain, by dictionary or split into streams of bytes, in data pages of both versions, plain or packed by
//! snappy or zstd: what pyarrow writes. Nothing is taken on the file's word: pages, numbers and runs are held against the bytes that are there.

mod pages;
mod thrift;

use crate::bounds::Bounds;
use pages::{Pages, Values};
use thrift::Value;

const MAGIC: &[u8; 4] = b"PAR1";
/// Fields inside each other in a schema.
const DEEPEST: usize = 16;
/// Numbers for each byte of a file: a column of measurements has less than one.
const NUMBERS_PER_BYTE: usize = 24;
/// Numbers that any file may have: a column of one value is packed to nearly nothing.
const LEAST_LIMIT: usize = 1 << 22;

/// A column, NaN where there is no number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Column {
    /// Numbers of a row.
    pub width: usize,
    /// Shape `[rows, width]`.
    pub values: Vec<f64>,
}

/// A field with numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Leaf<'a> {
    /// Name of the field at the top that it is in.
    top: &'a str,
    most_defined: u32,
    most_repeated: u32,
}

/// The columns with these names, each as long as the file has rows.
///
/// # Errors
/// No Parquet file, a column is missing, holds no numbers, or lists of different lengths.
pub fn columns(file: &[u8], names: &[&str]) -> Result<Vec<Column>, String> {
    let footer = footer(file)?;
    let (meta, _) = Value::read(footer)?;
    let leaves = leaves(meta.list(2))?;
    let place = |name: &&str| {
        let all: Vec<usize> = (0..leaves.len()).filter(|leaf| leaves[*leaf].top == *name).collect();
        match all[..] {
            [one] => Ok(one),
            [] => Err(format!("no column `{name}`")),
            _ => Err(format!("a column `{name}` of records")),
        }
    };
    let places: Vec<usize> = names.iter().map(place).collect::<Result<_, String>>()?;
    let mut rows = vec![Rows::default(); names.len()];
    let bounds = Bounds::of(file.len());
    let mut left = (NUMBERS_PER_BYTE * file.len()).max(LEAST_LIMIT);
    for group in meta.list(4) {
        let chunks = group.list(1);
        if chunks.len() != leaves.len() {
            return Err(format!("{} columns in a group of rows instead of {}", chunks.len(), leaves.len()));
        }
        for ((rows, place), name) in rows.iter_mut().zip(&places).zip(names) {
            let chunk = chunks[*place].field(3).ok_or_else(|| format!("column `{name}`: data in another file"))?;
            let read = rows.read(file, chunk, leaves[*place], &mut left, &bounds);
            read.map_err(|found| format!("column `{name}`: {found}"))?;
        }
    }
    let count = rows.first().map_or(0, |rows| rows.lengths.len());
    rows.into_iter()
        .zip(names)
        .map(|(rows, name)| rows.even(count).map_err(|e| format!("column `{name}`: {e}")))
        .collect()
}

/// The description at the end.
fn footer(file: &[u8]) -> Result<&[u8], String> {
    if file.len() < 12 || !file.starts_with(MAGIC) || !file.ends_with(MAGIC) {
        return Err("no PAR1 at its beginning and its end: another file, or one that is cut off".into());
    }
    let end = file.len() - 8;
    let length = u32::from_le_bytes([file[end], file[end + 1], file[end + 2], file[end + 3]]) as usize;
    let start = end.checked_sub(length).filter(|start| *start >= 4);
    start.map(|start| &file[start..end]).ok_or_else(|| format!("a description of {length} bytes in {}", file.len()))
}

/// The fields with numbers, in the order of the columns.
fn leaves<'a>(schema: &[Value<'a>]) -> Result<Vec<Leaf<'a>>, String> {
    let mut out = Vec::new();
    let mut at = 1;
    let fields = schema.first().and_then(|root| root.count(5)).unwrap_or(0);
    for _ in 0..fields {
        let top = schema.get(at).and_then(|field| field.text(4)).ok_or("a schema that is cut off")?;
        add(schema, &mut at, Leaf { top, most_defined: 0, most_repeated: 0 }, 0, &mut out)?;
    }
    Ok(out)
}

fn add<'a>(
    schema: &[Value<'a>],
    at: &mut usize,
    above: Leaf<'a>,
    depth: usize,
    out: &mut Vec<Leaf<'a>>,
) -> Result<(), String> {
    let field = schema.get(*at).ok_or("a schema that is cut off")?;
    *at += 1;
    // 0 required, 1 optional, 2 repeated.
    let repetition = field.int(3).unwrap_or(0);
    let here = Leaf {
        most_defined: above.most_defined + u32::from(repetition != 0),
        most_repeated: above.most_repeated + u32::from(repetition == 2),
        ..above
    };
    match field.count(5).unwrap_or(0) {
        0 => out.push(here),
        _ if depth > DEEPEST => return Err(format!("more than {DEEPEST} fields inside each other")),
        children => {
            for _ in 0..children {
                add(schema, at, here, depth + 1, out)?;
            }
        }
    }
    Ok(())
}

/// Numbers of each row, one after the other.
#[derive(Debug, Clone, Default)]
struct Rows {
    lengths: Vec<usize>,
    values: Vec<f64>,
}

impl Rows {
    /// Adds the rows of a chunk; `left` is how many numbers the file may have yet, `bounds` how many bytes.
    fn read(
        &mut self,
        file: &[u8],
        chunk: &Value,
        leaf: Leaf,
        left: &mut usize,
        bounds: &Bounds,
    ) -> Result<(), String> {
        if leaf.most_repeated > 1 {
            return Err("lists of lists".into());
        }
        let mut pages = Pages::of(file, chunk, [leaf.most_defined, leaf.most_repeated], bounds)?;
        while let Some(Values { defined, repeated, numbers }) = pages.next(left)? {
            let mut numbers = numbers.into_iter();
            for (defined, repeated) in defined.into_iter().zip(repeated) {
                if repeated == 0 {
                    self.lengths.push(0);
                }
                let length = self.lengths.last_mut().ok_or("a list that begins in the middle")?;
                // A list that is empty, or not there, has a level without a number, too.
                if defined == leaf.most_defined {
                    *length += 1;
                    self.values.push(numbers.next().unwrap_or(f64::NAN));
                }
            }
        }
        Ok(())
    }

    /// Rows of one length; those without numbers are gaps.
    fn even(self, count: usize) -> Result<Column, String> {
        let width = self.lengths.iter().copied().max().unwrap_or(0);
        if self.lengths.len() != count {
            return Err(format!("{} rows instead of {count}", self.lengths.len()));
        }
        if let Some(length) = self.lengths.iter().find(|length| **length != 0 && **length != width) {
            return Err(format!("lists of {length} and of {width} numbers"));
        }
        let empty = self.lengths.iter().filter(|length| **length == 0).count();
        if empty == 0 {
            return Ok(Column { width, values: self.values });
        }
        // One list of many numbers among many empty ones must not cost more than numbers that are there.
        if empty.saturating_mul(width) > self.values.len().saturating_mul(16) + LEAST_LIMIT {
            return Err(format!("{empty} of {count} rows without numbers"));
        }
        let mut out = Column { width, values: Vec::with_capacity(count * width) };
        let mut rest = &self.values[..];
        for length in self.lengths {
            let (row, after) = rest.split_at(length);
            out.values.extend_from_slice(row);
            out.values.resize(out.values.len() + width - length, f64::NAN);
            rest = after;
        }
        Ok(out)
    }
}
