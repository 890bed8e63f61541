//! The ground of the second engine: its shape, and friction by place.

use crate::parameters::{GeomField, WorldField};
use crate::rapier::values::Values;
use crate::{SimError, Terrain};
use glam::{DQuat, DVec3};
use rapier3d_f64::geometry::{ColliderHandle, SharedShape, TriMeshFlags};
use rapier3d_f64::math::Pose;
use rapier3d_f64::pipeline::{ContactModificationContext, PhysicsHooks};
use std::sync::Arc;

/// Far beyond any terrain \[m\].
const EVERYWHERE: f64 = 1e9;

/// The collision shape, shared by all worlds that an engine builds.
#[derive(Clone)]
pub(super) struct GroundShape {
    /// `None` where there is no ground.
    pub shape: Option<SharedShape>,
    /// Material of each triangle; empty for a plane.
    materials: Arc<[Option<u16>]>,
}

impl GroundShape {
    /// # Errors
    /// When rapier does not take the triangles.
    pub fn new(terrain: &Terrain) -> Result<Self, SimError> {
        let none: Arc<[Option<u16>]> = Arc::new([]);
        if terrain.is_none() {
            return Ok(Self { shape: None, materials: none });
        }
        if terrain.is_plane() {
            return Ok(Self { shape: Some(SharedShape::halfspace(DVec3::Z)), materials: none });
        }
        let mut triangles = Vec::new();
        terrain.triangles_in(DVec3::splat(-EVERYWHERE), DVec3::splat(EVERYWHERE), &mut triangles);
        let vertices = triangles.iter().flat_map(|t| t.corners).collect();
        let indices = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        // Without this a foot that slides over the edge between two flat triangles is kicked.
        let shape = SharedShape::trimesh_with_flags(vertices, indices, TriMeshFlags::FIX_INTERNAL_EDGES);
        let shape = shape.map_err(|e| SimError::Terrain {
            expected: "triangles that the second engine takes".into(),
            found: e.to_string(),
        })?;
        Ok(Self { shape: Some(shape), materials: triangles.iter().map(|t| t.material).collect() })
    }

    /// Friction rules of this ground under the parameters in force.
    pub fn rules(&self, values: &Values, geoms: usize) -> ContactRules {
        use WorldField::*;
        ContactRules {
            ground: ColliderHandle::invalid(),
            triangles: self.materials.clone(),
            materials: (0..values.materials()).map(|m| values.material(m)).collect(),
            friction: values.world(Friction),
            patch: [PatchXMin, PatchXMax, PatchYMin, PatchYMax].map(|field| values.world(field)),
            patch_friction: values.world(PatchFriction),
            geom_scale: (0..geoms).map(|g| values.geom(g, GeomField::FrictionScale)).collect(),
        }
    }
}

/// Pose of the terrain: raised, and tilted about the origin.
pub(super) fn world_from_terrain(values: &Values) -> Pose {
    let tilt = DQuat::from_rotation_y(-values.world(WorldField::SlopeX))
        * DQuat::from_rotation_x(values.world(WorldField::SlopeY));
    Pose::from_parts(DVec3::new(0.0, 0.0, values.world(WorldField::Height)), tilt)
}

/// Sets the friction of every contact by where it is. The user data of a robot's collider is the shape's index.
pub(super) struct ContactRules {
    pub ground: ColliderHandle,
    triangles: Arc<[Option<u16>]>,
    materials: Vec<f64>,
    friction: f64,
    /// Smallest and largest x, then y, in terrain coordinates \[m\].
    patch: [f64; 4],
    patch_friction: f64,
    geom_scale: Vec<f64>,
}

impl ContactRules {
    fn ground_friction(&self, triangle: u32, point_in_terrain: DVec3) -> f64 {
        let [x0, x1, y0, y1] = self.patch;
        let p = point_in_terrain;
        if x0 <= p.x && p.x < x1 && y0 <= p.y && p.y < y1 {
            return self.patch_friction;
        }
        let material = self.triangles.get(triangle as usize).copied().flatten();
        material.and_then(|m| self.materials.get(m as usize).copied()).unwrap_or(self.friction)
    }
}

impl PhysicsHooks for ContactRules {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        let ground_first = context.collider1 == self.ground;
        let other = if ground_first { context.collider2 } else { context.collider1 };
        let geom = context.colliders.get(other).map_or(0, |collider| collider.user_data as usize);
        let Some(contact) = context.rigid_mut() else { return };
        // A shape that lies across the edge of the patch has one friction, that of its deepest point.
        let deepest = contact.manifold.points.iter().min_by(|a, b| a.dist.total_cmp(&b.dist));
        let Some(deepest) = deepest else { return };
        let (triangle, point) = if ground_first {
            (contact.manifold.subshape1, deepest.local_p1)
        } else {
            (contact.manifold.subshape2, deepest.local_p2)
        };
        let scale = self.geom_scale.get(geom).copied().unwrap_or(1.0);
        *contact.friction = scale * self.ground_friction(triangle, point);
    }
}
