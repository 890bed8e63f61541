//! Left and right exchanged: how the numbers of a task look in a mirror, for symmetric data augmentation in PPO.
//!
//! Source: Mittal et al. 2024, "Symmetry considerations for learning task symmetric robot policies", section III-B, whose augmentation
//! rsl_rl has as `symmetry_cfg.use_data_augmentation`.

/// A list of numbers in the mirror: number `k` of the image is `sign[k] * row[index[k]]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MirrorMap {
    /// Where each number of the image is in the list.
    pub index: Vec<usize>,
    /// 1, or -1 for numbers that change their sign.
    pub sign: Vec<f32>,
}

/// Mirror images of all that a learner reads and decides.
#[derive(Debug, Clone, PartialEq)]
pub struct Symmetry {
    /// Of the observation.
    pub observation: MirrorMap,
    /// Of what the critic reads.
    pub privileged: MirrorMap,
    /// Of the action.
    pub action: MirrorMap,
}

impl MirrorMap {
    /// Numbers that keep their places, with these signs.
    pub fn in_place(sign: &[f32]) -> Self {
        Self { index: (0..sign.len()).collect(), sign: sign.to_vec() }
    }

    /// Numbers that change places and keep their signs.
    pub fn permuted(index: &[usize]) -> Self {
        Self { index: index.to_vec(), sign: vec![1.0; index.len()] }
    }

    /// Appends the numbers of another list that follow those of this one.
    pub fn append(&mut self, other: &Self) {
        let first = self.index.len();
        self.index.extend(other.index.iter().map(|k| first + k));
        self.sign.extend(&other.sign);
    }

    /// Writes the image of the first numbers of `row` into those of `image`; numbers beyond the map's length stay.
    pub fn apply(&self, row: &[f32], image: &mut [f32]) {
        for ((image, &k), sign) in image.iter_mut().zip(&self.index).zip(&self.sign) {
            *image = sign * row[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_of_an_image_is_the_list() {
        let mut map = MirrorMap::in_place(&[-1.0, 1.0]);
        map.append(&MirrorMap::permuted(&[1, 0]));
        let (row, mut once, mut twice) = ([1.0, 2.0, 3.0, 4.0, 9.0], [0.0; 5], [0.0; 5]);
        map.apply(&row, &mut once);
        assert_eq!(once, [-1.0, 2.0, 4.0, 3.0, 0.0]);
        map.apply(&once, &mut twice);
        assert_eq!(twice[..4], row[..4]);
    }
}
