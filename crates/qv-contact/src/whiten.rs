//! What differences between measured and simulated states mean: their usual size, how they go together, and a loss that
//! grows only with the logarithm of what is unusual.

use qv_fit::Scatter;
use qv_fit::linear::minus;

/// Degrees of freedom of Student's t: a window in which a foot lands elsewhere must not decide.
const FREEDOM: f64 = 4.0;

/// Middle and covariance of differences.
#[derive(Debug, Clone)]
pub struct Usual(Scatter);

impl Usual {
    /// Middle and spread; `None` when there are fewer differences than [`FEWEST`], or they hold none that is finite.
    pub fn of(differences: &[Vec<f64>]) -> Option<Self> {
        Scatter::of(&whole(differences)?).map(Self)
    }

    /// Square of the distance of a difference from the middle, in units of the spread; infinite for one of another size.
    pub fn square(&self, difference: &[f64]) -> f64 {
        if difference.len() != self.0.middle.len() || difference.iter().any(|x| !x.is_finite()) {
            return f64::INFINITY;
        }
        self.0.factor.length(&minus(difference, &self.0.middle))
    }

    /// Square of the distance between two differences, in units of the spread; infinite when one ran away.
    pub fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        if a.len() != b.len() {
            return f64::INFINITY;
        }
        let from_middle: Vec<f64> = a.iter().zip(b).zip(self.0.middle.iter()).map(|((a, b), m)| a - b + m).collect();
        self.square(&from_middle)
    }

    /// Middle at zero and the spread about it; `None` as for [`Self::of`].
    pub fn about_zero(differences: &[Vec<f64>]) -> Option<Self> {
        Scatter::about_zero(&whole(differences)?).map(Self)
    }

    /// A difference of two differences in units of the spread, uncorrelated; `None` when its size is another or it is not finite.
    pub fn whitened(&self, mut difference: Vec<f64>) -> Option<Vec<f64>> {
        if difference.len() != self.0.middle.len() || difference.iter().any(|x| !x.is_finite()) {
            return None;
        }
        self.0.factor.whiten(&mut difference);
        Some(difference)
    }

    /// Weight of a difference at that square of its distance: 1 at what is usual, less beyond.
    pub fn weight(&self, square: f64) -> f64 {
        let size = self.0.middle.len() as f64;
        (FREEDOM + size) / (FREEDOM + square)
    }

    /// The same spread about zero.
    pub fn centred(mut self) -> Self {
        self.0.middle.fill(0.0);
        self
    }

    /// Negative log likelihood of a difference, but for a constant; that of a square of 1e4 for each number at most.
    pub fn loss(&self, difference: &[f64]) -> f64 {
        let size = self.0.middle.len() as f64;
        let square = self.square(difference).min(WORST * size);
        0.5 * (FREEDOM + size) * (1.0 + square / FREEDOM).ln()
    }
}

/// Those that ended and are finite; `None` when they are too few.
fn whole(differences: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let is_whole = |d: &&Vec<f64>| !d.is_empty() && d.iter().all(|x| x.is_finite());
    let whole: Vec<Vec<f64>> = differences.iter().filter(is_whole).cloned().collect();
    (whole.len() >= FEWEST).then_some(whole)
}

/// Fewest differences that show what is usual.
pub const FEWEST: usize = 30;
/// Square for each number of a difference beyond which all are equally wrong.
const WORST: f64 = 1e4;

#[cfg(test)]
mod tests {
    use super::*;

    fn correlated() -> Vec<Vec<f64>> {
        // Two numbers that go together, from a sequence that fills the square evenly.
        let normal = |k: f64, step: f64| ((k * step).fract() - 0.5) * 3.46;
        (1..400)
            .map(|k| {
                let (a, b) = (normal(f64::from(k), 0.754_877_666), normal(f64::from(k), 0.569_840_291));
                vec![2.0 + a, 5.0 * (a + 0.3 * b) - 1.0]
            })
            .collect()
    }

    #[test]
    fn middle_and_direction_are_found_and_outliers_hardly_matter() {
        let clean = Usual::of(&correlated()).unwrap();
        let mut dirty = correlated();
        dirty.extend((0..20).map(|_| vec![500.0, -900.0]));
        let dirty = Usual::of(&dirty).unwrap();
        for usual in [&clean, &dirty] {
            assert!(usual.square(&[2.0, -1.0]) < 0.1);
            let (along, across) = (usual.square(&[3.0, 4.0]), usual.square(&[3.0, -6.0]));
            assert!(across > 5.0 * along, "{along} {across}");
        }
        assert!((dirty.square(&[4.0, 9.0]) / clean.square(&[4.0, 9.0]) - 1.0).abs() < 0.4);
    }

    #[test]
    fn what_ran_away_is_as_wrong_as_can_be() {
        let usual = Usual::of(&correlated()).unwrap();
        assert!(usual.loss(&[]).is_finite() && usual.loss(&[f64::NAN, 0.0]) == usual.loss(&[]));
        assert!(usual.loss(&[2.0, -1.0]) < usual.loss(&[9.0, 9.0]));
        assert!(Usual::of(&correlated()[..20]).is_none());
    }
}
