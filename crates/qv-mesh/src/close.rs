//! Holes filled, and an open ground made into a solid.

use crate::clean::rim_loops;
use crate::topology::sides;
use glam::{DVec2, DVec3};
use qv_core::TriangleMesh;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};
use std::collections::HashSet;

/// How much the walls of a solid lean \[m per m of height\]: points above each other at a rim get different places on the floor.
const LEAN: DVec2 = DVec2::new(0.006, 0.008);

/// What was closed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ClosedSurface {
    /// Loops that were filled.
    pub filled: usize,
    /// Those of them that fold over themselves in every direction and got a fan about their middle instead of a triangulation.
    pub by_fan: usize,
    /// Loops that stay open.
    pub left: usize,
}

/// Fills the holes whose rim is at most `perimeter` long \[m\]: the rim is triangulated in the plane that fits it best (constrained
/// Delaunay; Chew 1989). The longest rim stays when it goes round the whole, counter-clockwise about the normals of the triangles at
/// it. New triangles carry the label of a triangle at the rim.
pub fn fill_holes(mesh: &mut TriangleMesh, perimeter: f64) -> ClosedSurface {
    let mut out = ClosedSurface::default();
    let loops = rim_loops(mesh);
    let lengths: Vec<f64> = loops.iter().map(|ring| length(mesh, ring)).collect();
    let longest = (0..loops.len()).rev().max_by(|a, b| lengths[*a].total_cmp(&lengths[*b]));
    let (normals, label_at) = (normals_at_vertices(mesh), labels_at_vertices(mesh));
    let mut edges = known_edges(mesh);
    for (index, ring) in loops.iter().enumerate() {
        let normal: DVec3 = ring.iter().map(|v| normals[*v as usize]).sum();
        let goes_round = area_vector(mesh, ring).dot(normal) > 0.0;
        if lengths[index] > perimeter || (goes_round && Some(index) == longest) {
            out.left += 1;
            continue;
        }
        out.by_fan += usize::from(!cap(mesh, ring, label_at.as_ref().map(|l| l[ring[0] as usize]), &mut edges));
        out.filled += 1;
    }
    out
}

/// Sum of the area vectors of the triangles at each vertex \[m²\].
fn normals_at_vertices(mesh: &TriangleMesh) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO; mesh.vertices.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(t);
        triangle.iter().for_each(|v| out[*v as usize] += 0.5 * (b - a).cross(c - a));
    }
    out
}

/// Closes every rim that is left: nearly upright walls down to a floor `thickness` \[m\] below the lowest point, and the floor. What comes
/// out has no open edge.
pub fn close_to_solid(mesh: &mut TriangleMesh, thickness: f64) -> ClosedSurface {
    let mut out = ClosedSurface::default();
    let floor = mesh.vertices.iter().map(|v| v.z).fold(f64::INFINITY, f64::min) - thickness;
    let loops = rim_loops(mesh);
    let label_at = labels_at_vertices(mesh);
    let mut edges = known_edges(mesh);
    for ring in &loops {
        let first = mesh.vertices.len() as u32;
        let below = |p: DVec3| (p.truncate() + LEAN * (p.z - floor)).extend(floor);
        let below: Vec<DVec3> = ring.iter().map(|v| below(mesh.vertices[*v as usize])).collect();
        mesh.vertices.extend(below);
        let n = ring.len() as u32;
        for k in 0..n {
            let (a, b) = (ring[k as usize], ring[((k + 1) % n) as usize]);
            let (below_a, below_b) = (first + k, first + (k + 1) % n);
            mesh.triangles.push([b, a, below_a]);
            mesh.triangles.push([b, below_a, below_b]);
            if let Some(label_at) = &label_at {
                mesh.labels.extend([label_at[a as usize]; 2]);
            }
        }
        let floor_ring: Vec<u32> = (first..first + n).collect();
        out.by_fan += usize::from(!cap(mesh, &floor_ring, label_at.as_ref().map(|l| l[ring[0] as usize]), &mut edges));
        out.filled += 1;
    }
    out
}

/// Label of a triangle at each vertex; none for a mesh without labels.
fn labels_at_vertices(mesh: &TriangleMesh) -> Option<Vec<u16>> {
    if mesh.labels.is_empty() {
        return None;
    }
    let mut out = vec![0; mesh.vertices.len()];
    for (triangle, label) in mesh.triangles.iter().zip(&mesh.labels) {
        triangle.iter().for_each(|v| out[*v as usize] = *label);
    }
    Some(out)
}

