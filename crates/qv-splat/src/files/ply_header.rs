//! The header of a PLY file (Turk, *The PLY Polygon File Format*, 1994), held against the bytes that follow it.

use crate::SplatError;
use crate::cursor::{f32_at, u32_at};
use crate::error::off;

/// Longest header that is looked through for its end, bytes.
const LONGEST_HEADER: usize = 1 << 20;

/// Type of a property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn of_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A number of each row of an element.
#[derive(Debug, Clone, PartialEq)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
    /// Its place within a row, bytes.
    pub offset: usize,
}

impl Property {
    /// Its value in a row of the element, in single precision.
    pub fn value(&self, row: &[u8]) -> f32 {
        let at = self.offset;
        match self.kind {
            Kind::I8 => f32::from(row[at] as i8),
            Kind::U8 => f32::from(row[at]),
            Kind::I16 => f32::from(i16::from_le_bytes([row[at], row[at + 1]])),
            Kind::U16 => f32::from(u16::from_le_bytes([row[at], row[at + 1]])),
            Kind::I32 => u32_at(row, at) as i32 as f32,
            Kind::U32 => u32_at(row, at) as f32,
            Kind::F32 => f32_at(row, at),
            Kind::F64 => {
                let bits = u64::from(u32_at(row, at)) | u64::from(u32_at(row, at + 4)) << 32;
                f64::from_bits(bits) as f32
            }
        }
    }
}

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
    /// Bytes of a row.
    pub stride: usize,
    /// Where its rows begin in the file, bytes.
    start: usize,
}

impl Element {
    /// A property by name.
    ///
    /// # Errors
    /// There is none.
    pub fn property(&self, name: &str) -> Result<&Property, SplatError> {
        let found = self.properties.iter().find(|property| property.name == name);
        found.ok_or_else(|| {
            let names: Vec<&str> = self.properties.iter().take(8).map(|property| property.name.as_str()).collect();
            let more = if self.properties.len() > names.len() { ", ..." } else { "" };
            off(format!("PLY element {}", self.name), format!("property {name}"), format!("{}{more}", names.join(", ")))
        })
    }

    /// A property by name, which must be of a kind.
    ///
    /// # Errors
    /// There is none, or it is of another kind.
    pub fn property_of(&self, name: &str, kind: Kind) -> Result<&Property, SplatError> {
        let property = self.property(name)?;
        if property.kind != kind {
            let place = format!("PLY element {}, property {name}", self.name);
            return Err(off(place, format!("{kind:?}"), format!("{:?}", property.kind)));
        }
        Ok(property)
    }

    /// Its rows in the file that the header is of.
    pub fn rows<'a>(&self, file: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
        file[self.start..self.start + self.count * self.stride].chunks_exact(self.stride.max(1))
    }
}

/// What a file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    pub elements: Vec<Element>,
    /// Lines of comment, without that word.
    pub comments: Vec<String>,
}

impl Header {
    /// Reads the header of a whole file.
    ///
    /// # Errors
    /// Names the line that is off, ASCII and big-endian files, lists, and counts that do not fit the bytes that are there:
    /// neither may bytes be missing, nor may there be more.
    pub fn parse(file: &[u8]) -> Result<Self, SplatError> {
        let (text, body) = split(file)?;
        let mut elements: Vec<Element> = Vec::new();
        let (mut format, mut comments) = (None, Vec::new());
        for (number, line) in text.lines().enumerate() {
            let place = || format!("PLY header, line {}", number + 1);
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["ply"] if number == 0 => {}
                ["comment", words @ ..] => comments.push(words.join(" ")),
                [] | ["obj_info", ..] => {}
                ["format", kind, version] => {
                    if (*kind, *version) != ("binary_little_endian", "1.0") {
                        return Err(off(place(), "format binary_little_endian 1.0", format!("{kind} {version}")));
                    }
                    format = Some(());
                }
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| off(place(), "a number of rows", count))?;
                    elements.push(Element { name: (*name).into(), count, properties: vec![], stride: 0, start: 0 });
                }
                ["property", "list", ..] => return Err(off(place(), "properties that are no lists", line)),
                ["property", kind, name] => {
                    let kind = Kind::of_name(kind).ok_or_else(|| off(place(), "a type of PLY", kind))?;
                    let element = elements.last_mut().ok_or_else(|| off(place(), "an element first", line))?;
                    element.properties.push(Property { name: (*name).into(), kind, offset: element.stride });
                    element.stride += kind.bytes();
                }
                _ => return Err(off(place(), "format, element, property or comment", shortened(line))),
            }
        }
        format.ok_or_else(|| off("PLY header", "a line with the format", "none"))?;
        place_rows(&mut elements, body, file.len())?;
        Ok(Self { elements, comments })
    }

    /// An element by name.
    pub fn find(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }

    /// An element by name.
    ///
    /// # Errors
    /// There is none.
    pub fn element(&self, name: &str) -> Result<&Element, SplatError> {
        self.find(name).ok_or_else(|| {
            let names: Vec<&str> = self.elements.iter().map(|element| element.name.as_str()).collect();
            off("PLY header", format!("element {name}"), names.join(", "))
        })
    }
}

