//! What a viewer draws beside the robots of `replay.mcap`: forces on feet and slips as `foxglove.SceneUpdate`, and errors of joints.

use super::Replay;
use super::errors::{Phase, foot_phases};
use crate::joint_state::{joint_state_bytes, row};
use glam::{DQuat, DVec3};
use qv_recording::cdr::Writer;
use qv_rollout::{Feet, Trace};
use qv_sim::{BaseKind, Model, Shape};

/// Interval of what is drawn \[s\].
const TICK: f64 = 0.05;
/// A loaded foot that moves farther than this in a tick slips \[m\]; the same as for `qv contact`.
const SLIPPING: f64 = 0.006;
/// Length of the arrow of a force at the largest that is usual for the feet of its robot \[m\].
const LONGEST: f64 = 0.25;
/// Share of the forces that are at most the largest that is usual.
const USUAL: f64 = 0.95;
/// Diameters of an arrow's shaft and head, length of its head, diameter of a slip \[m\].
const SHAFT: f64 = 0.008;
const HEAD: [f64; 2] = [0.02, 0.03];
const SLIP: f64 = 0.015;
/// Longest that an arrow stays when none follows \[ns\].
const LIFETIME: u32 = 100_000_000;

/// Name of the message.
pub(super) const NAME: &str = "foxglove_msgs/msg/SceneUpdate";
/// Its definition, with all that it is made of, as ROS 2 has it.
pub(super) const DEFINITION: &str = include_str!("scene_update.msg");

/// A foot over time.
struct Foot {
    /// Where it touches the ground \[m\], in the world.
    soles: Vec<DVec3>,
    /// What it is doing.
    phases: Vec<Phase>,
}

/// What is drawn of one robot.
pub(super) struct RobotDrawing {
    /// Name of the robot.
    name: &'static str,
    colour: [f64; 3],
    feet: Vec<Foot>,
    /// Samples from one picture to the next.
    stride: usize,
    /// Metres for a newton.
    scale: f64,
}

impl RobotDrawing {
    /// Of a robot with a free base whose forces are known; none of another.
    pub(super) fn new(name: &'static str, colour: [f64; 3], trace: &Trace, feet: &Feet, model: &Model) -> Option<Self> {
        let (count, forces) = (feet.names.len(), &trace.foot_force);
        let is_known = count > 0 && forces.len() == count * trace.time.len() && trace.base.len() == trace.time.len();
        if !is_known || model.base != BaseKind::Floating {
            return None;
        }
        let usual = usual_force(forces)?;
        let soles: Vec<Vec<DVec3>> = (0..trace.time.len()).map(|i| soles(trace, feet, model, i)).collect();
        let foot = |k: usize| Foot {
            soles: soles.iter().map(|row| row[k]).collect(),
            phases: foot_phases(&trace.time, forces, k, count),
        };
        let interval = (trace.time.last()? - trace.time.first()?) / (trace.time.len().max(2) - 1) as f64;
        let stride = ((TICK / interval).round() as usize).max(1);
        Some(Self { name, colour, feet: (0..count).map(foot).collect(), stride, scale: LONGEST / usual })
    }

    /// The topic.
    pub(super) fn topic(&self) -> String {
        format!("/{}/scene", self.name)
    }

    /// The message of a sample; none between pictures, or where nothing is to be drawn.
    pub(super) fn at(&self, trace: &Trace, feet: &Feet, i: usize, stamp: u64) -> Option<Vec<u8>> {
        if !i.is_multiple_of(self.stride) {
            return None;
        }
        let mut entities = Vec::new();
        for (k, (foot, name)) in self.feet.iter().zip(&feet.names).enumerate() {
            let (sole, force) = (foot.soles[i], trace.foot_force[i * feet.names.len() + k]);
            if !sole.is_finite() {
                continue;
            }
            if force.is_finite() && force > 0.0 {
                entities.push(Entity {
                    id: format!("force {name}"),
                    lasts: true,
                    arrow: Some(self.scale * force),
                    at: sole,
                });
            }
            if self.slipped(foot, i).is_some() {
                entities.push(Entity { id: format!("slip {name} {i}"), lasts: false, arrow: None, at: sole });
            }
        }
        (!entities.is_empty()).then(|| bytes(stamp, &entities, self.colour))
    }

    /// How far a loaded foot moved over the ground since the picture before \[m\], where it slipped.
    fn slipped(&self, foot: &Foot, i: usize) -> Option<f64> {
        let before = i.checked_sub(self.stride)?;
        // Impacts push the sole about.
        let stands = (before..=i).all(|j| foot.phases.get(j) == Some(&Phase::Stance));
        let moved = (foot.soles[i] - foot.soles[before]).truncate().length();
        (stands && moved > SLIPPING).then_some(moved)
    }
}

