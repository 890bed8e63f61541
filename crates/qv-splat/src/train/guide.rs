//! Where Gaussians are put: beside others in proportion to their opacity (Kheradmand et al., 2024), or to the error of the pixels that they
//! are seen in.
//!
//! A Gaussian's error in a photograph is the sum over pixels of its weight α T times the distance of the drawn colour from the
//! photograph's: the error of the image shared out among those that made it (Rota Bulò, Porzi and Kontschieder, *Revising Densification in
//! Gaussian Splatting*, ECCV 2024). That several photographs agree on where detail is missing is asked for by Ren et al., *FastGS*
//! (arXiv 2511.04283); here the photograph that a Gaussian does worst in is left out of its sum, so that what one photograph
//! alone wants counts for nothing.

use super::random::{Purpose, words};

/// What Gaussians are chosen by when others are put beside them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Guide {
    /// Opacity.
    Opacity,
    /// Error of the pixels that they are seen in.
    Error,
    /// The same without the photograph in which it is largest.
    Views,
}

/// Photographs that errors are taken of, as in FastGS.
pub const LOOKED_AT: usize = 10;

/// Error of a Gaussian: the sum over photographs, and the largest of them.
pub(crate) type ErrorSum = [f32; 2];

impl Guide {
    /// The weight of each Gaussian in the choice.
    pub fn weights(self, errors: &[ErrorSum]) -> Vec<f32> {
        let of = |[sum, largest]: &ErrorSum| match self {
            Self::Opacity => 0.0,
            Self::Error => *sum,
            Self::Views => (sum - largest).max(0.0),
        };
        errors.iter().map(of).collect()
    }
}

/// Photographs to look at after a step, each once, by index.
pub fn looked_at(photographs: usize, seed: u32, step: u32) -> Vec<usize> {
    let mut all: Vec<usize> = (0..photographs).collect();
    let count = photographs.min(LOOKED_AT);
    for place in 0..count {
        let word = words(seed, step, place as u32, Purpose::Look)[0];
        let other = place + ((u64::from(word) * (photographs - place) as u64) >> 32) as usize;
        all.swap(place, other);
    }
    all.truncate(count);
    all
}

/// Adds the errors of one photograph.
pub fn add(sums: &mut [ErrorSum], errors: &[f32]) {
    for (sum, error) in sums.iter_mut().zip(errors) {
        sum[0] += error;
        sum[1] = sum[1].max(*error);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_photograph_wants_alone_counts_for_nothing() {
        let mut sums = vec![[0.0; 2]; 3];
        add(&mut sums, &[1.0, 0.0, 0.5]);
        add(&mut sums, &[0.0, 0.0, 0.25]);
        assert_eq!(Guide::Error.weights(&sums), [1.0, 0.0, 0.75]);
        assert_eq!(Guide::Views.weights(&sums), [0.0, 0.0, 0.25]);
    }

    #[test]
    fn each_photograph_is_looked_at_once_and_others_after_another_step() {
        let mut some = looked_at(43, 1, 600);
        assert_ne!(some, looked_at(43, 1, 700));
        assert_eq!(some, looked_at(43, 1, 600));
        some.sort_unstable();
        some.dedup();
        assert!(some.len() == LOOKED_AT && some[9] < 43, "{some:?}");
        assert_eq!(looked_at(3, 1, 600).len(), 3);
    }
}
