//! What one robot did in a step: reward, end, and what is remembered of it.

use super::readings::Readings;
use super::reward::{Measures, RewardInput, Terms, terms};
use super::robot::MOST_FEET;
use super::turns::{in_heading, turned_back};
use super::{Commands, Ground, Reward, TaskRobot, TaskSettings, Walker};
use crate::env::End;
use qv_sim::Batch;

/// Force from which a shape counts as touching \[N\]: a thousandth of a small robot's weight, above the noise of single precision.
const TOUCH: f32 = 0.1;

/// What one robot did in a step, for the sums.
#[derive(Debug, Clone, Copy)]
pub(super) struct Outcome {
    pub terms: Terms,
    pub velocity_error: f32,
    pub turning_error: f32,
    pub feet: [f32; 3],
}

/// What judging a robot reads, the same for all.
pub(super) struct Judge<'a> {
    pub robot: &'a TaskRobot,
    pub settings: &'a TaskSettings,
    pub reward: &'a Reward,
    pub ground: &'a Ground,
    pub batch: &'a Batch<f32>,
    pub read: &'a Readings,
    pub judged: bool,
    pub commands: &'a Commands,
    pub torque: f32,
    pub weight: f32,
    pub foot_radius: Vec<f32>,
    pub length: u32,
}

impl Judge<'_> {
    /// Reward and end of one robot's step, and what it remembers of it.
    pub fn judge(&self, env: usize, action: &[f32], walker: &mut Walker) -> (Outcome, End) {
        let (joints, feet) = (self.robot.joints(), self.robot.feet.len());
        let geoms = self.robot.model.geoms.len();
        let dt = self.settings.dt();
        let q = &self.read.q[env * (7 + joints)..][..7 + joints];
        let v = &self.read.v[env * (6 + joints)..][..6 + joints];
        let turn = [q[3], q[4], q[5], q[6]];
        let ground = self.ground.height(q[0], q[1], q[2]);
        walker.ground = ground.unwrap_or(walker.ground);
        let height = q[2] - walker.ground;
        let gravity = turned_back(turn, [0.0, 0.0, -1.0]);
        let velocity = in_heading(turn, [v[0], v[1], v[2]]);
        let feet_seen = self.see_feet(env, walker);
        let on = |shapes: &[usize]| shapes.iter().filter(|&&g| touches(&self.read.forces, geoms, env, g)).count();
        let ends = &self.settings.ends;
        let faulty = self.batch.is_faulty(env).unwrap_or(true);
        let tilted = -gravity[2] < ends.tilt.cos();
        let low = height < ends.height * self.robot.height;
        let fell = faulty || tilted || low || (ends.trunk && on(&self.robot.trunk) > 0);
        let seen = RewardInput {
            velocity,
            turning: [v[3], v[4], v[5]],
            gravity,
            height,
            q: &q[7..],
            dq: &v[6..],
            torques: &self.read.torques[env * joints..][..joints],
            action,
            feet_height: &feet_seen.height[..feet],
            feet_speed: &feet_seen.speed[..feet],
            touching: &feet_seen.touching[..feet],
            outside: feet_seen.outside,
            landing: feet_seen.landing,
            phase: (self.settings.clock > 0.0).then(|| walker.phase(self.settings.clock, dt)),
            peaks: &feet_seen.peaks[..feet],
            limbs: on(&self.robot.limbs),
            fell,
        };
        let measures = Measures {
            stand: &self.robot.stand,
            sideways: &self.robot.sideways,
            height: self.robot.height,
            torque: self.torque,
            weight: self.weight,
        };
        let off = [velocity[0] - walker.command[0], velocity[1] - walker.command[1], v[5] - walker.command[2]];
        let share = (dt / self.reward.steady_time).min(1.0);
        (0..3).for_each(|k| walker.strayed[k] += share * (off[k] - walker.strayed[k]));
        let terms = terms(self.reward, &measures, &seen, walker, dt);
        let [vx, vy, wz] = walker.command;
        let outcome = Outcome {
            terms,
            velocity_error: (velocity[0] - vx).hypot(velocity[1] - vy),
            turning_error: (v[5] - wz).abs(),
            feet: feet_seen.landings,
        };
        walker.action_before.copy_from_slice(&walker.action);
        walker.action.copy_from_slice(action);
        walker.dq.copy_from_slice(&v[6..]);
        walker.steps += 1;
        walker.asked += vx.hypot(vy) * dt;
        walker.went += velocity[0].hypot(velocity[1]) * dt;
        let end = if fell {
            End::Failed
        } else if walker.steps >= self.length || ground.is_none() {
            // Who walks off the ground did not fall.
            End::TimeOut
        } else {
            End::No
        };
        if !self.judged {
            walker.command_steps = walker.command_steps.saturating_sub(1);
            if walker.command_steps == 0 {
                walker.draw_command(self.commands, dt);
            }
        }
        (outcome, end)
    }
}

