//! Nearest neighbours among points, by a k-d tree (Bentley, 1975).

use rayon::prelude::*;

/// Points in the order of a tree: the middle one of every range splits it along its widest axis.
#[derive(Debug)]
pub struct Tree<'a> {
    points: &'a [[f32; 3]],
    order: Vec<u32>,
    axes: Vec<u8>,
}

impl<'a> Tree<'a> {
    /// Sorts points, which must be finite.
    pub fn new(points: &'a [[f32; 3]]) -> Self {
        let mut tree = Self { points, order: (0..points.len() as u32).collect(), axes: vec![0; points.len()] };
        let mut ranges = vec![(0, points.len())];
        while let Some((first, end)) = ranges.pop() {
            if end - first < 2 {
                continue;
            }
            let part = &mut tree.order[first..end];
            let width = |axis: usize| {
                let values = part.iter().map(|&i| points[i as usize][axis]);
                let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), x| (low.min(x), high.max(x)));
                high - low
            };
            let axis = (0..3).max_by(|&a, &b| width(a).total_cmp(&width(b))).unwrap_or(0);
            let middle = part.len() / 2;
            part.select_nth_unstable_by(middle, |&a, &b| {
                points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b))
            });
            tree.axes[first + middle] = axis as u8;
            ranges.extend([(first, first + middle), (first + middle + 1, end)]);
        }
        tree
    }

    /// Distances of each point to its `count` nearest others, from near to far; fewer when there are not so many.
    pub fn nearest(&self, count: usize) -> Vec<Vec<f32>> {
        (0..self.points.len() as u32).into_par_iter().map(|point| self.nearest_of(point, count)).collect()
    }

    fn nearest_of(&self, point: u32, count: usize) -> Vec<f32> {
        let at = self.points[point as usize];
        let mut found: Vec<f32> = vec![];
        // Ranges with a bound on the squared distance to what they hold.
        let mut ranges = vec![(0, self.points.len(), 0.0f32)];
        while let Some((first, end, bound)) = ranges.pop() {
            if first == end || (found.len() == count && bound >= found[count - 1]) {
                continue;
            }
            let middle = first + (end - first) / 2;
            let here = self.order[middle];
            let there = self.points[here as usize];
            if here != point {
                let square = (0..3).map(|k| (there[k] - at[k]).powi(2)).sum::<f32>();
                let place = found.partition_point(|x| *x <= square);
                found.insert(place, square);
                found.truncate(count);
            }
            let axis = self.axes[middle] as usize;
            let aside = at[axis] - there[axis];
            let (low, high) = ((first, middle), (middle + 1, end));
            let (near, far) = if aside < 0.0 { (low, high) } else { (high, low) };
            ranges.push((far.0, far.1, bound.max(aside * aside)));
            ranges.push((near.0, near.1, bound));
        }
        found.iter().map(|square| square.sqrt()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::random::{Purpose, unit, words};
    use super::*;

    #[test]
    fn neighbours_are_those_of_all_pairs() {
        let points: Vec<[f32; 3]> = (0..300)
            .map(|i| words(1, 2, i, Purpose::Start))
            .map(|w| [unit(w[0]), 0.2 * unit(w[1]), (unit(w[2]) * 4.0).floor()])
            .collect();
        for (i, found) in Tree::new(&points).nearest(3).iter().enumerate() {
            let distance = |p: &[f32; 3]| (0..3).map(|k| (p[k] - points[i][k]).powi(2)).sum::<f32>().sqrt();
            let mut all: Vec<f32> =
                points.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, p)| distance(p)).collect();
            all.sort_by(f32::total_cmp);
            assert_eq!(found, &all[..3], "{i}");
        }
        assert_eq!(Tree::new(&points[..2]).nearest(3)[0].len(), 1);
        assert!(Tree::new(&[]).nearest(3).is_empty());
    }
}
