//! Effects that no library has as they are here: outside forces and torques, fading motors, lost commands.

use crate::plant::Plant;
use crate::scout::Scout;
use qv_core::random::SplitMix64;
use qv_go2::messages::LowCmd;
use qv_go2::model::{JOINT_NAMES, STAND};
use qv_sim::SimError;
use std::f64::consts::TAU;

/// Names of the withheld effects.
pub const WITHHELD: [&str; 9] = [
    "tether",
    "torque_ripple",
    "stribeck_friction",
    "parallel_spring",
    "squared_drag",
    "thermal_derating",
    "load_friction",
    "dropped_commands",
    "periodic_side_force",
];

/// One withheld effect with its sizes. Those of joints act on all of `joints`.
#[derive(Debug, Clone, PartialEq)]
pub struct Withheld {
    /// Name out of [`WITHHELD`].
    pub name: &'static str,
    /// Joints that it acts on, in joint order; empty for what acts on the trunk or on commands.
    pub joints: Vec<usize>,
    /// Names, values and units of its sizes.
    pub sizes: Vec<(&'static str, f64, &'static str)>,
    /// Seed of its phases, or of its bursts.
    pub seed: u64,
}

/// Effects of a library that are close relatives: naming one of them describes the withheld effect in part.
fn relatives(name: &str) -> &'static [&'static str] {
    match name {
        "tether" | "periodic_side_force" => &["external_force"],
        "stribeck_friction" | "load_friction" => &["joint_coulomb_friction", "external_torque"],
        "squared_drag" => &["joint_viscous_friction", "external_torque"],
        "torque_ripple" | "parallel_spring" => &["external_torque"],
        "thermal_derating" => &["motor_strength", "strength_drift", "supply_sag"],
        "dropped_commands" => &["command_latency"],
        _ => &[],
    }
}

impl Withheld {
    /// Effects of the library that describe it in part.
    pub fn relatives(&self) -> &'static [&'static str] {
        relatives(self.name)
    }

    fn size(&self, name: &str) -> f64 {
        self.sizes.iter().find(|(n, ..)| *n == name).map_or(0.0, |(_, value, _)| *value)
    }

    /// Draws the sizes; `None` for a name that is not in [`WITHHELD`], or when the motion does not bring the effect out.
    pub(crate) fn drawn(name: &str, draws: &mut SplitMix64, scout: &Scout) -> Option<Self> {
        let name = WITHHELD.into_iter().find(|known| *known == name)?;
        let on_trunk = matches!(name, "tether" | "periodic_side_force" | "dropped_commands");
        let joints = if on_trunk { Vec::new() } else { some_joints(draws) };
        let sizes = match name {
            "tether" => {
                // Nothing pulls at a robot that does not leave.
                let reach = scout.reach();
                if reach < 0.4 {
                    return None;
                }
                vec![("stiffness", draws.between(10.0, 20.0) / reach, "N/m")]
            }
            "torque_ripple" => {
                let periods = [8.0, 12.0, 16.0, 24.0][draws.index(4)];
                vec![("amplitude", draws.between(0.8, 2.0), "N m"), ("per_radian", periods, "1/rad")]
            }
            "stribeck_friction" => {
                vec![("torque", draws.between(0.7, 1.5), "N m"), ("speed", draws.between(0.5, 1.5), "rad/s")]
            }
            "parallel_spring" => {
                let rest = draws.sign() * draws.between(0.1, 0.4);
                vec![("stiffness", draws.between(3.0, 7.0), "N m/rad"), ("rest", rest, "rad")]
            }
            "squared_drag" => {
                let fast = scout.quantile(&scout.speed, &joints, 0.95).max(1.0);
                vec![("drag", draws.between(1.5, 4.0) / (fast * fast), "N m s²/rad²")]
            }
            "thermal_derating" => {
                vec![("loss", draws.between(0.25, 0.45), "1"), ("time_constant", draws.between(5.0, 12.0), "s")]
            }
            "load_friction" => vec![("ratio", draws.between(0.1, 0.22), "1")],
            "dropped_commands" => {
                vec![("rate", draws.between(1.5, 4.0), "1/s"), ("longest", draws.between(0.06, 0.12), "s")]
            }
            _ => vec![("amplitude", draws.between(10.0, 20.0), "N"), ("frequency", draws.between(0.4, 1.2), "Hz")],
        };
        Some(Self { name, joints, sizes, seed: (draws.uniform() * 1e15) as u64 })
    }
}

/// All joints, those of one kind, or those of one leg.
fn some_joints(draws: &mut SplitMix64) -> Vec<usize> {
    let (which, kind, leg) = (draws.uniform(), 1 + draws.index(2), draws.index(4));
    let within = |j: &usize| {
        if which < 0.6 {
            true
        } else if which < 0.8 {
            j % 3 == kind
        } else {
            j / 3 == leg
        }
    };
    (0..12).filter(within).collect()
}

