//! The header of a PLY file (Turk, *The PLY Polygon File Format*, 1994), held against the bytes that follow it.

use crate::SplatError;
use crate::cursor::{f32_at, u32_at};
use crate::error::off;
use std::io::Read;

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
    pub start: usize,
    /// Whether a property is a list: its rows have no length then, and none of them is read.
    lists: bool,
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
    /// Elements whose rows are in the file, up to the first with lists that has any.
    pub elements: Vec<Element>,
    /// Lines of comment, without that word.
    pub comments: Vec<String>,
    /// Where the rows begin in the file, bytes.
    pub body: usize,
    /// Elements from the first with lists on that has rows, by name.
    unread: Vec<String>,
    /// Bytes behind the rows of `elements`.
    rest: u64,
}

/// What is said of what follows the rows that are read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Remarks {
    pub remarks: Vec<String>,
    pub lost: Vec<String>,
}

impl Header {
    /// Reads the header of a whole file.
    ///
    /// # Errors
    /// As [`Self::parse_head`].
    pub fn parse(file: &[u8]) -> Result<Self, SplatError> {
        Self::parse_head(file, file.len() as u64)
    }

    /// Reads the header at the beginning of a file of `length` bytes, of which `head` has at least the header.
    ///
    /// # Errors
    /// Names the line that is off, ASCII and big-endian files, and counts that need more bytes than are there.
    pub fn parse_head(head: &[u8], length: u64) -> Result<Self, SplatError> {
        let (text, body) = split(head)?;
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
                    let (name, properties) = ((*name).into(), vec![]);
                    elements.push(Element { name, count, properties, stride: 0, start: 0, lists: false });
                }
                ["property", "list", ..] => {
                    elements.last_mut().ok_or_else(|| off(place(), "an element first", line))?.lists = true;
                }
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
        let known = elements.iter().position(|element| element.lists && element.count > 0).unwrap_or(elements.len());
        let unread = elements.split_off(known).into_iter().map(|element| element.name).collect();
        let end = place_rows(&mut elements, body, length)?;
        Ok(Self { elements, comments, body, unread, rest: length - end })
    }

    /// What is behind the rows that are known: nothing, elements of which no cloud is made, or bytes that no line of the header speaks of.
    /// `is_blank` says whether all of them are blanks, line breaks or zeros.
    pub fn remarks(&self, is_blank: bool) -> Remarks {
        let mut out = Remarks::default();
        if !self.unread.is_empty() {
            out.lost.push(format!("PLY elements {}: lists", self.unread.join(", ")));
        } else if self.rest > 0 && is_blank {
            out.remarks.push(format!("{} blank bytes after the data", self.rest));
        } else if self.rest > 0 {
            out.lost.push(format!("{} bytes after the data, of which the header says nothing", self.rest));
        }
        out
    }

    /// [`Self::remarks`] of a whole file.
    pub fn remarks_of(&self, file: &[u8]) -> Remarks {
        self.remarks(is_blank(&file[file.len() - self.rest as usize..]))
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
            let lists = if self.unread.iter().any(|unread| unread == name) { " before any with lists" } else { "" };
            off("PLY header", format!("element {name}{lists}"), names.join(", "))
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

/// Sets where each element's rows begin; gives where the last ones end.
fn place_rows(elements: &mut [Element], body: usize, length: u64) -> Result<u64, SplatError> {
    let mut at = body as u64;
    for element in elements.iter_mut() {
        let claimed = element.count as u128 * element.stride as u128;
        if claimed > u128::from(length - at) {
            let place = format!("PLY element {}, {} rows of {} bytes", element.name, element.count, element.stride);
            let expected = u64::try_from(claimed).unwrap_or(u64::MAX);
            return Err(SplatError::CutOff { place, byte: at, expected, found: length - at });
        }
        element.start = at as usize;
        at += claimed as u64;
    }
    Ok(at)
}

/// Whether bytes say nothing.
pub fn is_blank(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| byte.is_ascii_whitespace() || *byte == 0)
}

/// Bytes of the header at the front of a stream, and what of the rows was read with it.
///
/// # Errors
/// It cannot be read. Whether there is a header, [`Header::parse_head`] says.
pub fn head_of(mut source: &mut dyn Read) -> Result<Vec<u8>, SplatError> {
    const STEP: u64 = 4096;
    let mut head = Vec::new();
    loop {
        let before = head.len();
        let read = Read::take(&mut source, STEP).read_to_end(&mut head);
        read.map_err(|error| off("PLY file", "bytes that can be read", error))?;
        // The line break after the last line may come with the next bytes.
        let from = before.saturating_sub(16);
        let end = head[from..].windows(11).position(|window| window == b"\nend_header").map(|at| from + at);
        if head.len() == before || head.len() > LONGEST_HEADER || end.is_some_and(|end| end + 13 <= head.len()) {
            return Ok(head);
        }
    }
}

/// A line as an error may show it.
fn shortened(line: &str) -> String {
    line.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

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
        assert!(fault("ply\nformat ascii 1.0\nend_header\n", 0).states("2 binary_little_endian"));
        assert!(fault("ply\nformat binary_big_endian 1.0\nend_header\n", 0).states("binary_big_endian 1.0"));
        assert!(fault("ply\nend_header\n", 0).states("format"));
        assert!(fault(begin, 9).states("end_header"));
        assert!(fault(&format!("{begin}element v x\nend_header\n"), 0).states("number 3"));
        assert!(fault(&format!("{begin}property int x\nend_header\n"), 0).states("element"));
        assert!(fault(&format!("{begin}property list uchar int i\nend_header\n"), 0).states("element"));
        let huge = format!("{begin}element v 18446744073709551615\nproperty double x\nend_header\n");
        assert!(fault(&huge, 16).states("byte"), "{}", fault(&huge, 16));
        let one = format!("{begin}element v 1\nproperty int x\nend_header\n");
        assert!(fault(&one, 3).states("bytes 4"));
    }

    #[test]
    fn what_follows_the_rows_is_said() {
        let one = "ply\nformat binary_little_endian 1.0\nelement v 1\nproperty uchar x\n";
        let list = "element face COUNT\nproperty list uchar int i\n";
        let remarks = |middle: &str, body: &[u8]| {
            let file = [format!("{one}{middle}end_header\n").as_bytes(), body].concat();
            let header = Header::parse(&file).unwrap();
            assert_eq!(header.elements[0].rows(&file).collect::<Vec<_>>(), [&body[..1]]);
            let head = head_of(&mut &file[..]).unwrap();
            assert_eq!(Header::parse_head(&head, file.len() as u64).unwrap(), header);
            let Remarks { remarks, lost } = header.remarks_of(&file);
            [remarks, lost].map(|lines| lines.join("; "))
        };
        let nothing = String::new;
        assert_eq!(remarks(&list.replace("COUNT", "0"), &[7]), [nothing(), nothing()]);
        assert_eq!(remarks(&list.replace("COUNT", "2"), &[7, 1, 2]), [nothing(), "PLY elements face: lists".into()]);
        assert_eq!(remarks("", b"7 \n"), ["2 blank bytes after the data".into(), nothing()]);
        assert!(remarks("", b"7x")[1].states("bytes 1"));
        let first = format!(
            "ply\nformat binary_little_endian 1.0\n{}element v 1\nproperty uchar x\nend_header\n",
            list.replace("COUNT", "1")
        );
        let header = Header::parse(first.as_bytes()).unwrap();
        assert!(header.element("v").unwrap_err().to_string().states("element"));
    }
}
