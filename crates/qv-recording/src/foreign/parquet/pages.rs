//! Pages of a column: levels and numbers.

use super::thrift::Value;
use crate::bounds::Bounds;

/// Largest page, unpacked, bytes: sixty-four times what pyarrow writes.
const LARGEST_PAGE: usize = 64 << 20;
/// Physical types.
const BOOLEAN: i64 = 0;
const INT32: i64 = 1;
const INT64: i64 = 2;
const FLOAT: i64 = 4;
const DOUBLE: i64 = 5;

/// The pages of a column's chunk that are not read yet.
pub struct Pages<'a> {
    bytes: &'a [u8],
    kind: i64,
    codec: i64,
    /// Largest levels of definition and of repetition.
    most: [u32; 2],
    /// Numbers of the chunk that are to come, levels without one included.
    left: usize,
    dictionary: Option<Vec<f64>>,
    bounds: Bounds,
}

/// What a page holds.
#[derive(Debug, Default)]
pub struct Values {
    /// How far a value is there, one of each level.
    pub defined: Vec<u32>,
    /// 0 where a row begins, as many.
    pub repeated: Vec<u32>,
    /// The numbers of the levels that are defined.
    pub numbers: Vec<f64>,
}

impl<'a> Pages<'a> {
    /// Those of `ColumnMetaData`.
    pub fn of(file: &'a [u8], chunk: &Value, most: [u32; 2], bounds: &Bounds) -> Result<Self, String> {
        let kind = chunk.int(1).unwrap_or(-1);
        if ![BOOLEAN, INT32, INT64, FLOAT, DOUBLE].contains(&kind) {
            return Err("no numbers".into());
        }
        let data = chunk.count(9).ok_or("no place of its data")?;
        // Writers without dictionaries leave their place out, or at 0.
        let start = chunk.count(11).filter(|at| *at > 0).map_or(data, |at| at.min(data));
        let length = chunk.count(7).ok_or("no length of its data")?;
        let bytes = start.checked_add(length).and_then(|end| file.get(start..end));
        let bytes = bytes.ok_or_else(|| format!("{length} bytes from byte {start} on, of {}", file.len()))?;
        let left = chunk.count(5).ok_or("no number of values")?;
        Ok(Self { bytes, kind, codec: chunk.int(4).unwrap_or(0), most, left, dictionary: None, bounds: bounds.clone() })
    }

    /// The next page with values; `limit` is how many the file may have yet.
    pub fn next(&mut self, limit: &mut usize) -> Result<Option<Values>, String> {
        while self.left > 0 {
            let (header, length) = Value::read(self.bytes)?;
            let (packed, size) = (header.count(3), header.count(2));
            let (Some(packed), Some(size)) = (packed, size.filter(|size| *size <= LARGEST_PAGE)) else {
                return Err(format!("a page of {size:?} bytes"));
            };
            let end = length.saturating_add(packed);
            let body = self.bytes.get(length..end).ok_or("a page that is cut off")?;
            self.bytes = &self.bytes[end..];
            match header.int(1) {
                Some(2) => self.read_dictionary(&header, body, size)?,
                Some(0) => return self.data(header.field(5), body, size, false, limit).map(Some),
                Some(3) => return self.data(header.field(8), body, size, true, limit).map(Some),
                // Pages of other kinds are passed over.
                _ => {}
            }
        }
        Ok(None)
    }

    fn unpacked(&self, body: &[u8], size: usize) -> Result<Vec<u8>, String> {
        self.bounds.take(size as u64)?;
        let out = match self.codec {
            0 => body.to_vec(),
            1 => {
                let claimed = snap::raw::decompress_len(body).map_err(|e| e.to_string())?;
                if claimed != size {
                    return Err(format!("a page of {claimed} bytes instead of {size}"));
                }
                snap::raw::Decoder::new().decompress_vec(body).map_err(|e| e.to_string())?
            }
            6 => zstd::bulk::decompress(body, size).map_err(|e| e.to_string())?,
            2 => return Err("pages packed by gzip; those by snappy and zstd are read".into()),
            other => return Err(format!("pages packed by codec {other}; those by snappy (1) and zstd (6) are read")),
        };
        if out.len() == size { Ok(out) } else { Err(format!("a page of {} bytes instead of {size}", out.len())) }
    }

    fn read_dictionary(&mut self, header: &Value, body: &[u8], size: usize) -> Result<(), String> {
        let count = header.field(7).and_then(|own| own.count(1)).ok_or("a dictionary without a size")?;
        let bytes = self.unpacked(body, size)?;
        self.dictionary = Some(plain(self.kind, &bytes, count)?);
        Ok(())
    }

