//! The labelled ground: which labels it has, and which one lies under a place.

use crate::ContactError;
use glam::DVec3;
use qv_core::{Material, TriangleMesh};
use qv_sim::Terrain;
use std::collections::HashMap;

/// Side of the squares by which triangles are looked up \[m\].
const CELL: f64 = 0.25;
/// Most squares that one triangle is listed in; larger ones are looked at each time.
const MOST_CELLS: i64 = 4096;

/// Labelled triangles, looked up by place.
#[derive(Debug, Clone)]
pub struct Ground {
    mesh: TriangleMesh,
    /// Triangles by the squares that their bounds touch.
    cells: HashMap<(i64, i64), Vec<u32>>,
    /// Triangles too large for that.
    large: Vec<u32>,
}

impl Ground {
    /// The ground of a mesh, without materials that no triangle has.
    ///
    /// # Errors
    /// When the mesh is off, has no labels, or two of its materials have one name.
    pub fn new(mesh: &TriangleMesh) -> Result<Self, ContactError> {
        mesh.validate().map_err(|e| ContactError::run("terrain", "a good mesh", e.to_string()))?;
        let mesh = compact(mesh);
        let is_labelled = mesh.materials.iter().any(|m| m.name != "unlabelled");
        if mesh.labels.is_empty() || !is_labelled {
            return Err(ContactError::run("terrain", "triangles with materials", "none with a material"));
        }
        for (i, material) in mesh.materials.iter().enumerate() {
            if mesh.materials[..i].iter().any(|m| m.name == material.name) {
                let found = format!("two of the name `{}`", material.name);
                return Err(ContactError::run("materials of the terrain", "names of their own", found));
            }
        }
        let (mut cells, mut large) = (HashMap::<(i64, i64), Vec<u32>>::new(), Vec::new());
        for triangle in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(triangle);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let (from, to) = (cell(low.x, low.y), cell(high.x, high.y));
            let count = |low: i64, high: i64| high.saturating_sub(low).saturating_add(1);
            if count(from.0, to.0).saturating_mul(count(from.1, to.1)) > MOST_CELLS {
                large.push(triangle as u32);
                continue;
            }
            for i in from.0..=to.0 {
                for j in from.1..=to.1 {
                    cells.entry((i, j)).or_default().push(triangle as u32);
                }
            }
        }
        Ok(Self { mesh, cells, large })
    }

    /// Names of the labels, in the order of the mesh.
    pub fn labels(&self) -> Vec<String> {
        self.mesh.materials.iter().map(|m| m.name.clone()).collect()
    }

    /// The mesh.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// The same mesh with these frictions, one for each label.
    pub fn with_frictions(&self, frictions: &[f64]) -> TriangleMesh {
        let mut mesh = self.mesh.clone();
        mesh.materials.iter_mut().zip(frictions).for_each(|(m, f)| m.friction = Some(*f));
        mesh
    }

    /// The ground as the simulator has it, with these frictions.
    ///
    /// # Errors
    /// When no triangle has an area.
    pub fn terrain(&self, frictions: &[f64]) -> Result<Terrain, ContactError> {
        Ok(Terrain::from_mesh(&self.with_frictions(frictions))?)
    }

    /// Label and height \[m\] of the uppermost triangle below a point; `None` where there is none.
    pub fn below(&self, point: DVec3) -> Option<(usize, f64)> {
        let near = self.cells.get(&cell(point.x, point.y)).into_iter().flatten();
        let hits = near.chain(&self.large).filter_map(|&t| {
            let height = height_at(self.mesh.corners(t as usize), point.x, point.y)?;
            (height <= point.z).then(|| (usize::from(self.mesh.labels[t as usize]), height))
        });
        hits.max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

fn cell(x: f64, y: f64) -> (i64, i64) {
    ((x / CELL).floor() as i64, (y / CELL).floor() as i64)
}

/// The mesh with the materials that its triangles have, in their order.
fn compact(mesh: &TriangleMesh) -> TriangleMesh {
    let mut used = vec![false; mesh.materials.len()];
    mesh.labels.iter().for_each(|l| used[usize::from(*l)] = true);
    let mut new = vec![0u16; mesh.materials.len()];
    let mut materials: Vec<Material> = Vec::new();
    for (old, material) in mesh.materials.iter().enumerate().filter(|(i, _)| used[*i]) {
        new[old] = materials.len() as u16;
        materials.push(material.clone());
    }
    let labels = mesh.labels.iter().map(|l| new[usize::from(*l)]).collect();
    TriangleMesh { labels, materials, ..mesh.clone() }
}

/// Height of a triangle's plane above (x, y), if that lies within it.
fn height_at([a, b, c]: [DVec3; 3], x: f64, y: f64) -> Option<f64> {
    let cross = |p: DVec3, q: DVec3| (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
    let (u, v, w) = (cross(b, c), cross(c, a), cross(a, b));
    let area = u + v + w;
    // Upright triangles have no height; the edge counts as inside.
    let slack = 1e-9 * area.abs();
    let is_inside = [u, v, w].iter().all(|s| s * area.signum() >= -slack);
    (area.abs() > 1e-12 && is_inside).then(|| (u * a.z + v * b.z + w * c.z) / area)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two squares side by side along x, the second 0.1 m higher, and a material that none has.
    pub(crate) fn two_squares() -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for name in ["ice", "unused", "grass"] {
            mesh.materials.push(Material { name: name.into(), friction: None });
        }
        for (k, label) in [(0, 0u16), (1, 2)] {
            let (x, z, first) = (f64::from(k), 0.1 * f64::from(k), mesh.vertices.len() as u32);
            for (dx, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                mesh.vertices.push(DVec3::new(x + dx, y, z));
            }
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            mesh.labels.extend([label; 2]);
        }
        mesh
    }

    #[test]
    fn labels_lie_under_places() {
        let ground = Ground::new(&two_squares()).unwrap();
        assert_eq!(ground.labels(), ["ice", "grass"]);
        assert_eq!(ground.below(DVec3::new(0.5, 0.2, 1.0)), Some((0, 0.0)));
        let (label, height) = ground.below(DVec3::new(1.5, 0.7, 1.0)).unwrap();
        assert!(label == 1 && (height - 0.1).abs() < 1e-12);
        assert_eq!(ground.below(DVec3::new(1.5, 0.7, 0.05)), None, "it lies above");
        assert_eq!(ground.below(DVec3::new(2.5, 0.7, 1.0)), None);
        assert_eq!(ground.with_frictions(&[0.1, 0.6]).materials[1].friction, Some(0.6));
    }

    #[test]
    fn a_large_triangle_is_found_far_away() {
        let mut mesh = two_squares();
        mesh.vertices.iter_mut().for_each(|v| *v *= 100.0);
        let ground = Ground::new(&mesh).unwrap();
        assert_eq!(ground.below(DVec3::new(77.0, 12.0, 50.0)), Some((0, 0.0)));
    }

    #[test]
    fn a_ground_without_labels_is_named() {
        let mut mesh = two_squares();
        mesh.labels.clear();
        let error = Ground::new(&mesh).unwrap_err().to_string();
        assert!(error.contains("materials"), "{error}");
        let mut mesh = two_squares();
        mesh.materials[2].name = "ice".into();
        assert!(Ground::new(&mesh).unwrap_err().to_string().contains("`ice`"));
    }
}
