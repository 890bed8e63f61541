//! Columns of numbers as short text: rounded to a step, one to three bytes each, in base64.
//!
//! A number is `first + code * step`. The caller says the step: the smallest difference that is worth seeing, such as 1e-5 rad. A
//! column takes as many bytes as its range needs; where three are too few, the step grows to a 2²⁴th of the range. The highest code
//! is a gap. Numbers that are evenly spread, as most times are, need no codes at all.

use serde::{Deserialize, Serialize};

/// Codes of the least column that has them.
const FEW: f64 = 256.0;

/// A column of numbers, see the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PackedColumn {
    /// How many numbers.
    pub n: usize,
    /// The number of code 0.
    pub first: f64,
    /// What a code is worth; between neighbours where there are no codes.
    pub step: f64,
    /// Bytes of a code, the least one first; 0 where the numbers are evenly spread.
    pub bytes: usize,
    /// The codes in base64.
    #[serde(skip_serializing_if = "String::is_empty", default)]
    pub data: String,
}

/// Packs numbers to a `step`, in their own unit; a step that is none is a 2¹⁶th of their range. What is not finite becomes a gap.
pub fn pack(values: &[f64], step: f64) -> PackedColumn {
    let (low, high) = values
        .iter()
        .filter(|x| x.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)));
    let range = if low <= high { high - low } else { 0.0 };
    let is_step = step.is_finite() && step > 0.0;
    let step = if is_step { step } else { (range / (FEW.powi(2) - 4.0)).max(1e-300) };
    if let Some(even) = evenly(values, step) {
        return even;
    }
    let step = step.max(range / (FEW.powi(3) - 4.0));
    // Whole steps, so that sums are round numbers.
    let first = if low <= high { (low / step).floor() * step } else { 0.0 };
    let highest = if low <= high { ((high - first) / step).round() } else { 0.0 };
    let bytes = (1..3).find(|&b| highest < FEW.powi(b) - 1.0).unwrap_or(3) as usize;
    let gap = FEW.powi(bytes as i32) - 1.0;
    let code = |x: f64| if x.is_finite() { ((x - first) / step).round().clamp(0.0, gap - 1.0) } else { gap };
    let codes: Vec<u8> = values.iter().flat_map(|&x| (code(x) as u32).to_le_bytes().into_iter().take(bytes)).collect();
    PackedColumn { n: values.len(), first, step, bytes, data: to_base64(&codes) }
}

/// The column without codes, where each number is within half a step of one that is evenly spread.
fn evenly(values: &[f64], step: f64) -> Option<PackedColumn> {
    let (first, last) = (*values.first()?, *values.last()?);
    let every = if values.len() > 1 { (last - first) / (values.len() - 1) as f64 } else { 0.0 };
    let fits = |(k, x): (usize, &f64)| (first + k as f64 * every - x).abs() <= 0.5 * step;
    let fits = first.is_finite() && every.is_finite() && values.iter().enumerate().all(fits);
    fits.then_some(PackedColumn { n: values.len(), first, step: every, bytes: 0, data: String::new() })
}

/// The numbers again, a gap as NaN; `None` where the codes are not as many as they say.
pub fn unpack(packed: &PackedColumn) -> Option<Vec<f64>> {
    let PackedColumn { n, first, step, bytes, data } = packed;
    if *bytes == 0 {
        return Some((0..*n).map(|k| first + k as f64 * step).collect());
    }
    let codes = from_base64(data)?;
    if *bytes > 3 || codes.len() != n.checked_mul(*bytes)? {
        return None;
    }
    let gap = (1u32 << (8 * bytes)) - 1;
    let number = |code: &[u8]| {
        let code = code.iter().rev().fold(0, |sum, byte| 256 * sum + u32::from(*byte));
        if code == gap { f64::NAN } else { first + f64::from(code) * step }
    };
    Some(codes.chunks_exact(*bytes).map(number).collect())
}

const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Base64 of bytes (RFC 4648, section 4), also for pictures in a page.
pub fn to_base64(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|i| u32::from(chunk.get(i).copied().unwrap_or(0)));
        let word = a << 16 | b << 8 | c;
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k) & 63) as usize] as char;
            out.push(if k <= chunk.len() { digit } else { '=' });
        }
    }
    out
}

