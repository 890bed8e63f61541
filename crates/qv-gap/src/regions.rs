//! Rectangles of the ground to begin a search from, by what each window gains there.

use crate::columns::{Extent, Suspect};

/// All of the ground, and what lies to the left and to the right of the way: the feet of one side alone may stand on it.
pub fn whole_and_halves(places: &[[f64; 2]]) -> Vec<[f64; 4]> {
    const FAR: f64 = 1e3;
    let whole = [-FAR, FAR, -FAR, FAR];
    let along = |axis: usize| {
        let mut all: Vec<f64> = places.iter().map(|p| p[axis]).filter(|x| x.is_finite()).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let [x, y] = [along(0), along(1)];
    if x.is_empty() {
        return vec![whole];
    }
    let length = |all: &[f64]| all[all.len() - 1] - all[0];
    let (across, middle) = if length(&x) > length(&y) { (1, y[y.len() / 2]) } else { (0, x[x.len() / 2]) };
    let half = |edge: usize| {
        let mut half = whole;
        half[2 * across + edge] = middle;
        half
    };
    vec![whole, half(0), half(1)]
}

/// A region as it is, wider, and moved by as much as feet stand away from the trunk.
pub fn around(suspect: &Suspect) -> Vec<Suspect> {
    const AWAY: f64 = 0.2;
    let Some(Extent::Region([x0, x1, y0, y1])) = suspect.extent else { return Vec::new() };
    let moved = |x: f64, y: f64| [x0 + x, x1 + x, y0 + y, y1 + y];
    let regions = [
        [x0, x1, y0, y1],
        [x0 - AWAY, x1 + AWAY, y0 - AWAY, y1 + AWAY],
        moved(AWAY, 0.0),
        moved(-AWAY, 0.0),
        moved(0.0, AWAY),
        moved(0.0, -AWAY),
    ];
    regions.map(|r| Suspect { extent: Some(Extent::Region(r)), ..suspect.clone() }).into()
}

/// What two regions share.
pub fn overlap(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [a[0].max(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].min(b[3])]
}

/// The stripes and the rectangle with the largest sum of gains: stripes along y and x, then the other edges of the best.
pub fn rectangles(places: &[[f64; 2]], gains: &[f64]) -> Vec<(f64, [f64; 4])> {
    const FAR: f64 = 4.0;
    let whole = |axis: usize| {
        let all = places.iter().map(|p| p[axis]).filter(|x| x.is_finite());
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        [low - FAR, high + FAR]
    };
    let (all_x, all_y) = (whole(0), whole(1));
    if !all_x[0].is_finite() || !all_y[0].is_finite() {
        return Vec::new();
    }
    let all: Vec<usize> = (0..places.len()).collect();
    let mut found = Vec::new();
    for first in [0, 1] {
        let Some((gain, stripe)) = interval(places, gains, first, &all) else { continue };
        let other_all = if first == 0 { all_y } else { all_x };
        let region =
            |a: [f64; 2], b: [f64; 2]| if first == 0 { [a[0], a[1], b[0], b[1]] } else { [b[0], b[1], a[0], a[1]] };
        found.push((gain, region(stripe, other_all)));
        let inside: Vec<usize> =
            all.iter().copied().filter(|&k| (stripe[0]..=stripe[1]).contains(&places[k][first])).collect();
        if let Some((gain, other)) = interval(places, gains, 1 - first, &inside) {
            found.push((gain, region(stripe, other)));
        }
    }
    found
}

/// The interval along an axis with the largest sum of gains (Bentley, Communications of the ACM 27, 1984), with edges
/// midway to the neighbours.
fn interval(places: &[[f64; 2]], gains: &[f64], axis: usize, of: &[usize]) -> Option<(f64, [f64; 2])> {
    let mut order: Vec<usize> = of.iter().copied().filter(|&k| places[k][axis].is_finite()).collect();
    order.sort_by(|&a, &b| places[a][axis].total_cmp(&places[b][axis]));
    let (mut best, mut sum, mut from) = (None, 0.0, 0);
    for (i, &k) in order.iter().enumerate() {
        if sum <= 0.0 {
            (sum, from) = (0.0, i);
        }
        sum += gains[k];
        if best.is_none_or(|(b, _, _)| sum > b) {
            best = Some((sum, from, i));
        }
    }
    let (gain, from, to) = best?;
    let at = |i: usize| places[order[i]][axis];
    let low = if from == 0 { at(0) - 1.0 } else { 0.5 * (at(from - 1) + at(from)) };
    let high = if to + 1 == order.len() { at(to) + 1.0 } else { 0.5 * (at(to) + at(to + 1)) };
    Some((gain, [low, high]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stripe_of_gains_is_found() {
        let places: Vec<[f64; 2]> = (0..40).map(|k| [0.05 * k as f64, 0.3 * (k as f64).sin()]).collect();
        let gains: Vec<f64> = places.iter().map(|p| if (0.5..1.0).contains(&p[0]) { 3.0 } else { -1.0 }).collect();
        let (gain, stripe) = interval(&places, &gains, 0, &(0..40).collect::<Vec<_>>()).unwrap();
        assert!((gain - 30.0).abs() < 1e-12);
        assert!((stripe[0] - 0.475).abs() < 1e-9 && (stripe[1] - 0.975).abs() < 1e-9, "{stripe:?}");
        let best = rectangles(&places, &gains).into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        assert!(best.1[0] > 0.4 && best.1[1] < 1.05 && best.0 >= 30.0, "{best:?}");
    }

    #[test]
    fn places_that_are_not_known_are_no_region() {
        assert!(rectangles(&[[f64::NAN; 2]; 5], &[1.0; 5]).is_empty());
    }

    #[test]
    fn halves_meet_in_the_middle_of_the_way() {
        let places: Vec<[f64; 2]> = (0..41).map(|k| [0.05 * k as f64, 0.4 + 0.01 * (k % 3) as f64]).collect();
        let [whole, right, left] = whole_and_halves(&places)[..] else { panic!("three") };
        assert!(whole[2] < -100.0 && whole[3] > 100.0);
        assert_eq!((right[2], left[3]), (0.41, 0.41), "the way goes along x");
        assert_eq!(overlap(right, [0.0, 1.0, -1.0, 2.0]), [0.0, 1.0, 0.41, 2.0]);
        assert_eq!(whole_and_halves(&[[f64::NAN; 2]; 3]).len(), 1);
    }

    #[test]
    fn a_region_is_moved_to_all_sides() {
        let suspect = Suspect { group: 0, values: vec![0.2], extent: Some(Extent::Region([0.0, 1.0, -1.0, 1.0])) };
        let all = around(&suspect);
        assert_eq!(all.len(), 6);
        assert!(all.contains(&Suspect { extent: Some(Extent::Region([-0.2, 1.2, -1.2, 1.2])), ..suspect.clone() }));
        assert!(around(&Suspect { extent: None, ..suspect }).is_empty());
    }
}
