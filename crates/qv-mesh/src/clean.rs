//! What marching cubes leave, made into one surface whose every vertex has one fan of triangles.

use crate::topology::{Groups, is_shared, join_fans, sides};
use glam::DVec3;
use qv_core::TriangleMesh;
use rayon::prelude::*;

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

/// How far fans that met in one vertex are drawn apart, as a share of the way to the middle of each.
const APART: f64 = 0.02;

/// Gives each fan of triangles round a vertex a vertex of its own, and cuts edges that are not shared by two triangles which agree
/// about what is outside. Afterwards the rim consists of simple loops. Fans that met are drawn apart a little, so that who joins
/// vertices by their place does not put them together again.
pub fn split_fans(mesh: &mut TriangleMesh) {
    let sides = sides(mesh);
    let mut fans = Groups::new(3 * mesh.triangles.len());
    for edge in sides.chunk_by(|a, b| a.ends == b.ends).filter(|edge| is_shared(edge)) {
        join_fans(&mut fans, edge, mesh);
    }
    let mut place = vec![u32::MAX; 3 * mesh.triangles.len()];
    let mut fans_of = vec![0u8; mesh.vertices.len()];
    // The vertex that each new one was.
    let mut origin: Vec<u32> = Vec::with_capacity(mesh.vertices.len());
    for (corner, vertex) in mesh.triangles.iter_mut().flatten().enumerate() {
        let fan = fans.find(corner as u32) as usize;
        if place[fan] == u32::MAX {
            place[fan] = origin.len() as u32;
            origin.push(*vertex);
            fans_of[*vertex as usize] = fans_of[*vertex as usize].saturating_add(1);
        }
        *vertex = place[fan];
    }
    let before = std::mem::take(&mut mesh.vertices);
    mesh.vertices = origin.iter().map(|v| before[*v as usize]).collect();
    let mut middles = vec![(DVec3::ZERO, 0.0); origin.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for vertex in triangle.iter().filter(|v| fans_of[origin[**v as usize] as usize] > 1) {
            let middle = &mut middles[*vertex as usize];
            middle.0 += mesh.corners(t).iter().sum::<DVec3>() / 3.0;
            middle.1 += 1.0;
        }
    }
    for (vertex, (sum, count)) in mesh.vertices.iter_mut().zip(middles).filter(|(_, middle)| middle.1 > 0.0) {
        *vertex += APART * (sum / count - *vertex);
    }
}

/// Pieces that were left out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DroppedPieces {
    /// How many.
    pub count: usize,
    /// Area of the largest of them \[m²\]: a table whose legs were not seen is a piece of its own.
    pub largest: f64,
}

/// Keeps the piece with the largest area, and with `least` all others of at least that area \[m²\], too. Returns what was dropped.
pub fn keep_largest(mesh: &mut TriangleMesh, least: Option<f64>) -> DroppedPieces {
    let mut pieces = Groups::new(mesh.vertices.len());
    for [a, b, c] in &mesh.triangles {
        pieces.join(*a, *b);
        pieces.join(*b, *c);
    }
    let piece: Vec<u32> = mesh.triangles.iter().map(|t| pieces.find(t[0])).collect();
    let mut area = vec![0.0f64; mesh.vertices.len()];
    for (t, piece) in piece.iter().enumerate() {
        let [a, b, c] = mesh.corners(t);
        area[*piece as usize] += 0.5 * (b - a).cross(c - a).length();
    }
    let mut found = piece.clone();
    found.sort_unstable();
    found.dedup();
    // The first of equals.
    let largest = found.iter().rev().copied().max_by(|a, b| area[*a as usize].total_cmp(&area[*b as usize]));
    let Some(largest) = largest else { return DroppedPieces::default() };
    let is_kept = |piece: u32| piece == largest || least.is_some_and(|least| area[piece as usize] >= least);
    let mut dropped = DroppedPieces::default();
    for piece in found.iter().filter(|piece| !is_kept(**piece)) {
        dropped.count += 1;
        dropped.largest = dropped.largest.max(area[*piece as usize]);
    }
    keep_triangles(mesh, |t| is_kept(piece[t]));
    dropped
}

