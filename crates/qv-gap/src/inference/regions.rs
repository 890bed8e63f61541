//! Rectangles of the ground: where a search for them begins, by what each window gains there, and what feet report their edges.

use crate::inference::linearised::LinearisedProblem;
use crate::problem::columns::{Extent, Suspect};

/// All of the ground, and what lies to the left and to the right of the way: the feet of one side alone may stand on it.
pub(crate) fn whole_and_halves(places: &[[f64; 2]]) -> Vec<[f64; 4]> {
    const FAR: f64 = 1e3;
    let whole = [-FAR, FAR, -FAR, FAR];
    let along = |axis: usize| {
        let mut all: Vec<f64> = places.iter().map(|p| p[axis]).filter(|x| x.is_finite()).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let [x, y] = [along(0), along(1)];
    if x.is_empty() || y.is_empty() {
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

/// How far feet reach beyond the trunk's middle \[m\].
pub const REACH: f64 = 0.35;
/// Whether feet may stand in a region while the trunk is at a place, x and y \[m\].
pub(crate) fn is_within_reach(region: [f64; 4], [x, y]: [f64; 2]) -> bool {
    let reach = |low: f64, high: f64| low - REACH..high + REACH;
    reach(region[0], region[1]).contains(&x) && reach(region[2], region[3]).contains(&y)
}

/// How far beyond the outermost foot that stood in a region its edges lie at most \[m\]: simulated feet slip a little farther.
const BEYOND_FEET: f64 = 0.05;
/// Smallest standard deviation of an edge \[m\]: feet slide.
const LEAST_DEVIATION: f64 = 0.02;
/// Names of the edges.
pub const EDGES: [&str; 4] = ["x_min", "x_max", "y_min", "y_max"];

/// A region with the standard deviations of its edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    /// x from and to, y from and to \[m\].
    pub region: [f64; 4],
    /// Of each edge \[m\], if the ground does not go on where no foot stood.
    pub deviations: [f64; 4],
}

fn inside(feet: &[[f64; 2]], region: [f64; 4]) -> Vec<[f64; 2]> {
    let is_inside = |p: &&[f64; 2]| (region[0]..=region[1]).contains(&p[0]) && (region[2]..=region[3]).contains(&p[1]);
    feet.iter().filter(is_inside).copied().collect()
}

/// The region without what lies beyond the feet that stood in it, about which nothing is known.
pub(crate) fn up_to_feet(feet: &[[f64; 2]], region: [f64; 4]) -> [f64; 4] {
    let inside = inside(feet, region);
    if inside.is_empty() {
        return region;
    }
    let least = |axis: usize| inside.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - BEYOND_FEET;
    let most = |axis: usize| inside.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max) + BEYOND_FEET;
    [region[0].max(least(0)), region[1].min(most(0)), region[2].max(least(1)), region[3].min(most(1))]
}

/// How far out the nearest foot beyond an edge stood, beside which it goes along; infinite where none did.
fn beyond(feet: &[[f64; 2]], region: [f64; 4], edge: usize) -> f64 {
    let (axis, other, sign) = (edge / 2, 1 - edge / 2, outwards(edge));
    let span = region[2 * other]..=region[2 * other + 1];
    let out = feet.iter().filter(|p| span.contains(&p[other])).map(|p| sign * p[axis]);
    out.filter(|out| *out > sign * region[edge]).fold(f64::INFINITY, f64::min)
}

fn outwards(edge: usize) -> f64 {
    if edge.is_multiple_of(2) { -1.0 } else { 1.0 }
}

/// The region with each edge midway between the outermost foot inside and the next one outside: anywhere between them it explains as much.
/// Where no foot stood outside, it ends at the feet inside.
pub(crate) fn outline_of_feet(feet: &[[f64; 2]], region: [f64; 4]) -> Outline {
    let within = up_to_feet(feet, region);
    let inside = inside(feet, region);
    let mut remarks = Outline { region: within, deviations: [BEYOND_FEET; 4] };
    for edge in 0..4 {
        let (axis, sign) = (edge / 2, outwards(edge));
        let mut strip = within;
        strip[edge] = region[edge];
        let farthest = inside.iter().map(|p| sign * p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let nearest = beyond(feet, strip, edge);
        if nearest.is_finite() && farthest.is_finite() {
            remarks.region[edge] = sign * 0.5 * (farthest + nearest);
            // Of what lies evenly between the two.
            remarks.deviations[edge] = (0.5 * (nearest - farthest) / f64::sqrt(3.0)).max(LEAST_DEVIATION);
        }
    }
    remarks
}

/// Names of the edges beyond which no foot stood: the ground may go on there.
pub(crate) fn untested(feet: &[[f64; 2]], region: [f64; 4]) -> Vec<&'static str> {
    (0..4).filter(|&edge| beyond(feet, region, edge).is_infinite()).map(|edge| EDGES[edge]).collect()
}

/// Share of the places where feet stood that may lie outside of ground that the robot never left: it stands still at its ends.
const MOST_OUTSIDE: f64 = 0.25;

/// Whether the robot was in a region in all windows, and its feet all but always.
pub(crate) fn never_left(study: &LinearisedProblem, feet: &[[f64; 2]], [x0, x1, y0, y1]: [f64; 4]) -> bool {
    let inside = |[x, y]: [f64; 2]| (x0..=x1).contains(&x) && (y0..=y1).contains(&y);
    let outside = feet.iter().filter(|p| !inside(**p)).count() as f64;
    outside <= MOST_OUTSIDE * feet.len() as f64 && study.seen.iter().all(|s| inside(place(&s.window)))
}

/// Mean place of the robot in a window \[m\].
pub fn place(window: &qv_rollout::Window) -> [f64; 2] {
    let Some(pose) = &window.view.measured.base_pose else { return [f64::NAN; 2] };
    let mut row = vec![0.0; pose.joints];
    pose.interpolate(window.start + 0.15, &mut row);
    [row[0], row[1]]
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
        let places: Vec<[f64; 2]> = (0..41).map(|k| [0.05 * k as f64, 0.25 * (k % 3) as f64]).collect();
        let [whole, right, left] = whole_and_halves(&places)[..] else { panic!("three") };
        assert!(whole[2] < -100.0 && whole[3] > 100.0);
        assert_eq!((right[2], left[3]), (0.25, 0.25), "the way goes along x");
        assert_eq!(overlap(right, [0.0, 1.0, -1.0, 2.0]), [0.0, 1.0, 0.25, 2.0]);
        assert_eq!(whole_and_halves(&[[f64::NAN; 2]; 3]).len(), 1);
    }

    #[test]
    fn a_region_is_moved_to_all_sides() {
        let suspect = Suspect { group: 0, values: vec![0.2], extent: Some(Extent::Region([0.0, 1.0, -1.0, 1.0])) };
        let all = around(&suspect);
        let regions: Vec<Option<Extent>> = all.iter().map(|s| s.extent).collect();
        let moved = [[0.0, 1.0, -1.0, 1.0], [-0.2, 1.2, -1.2, 1.2], [0.2, 1.2, -1.0, 1.0], [-0.2, 0.8, -1.0, 1.0]];
        let moved = [&moved[..], &[[0.0, 1.0, -0.8, 1.2], [0.0, 1.0, -1.2, 0.8]]].concat();
        assert_eq!(regions, moved.into_iter().map(|r| Some(Extent::Region(r))).collect::<Vec<_>>());
        assert!(all.iter().all(|s| s.values == [0.2]));
        assert!(around(&Suspect { extent: None, ..suspect }).is_empty());
    }

    #[test]
    fn edges_lie_midway_between_feet_and_end_where_none_stood() {
        // Two rows of feet, 0.1 m to either side of a way along x.
        let feet: Vec<[f64; 2]> = (0..20).flat_map(|k| [[0.1 * k as f64, -0.1], [0.1 * k as f64, 0.1]]).collect();
        let near = |a: [f64; 4], b: [f64; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        let stripe = outline_of_feet(&feet, [0.52, 0.93, -4.0, 4.0]);
        assert!(near(stripe.region, [0.55, 0.95, -0.15, 0.15]), "{stripe:?}");
        assert_eq!(untested(&feet, stripe.region), ["y_min", "y_max"]);
        let half = outline_of_feet(&feet, [0.52, 0.93, 0.07, 4.0]);
        assert!(near(half.region, [0.55, 0.95, 0.0, 0.15]), "{half:?}");
        assert!(near(half.deviations, [0.05 / 3f64.sqrt(), 0.05 / 3f64.sqrt(), 0.1 / 3f64.sqrt(), 0.05]), "{half:?}");
        assert_eq!(untested(&feet, half.region), ["y_max"]);
        let nobody = [5.0, 6.0, 0.0, 1.0];
        assert_eq!(outline_of_feet(&feet, nobody).region, nobody);
        assert_eq!(outline_of_feet(&[], nobody).region, nobody);
    }
}