/// Text of the header before its last line, and where the rows begin.
fn split(file: &[u8]) -> Result<(&str, usize), SplatError> {
    let head = &file[..file.len().min(LONGEST_HEADER)];
    let end = head.windows(11).position(|window| window == b"\nend_header").map(|at| at + 1);
    let end = end.ok_or_else(|| off("PLY header", "a line end_header", format!("none in {} bytes", head.len())))?;
    let after = end + b"end_header".len();
    let body = match head[after..] {
        [b'\n', ..] => after + 1,
        [b'\r', b'\n', ..] => after + 2,
        _ => return Err(off("PLY header", "a line break after end_header", "none")),
    };
    let text = std::str::from_utf8(&head[..end]).map_err(|error| off("PLY header", "text", error))?;
    Ok((text, body))
}

/// Sets where each element's rows begin.
fn place_rows(elements: &mut [Element], body: usize, length: usize) -> Result<(), SplatError> {
    let mut at = body;
    for element in elements.iter_mut() {
        let claimed = element.count as u128 * element.stride as u128;
        if claimed > (length - at) as u128 {
            let place = format!("PLY element {}, {} rows of {} bytes", element.name, element.count, element.stride);
            let expected = u64::try_from(claimed).unwrap_or(u64::MAX);
            return Err(SplatError::CutOff { place, byte: at as u64, expected, found: (length - at) as u64 });
        }
        element.start = at;
        at += claimed as usize;
    }
    if at != length {
        return Err(off(format!("PLY file, byte {at}"), "the end of the file", format!("{} bytes more", length - at)));
    }
    Ok(())
}

/// A line as an error may show it.
fn shortened(line: &str) -> String {
    line.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(header: &str, body: usize) -> String {
        let mut file = header.as_bytes().to_vec();
        file.resize(file.len() + body, 0);
        Header::parse(&file).unwrap_err().to_string()
    }

    #[test]
    fn a_header_is_laid_out() {
        let mut file = b"ply\r\nformat binary_little_endian 1.0\r\ncomment hi\r\nelement a 2\r\nproperty uchar x\r\n\
            property double y\r\nelement b 1\r\nproperty int z\r\nend_header\r\n"
            .to_vec();
        for (x, y) in [(7u8, 0.5f64), (8, -2.0)] {
            file.push(x);
            file.extend(y.to_le_bytes());
        }
        file.extend((-3i32).to_le_bytes());
        let header = Header::parse(&file).unwrap();
        let (a, b) = (header.element("a").unwrap(), header.element("b").unwrap());
        let column = |element: &Element, name: &str| -> Vec<f32> {
            let property = element.property(name).unwrap();
            element.rows(&file).map(|row| property.value(row)).collect()
        };
        assert_eq!((column(a, "x"), column(a, "y"), column(b, "z")), (vec![7.0, 8.0], vec![0.5, -2.0], vec![-3.0]));
    }

    #[test]
    fn each_fault_is_named() {
        let begin = "ply\nformat binary_little_endian 1.0\n";
        assert!(
            fault("ply\nformat ascii 1.0\nend_header\n", 0).contains("line 2: expected format binary_little_endian")
        );
        assert!(fault("ply\nformat binary_big_endian 1.0\nend_header\n", 0).contains("found binary_big_endian 1.0"));
        assert!(fault("ply\nend_header\n", 0).contains("a line with the format"));
        assert!(fault(begin, 9).contains("expected a line end_header"));
        assert!(fault(&format!("{begin}element v x\nend_header\n"), 0).contains("line 3: expected a number of rows"));
        assert!(fault(&format!("{begin}property int x\nend_header\n"), 0).contains("an element first"));
        let list = format!("{begin}element face 1\nproperty list uchar int i\nend_header\n");
        assert!(fault(&list, 0).contains("line 4: expected properties that are no lists"));
        let huge = format!("{begin}element v 18446744073709551615\nproperty double x\nend_header\n");
        assert!(fault(&huge, 16).contains("from byte"), "{}", fault(&huge, 16));
        let one = format!("{begin}element v 1\nproperty int x\nend_header\n");
        assert!(fault(&one, 3).contains("expected 4 bytes from byte"));
        assert!(fault(&one, 5).contains("expected the end of the file, found 1 bytes more"));
    }
}
