//! A regular grid of heights: the triangles under a box are found without a search.

use super::Triangle;
use crate::SimError;
use glam::DVec3;

#[derive(Debug)]
pub(super) struct HeightField {
    origin: [f64; 2],
    spacing: [f64; 2],
    columns: usize,
    rows: usize,
    heights: Vec<f64>,
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
        Ok(Self { origin, spacing, columns, rows, heights })
    }

    pub fn triangle_count(&self) -> usize {
        2 * (self.columns - 1) * (self.rows - 1)
    }

    pub fn triangles_in(&self, low: DVec3, high: DVec3, out: &mut Vec<Triangle>) {
        let (Some((i0, i1)), Some((j0, j1))) =
            (self.cells(0, low.x, high.x, self.columns), self.cells(1, low.y, high.y, self.rows))
        else {
            return;
        };
        for j in j0..=j1 {
            for i in i0..=i1 {
                self.push_cell(i, j, low.z, high.z, out);
            }
        }
    }

    /// First and last cell that an interval touches along one axis.
    fn cells(&self, axis: usize, low: f64, high: f64, points: usize) -> Option<(usize, usize)> {
        let last = (points - 2) as f64;
        let first_cell = ((low - self.origin[axis]) / self.spacing[axis]).floor();
        let last_cell = ((high - self.origin[axis]) / self.spacing[axis]).floor();
        // Written so that NaN finds nothing.
        let touches = last_cell >= 0.0 && first_cell <= last;
        touches.then(|| (first_cell.max(0.0) as usize, last_cell.min(last) as usize))
    }

    fn push_cell(&self, i: usize, j: usize, low_z: f64, high_z: f64, out: &mut Vec<Triangle>) {
        let [a, b, c, d] = [self.point(i, j), self.point(i + 1, j), self.point(i + 1, j + 1), self.point(i, j + 1)];
        let index = 2 * (j * (self.columns - 1) + i) as u32;
        for (k, corners) in [[a, b, c], [a, c, d]].into_iter().enumerate() {
            let [p, q, r] = corners.map(|v| v.z);
            if p.min(q).min(r) <= high_z && p.max(q).max(r) >= low_z {
                out.push(Triangle { index: index + k as u32, corners, material: None });
            }
        }
    }

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
