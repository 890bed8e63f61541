//! Nearest points, by a grid of cells.

use crate::MeshError;
use crate::error::off;
use crate::volume::{BlockKey, KeyMap};
use glam::DVec3;
use rayon::prelude::*;

/// Points sorted into cells.
#[derive(Debug)]
pub struct PointGrid {
    cell: f64,
    /// First place in `order` and number of points of each cell.
    cells: KeyMap<BlockKey, [u32; 2]>,
    points: Vec<DVec3>,
    /// Index of each point in the list that was given.
    order: Vec<u32>,
}

impl PointGrid {
    /// Sorts points \[m\] into cells of a side \[m\], best that of the distances that will be asked for.
    ///
    /// # Errors
    /// The side is not positive, or a point is not finite or more than a million cells from the origin.
    pub fn new(points: &[DVec3], cell: f64) -> Result<Self, MeshError> {
        if !(cell.is_finite() && cell > 0.0) {
            return Err(off("side of a cell", "a positive number", cell));
        }
        let key = |index: usize| BlockKey::of((points[index] / cell).floor().to_array().map(|c| c as i64));
        if let Some(bad) = (0..points.len()).find(|i| !points[*i].is_finite() || key(*i).is_none()) {
            return Err(off(format!("point {bad}"), format!("within a million cells of {cell} m"), points[bad]));
        }
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.par_sort_unstable_by_key(|i| (key(*i as usize), *i));
        let mut cells: KeyMap<BlockKey, [u32; 2]> = KeyMap::default();
        for (place, index) in order.iter().enumerate() {
            if let Some(key) = key(*index as usize) {
                cells.entry(key).or_insert([place as u32, 0])[1] += 1;
            }
        }
        let points = order.iter().map(|i| points[*i as usize]).collect();
        Ok(Self { cell, cells, points, order })
    }

    /// Calls `visit` with index and squared distance \[m²\] of each point within `radius` \[m\].
    fn visit(&self, p: DVec3, radius: f64, mut visit: impl FnMut(u32, f64)) {
        let (low, high) = (((p - radius) / self.cell).floor(), ((p + radius) / self.cell).floor());
        let [low, high] = [low, high].map(|c| c.to_array().map(|c| c as i64));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let Some(range) = BlockKey::of([x, y, z]).and_then(|key| self.cells.get(&key)) else { continue };
                    for place in range[0]..range[0] + range[1] {
                        let d = self.points[place as usize].distance_squared(p);
                        if d <= radius * radius {
                            visit(self.order[place as usize], d);
                        }
                    }
                }
            }
        }
    }

    /// Index and distance \[m\] of the nearest point within `radius` \[m\], the first of equals.
    pub fn nearest(&self, p: DVec3, radius: f64) -> Option<(usize, f64)> {
        let mut best: Option<(f64, u32)> = None;
        self.visit(p, radius, |index, d| {
            if best.is_none_or(|b| (d, index) < b) {
                best = Some((d, index));
            }
        });
        best.map(|(d, index)| (index as usize, d.sqrt()))
    }

    /// Indices and distances \[m\] of the `k` nearest points within `radius` \[m\], nearest first, into `out`.
    pub fn k_nearest(&self, p: DVec3, k: usize, radius: f64, out: &mut Vec<(usize, f64)>) {
        let mut best: Vec<(f64, u32)> = Vec::with_capacity(k + 1);
        self.visit(p, radius, |index, d| {
            if best.len() < k || best.last().is_some_and(|last| (d, index) < *last) {
                let place = best.partition_point(|b| *b < (d, index));
                best.insert(place, (d, index));
                best.truncate(k);
            }
        });
        out.clear();
        out.extend(best.into_iter().map(|(d, index)| (index as usize, d.sqrt())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_finds_what_a_plain_loop_finds() {
        let at =
            |i: u32| DVec3::new(f64::from(i * 37 % 101), f64::from(i * 53 % 97), f64::from(i * 71 % 89)) * 0.02 - 1.0;
        let points: Vec<DVec3> = (0..400).map(at).collect();
        let grid = PointGrid::new(&points, 0.15).unwrap();
        let mut found = Vec::new();
        for i in 400..450 {
            let p = at(i) + 0.003;
            let mut expected: Vec<(f64, usize)> = points
                .iter()
                .enumerate()
                .map(|(i, q)| (q.distance_squared(p), i))
                .filter(|(d, _)| *d <= 0.16)
                .collect();
            expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
            expected.truncate(6);
            grid.k_nearest(p, 6, 0.4, &mut found);
            assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), expected.iter().map(|e| e.1).collect::<Vec<_>>());
            assert_eq!(grid.nearest(p, 0.4).map(|f| f.0), expected.first().map(|e| e.1));
        }
    }

    #[test]
    fn bad_points_are_named() {
        assert!(PointGrid::new(&[DVec3::ZERO], 0.0).is_err());
        let fault = PointGrid::new(&[DVec3::ZERO, DVec3::splat(f64::NAN)], 0.1).unwrap_err().to_string();
        assert!(fault.starts_with("point 1: expected within"), "{fault}");
        assert!(PointGrid::new(&[DVec3::splat(1e9)], 0.1).is_err());
        assert_eq!(PointGrid::new(&[], 0.1).unwrap().nearest(DVec3::ZERO, 1.0), None);
    }
}
