//! From the parameters of one environment to what the engine reads in its lane.

use super::block::Block;
use super::topology::Topology;
use crate::SimError;
use crate::lanes::{Real, set};
use crate::model::Model;
use crate::model::inertia::{MassProperties, Payload};
use crate::motor::{lag_gain, speed_slope};
use crate::parameters::{ActsOn, Catalogue, GeomField, JointField, LinkField, UNLIMITED, WorldField};
use glam::{DMat3, DVec3};

/// Everything that turns a parameter into lanes.
pub(crate) struct Deriver<'a> {
    pub model: &'a Model,
    pub topology: &'a Topology,
    pub catalogue: &'a Catalogue,
    pub timestep: f64,
    /// Longest command latency that the batch keeps commands for \[s\].
    pub max_latency: f64,
}

impl Deriver<'_> {
    /// Writes what depends on one parameter. `values` are all parameters of the environment.
    ///
    /// # Errors
    /// When a link would lose all its mass, or a latency exceeds what the batch remembers.
    pub fn apply<L: Real>(
        &self,
        acts_on: ActsOn,
        values: &[f64],
        lane: usize,
        block: &mut Block<L>,
    ) -> Result<(), SimError> {
        match acts_on {
            ActsOn::Joint(j, _) => self.joint(j, values, lane, block),
            ActsOn::Link(l, _) => self.link(l, values, lane, block),
            ActsOn::Geom(g, _) => {
                let at = self.catalogue.geoms_at + g * GeomField::COUNT;
                set(&mut block.geoms[g].friction_scale, lane, values[at + GeomField::FrictionScale as usize]);
                set(&mut block.geoms[g].radius_offset, lane, values[at + GeomField::RadiusOffset as usize]);
                Ok(())
            }
            ActsOn::Material(m) => {
                set(&mut block.materials[m], lane, values[self.catalogue.materials_at + m]);
                Ok(())
            }
            ActsOn::World(_) => {
                self.world(values, lane, block);
                Ok(())
            }
        }
    }

    /// Writes everything.
    ///
    /// # Errors
    /// As [`Deriver::apply`].
    pub fn apply_all<L: Real>(&self, values: &[f64], lane: usize, block: &mut Block<L>) -> Result<(), SimError> {
        for info in &self.catalogue.infos {
            // One parameter of each joint, link and shape stands for all of it.
            let first = match info.acts_on {
                ActsOn::Joint(_, f) => f == JointField::Armature,
                ActsOn::Link(_, f) => f == LinkField::MassScale,
                ActsOn::Geom(_, f) => f == GeomField::FrictionScale,
                ActsOn::Material(_) => true,
                ActsOn::World(f) => f == WorldField::Friction,
            };
            if first {
                self.apply(info.acts_on, values, lane, block)?;
            }
        }
        Ok(())
    }

    fn joint<L: Real>(&self, j: usize, values: &[f64], lane: usize, block: &mut Block<L>) -> Result<(), SimError> {
        let at = j * JointField::COUNT;
        let get = |field: JointField| values[at + field as usize];
        let latency = get(JointField::CommandLatency);
        if latency > self.max_latency {
            return Err(SimError::Value {
                what: self.catalogue.infos[at + JointField::CommandLatency as usize].name.clone(),
                expected: format!("at most max_command_latency of the options, {} s", self.max_latency),
                found: latency,
            });
        }
        let dof = self.topology.joint_dof(j);
        set(&mut block.armature[dof], lane, get(JointField::Armature));
        set(&mut block.viscous[dof], lane, get(JointField::Viscous));
        set(&mut block.coulomb[dof], lane, get(JointField::Coulomb));
        let p = &mut block.joints[j];
        set(&mut p.law.strength, lane, get(JointField::Strength));
        set(&mut p.law.asymmetry, lane, get(JointField::StrengthAsymmetry));
        set(&mut p.law.kp_scale, lane, get(JointField::KpScale));
        set(&mut p.law.kd_scale, lane, get(JointField::KdScale));
        set(&mut p.law.torque_limit, lane, get(JointField::TorqueLimit).min(UNLIMITED));
        set(&mut p.law.position_torque_limit, lane, get(JointField::PositionTorqueLimit).min(UNLIMITED));
        let knee = get(JointField::SpeedKnee).min(UNLIMITED);
        set(&mut p.law.speed_knee, lane, knee);
        set(&mut p.law.speed_slope, lane, speed_slope(knee, get(JointField::SpeedZero)));
        set(&mut p.lag_gain, lane, lag_gain(self.timestep, get(JointField::Lag)));
        set(&mut p.latency, lane, latency / self.timestep);
        set(&mut p.law.half_backlash, lane, 0.5 * get(JointField::Backlash));
        set(&mut p.law.compliance, lane, get(JointField::SeriesCompliance));
        set(&mut p.encoder_bias, lane, get(JointField::EncoderBias));
        set(&mut p.external_torque, lane, get(JointField::ExternalTorque));
        set(&mut p.drift, lane, get(JointField::StrengthDrift));
        set(&mut p.constant_torque, lane, get(JointField::ConstantTorque));
        set(&mut p.spring.stiffness, lane, get(JointField::SpringStiffness));
        set(&mut p.spring.rest, lane, get(JointField::SpringRest));
        set(&mut p.spring.slack, lane, get(JointField::SpringSlack));
        block.any_spring |= get(JointField::SpringStiffness) != 0.0 || get(JointField::ConstantTorque) != 0.0;
        let of_servo = [
            (&mut p.servo.stribeck, JointField::StribeckFriction),
            (&mut p.servo.load_motor, JointField::LoadMotor),
            (&mut p.servo.load_external, JointField::LoadExternal),
            (&mut p.servo.stribeck_load_motor, JointField::StribeckLoadMotor),
            (&mut p.servo.stribeck_load_external, JointField::StribeckLoadExternal),
            (&mut p.servo.quadratic_load_motor, JointField::QuadraticLoadMotor),
            (&mut p.servo.quadratic_load_external, JointField::QuadraticLoadExternal),
            (&mut p.servo.drag, JointField::QuadraticDrag),
        ];
        let mut any_servo = false;
        for (target, field) in of_servo {
            set(target, lane, get(field));
            any_servo |= get(field) > 0.0;
        }
        set(&mut p.servo.speed, lane, get(JointField::StribeckSpeed));
        set(&mut p.servo.exponent, lane, get(JointField::StribeckExponent));
        block.any_servo |= any_servo;
        block.any_coulomb |= get(JointField::Coulomb) > 0.0 || any_servo;
        block.any_viscous |= get(JointField::Viscous) > 0.0 || get(JointField::QuadraticDrag) > 0.0;
        block.any_latency |= latency > 0.0;
        block.any_fading |= get(JointField::StrengthDrift) != 0.0;
        block.any_compliance |= get(JointField::SeriesCompliance) > 0.0;
        Ok(())
    }

    fn link<L: Real>(&self, l: usize, values: &[f64], lane: usize, block: &mut Block<L>) -> Result<(), SimError> {
        let body = self.link_mass(l, values);
        if body.mass <= 0.0 && self.model.links[l].mass > 0.0 {
            return Err(SimError::Value {
                what: format!("mass of link `{}` with its payload", self.model.links[l].name),
                expected: "more than 0 kg".into(),
                found: body.mass,
            });
        }
        set(&mut block.mass[l], lane, body.mass);
        let at = self.catalogue.links_at + l * LinkField::COUNT;
        set(&mut block.length[l], lane, values[at + LinkField::LengthScale as usize]);
        for k in 0..3 {
            set(&mut block.com[l][k], lane, body.com[k]);
        }
        let i = body.inertia;
        let entries = [i.x_axis.x, i.y_axis.y, i.z_axis.z, i.x_axis.y, i.x_axis.z, i.y_axis.z];
        for k in 0..6 {
            set(&mut block.inertia[l][k], lane, entries[k]);
        }
        Ok(())
    }

    /// The link as scaled and shifted, welded to its payload.
    fn link_mass(&self, l: usize, values: &[f64]) -> MassProperties {
        let at = self.catalogue.links_at + l * LinkField::COUNT;
        let get = |field: LinkField| values[at + field as usize];
        let link = &self.model.links[l];
        let (scale, length) = (get(LinkField::MassScale), get(LinkField::LengthScale));
        let vector = |x, y, z| DVec3::new(get(x), get(y), get(z));
        let own = MassProperties {
            mass: link.mass * scale,
            com: link.com * length + vector(LinkField::ComX, LinkField::ComY, LinkField::ComZ),
            inertia: link.inertia * (scale * get(LinkField::InertiaScale)),
        };
        let payload = Payload {
            mass: get(LinkField::PayloadMass),
            at: link.com * length + vector(LinkField::PayloadX, LinkField::PayloadY, LinkField::PayloadZ),
            moment: vector(LinkField::PayloadMomentX, LinkField::PayloadMomentY, LinkField::PayloadMomentZ),
        };
        payload.on(&own)
    }

    fn world<L: Real>(&self, values: &[f64], lane: usize, block: &mut Block<L>) {
        use WorldField::*;
        let get = |field: WorldField| values[self.catalogue.world_at + field as usize];
        set(&mut block.supply.start, lane, get(RunStart));
        set(&mut block.supply.sag, lane, get(SupplySag));
        block.any_fading |= get(SupplySag) > 0.0;
        block.any_weakening |= get(FrictionDrop) > 0.0;
        block.any_sinking |= get(YieldForce) < UNLIMITED && get(SinkRate) > 0.0;
        let ground = &mut block.ground;
        set(&mut ground.friction, lane, get(Friction));
        set(&mut ground.yield_force, lane, get(YieldForce));
        set(&mut ground.sink_rate, lane, get(SinkRate));
        // No more than all of it can be gone.
        set(&mut ground.drop, lane, get(FrictionDrop).min(1.0));
        set(&mut ground.drop_speed, lane, get(FrictionSpeed));
        let (time_constant, damping_ratio) =
            contact_response(get(TimeConstant), get(DampingRatio), get(Restitution), self.timestep);
        let most = super::constraint::IMPEDANCE_MAX;
        let frequency = 1.0 / (most * time_constant * damping_ratio);
        set(&mut ground.stiffness, lane, frequency * frequency);
        set(&mut ground.damping, lane, 2.0 / (most * time_constant));
        set(&mut ground.torsional, lane, get(Torsional));
        set(&mut ground.rolling, lane, get(Rolling));
        set(&mut ground.height, lane, get(Height));
        // Rising along x is a turn about -y, rising along y one about x.
        let tilt = DMat3::from_rotation_y(-get(SlopeX)) * DMat3::from_rotation_x(get(SlopeY));
        for (k, value) in tilt.transpose().to_cols_array().into_iter().enumerate() {
            set(&mut ground.tilt[k], lane, value);
        }
        for (k, field) in [PatchXMin, PatchXMax, PatchYMin, PatchYMax].into_iter().enumerate() {
            set(&mut ground.patch[k], lane, get(field));
        }
        set(&mut ground.patch_friction, lane, get(PatchFriction));
        for (k, field) in [ForceX, ForceY, ForceZ].into_iter().enumerate() {
            set(&mut ground.force[k], lane, get(field));
        }
        set(&mut ground.force_start, lane, get(ForceStart));
        set(&mut ground.force_end, lane, get(ForceStart) + get(ForceDuration));
    }
}

