//! Torques that the simulator's parameters lack, as a sum of known shapes for each joint: friction that falls with speed, friction that
//! grows with load, drag, saturation, springs. Linear in its numbers, so that few recordings suffice, and behind the motors' latency.

use qv_policy::compensate::{Compensator, SimulatedStates};
use rayon::prelude::*;

/// Shapes of a joint's torque: name and unit of the number before it. `s` is a smooth sign of the speed, odd and within -1 to 1.
pub const SHAPES: [(&str, &str); 6] = [
    // Stribeck 1902: more friction near rest than in motion.
    ("friction near rest, against the motion", "N m"),
    // Gears bear more on their teeth under load (Rhoban's BAM models m2 to m6).
    ("friction in proportion to the motor's torque", "1"),
    ("drag of squared speed", "N m s²/rad²"),
    ("torque of squared torque: saturation", "1/(N m)"),
    ("constant torque", "N m"),
    ("spring about the stand", "N m/rad"),
];

/// Speed within which a friction turns over \[rad/s\]: torques are held for a physics step of 5 ms, and a stiffer law would throw a light
/// joint past rest.
pub(crate) const TURN: f32 = 0.3;
/// Speed to which friction near rest reaches \[rad/s\].
pub(crate) const NEAR_REST: f32 = 1.5;

/// Smooth sign.
fn sign(x: f32) -> f32 {
    x / (1.0 + x * x).sqrt()
}

/// The shapes at one joint's angle from the stand \[rad\], speed \[rad/s\] and motor torque \[N m\].
pub fn shapes(off: f32, speed: f32, torque: f32) -> [f32; SHAPES.len()] {
    let against = -sign(speed / TURN);
    let near = 1.0 / (1.0 + (speed / NEAR_REST).powi(2));
    [against * near, against * torque.abs(), -speed * speed.abs(), -torque * torque.abs(), 1.0, -off]
}

/// The sum of shapes as a compensator.
#[derive(Debug, Clone)]
pub struct BasisTorque {
    /// Joint angles of the stand \[rad\].
    pub stand: Vec<f32>,
    /// Largest torque that is added \[N m\], `[joints]`.
    pub most: Vec<f32>,
    /// Numbers `[joints][shapes]`, of all environments; or `[environments][joints][shapes]`.
    pub numbers: Vec<f32>,
}

impl Compensator for BasisTorque {
    fn begin(&mut self, _env: usize) {}

    fn move_targets(&mut self, _seen: &SimulatedStates, _sent: &mut [f32]) {}

    fn adds_torques(&self) -> bool {
        true
    }

    fn add_torques(&mut self, seen: &SimulatedStates, added: &mut [f32]) {
        let joints = self.stand.len();
        let own = joints * SHAPES.len();
        let is_shared = self.numbers.len() == own;
        let rows = added.par_chunks_exact_mut(joints).with_min_len(64).enumerate();
        rows.for_each(|(env, added)| {
            let numbers = if is_shared { &self.numbers[..] } else { &self.numbers[env * own..][..own] };
            let q = &seen.q[env * (7 + joints) + 7..];
            let v = &seen.v[env * (6 + joints) + 6..];
            for j in 0..joints {
                let shapes = shapes(q[j] - self.stand[j], v[j], seen.torques[env * joints + j]);
                let sum: f32 = shapes.iter().zip(&numbers[j * SHAPES.len()..]).map(|(s, n)| s * n).sum();
                added[j] = sum.clamp(-self.most[j], self.most[j]);
            }
        });
    }

    fn for_count(&self, _count: usize) -> Box<dyn Compensator> {
        let own = self.stand.len() * SHAPES.len();
        Box::new(Self { numbers: self.numbers[..own].to_vec(), ..self.clone() })
    }
}