/// The bytes again; `None` of what is no base64.
pub fn from_base64(text: &str) -> Option<Vec<u8>> {
    let text = text.as_bytes();
    if !text.len().is_multiple_of(4) {
        return None;
    }
    let padding = text.iter().rev().take(2).take_while(|c| **c == b'=').count();
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    for group in text[..text.len() - padding].chunks(4) {
        let mut word = 0;
        for k in 0..4 {
            let digit = match group.get(k) {
                Some(c) => DIGITS.iter().position(|d| d == c)? as u32,
                None => 0,
            };
            word = word << 6 | digit;
        }
        out.extend_from_slice(&word.to_be_bytes()[1..group.len()]);
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn back(values: &[f64], step: f64) -> (PackedColumn, Vec<f64>) {
        let packed = pack(values, step);
        let text = serde_json::to_string(&packed).unwrap();
        let read: PackedColumn = serde_json::from_str(&text).unwrap();
        (packed, unpack(&read).unwrap())
    }

    #[test]
    fn base64_as_the_standard_has_it() {
        // RFC 4648, section 10.
        for (text, expected) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(to_base64(text.as_bytes()), expected);
            assert_eq!(from_base64(expected).unwrap(), text.as_bytes());
        }
        for wrong in ["Zg=", "Z*==", "====", "Zm9v\n"] {
            assert!(from_base64(wrong).is_none(), "{wrong}");
        }
    }

    #[test]
    fn numbers_come_back_to_half_a_step_in_as_few_bytes_as_they_need() {
        let wave = |size: f64| (0..1000).map(|k| size * (0.1 * f64::from(k)).sin()).collect::<Vec<f64>>();
        for (size, step, bytes) in [(1.0, 0.01, 1), (1.0, 1e-4, 2), (1.0, 1e-6, 3), (1e3, 1e-9, 3), (1e-12, 1e-3, 0)] {
            let values = wave(size);
            let (packed, found) = back(&values, step);
            assert_eq!(packed.bytes, bytes, "{size} {step}");
            let worst = values.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst <= 0.501 * packed.step.max(step), "{size} {step}: {worst}");
        }
    }

    #[test]
    fn gaps_stay_gaps_and_round_numbers_stay_round() {
        let (packed, found) = back(&[0.1, f64::NAN, 0.3, f64::INFINITY, 7.7], 0.1);
        assert_eq!(packed.bytes, 1);
        assert!(found[1].is_nan() && found[3].is_nan());
        assert_eq!([found[0], found[2], found[4]].map(|x| format!("{x:.1}")), ["0.1", "0.3", "7.7"]);
        let (_, all) = back(&[f64::NAN; 3], 1.0);
        assert!(all.len() == 3 && all.iter().all(|x| x.is_nan()));
        assert!(back(&[], 1.0).1.is_empty());
        assert_eq!(back(&[2.5], 1.0).1, [2.5]);
    }

    #[test]
    fn times_need_no_codes_and_every_code_below_the_gap_is_a_number() {
        let times: Vec<f64> = (0..10_000).map(|k| 5.0 + 0.002 * f64::from(k)).collect();
        let (packed, found) = back(&times, 1e-5);
        assert!(packed.data.is_empty() && (found[9_999] - times[9_999]).abs() < 1e-9);
        let mut uneven = times;
        uneven[7] += 0.001;
        assert_eq!(pack(&uneven, 1e-5).bytes, 3);
        let values: Vec<f64> = [(0..255).map(f64::from).collect(), vec![0.0]].concat();
        let (packed, found) = back(&values, 1.0);
        assert!(packed.bytes == 1 && found == values);
        assert_eq!(pack(&[values, vec![255.0]].concat(), 1.0).bytes, 2);
    }

    #[test]
    fn a_step_that_is_none_is_a_share_of_the_range_and_codes_that_lack_are_told() {
        let (packed, found) = back(&[0.0, 3.0, 1.0], f64::NAN);
        assert!(packed.bytes == 2 && (found[1] - 3.0).abs() < 1e-4);
        for wrong in
            [PackedColumn { n: 4, ..packed.clone() }, PackedColumn { bytes: 9, n: usize::MAX, ..packed.clone() }]
        {
            assert!(unpack(&wrong).is_none());
        }
        assert!(unpack(&PackedColumn { data: "?".into(), ..packed }).is_none());
    }
}
