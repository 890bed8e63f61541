//! Fewer triangles: edges are collapsed in the order of their quadric error (Garland and Heckbert, *Surface simplification using
//! quadric error metrics*, 1997).
//!
//! A collapse must keep the mesh a manifold (the link condition; Dey et al. 1999), turn no triangle over, and leave the borders
//! between labels and the rim where they are: their vertices move along them only, and where three meet not at all.

use crate::clean::drop_unused;
use crate::topology::sides;
use glam::{DMat3, DVec3};
use qv_core::TriangleMesh;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Weight of the planes that hold borders in place, per area of a square over the edge.
const BORDER: f64 = 10.0;
/// Least cosine between a triangle's normal before and after a collapse.
const TURN: f64 = 0.3;
/// Least shape of a new triangle, 1 for an equilateral one, unless the old one was worse.
const SHAPE: f64 = 0.05;

/// Sum of squared distances to planes: p' A p + 2 b' p + c.
#[derive(Debug, Clone, Copy, Default)]
struct Quadric {
    a: [f64; 6],
    b: DVec3,
    c: f64,
}

impl Quadric {
    /// Of the plane through a point with a unit normal.
    fn plane(n: DVec3, point: DVec3, weight: f64) -> Self {
        let d = -n.dot(point);
        let a = [n.x * n.x, n.x * n.y, n.x * n.z, n.y * n.y, n.y * n.z, n.z * n.z].map(|x| weight * x);
        Self { a, b: weight * d * n, c: weight * d * d }
    }

    fn add(&mut self, other: &Self) {
        for k in 0..6 {
            self.a[k] += other.a[k];
        }
        self.b += other.b;
        self.c += other.c;
    }

    fn matrix(&self) -> DMat3 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
    }

    fn at(&self, p: DVec3) -> f64 {
        (p.dot(self.matrix() * p) + 2.0 * self.b.dot(p) + self.c).max(0.0)
    }

    /// Where it is least, held to `near` along directions that it does not determine.
    fn least(&self, near: DVec3) -> DVec3 {
        let trace = self.a[0] + self.a[3] + self.a[5];
        let matrix = self.matrix() + DMat3::from_diagonal(DVec3::splat(1e-4 * trace.max(1e-30)));
        let found = near + matrix.inverse() * -(self.matrix() * near + self.b);
        if found.is_finite() { found } else { near }
    }
}

/// What a vertex may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Anything.
    Free,
    /// Move along the border that it lies on.
    Border,
    /// Nothing.
    Fixed,
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecimateOptions {
    /// Triangles to come down to.
    pub triangles: usize,
    /// How far the surface may move in all \[m\]: a bound on the sum of the distances from each merged vertex to the planes of the
    /// triangles that it replaces, along every chain of collapses.
    pub max_error: f64,
}

/// What came of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Decimation {
    /// Triangles before.
    pub before: usize,
    /// Triangles after; more than asked for when the error would have been too large.
    pub after: usize,
    /// Largest bound of a vertex's error \[m\].
    pub error: f64,
}

/// Collapses edges until a mesh has few enough triangles or would move too far.
pub fn decimate(mesh: &mut TriangleMesh, options: &DecimateOptions) -> Decimation {
    let before = mesh.triangles.len();
    if before <= options.triangles {
        return Decimation { before, after: before, error: 0.0 };
    }
    let mut work = Work::new(mesh, options.max_error);
    let mut left = before;
    while left > options.triangles {
        let Some(Reverse((_, a, b, stamp_a, stamp_b))) = work.heap.pop() else { break };
        if work.stamp[a as usize] != stamp_a || work.stamp[b as usize] != stamp_b {
            continue;
        }
        left -= work.collapse(a, b);
    }
    let error =
        work.error.iter().zip(&work.fans).filter(|(_, fan)| !fan.is_empty()).fold(0.0, |m, (e, _)| f64::max(m, *e));
    let Work { mesh: reduced, alive, .. } = work;
    *mesh = reduced;
    let keep = |t: usize| alive[t];
    mesh.labels = (0..mesh.labels.len()).filter(|t| keep(*t)).map(|t| mesh.labels[t]).collect();
    mesh.triangles = (0..mesh.triangles.len()).filter(|t| keep(*t)).map(|t| mesh.triangles[t]).collect();
    drop_unused(mesh);
    Decimation { before, after: mesh.triangles.len(), error }
}

