//! One robot under a policy, step by step: what pages draw and recordings hold.

use crate::PolicyError;
use crate::env::{End, VectorEnv};
use crate::score::Decide;
use crate::velocity::VelocityTask;
use serde::Serialize;

/// What a robot did, one entry per decision.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Played {
    /// Decisions a second \[Hz\].
    pub rate: f32,
    /// Joint names.
    pub joints: Vec<String>,
    /// Names of the feet's shapes.
    pub feet: Vec<String>,
    /// Names of the links.
    pub links: Vec<String>,
    /// Parent of each link.
    pub parents: Vec<Option<usize>>,
    /// Link of each foot.
    pub foot_links: Vec<usize>,
    /// Commands: forwards, to the left \[m/s\], turning \[rad/s\].
    pub commands: Vec<[f32; 3]>,
    /// Base position \[m\] and quaternion w, x, y, z, then joint angles \[rad\].
    pub q: Vec<Vec<f32>>,
    /// Velocity of the base in its heading's axes: forwards, to the left, up \[m/s\].
    pub velocity: Vec<[f32; 3]>,
    /// Angular velocity of the base, base axes \[rad/s\].
    pub turning: Vec<[f32; 3]>,
    /// Joint speeds \[rad/s\].
    pub dq: Vec<Vec<f32>>,
    /// Joint torques \[N m\].
    pub torques: Vec<Vec<f32>>,
    /// Joint targets \[rad\].
    pub targets: Vec<Vec<f32>>,
    /// Force of the ground on each foot, upwards \[N\].
    pub foot_forces: Vec<Vec<f32>>,
    /// Position of each foot's centre in the world \[m\].
    pub foot_positions: Vec<Vec<[f32; 3]>>,
    /// Position of each link in the world \[m\].
    pub link_positions: Vec<Vec<[f32; 3]>>,
    /// Decision at which the robot fell.
    pub fell: Option<usize>,
}

/// Runs the first robot of `task` under commands that begin at given times \[s\], until `seconds` or a fall.
///
/// # Errors
/// When there are no commands, or a number is not finite.
pub fn play(
    mut policy: impl Decide,
    task: &mut VelocityTask,
    commands: &[(f32, [f32; 3])],
    seconds: f32,
    seed: u64,
) -> Result<Played, PolicyError> {
    if commands.is_empty() {
        return Err(PolicyError::setting("commands", "at least one", "none"));
    }
    task.judged = true;
    task.restart(seed, 0)?;
    let robot = task.robot().clone();
    let (count, joints, geoms) = (task.count(), robot.joints(), robot.model.geoms.len());
    let mut out = Played {
        rate: task.settings().rate,
        joints: robot.model.joint_names().to_vec(),
        feet: robot.feet.iter().map(|&g| robot.model.geoms[g].name.clone()).collect(),
        links: robot.model.links.iter().map(|l| l.name.clone()).collect(),
        parents: robot.model.links.iter().map(|l| l.parent).collect(),
        foot_links: robot.feet.iter().map(|&g| robot.model.geoms[g].link).collect(),
        ..Default::default()
    };
    let (mut observations, mut privileged) =
        (vec![0.0; count * task.observations()], vec![0.0; count * task.privileged()]);
    let (mut actions, mut rewards, mut ends) = (vec![0.0; count * joints], vec![0.0; count], vec![End::No; count]);
    for step in 0..(seconds * out.rate) as usize {
        let time = step as f32 / out.rate;
        let command = commands.iter().rev().find(|(from, _)| *from <= time).unwrap_or(&commands[0]).1;
        (0..count).for_each(|env| task.command(env, command));
        task.observe(&mut observations, &mut privileged);
        policy.decide(count, &observations, &mut actions)?;
        task.step(&actions, &mut rewards, &mut ends)?;
        let (q, v, torques) = task.motion();
        let (feet, forces) = task.feet();
        let q = q[..7 + joints].to_vec();
        let turned = crate::velocity::in_heading([q[3], q[4], q[5], q[6]], [v[0], v[1], v[2]]);
        let wide: Vec<f64> = q.iter().map(|&x| f64::from(x)).collect();
        let links = robot.model.world_from_links(&wide);
        out.link_positions.push(links.iter().map(|p| p.position.to_array().map(|x| x as f32)).collect());
        out.commands.push(command);
        out.q.push(q);
        out.velocity.push(turned);
        out.turning.push([v[3], v[4], v[5]]);
        out.dq.push(v[6..6 + joints].to_vec());
        out.torques.push(torques[..joints].to_vec());
        out.targets.push(task.targets()[..joints].to_vec());
        out.foot_forces.push(robot.feet.iter().map(|&g| forces[3 * g + 2]).collect());
        out.foot_positions.push(feet[..3 * robot.feet.len()].chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect());
        debug_assert!(forces.len() == count * geoms * 3);
        if ends[0] == End::Failed {
            out.fell = Some(step);
            break;
        }
    }
    Ok(out)
}

impl Played {
    /// Swings of all feet that began and ended: how long each lasted \[s\].
    pub fn swings(&self) -> Vec<f32> {
        let mut out = Vec::new();
        for foot in 0..self.feet.len() {
            let mut since = None;
            for (step, forces) in self.foot_forces.iter().enumerate() {
                match (forces[foot] > 0.0, since) {
                    (true, Some(from)) => {
                        out.push((step - from) as f32 / self.rate);
                        since = None;
                    }
                    (false, None) if step > 0 && self.foot_forces[step - 1][foot] > 0.0 => since = Some(step),
                    _ => {}
                }
            }
        }
        out
    }
}
