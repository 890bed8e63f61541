//! The friction of all tosses together with its interval, by bootstrap over tosses (Efron and Tibshirani, *An Introduction to the
//! Bootstrap*, 1993, sec. 13.3): the errors of tosses that share a board are no more alike than that.

use super::Bench;
use crate::tosses::Setting;

const RESAMPLINGS: usize = 2000;
/// Frictions tried about the best, and the step between them.
const EITHER_SIDE: i32 = 20;
const STEP: f64 = 0.0025;

/// Best friction, and the 2.5 and 97.5 % points of it over resampled tosses. `setting` begins with the friction.
pub fn friction(bench: &Bench, mut setting: Setting) -> Result<(f64, [f64; 2]), String> {
    let middle = setting[0].1;
    let tried: Vec<f64> =
        (-EITHER_SIDE..=EITHER_SIDE).map(|k| middle + STEP * f64::from(k)).filter(|f| *f > 0.0).collect();
    let mut errors: Vec<Vec<f64>> = Vec::new();
    for &friction in &tried {
        setting[0].1 = friction;
        errors.push(bench.run(&setting)?.iter().map(|e| e.mean).collect());
    }
    let count = bench.tosses.len();
    let best_of = |picked: &[usize]| {
        let sum = |of: &Vec<f64>| picked.iter().map(|&toss| of[toss]).sum::<f64>();
        let best = (0..tried.len()).min_by(|&a, &b| sum(&errors[a]).total_cmp(&sum(&errors[b])));
        best.map_or(f64::NAN, |k| tried[k])
    };
    let mut seed = 1u64;
    let mut found: Vec<f64> =
        (0..RESAMPLINGS).map(|_| best_of(&(0..count).map(|_| pick(&mut seed, count)).collect::<Vec<_>>())).collect();
    found.sort_by(f64::total_cmp);
    let at = |q: f64| found[(q * RESAMPLINGS as f64) as usize];
    Ok((best_of(&(0..count).collect::<Vec<_>>()), [at(0.025), at(0.975)]))
}

/// An index below `count`, by Knuth's linear congruential generator (*The Art of Computer Programming*, vol. 2, sec. 3.3.4), high bits.
fn pick(seed: &mut u64, count: usize) -> usize {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    ((*seed >> 32) as usize * count) >> 32
}
