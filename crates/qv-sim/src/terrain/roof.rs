//! Greatest heights over blocks of cells: shows that a box is above all ground without a look at a triangle.

/// Maxima of a grid of cells, and of its blocks of 2 x 2, 4 x 4 and so on.
#[derive(Debug)]
pub(super) struct Roof {
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    columns: usize,
    rows: usize,
    /// Row-major, column fastest \[m\].
    highest: Vec<f64>,
}

impl Roof {
    /// From the greatest height in each of `columns * rows` cells, column fastest.
    pub fn new(columns: usize, rows: usize, highest: Vec<f64>) -> Self {
        let mut levels = vec![Level { columns, rows, highest }];
        while let Some(level) = levels.last()
            && level.columns.max(level.rows) > 1
        {
            let next = level.halved();
            levels.push(next);
        }
        Self { levels }
    }

    /// The greatest height of all \[m\].
    pub fn top(&self) -> f64 {
        self.levels.last().map_or(f64::INFINITY, |level| level.highest[0])
    }

    /// A height that no cell of columns `i0..=i1` and rows `j0..=j1` exceeds \[m\]: the greatest of at most 2 x 2 blocks
    /// that hold them.
    #[inline(always)]
    pub fn bound(&self, [i0, i1]: [usize; 2], [j0, j1]: [usize; 2]) -> f64 {
        let width = (i1 - i0).max(j1 - j0);
        // Blocks at least as wide as the region is from first to last cell: it touches two at most along each axis.
        let shift = (usize::BITS - width.leading_zeros()) as usize;
        let shift = shift.min(self.levels.len() - 1);
        let level = &self.levels[shift];
        let mut highest = f64::NEG_INFINITY;
        for j in j0 >> shift..=j1 >> shift {
            for i in i0 >> shift..=i1 >> shift {
                highest = highest.max(level.highest[j * level.columns + i]);
            }
        }
        highest
    }
}

impl Level {
    fn halved(&self) -> Self {
        let (columns, rows) = (self.columns.div_ceil(2), self.rows.div_ceil(2));
        let mut highest = vec![f64::NEG_INFINITY; columns * rows];
        for j in 0..self.rows {
            for i in 0..self.columns {
                let block = &mut highest[j / 2 * columns + i / 2];
                *block = block.max(self.highest[j * self.columns + i]);
            }
        }
        Self { columns, rows, highest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_hold_and_are_not_far_off() {
        let (columns, rows) = (7, 5);
        let heights: Vec<f64> = (0..columns * rows).map(|k| f64::from((k as u32 * 37) % 31)).collect();
        let roof = Roof::new(columns, rows, heights.clone());
        assert_eq!(roof.top(), heights.iter().copied().fold(0.0, f64::max));
        for (i0, j0) in (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j))) {
            assert_eq!(roof.bound([i0, i0], [j0, j0]), heights[j0 * columns + i0]);
            for (i1, j1) in (i0..columns).flat_map(|i| (j0..rows).map(move |j| (i, j))) {
                let within = |[i0, i1]: [usize; 2], [j0, j1]: [usize; 2]| {
                    let cells = (j0..=j1).flat_map(|j| (i0..=i1).map(move |i| (i, j)));
                    cells.map(|(i, j)| heights[j * columns + i]).fold(f64::NEG_INFINITY, f64::max)
                };
                let bound = roof.bound([i0, i1], [j0, j1]);
                let wide = 2 * (i1 - i0).max(j1 - j0);
                let around = |k0: usize, k1: usize, most: usize| [k0.saturating_sub(wide), (k1 + wide).min(most - 1)];
                assert!(bound >= within([i0, i1], [j0, j1]));
                assert!(bound <= within(around(i0, i1, columns), around(j0, j1, rows)));
            }
        }
    }
}