    fn data(
        &mut self,
        header: Option<&Value>,
        body: &[u8],
        size: usize,
        is_second: bool,
        limit: &mut usize,
    ) -> Result<Values, String> {
        let header = header.ok_or("a page without a header")?;
        let count = header.count(1).ok_or("a page without a number of values")?;
        if count > self.left || count > *limit || count == 0 {
            return Err(format!("{count} values in a page, where {} are left", self.left.min(*limit)));
        }
        self.left -= count;
        *limit -= count;
        let encoding = header.int(if is_second { 4 } else { 2 }).unwrap_or(-1);
        let [most_defined, most_repeated] = self.most;
        let (defined, repeated, bytes);
        if is_second {
            let [of_defined, of_repeated] = [5, 6].map(|number| header.count(number).unwrap_or(0));
            let split = of_repeated.checked_add(of_defined).filter(|at| *at <= body.len() && *at <= size);
            let split = split.ok_or("levels that are cut off")?;
            repeated = levels(&body[..of_repeated], most_repeated, count)?;
            defined = levels(&body[of_repeated..split], most_defined, count)?;
            let is_packed = header.field(7) != Some(&Value::Bool(false));
            bytes = if is_packed { self.unpacked(&body[split..], size - split)? } else { body[split..].to_vec() };
        } else {
            let all = self.unpacked(body, size)?;
            let mut rest = &all[..];
            repeated = prefixed(&mut rest, most_repeated, count)?;
            defined = prefixed(&mut rest, most_defined, count)?;
            bytes = rest.to_vec();
        }
        let there = defined.iter().filter(|level| **level == most_defined).count();
        let numbers = match encoding {
            0 => plain(self.kind, &bytes, there)?,
            2 | 8 => {
                let dictionary = self.dictionary.as_ref().ok_or("a page without its dictionary")?;
                let Some((width, runs)) = bytes.split_first() else {
                    return if there == 0 {
                        Ok(Values { defined, repeated, numbers: vec![] })
                    } else {
                        Err("an empty page".into())
                    };
                };
                let places = hybrid(runs, u32::from(*width), there)?;
                let number = |place: u32| dictionary.get(place as usize).copied();
                places.into_iter().map(number).collect::<Option<_>>().ok_or("a number beyond the dictionary")?
            }
            3 if self.kind == BOOLEAN => prefixed(&mut &bytes[..], 1, there)?.into_iter().map(f64::from).collect(),
            9 => split_into_streams(self.kind, &bytes, there)?,
            other => {
                return Err(format!(
                    "numbers in encoding {other}; plain (0), by dictionary (2, 8) and in streams (9) are read"
                ));
            }
        };
        Ok(Values { defined, repeated, numbers })
    }
}

/// Levels behind their length in bytes, in a page of version 1.
fn prefixed(bytes: &mut &[u8], most: u32, count: usize) -> Result<Vec<u32>, String> {
    if most == 0 {
        return Ok(vec![0; count]);
    }
    let (length, rest) = bytes.split_first_chunk::<4>().ok_or("levels that are cut off")?;
    let length = u32::from_le_bytes(*length) as usize;
    let own = rest.get(..length).ok_or("levels that are cut off")?;
    *bytes = &rest[length..];
    levels(own, most, count)
}

/// So many levels up to `most`.
fn levels(bytes: &[u8], most: u32, count: usize) -> Result<Vec<u32>, String> {
    if most == 0 {
        return Ok(vec![0; count]);
    }
    let all = hybrid(bytes, u32::BITS - most.leading_zeros(), count)?;
    if all.iter().any(|level| *level > most) { Err("levels that are too large".into()) } else { Ok(all) }
}

/// Numbers of `width` bits in runs of one value and in groups of eight.
fn hybrid(bytes: &[u8], width: u32, count: usize) -> Result<Vec<u32>, String> {
    if width > 32 {
        return Err(format!("numbers of {width} bits"));
    }
    let cut = "runs that are cut off";
    let mut out = Vec::with_capacity(count);
    let mut at = 0;
    while out.len() < count {
        let mut head = 0u64;
        for shift in (0..35).step_by(7) {
            let byte = *bytes.get(at).ok_or(cut)?;
            at += 1;
            head |= u64::from(byte & 127) << shift;
            if byte < 128 {
                break;
            }
        }
        let wanted = count - out.len();
        if head & 1 == 0 {
            let length = width.div_ceil(8) as usize;
            let own = bytes.get(at..at + length).ok_or(cut)?;
            at += length;
            let value = own.iter().rev().fold(0u64, |value, byte| value << 8 | u64::from(*byte));
            let run = usize::try_from(head >> 1).unwrap_or(usize::MAX);
            if run == 0 {
                return Err("a run of nothing".into());
            }
            out.resize(out.len() + run.min(wanted), value as u32);
        } else {
            let length = usize::try_from(head >> 1).unwrap_or(usize::MAX).saturating_mul(width as usize);
            // The last group may end with the last value.
            let own = &bytes[at.min(bytes.len())..at.saturating_add(length).min(bytes.len())];
            let groups = usize::try_from(head >> 1).unwrap_or(usize::MAX).saturating_mul(8);
            let there = if width == 0 { groups } else { (8 * own.len() / width as usize).min(groups) };
            if there == 0 {
                return Err(cut.into());
            }
            out.extend((0..there.min(wanted)).map(|k| bits(own, k * width as usize, width)));
            at += own.len();
        }
    }
    Ok(out)
}

