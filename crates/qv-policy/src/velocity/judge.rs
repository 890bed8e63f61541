//! What one robot did in a step: reward, end, and what is remembered of it.

use super::readings::Readings;
use super::reward::{Measures, RewardInput, Terms, terms};
use super::robot::MOST_FEET;
use super::turns::{in_heading, turned_back};
use super::{Ground, Reward, TaskRobot, TaskSettings, Walker};
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
    pub torque: f32,
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
        let (mut touching, mut landed) = ([false; MOST_FEET], [-1.0f32; MOST_FEET]);
        let (mut feet_height, mut feet_speed) = ([0.0f32; MOST_FEET], [0.0f32; MOST_FEET]);
        let mut landings = [0.0f32; 3];
        for (f, &geom) in self.robot.feet.iter().enumerate() {
            let at = (env * feet + f) * 3;
            let (p, speed) = (&self.read.feet[at..at + 3], &self.read.feet_speed[at..at + 3]);
            let under = match self.ground.is_plane() {
                true => 0.0,
                false => self.ground.height(p[0], p[1], p[2]).unwrap_or(walker.ground),
            };
            feet_height[f] = p[2] - self.foot_radius[f] - under;
            feet_speed[f] = speed[0].hypot(speed[1]);
            touching[f] = touches(&self.read.forces, geoms, env, geom);
            if touching[f] {
                if walker.air[f] > 0.0 {
                    landed[f] = walker.air[f];
                    landings = [landings[0] + 1.0, landings[1] + walker.air[f], landings[2] + walker.peak[f]];
                }
                (walker.air[f], walker.peak[f]) = (0.0, 0.0);
            } else {
                walker.air[f] += dt;
                walker.peak[f] = walker.peak[f].max(feet_height[f]);
            }
        }
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
            feet_height: &feet_height[..feet],
            feet_speed: &feet_speed[..feet],
            touching: &touching[..feet],
            landed: &landed[..feet],
            limbs: on(&self.robot.limbs),
            fell,
        };
        let measures = Measures {
            stand: &self.robot.stand,
            sideways: &self.robot.sideways,
            height: self.robot.height,
            torque: self.torque,
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
            feet: landings,
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
                walker.draw_command(&self.settings.commands, dt);
            }
        }
        (outcome, end)
    }
}

/// Whether the ground pushes a shape of one robot.
pub(super) fn touches(forces: &[f32], geoms: usize, env: usize, geom: usize) -> bool {
    let f = &forces[(env * geoms + geom) * 3..][..3];
    f[0] * f[0] + f[1] * f[1] + f[2] * f[2] > TOUCH * TOUCH
}