fn known_edges(mesh: &TriangleMesh) -> HashSet<[u32; 2]> {
    sides(mesh).into_iter().map(|side| side.ends).collect()
}

fn length(mesh: &TriangleMesh, ring: &[u32]) -> f64 {
    let at = |k: usize| mesh.vertices[ring[k % ring.len()] as usize];
    (0..ring.len()).map(|k| at(k).distance(at(k + 1))).sum()
}

/// Area of a loop as a vector along its normal (Newell), the loop counter-clockwise about it \[m²\].
fn area_vector(mesh: &TriangleMesh, ring: &[u32]) -> DVec3 {
    let at = |k: usize| mesh.vertices[ring[k % ring.len()] as usize];
    let origin = at(0);
    (0..ring.len()).map(|k| 0.5 * (at(k) - origin).cross(at(k + 1) - origin)).sum()
}

/// Closes a loop with triangles of a label. False when it took a fan about the middle.
fn cap(mesh: &mut TriangleMesh, ring: &[u32], label: Option<u16>, edges: &mut HashSet<[u32; 2]>) -> bool {
    // Triangles of the cap have the loop's sides the other way round.
    let polygon: Vec<u32> = ring.iter().rev().copied().collect();
    let flat = triangulate(mesh, &polygon).filter(|triangles| {
        // A diagonal that is an edge already would get four triangles.
        let n = polygon.len();
        let on_rim = |a: usize, b: usize| (a + 1) % n == b || (b + 1) % n == a;
        let free = |a: usize, b: usize| on_rim(a, b) || !edges.contains(&ends(polygon[a], polygon[b]));
        triangles.iter().all(|[a, b, c]| free(*a, *b) && free(*b, *c) && free(*c, *a))
    });
    let found = flat.is_some();
    let triangles: Vec<[u32; 3]> = match flat {
        Some(triangles) => triangles.into_iter().map(|t| t.map(|k| polygon[k])).collect(),
        None => {
            let middle = polygon.iter().map(|v| mesh.vertices[*v as usize]).sum::<DVec3>() / polygon.len() as f64;
            let centre = mesh.vertices.len() as u32;
            mesh.vertices.push(middle);
            (0..polygon.len()).map(|k| [polygon[k], polygon[(k + 1) % polygon.len()], centre]).collect()
        }
    };
    for t in &triangles {
        edges.extend([ends(t[0], t[1]), ends(t[1], t[2]), ends(t[2], t[0])]);
        mesh.labels.extend(label);
    }
    mesh.triangles.extend(triangles);
    found
}

