//! Columns of numbers, or of lists of numbers, of a Parquet file.

use bytes::Bytes;
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::file::reader::{FileReader, SerializedFileReader};

/// Rows that are read at a time.
const AT_ONCE: usize = 4096;

/// A column, NaN where there is no number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Column {
    /// Numbers of a row.
    pub width: usize,
    /// Shape `[rows, width]`.
    pub values: Vec<f64>,
}

/// The columns with these names, each as long as the file has rows.
///
/// # Errors
/// No Parquet file, a column is missing, holds no numbers, or lists of different lengths.
pub fn columns(bytes: Vec<u8>, names: &[&str]) -> Result<Vec<Column>, String> {
    let reader = SerializedFileReader::new(Bytes::from(bytes)).map_err(|e| e.to_string())?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let leaf = |name: &&str| {
        let all = (0..schema.num_columns())
            .filter(|leaf| schema.column(*leaf).path().parts().first().is_some_and(|top| top == name));
        let leaves: Vec<usize> = all.collect();
        match leaves[..] {
            [one] => Ok(one),
            [] => Err(format!("no column `{name}`")),
            _ => Err(format!("a column `{name}` of records")),
        }
    };
    let leaves: Vec<usize> = names.iter().map(leaf).collect::<Result<_, String>>()?;
    let mut rows: Vec<Rows> = vec![Rows::default(); names.len()];
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group).map_err(|e| e.to_string())?;
        for ((rows, leaf), name) in rows.iter_mut().zip(&leaves).zip(names) {
            let levels = [schema.column(*leaf).max_def_level(), schema.column(*leaf).max_rep_level()];
            let column = group.get_column_reader(*leaf).map_err(|e| e.to_string())?;
            rows.read(column, levels).map_err(|found| format!("column `{name}`: {found}"))?;
        }
    }
    let count = rows.first().map_or(0, |rows| rows.lengths.len());
    rows.into_iter()
        .zip(names)
        .map(|(rows, name)| rows.even(count).map_err(|e| format!("column `{name}`: {e}")))
        .collect()
}

/// Numbers of each row, one after the other.
#[derive(Debug, Clone, Default)]
struct Rows {
    lengths: Vec<usize>,
    values: Vec<f64>,
}

impl Rows {
    fn read(&mut self, column: ColumnReader, levels: [i16; 2]) -> Result<(), String> {
        match column {
            ColumnReader::FloatColumnReader(c) => self.fill(c, levels, |x| f64::from(*x)),
            ColumnReader::DoubleColumnReader(c) => self.fill(c, levels, |x| *x),
            ColumnReader::Int32ColumnReader(c) => self.fill(c, levels, |x| f64::from(*x)),
            ColumnReader::Int64ColumnReader(c) => self.fill(c, levels, |x| *x as f64),
            _ => Err("no numbers".into()),
        }
    }

    fn fill<T: DataType>(
        &mut self,
        mut column: ColumnReaderImpl<T>,
        [most_defined, most_repeated]: [i16; 2],
        number: fn(&T::T) -> f64,
    ) -> Result<(), String> {
        if most_repeated > 1 {
            return Err("lists of lists".into());
        }
        loop {
            let (mut defined, mut repeated, mut values) = (vec![], vec![], vec![]);
            let read = column.read_records(AT_ONCE, Some(&mut defined), Some(&mut repeated), &mut values);
            let (records, _, levels) = read.map_err(|e| e.to_string())?;
            if records == 0 {
                return Ok(());
            }
            let mut values = values.iter();
            for level in 0..levels.max(values.len()) {
                let is_there = defined.get(level).is_none_or(|defined| *defined == most_defined);
                if repeated.get(level).is_none_or(|repeated| *repeated == 0) {
                    self.lengths.push(0);
                }
                // A list that is empty, or not there, has a level without a number, too.
                if let (true, Some(length)) = (is_there, self.lengths.last_mut()) {
                    *length += 1;
                    self.values.push(values.next().map_or(f64::NAN, number));
                }
            }
        }
    }

    /// Rows of one length; those without numbers are gaps.
    fn even(self, count: usize) -> Result<Column, String> {
        let width = self.lengths.iter().copied().max().unwrap_or(0);
        if self.lengths.len() != count {
            return Err(format!("{} rows instead of {count}", self.lengths.len()));
        }
        let mut out = Column { width, values: Vec::with_capacity(self.values.len()) };
        let mut rest = &self.values[..];
        for length in self.lengths {
            if length != 0 && length != width {
                return Err(format!("lists of {length} and of {width} numbers"));
            }
            let (row, after) = rest.split_at(length);
            out.values.extend_from_slice(row);
            out.values.resize(out.values.len() + width - length, f64::NAN);
            rest = after;
        }
        Ok(out)
    }
}
