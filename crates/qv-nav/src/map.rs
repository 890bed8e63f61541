//! Where a robot can go: heights, distances to what blocks, and ways, on a square grid over a labelled mesh.
//!
//! Ways come from fast marching (Sethian 1996): the time at which a front that starts at the goal reaches each cell, slower where there is
//! little room or the label is dear. Its slope leads to the goal.

use crate::NavError;
use glam::{DVec2, DVec3};
use qv_core::{Pose, TriangleMesh};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// What a robot can go over, and how the grid is made.
#[derive(Debug, Clone, PartialEq)]
pub struct MapSettings {
    /// Side of a cell \[m\].
    pub spacing: f64,
    /// Highest step from cell to cell \[m\].
    pub step: f64,
    /// Steepest slope \[rad\].
    pub slope: f64,
    /// Room from the robot's middle to what blocks \[m\].
    pub clearance: f64,
    /// Room below which ways are dearer \[m\].
    pub comfort: f64,
    /// Surfaces higher than this are no ground \[m\].
    pub ceiling: f64,
    /// Height of the ground where the mesh has none, within its bounds \[m\]: for captures that show little of their floor. `None`: what was not
    /// seen is no ground.
    pub floor: Option<f64>,
    /// Factors on the way by name of label; 1 for all others.
    pub dear: Vec<(String, f64)>,
}

impl Default for MapSettings {
    fn default() -> Self {
        Self {
            spacing: 0.05,
            step: 0.06,
            slope: 0.45,
            clearance: 0.32,
            comfort: 0.60,
            ceiling: 2.0,
            floor: None,
            dear: vec![("tiles".into(), 1.2)],
        }
    }
}

/// The grid.
#[derive(Debug, Clone)]
pub struct Map {
    origin: DVec2,
    spacing: f64,
    size: [usize; 2],
    clearance: f64,
    /// Height of the ground \[m\], not a number where there is none.
    heights: Vec<f32>,
    /// Whether the mesh shows it.
    shown: Vec<bool>,
    /// Distance to what blocks \[m\].
    room: Vec<f32>,
    /// Time per metre, infinite where nobody gets through.
    slowness: Vec<f32>,
    /// Cells of the largest place that hangs together with enough room.
    within: Vec<bool>,
}

/// Arrival times at all cells.
#[derive(Debug, Clone)]
pub struct Field(Vec<f32>);

/// Least room at which a robot that strayed can still go on \[m\].
pub(crate) const SQUEEZE: f32 = 0.12;
/// How dear it is there.
const SQUEEZE_COST: f32 = 8.0;

impl Map {
    /// The grid over a mesh.
    ///
    /// # Errors
    /// When a setting means nothing, or there is no ground with enough room.
    pub fn new(mesh: &TriangleMesh, settings: &MapSettings) -> Result<Self, NavError> {
        if !(0.01..=0.5).contains(&settings.spacing) {
            return Err(NavError::value("spacing of the map", "0.01 to 0.5 m", settings.spacing));
        }
        let corners = || mesh.triangles.iter().flatten().map(|&v| mesh.vertices[v as usize].truncate());
        let (low, high) = corners().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let span = (high - low) / settings.spacing;
        if !(span.x >= 1.0 && span.y >= 1.0 && span.x * span.y < 4e7) {
            return Err(NavError::value(
                "extent of the mesh",
                "1 to 40 million cells of the map",
                format!("{}", high - low),
            ));
        }
        // Two cells around without ground: where the mesh ends is what blocks.
        let size = [span.x.ceil() as usize + 4, span.y.ceil() as usize + 4];
        let origin = low - DVec2::splat(1.75 * settings.spacing);
        let count = size[0] * size[1];
        let mut map = Self {
            origin,
            spacing: settings.spacing,
            size,
            clearance: settings.clearance,
            heights: vec![f32::NAN; count],
            shown: Vec::new(),
            room: Vec::new(),
            slowness: vec![1.0; count],
            within: Vec::new(),
        };
        let labels = map.lay(mesh, settings);
        map.shown = map.heights.iter().map(|height| !height.is_nan()).collect();
        if let Some(floor) = settings.floor {
            map.fill(floor as f32);
        }
        let blocked = map.blocked(settings);
        let sources: Vec<(usize, f32)> = (0..count).filter(|&c| blocked[c]).map(|c| (c, 0.0)).collect();
        map.room = map.march(&sources, |_| 1.0);
        let factors: Vec<f32> = mesh
            .materials
            .iter()
            .map(|m| settings.dear.iter().find(|(name, _)| *name == m.name).map_or(1.0, |(_, factor)| *factor as f32))
            .collect();
        for cell in 0..count {
            let (room, clear, comfort) = (map.room[cell], settings.clearance as f32, settings.comfort as f32);
            let narrow = 1.0 + 2.5 * ((comfort - room) / (comfort - clear).max(0.01)).clamp(0.0, 1.0);
            let of_label = factors.get(labels[cell] as usize).copied().unwrap_or(1.0);
            map.slowness[cell] = match room {
                r if r >= clear => narrow * of_label,
                r if r > SQUEEZE => SQUEEZE_COST,
                _ => f32::INFINITY,
            };
        }
        map.within = map.largest();
        if !map.within.contains(&true) {
            let expected = format!("ground with {} m of room", settings.clearance);
            return Err(NavError::value("mesh", &expected, "none"));
        }
        Ok(map)
    }

