//! Friction of a region from pieces of windows so short that a foot seldom lands in one.
//!
//! Where feet slip, whether a foot lands a little earlier decides where it slips: a window of the usual length is missed
//! by the right friction as well as by a wrong one, and the loss of all is least somewhere between. Pieces in which the
//! feet that stand go on standing are met by the right friction alone, and the others count little by their logarithm.

use crate::GapError;
use crate::inference::linearised::{LinearisedProblem, LinearisedWindow};
use crate::inference::regions::never_left;
use crate::inference::regions::place;
use crate::inference::regions::{Outline, is_within_reach, outline_of_feet, up_to_feet};
use crate::inference::search::{Fall, Search, fitted, held_out};
use crate::problem::columns::{Extent, Suspect};
use qv_core::statistics::median;
use qv_rollout::compare;
use qv_rollout::{Overrides, Rollout, Window, WindowOptions};
use rayon::prelude::*;

/// Pieces of a window.
const PIECES: usize = 3;
/// Bins of a piece.
const BINS: f64 = 4.0;
/// Frictions asked for, evenly spread in the logarithm.
const FRICTIONS: usize = 26;
const RANGE: [f64; 2] = [0.05, 1.0];
/// How far a stripe reaches beyond the start of a search \[m\].
const FAR: f64 = 5.0;
/// First and last step of a region's edges \[m\].
const FIRST_STEP: f64 = 0.24;
const LAST_STEP: f64 = 0.02;
/// Fewest pieces inside and outside of the region.
const FEWEST: usize = 9;
/// Loss of a piece that is missed, and mean square at which a piece is half missed.
const MISSED: f64 = 3.0;
const MET: f64 = 5.0;
/// Rise of half the loss at which a friction is out (one standard deviation).
const RISE: f64 = 0.5;

/// Ground of another friction, as pieces show it.
#[derive(Debug, Clone, Copy)]
pub struct Slip {
    /// Friction and its standard deviation.
    pub friction: [f64; 2],
    /// Where it is.
    pub outline: Outline,
    /// Fall of the log likelihood's negative in windows of the fit.
    pub gain: f64,
    /// The same in windows that no fit has seen.
    pub held_out: Fall,
}

impl<'a> Search<'_, 'a> {
    /// Friction and outline of slippery ground, started from a region found in whole windows and beside the present
    /// deviations; `None` where too little was recorded inside or outside.
    ///
    /// # Errors
    /// When a value means nothing.
    pub fn slip(&self, group: usize, start: [f64; 4]) -> Result<Option<Slip>, GapError> {
        let rollout = short(&self.study.rollout);
        let (inside, outside) = self.pieces(&rollout, |seen| fitted(seen) > 0.0, start);
        if inside.len() < FEWEST || outside.len() < FEWEST {
            return Ok(None);
        }
        let sound = residuals(&rollout, &outside, &[self.slippery(&rollout, group, RANGE[1], [0.0; 4])])?.remove(0);
        let feet = feet(self.study);
        let pieces = Pieces { search: self, group, scales: scales(&sound), rollout: &rollout, feet };
        let frictions: Vec<f64> =
            (0..FRICTIONS).map(|k| RANGE[0] * (RANGE[1] / RANGE[0]).powf(k as f64 / (FRICTIONS - 1) as f64)).collect();
        let at = |region: [f64; 4]| frictions.iter().map(|mu| (*mu, region)).collect::<Vec<_>>();
        let Some((rough, _)) = least(&frictions, &pieces.losses(&inside, &at(start))?) else { return Ok(None) };
        let all: Vec<Window> = inside.into_iter().chain(outside).collect();
        let (mut region, mut friction) = (start, [rough, 0.0]);
        // The friction of a region that is too large is too high: once more with that of the outline.
        for _ in 0..2 {
            region = pieces.outline(&all, friction[0], region)?;
            let Some((mu, deviation)) = least(&frictions, &pieces.losses(&all, &at(region))?) else { return Ok(None) };
            friction = [mu, deviation];
        }
        let outline = pieces.between_feet(&all, friction[0], region)?;
        let ends = pieces.losses(&all, &[(RANGE[1], [0.0; 4]), (friction[0], outline.region)])?;
        let usual = sound.iter().map(|r| loss(r, &pieces.scales)).sum::<f64>() / sound.len() as f64;
        let held_out = pieces.fall(friction[0], outline.region, usual)?;
        Ok(Some(Slip { friction, outline, gain: ends[0] - ends[1], held_out }))
    }

    fn slippery(&self, rollout: &Rollout, group: usize, mu: f64, region: [f64; 4]) -> Overrides {
        let suspect = Suspect { group, values: vec![mu], extent: Some(Extent::Region(region)) };
        self.columns().setting_beside(rollout, &self.deviant, &[suspect])
    }

    /// Pieces of some windows: those in which feet may stand in a region, and the others.
    fn pieces(
        &self,
        rollout: &Rollout,
        wanted: impl Fn(&LinearisedWindow) -> bool,
        region: [f64; 4],
    ) -> (Vec<Window>, Vec<Window>) {
        let (mut inside, mut outside) = (Vec::new(), Vec::new());
        for seen in self.study.seen.iter().filter(|s| wanted(s)) {
            let is_in = is_within_reach(region, place(&seen.window));
            let pieces = cut(rollout, seen);
            if is_in { inside.extend(pieces) } else { outside.extend(pieces) }
        }
        (inside, outside)
    }
}

