//! The surface of a signed distance.

use crate::cubes::{Cases, edge_base};
use crate::volume::{BlockKey, SIDE, VOXELS, Volume, Voxel};
use glam::DVec3;
use qv_core::TriangleMesh;
use rayon::prelude::*;

/// Samples along a side of a block with the first layer of its neighbours.
const WIDE: usize = SIDE + 1;
/// Vertices keep this share of an edge from its ends, so that no triangle is without area.
const MARGIN: f64 = 0.02;
/// Bits of a block's edges: three for each voxel.
const WORDS: usize = 3 * VOXELS / 64;

/// Which edges of a block have a vertex, and where these are.
struct Crossings {
    bits: [u64; WORDS],
    /// Vertices before each word.
    before: [u32; WORDS],
    vertices: Vec<DVec3>,
}

impl Crossings {
    /// Number of the vertex on an edge, among those of the block.
    fn vertex(&self, edge: usize) -> u32 {
        let (word, bit) = (edge / 64, edge % 64);
        self.before[word] + (self.bits[word] & ((1u64 << bit) - 1)).count_ones()
    }
}

/// Values at the block's voxels and the first ones of its neighbours along x, y, z; NaN where nothing was seen.
type Samples = [f32; WIDE * WIDE * WIDE];

/// The zero surface of a volume by marching cubes, normals towards the cameras. Only cubes whose corners were all seen count, so
/// that what nobody saw stays open. Vertices are shared, also between blocks, in an order that depends on nothing but the volume.
pub fn extract(volume: &Volume) -> TriangleMesh {
    let mut order: Vec<u32> = (0..volume.keys.len() as u32).collect();
    order.par_sort_unstable_by_key(|block| volume.keys[*block as usize]);
    let around: Vec<[Option<u32>; 8]> = order.par_iter().map(|block| neighbours(volume, *block)).collect();
    let crossings: Vec<Crossings> = around.par_iter().map(|around| crossings(volume, around)).collect();
    let mut first = Vec::with_capacity(order.len());
    let mut total = 0u32;
    for block in &crossings {
        first.push(total);
        total += block.vertices.len() as u32;
    }
    // Where a block of the volume is in this order.
    let mut place = vec![0u32; order.len()];
    order.iter().enumerate().for_each(|(at, block)| place[*block as usize] = at as u32);
    let cases = Cases::derive();
    let vertex = |around: &[Option<u32>; 8], voxel: [usize; 3], axis: usize| {
        let neighbour = (0..3).fold(0, |n, k| n | (voxel[k] / SIDE) << k);
        let block = place[around[neighbour].unwrap_or(0) as usize] as usize;
        let local = (voxel[2] % SIDE * SIDE + voxel[1] % SIDE) * SIDE + voxel[0] % SIDE;
        first[block] + crossings[block].vertex(3 * local + axis)
    };
    let triangles: Vec<Vec<[u32; 3]>> = around
        .par_iter()
        .map(|around| {
            let samples = samples(volume, around);
            let mut out = Vec::new();
            for i in 0..VOXELS {
                let at = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)];
                let Some(inside) = case(&samples, at) else { continue };
                for triangle in &cases.triangles[inside] {
                    out.push(triangle.map(|edge| {
                        let (axis, base) = edge_base(edge);
                        vertex(around, [at[0] + base[0], at[1] + base[1], at[2] + base[2]], axis)
                    }));
                }
            }
            out
        })
        .collect();
    let vertices = crossings.into_iter().flat_map(|block| block.vertices).collect();
    let mut mesh = TriangleMesh { vertices, triangles: triangles.concat(), ..Default::default() };
    crate::clean::drop_unused(&mut mesh);
    mesh
}

/// The block itself and its neighbours towards larger coordinates; bit k of the place says along axis k.
fn neighbours(volume: &Volume, block: u32) -> [Option<u32>; 8] {
    let at = volume.keys[block as usize].coordinates();
    std::array::from_fn(|n| {
        let key = BlockKey::of([0, 1, 2].map(|k| at[k] + (n >> k & 1) as i64))?;
        volume.index.get(&key).copied()
    })
}

fn samples(volume: &Volume, around: &[Option<u32>; 8]) -> Samples {
    let least = volume.least_weight();
    let value = |v: &Voxel| if v.weight >= least { f32::from(v.distance) } else { f32::NAN };
    std::array::from_fn(|i| {
        let at = [i % WIDE, i / WIDE % WIDE, i / (WIDE * WIDE)];
        let neighbour = (0..3).fold(0, |n, k| n | (at[k] / SIDE) << k);
        let local = (at[2] % SIDE * SIDE + at[1] % SIDE) * SIDE + at[0] % SIDE;
        around[neighbour].map_or(f32::NAN, |block| value(&volume.blocks[block as usize][local]))
    })
}

fn sample(samples: &Samples, [x, y, z]: [usize; 3]) -> f32 {
    samples[(z * WIDE + y) * WIDE + x]
}

/// Which corners of a cube are inside; none when a corner was not seen or no surface passes.
fn case(samples: &Samples, [x, y, z]: [usize; 3]) -> Option<usize> {
    let mut inside = 0;
    for corner in 0..8 {
        let value = sample(samples, [x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)]);
        if value.is_nan() {
            return None;
        }
        inside |= usize::from(value < 0.0) << corner;
    }
    (inside != 0 && inside != 255).then_some(inside)
}

fn crossings(volume: &Volume, around: &[Option<u32>; 8]) -> Crossings {
    let samples = samples(volume, around);
    let block = volume.keys[around[0].unwrap_or(0) as usize].coordinates();
    let mut out = Crossings { bits: [0; WORDS], before: [0; WORDS], vertices: vec![] };
    for edge in 0..3 * VOXELS {
        if edge % 64 == 0 {
            out.before[edge / 64] = out.vertices.len() as u32;
        }
        let (i, axis) = (edge / 3, edge % 3);
        let at = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)];
        let mut end = at;
        end[axis] += 1;
        let (a, b) = (f64::from(sample(&samples, at)), f64::from(sample(&samples, end)));
        // Written so that NaN makes no vertex.
        if !((a < 0.0 && b >= 0.0) || (a >= 0.0 && b < 0.0)) {
            continue;
        }
        let mut p = DVec3::from_array(std::array::from_fn(|k| (block[k] * SIDE as i64 + at[k] as i64) as f64));
        p[axis] += (a / (a - b)).clamp(MARGIN, 1.0 - MARGIN);
        out.vertices.push(p * volume.voxel());
        out.bits[edge / 64] |= 1 << (edge % 64);
    }
    out
}