/// Cost as ordered bits, the two vertices, and what their stamps were.
type Candidate = Reverse<(u64, u32, u32, u32, u32)>;

struct Work {
    mesh: TriangleMesh,
    alive: Vec<bool>,
    /// Triangles at each vertex.
    fans: Vec<Vec<u32>>,
    quadrics: Vec<Quadric>,
    kinds: Vec<Kind>,
    /// Bound of how far the surface has moved at each vertex \[m\].
    error: Vec<f64>,
    /// Changes whenever the vertex does.
    stamp: Vec<u32>,
    heap: BinaryHeap<Candidate>,
    max_error: f64,
}

impl Work {
    fn new(mesh: &TriangleMesh, max_error: f64) -> Self {
        let vertices = mesh.vertices.len();
        let mut work = Self {
            mesh: mesh.clone(),
            alive: vec![true; mesh.triangles.len()],
            fans: vec![Vec::new(); vertices],
            quadrics: vec![Quadric::default(); vertices],
            kinds: vec![Kind::Free; vertices],
            error: vec![0.0; vertices],
            stamp: vec![0; vertices],
            heap: BinaryHeap::new(),
            max_error,
        };
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = mesh.corners(t);
            let area = 0.5 * (b - a).cross(c - a);
            let quadric = area.try_normalize().map(|n| Quadric::plane(n, a, area.length()));
            for v in triangle {
                work.fans[*v as usize].push(t as u32);
                quadric.iter().for_each(|q| work.quadrics[*v as usize].add(q));
            }
        }
        work.find_borders();
        work
    }

    /// Sets kinds, adds the planes that hold borders, and fills the heap.
    fn find_borders(&mut self) {
        let sides = sides(&self.mesh);
        let mut borders = vec![0u32; self.mesh.vertices.len()];
        for edge in sides.chunk_by(|a, b| a.ends == b.ends) {
            let label = |k: usize| self.mesh.labels.get(edge[k].triangle as usize);
            if edge.len() == 2 && label(0) == label(1) {
                continue;
            }
            let [a, b] = edge[0].ends.map(|v| self.mesh.vertices[v as usize]);
            for side in edge {
                let [p, q, r] = self.mesh.corners(side.triangle as usize);
                let upright = (q - p).cross(r - p).cross(b - a);
                if let Some(n) = upright.try_normalize() {
                    let hold = Quadric::plane(n, a, BORDER * (b - a).length_squared());
                    edge[0].ends.iter().for_each(|v| self.quadrics[*v as usize].add(&hold));
                }
            }
            // An edge with three triangles or more is left alone.
            edge[0].ends.iter().for_each(|v| borders[*v as usize] += if edge.len() > 2 { 3 } else { 1 });
        }
        for (kind, borders) in self.kinds.iter_mut().zip(borders) {
            *kind = match borders {
                0 => Kind::Free,
                2 => Kind::Border,
                _ => Kind::Fixed,
            };
        }
        for edge in sides.chunk_by(|a, b| a.ends == b.ends) {
            self.push(edge[0].ends[0], edge[0].ends[1]);
        }
    }

    fn push(&mut self, a: u32, b: u32) {
        let (a, b) = (a.min(b), a.max(b));
        let Some(target) = self.target(a, b) else { return };
        let mut quadric = self.quadrics[a as usize];
        quadric.add(&self.quadrics[b as usize]);
        // A little for length, so that flat ground is thinned evenly.
        let length = self.mesh.vertices[a as usize].distance_squared(self.mesh.vertices[b as usize]);
        let cost = quadric.at(target) + 1e-9 * length;
        self.heap.push(Reverse((cost.to_bits(), a, b, self.stamp[a as usize], self.stamp[b as usize])));
    }

    /// Whether an edge lies on the rim or between labels.
    fn is_border(&self, a: u32, b: u32) -> bool {
        let at_edge: Vec<u32> = self.shared(a, b);
        let label = |t: u32| self.mesh.labels.get(t as usize);
        at_edge.len() != 2 || label(at_edge[0]) != label(at_edge[1])
    }

    /// Triangles at both vertices.
    fn shared(&self, a: u32, b: u32) -> Vec<u32> {
        self.fans[a as usize].iter().copied().filter(|t| self.mesh.triangles[*t as usize].contains(&b)).collect()
    }

    /// Where the vertex goes that an edge becomes; none when the edge must stay.
    fn target(&self, a: u32, b: u32) -> Option<DVec3> {
        let (p, q) = (self.mesh.vertices[a as usize], self.mesh.vertices[b as usize]);
        let mut quadric = self.quadrics[a as usize];
        quadric.add(&self.quadrics[b as usize]);
        match (self.kinds[a as usize], self.kinds[b as usize]) {
            (Kind::Free, Kind::Free) => Some(quadric.least(0.5 * (p + q))),
            (Kind::Free, _) => Some(q),
            (_, Kind::Free) => Some(p),
            (Kind::Fixed, Kind::Fixed) => None,
            (kind_a, kind_b) if self.is_border(a, b) => match (kind_a, kind_b) {
                (Kind::Fixed, _) => Some(p),
                (_, Kind::Fixed) => Some(q),
                _ => [p, q, 0.5 * (p + q)].into_iter().min_by(|x, y| quadric.at(*x).total_cmp(&quadric.at(*y))),
            },
            _ => None,
        }
    }

    /// Vertices beside one.
    fn around(&self, v: u32) -> Vec<u32> {
        let mut out: Vec<u32> =
            self.fans[v as usize].iter().flat_map(|t| self.mesh.triangles[*t as usize]).filter(|w| *w != v).collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// Collapses an edge if it may be; returns how many triangles went.
    fn collapse(&mut self, a: u32, b: u32) -> usize {
        let Some(target) = self.target(a, b) else { return 0 };
        let shared = self.shared(a, b);
        let (around_a, around_b) = (self.around(a), self.around(b));
        let common = around_a.iter().filter(|v| around_b.binary_search(v).is_ok()).count();
        // The link condition; and a tetrahedron stays one.
        if shared.is_empty() || common != shared.len() || around_a.len() + around_b.len() - common <= 4 {
            return 0;
        }
        let Some(moved) = self.movement(a, b, target) else { return 0 };
        let error = self.error[a as usize].max(self.error[b as usize]) + moved;
        if error > self.max_error {
            return 0;
        }
        // The vertex with the greater right to stay keeps its kind.
        let kind = |v: u32| self.kinds[v as usize];
        let kept = [Kind::Fixed, Kind::Border].into_iter().find(|k| kind(a) == *k || kind(b) == *k);
        self.kinds[a as usize] = kept.unwrap_or(Kind::Free);
        self.error[a as usize] = error;
        let quadric = self.quadrics[b as usize];
        self.quadrics[a as usize].add(&quadric);
        self.mesh.vertices[a as usize] = target;
        for t in &shared {
            self.alive[*t as usize] = false;
            for v in self.mesh.triangles[*t as usize] {
                self.fans[v as usize].retain(|u| u != t);
            }
        }
        for t in std::mem::take(&mut self.fans[b as usize]) {
            self.mesh.triangles[t as usize].iter_mut().filter(|v| **v == b).for_each(|v| *v = a);
            self.fans[a as usize].push(t);
        }
        self.stamp[a as usize] += 1;
        self.stamp[b as usize] += 1;
        for v in self.around(a) {
            self.push(a, v);
        }
        shared.len()
    }

    /// How far a target lies from the planes of the triangles about an edge \[m\]; none when a triangle would turn over or become
    /// a splinter.
    fn movement(&self, a: u32, b: u32, target: DVec3) -> Option<f64> {
        let mut moved: f64 = 0.0;
        for (v, other) in [(a, b), (b, a)] {
            for t in &self.fans[v as usize] {
                let corners = self.mesh.corners(*t as usize);
                let old = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                if let Some(normal) = old.try_normalize() {
                    moved = moved.max(normal.dot(target - corners[0]).abs());
                }
                let triangle = self.mesh.triangles[*t as usize];
                if triangle.contains(&other) {
                    continue;
                }
                let new = [0, 1, 2].map(|k| if triangle[k] == v { target } else { corners[k] });
                let normal = (new[1] - new[0]).cross(new[2] - new[0]);
                if normal.dot(old) < TURN * normal.length() * old.length()
                    || shape(&new) < SHAPE.min(0.9 * shape(&corners))
                {
                    return None;
                }
            }
        }
        Some(moved)
    }
}

