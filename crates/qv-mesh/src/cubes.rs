//! Triangles of a cube for each choice of corners inside (Lorensen and Cline, *Marching cubes*, 1987), derived rather than listed.
//!
//! On each face of the cube the surface is cut along segments that go round each run of inside corners. Two cubes that share a
//! face make the same segments on it, ambiguous faces included, so that there are no gaps. Segments join up to loops, and loops are
//! cut to triangles without a diagonal that lies within a face, which the neighbour could use, too.

use std::array;

/// Corners of the faces, counter-clockwise seen from outside; bit k of a corner's number is its coordinate along axis k.
const FACES: [[u8; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Triangles of each of the 256 cases, as edges of the cube.
pub(crate) struct Cases {
    pub triangles: [Vec<[u8; 3]>; 256],
}

/// An edge of the cube by its two corners: axis times 4 plus the number among those along it.
fn edge(a: u8, b: u8) -> u8 {
    let axis = (a ^ b).trailing_zeros() as u8;
    let base = a & b;
    // The two bits of the base beside the axis.
    let (low, high) = (base & ((1 << axis) - 1), base >> (axis + 1));
    4 * axis + (low | high << axis)
}

/// Axis of an edge, and the coordinates of its lower corner.
pub(crate) fn edge_base(edge: u8) -> (usize, [usize; 3]) {
    let (axis, rest) = (edge / 4, edge % 4);
    let corner = (rest & ((1 << axis) - 1)) | (rest >> axis) << (axis + 1);
    (axis as usize, array::from_fn(|k| usize::from(corner >> k & 1)))
}

/// Whether two edges lie in one face.
fn coplanar(a: u8, b: u8) -> bool {
    FACES.iter().any(|face| {
        let has = |e: u8| (0..4).any(|k| edge(face[k], face[(k + 1) % 4]) == e);
        has(a) && has(b)
    })
}

impl Cases {
    pub fn derive() -> Self {
        Self { triangles: array::from_fn(|inside| triangles(inside as u8)) }
    }
}

fn triangles(inside: u8) -> Vec<[u8; 3]> {
    let is_in = |corner: u8| inside >> corner & 1 == 1;
    // The segment that leaves each edge, if any, by where it goes.
    let mut next: [Option<u8>; 12] = [None; 12];
    for face in FACES {
        for k in 0..4 {
            let entered = !is_in(face[k]) && is_in(face[(k + 1) % 4]);
            if !entered {
                continue;
            }
            let last = (1..4).find(|j| !is_in(face[(k + j + 1) % 4])).unwrap_or(3);
            let (from, to) = (edge(face[k], face[(k + 1) % 4]), edge(face[(k + last) % 4], face[(k + last + 1) % 4]));
            next[from as usize] = Some(to);
        }
    }
    let mut out = Vec::new();
    for start in 0..12u8 {
        let mut polygon = Vec::new();
        let mut at = start;
        while let Some(to) = next[at as usize].take() {
            polygon.push(at);
            at = to;
        }
        if polygon.len() >= 3 {
            out.extend(cut(&polygon).1);
        }
    }
    out
}

/// The triangulation with the fewest diagonals within a face, and how many these are.
fn cut(polygon: &[u8]) -> (usize, Vec<[u8; 3]>) {
    let n = polygon.len();
    if n < 3 {
        return (0, vec![]);
    }
    // The triangle on the side from the last to the first corner.
    let split = |apex: usize| {
        let cost = |a: usize, b: usize| usize::from(b - a > 1 && coplanar(polygon[a], polygon[b]));
        let (left, right) = (cut(&polygon[..=apex]), cut(&polygon[apex..]));
        let mut list = left.1;
        list.push([polygon[0], polygon[apex], polygon[n - 1]]);
        list.extend(right.1);
        (left.0 + right.0 + cost(0, apex) + cost(apex, n - 1), list)
    };
    (1..n - 1).map(split).min_by_key(|(cost, _)| *cost).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn middle(edge: u8) -> DVec3 {
        let (axis, base) = edge_base(edge);
        let mut p = DVec3::from_array(base.map(|c| c as f64));
        p[axis] = 0.5;
        p
    }

    #[test]
    fn edges_are_numbered_one_to_one() {
        let mut seen = [0; 12];
        for a in 0..8u8 {
            for axis in 0..3 {
                let b = a ^ (1 << axis);
                if a < b {
                    let e = edge(a, b);
                    seen[e as usize] += 1;
                    assert_eq!(edge_base(e), (axis, array::from_fn(|k| usize::from(a >> k & 1))));
                }
            }
        }
        assert_eq!(seen, [1; 12]);
    }

    /// Every edge that changes sides has a vertex; every side of a triangle is shared within the cube or lies in a face.
    #[test]
    fn each_case_is_a_surface_with_its_rim_in_the_faces() {
        for (inside, triangles) in Cases::derive().triangles.iter().enumerate() {
            let crossing: Vec<u8> = (0..12)
                .filter(|e| {
                    let (axis, base) = edge_base(*e);
                    let corner = base[0] | base[1] << 1 | base[2] << 2;
                    (inside >> corner & 1) != (inside >> (corner | 1 << axis) & 1)
                })
                .collect();
            let mut used: Vec<u8> = triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            assert_eq!(used, crossing, "case {inside}");
            let sides: Vec<[u8; 2]> =
                triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
            for [a, b] in &sides {
                let back = sides.iter().filter(|s| **s == [*b, *a]).count();
                let forth = sides.iter().filter(|s| **s == [*a, *b]).count();
                assert_eq!(forth, 1, "case {inside}");
                assert_eq!(back, usize::from(!coplanar(*a, *b)), "case {inside}: {a} {b}");
            }
        }
    }

    #[test]
    fn faces_look_away_from_the_inside() {
        let cases = Cases::derive();
        for corner in 0..8usize {
            let [a, b, c] = cases.triangles[1 << corner][0].map(middle);
            let out =
                DVec3::splat(0.5) - DVec3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64);
            assert!((b - a).cross(c - a).dot(out) > 0.0, "{corner}");
        }
    }
}
