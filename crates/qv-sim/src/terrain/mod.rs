//! What the robot stands on: a plane, a height field or a triangle mesh, with friction by material.

mod ground_mesh;
mod height_field;
mod roof;
mod triangle;

pub(crate) use triangle::{SurfaceContact, Triangle};

use crate::SimError;
use crate::error::{finite, length};
use glam::DVec3;
use ground_mesh::GroundMesh;
use height_field::HeightField;
use qv_core::TriangleMesh;
use std::collections::HashMap;
use std::sync::Arc;

/// Friction of ground that carries no material, foot on ground.
pub const DEFAULT_FRICTION: f64 = 0.8;

/// Triangles that may lie in the same place: each is a contact of what stands there, and contacts of a ball are judged beside each other.
const MOST_ALIKE: usize = 64;

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
    Mesh { mesh: GroundMesh, materials: Vec<(String, f64)>, turned: usize },
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
    /// Triangles without area are left out of contact. Pieces that are wound the other way round are turned
    /// ([`TriangleMesh::turn_outward`]); [`Self::turned`] says how many triangles that were.
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
        let turned = kept.turn_outward();
        let alike = most_alike(&kept);
        if alike > MOST_ALIKE {
            let expected = format!("at most {MOST_ALIKE} triangles of the same corners");
            return Err(SimError::Terrain { expected, found: alike.to_string() });
        }
        let materials =
            kept.materials.iter().map(|m| (m.name.clone(), m.friction.unwrap_or(DEFAULT_FRICTION))).collect();
        Ok(Self {
            surface: Arc::new(Surface::Mesh { mesh: GroundMesh::new(kept), materials, turned }),
            friction: DEFAULT_FRICTION,
        })
    }

    /// Triangles that looked down, or into their piece, and were turned round.
    pub fn turned(&self) -> usize {
        match &*self.surface {
            Surface::Mesh { turned, .. } => *turned,
            _ => 0,
        }
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
            Surface::Mesh { mesh, .. } => mesh.triangle_count(),
        }
    }

    /// Triangles whose bounds touch a box, with the material of each, in increasing order of index.
    pub(crate) fn triangles_in(&self, low: DVec3, high: DVec3, out: &mut Vec<Triangle>) {
        out.clear();
        match &*self.surface {
            Surface::None | Surface::Plane => {}
            Surface::HeightField(field) => field.triangles_in(low, high, out),
            Surface::Mesh { mesh, .. } => mesh.triangles_in(low, high, out),
        }
    }

    /// The greatest height of ground that has triangles \[m\]; infinite for what has none.
    pub(crate) fn top(&self) -> f64 {
        match &*self.surface {
            Surface::None | Surface::Plane => f64::INFINITY,
            Surface::HeightField(field) => field.top(),
            Surface::Mesh { mesh, .. } => mesh.top(),
        }
    }

    /// Adds the contacts of a ball with the triangles that a cube about it touches (half its edge is `reach`), in
    /// increasing order of the triangles' index.
    #[inline(always)]
    pub(crate) fn ball_contacts(
        &self,
        centre: DVec3,
        radius: f64,
        reach: f64,
        triangles: &mut Vec<Triangle>,
        out: &mut Vec<SurfaceContact>,
    ) {
        match &*self.surface {
            Surface::None | Surface::Plane => {}
            Surface::HeightField(field) => field.ball_contacts(centre, radius, reach, out),
            Surface::Mesh { mesh, .. } => mesh.ball_contacts(centre, radius, reach, triangles, out),
        }
    }

    /// Height of the ground above (x, y) \[m\], looking down from `z`; `None` where there is none below.
    pub fn height_below(&self, x: f64, y: f64, z: f64) -> Option<f64> {
        self.height_under([x, y, z], &mut Vec::new())
    }

    /// [`Terrain::height_below`] for many points (x, y, z) \[m\], `heights[i]` for `points[i]`. A height field is read where
    /// the point lies, and nothing is allocated for it.
    ///
    /// # Errors
    /// When there are not as many heights as points, or a coordinate is not a number; nothing is written then.
    pub fn heights_below(&self, points: &[[f64; 3]], heights: &mut [Option<f64>]) -> Result<(), SimError> {
        length("heights", points.len(), heights.len())?;
        finite("coordinate", points.as_flattened())?;
        let mut triangles = Vec::new();
        for (&point, height) in points.iter().zip(heights) {
            *height = self.height_under(point, &mut triangles);
        }
        Ok(())
    }

    fn height_under(&self, [x, y, z]: [f64; 3], triangles: &mut Vec<Triangle>) -> Option<f64> {
        match &*self.surface {
            Surface::None => None,
            Surface::Plane => (z >= 0.0).then_some(0.0),
            Surface::HeightField(field) => field.height_below(x, y, z),
            Surface::Mesh { .. } => {
                self.triangles_in(DVec3::new(x, y, -1e6), DVec3::new(x, y, z), triangles);
                triangles.iter().filter_map(|t| t.height_at(x, y)).filter(|&h| h <= z).max_by(f64::total_cmp)
            }
        }
    }
}

/// The largest number of triangles that have the same three corners.
fn most_alike(mesh: &TriangleMesh) -> usize {
    let mut counts: HashMap<[[u64; 3]; 3], usize> = HashMap::new();
    for t in 0..mesh.triangles.len() {
        let mut corners = mesh.corners(t).map(|corner| corner.to_array().map(f64::to_bits));
        corners.sort_unstable();
        *counts.entry(corners).or_default() += 1;
    }
    counts.into_values().max().unwrap_or(0)
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
    fn many_heights_are_those_of_single_points() {
        let field =
            Terrain::height_field([-1.0, -1.0], [0.5, 0.25], 5, 9, (0..45).map(|k| f64::from(k * 29 % 17)).collect());
        for terrain in [Terrain::plane(), Terrain::none(), field.unwrap(), Terrain::from_mesh(&step()).unwrap()] {
            let place = |k: i32| f64::from(k) * 0.125 - 1.25;
            let points: Vec<[f64; 3]> =
                (0..8820).map(|k| [place(k % 21), place(k / 21 % 21), f64::from(k / 441) - 1.0]).collect();
            let mut heights = vec![None; points.len()];
            terrain.heights_below(&points, &mut heights).unwrap();
            for ([x, y, z], height) in points.iter().zip(&heights) {
                assert_eq!(terrain.height_below(*x, *y, *z), *height, "{x} {y} {z}");
                // As the search through the triangles finds it.
                let mut triangles = Vec::new();
                terrain.triangles_in(DVec3::new(*x, *y, -1e6), DVec3::new(*x, *y, *z), &mut triangles);
                let searched =
                    triangles.iter().filter_map(|t| t.height_at(*x, *y)).filter(|h| h <= z).max_by(f64::total_cmp);
                assert!(terrain.triangle_count() == 0 || searched == *height, "{x} {y} {z}: {searched:?} {height:?}");
            }
            assert_eq!(heights.iter().any(Option::is_some), !terrain.is_none());
            assert!(matches!(terrain.heights_below(&points, &mut heights[1..]), Err(SimError::Length { .. })));
            assert!(matches!(
                terrain.heights_below(&[[0.0, f64::NAN, 0.0]], &mut heights[..1]),
                Err(SimError::Value { .. })
            ));
        }
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
