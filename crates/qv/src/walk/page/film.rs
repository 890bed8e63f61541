//! Eight poses side by side, for print: one stride, or the fall.

use super::measures::mean;
use qv_policy::play::WalkTrace;
use std::fmt::Write;

const POSES: usize = 8;
/// Width and height of one pose in the drawing.
const CELL: [f32; 2] = [130.0, 118.0];
/// Directions of the view: about the vertical, and down \[rad\].
const VIEW: [f32; 2] = [0.45, 0.2];

/// What it shows in words, and the drawing; `None` of a play without decisions.
pub fn film(played: &WalkTrace) -> Option<(String, String)> {
    let (what, steps) = chosen(played)?;
    let scale = 0.46 * CELL[0] / reach(played, &steps).max(1e-6);
    let (width, height) = (CELL[0] * POSES as f32, CELL[1]);
    let mut svg =
        format!("<svg class=\"film\" viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" aria-label=\"Eight poses\">");
    for (k, &step) in steps.iter().enumerate() {
        let middle = CELL[0] * (k as f32 + 0.5);
        let pose = Pose::new(played, step);
        let ground = pose.lowest();
        let place = |p: [f32; 3]| {
            let [x, y] = seen(p, scale);
            [middle + x, height - 34.0 + y - seen([0.0, 0.0, ground], scale)[1]]
        };
        // A simulation that ran away has nothing to be drawn.
        if pose.is_finite() {
            svg += &pose.drawn(played, step, &place);
        }
        let time = (step + 1) as f32 / played.rate;
        _ = write!(svg, "<text x=\"{middle:.0}\" y=\"{:.0}\" text-anchor=\"middle\">{time:.2} s</text>", height - 6.0);
    }
    Some((what, qv_page::parts::scroll("poses", &(svg + "</svg>"))))
}

/// The last moments before a fall, else one stride (from touchdown to touchdown of the first foot) in the middle of the
/// command that asks for the longest way, else the whole play.
fn chosen(played: &WalkTrace) -> Option<(String, Vec<usize>)> {
    let last = played.q.len().checked_sub(1)?;
    let spread = |from: usize, to: f32| -> Vec<usize> {
        (0..POSES).map(|k| (from + (to * k as f32 / (POSES - 1) as f32).round() as usize).min(last)).collect()
    };
    if let Some(step) = played.fell {
        let from = step.saturating_sub((0.8 * played.rate) as usize);
        return Some(("The fall.".into(), spread(from, (step - from) as f32)));
    }
    let mut begin = 0;
    let walks = played.commands.chunk_by(|a, b| a == b).map(|chunk| {
        let (from, [vx, vy, wz]) = (begin, chunk[0]);
        begin += chunk.len();
        (from, begin, chunk.len() as f32 * (vx.hypot(vy) + wz.abs()))
    });
    let (from, to, _) = walks.filter(|w| w.2 > 0.0).max_by(|a, b| a.2.total_cmp(&b.2)).unwrap_or((0, 0, 0.0));
    let on = |step: usize| played.foot_forces[step].first().is_some_and(|force| *force > 0.0);
    let down: Vec<usize> = (from.max(1)..to).filter(|&step| on(step) && !on(step - 1)).collect();
    let stride = mean(down.windows(2).map(|w| (w[1] - w[0]) as f32));
    match stride {
        Some(stride) => {
            let from = down[(down.len() - 1) / 2];
            let name = &played.feet[0];
            let what = format!("One stride of {:.2} s, from touchdown to touchdown of {name}.", stride / played.rate);
            Some((what, spread(from, stride)))
        }
        None => Some(("The whole play.".into(), spread(0, last as f32))),
    }
}

/// Place in the drawing of a point in the base's heading: forwards, to the left, up.
fn seen([x, y, z]: [f32; 3], scale: f32) -> [f32; 2] {
    let [turn, down] = VIEW;
    let (right, deep) = (x * turn.cos() + y * turn.sin(), y * turn.cos() - x * turn.sin());
    [scale * right, -scale * (z * down.cos() + deep * down.sin())]
}

/// Longest way to the left or right of a link or foot from the base, so that all poses fit.
fn reach(played: &WalkTrace, steps: &[usize]) -> f32 {
    let all = steps.iter().flat_map(|&step| {
        let pose = Pose::new(played, step);
        pose.links.into_iter().chain(pose.feet).map(|p| seen(p, 1.0)[0].abs())
    });
    all.filter(|x| x.is_finite()).fold(0.0, f32::max)
}

/// Links and feet as seen from the base: its heading, its place, its height.
struct Pose {
    links: Vec<[f32; 3]>,
    feet: Vec<[f32; 3]>,
    radii: Vec<f32>,
    /// The base's upward axis.
    up: [f32; 3],
}