/// The rollout with windows cut into pieces.
fn short<'a>(rollout: &Rollout<'a>) -> Rollout<'a> {
    let mut rollout = rollout.clone();
    let window = rollout.cut.window / PIECES as f64;
    rollout.cut = WindowOptions { window, bin: window / BINS, ..rollout.cut };
    rollout
}

/// Pieces of a window, for a rollout that is cut into them.
fn cut(rollout: &Rollout, seen: &LinearisedWindow) -> Vec<Window> {
    let starts = (0..PIECES).map(|k| seen.window.start + k as f64 * rollout.cut.window);
    let of_view = starts.filter_map(|start| rollout.window(&seen.window.view, start, false));
    // What is seen around a window begins later than the recording.
    of_view
        .map(|w| {
            let (moving, since) = (w.moving, seen.window.since + (w.start - seen.window.start));
            w.with(moving, since)
        })
        .collect()
}

/// Where feet stood at the starts of all pieces, x and y \[m\].
pub fn feet(study: &LinearisedProblem) -> Vec<[f64; 2]> {
    let rollout = short(&study.rollout);
    let of_window =
        |seen: &LinearisedWindow| cut(&rollout, seen).iter().flat_map(|p| p.standing_feet(&rollout)).collect();
    // In order: the same on any number of threads.
    study.seen.par_iter().map(of_window).collect::<Vec<Vec<[f64; 2]>>>().concat()
}

/// What losses of pieces take.
struct Pieces<'p, 's, 'a> {
    search: &'p Search<'s, 'a>,
    rollout: &'p Rollout<'a>,
    group: usize,
    scales: Vec<f64>,
    /// Where feet stood \[m\].
    feet: Vec<[f64; 2]>,
}

