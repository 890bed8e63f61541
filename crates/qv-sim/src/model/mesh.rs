//! Meshes of robot files.

use glam::DVec3;
use std::collections::HashMap;

/// A mesh as its file has it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshShape {
    /// Vertices \[m\].
    pub vertices: Vec<DVec3>,
    /// Vertices of each triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl MeshShape {
    /// Whether triangles enclose a volume: each edge has one triangle on either side. Vertices at one place count as one.
    pub fn is_closed(&self) -> bool {
        let mut places = HashMap::new();
        let bits = |v: &DVec3| (*v + DVec3::ZERO).to_array().map(f64::to_bits);
        let own: Vec<usize> = self
            .vertices
            .iter()
            .map(|v| {
                let next = places.len();
                *places.entry(bits(v)).or_insert(next)
            })
            .collect();
        let mut edges: HashMap<(usize, usize), i32> = HashMap::new();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|i| own.get(i as usize).copied());
            let (Some(a), Some(b), Some(c)) = (a, b, c) else { return false };
            // A triangle without an area has no side.
            if a == b || b == c || c == a {
                continue;
            }
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        !edges.is_empty() && edges.values().all(|balance| *balance == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tetrahedron_is_closed_and_without_a_face_it_is_not() {
        let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let closed = MeshShape { vertices: vertices.clone(), triangles: faces.clone() };
        assert!(closed.is_closed());
        // As an STL has it: three vertices of their own for each triangle.
        let loose = MeshShape {
            vertices: faces.iter().flatten().map(|&i: &u32| vertices[i as usize]).collect(),
            triangles: (0..4).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
        };
        assert!(loose.is_closed());
        let open = MeshShape { vertices: vertices.clone(), triangles: faces[..3].to_vec() };
        assert!(!open.is_closed());
        let flipped = MeshShape { vertices, triangles: [&faces[..3], &[[1, 3, 2]]].concat() };
        assert!(!flipped.is_closed());
        assert!(!MeshShape::default().is_closed());
    }
}
