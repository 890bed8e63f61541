//! What the robot stands on: a plane, a height field or a triangle mesh, with friction by material.

mod height_field;
mod triangle;

pub(crate) use triangle::{SurfaceContact, Triangle};

use crate::SimError;
use glam::DVec3;
use height_field::HeightField;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use qv_core::TriangleMesh;
use std::sync::Arc;

/// Friction of ground that carries no material, foot on ground.
pub const DEFAULT_FRICTION: f64 = 0.8;

/// Immovable ground in world coordinates, z up. Cloning shares the data.
#[derive(Debug, Clone)]
pub struct Terrain {
    surface: Arc<Surface>,
    friction: f64,
}

#[derive(Debug)]
enum Surface {
    None,
    Plane,
    HeightField(HeightField),
    Mesh { mesh: TriangleMesh, bvh: Bvh, materials: Vec<(String, f64)> },
}

impl Terrain {
    /// The plane z = 0 with friction [`DEFAULT_FRICTION`].
    pub fn plane() -> Self {
        Self { surface: Arc::new(Surface::Plane), friction: DEFAULT_FRICTION }
    }

    /// No ground at all, for arms and for robots held in the air.
    pub fn none() -> Self {
        Self { surface: Arc::new(Surface::None), friction: DEFAULT_FRICTION }
    }

    /// A grid of heights \[m\], row-major with x fastest: point (i, j) lies at `origin + (i dx, j dy)`. Each cell is two
    /// triangles, split from its (min x, min y) to its (max x, max y) corner. Outside the grid there is no ground.
    ///
    /// # Errors
    /// When there are fewer than 2 x 2 heights, their number is not `columns * rows`, or a number is not finite.
    pub fn height_field(
        origin: [f64; 2],
        spacing: [f64; 2],
        columns: usize,
        rows: usize,
        heights: Vec<f64>,
    ) -> Result<Self, SimError> {
        let field = HeightField::new(origin, spacing, columns, rows, heights)?;
        Ok(Self { surface: Arc::new(Surface::HeightField(field)), friction: DEFAULT_FRICTION })
    }

    /// A triangle mesh, counter-clockwise seen from above; materials without a friction get [`DEFAULT_FRICTION`].
    /// Triangles without area are left out of contact.
    ///
    /// # Errors
    /// When indices or labels are off, a number is not finite, or no triangle is left.
    pub fn from_mesh(mesh: &TriangleMesh) -> Result<Self, SimError> {
        let bad = |found: String| SimError::Terrain { expected: "a mesh with triangles".into(), found };
        mesh.validate().map_err(|e| bad(e.to_string()))?;
        let mut kept = TriangleMesh { triangles: Vec::new(), labels: Vec::new(), ..mesh.clone() };
        for (t, indices) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = mesh.corners(t);
            if (b - a).cross(c - a).length_squared() > 1e-24 {
                kept.triangles.push(*indices);
                kept.labels.extend(mesh.labels.get(t));
            }
        }
        if kept.triangles.is_empty() {
            return Err(bad(format!("{} triangles, none with an area", mesh.triangles.len())));
        }
        let boxes: Vec<Aabb> = (0..kept.triangles.len()).map(|t| bounds(&kept.corners(t))).collect();
        let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let materials =
            kept.materials.iter().map(|m| (m.name.clone(), m.friction.unwrap_or(DEFAULT_FRICTION))).collect();
        Ok(Self { surface: Arc::new(Surface::Mesh { mesh: kept, bvh, materials }), friction: DEFAULT_FRICTION })
    }

    /// The same ground with another friction where it carries no material.
    ///
    /// # Errors
    /// When the coefficient is negative or not finite.
    pub fn with_friction(mut self, friction: f64) -> Result<Self, SimError> {
        if !(friction.is_finite() && friction >= 0.0) {
            return Err(SimError::Value { what: "friction".into(), expected: "at least 0".into(), found: friction });
        }
        self.friction = friction;
        Ok(self)
    }

    /// Friction where there is no material.
    pub fn friction(&self) -> f64 {
        self.friction
    }

    /// Names and friction of the materials.
    pub fn materials(&self) -> &[(String, f64)] {
        match &*self.surface {
            Surface::Mesh { materials, .. } => materials,
            _ => &[],
        }
    }

    /// Whether this is the plane z = 0.
    pub fn is_plane(&self) -> bool {
        matches!(*self.surface, Surface::Plane)
    }

    /// Whether there is no ground.
    pub fn is_none(&self) -> bool {
        matches!(*self.surface, Surface::None)
    }

    /// Number of triangles; 0 for a plane.
    pub fn triangle_count(&self) -> usize {
        match &*self.surface {
            Surface::None | Surface::Plane => 0,
            Surface::HeightField(field) => field.triangle_count(),
            Surface::Mesh { mesh, .. } => mesh.triangles.len(),
        }
    }

    /// Triangles whose bounds touch a box, with the material of each, in increasing order of index.
    pub(crate) fn triangles_in(&self, low: DVec3, high: DVec3, out: &mut Vec<Triangle>) {
        out.clear();
        match &*self.surface {
            Surface::None | Surface::Plane => {}
            Surface::HeightField(field) => field.triangles_in(low, high, out),
            Surface::Mesh { mesh, bvh, .. } => {
                let region = Aabb::new(low, high);
                out.extend(bvh.intersect_aabb(&region).map(|t| Triangle {
                    index: t,
                    corners: mesh.corners(t as usize),
                    material: mesh.labels.get(t as usize).copied(),
                }));
                out.sort_unstable_by_key(|t| t.index);
            }
        }
    }

    /// Height of the ground above (x, y) \[m\], looking down from `z`; `None` where there is none below.
    pub fn height_below(&self, x: f64, y: f64, z: f64) -> Option<f64> {
        if self.is_plane() {
            return (z >= 0.0).then_some(0.0);
        }
        let mut triangles = Vec::new();
        self.triangles_in(DVec3::new(x, y, -1e6), DVec3::new(x, y, z), &mut triangles);
        triangles.iter().filter_map(|t| t.height_at(x, y)).filter(|&h| h <= z).max_by(f64::total_cmp)
    }
}

fn bounds(corners: &[DVec3; 3]) -> Aabb {
    let [a, b, c] = *corners;
    Aabb::new(a.min(b).min(c), a.max(b).max(c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::Material;

    fn step() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.0, 1.0, 0.5)],
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 0, 1]],
            labels: vec![1, 0, 0],
            materials: vec![
                Material { name: "grass".into(), friction: Some(0.6) },
                Material { name: "stone".into(), friction: None },
            ],
        }
    }

    #[test]
    fn mesh_heights_and_materials() {
        let terrain = Terrain::from_mesh(&step()).unwrap();
        assert_eq!(terrain.triangle_count(), 2);
        assert_eq!(terrain.materials(), &[("grass".to_owned(), 0.6), ("stone".to_owned(), DEFAULT_FRICTION)]);
        assert_eq!(terrain.height_below(0.75, 0.25, 1.0), Some(0.0));
        let height = terrain.height_below(0.25, 0.75, 1.0).unwrap();
        assert!((height - 0.25).abs() < 1e-12, "{height}");
        assert_eq!(terrain.height_below(2.0, 0.0, 1.0), None);
    }

    #[test]
    fn bad_grounds_are_named() {
        let mut flat = step();
        flat.triangles = vec![[0, 0, 1]];
        flat.labels = vec![0];
        assert!(matches!(Terrain::from_mesh(&flat), Err(SimError::Terrain { .. })));
        assert!(Terrain::plane().with_friction(f64::NAN).is_err());
    }
}