/// Time constant and damping ratio in force: at least two steps long, and with the damping that gives the restitution
/// at the same stiffness.
fn contact_response(time_constant: f64, damping_ratio: f64, restitution: f64, timestep: f64) -> (f64, f64) {
    let (time_constant, ratio) = if restitution > 0.0 {
        let ratio = damping_for_restitution(restitution);
        (time_constant * damping_ratio / ratio, ratio)
    } else {
        (time_constant, damping_ratio)
    };
    (time_constant.max(2.0 * timestep), ratio)
}

/// Damping ratio of a spring and damper that never pulls and returns `restitution` of the impact speed
/// (Schwager and Pöschel, Granular Matter 9, 2007, eq. 21), by bisection.
fn damping_for_restitution(restitution: f64) -> f64 {
    let rebound = |ratio: f64| {
        let root = (1.0 - ratio * ratio).sqrt();
        // Phase at which the force falls to zero.
        let phase = (2.0 * ratio * root).atan2(2.0 * ratio * ratio - 1.0);
        (-ratio / root * phase).exp()
    };
    let (mut low, mut high) = (1e-6, 1.0 - 1e-6);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if rebound(middle) > restitution {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damping_falls_with_restitution() {
        let values: Vec<f64> = [0.1, 0.5, 0.9].into_iter().map(damping_for_restitution).collect();
        assert!(values[0] > values[1] && values[1] > values[2]);
        assert!((values[2] - 0.1 / std::f64::consts::PI).abs() < 0.01, "{values:?}");
    }
}
