//! Torques that the simulator's parameters lack, as a sum of known shapes for each joint: friction that falls with speed, friction that
//! grows with load, drag, saturation, springs. Linear in its numbers, so that few recordings suffice, and behind the motors' latency.

use crate::velocity::TaskRobot;
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
pub const TURN: f32 = 0.3;
/// Speed to which friction near rest reaches \[rad/s\].
pub const NEAR_REST: f32 = 1.5;

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

/// The sum of shapes at each joint, to be added to a simulator's torques behind the motors' latency and lag.
#[derive(Debug, Clone)]
pub struct ShapeTorques {
    /// Joint angles of the stand \[rad\].
    pub stand: Vec<f32>,
    /// Largest torque that is added \[N m\], `[joints]`.
    pub most: Vec<f32>,
    /// Numbers `[joints][shapes]`, of all environments; or `[environments][joints][shapes]`.
    pub numbers: Vec<f32>,
}

impl ShapeTorques {
    /// Of a robot.
    pub fn new(robot: &TaskRobot, numbers: Vec<f32>) -> Self {
        Self { stand: robot.stand.clone(), most: vec![robot.torque_scale(); robot.joints()], numbers }
    }

    /// Writes the torques of all environments, `[environments][joints]` \[N m\]. Positions are `[environments][7 + joints]`, velocities
    /// `[environments][6 + joints]`, as a [`qv_sim::Batch`] has them; `torques` are those that the motors delivered in the last physics step.
    pub fn write(&self, positions: &[f32], velocities: &[f32], torques: &[f32], added: &mut [f32]) {
        let joints = self.stand.len();
        let own = joints * SHAPES.len();
        let is_shared = self.numbers.len() == own;
        let rows = added.par_chunks_exact_mut(joints).with_min_len(64).enumerate();
        rows.for_each(|(env, added)| {
            let numbers = if is_shared { &self.numbers[..] } else { &self.numbers[env * own..][..own] };
            let q = &positions[env * (7 + joints) + 7..];
            let v = &velocities[env * (6 + joints) + 6..];
            for j in 0..joints {
                let shapes = shapes(q[j] - self.stand[j], v[j], torques[env * joints + j]);
                let sum: f32 = shapes.iter().zip(&numbers[j * SHAPES.len()..]).map(|(s, n)| s * n).sum();
                added[j] = sum.clamp(-self.most[j], self.most[j]);
            }
        });
    }
}