impl Pieces<'_, '_, '_> {
    /// Losses of pieces for frictions with regions.
    fn losses(&self, pieces: &[Window], points: &[(f64, [f64; 4])]) -> Result<Vec<f64>, GapError> {
        Ok(self.each(pieces, points)?.iter().map(|of_point| of_point.iter().sum()).collect())
    }

    /// The same by piece, shape `[points][pieces]`.
    fn each(&self, pieces: &[Window], points: &[(f64, [f64; 4])]) -> Result<Vec<Vec<f64>>, GapError> {
        let setting = |&(mu, region): &(f64, [f64; 4])| self.search.slippery(self.rollout, self.group, mu, region);
        let settings: Vec<Overrides> = points.iter().map(setting).collect();
        let residuals = residuals(self.rollout, pieces, &settings)?;
        Ok(residuals.iter().map(|of_point| of_point.iter().map(|r| loss(r, &self.scales)).collect()).collect())
    }

    /// Edges of the region by a pattern search, from the start, from stripes along either axis, and from halves of those.
    fn outline(&self, all: &[Window], mu: f64, start: [f64; 4]) -> Result<[f64; 4], GapError> {
        let starts = starts(&self.feet, start);
        let points: Vec<(f64, [f64; 4])> = starts.iter().map(|r| (mu, *r)).collect();
        let losses = self.losses(all, &points)?;
        let first = (0..starts.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0);
        let (mut at, mut loss) = (starts[first], losses[first]);
        let mut step = FIRST_STEP;
        while step > LAST_STEP {
            let mut points = Vec::new();
            for edge in 0..4 {
                for sign in [-step, step] {
                    let mut moved = at;
                    moved[edge] += sign;
                    points.push((mu, moved));
                }
                // Ground may go on where the robot never was: no small step leads there.
                let mut open = at;
                open[edge] += if edge % 2 == 0 { -FAR } else { FAR };
                points.push((mu, open));
            }
            let losses = self.losses(all, &points)?;
            let best = (0..points.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b])).unwrap_or(0);
            if losses[best] < loss - 1e-9 {
                (at, loss) = (points[best].1, losses[best]);
            } else {
                step *= 0.5;
            }
        }
        Ok(at)
    }

    /// The region with its edges where feet show them, if that is no worse. Ground that the robot never left has none.
    fn between_feet(&self, all: &[Window], mu: f64, region: [f64; 4]) -> Result<Outline, GapError> {
        let found = Outline { region, deviations: [LAST_STEP; 4] };
        if never_left(self.search.study, &self.feet, region) {
            return Ok(found);
        }
        let settled = outline_of_feet(&self.feet, region);
        let losses = self.losses(all, &[(mu, region), (mu, settled.region)])?;
        Ok(if losses[1] < losses[0] + RISE { settled } else { found })
    }

    /// The fall in windows that no fit has seen; `usual` is the loss of a piece elsewhere.
    fn fall(&self, mu: f64, region: [f64; 4], usual: f64) -> Result<Fall, GapError> {
        let (inside, _) = self.search.pieces(self.rollout, |seen| held_out(seen) > 0.0, region);
        let each = self.each(&inside, &[(RANGE[1], [0.0; 4]), (mu, region)])?;
        let changed: Vec<(f64, f64)> =
            each[0].iter().copied().zip(each[1].iter().copied()).filter(|(b, a)| (b - a).abs() > 1e-3).collect();
        let falls: Vec<f64> = changed.iter().map(|(b, a)| b - a).collect();
        let excess: f64 = changed.iter().map(|(b, _)| b - usual).sum();
        let count = falls.len().max(1) as f64;
        let mean = falls.iter().sum::<f64>() / count;
        let variance = falls.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        let closed = if excess > 0.0 { (falls.iter().sum::<f64>() / excess).clamp(0.0, 1.0) } else { 0.0 };
        Ok(Fall { mean, error: (variance / count).sqrt(), closed })
    }
}

/// Where the search for an outline begins. Steps from an edge that lies beyond all feet change nothing: edges begin at the feet.
fn starts(feet: &[[f64; 2]], start: [f64; 4]) -> Vec<[f64; 4]> {
    let [x0, x1, y0, y1] = start;
    let wide = [start, [x0, x1, y0 - FAR, y1 + FAR], [x0 - FAR, x1 + FAR, y0, y1]].map(|r| up_to_feet(feet, r));
    let [_, along_y, along_x] = wide;
    let half = |r: [f64; 4], edge: usize| {
        let axis = edge / 2;
        let mut half = r;
        half[edge] = 0.5 * (r[2 * axis] + r[2 * axis + 1]);
        half
    };
    let halves = [half(along_y, 2), half(along_y, 3), half(along_x, 0), half(along_x, 1)];
    wide.into_iter().chain(halves).collect()
}