impl Judge<'_> {
    /// What the feet of one robot do, and how long they have done it.
    fn see_feet(&self, env: usize, walker: &mut Walker) -> Feet {
        let (geoms, feet) = (self.robot.model.geoms.len(), self.robot.feet.len());
        let (dt, reward) = (self.settings.dt(), self.reward);
        let share = (dt / reward.duty_time).min(1.0);
        let stands = walker.stands();
        let mut seen = Feet::default();
        for (f, &geom) in self.robot.feet.iter().enumerate() {
            let at = (env * feet + f) * 3;
            let (p, speed) = (&self.read.feet[at..at + 3], &self.read.feet_speed[at..at + 3]);
            let under = match self.ground.is_plane() {
                true => 0.0,
                false => self.ground.height(p[0], p[1], p[2]).unwrap_or(walker.ground),
            };
            seen.height[f] = p[2] - self.foot_radius[f] - under;
            seen.speed[f] = speed[0].hypot(speed[1]);
            seen.peaks[f] = self.read.peaks[env * feet + f] / self.weight;
            seen.touching[f] = touches(&self.read.forces, geoms, env, geom);
            walker.duty[f] += share * (f32::from(seen.touching[f]) - walker.duty[f]);
            if seen.touching[f] {
                if walker.air[f] > 0.0 {
                    seen.landings[0] += 1.0;
                    seen.landings[1] += walker.air[f];
                    seen.landings[2] += walker.peak[f];
                    seen.landing += walker.sinking[f].max(0.0);
                    seen.outside += if stands { 0.0 } else { (reward.swing[0] - walker.air[f]).max(0.0) };
                }
                walker.stance[f] = if stands { 0.0 } else { walker.stance[f] + dt };
                (walker.air[f], walker.peak[f]) = (0.0, 0.0);
                seen.outside += (walker.stance[f] - reward.stance[1]).clamp(0.0, dt);
            } else {
                // A stance that a command began may be short.
                if walker.stance[f] > 0.0 {
                    seen.outside += (reward.stance[0] - walker.stance[f]).max(0.0);
                }
                walker.stance[f] = 0.0;
                walker.air[f] += dt;
                walker.peak[f] = walker.peak[f].max(seen.height[f]);
                seen.outside += if stands { 0.0 } else { (walker.air[f] - reward.swing[1]).clamp(0.0, dt) };
            }
            walker.sinking[f] = -speed[2];
        }
        seen
    }
}

/// What the feet of one robot did in a step.
#[derive(Default)]
struct Feet {
    /// Heights of their lowest points over the ground \[m\].
    height: [f32; MOST_FEET],
    /// Horizontal speeds \[m/s\].
    speed: [f32; MOST_FEET],
    touching: [bool; MOST_FEET],
    /// Peak forces in body weights.
    peaks: [f32; MOST_FEET],
    /// Seconds of swings and stances outside their bounds.
    outside: f32,
    /// Speeds downwards of those that landed \[m/s\].
    landing: f32,
    /// Landings, time in the air, highest points.
    landings: [f32; 3],
}

/// Whether the ground pushes a shape of one robot.
pub(super) fn touches(forces: &[f32], geoms: usize, env: usize, geom: usize) -> bool {
    let f = &forces[(env * geoms + geom) * 3..][..3];
    f[0] * f[0] + f[1] * f[1] + f[2] * f[2] > TOUCH * TOUCH
}
