//! A model read from MJCF against what MuJoCo makes of the same file (`fixtures/mjcf/generate.py`).

#![allow(dead_code)]

use qv_core::Pose;
use qv_sim::mjcf::MjcfModel;
use qv_sim::{BaseKind, Batch, JointCommand, SimOptions, State, Terrain};
use serde_json::Value;

pub fn numbers(value: &Value) -> Vec<f64> {
    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("expected a number, found {v}"));
    value.as_array().unwrap_or_else(|| panic!("expected an array, found {value}")).iter().map(number).collect()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap_or_else(|| panic!("expected an array, found {value}"))
}

/// The largest differences, each as a part of the quantity's size.
#[derive(Debug, Default)]
pub struct Differences {
    pub mass: f64,
    /// Of bodies and sites \[m, and parts of a unit quaternion\].
    pub pose: f64,
    pub kinetic_energy: f64,
    pub center_of_mass: f64,
    pub angular_momentum: f64,
    /// Of ranges, armatures, frictions, gains and efforts.
    pub joints: f64,
    /// Root mean square of the joints' motion \[rad or m\].
    pub motion: f64,
    /// Names compared.
    pub frames: usize,
}

fn relative(found: f64, right: f64) -> f64 {
    (found - right).abs() / right.abs().max(1.0)
}

fn most(found: &[f64], right: &[f64]) -> f64 {
    assert_eq!(found.len(), right.len());
    found.iter().zip(right).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

pub fn compare(read: &MjcfModel, golden: &Value) -> Differences {
    let mut all = Differences {
        mass: relative(read.model.mass(), golden["mass"].as_f64().unwrap()),
        joints: joints(read, &golden["joints"]),
        motion: motion(read, &golden["motion"]),
        ..Default::default()
    };
    for state in list(&golden["states"]) {
        compare_state(read, state, &mut all);
    }
    all
}

fn compare_state(read: &MjcfModel, state: &Value, all: &mut Differences) {
    let model = &read.model;
    let (q, v) = (numbers(&state["q"]), numbers(&state["v"]));
    let links = model.world_from_links(&q);
    for group in ["bodies", "sites"] {
        for (name, right) in state[group].as_object().unwrap() {
            let frame = model.frame(name).unwrap_or_else(|| panic!("no frame `{name}`"));
            let found = frame.link.map_or(Pose::IDENTITY, |l| links[l]) * frame.link_from_frame;
            let right = numbers(right);
            let turn: f64 = found.wxyz().iter().zip(&right[3..]).map(|(a, b)| a * b).sum();
            let place = most(&found.position.to_array(), &right[..3]);
            // The dot product of quaternions hides half the digits of small angles.
            let signed: Vec<f64> = right[3..].iter().map(|x| x * turn.signum()).collect();
            all.pose = all.pose.max(place).max(most(&found.wxyz(), &signed));
            all.frames += 1;
        }
    }
    let mechanics = model.mechanics(&q, &v);
    let energy = state["kinetic_energy"].as_f64().unwrap();
    all.kinetic_energy = all.kinetic_energy.max(relative(mechanics.kinetic_energy, energy));
    let com = most(&mechanics.center_of_mass.to_array(), &numbers(&state["center_of_mass"]));
    all.center_of_mass = all.center_of_mass.max(com);
    let momentum = most(&mechanics.angular_momentum.to_array(), &numbers(&state["angular_momentum"]));
    all.angular_momentum = all.angular_momentum.max(momentum);
}

fn joints(read: &MjcfModel, right: &Value) -> f64 {
    let names: Vec<&str> = list(right).iter().map(|j| j["name"].as_str().unwrap()).collect();
    assert_eq!(read.model.joint_names(), names);
    let mut worst = 0.0f64;
    for ((joint, gains), right) in read.model.joints.iter().zip(&read.gains).zip(list(right)) {
        let range = match &right["range"] {
            Value::Null => [f64::NEG_INFINITY, f64::INFINITY],
            range => [numbers(range)[0], numbers(range)[1]],
        };
        let gains = gains.map_or([0.0; 2], |g| [g.kp, g.kd]);
        let number = |name: &str| right[name].as_f64().unwrap_or(f64::INFINITY);
        let pairs = [
            (joint.lower, range[0]),
            (joint.upper, range[1]),
            (joint.armature, number("armature")),
            (joint.viscous_friction, number("damping")),
            (joint.coulomb_friction, number("frictionloss")),
            (joint.effort, number("effort")),
            (gains[0], number("kp")),
            (gains[1], number("kd")),
        ];
        for (found, right) in pairs {
            let off = if found == right { 0.0 } else { relative(found, right) };
            worst = worst.max(if off.is_nan() { f64::INFINITY } else { off });
        }
    }
    worst
}

/// Drives the joints to the golden's targets in the air.
fn motion(read: &MjcfModel, golden: &Value) -> f64 {
    let model = &read.model;
    let options = SimOptions { timestep: golden["timestep"].as_f64().unwrap(), ..Default::default() };
    let mut sim = Batch::<f64>::new(model, &Terrain::plane(), &options, 1).unwrap();
    let (mut q, v) = (numbers(&golden["start"]), numbers(&golden["start_v"]));
    // The golden falls without a ground: from this high nothing reaches it.
    let lift = if model.base == BaseKind::Floating { 100.0 } else { 0.0 };
    if lift > 0.0 {
        q[2] += lift;
    }
    sim.set_state(0, &State { q, v }).unwrap();
    let n = model.joints.len();
    let gain = |pick: fn(&qv_sim::mjcf::Gains) -> f64| -> Vec<f64> {
        read.gains.iter().map(|g| g.as_ref().map_or(0.0, pick)).collect()
    };
    let (kp, kd, zero) = (gain(|g| g.kp), gain(|g| g.kd), vec![0.0; n]);
    let target = numbers(&golden["targets"]);
    let (mut sum, mut count) = (0.0, 0);
    for row in list(&golden["rows"]) {
        let row = numbers(row);
        let mut found = sim.state(0).unwrap().q;
        if lift > 0.0 {
            found[2] -= lift;
        }
        sum += found.iter().zip(&row).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        count += row.len();
        for _ in 0..golden["every"].as_u64().unwrap() {
            sim.set_command(0, &JointCommand { q: &target, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
            sim.step();
        }
    }
    (sum / f64::from(u32::try_from(count).unwrap())).sqrt()
}
