//! ZIP archives (PKWARE, *APPNOTE*, 6.3): the members of a bundle, stored or deflated.

use crate::SplatError;
use crate::cursor::{Cursor, u32_at};
use crate::error::off;
use std::io::Read;

/// Bytes of the record at the end, and of an archive's longest comment behind it.
const END: usize = 22;
const LONGEST_COMMENT: usize = 65_535;
/// Members of an archive that are looked at.
const MOST: usize = 10_000;
/// Where a number stands elsewhere, in a record for large archives.
const ELSEWHERE: u32 = u32::MAX;

/// A member.
struct Member<'a> {
    name: &'a [u8],
    /// 0 stored, 8 deflated.
    method: u16,
    packed: u32,
    size: u32,
    start: u32,
    is_encrypted: bool,
}

/// An archive.
pub struct Archive<'a> {
    bytes: &'a [u8],
    members: Vec<Member<'a>>,
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

impl<'a> Archive<'a> {
    /// Reads the directory of an archive.
    ///
    /// # Errors
    /// There is none, it is cut off, or is one for archives above 4 GiB.
    pub fn open(bytes: &'a [u8]) -> Result<Self, SplatError> {
        let from = bytes.len().saturating_sub(END + LONGEST_COMMENT);
        let end = bytes[from..].windows(4).rposition(|four| four == b"PK\x05\x06").map(|at| from + at);
        let Some(end) = end.filter(|end| end + END <= bytes.len()) else {
            return Err(off("ZIP archive", "a directory at its end", "none: it is cut off"));
        };
        let (count, start) = (usize::from(u16_at(bytes, end + 10)), u32_at(bytes, end + 16));
        if start == ELSEWHERE || count == usize::from(u16::MAX) {
            return Err(off("ZIP archive", "one of less than 4 GiB and 65535 members", "a larger one (ZIP64)"));
        }
        let directory = bytes.get(start as usize..end).unwrap_or_default();
        let mut cursor = Cursor::new(directory, "ZIP directory");
        let mut members = Vec::new();
        for _ in 0..count.min(MOST) {
            let head = cursor.take(46, "member")?;
            if head[..4] != *b"PK\x01\x02" {
                return Err(off("ZIP directory", "a member", format!("{:02x?}", &head[..4])));
            }
            let [name, extra, comment] = [28, 30, 32].map(|at| u64::from(u16_at(head, at)));
            members.push(Member {
                name: cursor.take(name, "name")?,
                method: u16_at(head, 10),
                packed: u32_at(head, 20),
                size: u32_at(head, 24),
                start: u32_at(head, 42),
                is_encrypted: head[8] & 1 == 1,
            });
            cursor.take(extra + comment, "member")?;
        }
        Ok(Self { bytes, members })
    }

    /// The contents of the first member with a name, in whatever folder, of at most `most` bytes.
    ///
    /// # Errors
    /// There is none, or it is damaged, encrypted, packed in another way, or larger.
    pub fn get(&self, name: &str, most: u64) -> Result<Vec<u8>, String> {
        let is_it = |path: &[u8]| path.rsplit(|byte| *byte == b'/').next() == Some(name.as_bytes());
        let member = self.members.iter().find(|member| is_it(member.name)).ok_or("no such member in the archive")?;
        if member.is_encrypted {
            return Err("an encrypted member".into());
        }
        if u64::from(member.size) > most {
            return Err(format!("{} bytes, of which at most {most} are read", member.size));
        }
        let start = member.start as usize;
        let head = self.bytes.get(start..start.saturating_add(30)).ok_or("a member beyond the end")?;
        let data = start + 30 + usize::from(u16_at(head, 26)) + usize::from(u16_at(head, 28));
        let packed = self.bytes.get(data..data.saturating_add(member.packed as usize));
        let packed = packed.ok_or("a member beyond the end")?;
        let mut out = Vec::new();
        match member.method {
            0 => out.extend_from_slice(packed),
            8 => {
                let mut decoder = flate2::read::DeflateDecoder::new(packed).take(u64::from(member.size) + 1);
                decoder.read_to_end(&mut out).map_err(|error| error.to_string())?;
            }
            other => return Err(format!("a member packed by method {other}; stored and deflated ones are read")),
        }
        if out.len() != member.size as usize {
            return Err(format!("{} bytes instead of {}", out.len(), member.size));
        }
        Ok(out)
    }
}

/// An archive of members, each stored or deflated. For tests.
#[cfg(test)]
pub fn archive(members: &[(&str, &[u8])], deflate: bool) -> Vec<u8> {
    use std::io::Write;
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for (name, contents) in members {
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(contents).unwrap();
        let packed = if deflate { encoder.finish().unwrap() } else { contents.to_vec() };
        let mut sizes = vec![0; 4];
        sizes.extend((packed.len() as u32).to_le_bytes());
        sizes.extend((contents.len() as u32).to_le_bytes());
        sizes.extend((name.len() as u16).to_le_bytes());
        sizes.extend([0, 0]);
        let common = [&[20, 0, 0, 0, if deflate { 8 } else { 0 }, 0, 0, 0, 0, 0], &sizes[..]].concat();
        directory.extend(b"PK\x01\x02\x14\0");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend((out.len() as u32).to_le_bytes());
        directory.extend(name.as_bytes());
        out.extend(b"PK\x03\x04");
        out.extend(&common);
        out.extend(name.as_bytes());
        out.extend(packed);
    }
    let start = out.len() as u32;
    out.extend(&directory);
    out.extend(b"PK\x05\x06\0\0\0\0");
    out.extend([(members.len() as u16).to_le_bytes(); 2].concat());
    out.extend((directory.len() as u32).to_le_bytes());
    out.extend(start.to_le_bytes());
    out.extend([0, 0]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn members_come_out_as_they_went_in() {
        let long = vec![7u8; 1000];
        for deflate in [false, true] {
            let bytes = archive(&[("scene/a.txt", b"hello"), ("b", &long)], deflate);
            let open = Archive::open(&bytes).unwrap();
            assert_eq!(open.get("a.txt", 10).unwrap(), b"hello");
            assert_eq!(open.get("b", 1000).unwrap(), long);
            assert!(open.get("b", 999).unwrap_err().states("most 999"));
            assert!(open.get("c", 9).unwrap_err().states("member"));
            for length in 0..bytes.len() {
                assert!(Archive::open(&bytes[..length]).is_err(), "{length}");
            }
            let mut n = 0usize;
            for at in 0..bytes.len() {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << (at % 8);
                if let Ok(open) = Archive::open(&damaged) {
                    n += usize::from(open.get("b", 1000).is_ok());
                }
            }
            assert!(n > 0);
        }
    }
}
