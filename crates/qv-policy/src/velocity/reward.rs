//! The terms of the reward, one robot at a time.

use super::settings::Reward;
use super::walker::Walker;

/// Names of the terms, in the order in which a step has them.
pub const TERMS: [&str; 24] = [
    "velocity",
    "turning",
    "bounce",
    "sway",
    "tilt",
    "height",
    "torque",
    "acceleration",
    "action_rate",
    "action_jerk",
    "pose",
    "air_time",
    "duty_variance",
    "landing",
    "contact_forces",
    "power",
    "clearance",
    "slip",
    "pairs",
    "clock",
    "limbs",
    "still",
    "steady",
    "fall",
];

/// Weighted terms of one step of one robot \[1/s\].
pub type Terms = [f32; TERMS.len()];

/// What the terms read of one robot after a step; world axes unless it says otherwise.
pub struct RewardInput<'a> {
    /// Velocity of the base, heading axes \[m/s\].
    pub velocity: [f32; 3],
    /// Angular velocity of the base, its axes \[rad/s\].
    pub turning: [f32; 3],
    /// Direction of gravity in the base.
    pub gravity: [f32; 3],
    /// Height of the base over the ground \[m\].
    pub height: f32,
    /// Joint angles \[rad\].
    pub q: &'a [f32],
    /// Joint speeds \[rad/s\].
    pub dq: &'a [f32],
    /// Joint torques \[N m\].
    pub torques: &'a [f32],
    /// The action of this step.
    pub action: &'a [f32],
    /// Heights of the feet's lowest points over the ground \[m\].
    pub feet_height: &'a [f32],
    /// Horizontal speeds of the feet \[m/s\].
    pub feet_speed: &'a [f32],
    /// Which feet touch.
    pub touching: &'a [bool],
    /// Seconds by which swings and stances of the feet went outside their bounds in this step, summed.
    pub outside: f32,
    /// Speeds downwards of the feet that landed, summed \[m/s\].
    pub landing: f32,
    /// Phase of the clock in this step, where there is one: 0 to 1.
    pub phase: Option<f32>,
    /// Peak forces on the feet in this step, in body weights.
    pub peaks: &'a [f32],
    /// Limbs that touch.
    pub limbs: usize,
    /// Whether the robot fell.
    pub fell: bool,
}

/// The robot's own measures, see [`super::TaskRobot`].
pub struct Measures<'a> {
    /// Joint angles of the stand \[rad\].
    pub stand: &'a [f32],
    /// Joints that move legs sideways.
    pub sideways: &'a [bool],
    /// Height of the base in the stand \[m\].
    pub height: f32,
    /// \[N m\]
    pub torque: f32,
    /// \[N\]
    pub weight: f32,
}

fn squared(values: impl Iterator<Item = f32>) -> f32 {
    values.map(|x| x * x).sum()
}

