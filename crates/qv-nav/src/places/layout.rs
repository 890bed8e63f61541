//! What stands where in a drawn place: walls round it, partitions, and clutter, as prisms on a flat floor.

use glam::{DVec2, DVec3};
use qv_core::TriangleMesh;
use qv_core::random::Xoshiro256PlusPlus;
use std::f64::consts::{FRAC_PI_2, TAU};

/// What a prism is: it decides how it looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// One of the four around the place.
    Wall,
    /// A wall within.
    Partition,
    /// A box.
    Block,
    /// A round thing.
    Post,
    /// A leg of a table.
    Leg,
    /// A table's top.
    Top,
}

/// An upright prism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solid {
    /// What it is.
    pub kind: Kind,
    /// Its middle from above \[m\].
    pub middle: DVec2,
    /// Half sides of a box, radii of a round thing \[m\].
    pub half: DVec2,
    /// Turn about the vertical \[rad\].
    pub yaw: f64,
    /// Heights of its lower and upper end \[m\].
    pub heights: [f64; 2],
    /// Corners of its foot: 4, or more for round things.
    pub corners: usize,
}

impl Solid {
    /// Whether a point from above is within its foot; round things count as boxes that are a little smaller.
    pub fn covers(&self, point: DVec2) -> bool {
        let p = DVec2::from_angle(-self.yaw).rotate(point - self.middle).abs();
        let share = if self.corners > 4 { 0.9 } else { 1.0 };
        p.x <= share * self.half.x && p.y <= share * self.half.y
    }

    fn foot(&self) -> Vec<DVec2> {
        let corner = |k: usize| match self.corners {
            4 => DVec2::new([1.0, -1.0, -1.0, 1.0][k], [1.0, 1.0, -1.0, -1.0][k]) * self.half,
            n => DVec2::from_angle(TAU * k as f64 / n as f64) * self.half,
        };
        (0..self.corners).map(|k| self.middle + DVec2::from_angle(self.yaw).rotate(corner(k))).collect()
    }
}

/// A drawn place without its looks.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Whether it has a roof's light and a room's walls; a yard otherwise.
    pub is_room: bool,
    /// Half sides of the floor \[m\].
    pub half: DVec2,
    /// What stands on it.
    pub solids: Vec<Solid>,
}

/// The surface of a layout.
pub struct Surface {
    /// All of it; faces that look down are left out.
    pub mesh: TriangleMesh,
    /// For each triangle the solid that it belongs to; none for the floor.
    pub solid_of: Vec<Option<usize>>,
}

/// Numbers between two bounds.
pub(super) struct Draw<'a>(pub &'a mut Xoshiro256PlusPlus);

impl Draw<'_> {
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.0.unit())
    }

    pub fn chance(&mut self, share: f64) -> bool {
        f64::from(self.0.unit()) < share
    }

    pub fn within(&mut self, half: DVec2) -> DVec2 {
        DVec2::new(self.between(-half.x, half.x), self.between(-half.y, half.y))
    }
}

impl Layout {
    /// One place.
    pub fn draw(random: &mut Xoshiro256PlusPlus) -> Self {
        let mut draw = Draw(random);
        let is_room = draw.chance(0.5);
        let half = DVec2::new(draw.between(2.6, 4.6), draw.between(2.6, 4.6));
        let mut layout = Self { is_room, half, solids: Vec::new() };
        layout.add_walls(&mut draw);
        for k in 0..1 + draw.0.below(4) {
            layout.add_partition(k, &mut draw);
        }
        // More clutter where there is more floor.
        let area = 4.0 * half.x * half.y;
        for _ in 0..(area * draw.between(0.06, 0.22)) as usize {
            layout.add_clutter(&mut draw);
        }
        layout
    }

    fn add_walls(&mut self, draw: &mut Draw) {
        let height = if self.is_room { draw.between(1.1, 1.6) } else { draw.between(0.3, 1.3) };
        for side in 0..4 {
            let (along, across) = if side % 2 == 0 { (self.half.y, self.half.x) } else { (self.half.x, self.half.y) };
            let yaw = FRAC_PI_2 * f64::from(side);
            let height = if self.is_room { height } else { height * draw.between(0.8, 1.2) };
            self.solids.push(Solid {
                kind: Kind::Wall,
                middle: DVec2::from_angle(yaw) * across,
                half: DVec2::new(0.06, along + 0.06),
                yaw,
                heights: [0.0, height],
                corners: 4,
            });
        }
    }

    /// Hides what is behind it: it is higher than a robot's camera.
    fn add_partition(&mut self, index: usize, draw: &mut Draw) {
        let quarter = if draw.chance(0.5) { 0.0 } else { FRAC_PI_2 };
        let yaw = if draw.chance(0.7) { quarter } else { draw.between(0.0, TAU) };
        let half = DVec2::new(draw.between(0.5, 1.2), draw.between(0.05, 0.15));
        let least = if index == 0 { 0.75 } else { 0.5 };
        let heights = [0.0, draw.between(least, 1.5)];
        let middle = draw.within(self.half * 0.75);
        self.solids.push(Solid { kind: Kind::Partition, middle, half, yaw, heights, corners: 4 });
    }

