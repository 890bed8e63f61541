//! How a table is written: separator, decimal commas, unit of time. Found by looking, and reported.

use crate::clean::median_interval;
use std::io::{Chain, Cursor, Read};

/// Bytes that are looked at for the header line.
const HEAD: u64 = 1 << 20;

/// Separators of columns, the usual one first.
const SEPARATORS: [(u8, &str); 4] = [(b',', "commas"), (b';', "semicolons"), (b'\t', "tabs"), (b'|', "bars")];

/// The separator of which the first line has most, with its name, and a reader that gives all bytes again. An error of reading
/// comes with the bytes.
pub(super) fn separator<R: Read>(mut csv: R) -> (u8, &'static str, Chain<Cursor<Vec<u8>>, R>) {
    let mut head = Vec::new();
    // What cannot be read here cannot be read again either: the rows end there, which is reported then.
    let _ = csv.by_ref().take(HEAD).read_to_end(&mut head);
    // Excel's way to say it, in a line of its own.
    let said = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&head).strip_prefix(b"sep=");
    let said = said.and_then(|rest| Some((*rest.first()?, rest.iter().position(|b| *b == b'\n')? + 1, rest.len())));
    if let Some((separator, end, length)) = said {
        let name = SEPARATORS.iter().find(|(byte, _)| *byte == separator).map_or("a separator of its own", |s| s.1);
        let rest = head.split_off(head.len() - length + end);
        return (separator, name, Cursor::new(rest).chain(csv));
    }
    let line = head.split(|b| *b == b'\n').find(|line| !line.trim_ascii().is_empty()).unwrap_or_default();
    let count = |separator: u8| {
        let mut quoted = false;
        let mut is_outside = |b: &&u8| {
            quoted ^= **b == b'"';
            !quoted && **b == separator
        };
        line.iter().filter(|b| is_outside(b)).count()
    };
    // Of equal counts the first one holds.
    let (separator, name) = SEPARATORS.into_iter().rev().max_by_key(|(byte, _)| count(*byte)).unwrap_or(SEPARATORS[0]);
    (separator, name, Cursor::new(head).chain(csv))
}

/// Cells become numbers.
#[derive(Debug, Default)]
pub(super) struct Cells {
    /// Cells with a decimal comma.
    pub commas: usize,
    /// The first stamp, where it is a whole number that a float cannot hold.
    first: Option<i128>,
}

impl Cells {
    /// A number with a decimal point, or with a single comma in its place.
    pub(super) fn number(&mut self, cell: &[u8]) -> Option<f64> {
        let text = std::str::from_utf8(cell).ok()?.trim();
        if let Ok(number) = text.parse() {
            return Some(number);
        }
        if text.matches(',').count() != 1 || text.contains('.') {
            return None;
        }
        let number = text.replace(',', ".").parse().ok()?;
        self.commas += 1;
        Some(number)
    }

    /// A stamp. Where the first one is a whole number above 2^53, such as nanoseconds since the epoch, all count from it: as
    /// floats they would be steps of a quarter of a microsecond.
    pub(super) fn stamp(&mut self, cell: &[u8], is_first: bool) -> Option<f64> {
        let whole = || std::str::from_utf8(cell).ok()?.trim().parse::<i128>().ok();
        if is_first {
            self.first = whole().filter(|t| t.abs() > 1 << 53);
        }
        match (self.first, self.first.and_then(|_| whole())) {
            (Some(first), Some(stamp)) => Some((stamp - first) as f64),
            (Some(first), None) => self.number(cell).map(|t| t - first as f64),
            _ => self.number(cell),
        }
        .filter(|t| t.is_finite())
    }

    /// The first stamp as it stands in the file.
    pub(super) fn first_stamp(&self, time: &[f64]) -> f64 {
        self.first.map_or(time.first().copied().unwrap_or(0.0), |t| t as f64)
    }
}