fn ends(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Triangles of a loop, as places in it, in the plane that fits it; none when it crosses itself there.
fn triangulate(mesh: &TriangleMesh, polygon: &[u32]) -> Option<Vec<[usize; 3]>> {
    let normal = area_vector(mesh, polygon).try_normalize()?;
    let (x, y) = normal.any_orthonormal_pair();
    let flat: Vec<DVec2> = polygon
        .iter()
        .map(|v| {
            let p = mesh.vertices[*v as usize] - mesh.vertices[polygon[0] as usize];
            DVec2::new(p.dot(x), p.dot(y))
        })
        .collect();
    let n = flat.len();
    let mut plane = ConstrainedDelaunayTriangulation::<Point2<f64>>::with_capacity(n, 3 * n, 2 * n);
    let mut handles = Vec::with_capacity(n);
    for p in &flat {
        handles.push(plane.insert(Point2::new(p.x, p.y)).ok()?);
    }
    if plane.num_vertices() != n {
        return None;
    }
    for k in 0..n {
        let (a, b) = (handles[k], handles[(k + 1) % n]);
        if !plane.can_add_constraint(a, b) {
            return None;
        }
        plane.add_constraint(a, b);
    }
    // A side that runs through a corner of the loop was split in two, so that a triangle's side would not be the loop's.
    if plane.num_constraints() != n {
        return None;
    }
    let mut out = Vec::new();
    for face in plane.inner_faces() {
        let corners = face.vertices().map(|v| v.fix().index());
        let middle = corners.iter().map(|k| flat[*k]).sum::<DVec2>() / 3.0;
        if holds(&flat, middle) {
            out.push(corners);
        }
    }
    // n corners always give n - 2 triangles.
    (out.len() == n - 2).then_some(out)
}

/// Whether a point lies in a polygon: how often a ray along x leaves it.
fn holds(polygon: &[DVec2], p: DVec2) -> bool {
    let n = polygon.len();
    let crosses = |k: usize| {
        let (a, b) = (polygon[k], polygon[(k + 1) % n]);
        (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
    };
    (0..n).filter(|k| crosses(*k)).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::Topology;

    /// A square sheet of n x n cells of 0.1 m on a bumpy ground, without the cells for which `gone` is true.
    fn sheet(n: usize, gone: impl Fn(usize, usize) -> bool) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for j in 0..=n {
            for i in 0..=n {
                let (x, y) = (0.1 * i as f64, 0.1 * j as f64);
                mesh.vertices.push(DVec3::new(x, y, 0.05 * (9.0 * x).sin() * (7.0 * y).cos()));
            }
        }
        let v = |i: usize, j: usize| (j * (n + 1) + i) as u32;
        for j in 0..n {
            for i in 0..n {
                if !gone(i, j) {
                    mesh.triangles.push([v(i, j), v(i + 1, j), v(i + 1, j + 1)]);
                    mesh.triangles.push([v(i, j), v(i + 1, j + 1), v(i, j + 1)]);
                }
            }
        }
        crate::clean::drop_unused(&mut mesh);
        crate::clean::split_fans(&mut mesh);
        mesh
    }

    #[test]
    fn small_holes_are_filled_and_large_ones_are_not() {
        let small = |i: usize, j: usize| (3..5).contains(&i) && (3..6).contains(&j);
        let large = |i: usize, j: usize| (10..18).contains(&i) && (10..18).contains(&j);
        let mut mesh = sheet(20, |i, j| small(i, j) || large(i, j));
        let before = Topology::of(&mesh);
        let found = fill_holes(&mut mesh, 2.0);
        assert_eq!(found, ClosedSurface { filled: 1, by_fan: 0, left: 2 });
        let after = Topology::of(&mesh);
        assert_eq!((before.open_edges - after.open_edges, after.crowded_edges, after.twisted_edges), (10, 0, 0));
        assert!((after.area - before.area - 0.06).abs() < 0.01, "{} {}", before.area, after.area);
    }

    #[test]
    fn an_open_ground_becomes_a_solid() {
        let mut mesh = sheet(12, |i, j| i + j < 3 || (i == 6 && j == 6));
        mesh.labels = (0..mesh.triangles.len()).map(|t| (t % 2) as u16).collect();
        mesh.materials = vec![qv_core::Material { name: "a".into(), friction: None }; 2];
        let filled = fill_holes(&mut mesh, 1.0);
        assert_eq!((filled.filled, filled.left), (1, 1));
        let closed = close_to_solid(&mut mesh, 0.2);
        mesh.validate().unwrap();
        let found = Topology::of(&mesh);
        assert!(found.is_watertight() && found.pinched_vertices == 0, "{found:?} {closed:?}");
        assert_eq!((found.euler, found.components), (2, 1));
        let lowest = mesh.vertices.iter().map(|v| v.z).fold(f64::INFINITY, f64::min);
        let expected = (1.44 - 0.06) * (-lowest);
        assert!((found.volume - expected).abs() < 0.05, "{} {expected}", found.volume);
    }

    #[test]
    fn a_loop_that_crosses_itself_is_closed_by_a_fan() {
        // A rim like an eight: no plane shows it without a crossing.
        let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let mut mesh =
            TriangleMesh { vertices: vec![p(0.0, 0.0), p(2.0, 1.0), p(2.0, 0.0), p(0.0, 1.1)], ..Default::default() };
        let ring = [0, 1, 2, 3];
        for k in 0..4u32 {
            mesh.vertices.push(mesh.vertices[k as usize] - DVec3::Z);
        }
        for k in 0..4u32 {
            let n = (k + 1) % 4;
            mesh.triangles.extend([[ring[k as usize], ring[n as usize], 4 + n], [ring[k as usize], 4 + n, 4 + k]]);
        }
        let found = fill_holes(&mut mesh, 100.0);
        assert!(found.by_fan >= 1, "{found:?}");
        assert_eq!((Topology::of(&mesh).crowded_edges, Topology::of(&mesh).twisted_edges), (0, 0));
    }
}
