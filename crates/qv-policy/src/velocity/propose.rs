//! What a robot file leaves out, proposed from the model: feet, stand, gains, action scale and rotor inertia.
//!
//! The rule, for four legs of two joints or more:
//! - a foot is the shape of a leg's last link that is farthest from that link's joint;
//! - in the stand each foot is below its hip, at [`STANDING`] of the leg's length, the knees behind the hips where limits allow both;
//! - `kp` is [`STIFFNESS`] times a foot's share of the weight on a lever as long as the robot is high ([`super::TaskRobot::torque_scale`]), that of
//!   the A2; `kd` is a fortieth of it; an action of one moves a target by 0.25 rad (legged_gym);
//! - rotor inertia, where the model states none, is the Go2's in proportion to the mass.

use crate::PolicyError;
use glam::DVec3;
use qv_sim::Model;

/// Height of the hips over the feet in a stand, in lengths of a stretched leg: 0.73 for the Go2, 0.82 for ANYmal C.
const STANDING: f64 = 0.75;
/// `kp` over the torque of the stand \[1/rad\]: 136 N m/rad of the A2; with 2.5 Spot tips over slowly.
const STIFFNESS: f32 = 3.5;
/// `kp` over `kd` \[1/s\].
const DAMPING: f32 = 40.0;
/// Radians for an action of one.
const ACTION_SCALE: f32 = 0.25;
/// Rotor inertia \[kg m²\] for each kilogram of the robot: 0.01 for a Go2.
const ARMATURE: f64 = 0.01 / 15.2;
/// The robot file and the URDF of a robot of the list.
pub fn known_robot(name: &str) -> Option<(&'static str, &'static str)> {
    match name {
        "go1" => Some((include_str!("../../robots/go1.toml"), include_str!("../../robots/go1.urdf"))),
        "a1" => Some((include_str!("../../robots/a1.toml"), include_str!("../../robots/a1.urdf"))),
        "a2" => Some((include_str!("../../robots/a2.toml"), include_str!("../../robots/a2.urdf"))),
        "anymal_c" => Some((include_str!("../../robots/anymal_c.toml"), include_str!("../../robots/anymal_c.urdf"))),
        _ => None,
    }
}

/// Values of each joint that the search for a stand begins with.
const GRID: usize = 9;
/// One leg, from the base outwards.
struct Leg {
    joints: Vec<usize>,
    foot: usize,
}

/// Legs of a model: chains of at least two joints from the base to a link that carries no other.
fn legs(model: &Model) -> Result<Vec<Leg>, PolicyError> {
    let is_leaf = |link: usize| !model.links.iter().any(|other| other.parent == Some(link));
    let mut found = Vec::new();
    for leaf in (1..model.links.len()).filter(|&link| is_leaf(link)) {
        let mut joints = Vec::new();
        let mut link = Some(leaf);
        while let Some(now) = link {
            joints.extend(model.links[now].joint);
            link = model.links[now].parent;
        }
        joints.reverse();
        let far = |g: &usize| model.geoms[*g].link_from_geom.position.length();
        let own = (0..model.geoms.len()).filter(|&g| model.geoms[g].link == leaf);
        let foot = own.max_by(|a, b| far(a).total_cmp(&far(b)));
        if let Some(foot) = foot.filter(|_| joints.len() >= 2) {
            found.push(Leg { joints, foot });
        }
    }
    if found.len() == 4 {
        return Ok(found);
    }
    let expected = "four legs that end in a shape (for others a robot file names `stand` and `feet`)";
    Err(PolicyError::setting("robot", expected, format!("{} legs", found.len())))
}

/// The shapes of the feet.
///
/// # Errors
/// When there are not four legs.
pub(super) fn feet(model: &Model) -> Result<Vec<usize>, PolicyError> {
    Ok(legs(model)?.iter().map(|leg| leg.foot).collect())
}