    /// Fills the heights; gives the label of each cell.
    fn lay(&mut self, mesh: &TriangleMesh, settings: &MapSettings) -> Vec<u16> {
        let mut labels = vec![u16::MAX; self.heights.len()];
        for t in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(t);
            let normal = (b - a).cross(c - a);
            if normal.z <= 0.2 * normal.length() || a.z.min(b.z).min(c.z) > settings.ceiling {
                continue;
            }
            let (low, high) = (a.min(b).min(c).truncate(), a.max(b).max(c).truncate());
            let from = ((low - self.origin) / self.spacing - 0.5).ceil().max(DVec2::ZERO);
            let to = ((high - self.origin) / self.spacing - 0.5).floor();
            for j in from.y as usize..=(to.y.max(-1.0) + 1.0) as usize {
                for i in from.x as usize..=(to.x.max(-1.0) + 1.0) as usize {
                    if i >= self.size[0] || j >= self.size[1] {
                        continue;
                    }
                    let p = self.centre(j * self.size[0] + i);
                    let weight = |u: DVec3, v: DVec3| (v - u).truncate().perp_dot(p - u.truncate());
                    let [wa, wb, wc] = [weight(b, c), weight(c, a), weight(a, b)];
                    if wa < -1e-12 || wb < -1e-12 || wc < -1e-12 {
                        continue;
                    }
                    let z = ((wa * a.z + wb * b.z + wc * c.z) / (wa + wb + wc)) as f32;
                    let cell = j * self.size[0] + i;
                    if self.heights[cell].is_nan() || self.heights[cell] < z {
                        self.heights[cell] = z;
                        labels[cell] = mesh.labels.get(t).copied().unwrap_or(u16::MAX);
                    }
                }
            }
        }
        labels
    }

    /// Gives cells without ground a height, but for the rim of two cells.
    fn fill(&mut self, floor: f32) {
        let [w, h] = self.size;
        for cell in (2..h - 2).flat_map(|j| (2..w - 2).map(move |i| j * w + i)) {
            if self.heights[cell].is_nan() {
                self.heights[cell] = floor;
            }
        }
    }

    /// Cells without ground, at steps, or on slopes.
    fn blocked(&self, settings: &MapSettings) -> Vec<bool> {
        let rise = (settings.slope.tan() * self.spacing) as f32;
        let step = settings.step as f32;
        (0..self.heights.len())
            .map(|cell| {
                let here = self.heights[cell];
                if here.is_nan() {
                    return true;
                }
                let around = self.neighbours(cell);
                let steps = around.iter().flatten().any(|&n| (self.heights[n] - here).abs() > step);
                let slope = |a: Option<usize>, b: Option<usize>| match (a, b) {
                    (Some(a), Some(b)) => (self.heights[a] - self.heights[b]).abs() > 2.0 * rise,
                    _ => false,
                };
                steps || slope(around[0], around[1]) || slope(around[2], around[3])
            })
            .collect()
    }

    /// Neighbours to the left, to the right, below, above.
    fn neighbours(&self, cell: usize) -> [Option<usize>; 4] {
        let (i, j, [w, h]) = (cell % self.size[0], cell / self.size[0], self.size);
        [
            (i > 0).then(|| cell - 1),
            (i + 1 < w).then(|| cell + 1),
            (j > 0).then(|| cell - w),
            (j + 1 < h).then(|| cell + w),
        ]
    }

    fn largest(&self) -> Vec<bool> {
        let free = |c: usize| self.room[c] >= self.clearance as f32;
        let mut of = vec![0usize; self.heights.len()];
        let (mut best, mut most) = (0, 0);
        for start in 0..of.len() {
            if of[start] != 0 || !free(start) {
                continue;
            }
            let mark = start + 1;
            let (mut stack, mut count) = (vec![start], 0);
            of[start] = mark;
            while let Some(cell) = stack.pop() {
                count += 1;
                for n in self.neighbours(cell).into_iter().flatten() {
                    if of[n] == 0 && free(n) {
                        of[n] = mark;
                        stack.push(n);
                    }
                }
            }
            if count > most {
                (best, most) = (mark, count);
            }
        }
        of.iter().map(|&mark| mark == best && best != 0).collect()
    }

    /// Fast marching from cells with their times, through cells of a slowness \[s/m\].
    fn march(&self, sources: &[(usize, f32)], slowness: impl Fn(usize) -> f32) -> Vec<f32> {
        let mut times = vec![f32::INFINITY; self.heights.len()];
        let mut done = vec![false; times.len()];
        let mut heap: BinaryHeap<Reverse<(u32, usize)>> = BinaryHeap::new();
        for &(cell, time) in sources {
            times[cell] = time;
            heap.push(Reverse((time.to_bits(), cell)));
        }
        // Times are not negative: their bits are in their order.
        while let Some(Reverse((_, cell))) = heap.pop() {
            if std::mem::replace(&mut done[cell], true) {
                continue;
            }
            for n in self.neighbours(cell).into_iter().flatten().filter(|&n| !done[n]) {
                let step = slowness(n) * self.spacing as f32;
                if !step.is_finite() {
                    continue;
                }
                let around = self.neighbours(n).map(|m| m.map_or(f32::INFINITY, |m| times[m]));
                let (a, b) = (around[0].min(around[1]), around[2].min(around[3]));
                let (near, far) = (a.min(b), a.max(b));
                let time = if far - near >= step {
                    near + step
                } else {
                    0.5 * (near + far + (2.0 * step * step - (far - near).powi(2)).sqrt())
                };
                if time < times[n] {
                    times[n] = time;
                    heap.push(Reverse((time.to_bits(), n)));
                }
            }
        }
        times
    }

    /// Times to a place, with places to keep away from.
    pub fn field(&self, goal: DVec2, avoid: &[DVec2]) -> Field {
        let keep = |cell: usize| {
            let p = self.centre(cell);
            let near = avoid.iter().map(|a| a.distance(p)).fold(f64::INFINITY, f64::min);
            if near < 0.65 { 1.0 + 25.0 * (0.65 - near) as f32 } else { 1.0 }
        };
        let slow = |cell: usize| self.slowness[cell] * keep(cell);
        Field(self.cell(goal).map_or_else(Vec::new, |goal| self.march(&[(goal, 0.0)], slow)))
    }

    /// Lengths of the shortest ways from a place that keep the clearance \[m\].
    pub fn lengths(&self, from: DVec2) -> Field {
        let slow = |cell: usize| if self.room[cell] >= self.clearance as f32 { 1.0 } else { f32::INFINITY };
        Field(self.cell(from).map_or_else(Vec::new, |from| self.march(&[(from, 0.0)], slow)))
    }

    /// Value of a field at a place; infinite where the front does not come.
    pub fn at(&self, field: &Field, p: DVec2) -> f64 {
        self.cell(p).and_then(|c| field.0.get(c)).map_or(f64::INFINITY, |&t| f64::from(t))
    }

    /// The point `ahead` metres down the way from a place; the place itself at the goal. `None` where no way leads.
    pub fn ahead(&self, field: &Field, from: DVec2, ahead: f64) -> Option<DVec2> {
        let mut cell = self.nearest(field, from)?;
        let mut left = ahead - self.centre(cell).distance(from);
        while left > 0.0 {
            let [w, h] = self.size;
            let (i, j) = (cell % w, cell / w);
            let around = (0..9usize).filter(|&k| k != 4).filter_map(|k| {
                let (x, y) = ((i + k % 3).checked_sub(1)?, (j + k / 3).checked_sub(1)?);
                (x < w && y < h).then(|| y * w + x)
            });
            let slope = |n: usize| {
                let across = n % w != i && n / w != j;
                (field.0[cell] - field.0[n]) / if across { std::f32::consts::SQRT_2 } else { 1.0 }
            };
            let next = around.max_by(|&a, &b| slope(a).total_cmp(&slope(b)))?;
            if slope(next) <= 0.0 {
                break;
            }
            left -= self.centre(cell).distance(self.centre(next));
            cell = next;
        }
        Some(self.centre(cell))
    }

    /// The cell of a place, or the nearest that the front reached within 0.5 m.
    fn nearest(&self, field: &Field, p: DVec2) -> Option<usize> {
        let here = self.cell(p)?;
        if field.0.get(here)?.is_finite() {
            return Some(here);
        }
        let reach = (0.5 / self.spacing) as i64;
        let (i, j) = ((here % self.size[0]) as i64, (here / self.size[0]) as i64);
        let square = (-reach..=reach).flat_map(|b| (-reach..=reach).map(move |a| (i + a, j + b)));
        square
            .filter(|&(x, y)| x >= 0 && y >= 0 && x < self.size[0] as i64 && y < self.size[1] as i64)
            .map(|(x, y)| y as usize * self.size[0] + x as usize)
            .filter(|&c| field.0[c].is_finite())
            .min_by(|&a, &b| self.centre(a).distance(p).total_cmp(&self.centre(b).distance(p)))
    }

    fn cell(&self, p: DVec2) -> Option<usize> {
        let at = (p - self.origin) / self.spacing;
        // Written so that what is not a number finds nothing.
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        inside.then(|| at.y as usize * self.size[0] + at.x as usize)
    }

    fn centre(&self, cell: usize) -> DVec2 {
        let at = DVec2::new((cell % self.size[0]) as f64, (cell / self.size[0]) as f64);
        self.origin + (at + 0.5) * self.spacing
    }

    /// Height of the ground \[m\]; `None` where there is none.
    pub fn height(&self, p: DVec2) -> Option<f64> {
        self.cell(p).map(|c| f64::from(self.heights[c])).filter(|h| !h.is_nan())
    }

    /// Whether the mesh shows ground at a place, which is not taken for floor alone ([`MapSettings::floor`]).
    pub fn is_shown(&self, p: DVec2) -> bool {
        self.cell(p).is_some_and(|c| self.shown[c])
    }

    /// Distance to what blocks \[m\]; 0 outside.
    pub fn room(&self, p: DVec2) -> f64 {
        self.cell(p).map_or(0.0, |c| f64::from(self.room[c]))
    }

    /// Distance from a place along a direction to what blocks, at most `most` \[m\], to a cell.
    pub fn clear(&self, from: DVec2, along: DVec2, most: f64) -> f64 {
        let steps = (most / self.spacing).round() as usize;
        let blocked = |k: &usize| self.room(from + *k as f64 * self.spacing * along) < self.spacing;
        (0..steps).find(blocked).map_or(most, |k| k as f64 * self.spacing)
    }

    /// Distance from an eye along a direction within which something `tall` \[m\] on the ground can be seen, at most `most` \[m\], to a cell.
    pub(crate) fn in_sight(&self, eye: DVec3, along: DVec2, tall: f64, most: f64) -> f64 {
        let steps = (most / self.spacing).round() as usize;
        let mut steepest = f64::NEG_INFINITY;
        for k in 1..steps {
            let distance = k as f64 * self.spacing;
            let Some(ground) = self.height(eye.truncate() + distance * along) else { return distance };
            if (ground + tall - eye.z) / distance < steepest {
                return distance;
            }
            steepest = steepest.max((ground - eye.z) / distance);
        }
        most
    }

    /// Direction in which the room grows; none where it grows nowhere.
    pub fn away(&self, p: DVec2) -> DVec2 {
        // Over two cells each way: the room is that of a grid.
        let step = 2.0 * self.spacing;
        let slope = |along: DVec2| self.room(p + step * along) - self.room(p - step * along);
        DVec2::new(slope(DVec2::X), slope(DVec2::Y)).normalize_or_zero()
    }

    /// Whether a robot's middle may be here, in the place where all episodes are.
    pub fn is_within(&self, p: DVec2) -> bool {
        self.cell(p).is_some_and(|c| self.within[c])
    }

    /// Places of a coarser grid of `spacing` \[m\] with so much room.
    pub fn places(&self, spacing: f64, room: f64) -> Vec<DVec2> {
        let step = (spacing / self.spacing).round().max(1.0) as usize;
        let cells = (0..self.size[1]).step_by(step).flat_map(|j| (0..self.size[0]).step_by(step).map(move |i| (i, j)));
        cells
            .map(|(i, j)| j * self.size[0] + i)
            .filter(|&c| self.within[c] && f64::from(self.room[c]) >= room)
            .map(|c| self.centre(c))
            .collect()
    }

    /// Whether nothing stands between two points.
    pub fn is_free(&self, from: DVec3, to: DVec3) -> bool {
        let steps = ((to - from).length() / (0.8 * self.spacing)).ceil().max(1.0) as usize;
        (1..steps).all(|k| {
            let p = from.lerp(to, k as f64 / steps as f64);
            self.height(p.truncate()).is_none_or(|h| h < p.z)
        })
    }

    /// Lower left and upper right corner \[m\].
    pub fn bounds(&self) -> [DVec2; 2] {
        [self.origin, self.origin + DVec2::new(self.size[0] as f64, self.size[1] as f64) * self.spacing]
    }

    /// Cells in which a robot's middle may not be, as rectangles by rows for drawings: x from, x to, y of the middle \[m\].
    pub fn closed_rows(&self) -> Vec<[f64; 3]> {
        let mut out = Vec::new();
        for j in 0..self.size[1] {
            let mut since = None;
            for i in 0..=self.size[0] {
                let closed = i < self.size[0] && self.room[j * self.size[0] + i] < SQUEEZE;
                match (closed, since) {
                    (true, None) => since = Some(i),
                    (false, Some(from)) => {
                        let x = |i: usize| self.origin.x + i as f64 * self.spacing;
                        out.push([x(from), x(i), self.origin.y + (j as f64 + 0.5) * self.spacing]);
                        since = None;
                    }
                    _ => {}
                }
            }
        }
        out
    }
}