/// Area against the squares of the sides, 1 for an equilateral triangle.
fn shape([a, b, c]: &[DVec3; 3]) -> f64 {
    let squares = a.distance_squared(*b) + b.distance_squared(*c) + c.distance_squared(*a);
    2.0 * 3.0f64.sqrt() * (b - a).cross(c - a).length() / squares.max(1e-300)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::Topology;
    use qv_core::Material;

    /// A sheet of n x n cells over 1 x 1 m, half grass and half stone along a line that is not straight.
    fn sheet(n: usize, height: impl Fn(f64, f64) -> f64) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        let at = |i: usize| i as f64 / n as f64;
        for j in 0..=n {
            for i in 0..=n {
                mesh.vertices.push(DVec3::new(at(i), at(j), height(at(i), at(j))));
            }
        }
        let v = |i: usize, j: usize| (j * (n + 1) + i) as u32;
        for j in 0..n {
            for i in 0..n {
                mesh.triangles.push([v(i, j), v(i + 1, j), v(i + 1, j + 1)]);
                mesh.triangles.push([v(i, j), v(i + 1, j + 1), v(i, j + 1)]);
                mesh.labels.extend([u16::from(if j < n / 2 { 2 * i < n } else { 3 * i < n }); 2]);
            }
        }
        mesh.materials = ["grass", "stone"].map(|name| Material { name: name.into(), friction: None }).into();
        mesh
    }

    fn area_of(mesh: &TriangleMesh, label: u16) -> f64 {
        let of = (0..mesh.triangles.len()).filter(|t| mesh.labels[*t] == label);
        of.map(|t| mesh.corners(t)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
    }

    #[test]
    fn flat_ground_needs_few_triangles_and_keeps_its_labels() {
        let mut mesh = sheet(30, |_, _| 0.0);
        let areas = [area_of(&mesh, 0), area_of(&mesh, 1)];
        let found = decimate(&mut mesh, &DecimateOptions { triangles: 20, max_error: 1e-3 });
        mesh.validate().unwrap();
        assert!(found.after <= 40, "{found:?}");
        let topology = Topology::of(&mesh);
        assert_eq!((topology.crowded_edges, topology.twisted_edges, topology.components, topology.euler), (0, 0, 1, 1));
        assert!((area_of(&mesh, 0) - areas[0]).abs() < 1e-9 && (area_of(&mesh, 1) - areas[1]).abs() < 1e-9);
    }

    #[test]
    fn the_bound_holds_on_bumpy_ground() {
        let height = |x: f64, y: f64| 0.05 * (8.0 * x).sin() * (6.0 * y).cos();
        for bound in [0.002, 0.01] {
            let mut mesh = sheet(60, height);
            let found = decimate(&mut mesh, &DecimateOptions { triangles: 10, max_error: bound });
            assert!(found.error <= bound && found.after < found.before / 4, "{found:?}");
            let worst =
                crate::compare::sample(&mesh, 20_000, 1).unwrap().into_iter().map(|p| (p.z - height(p.x, p.y)).abs());
            let worst = worst.fold(0.0, f64::max);
            println!("bound {bound}: {worst} m, {found:?}");
            assert!(worst <= bound + 0.001, "{worst}");
        }
    }

    #[test]
    fn a_closed_surface_stays_closed() {
        let mut mesh = sheet(24, |x, y| 0.1 * (5.0 * x * y).sin());
        crate::close::close_to_solid(&mut mesh, 0.1);
        let volume = Topology::of(&mesh).volume;
        let found = decimate(&mut mesh, &DecimateOptions { triangles: 300, max_error: 0.02 });
        let topology = Topology::of(&mesh);
        assert!(topology.is_watertight() && topology.pinched_vertices == 0 && topology.euler == 2, "{topology:?}");
        assert!((topology.volume / volume - 1.0).abs() < 0.02 && found.after <= 420, "{found:?}");
    }
}
