//! One robot under a policy, step by step: what pages draw and recordings hold.

use crate::PolicyError;
use crate::env::{End, VectorEnv};
use crate::gait::{Gait, GaitMeter, GaitSample, GaitScale};
use crate::score::Decide;
use crate::velocity::{Ground, VelocityTask};
use serde::Serialize;

/// What a robot did, one entry per decision.
#[derive(Debug, Clone, Default, Serialize)]
pub struct WalkTrace {
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
    /// Radius of each foot \[m\].
    pub foot_radii: Vec<f32>,
    /// Largest torque of each joint \[N m\]; `None` where the model states none.
    pub efforts: Vec<Option<f32>>,
    /// Mass of the robot \[kg\].
    pub mass: f32,
    /// Height of the base in the stand \[m\].
    pub height: f32,
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
    /// Greatest such force of the physics steps of the decision \[N\].
    pub foot_peaks: Vec<Vec<f32>>,
    /// Position of each foot's centre in the world \[m\].
    pub foot_positions: Vec<Vec<[f32; 3]>>,
    /// Height of each foot's lowest point over the ground under it \[m\].
    pub foot_heights: Vec<Vec<f32>>,
    /// Position of each link in the world \[m\].
    pub link_positions: Vec<Vec<[f32; 3]>>,
    /// The ground around the way; `None` = the plane at height 0.
    pub ground: Option<Patch>,
    /// Decision at which the robot fell.
    pub fell: Option<usize>,
}

/// Heights of a part of the ground on a square grid.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Patch {
    /// x and y of the first height \[m\].
    pub origin: [f32; 2],
    /// Distance between neighbours \[m\].
    pub spacing: f32,
    /// Heights along x and along y.
    pub size: [usize; 2],
    /// Heights \[m\], `[size y][size x]`; `None` where there is no ground.
    pub heights: Vec<Option<f32>>,
}

impl WalkTrace {
    /// How it walks and stands, over all of its commands.
    pub fn gait(&self) -> Gait {
        let efforts = self.efforts.clone();
        let scale = GaitScale { dt: 1.0 / self.rate.max(1e-3), mass: self.mass, height: self.height, efforts };
        let mut meter = GaitMeter::new(&scale, self.feet.len());
        for k in 0..self.commands.len() {
            let touching: Vec<bool> = self.foot_forces[k].iter().map(|force| *force > 0.0).collect();
            meter.add(&GaitSample {
                command: self.commands[k],
                velocity: [self.velocity[k][0], self.velocity[k][1], self.turning[k][2]],
                peaks: &self.foot_peaks[k],
                touching: &touching,
                torques: &self.torques[k],
                speeds: &self.dq[k],
            });
        }
        if self.fell.is_some() {
            meter.note_fall();
        }
        meter.gait()
    }
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
) -> Result<WalkTrace, PolicyError> {
    if commands.is_empty() {
        return Err(PolicyError::setting("commands", "at least one", "none"));
    }
    task.judged = true;
    task.restart(seed, 0)?;
    let robot = task.robot().clone();
    let (count, joints, geoms) = (task.count(), robot.joints(), robot.model.geoms.len());
    let mut out = WalkTrace {
        rate: task.settings().rate,
        joints: robot.model.joint_names().to_vec(),
        feet: robot.feet.iter().map(|&g| robot.model.geoms[g].name.clone()).collect(),
        links: robot.model.links.iter().map(|l| l.name.clone()).collect(),
        parents: robot.model.links.iter().map(|l| l.parent).collect(),
        foot_links: robot.feet.iter().map(|&g| robot.model.geoms[g].link).collect(),
        foot_radii: robot.feet.iter().map(|&g| robot.foot_radius(g)).collect(),
        efforts: robot.model.joints.iter().map(|j| Some(j.effort as f32).filter(|x| x.is_finite())).collect(),
        mass: robot.model.mass() as f32,
        height: robot.height,
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
        out.foot_peaks.push(task.peaks()[..robot.feet.len()].to_vec());
        let feet: Vec<[f32; 3]> = feet[..3 * robot.feet.len()].chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
        let under = |p: &[f32; 3]| task.ground().height(p[0], p[1], p[2]).unwrap_or(task.walkers()[0].ground);
        out.foot_heights.push(feet.iter().zip(&out.foot_radii).map(|(p, radius)| p[2] - radius - under(p)).collect());
        out.foot_positions.push(feet);
        debug_assert!(forces.len() == count * geoms * 3);
        if ends[0] == End::Failed {
            out.fell = Some(step);
            break;
        }
    }
    out.ground = patch(task.ground(), &out.q, robot.height);
    Ok(out)
}

/// The ground around the way of the base, as far as four of its heights on each side.
fn patch(ground: &Ground, q: &[Vec<f32>], height: f32) -> Option<Patch> {
    /// Most heights along a side: the way of a long play is drawn more coarsely.
    const MOST: f32 = 150.0;
    if ground.is_plane() || q.is_empty() {
        return None;
    }
    let ends = |k: usize| q.iter().fold((f32::MAX, f32::MIN), |(low, high), q| (low.min(q[k]), high.max(q[k])));
    let ([x0, x1], [y0, y1]) = ([ends(0).0, ends(0).1], [ends(1).0, ends(1).1]);
    let margin = 4.0 * height;
    let spacing = (0.2 * height).max((x1 - x0).max(y1 - y0) / MOST);
    let size = [x1 - x0, y1 - y0].map(|side| ((side + 2.0 * margin) / spacing) as usize + 1);
    let origin = [x0 - margin, y0 - margin];
    let top = q.iter().map(|q| q[2]).fold(f32::MIN, f32::max) + height;
    let at = |k: usize| {
        let [i, j] = [k % size[0], k / size[0]];
        ground.height(origin[0] + i as f32 * spacing, origin[1] + j as f32 * spacing, top)
    };
    Some(Patch { origin, spacing, size, heights: (0..size[0] * size[1]).map(at).collect() })
}