/// The pose of a base that stands on the ground.
pub fn standing(map: &Map, place: DVec2, yaw: f64, height: f64) -> Pose {
    let z = map.height(place).unwrap_or(0.0) + height;
    Pose::from_xyz_rpy([place.x, place.y, z], [0.0, 0.0, yaw])
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Six by six metres with a box of 2 x 2 m and 0.5 m height in the middle.
    pub fn ring() -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        let mut square = |[x0, x1, y0, y1]: [f64; 4], z: f64| {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend([(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec3::new(x, y, z)));
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        };
        square([-3.0, 3.0, -3.0, 3.0], 0.0);
        square([-1.0, 1.0, -1.0, 1.0], 0.5);
        mesh
    }

    #[test]
    fn ways_lead_round_what_blocks() {
        let map = Map::new(&ring(), &MapSettings::default()).unwrap();
        let (from, to) = (DVec2::new(-2.0, 0.0), DVec2::new(2.0, 0.0));
        assert!(map.room(DVec2::new(-2.0, 0.0)) > 0.85 && map.room(DVec2::ZERO) > 0.5 && !map.is_within(DVec2::ZERO));
        // Over two corners of the box with 0.3 m of room: two slants and a straight part.
        let length = map.at(&map.lengths(from), to);
        let exact = 2.0 * (DVec2::new(2.0 - 1.3, 1.3)).length() + 2.6;
        assert!((length - exact).abs() < 0.25, "{length} for {exact}");
        let field = map.field(to, &[]);
        let mut p = from;
        for _ in 0..60 {
            p = map.ahead(&field, p, 0.2).unwrap();
            assert!(map.room(p) > 0.2, "{p}");
        }
        assert!(p.distance(to) < 0.1, "{p}");
        let aside = map.field(to, &[DVec2::new(0.0, 1.7)]);
        assert!(map.ahead(&aside, DVec2::new(-2.0, 0.05), 1.5).unwrap().y < 0.0, "the other side is free");
    }

    #[test]
    fn what_was_not_seen_is_floor_if_that_is_said() {
        let mut mesh = ring();
        // Of the floor a triangle without area is left, which only says how far the place reaches; of the box its top.
        mesh.triangles = vec![[0, 2, 0], [4, 5, 6], [4, 6, 7]];
        assert!(
            Map::new(&mesh, &MapSettings { clearance: 1.2, ..Default::default() }).is_err(),
            "the box is too small"
        );
        let map = Map::new(&mesh, &MapSettings { floor: Some(0.0), ..Default::default() }).unwrap();
        assert!(map.is_within(DVec2::new(-2.0, 0.0)) && !map.is_within(DVec2::ZERO));
        assert_eq!((map.height(DVec2::new(-2.0, 0.0)), map.height(DVec2::ZERO)), (Some(0.0), Some(0.5)));
        assert!(map.room(DVec2::new(-2.99, 0.0)) < 0.1, "the rim blocks");
        assert!(map.is_shown(DVec2::ZERO) && !map.is_shown(DVec2::new(-2.0, 0.0)) && !map.is_shown(DVec2::splat(9.0)));
    }

    #[test]
    fn boxes_hide_and_steps_close() {
        let map = Map::new(&ring(), &MapSettings::default()).unwrap();
        let eye = DVec3::new(-2.0, 0.0, 0.4);
        assert!(!map.is_free(eye, DVec3::new(2.0, 0.0, 0.3)) && map.is_free(eye, DVec3::new(-2.0, 2.5, 0.1)));
        let sight = |along| map.in_sight(eye, along, 0.3, 6.0);
        // A cone on the box would be seen, one behind it not; the other way the ground ends after a metre.
        assert!(
            (sight(DVec2::X) - 3.0).abs() < 0.11 && (sight(DVec2::NEG_X) - 1.0).abs() < 0.11,
            "{}",
            sight(DVec2::X)
        );
        assert!((sight(DVec2::Y) - 3.0).abs() < 0.11);
        assert!(map.room(DVec2::new(-2.99, 0.0)) < 0.1 && map.room(DVec2::new(2.99, 0.0)) < 0.1, "the rim blocks");
        let low = MapSettings { step: 0.6, slope: 1.5, ..Default::default() };
        assert!(Map::new(&ring(), &low).unwrap().is_within(DVec2::ZERO), "who climbs 0.6 m gets onto the box");
        assert!(Map::new(&ring(), &MapSettings { clearance: 5.0, ..Default::default() }).is_err());
        assert!(Map::new(&TriangleMesh::default(), &MapSettings::default()).is_err());
    }
}
