//! A regular grid of heights: the triangles under a box are found without a search.

use super::roof::Roof;
use super::triangle::{SurfaceContact, Triangle};
use crate::SimError;
use glam::DVec3;

#[derive(Debug)]
pub(super) struct HeightField {
    origin: [f64; 2],
    spacing: [f64; 2],
    columns: usize,
    rows: usize,
    heights: Vec<f64>,
    roof: Roof,
    /// Length of a cell's diagonal, seen from above \[m\].
    diagonal: f64,
}

impl HeightField {
    pub fn new(
        origin: [f64; 2],
        spacing: [f64; 2],
        columns: usize,
        rows: usize,
        heights: Vec<f64>,
    ) -> Result<Self, SimError> {
        let error = |expected: &str, found: String| SimError::Terrain { expected: expected.into(), found };
        if columns < 2 || rows < 2 || columns.checked_mul(rows) != Some(heights.len()) {
            return Err(error(
                "at least 2 x 2 heights, columns * rows of them",
                format!("{} heights for {columns} x {rows}", heights.len()),
            ));
        }
        if !spacing.iter().all(|d| d.is_finite() && *d > 0.0) || !origin.iter().all(|o| o.is_finite()) {
            return Err(error("a positive spacing and a finite origin", format!("{spacing:?} at {origin:?}")));
        }
        if let Some(i) = heights.iter().position(|h| !h.is_finite()) {
            return Err(error("finite heights", format!("{} at index {i}", heights[i])));
        }
        let cell = |k: usize| {
            let at = k / (columns - 1) * columns + k % (columns - 1);
            heights[at].max(heights[at + 1]).max(heights[at + columns]).max(heights[at + columns + 1])
        };
        let roof = Roof::new(columns - 1, rows - 1, (0..(columns - 1) * (rows - 1)).map(cell).collect());
        let diagonal = spacing[0].hypot(spacing[1]);
        Ok(Self { origin, spacing, columns, rows, heights, roof, diagonal })
    }

    /// The greatest height \[m\].
    pub fn top(&self) -> f64 {
        self.roof.top()
    }

    pub fn triangle_count(&self) -> usize {
        2 * (self.columns - 1) * (self.rows - 1)
    }

    /// Columns and rows of the cells under a box that is not above all of them.
    #[inline(always)]
    fn cells_under(&self, low: DVec3, high: DVec3) -> Option<[[usize; 2]; 2]> {
        let columns = self.cells(0, low.x, high.x, self.columns)?;
        let rows = self.cells(1, low.y, high.y, self.rows)?;
        (self.roof.bound(columns, rows) >= low.z).then_some([columns, rows])
    }

    pub fn triangles_in(&self, low: DVec3, high: DVec3, out: &mut Vec<Triangle>) {
        let Some([columns, rows]) = self.cells_under(low, high) else { return };
        for j in rows[0]..=rows[1] {
            for i in columns[0]..=columns[1] {
                for triangle in self.cell(i, j) {
                    out.extend(triangle.reaches(low.z, high.z).then_some(triangle));
                }
            }
        }
    }

    /// Contacts of a ball with all triangles that its bounds touch, in increasing order of index.
    #[inline(always)]
    pub fn ball_contacts(&self, centre: DVec3, radius: f64, reach: f64, out: &mut Vec<SurfaceContact>) {
        let (low, high) = (centre - DVec3::splat(reach), centre + DVec3::splat(reach));
        let Some([columns, rows]) = self.cells_under(low, high) else { return };
        // A ball whose middle is further than this beyond a cell's diagonal, seen from above, does not touch the
        // triangle on the other side; the margin is for rounding.
        let far = radius * self.diagonal * (1.0 + 1e-9);
        for j in rows[0]..=rows[1] {
            for i in columns[0]..=columns[1] {
                let cell = self.cell(i, j);
                let corner = cell[0].corners[0];
                let beyond = self.spacing[0] * (centre.y - corner.y) - self.spacing[1] * (centre.x - corner.x);
                for (triangle, beyond) in cell.iter().zip([beyond, -beyond]) {
                    if beyond <= far && triangle.reaches(low.z, high.z) {
                        out.extend(triangle.sphere_contact(centre, radius));
                    }
                }
            }
        }
    }

    /// Height above (x, y) \[m\], looking down from `z`.
    pub fn height_below(&self, x: f64, y: f64, z: f64) -> Option<f64> {
        let (columns, rows) = (self.cells(0, x, x, self.columns)?, self.cells(1, y, y, self.rows)?);
        let triangles = self.cell(columns[0], rows[0]);
        let heights = triangles.iter().filter(|t| t.reaches(f64::NEG_INFINITY, z)).filter_map(|t| t.height_at(x, y));
        heights.filter(|&h| h <= z).max_by(f64::total_cmp)
    }

    /// First and last cell that an interval touches along one axis.
    #[inline(always)]
    fn cells(&self, axis: usize, low: f64, high: f64, points: usize) -> Option<[usize; 2]> {
        let last = (points - 2) as f64;
        let first_cell = ((low - self.origin[axis]) / self.spacing[axis]).floor();
        let last_cell = ((high - self.origin[axis]) / self.spacing[axis]).floor();
        // Written so that NaN finds nothing.
        let touches = last_cell >= 0.0 && first_cell <= last;
        touches.then(|| [first_cell.max(0.0) as usize, last_cell.min(last) as usize])
    }

    /// The two triangles of a cell.
    #[inline(always)]
    fn cell(&self, i: usize, j: usize) -> [Triangle; 2] {
        let [a, b, c, d] = [self.point(i, j), self.point(i + 1, j), self.point(i + 1, j + 1), self.point(i, j + 1)];
        let index = 2 * (j * (self.columns - 1) + i) as u32;
        [
            Triangle { index, corners: [a, b, c], material: None },
            Triangle { index: index + 1, corners: [a, c, d], material: None },
        ]
    }

    #[inline(always)]
    fn point(&self, i: usize, j: usize) -> DVec3 {
        let x = self.origin[0] + i as f64 * self.spacing[0];
        let y = self.origin[1] + j as f64 * self.spacing[1];
        DVec3::new(x, y, self.heights[j * self.columns + i])
    }
}

#[cfg(test)]
mod tests {
    use super::super::Terrain;

    #[test]
    fn heights_are_linear_in_each_triangle() {
        let terrain = Terrain::height_field([-1.0, 0.0], [0.5, 1.0], 3, 2, vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        assert_eq!(terrain.triangle_count(), 4);
        let height = terrain.height_below(-0.75, 0.25, 10.0).unwrap();
        assert!((height - (0.5 + 0.75)).abs() < 1e-12, "{height}");
        assert_eq!(terrain.height_below(0.6, 0.5, 10.0), None);
    }

    #[test]
    fn wrong_shapes_are_refused() {
        assert!(Terrain::height_field([0.0; 2], [1.0; 2], 2, 2, vec![0.0; 3]).is_err());
        assert!(Terrain::height_field([0.0; 2], [0.0, 1.0], 2, 2, vec![0.0; 4]).is_err());
        assert!(Terrain::height_field([0.0; 2], [1.0; 2], 2, 2, vec![0.0, f64::NAN, 0.0, 0.0]).is_err());
        assert!(Terrain::height_field([0.0; 2], [1.0; 2], usize::MAX, 2, vec![0.0; 4]).is_err());
    }
}
