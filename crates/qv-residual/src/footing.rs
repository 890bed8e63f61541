//! Where feet and ground agree: a reconstructed ground is wrong by centimetres in places, and what a replay shows there is not the motors.

use crate::windows::{Replayer, WARM, Window};
use rayon::prelude::*;

/// In so long a time at least one foot stands \[s\]: half a stride of a trot.
const STANCE: f64 = 0.2;

/// Heights of the lowest feet over the ground at each decision of a log's stretches \[m\], as poses and ground have it.
#[derive(Debug, Clone, PartialEq)]
pub struct Footing {
    gaps: Vec<Vec<f64>>,
    /// Decisions in which a foot stands.
    stance: usize,
}

impl Footing {
    /// Of all stretches of a replayer's log.
    pub fn new(replayer: &Replayer) -> Self {
        let log = replayer.log;
        let of = |(stretch, s): (usize, &crate::log::Stretch)| {
            let decisions = 0..s.decisions(log.joints);
            // Without ground below, feet and ground contradict each other as far as can be.
            decisions.map(|decision| replayer.gap_at(Window { stretch, decision }).unwrap_or(f64::INFINITY)).collect()
        };
        let gaps = log.stretches.par_iter().enumerate().map(of).collect();
        Self { gaps, stance: (STANCE * f64::from(log.rate)).ceil().max(1.0) as usize }
    }

    /// How far feet and ground contradict each other from the warm-up of a window of `length` decisions to its end \[m\]: feet stand at different
    /// heights over the ground in different steps. Poses that are off by a constant height do no harm.
    pub fn contradiction(&self, window: Window, length: usize) -> f64 {
        let from = window.decision.saturating_sub(WARM);
        let all = &self.gaps[window.stretch];
        let own = &all[from.min(all.len())..(window.decision + length).min(all.len())];
        if own.iter().any(|gap| !gap.is_finite()) {
            return f64::INFINITY;
        }
        let least = |part: &[f64]| part.iter().copied().fold(f64::INFINITY, f64::min);
        let steps = own.windows(self.stance.min(own.len()).max(1)).map(least);
        let [low, high] = steps.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
        (high - low).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_is_no_contradiction_and_a_step_of_the_ground_is() {
        // A foot that stands for 0.16 s, then 0.04 s without any, and poses that are 3 cm too high.
        let flat: Vec<f64> = (0..100).map(|k| if k % 10 < 8 { 0.03 } else { 0.045 }).collect();
        let mut step = flat.clone();
        step[50..].iter_mut().for_each(|gap| *gap += 0.02);
        let mut hole = flat.clone();
        hole[50] = f64::INFINITY;
        let footing = Footing { gaps: vec![flat, step, hole], stance: 10 };
        let found = |stretch, decision| footing.contradiction(Window { stretch, decision }, 20);
        assert!(found(0, 40) < 1e-9);
        assert!((found(1, 40) - 0.02).abs() < 1e-9);
        assert!(found(1, 20) < 1e-9 && found(1, 60) < 1e-9, "before and after it");
        assert!(found(1, 95).is_finite(), "at the end");
        assert!(found(2, 40).is_infinite() && found(2, 60) < 1e-9, "no ground");
    }
}
