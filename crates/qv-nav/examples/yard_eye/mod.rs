//! The eye of the second world, for the examples that test a student in it.

use qv_nav::eye::{LINEAR, Shot};
use yard::{Things, Yard, objects};

/// What the yard's ray caster shows, 0 to 1, without noise.
pub fn cast(yard: &Yard, shot: &Shot) -> Vec<f32> {
    let cone = |c: &qv_nav::sight::Cone| objects::Cone {
        place: c.place.into(),
        height: c.height,
        radius: c.radius(),
        colour: LINEAR[c.colour],
    };
    let cones: Vec<_> = shot.cones.iter().map(cone).collect();
    let bytes = yard.photo_from(&shot.camera, &Things::new(&cones), [1.0; 3], 0.0, 0);
    bytes.into_iter().map(|b| f32::from(b) / 255.0).collect()
}