/// The number of `width` bits from bit `from` on, the lowest bit first.
fn bits(bytes: &[u8], from: usize, width: u32) -> u32 {
    (0..width as usize).fold(0, |value, k| {
        let bit = from + k;
        value | u32::from(bytes[bit / 8] >> (bit % 8) & 1) << k
    })
}

/// Numbers one after the other.
fn plain(kind: i64, bytes: &[u8], count: usize) -> Result<Vec<f64>, String> {
    let cut = || format!("{count} numbers in {} bytes", bytes.len());
    let own = |width: usize| count.checked_mul(width).and_then(|length| bytes.get(..length)).ok_or_else(cut);
    Ok(match kind {
        BOOLEAN => {
            own(1).or_else(|_| if count.div_ceil(8) <= bytes.len() { Ok(bytes) } else { Err(cut()) })?;
            (0..count).map(|k| f64::from(bits(bytes, k, 1))).collect()
        }
        INT32 | FLOAT => own(4)?.chunks_exact(4).map(|b| number(kind, &[b[0], b[1], b[2], b[3], 0, 0, 0, 0])).collect(),
        _ => own(8)?.chunks_exact(8).map(|b| number(kind, &[b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]])).collect(),
    })
}

/// First bytes of all numbers, then the second ones, and so on.
fn split_into_streams(kind: i64, bytes: &[u8], count: usize) -> Result<Vec<f64>, String> {
    let width = if [INT32, FLOAT].contains(&kind) { 4 } else { 8 };
    if kind == BOOLEAN || count.checked_mul(width).is_none_or(|length| length > bytes.len()) {
        return Err(format!("{count} numbers in {} bytes", bytes.len()));
    }
    let one = |k: usize| {
        let mut own = [0; 8];
        (0..width).for_each(|part| own[part] = bytes[part * count + k]);
        number(kind, &own)
    };
    Ok((0..count).map(one).collect())
}

fn number(kind: i64, b: &[u8; 8]) -> f64 {
    let four = [b[0], b[1], b[2], b[3]];
    match kind {
        INT32 => f64::from(i32::from_le_bytes(four)),
        FLOAT => f64::from(f32::from_le_bytes(four)),
        INT64 => i64::from_le_bytes(*b) as f64,
        _ => f64::from_le_bytes(*b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_groups_are_unpacked() {
        // Encodings.md: 0 to 7 in three bits each.
        assert_eq!(hybrid(&[0b11, 0b1000_1000, 0b1100_0110, 0b1111_1010], 3, 8).unwrap(), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(hybrid(&[10, 4, 4, 1], 3, 7).unwrap(), [4, 4, 4, 4, 4, 1, 1]);
        assert_eq!(hybrid(&[6], 0, 3).unwrap(), [0, 0, 0]);
        assert!(hybrid(&[10], 3, 5).is_err() && hybrid(&[0, 1], 3, 5).is_err() && hybrid(&[3], 3, 5).is_err());
        assert!(hybrid(&[1; 9], 33, 5).is_err());
    }

    #[test]
    fn numbers_are_as_the_format_has_them() {
        let floats: Vec<u8> = [1.5f32, -2.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(plain(FLOAT, &floats, 2).unwrap(), [1.5, -2.0]);
        let streams: Vec<u8> = (0..4).flat_map(|part| [floats[part], floats[4 + part]]).collect();
        assert_eq!(split_into_streams(FLOAT, &streams, 2).unwrap(), [1.5, -2.0]);
        assert_eq!(plain(INT64, &(-3i64).to_le_bytes(), 1).unwrap(), [-3.0]);
        assert_eq!(plain(BOOLEAN, &[0b101], 3).unwrap(), [1.0, 0.0, 1.0]);
        assert!(plain(FLOAT, &floats, 3).is_err() && plain(BOOLEAN, &[], 1).is_err());
        assert!(plain(DOUBLE, &floats, usize::MAX).is_err() && split_into_streams(FLOAT, &streams, 3).is_err());
    }
}