/// Seconds in a unit of time, and its name.
pub(crate) type Unit = (f64, &'static str);

const UNITS: [Unit; 4] = [(1.0, "seconds"), (1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds")];

/// Seconds since the epoch in the years 2001 to 2100.
const EPOCH: std::ops::Range<f64> = 1e9..4.1e9;

/// Longest interval of recordings of joints \[s\]: below five a second nothing can be derived of them.
const SLOWEST: f64 = 0.2;

/// The largest unit in which the typical interval is at most [`SLOWEST`]; of several such, the one in which stamps are times of this
/// century. A clock that counts microseconds since the robot was switched on passes through this century's seconds, too, but
/// not in steps of hours.
pub(crate) fn unit_of_time(first: f64, time: &[f64]) -> Unit {
    let interval = median_interval(time);
    // Of one row, or none that can be distinguished, nothing is known.
    let fits = |(seconds, _): &Unit| !interval.is_finite() || interval * seconds <= SLOWEST;
    let is_of_this_century = |(seconds, _): &Unit| EPOCH.contains(&(first * seconds));
    let mut all = UNITS.into_iter().filter(fits);
    let largest = all.clone().next();
    all.find(is_of_this_century).or(largest).unwrap_or(UNITS[0])
}

/// The unit that somebody states: `s`, `ms`, `us` or `ns`.
pub(super) fn stated_unit(word: &str) -> Option<Unit> {
    ["s", "ms", "us", "ns"].iter().position(|known| *known == word).map(|k| UNITS[k])
}

/// Text in UTF-16, which spreadsheets write, as UTF-8; everything else as it is.
pub(super) fn in_utf8<R: Read>(mut csv: R) -> Result<Chain<Cursor<Vec<u8>>, R>, String> {
    let mut bytes = Vec::new();
    csv.by_ref().take(2).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    let of: fn([u8; 2]) -> u16 = match bytes[..] {
        [0xff, 0xfe] => u16::from_le_bytes,
        [0xfe, 0xff] => u16::from_be_bytes,
        _ => return Ok(Cursor::new(bytes).chain(csv)),
    };
    let mut rest = Vec::new();
    csv.read_to_end(&mut rest).map_err(|e| e.to_string())?;
    let units = rest.chunks_exact(2).map(|pair| of([pair[0], pair[1]]));
    let text: String = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
    Ok(Cursor::new(text.into_bytes()).chain(csv))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separators_are_counted_outside_of_quotes() {
        for (header, right) in [
            ("time,pos.a", b','),
            ("time;pos.a;pos.b\n1,5;2;3", b';'),
            ("\n\ntime\tpos.a", b'\t'),
            ("time|pos.a", b'|'),
            ("time", b','),
            ("\"a,b,c,d\";time", b';'),
            ("", b','),
            ("time;pos.a,b,c,d\n", b','),
        ] {
            let (found, _, mut again) = separator(header.as_bytes());
            let mut text = String::new();
            again.read_to_string(&mut text).unwrap();
            assert_eq!((found, text.as_str()), (right, header));
        }
    }

    #[test]
    fn a_line_that_says_the_separator_is_no_header() {
        let (found, name, mut rest) = separator(&b"\xef\xbb\xbfsep=;\r\ntime;pos.a,b,c\n"[..]);
        let mut text = String::new();
        rest.read_to_string(&mut text).unwrap();
        assert_eq!((found, name, text.as_str()), (b';', "semicolons", "time;pos.a,b,c\n"));
    }

    #[test]
    fn utf_16_becomes_utf_8() {
        let little: Vec<u8> = "\u{feff}time\u{e4}".encode_utf16().flat_map(u16::to_le_bytes).collect();
        for (bytes, right) in [(&little[..], "time\u{e4}"), (b"time", "time"), (b"", "")] {
            let mut text = String::new();
            in_utf8(bytes).unwrap().read_to_string(&mut text).unwrap();
            assert_eq!(text, right);
        }
    }

    #[test]
    fn cells_become_numbers() {
        let mut cells = Cells::default();
        for (cell, right) in
            [("1.5", Some(1.5)), (" -2e3 ", Some(-2e3)), ("", None), ("1.234,5", None), ("1,2,3", None)]
        {
            assert_eq!(cells.number(cell.as_bytes()), right, "{cell}");
        }
        assert_eq!((cells.number(b"0,25"), cells.commas), (Some(0.25), 1));
        assert_eq!(cells.stamp(b"1700000000000000001", true), Some(0.0));
        assert_eq!(cells.stamp(b"1700000000000000003", false), Some(2.0));
        assert_eq!(cells.first_stamp(&[0.0, 2.0]), 1.7e18);
        assert_eq!(cells.stamp(b"nan", false), None);
    }

    #[test]
    fn units_are_found_by_size() {
        let from = |start: f64, step: f64| (0..50).map(|k| start + step * f64::from(k)).collect::<Vec<_>>();
        for (start, step, right) in [
            (0.0, 0.002, 1.0),
            (0.0, 0.1, 1.0),
            (1.7e9, 0.002, 1.0),
            // Time since the robot was switched on: 20 minutes, 30 minutes, 14 days.
            (1.2e9, 2000.0, 1e-6),
            (1.8e12, 2e6, 1e-9),
            (1.2096e9, 2.0, 1e-3),
            (0.0, 2.0, 1e-3),
            (1.7e12, 2.0, 1e-3),
            (0.0, 2000.0, 1e-6),
            (5e5, 1e5, 1e-6),
            (1.7e15, 2e3, 1e-6),
            (0.0, 2e6, 1e-9),
        ] {
            let time = from(start, step);
            assert_eq!(unit_of_time(time[0], &time).0, right, "from {start} by {step}");
        }
        assert_eq!(unit_of_time(3.0, &[3.0]).0, 1.0);
        assert_eq!(unit_of_time(1.7e18, &[0.0, 2e6, 4e6]).0, 1e-9);
    }
}