/// Smooths noise of a few edges' length away and keeps what is larger, without shrinking: each round moves vertices towards the
/// mean of their neighbours and then back a little further (Taubin, *A signal processing approach to fair surface design*, 1995).
/// Vertices at the rim stay.
pub fn smooth(mesh: &mut TriangleMesh, rounds: usize) {
    /// Steps there and back; together they leave what is wider than about ten edges as it is.
    const STEPS: [f64; 2] = [0.5, -0.53];
    let sides = sides(mesh);
    let mut fixed = vec![false; mesh.vertices.len()];
    let mut pairs: Vec<[u32; 2]> = Vec::with_capacity(sides.len());
    for edge in sides.chunk_by(|a, b| a.ends == b.ends) {
        let [a, b] = edge[0].ends;
        pairs.extend([[a, b], [b, a]]);
        if edge.len() != 2 {
            fixed[a as usize] = true;
            fixed[b as usize] = true;
        }
    }
    pairs.par_sort_unstable();
    let around: Vec<&[[u32; 2]]> = pairs.chunk_by(|a, b| a[0] == b[0]).collect();
    for step in (0..rounds).flat_map(|_| STEPS) {
        let moves: Vec<DVec3> = around
            .par_iter()
            .map(|pairs| {
                let own = mesh.vertices[pairs[0][0] as usize];
                let mean = pairs.iter().map(|pair| mesh.vertices[pair[1] as usize]).sum::<DVec3>() / pairs.len() as f64;
                step * (mean - own)
            })
            .collect();
        for (pairs, moved) in around.iter().zip(moves) {
            let v = pairs[0][0] as usize;
            if !fixed[v] {
                mesh.vertices[v] += moved;
            }
        }
    }
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

    fn area(mesh: &TriangleMesh, t: usize) -> f64 {
        let [a, b, c] = mesh.corners(t);
        0.5 * (b - a).cross(c - a).length()
    }

    #[test]
    fn fans_are_split_and_the_largest_piece_stays() {
        let mut mesh = bow_tie();
        assert_eq!(Topology::of(&mesh).pinched_vertices, 1);
        split_fans(&mut mesh);
        assert_eq!((Topology::of(&mesh).pinched_vertices, mesh.vertices.len()), (0, 10));
        let near = mesh.vertices.iter().filter(|v| v.length() < 0.1).count();
        assert!(near == 2 && !mesh.vertices.contains(&DVec3::ZERO), "two at the knot, apart");
        let mut all = mesh.clone();
        assert_eq!((keep_largest(&mut all, Some(0.0)).count, all.triangles.len()), (0, mesh.triangles.len()));
        let small = (2..4).map(|t| area(&mesh, t)).fold(0.0, f64::max);
        let dropped = keep_largest(&mut all, Some(1e3));
        assert_eq!((dropped.count, all.triangles.len()), (2, 2), "the largest stays however small");
        assert!((dropped.largest - small).abs() < 1e-12, "{dropped:?}, {small}");
        assert_eq!(keep_largest(&mut mesh, None), dropped);
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
        assert!((area - 1.0).abs() < 0.03, "{area}");
    }

    #[test]
    fn smoothing_takes_noise_and_leaves_the_form() {
        let form = |x: f64, y: f64| 0.2 * (2.0 * x).sin() * (1.5 * y).cos();
        let mut mesh = TriangleMesh::default();
        for i in 0..2500u32 {
            let (x, y) = (f64::from(i % 50) * 0.04, f64::from(i / 50) * 0.04);
            let noise = 0.02 * (f64::from(i.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24) - 0.5);
            mesh.vertices.push(DVec3::new(x, y, form(x, y) + noise));
        }
        for i in (0..2450u32).filter(|i| i % 50 < 49) {
            mesh.triangles.extend([[i, i + 1, i + 51], [i, i + 51, i + 50]]);
        }
        let inner = |v: &&DVec3| v.x > 0.1 && v.x < 1.86 && v.y > 0.1 && v.y < 1.86;
        let rms = |mesh: &TriangleMesh| {
            let errors: Vec<f64> = mesh.vertices.iter().filter(inner).map(|v| (v.z - form(v.x, v.y)).powi(2)).collect();
            (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
        };
        let before = rms(&mesh);
        smooth(&mut mesh, 5);
        assert!(rms(&mesh) < 0.45 * before, "{} {before}", rms(&mesh));
    }

    #[test]
    fn nothing_comes_of_nothing() {
        let mut mesh = TriangleMesh::default();
        split_fans(&mut mesh);
        assert_eq!((keep_largest(&mut mesh, None).count, rim_loops(&mesh).len()), (0, 0));
        assert!(!Topology::of(&mesh).is_watertight());
    }
}
