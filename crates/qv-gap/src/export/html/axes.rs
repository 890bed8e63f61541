//! What plots share: ranges, ticks, lines, levels of colour.

use super::words::fixed;
use std::fmt::Write;

/// Points of a line: more cannot be seen.
const POINTS: usize = 800;
/// Colours of amounts, `h0` to `h8`.
pub(super) const LEVELS: usize = 9;

/// Least and greatest finite value; `None` without any.
pub(super) fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.filter(|x| x.is_finite()).fold(None, |found: Option<[f64; 2]>, x| {
        let [low, high] = found.unwrap_or([x, x]);
        Some([low.min(x), high.max(x)])
    })
}

/// A little wider, and never without width.
pub(super) fn padded(range: [f64; 2]) -> [f64; 2] {
    let least = 1e-9 * range[0].abs().max(range[1].abs()).max(1.0);
    let pad = (0.06 * (range[1] - range[0])).max(least);
    [range[0] - pad, range[1] + pad]
}

/// A linear map from data to the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    /// Data.
    pub from: [f64; 2],
    /// Picture; may fall.
    pub to: [f64; 2],
}

impl Axis {
    /// Where a value is.
    pub fn at(&self, x: f64) -> f64 {
        let [a, b] = self.from;
        self.to[0] + (x - a) / (b - a) * (self.to[1] - self.to[0])
    }
}

/// Round numbers within a range, about `count` of them, as value and text.
pub(super) fn ticks(range: [f64; 2], count: f64) -> Vec<(f64, String)> {
    let raw = (range[1] - range[0]) / count;
    if !(raw > 0.0 && raw.is_finite()) {
        return Vec::new();
    }
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= 0.999 * raw).unwrap_or(10.0 * power);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (range[0] / step - 1e-9).ceil();
    let all = (0..20).map(|k| (first + f64::from(k)) * step).take_while(|x| *x <= range[1] + 1e-9 * step);
    all.map(|x| (x, fixed(x, decimals))).collect()
}

/// Path commands for the points; breaks where they are not finite.
pub(super) fn path(x: &[f64], y: &[f64], xs: Axis, ys: Axis) -> String {
    let count = x.len().min(y.len());
    let stride = count.div_ceil(POINTS).max(1);
    let mut text = String::new();
    let mut pen_up = true;
    for i in 0..count {
        if !(x[i].is_finite() && y[i].is_finite()) {
            pen_up = true;
        } else if i % stride == 0 || pen_up || i + 1 == count {
            let _ = write!(text, "{}{:.1} {:.1}", if pen_up { 'M' } else { 'L' }, xs.at(x[i]), ys.at(y[i]));
            pen_up = false;
        }
    }
    text
}

/// Class of colour for a share of the scale, 0 to 1; its own for what is not known.
pub(super) fn level(share: f64) -> String {
    if !share.is_finite() {
        return "hn".into();
    }
    format!("h{}", ((share * LEVELS as f64) as usize).min(LEVELS - 1))
}

/// The value that all but a few of the largest stay below, so that one outlier does not take all colours.
pub(super) fn top(values: impl Iterator<Item = f64>) -> f64 {
    let mut known: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    known.sort_by(f64::total_cmp);
    let at = (0.98 * known.len() as f64) as usize;
    known.get(at.min(known.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

/// A strip of all colours with what they stand for.
pub(super) fn legend(what: &str, labels: [String; 3]) -> String {
    let mut svg = String::from("<svg class=\"legend\" viewBox=\"0 0 420 34\" aria-hidden=\"true\">");
    for k in 0..LEVELS {
        let _ = write!(svg, "<rect class=\"h{k}\" x=\"{}\" y=\"2\" width=\"24.5\" height=\"11\"/>", 24 * k);
    }
    let right = 24 * LEVELS;
    // The lightest colours are those of the paper.
    let _ = write!(svg, "<rect class=\"axis\" x=\"0.5\" y=\"2\" width=\"{right}\" height=\"11\"/>");
    for (label, (x, anchor)) in labels.iter().zip([(0, "start"), (right / 2, "middle"), (right, "end")]) {
        let _ = write!(svg, "<text x=\"{x}\" y=\"28\" text-anchor=\"{anchor}\">{label}</text>");
    }
    let _ = write!(svg, "<text x=\"{}\" y=\"12\">{what}</text>", right + 10);
    svg + "</svg>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let texts = |range, count| ticks(range, count).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(texts([0.0, 10.0], 5.0), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(texts([-0.31, 0.12], 4.0), ["−0.2", "0.0"]);
        assert_eq!(texts([0.0, 0.3], 3.0), ["0.0", "0.1", "0.2", "0.3"]);
        assert!(texts([1.0, 1.0], 5.0).is_empty() && texts([0.0, f64::NAN], 5.0).is_empty());
    }

    #[test]
    fn lines_break_where_nothing_is_known() {
        let axis = Axis { from: [0.0, 1.0], to: [0.0, 10.0] };
        let found = path(&[0.0, 0.5, f64::NAN, 1.0], &[0.0, 1.0, 1.0, 0.0], axis, axis);
        assert_eq!(found, "M0.0 0.0L5.0 10.0M10.0 0.0");
        assert_eq!(path(&[], &[1.0], axis, axis), "");
    }

    #[test]
    fn colours_and_their_top() {
        assert_eq!([level(0.0), level(0.99), level(7.0), level(f64::NAN)], ["h0", "h8", "h8", "hn"]);
        assert_eq!(top((0..1000).map(f64::from).chain([f64::NAN])), 980.0);
        assert_eq!(top([3.0].into_iter()), 3.0);
        assert_eq!(top(std::iter::empty()), 0.0);
    }
}