/// The largest force that is usual on the feet of a robot \[N\]: 95 % of those that are known are at most this, single
/// impacts are far above it. None where no force is known, or hardly any is above zero.
pub fn usual_force(forces: &[f64]) -> Option<f64> {
    let mut sorted: Vec<f64> = forces.iter().copied().filter(|f| f.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get((USUAL * sorted.len() as f64) as usize).copied().filter(|f| *f > 0.0)
}

/// Where each foot would touch ground below it.
fn soles(trace: &Trace, feet: &Feet, model: &Model, i: usize) -> Vec<DVec3> {
    let mut q = trace.base[i].to_vec();
    q.extend(&trace.position[i * trace.joints..(i + 1) * trace.joints]);
    let poses = model.world_from_links(&q);
    let sole = |geom: &usize| {
        let geom = &model.geoms[*geom];
        let radius = if let Shape::Sphere(radius) = geom.shape { radius } else { 0.0 };
        poses[geom.link].transform_point(geom.link_from_geom.position) - radius * DVec3::Z
    };
    feet.geoms.iter().map(sole).collect()
}

/// An arrow that points up, or a ball.
struct Entity {
    id: String,
    /// Whether it goes when none follows.
    lasts: bool,
    /// Length of the arrow \[m\].
    arrow: Option<f64>,
    at: DVec3,
}

fn bytes(stamp: u64, entities: &[Entity], colour: [f64; 3]) -> Vec<u8> {
    let mut w = Writer::new();
    // No deletions.
    w.u32(0).u32(entities.len() as u32);
    for entity in entities {
        w.time(stamp).string("world").string(&entity.id);
        w.i32(0).u32(if entity.lasts { LIFETIME } else { 0 });
        // Not locked to its frame, no metadata.
        w.u8(0).u32(0);
        match entity.arrow {
            Some(length) => {
                w.u32(1);
                // Arrows point along x.
                pose(&mut w, entity.at, DQuat::from_rotation_y(-std::f64::consts::FRAC_PI_2));
                let head = HEAD[1].min(length);
                [length - head, SHAFT, head, HEAD[0]].into_iter().for_each(|x| _ = w.f64(x));
                rgba(&mut w, colour);
            }
            None => _ = w.u32(0),
        }
        // No cubes.
        w.u32(0);
        match entity.arrow {
            Some(_) => _ = w.u32(0),
            None => {
                w.u32(1);
                pose(&mut w, entity.at, DQuat::IDENTITY);
                [SLIP; 3].into_iter().for_each(|x| _ = w.f64(x));
                rgba(&mut w, colour);
            }
        }
        // No cylinders, lines, triangles, texts, models.
        (0..5).for_each(|_| _ = w.u32(0));
    }
    w.finish()
}

fn pose(w: &mut Writer, at: DVec3, turned: DQuat) {
    w.f64(at.x).f64(at.y).f64(at.z).f64(turned.x).f64(turned.y).f64(turned.z).f64(turned.w);
}

fn rgba(w: &mut Writer, [r, g, b]: [f64; 3]) {
    w.f64(r).f64(g).f64(b).f64(1.0);
}

/// Simulated minus recorded at a sample: position, velocity, torque of each joint.
fn difference(simulated: &Trace, at: usize, recorded: &Trace, i: usize) -> [Vec<f64>; 3] {
    let n = recorded.joints;
    let pairs = [
        (&simulated.position, &recorded.position),
        (&simulated.velocity, &recorded.velocity),
        (&simulated.torque, &recorded.torque),
    ];
    pairs.map(|(a, b)| {
        let (a, b) = (row(a, at, n), row(b, i, n));
        a.iter().zip(b).map(|(a, b)| a - b).collect()
    })
}

/// Errors of the whole run at a sample, as a `JointState` of differences.
pub(super) fn whole_error(replay: &Replay, i: usize, stamp: u64) -> Option<Vec<u8>> {
    error(replay, &replay.whole, i, i, stamp)
}

/// Errors in the window that a sample lies in; none where it lies in none.
pub(super) fn window_error(replay: &Replay, i: usize, stamp: u64) -> Option<Vec<u8>> {
    let windows = &replay.windows.windows;
    // Where one ends and the next begins, the error is that of the one that ends.
    let window = windows[..windows.partition_point(|w| w.first < i)].last()?;
    error(replay, &window.trace, i - window.first, i, stamp)
}

fn error(replay: &Replay, simulated: &Trace, at: usize, i: usize, stamp: u64) -> Option<Vec<u8>> {
    if at >= simulated.time.len() {
        return None;
    }
    let [position, velocity, torque] = difference(simulated, at, &replay.recorded, i);
    Some(joint_state_bytes(stamp, &replay.joint_names, [&position, &velocity, &torque]))
}