impl Pose {
    fn new(played: &WalkTrace, step: usize) -> Self {
        let q = &played.q[step];
        let [w, x, y, z] = [q[3], q[4], q[5], q[6]];
        let (s, c) = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)).sin_cos();
        let heading = |[x, y, z]: [f32; 3]| [c * x + s * y, c * y - s * x, z];
        let turned = |p: &[f32; 3]| heading([p[0] - q[0], p[1] - q[1], p[2] - q[2]]);
        Self {
            links: played.link_positions[step].iter().map(turned).collect(),
            feet: played.foot_positions[step].iter().map(turned).collect(),
            radii: played.foot_radii.clone(),
            up: heading([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)]),
        }
    }

    fn is_finite(&self) -> bool {
        self.links.iter().chain(&self.feet).flatten().all(|x| x.is_finite())
    }

    fn lowest(&self) -> f32 {
        let under = self.feet.iter().zip(&self.radii).map(|(p, radius)| p[2] - radius);
        under.filter(|z| z.is_finite()).fold(f32::INFINITY, f32::min).min(0.0)
    }

    /// Limbs from the far side to the near one, the trunk between them.
    fn drawn(&self, played: &WalkTrace, step: usize, place: &dyn Fn([f32; 3]) -> [f32; 2]) -> String {
        let parent = |l: usize| played.parents[l].unwrap_or(0);
        let limbs = (1..self.links.len()).filter(|&l| parent(l) != 0).map(|l| (self.links[parent(l)], self.links[l]));
        let shanks = self.feet.iter().zip(&played.foot_links).map(|(p, &l)| (self.links[l], *p));
        let mut lines: Vec<([f32; 3], [f32; 3])> = limbs.chain(shanks).collect();
        lines.sort_by(|a, b| (b.0[1] + b.1[1]).total_cmp(&(a.0[1] + a.1[1])));
        let (far, near): (Vec<_>, Vec<_>) = lines.into_iter().partition(|(a, b)| a[1] + b[1] > 0.0);
        let line = |class: &str, (a, b): &([f32; 3], [f32; 3])| {
            let ([ax, ay], [bx, by]) = (place(*a), place(*b));
            format!("<path class=\"{class}\" d=\"M{ax:.1} {ay:.1}L{bx:.1} {by:.1}\"/>")
        };
        let foot = |foot: usize| {
            let [x, y] = place(self.feet[foot]);
            let class = if played.foot_forces[step][foot] > 0.0 { "on" } else { "off" };
            format!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\"/>")
        };
        let [a, b] = [[-0.5, 0.5].map(|x| x * 0.8 * CELL[0]), [0.0; 2]];
        let level = place([0.0, 0.0, self.lowest()]);
        let mut out = format!(
            "<path class=\"axis\" d=\"M{:.1} {:.1}H{:.1}\"/>",
            level[0] + a[0],
            level[1] + b[0],
            level[0] + a[1]
        );
        far.iter().for_each(|one| out += &line("limb far", one));
        out += &self.trunk(played, place);
        near.iter().for_each(|one| out += &line("limb", one));
        (0..self.feet.len()).for_each(|k| out += &foot(k));
        out
    }

    /// A box over the joints at the base, as thick as a fifth of its length: its sides, then its top.
    fn trunk(&self, played: &WalkTrace, place: &dyn Fn([f32; 3]) -> [f32; 2]) -> String {
        let mut corners: Vec<[f32; 3]> =
            (1..self.links.len()).filter(|&l| played.parents[l] == Some(0)).map(|l| self.links[l]).collect();
        corners.sort_by(|a, b| a[1].atan2(a[0]).total_cmp(&b[1].atan2(b[0])));
        let long = corners.iter().map(|p| p[0].abs()).fold(0.0, f32::max);
        let raised = |p: &[f32; 3], by: f32| [0, 1, 2].map(|k| p[k] + by * long * self.up[k]);
        let low: Vec<[f32; 3]> = corners.iter().map(|p| raised(p, -0.1)).collect();
        let top: Vec<[f32; 3]> = corners.iter().map(|p| raised(p, 0.3)).collect();
        let face = |corners: &[[f32; 3]]| {
            let places = corners.iter().map(|p| place(*p)).map(|[x, y]| format!("{x:.1} {y:.1}"));
            format!("<path class=\"trunk\" d=\"M{}Z\"/>", places.collect::<Vec<_>>().join("L"))
        };
        // Sides from the far one to the near one: y is to the left, and the view is from the right.
        let mut sides: Vec<[[f32; 3]; 4]> = (0..corners.len())
            .map(|k| [k, (k + 1) % corners.len()])
            .map(|[a, b]| [low[a], low[b], top[b], top[a]])
            .collect();
        sides.sort_by(|a, b| (b[0][1] + b[1][1]).total_cmp(&(a[0][1] + a[1][1])));
        let sides: String = sides.iter().map(|side| face(side)).collect();
        if corners.is_empty() { sides } else { sides + &face(&top) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::walk::example::made_up;

    #[test]
    fn eight_poses_of_one_stride_or_of_the_fall() {
        let mut played = made_up(200);
        let (what, svg) = film(&played).unwrap();
        assert!(what.starts_with("One stride of 0.50 s"), "{what}");
        assert_eq!((svg.matches("class=\"trunk\"").count(), svg.matches("<circle").count()), (40, 32));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        played.fell = Some(150);
        let (what, svg) = film(&played).unwrap();
        assert!(what == "The fall." && svg.states("2.22 2.22") && svg.states("3.02 3.02"), "{svg}");
        assert!(film(&made_up(0)).is_none() && film(&made_up(1)).is_some());
    }
}
