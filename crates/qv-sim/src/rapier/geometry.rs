//! Shapes and poses in rapier's terms.

use crate::{Geom, Model, Shape, SimError};
use glam::{DQuat, DVec3};
use qv_core::Pose;
use rapier3d_f64::geometry::SharedShape;

pub(super) type RapierPose = rapier3d_f64::math::Pose;

pub(super) fn rapier_pose(pose: &Pose) -> RapierPose {
    RapierPose::from_parts(pose.position, pose.rotation)
}

/// Rotation that takes x to the axis: rapier's joints move about or along the x of their own frames.
pub(super) fn axis_frame(axis: DVec3) -> DQuat {
    DQuat::from_rotation_arc(DVec3::X, axis)
}

/// Shape with its pose in the link, and the skin that stands for `radius_offset` where there is no radius \[m\].
pub(super) struct SkinnedShape {
    pub shape: SharedShape,
    pub link_from_shape: RapierPose,
    pub skin: f64,
}

/// The shape under its parameters: `radius_offset`, and the `length` scale of its link.
///
/// # Errors
/// When the offset leaves no radius, or the hull has no volume.
pub(super) fn shape(model: &Model, geom: &Geom, radius_offset: f64, length: f64) -> Result<SkinnedShape, SimError> {
    let positive = |radius: f64| {
        let (what, expected) = (format!("radius of shape `{}`", geom.name), "more than 0 m".into());
        if radius > 0.0 { Ok(radius) } else { Err(SimError::Value { what, expected, found: radius }) }
    };
    let mut link_from_shape = rapier_pose(&geom.link_from_geom);
    link_from_shape.translation *= length;
    let mut skin = radius_offset;
    let shape = match &geom.shape {
        Shape::Sphere(radius) => {
            skin = 0.0;
            SharedShape::ball(positive(radius + radius_offset)?)
        }
        Shape::Capsule { radius, half_length } => {
            skin = 0.0;
            SharedShape::capsule_z(*half_length, positive(radius + radius_offset)?)
        }
        Shape::Box(half) => SharedShape::cuboid(half.x, half.y, half.z),
        Shape::Cylinder { radius, half_length } => {
            // Rapier's cylinder stands along y.
            let upright = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
            link_from_shape *= RapierPose::from_parts(DVec3::ZERO, upright);
            SharedShape::cylinder(*half_length, *radius)
        }
        Shape::Hull(points) => SharedShape::convex_hull(points).ok_or_else(|| SimError::Link {
            link: model.links[geom.link].name.clone(),
            expected: "a hull with a volume".into(),
            found: format!("{} points of shape `{}` without one", points.len(), geom.name),
        })?,
    };
    Ok(SkinnedShape { shape, link_from_shape, skin })
}