    fn add_clutter(&mut self, draw: &mut Draw) {
        let middle = draw.within(self.half - 0.2);
        let yaw = if draw.chance(0.5) { 0.0 } else { draw.between(0.0, TAU) };
        let block = Solid { kind: Kind::Block, middle, half: DVec2::splat(0.3), yaw, heights: [0.0; 2], corners: 4 };
        match draw.between(0.0, 1.0) {
            kind if kind < 0.62 => {
                let half = DVec2::new(draw.between(0.1, 0.55), draw.between(0.1, 0.45));
                // Small and low is what a goal looks like.
                let least = if half.x.min(half.y) < 0.2 { 0.6 } else { 0.12 };
                self.solids.push(Solid { half, heights: [0.0, draw.between(least, 1.2)], ..block });
            }
            kind if kind < 0.85 => {
                let radius = draw.between(0.05, 0.4);
                let least = if radius < 0.2 { 0.6 } else { 0.15 };
                let heights = [0.0, draw.between(least, 1.4)];
                let corners = 6 + draw.0.below(5);
                self.solids.push(Solid { kind: Kind::Post, half: DVec2::splat(radius), heights, corners, ..block });
            }
            _ => self.add_table(block, draw),
        }
    }

    fn add_table(&mut self, block: Solid, draw: &mut Draw) {
        let (half, height) = (DVec2::new(draw.between(0.3, 0.7), draw.between(0.25, 0.5)), draw.between(0.4, 0.8));
        self.solids.push(Solid { kind: Kind::Top, half, heights: [height - 0.05, height], ..block });
        for k in 0..4 {
            let corner = DVec2::new([1.0, -1.0, -1.0, 1.0][k], [1.0, 1.0, -1.0, -1.0][k]) * (half - 0.05);
            let middle = block.middle + DVec2::from_angle(block.yaw).rotate(corner);
            let half = DVec2::splat(0.03);
            self.solids.push(Solid { kind: Kind::Leg, middle, half, heights: [0.0, height - 0.05], ..block });
        }
    }

    /// Its surface.
    pub fn surface(&self) -> Surface {
        let mut out = Surface { mesh: TriangleMesh::default(), solid_of: Vec::new() };
        let DVec2 { x, y } = self.half;
        let floor = [(-x, -y), (x, -y), (x, y), (-x, y)].map(|(x, y)| DVec3::new(x, y, 0.0));
        out.add(&floor, None);
        for (k, solid) in self.solids.iter().enumerate() {
            let foot = solid.foot();
            let [low, high] = solid.heights;
            for (j, a) in foot.iter().enumerate() {
                let b = foot[(j + 1) % foot.len()];
                out.add(&[a.extend(low), b.extend(low), b.extend(high), a.extend(high)], Some(k));
            }
            let top: Vec<DVec3> = foot.iter().map(|p| p.extend(high)).collect();
            out.add(&top, Some(k));
        }
        out
    }

    /// A number that two layouts share only if they are the same to a millimetre.
    pub fn hash(&self) -> u64 {
        let numbers = [self.half.x, self.half.y].into_iter().chain(self.solids.iter().flat_map(|s| {
            [s.middle.x, s.middle.y, s.half.x, s.half.y, s.yaw, s.heights[0], s.heights[1], s.corners as f64]
        }));
        let bytes = numbers.flat_map(|x| ((x * 1000.0).round() as i64).to_le_bytes());
        hash_of(bytes)
    }
}

/// FNV-1a.
pub fn hash_of(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

impl Surface {
    /// A convex polygon, its corners counter-clockwise as seen from outside.
    fn add(&mut self, corners: &[DVec3], solid: Option<usize>) {
        let first = self.mesh.vertices.len() as u32;
        self.mesh.vertices.extend(corners);
        for k in 1..corners.len() as u32 - 1 {
            self.mesh.triangles.push([first, first + k, first + k + 1]);
            self.solid_of.push(solid);
        }
    }

    /// \[m²\].
    pub fn area(&self) -> f64 {
        let area = |t: usize| {
            let [a, b, c] = self.mesh.corners(t);
            0.5 * (b - a).cross(c - a).length()
        };
        (0..self.mesh.triangles.len()).map(area).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_look_out_and_nothing_is_like_a_goal() {
        for seed in 0..20 {
            let layout = Layout::draw(&mut Xoshiro256PlusPlus::new(seed));
            let Surface { mesh, solid_of } = layout.surface();
            mesh.validate().unwrap();
            assert_eq!(mesh.triangles.len(), solid_of.len());
            for (t, solid) in solid_of.iter().enumerate() {
                let [a, b, c] = mesh.corners(t);
                let normal = (b - a).cross(c - a).normalize();
                let middle = (a + b + c) / 3.0;
                match solid {
                    None => assert!(normal.z > 0.99),
                    Some(k) => {
                        let solid = &layout.solids[*k];
                        let [low, high] = solid.heights;
                        let inside = solid.middle.extend(0.5 * (low + high));
                        assert!(normal.dot(middle - inside) > 0.0, "seed {seed}, triangle {t}");
                    }
                }
            }
            let free = layout.solids.iter().filter(|s| matches!(s.kind, Kind::Block | Kind::Post));
            for solid in free {
                assert!(solid.half.min_element() >= 0.2 || solid.heights[1] >= 0.6, "{solid:?}");
            }
        }
    }

    #[test]
    fn hashes_differ_by_a_millimetre() {
        let layout = Layout::draw(&mut Xoshiro256PlusPlus::new(3));
        let mut other = layout.clone();
        assert_eq!(layout.hash(), other.hash());
        other.solids[5].middle.x += 0.001;
        assert_ne!(layout.hash(), other.hash());
    }
}
