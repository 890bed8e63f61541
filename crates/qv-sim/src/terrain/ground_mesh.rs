//! A triangle mesh as ground: a tree finds the triangles in a box, a grid reports most boxes that there are none.

use super::roof::Roof;
use super::triangle::{SurfaceContact, Triangle, bounds};
use glam::DVec3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use qv_core::TriangleMesh;

/// Cells that a triangle lies above, on average: 4 where all are alike.
const MOST_COVERED: usize = 64;

#[derive(Debug)]
pub(super) struct GroundMesh {
    mesh: TriangleMesh,
    bvh: Bvh,
    roof: Roof,
    /// Least x and y of the roof's cells, one over a cell's edge, and how many there are along x and y.
    low: [f64; 2],
    inverse: f64,
    cells: [usize; 2],
}

impl GroundMesh {
    /// Triangles must have an area, and there must be one.
    pub fn new(mesh: TriangleMesh) -> Self {
        let boxes: Vec<Aabb> = (0..mesh.triangles.len()).map(|t| bounds(&mesh.corners(t))).collect();
        let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let (low, high) = boxes
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), b| (low.min(b.mins), high.max(b.maxs)));
        // About as many cells as triangles, seen from above; a wall has no area there.
        let size = (high - low).truncate();
        let edge = (size.x * size.y / boxes.len() as f64).sqrt().max(size.max_element() / boxes.len() as f64);
        let mut ground = Self {
            mesh,
            bvh,
            roof: Roof::new(1, 1, vec![high.z]),
            low: low.truncate().to_array(),
            inverse: 1.0,
            cells: [1, 1],
        };
        ground.divide(size.to_array(), edge);
        // Where large triangles lie above each other in numbers, cells are larger, too.
        let mut coarser = edge;
        while ground.covered(&boxes) > MOST_COVERED * boxes.len() && ground.cells != [1, 1] {
            coarser *= 2.0;
            ground.divide(size.to_array(), coarser);
        }
        let [columns, rows] = ground.cells;
        let mut highest = vec![f64::NEG_INFINITY; columns * rows];
        for b in &boxes {
            let [[i0, i1], [j0, j1]] = [ground.range(0, b.mins.x, b.maxs.x), ground.range(1, b.mins.y, b.maxs.y)];
            for (j, i) in (j0..=j1).flat_map(|j| (i0..=i1).map(move |i| (j, i))) {
                let cell = &mut highest[j * columns + i];
                *cell = cell.max(b.maxs.z);
            }
        }
        ground.roof = Roof::new(columns, rows, highest);
        ground
    }

    /// Cells of this edge \[m\] over an area.
    fn divide(&mut self, [x, y]: [f64; 2], edge: f64) {
        self.inverse = 1.0 / edge;
        self.cells = [x, y].map(|length| (length * self.inverse).floor() as usize + 1);
    }

    /// How many cells boxes lie above, each counted anew.
    fn covered(&self, boxes: &[Aabb]) -> usize {
        let cells = |b: &Aabb| {
            let [[i0, i1], [j0, j1]] = [self.range(0, b.mins.x, b.maxs.x), self.range(1, b.mins.y, b.maxs.y)];
            (i1 - i0 + 1) * (j1 - j0 + 1)
        };
        boxes.iter().map(cells).fold(0, usize::saturating_add)
    }

    /// First and last cell of an interval along an axis. What lies outside counts with the outermost cells, and a greater
    /// number never gets an earlier cell: boxes that overlap share one.
    #[inline(always)]
    fn range(&self, axis: usize, low: f64, high: f64) -> [usize; 2] {
        let last = (self.cells[axis] - 1) as f64;
        let cell = |x: f64| ((x - self.low[axis]) * self.inverse).floor().clamp(0.0, last) as usize;
        [cell(low), cell(high)]
    }

    /// The greatest height \[m\].
    pub fn top(&self) -> f64 {
        self.roof.top()
    }

    pub fn triangle_count(&self) -> usize {
        self.mesh.triangles.len()
    }

    pub fn triangles_in(&self, low: DVec3, high: DVec3, out: &mut Vec<Triangle>) {
        if self.roof.bound(self.range(0, low.x, high.x), self.range(1, low.y, high.y)) < low.z {
            return;
        }
        out.extend(self.bvh.intersect_aabb(&Aabb::new(low, high)).map(|t| Triangle {
            index: t,
            corners: self.mesh.corners(t as usize),
            material: self.mesh.labels.get(t as usize).copied(),
        }));
        if out.len() > 1 {
            out.sort_unstable_by_key(|t| t.index);
        }
    }

    /// Contacts of a ball with all triangles that its bounds touch, in increasing order of index.
    pub fn ball_contacts(
        &self,
        centre: DVec3,
        radius: f64,
        reach: f64,
        triangles: &mut Vec<Triangle>,
        out: &mut Vec<SurfaceContact>,
    ) {
        triangles.clear();
        self.triangles_in(centre - DVec3::splat(reach), centre + DVec3::splat(reach), triangles);
        out.extend(triangles.iter().filter_map(|triangle| triangle.sphere_contact(centre, radius)));
    }
}
