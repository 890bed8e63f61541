//! Parameter values by what they act on.

use crate::model::inertia::{MassProperties, Payload, positive_definite};
use crate::parameters::{Catalogue, GeomField, JointField, LinkField, WorldField};
use crate::rapier::options::LONGEST_DELAY;
use crate::{Model, SimError};
use glam::DVec3;
use std::collections::BTreeMap;

/// The catalogue with the values in force.
pub(super) struct Values<'a> {
    catalogue: &'a Catalogue,
    overrides: &'a BTreeMap<usize, f64>,
}

impl<'a> Values<'a> {
    pub fn new(catalogue: &'a Catalogue, overrides: &'a BTreeMap<usize, f64>) -> Self {
        Self { catalogue, overrides }
    }

    fn at(&self, id: usize) -> f64 {
        self.overrides.get(&id).copied().unwrap_or(self.catalogue.infos[id].neutral)
    }

    pub fn joint(&self, joint: usize, field: JointField) -> f64 {
        self.at(joint * JointField::COUNT + field as usize)
    }

    /// True over modelled distance of what is fixed to a link from its own joint.
    pub fn length(&self, link: usize) -> f64 {
        self.link(link, LinkField::LengthScale)
    }

    fn link(&self, link: usize, field: LinkField) -> f64 {
        self.at(self.catalogue.links_at + link * LinkField::COUNT + field as usize)
    }

    pub fn geom(&self, geom: usize, field: GeomField) -> f64 {
        self.at(self.catalogue.geoms_at + geom * GeomField::COUNT + field as usize)
    }

    pub fn material(&self, material: usize) -> f64 {
        self.at(self.catalogue.materials_at + material)
    }

    pub fn materials(&self) -> usize {
        self.catalogue.materials()
    }

    pub fn world(&self, field: WorldField) -> f64 {
        self.at(self.catalogue.world_at + field as usize)
    }

    pub fn world3(&self, x: WorldField, y: WorldField, z: WorldField) -> DVec3 {
        DVec3::new(self.world(x), self.world(y), self.world(z))
    }

    /// Mass, centre of mass and inertia of a link with its payload, in the link frame.
    ///
    /// # Errors
    /// When what is left has no mass or no positive inertia.
    pub fn body(&self, model: &Model, link: usize) -> Result<MassProperties, SimError> {
        let vector = |x, y, z| DVec3::new(self.link(link, x), self.link(link, y), self.link(link, z));
        let nominal = &model.links[link];
        let scale = self.link(link, LinkField::MassScale);
        let own = MassProperties {
            mass: nominal.mass * scale,
            com: nominal.com * self.length(link) + vector(LinkField::ComX, LinkField::ComY, LinkField::ComZ),
            inertia: nominal.inertia * (scale * self.link(link, LinkField::InertiaScale)),
        };
        let payload = Payload {
            mass: self.link(link, LinkField::PayloadMass),
            at: nominal.com * self.length(link) + vector(LinkField::PayloadX, LinkField::PayloadY, LinkField::PayloadZ),
            moment: vector(LinkField::PayloadMomentX, LinkField::PayloadMomentY, LinkField::PayloadMomentZ),
        };
        let what = |quantity: &str| format!("{quantity} of link `{}` with its payload", nominal.name);
        let mass = own.mass + payload.mass;
        if mass <= 0.0 {
            return Err(SimError::Value { what: what("mass"), expected: "more than 0 kg".into(), found: mass });
        }
        let body = payload.on(&own);
        if !positive_definite(&body.inertia) {
            let (expected, found) = ("positive in every direction".into(), body.inertia.determinant());
            return Err(SimError::Value { what: what("inertia (its determinant)"), expected, found });
        }
        Ok(body)
    }

    /// # Errors
    /// Names the first latency or delay that is longer than what is remembered.
    pub fn delays(&self, model: &Model) -> Result<(), SimError> {
        let joints = (0..model.joints.len()).flat_map(|joint| {
            [JointField::CommandLatency, JointField::EncoderLatency]
                .map(|field| joint * JointField::COUNT + field as usize)
        });
        let pose = self.catalogue.world_at + WorldField::PoseDelay as usize;
        for id in joints.chain([pose]) {
            if self.at(id) > LONGEST_DELAY {
                let (what, expected) = (self.catalogue.infos[id].name.clone(), format!("at most {LONGEST_DELAY} s"));
                return Err(SimError::Value { what, expected, found: self.at(id) });
            }
        }
        Ok(())
    }

    /// Share of the step from `time` on during which outside force and torques act.
    pub fn external_share(&self, time: f64, timestep: f64) -> f64 {
        let start = self.world(WorldField::ForceStart);
        let from = start.max(time);
        let to = (start + self.world(WorldField::ForceDuration)).min(time + timestep);
        ((to - from) / timestep).clamp(0.0, 1.0)
    }

    /// Outside force on the base \[N\], world axes.
    pub fn external_force(&self) -> DVec3 {
        self.world3(WorldField::ForceX, WorldField::ForceY, WorldField::ForceZ)
    }

    /// Adds the outside torques \[N m\] to those of the motors.
    pub fn add_external_torques(&self, share: f64, torque: &mut [f64]) {
        for (joint, torque) in torque.iter_mut().enumerate() {
            *torque += share * self.joint(joint, JointField::ExternalTorque);
        }
    }
}