/// All terms of a step of `dt` seconds.
pub fn terms(reward: &Reward, measures: &Measures, seen: &RewardInput, walker: &Walker, dt: f32) -> Terms {
    let [vx, vy, wz] = walker.command;
    let off = (seen.velocity[0] - vx).powi(2) + (seen.velocity[1] - vy).powi(2);
    let turn_off = (seen.turning[2] - wz).powi(2);
    let standing = walker.stands();
    let pairs = seen.action.iter().zip(&walker.action);
    let jerk = pairs.clone().zip(&walker.action_before).map(|((now, last), before)| now - 2.0 * last + before);
    let pose = seen.q.iter().zip(measures.stand).zip(measures.sideways).map(|((q, stand), &sideways)| {
        let weight = if sideways || standing { 1.0 } else { 0.2 };
        weight * (q - stand) * (q - stand)
    });
    let power: f32 = seen.torques.iter().zip(seen.dq).map(|(torque, speed)| (torque * speed).abs()).sum();
    let forces = seen.peaks.iter().map(|peak| (peak - reward.max_contact_force).max(0.0));
    let target = reward.clearance_height * measures.height;
    let clearance = (0..seen.touching.len()).filter(|&f| !seen.touching[f]).map(|f| {
        let miss = (seen.feet_height[f] - target) / measures.height;
        miss * miss * seen.feet_speed[f]
    });
    let slip = (0..seen.touching.len()).filter(|&f| seen.touching[f]).map(|f| seen.feet_speed[f] * seen.feet_speed[f]);
    let feet_up = seen.touching.iter().filter(|&&t| !t).count() as f32;
    let still = feet_up + 0.02 * squared(seen.dq.iter().copied());
    let [ahead, aside, turn] = walker.strayed;
    let near = |off: f32| 1.0 / (1.0 + off / (reward.steady_width * reward.steady_width));
    let steady = near(ahead * ahead + aside * aside) + near(turn * turn);
    let moving = |x: f32| if standing { 0.0 } else { x };
    [
        reward.velocity * (-off / reward.velocity_width).exp(),
        reward.turning * (-turn_off / reward.turning_width).exp(),
        -reward.bounce * seen.velocity[2] * seen.velocity[2],
        -reward.sway * squared(seen.turning[..2].iter().copied()),
        -reward.tilt * squared(seen.gravity[..2].iter().copied()),
        -reward.height * (seen.height / measures.height - 1.0).powi(2),
        -reward.torque * squared(seen.torques.iter().map(|t| t / measures.torque)),
        -reward.acceleration * squared(seen.dq.iter().zip(&walker.dq).map(|(now, last)| (now - last) / dt)),
        -reward.action_rate * squared(pairs.map(|(now, last)| now - last)),
        -reward.action_jerk * squared(jerk),
        -reward.pose * pose.sum::<f32>(),
        -reward.air_time * seen.outside,
        -reward.duty_variance * moving(variance(&walker.duty)),
        -reward.landing * seen.landing,
        -reward.contact_forces * forces.sum::<f32>(),
        -reward.power * power / measures.weight,
        -reward.clearance * clearance.sum::<f32>(),
        -reward.slip * slip.sum::<f32>(),
        -reward.pairs * moving(apart(seen.touching)),
        -reward.clock * moving(seen.phase.map_or(0.0, |phase| off_beat(seen.touching, phase, reward.clock_duty))),
        -reward.limbs * seen.limbs as f32,
        if standing { -reward.still * still } else { 0.0 },
        reward.steady * steady,
        if seen.fell { -reward.fall / dt } else { 0.0 },
    ]
}

fn variance(values: &[f32]) -> f32 {
    let count = values.len().max(1) as f32;
    let mean = values.iter().sum::<f32>() / count;
    values.iter().map(|x| (x - mean) * (x - mean)).sum::<f32>() / count
}

/// Pairs of legs across (first and last, second and third) that are not together; none for robots without four legs.
fn apart(touching: &[bool]) -> f32 {
    match touching {
        [a, b, c, d] => f32::from(a != d) + f32::from(b != c),
        _ => 0.0,
    }
}

/// Feet that are on the ground where the clock has them swing, or off it where it has them stand; none for robots without four legs. The first
/// and the last foot stand for the first `duty` of a stride, the other two half a stride later.
fn off_beat(touching: &[bool], phase: f32, duty: f32) -> f32 {
    let stands = |offset: f32| (phase + offset).fract() < duty;
    match touching {
        [a, b, c, d] => {
            let off = |touching: &[&bool], offset: f32| touching.iter().filter(|t| ***t != stands(offset)).count();
            (off(&[a, d], 0.0) + off(&[b, c], 0.5)) as f32
        }
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::off_beat;

    #[test]
    fn feet_across_stand_together_half_a_stride_from_the_others() {
        let trot = [true, false, false, true];
        assert_eq!(off_beat(&trot, 0.25, 0.55), 0.0);
        assert_eq!(off_beat(&trot, 0.75, 0.55), 4.0);
        // Both pairs stand for a twentieth of a stride.
        assert_eq!(off_beat(&[true; 4], 0.52, 0.55), 0.0);
        assert_eq!(off_beat(&[true; 4], 0.25, 0.55), 2.0);
        assert_eq!(off_beat(&[false; 4], 0.25, 0.55), 2.0);
        assert_eq!(off_beat(&[true, false], 0.25, 0.55), 0.0, "two legs have no trot");
    }
}
