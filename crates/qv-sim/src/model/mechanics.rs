//! Energy and momentum of a state, for checks and reports.

use super::{JointKind, Model};
use glam::DVec3;

/// Mechanical totals of one state of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mechanics {
    /// Kinetic energy, rotor inertia included \[J\].
    pub kinetic_energy: f64,
    /// Mass times height of the centre of mass times 9.81 m/s² \[J\].
    pub potential_energy: f64,
    /// Centre of mass in the world \[m\].
    pub center_of_mass: DVec3,
    /// Its velocity \[m/s\].
    pub center_of_mass_velocity: DVec3,
    /// Angular momentum of the links about the centre of mass, world axes \[kg m²/s\].
    pub angular_momentum: DVec3,
}

impl Model {
    /// Energy and momentum for positions `q` (shape `[nq]`) and velocities `v` (shape `[nv]`), as in [`crate::State`].
    ///
    /// # Panics
    /// When `q` or `v` is too short.
    pub fn mechanics(&self, q: &[f64], v: &[f64]) -> Mechanics {
        let poses = self.world_from_links(q);
        // Velocity of each link's origin, and its angular velocity, in the world.
        let mut twists: Vec<(DVec3, DVec3)> = Vec::with_capacity(self.links.len());
        let mut mass = 0.0;
        let mut first_moment = DVec3::ZERO;
        let mut momentum = DVec3::ZERO;
        let mut about_origin = DVec3::ZERO;
        let mut kinetic_energy = 0.0;
        for (index, link) in self.links.iter().enumerate() {
            let pose = poses[index];
            let (moving, turning) = match link.joint {
                None => (DVec3::new(v[0], v[1], v[2]), pose.rotation * DVec3::new(v[3], v[4], v[5])),
                Some(j) => {
                    let joint = &self.joints[j];
                    let speed = v[self.base_dofs() + j];
                    kinetic_energy += 0.5 * joint.armature * speed * speed;
                    let axis = pose.rotation * joint.axis;
                    let (moving, turning) = link.parent.map_or((DVec3::ZERO, DVec3::ZERO), |p| {
                        let (moving, turning) = twists[p];
                        (moving + turning.cross(pose.position - poses[p].position), turning)
                    });
                    match joint.kind {
                        JointKind::Revolute => (moving, turning + axis * speed),
                        JointKind::Prismatic => (moving + axis * speed, turning),
                    }
                }
            };
            twists.push((moving, turning));
            let centre = pose.transform_point(link.com);
            let velocity = moving + turning.cross(centre - pose.position);
            let rotation = pose.matrix();
            let spin = rotation * link.inertia * rotation.transpose() * turning;
            mass += link.mass;
            first_moment += centre * link.mass;
            momentum += velocity * link.mass;
            about_origin += centre.cross(velocity * link.mass) + spin;
            kinetic_energy += 0.5 * (link.mass * velocity.length_squared() + turning.dot(spin));
        }
        let center_of_mass = first_moment / mass;
        Mechanics {
            kinetic_energy,
            potential_energy: mass * center_of_mass.z * qv_core::GRAVITY,
            center_of_mass,
            center_of_mass_velocity: momentum / mass,
            angular_momentum: about_origin - center_of_mass.cross(momentum),
        }
    }
}