/// Residuals of pieces under settings, shape `[settings][pieces][features]`; empty where a simulation ran away.
fn residuals(rollout: &Rollout, pieces: &[Window], settings: &[Overrides]) -> Result<Vec<Vec<Vec<f64>>>, GapError> {
    let pieces: Vec<&Window> = pieces.iter().collect();
    Ok(compare(rollout, &rollout.numerics, &pieces, settings)?.values)
}

/// Usual size of each feature: of the middle piece.
fn scales(residuals: &[Vec<f64>]) -> Vec<f64> {
    let whole: Vec<&Vec<f64>> = residuals.iter().filter(|r| !r.is_empty()).collect();
    let size = whole.first().map_or(0, |r| r.len());
    let of_feature = |i: usize| {
        let mut all: Vec<f64> = whole.iter().map(|r| r[i].abs()).collect();
        // The median of a normal distribution's size is 0.674 of its deviation.
        (median(&mut all) / 0.674).max(1e-9)
    };
    (0..size).map(of_feature).collect()
}

/// Loss of a piece, which grows no more once it is missed: Geman and McClure's (Bulletin of the International
/// Statistical Institute 52, 1987).
fn loss(residual: &[f64], scales: &[f64]) -> f64 {
    let square = residual.iter().zip(scales).map(|(r, s)| (r / s).powi(2)).sum::<f64>() / scales.len().max(1) as f64;
    // Features of a piece are anything but independent: it counts as one number.
    if residual.is_empty() { MISSED } else { MISSED * square / (square + MET) }
}

/// The friction of the least loss, between grid points by a parabola in the logarithm, and its deviation.
fn least(frictions: &[f64], losses: &[f64]) -> Option<(f64, f64)> {
    let best = (0..losses.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b]))?;
    let grid = (frictions[1] / frictions[0]).ln();
    let out = |k: &usize| losses[*k] - losses[best] > RISE;
    let low = (0..best).rev().find(out).map_or(frictions[0], |k| frictions[k]);
    let high = (best..losses.len()).find(out).map_or(frictions[frictions.len() - 1], |k| frictions[k]);
    let mut at = frictions[best].ln();
    if best > 0 && best + 1 < losses.len() {
        let (a, b, c) = (losses[best - 1], losses[best], losses[best + 1]);
        let bend = a - 2.0 * b + c;
        at += if bend > 0.0 { 0.5 * grid * (a - c) / bend } else { 0.0 };
    }
    Some((at.exp(), 0.5 * (high - low)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_loss_lies_between_grid_points() {
        let frictions: Vec<f64> = (0..20).map(|k| 0.05 * 1.15_f64.powi(k)).collect();
        let losses: Vec<f64> = frictions.iter().map(|mu| 40.0 * (mu / 0.2).ln().powi(2)).collect();
        let (mu, deviation) = least(&frictions, &losses).unwrap();
        assert!((mu - 0.2).abs() < 1e-6, "{mu}");
        assert!((0.01..0.05).contains(&deviation), "{deviation}");
    }

    #[test]
    fn a_search_begins_at_feet_and_in_halves() {
        let feet: Vec<[f64; 2]> = (0..20).flat_map(|k| [[0.1 * k as f64, -0.1], [0.1 * k as f64, 0.1]]).collect();
        let near = |a: &[f64; 4], b: [f64; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        let all = starts(&feet, [0.52, 0.93, -0.02, 4.0]);
        assert!(near(&all[0], [0.55, 0.93, 0.05, 0.15]), "{all:?}");
        assert!(all.iter().any(|s| near(s, [0.55, 0.93, 0.0, 0.15])), "{all:?}");
    }

    #[test]
    fn a_piece_that_is_missed_by_far_counts_little() {
        let scales = vec![1.0; 4];
        let (near, far) = (loss(&[1.0; 4], &scales), loss(&[100.0; 4], &scales));
        assert!(near < 0.6 && far > 2.9 && far <= MISSED, "{near} {far}");
        assert_eq!(loss(&[], &scales), MISSED, "one that ran away, too");
    }
}
