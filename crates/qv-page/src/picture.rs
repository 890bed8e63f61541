//! What drawings share: ranges, ticks, lines, levels of colour.

use crate::number::fixed;
use std::fmt::Write;

/// Stretches along a line of which the least and the greatest value are drawn: more cannot be seen.
const STRETCHES: usize = 400;
/// Colours of amounts, `h0` to `h8` of the style.
pub const LEVELS: usize = 9;

/// Least and greatest finite value; `None` without any.
pub fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.filter(|x| x.is_finite()).fold(None, |found: Option<[f64; 2]>, x| {
        let [low, high] = found.unwrap_or([x, x]);
        Some([low.min(x), high.max(x)])
    })
}

/// A little wider, and never without width.
pub fn padded(range: [f64; 2]) -> [f64; 2] {
    let least = 1e-9 * range[0].abs().max(range[1].abs()).max(1.0);
    let pad = (0.06 * (range[1] - range[0])).max(least);
    [range[0] - pad, range[1] + pad]
}

/// A linear map from data to the picture.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
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

/// Both axes of a map of the ground in one scale, for places in `x` and `y` \[m\] on `inner` pixels of width, and its height
/// \[pixels\], within `heights`. `corner` is the upper left one.
pub fn map(x: [f64; 2], y: [f64; 2], inner: f64, heights: [f64; 2], corner: [f64; 2]) -> (Axis, Axis, f64) {
    // A straight walk needs no square.
    let height = (inner * (y[1] - y[0]) / (x[1] - x[0])).clamp(heights[0], heights[1]);
    let scale = ((x[1] - x[0]) / inner).max((y[1] - y[0]) / height).max(1e-4);
    let widened = |r: [f64; 2], pixels: f64| {
        let extra = 0.5 * (scale * pixels - (r[1] - r[0]));
        [r[0] - extra, r[1] + extra]
    };
    let xs = Axis { from: widened(x, inner), to: [corner[0], corner[0] + inner] };
    let ys = Axis { from: widened(y, height), to: [corner[1] + height, corner[1]] };
    (xs, ys, height)
}

/// Round numbers within a range, about `count` of them, as value and text.
pub fn ticks(range: [f64; 2], count: f64) -> Vec<(f64, String)> {
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

/// Lines and numbers of both axes, within them; names of the axes are escaped by the caller.
pub fn axes(xs: Axis, ys: Axis, x_name: &str, y_name: &str) -> String {
    let ([left, right], [bottom, top]) = (xs.to, ys.to);
    let mut svg = String::new();
    for (x, label) in ticks(xs.from, ((right - left) / 80.0).max(2.0)) {
        let at = xs.at(x);
        let _ = write!(svg, "<path class=\"axis\" d=\"M{at:.1} {top:.1}V{bottom:.1}\"/>");
        let _ = write!(svg, "<text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>", bottom + 15.0);
    }
    for (y, label) in ticks(ys.from, ((bottom - top) / 32.0).clamp(2.0, 6.0)) {
        let at = ys.at(y);
        let _ = write!(svg, "<path class=\"axis\" d=\"M{left:.1} {at:.1}H{right:.1}\"/>");
        let _ = write!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>", left - 5.0, at + 4.0);
    }
    let _ = write!(svg, "<text x=\"{right:.1}\" y=\"{:.1}\" text-anchor=\"end\">{x_name}</text>", bottom + 31.0);
    let _ = write!(svg, "<text x=\"4\" y=\"{:.1}\">{y_name}</text>", bottom + 31.0);
    svg
}

/// Path commands for the points; breaks where they are not finite. Of many points the least and the greatest of each stretch are
/// drawn, so that no peak is lost.
pub fn path(x: &[f64], y: &[f64], xs: Axis, ys: Axis) -> String {
    let count = x.len().min(y.len());
    let mut text = String::new();
    let mut pen_up = true;
    let mut draw = |i: Option<usize>| {
        let Some(i) = i else {
            pen_up = true;
            return;
        };
        let _ = write!(text, "{}{:.1} {:.1}", if pen_up { 'M' } else { 'L' }, xs.at(x[i]), ys.at(y[i]));
        pen_up = false;
    };
    let known = |i: usize| x[i].is_finite() && y[i].is_finite();
    let stride = count.div_ceil(STRETCHES).max(1);
    for from in (0..count).step_by(stride) {
        let to = (from + stride).min(count);
        for run in (from..to).collect::<Vec<_>>().chunk_by(|&a, &b| known(a) == known(b)) {
            if !known(run[0]) {
                draw(None);
                continue;
            }
            let ends = |f: fn(f64, f64) -> bool| run.iter().copied().reduce(|a, b| if f(y[b], y[a]) { b } else { a });
            let (least, greatest) = (ends(|a, b| a < b).unwrap_or(from), ends(|a, b| a > b).unwrap_or(from));
            let mut points = vec![run[0], least.min(greatest), least.max(greatest), run[run.len() - 1]];
            points.dedup();
            points.into_iter().for_each(|i| draw(Some(i)));
        }
    }
    text
}

/// Class of colour for a share of the scale, 0 to 1; its own for what is not known.
pub fn level(share: f64) -> String {
    if !share.is_finite() {
        return "hn".into();
    }
    format!("h{}", ((share * LEVELS as f64) as usize).min(LEVELS - 1))
}

/// The value that all but a few of the largest stay below, so that one outlier does not take all colours.
pub fn top(values: impl Iterator<Item = f64>) -> f64 {
    let mut known: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    known.sort_by(f64::total_cmp);
    let at = (0.98 * known.len() as f64) as usize;
    known.get(at.min(known.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

/// A strip of all colours with what they stand for: text that is escaped already, and the numbers at its left, middle and right.
pub fn legend(what: &str, labels: [String; 3]) -> String {
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

/// At most this many characters, the last an ellipsis where some are left out.
pub fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most.saturating_sub(1)).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

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
    fn a_peak_of_one_sample_is_drawn_and_paths_stay_short() {
        let axis = Axis { from: [0.0, 1.0], to: [0.0, 1.0] };
        let x: Vec<f64> = (0..100_000).map(|k| 1e-5 * f64::from(k)).collect();
        let mut y = vec![0.0; x.len()];
        y[77_777] = 9.0;
        y[500] = f64::NAN;
        let found = path(&x, &y, axis, axis);
        assert!(found.contains(" 9.0") && found.matches('M').count() == 2 && found.len() < 20_000, "{}", found.len());
    }

    #[test]
    fn colours_and_their_top() {
        assert_eq!([level(0.0), level(0.99), level(7.0), level(f64::NAN)], ["h0", "h8", "h8", "hn"]);
        assert_eq!(top((0..1000).map(f64::from).chain([f64::NAN])), 980.0);
        assert_eq!(top([3.0].into_iter()), 3.0);
        assert_eq!(top(std::iter::empty()), 0.0);
        assert_eq!(shortened("abcdef", 4), "abc…");
    }

    #[test]
    fn a_map_has_one_scale_for_both_directions() {
        let (xs, ys, height) = map([0.0, 3.0], [0.0, 0.1], 400.0, [150.0, 380.0], [40.0, 10.0]);
        let scale = |a: Axis| ((a.to[1] - a.to[0]) / (a.from[1] - a.from[0])).abs();
        assert!((scale(xs) / scale(ys) - 1.0).abs() < 1e-9 && height == 150.0);
        assert!(axes(xs, ys, "x [m]", "y [m]").states("[m]"));
    }
}
