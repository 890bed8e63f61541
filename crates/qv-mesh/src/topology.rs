//! Edges of a mesh: what is shared, what is open, what is off.

use qv_core::TriangleMesh;
use rayon::prelude::*;

/// A side of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Side {
    /// The smaller and the larger of its vertices.
    pub ends: [u32; 2],
    pub triangle: u32,
    /// Which side of it: from corner `corner` to the next.
    pub corner: u8,
    /// Whether it goes from the smaller to the larger vertex.
    pub forward: bool,
}

/// All sides of all triangles, those of an edge beside each other.
pub(crate) fn sides(mesh: &TriangleMesh) -> Vec<Side> {
    let of = |t: usize| {
        let triangle = mesh.triangles[t];
        (0..3).map(move |k| {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            Side { ends: [a.min(b), a.max(b)], triangle: t as u32, corner: k as u8, forward: a < b }
        })
    };
    let mut out: Vec<Side> = (0..mesh.triangles.len()).flat_map(of).collect();
    out.par_sort_unstable();
    out
}

/// Whether the sides of an edge are two triangles that agree about what is outside.
pub(crate) fn is_shared(sides: &[Side]) -> bool {
    sides.len() == 2 && sides[0].forward != sides[1].forward
}

/// Sets that grow together.
pub(crate) struct Groups(Vec<u32>);

impl Groups {
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The set of an element, by its smallest member.
    pub fn find(&mut self, mut at: u32) -> u32 {
        while self.0[at as usize] != at {
            self.0[at as usize] = self.0[self.0[at as usize] as usize];
            at = self.0[at as usize];
        }
        at
    }

    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// How a mesh holds together.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Topology {
    /// Edges with one triangle.
    pub open_edges: usize,
    /// Edges with three triangles or more.
    pub crowded_edges: usize,
    /// Edges whose two triangles disagree about what is outside.
    pub twisted_edges: usize,
    /// Vertices whose triangles form more than one fan.
    pub pinched_vertices: usize,
    /// Pieces that share no vertex.
    pub components: usize,
    /// Vertices minus edges plus triangles; 2 for what is like a ball.
    pub euler: i64,
    /// Enclosed volume \[m³\], positive when normals point outwards; of no meaning when edges are open.
    pub volume: f64,
    /// Area \[m²\].
    pub area: f64,
}

impl Topology {
    /// Of a mesh whose indices are valid.
    pub fn of(mesh: &TriangleMesh) -> Self {
        let sides = sides(mesh);
        let mut out = Self::default();
        let mut edges = 0i64;
        let mut fans = Groups::new(3 * mesh.triangles.len());
        let mut pieces = Groups::new(mesh.vertices.len());
        for edge in sides.chunk_by(|a, b| a.ends == b.ends) {
            edges += 1;
            pieces.join(edge[0].ends[0], edge[0].ends[1]);
            match edge.len() {
                1 => out.open_edges += 1,
                2 if is_shared(edge) => join_fans(&mut fans, edge, mesh),
                2 => out.twisted_edges += 1,
                _ => out.crowded_edges += 1,
            }
        }
        let mut used = vec![0u32; mesh.vertices.len()];
        for (corner, vertex) in mesh.triangles.iter().flatten().enumerate() {
            used[*vertex as usize] += u32::from(fans.find(corner as u32) == corner as u32);
        }
        out.pinched_vertices = used.iter().filter(|fans| **fans > 1).count();
        let vertices = used.iter().filter(|fans| **fans > 0).count();
        out.components = (0..used.len() as u32).filter(|v| used[*v as usize] > 0 && pieces.find(*v) == *v).count();
        out.euler = vertices as i64 - edges + mesh.triangles.len() as i64;
        for t in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(t);
            out.volume += a.dot(b.cross(c)) / 6.0;
            out.area += 0.5 * (b - a).cross(c - a).length();
        }
        out
    }

    /// Whether every edge has two triangles that agree about what is outside.
    pub fn is_watertight(&self) -> bool {
        self.open_edges + self.crowded_edges + self.twisted_edges == 0 && self.area > 0.0
    }
}

/// Joins the corners of two triangles at both ends of the edge that they share.
pub(crate) fn join_fans(fans: &mut Groups, edge: &[Side], mesh: &TriangleMesh) {
    for end in edge[0].ends {
        let corner = |side: &Side| {
            let triangle = mesh.triangles[side.triangle as usize];
            let k = (0..3).find(|k| triangle[*k as usize] == end).unwrap_or(0);
            3 * side.triangle + k
        };
        fans.join(corner(&edge[0]), corner(&edge[1]));
    }
}