/// A withheld effect at work on a plant.
pub(crate) struct Disturbance<'a> {
    effect: &'a Withheld,
    timestep: f64,
    draws: SplitMix64,
    phases: [f64; 12],
    /// Catalogue indices of external torques, of strengths and of the external force.
    torques: Vec<usize>,
    strengths: Vec<usize>,
    force: Vec<usize>,
    /// Where the base was when the effect began \[m\].
    anchor: Option<[f64; 2]>,
    /// Until when a command is held \[s\], and the one that is.
    held_until: f64,
    held: Option<LowCmd>,
}

impl<'a> Disturbance<'a> {
    /// # Errors
    /// When the plant lacks a parameter that the effect acts through.
    pub fn new(effect: &'a Withheld, plant: &Plant, timestep: f64) -> Result<Self, SimError> {
        let mut draws = SplitMix64::new(effect.seed);
        let of_joints = |prefix: &str, end: &str| {
            let all = effect.joints.iter().map(|&j| plant.index(&format!("{prefix}.{}.{end}", JOINT_NAMES[j])));
            all.collect::<Result<Vec<_>, _>>()
        };
        let phases = std::array::from_fn(|_| draws.between(0.0, TAU));
        Ok(Self {
            effect,
            timestep,
            phases,
            torques: of_joints("joint", "external_torque")?,
            strengths: of_joints("actuator", "strength")?,
            force: ["external.force_x", "external.force_y"]
                .map(|n| plant.index(n))
                .into_iter()
                .collect::<Result<_, _>>()?,
            anchor: None,
            held_until: f64::NEG_INFINITY,
            held: None,
            draws,
        })
    }

    /// What reaches the motors of a command that was sent at `time` \[s\] of the recording.
    pub(crate) fn arriving(&mut self, time: f64, sent: LowCmd) -> LowCmd {
        if self.effect.name != "dropped_commands" {
            return sent;
        }
        if time >= self.held_until {
            // A burst begins in this interval of 2 ms with the probability that its rate says.
            if self.draws.chance(0.002 * self.effect.size("rate")) {
                self.held_until = time + self.effect.size("longest") * self.draws.between(0.4, 1.0);
            } else {
                self.held = Some(sent);
            }
        }
        self.held.unwrap_or(sent)
    }

    /// Sets the outside forces, torques and strengths of the coming step, at `time` \[s\] of the recording.
    ///
    /// # Errors
    /// When a value means nothing, as when the numbers have run away.
    pub fn act(&mut self, plant: &mut Plant, time: f64) -> Result<(), SimError> {
        match self.effect.name {
            "dropped_commands" => Ok(()),
            "tether" | "periodic_side_force" => self.pull(plant, time),
            "thermal_derating" => {
                let lost = self.effect.size("loss") * (1.0 - (-time / self.effect.size("time_constant")).exp());
                self.strengths.iter().try_for_each(|&id| plant.set(id, 1.0 - lost))
            }
            _ => self.twist(plant),
        }
    }

    fn pull(&mut self, plant: &mut Plant, time: f64) -> Result<(), SimError> {
        let q = plant.state()?.q;
        let anchor = *self.anchor.get_or_insert([q[0], q[1]]);
        let [x, y] = match self.effect.name {
            "tether" => [0, 1].map(|axis| self.effect.size("stiffness") * (anchor[axis] - q[axis])),
            _ => {
                let push = self.effect.size("amplitude") * (TAU * self.effect.size("frequency") * time).sin();
                // Sideways as the robot sees it.
                let yaw = (2.0 * (q[3] * q[6] + q[4] * q[5])).atan2(1.0 - 2.0 * (q[5] * q[5] + q[6] * q[6]));
                [-push * yaw.sin(), push * yaw.cos()]
            }
        };
        plant.set(self.force[0], x)?;
        plant.set(self.force[1], y)
    }

    fn twist(&mut self, plant: &mut Plant) -> Result<(), SimError> {
        let state = plant.state()?;
        // Only this one asks what the motors did.
        let motor = if self.effect.name == "load_friction" { plant.sensors()?.tau } else { vec![0.0; 12] };
        for (i, &joint) in self.effect.joints.iter().enumerate() {
            let torque = self.torque(joint, state.q[7 + joint], state.v[6 + joint], motor[joint]);
            plant.set(self.torques[i], torque)?;
        }
        Ok(())
    }

