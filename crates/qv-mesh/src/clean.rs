//! What marching cubes leave, made into one surface whose every vertex has one fan of triangles.

use crate::topology::{Groups, is_shared, join_fans, sides};
use glam::DVec3;
use qv_core::TriangleMesh;

/// Drops vertices that no triangle uses; the order stays.
pub(crate) fn drop_unused(mesh: &mut TriangleMesh) {
    let mut place = vec![u32::MAX; mesh.vertices.len()];
    mesh.triangles.iter().flatten().for_each(|v| place[*v as usize] = 0);
    let mut kept = 0u32;
    let mut at = 0;
    mesh.vertices.retain(|_| {
        let used = place[at] == 0;
        if used {
            place[at] = kept;
            kept += 1;
        }
        at += 1;
        used
    });
    mesh.triangles.iter_mut().flatten().for_each(|v| *v = place[*v as usize]);
}

/// Keeps triangles for which `keep` is true, with their labels.
pub(crate) fn keep_triangles(mesh: &mut TriangleMesh, keep: impl Fn(usize) -> bool) {
    let filter = |len: usize| (0..len).filter(|t| keep(*t));
    mesh.labels = filter(mesh.labels.len()).map(|t| mesh.labels[t]).collect();
    mesh.triangles = filter(mesh.triangles.len()).map(|t| mesh.triangles[t]).collect();
    drop_unused(mesh);
}

/// Gives each fan of triangles round a vertex a vertex of its own, and cuts edges that are not shared by two triangles which agree
/// about what is outside. Afterwards the rim consists of simple loops.
pub fn split_fans(mesh: &mut TriangleMesh) {
    let sides = sides(mesh);
    let mut fans = Groups::new(3 * mesh.triangles.len());
    for edge in sides.chunk_by(|a, b| a.ends == b.ends).filter(|edge| is_shared(edge)) {
        join_fans(&mut fans, edge, mesh);
    }
    let mut place = vec![u32::MAX; 3 * mesh.triangles.len()];
    let mut vertices: Vec<DVec3> = Vec::with_capacity(mesh.vertices.len());
    for (corner, vertex) in mesh.triangles.iter_mut().flatten().enumerate() {
        let fan = fans.find(corner as u32) as usize;
        if place[fan] == u32::MAX {
            place[fan] = vertices.len() as u32;
            vertices.push(mesh.vertices[*vertex as usize]);
        }
        *vertex = place[fan];
    }
    mesh.vertices = vertices;
}

/// Keeps the piece with the largest area. Returns how many others there were.
pub fn keep_largest(mesh: &mut TriangleMesh) -> usize {
    let mut pieces = Groups::new(mesh.vertices.len());
    for [a, b, c] in &mesh.triangles {
        pieces.join(*a, *b);
        pieces.join(*b, *c);
    }
    let piece: Vec<u32> = mesh.triangles.iter().map(|t| pieces.find(t[0])).collect();
    let mut area = vec![0.0f64; mesh.vertices.len()];
    for (t, piece) in piece.iter().enumerate() {
        let [a, b, c] = mesh.corners(t);
        area[*piece as usize] += (b - a).cross(c - a).length();
    }
    let mut found = piece.clone();
    found.sort_unstable();
    found.dedup();
    // The first of equals.
    let largest = found.iter().rev().copied().max_by(|a, b| area[*a as usize].total_cmp(&area[*b as usize]));
    let Some(largest) = largest else { return 0 };
    keep_triangles(mesh, |t| piece[t] == largest);
    found.len() - 1
}

/// The rim as closed loops of vertices, each in the direction of the triangles' own sides: a rim round the whole goes
/// counter-clockwise seen from outside, one round a hole clockwise.
pub fn rim_loops(mesh: &TriangleMesh) -> Vec<Vec<u32>> {
    let sides = sides(mesh);
    let mut next = vec![u32::MAX; mesh.vertices.len()];
    for edge in sides.chunk_by(|a, b| a.ends == b.ends).filter(|edge| edge.len() == 1) {
        let [low, high] = edge[0].ends;
        let (from, to) = if edge[0].forward { (low, high) } else { (high, low) };
        next[from as usize] = to;
    }
    let mut out = Vec::new();
    for start in 0..next.len() as u32 {
        let mut ring = Vec::new();
        let mut at = start;
        while next[at as usize] != u32::MAX {
            ring.push(at);
            at = std::mem::replace(&mut next[at as usize], u32::MAX);
        }
        if ring.len() >= 3 && at == start {
            out.push(ring);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::Topology;

    /// Two pairs of triangles that touch in one vertex, and a lone one.
    fn bow_tie() -> TriangleMesh {
        let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        TriangleMesh {
            vertices: vec![
                p(0.0, 0.0),
                p(1.0, 0.0),
                p(1.0, 1.0),
                p(0.0, 1.0),
                p(-1.0, 0.0),
                p(-1.0, -1.0),
                p(5.0, 5.0),
                p(6.0, 5.0),
                p(5.0, 6.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 4, 5], [6, 7, 8]],
            labels: vec![0, 1, 2, 3],
            materials: (0..4).map(|i| qv_core::Material { name: i.to_string(), friction: None }).collect(),
        }
    }

    #[test]
    fn fans_are_split_and_the_largest_piece_stays() {
        let mut mesh = bow_tie();
        assert_eq!(Topology::of(&mesh).pinched_vertices, 1);
        split_fans(&mut mesh);
        assert_eq!((Topology::of(&mesh).pinched_vertices, mesh.vertices.len()), (0, 10));
        assert_eq!(keep_largest(&mut mesh), 2);
        mesh.validate().unwrap();
        assert_eq!((mesh.triangles.len(), mesh.vertices.len(), mesh.labels.as_slice()), (2, 4, &[0, 1][..]));
        let loops = rim_loops(&mesh);
        assert_eq!(loops.len(), 1);
        let area: f64 = (0..4)
            .map(|k| {
                let (a, b) = (mesh.vertices[loops[0][k] as usize], mesh.vertices[loops[0][(k + 1) % 4] as usize]);
                0.5 * a.cross(b).z
            })
            .sum();
        assert!((area - 1.0).abs() < 1e-12, "{area}");
    }

    #[test]
    fn nothing_comes_of_nothing() {
        let mut mesh = TriangleMesh::default();
        split_fans(&mut mesh);
        assert_eq!((keep_largest(&mut mesh), rim_loops(&mesh).len()), (0, 0));
        assert!(!Topology::of(&mesh).is_watertight());
    }
}