/// Joint angles of a stand \[rad\].
///
/// # Errors
/// When there are not four legs, or a foot cannot be put below its hip within the limits.
pub(super) fn stand(model: &Model) -> Result<Vec<f32>, PolicyError> {
    let mut q = vec![0.0; model.nq()];
    q[3] = 1.0;
    for (joint, q) in model.joints.iter().zip(&mut q[7..]) {
        *q = 0.0f64.clamp(joint.lower, joint.upper);
    }
    for leg in legs(model)? {
        let zero = model.world_from_links(&q);
        let origin = |joint: usize| zero[model.joints[joint].link].position;
        let geom = &model.geoms[leg.foot];
        let foot = (zero[geom.link] * geom.link_from_geom).position;
        // The first joint of three moves the leg sideways; the hip is the one that swings it.
        let hip = origin(leg.joints[usize::from(leg.joints.len() > 2)]);
        let from_hip: Vec<DVec3> =
            leg.joints.iter().skip(usize::from(leg.joints.len() > 2)).map(|&j| origin(j)).chain([foot]).collect();
        let length: f64 = from_hip.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let side = if leg.joints.len() > 2 { foot.y } else { hip.y };
        let target = DVec3::new(hip.x, side, hip.z - STANDING * length);
        let off = place(model, &leg, (target, length), &mut q);
        if off > 0.1 * length {
            let name = &model.joints[leg.joints[0]].name;
            let expected = format!("a foot of the leg of `{name}` below its hip within the limits");
            return Err(PolicyError::setting("stand", &expected, format!("{off:.3} m off")));
        }
    }
    Ok(q[7..].iter().map(|&angle| angle as f32).collect())
}

/// Puts the foot of a leg at a target by its joints: a grid over their ranges, then steps that halve. Returns what is left \[m\].
fn place(model: &Model, leg: &Leg, (target, length): (DVec3, f64), q: &mut [f64]) -> f64 {
    let off = |q: &[f64]| {
        let links = model.world_from_links(q);
        let geom = &model.geoms[leg.foot];
        let foot = (links[geom.link] * geom.link_from_geom).position;
        let knee = links[model.joints[leg.joints[leg.joints.len() - 1]].link].position;
        (foot.distance(target), knee.x - target.x)
    };
    // Being there counts; knees behind hips decide between stands that are as good.
    let cost = |q: &[f64]| {
        let (off, ahead) = off(q);
        (off / length).powi(2) + 1e-3 * ahead / length
    };
    let range = |joint: usize| {
        let joint = &model.joints[joint];
        [joint.lower.max(-std::f64::consts::PI), joint.upper.min(std::f64::consts::PI)]
    };
    let (mut best, mut least) = (q.to_vec(), f64::INFINITY);
    for k in 0..GRID.pow(leg.joints.len().min(4) as u32) {
        let mut digits = k;
        for &joint in leg.joints.iter().take(4) {
            let [low, high] = range(joint);
            q[7 + joint] = low + (high - low) * (digits % GRID) as f64 / (GRID - 1) as f64;
            digits /= GRID;
        }
        let found = cost(q);
        if found < least {
            (least, best) = (found, q.to_vec());
        }
    }
    let mut step = 0.3;
    while step > 1e-4 {
        let before = least;
        for &joint in &leg.joints {
            for move_by in [step, -step] {
                let mut trial = best.clone();
                let [low, high] = range(joint);
                trial[7 + joint] = (trial[7 + joint] + move_by).clamp(low, high);
                let found = cost(&trial);
                if found < least {
                    (least, best) = (found, trial);
                }
            }
        }
        if least >= before {
            step *= 0.5;
        }
    }
    q.copy_from_slice(&best);
    off(q).0
}

/// Position and velocity gains and action scale of a robot whose stand is known, `[joints]` each; `torque` is its torque scale \[N m\].
pub(super) fn gains(torque: f32, joints: usize) -> [Vec<f32>; 3] {
    let kp = STIFFNESS * torque;
    [kp, kp / DAMPING, ACTION_SCALE].map(|value| vec![value; joints])
}

/// Gives joints rotor inertia, where the model states none.
pub(super) fn add_armature(model: &mut Model) {
    let armature = ARMATURE * model.mass();
    model.joints.iter_mut().filter(|joint| joint.armature == 0.0).for_each(|joint| joint.armature = armature);
}