    /// Outside torque \[N m\] on a joint at an angle and a speed, with the motor's torque.
    fn torque(&self, joint: usize, q: f64, dq: f64, motor: f64) -> f64 {
        let size = |name| self.effect.size(name);
        // Friction turns over within this speed: a torque given step by step must not throw the joint past rest.
        let against = |most: f64| {
            const LIGHTEST: f64 = 0.016;
            let narrow = (2.0 * most.abs() * self.timestep / LIGHTEST).max(0.05);
            -most.abs() * (dq / narrow).tanh()
        };
        match self.effect.name {
            "torque_ripple" => size("amplitude") * (size("per_radian") * q + self.phases[joint]).sin(),
            "stribeck_friction" => against(size("torque") * (-(dq / size("speed")).powi(2)).exp()),
            "parallel_spring" => size("stiffness") * (STAND[joint] + size("rest") - q),
            "squared_drag" => {
                // No more than stops the joint within a few steps, at speeds that no motor reaches.
                let stopping = 0.004 * dq.abs() / self.timestep;
                -dq.signum() * (size("drag") * dq * dq).min(stopping)
            }
            _ => against(size("ratio") * motor),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Engine;

    fn effect(name: &'static str, sizes: &[(&'static str, f64)]) -> Withheld {
        let sizes = sizes.iter().map(|(name, value)| (*name, *value, "")).collect();
        Withheld { name, joints: (0..12).collect(), sizes, seed: 3 }
    }

    fn plant() -> Plant {
        let engine = Engine::Ours { timestep: 0.001, impratio: 10.0, contact_dimension: 3, time_constant: 0.008 };
        Plant::new(&engine, &[]).unwrap()
    }

    #[test]
    fn frictions_oppose_motion_and_vanish_at_rest() {
        let plant = plant();
        for (name, sizes) in [
            ("stribeck_friction", vec![("torque", 1.0), ("speed", 1.0)]),
            ("squared_drag", vec![("drag", 0.1)]),
            ("load_friction", vec![("ratio", 0.2)]),
        ] {
            let effect = effect(name, &sizes);
            let acting = Disturbance::new(&effect, &plant, 0.001).unwrap();
            let at = |dq: f64| acting.torque(1, 0.8, dq, 5.0);
            assert_eq!(at(0.0), 0.0, "{name}");
            assert!(at(0.5) < 0.0 && at(-0.5) == -at(0.5), "{name}: {}", at(0.5));
        }
        let falling = effect("stribeck_friction", &[("torque", 1.0), ("speed", 1.0)]);
        let acting = Disturbance::new(&falling, &plant, 0.001).unwrap();
        assert!(acting.torque(1, 0.8, 3.0, 0.0).abs() < 0.01 * acting.torque(1, 0.8, 0.5, 0.0).abs());
    }

    #[test]
    fn ripple_repeats_and_a_spring_pulls_to_its_rest() {
        let plant = plant();
        let ripple = effect("torque_ripple", &[("amplitude", 2.0), ("per_radian", 10.0)]);
        let acting = Disturbance::new(&ripple, &plant, 0.001).unwrap();
        let at = |q: f64| acting.torque(4, q, 0.0, 0.0);
        assert!((at(0.3) - at(0.3 + TAU / 10.0)).abs() < 1e-9 && (at(0.3) + at(0.3 + TAU / 20.0)).abs() < 1e-9);
        let spring = effect("parallel_spring", &[("stiffness", 4.0), ("rest", 0.2)]);
        let acting = Disturbance::new(&spring, &plant, 0.001).unwrap();
        assert!((acting.torque(1, STAND[1], 0.0, 0.0) - 0.8).abs() < 1e-12);
    }

    #[test]
    fn held_commands_come_in_bursts() {
        let effect = effect("dropped_commands", &[("rate", 3.0), ("longest", 0.1)]);
        let mut acting = Disturbance::new(&effect, &plant(), 0.001).unwrap();
        let (mut held, mut bursts, mut before) = (0, 0, false);
        for k in 0..10_000u32 {
            let sent = LowCmd { q: [f64::from(k); 12], ..Default::default() };
            let late = acting.arriving(0.002 * f64::from(k), sent).q[0] != sent.q[0];
            bursts += u32::from(late && !before);
            held += u32::from(late);
            before = late;
        }
        // 20 s at 3 a second, each of 70 ms on average.
        assert!((30..70).contains(&bursts), "{bursts}");
        assert!((900..3200).contains(&held), "{held}");
    }

    #[test]
    fn a_tether_pulls_back_and_heat_weakens() {
        let mut plant = plant();
        let tether = effect("tether", &[("stiffness", 20.0)]);
        let mut acting = Disturbance::new(&tether, &plant, 0.001).unwrap();
        acting.anchor = Some([-0.5, 0.0]);
        acting.act(&mut plant, 1.0).unwrap();
        let hot = effect("thermal_derating", &[("loss", 0.4), ("time_constant", 1.0)]);
        Disturbance::new(&hot, &plant, 0.001).unwrap().act(&mut plant, 10.0).unwrap();
        let sim = match &plant {
            Plant::Ours(sim) => sim,
            #[cfg(feature = "rapier")]
            Plant::Second(_) => panic!("made with our engine"),
        };
        assert!((sim.parameter(0, "external.force_x").unwrap() + 10.0).abs() < 1e-9);
        assert!((sim.parameter(0, "actuator.FL_hip_joint.strength").unwrap() - 0.6).abs() < 1e-3);
    }
}
