//! What the exported files do, not what they say: a simulator with them comes most of the way from the nominal robot to one that has
//! the effect. Robots with effects are qv-sim's; those that read the files are MuJoCo, qv-sim on a URDF, and a motor in Python.

use crate::python::{python, python_with};
use qv_gap::export::{to_isaac_lab, to_mjcf, to_urdf};
use qv_gap::report::Correction;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, State, Terrain};
use std::fmt::Write;

/// Share of the difference that a file must close.
const CLOSES: f64 = 0.8;
const STEP: f64 = 0.001;
const TICKS: usize = 3000;
const KP: [f64; 2] = [12.0; 2];
const KD: [f64; 2] = [0.4; 2];

const ARM: &str = r#"<robot name="arm"><link name="bench"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/><inertia ixx="0.004" iyy="0.004" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.12"/><mass value="0.4"/><inertia ixx="0.002" iyy="0.002" izz="0.0003" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"#;

fn arm(urdf: &str) -> Model {
    Model::from_urdf(urdf, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap()
}

fn command(tick: usize) -> [f64; 2] {
    let time = STEP * tick as f64;
    [0.6 * (3.1 * time).sin() + 0.2 * (9.3 * time).sin(), 0.5 * (5.1 * time).sin()]
}

/// Effects that only MJCF expresses.
fn effects_of_mjcf() -> Vec<(&'static str, Vec<(&'static str, f64)>)> {
    let both = |of: [&'static str; 2], value: f64| of.map(|name| (name, value)).to_vec();
    vec![
        ("drag", both(["joint.shoulder.quadratic_drag", "joint.elbow.quadratic_drag"], 0.08)),
        ("spring", both(["joint.shoulder.spring_stiffness", "joint.elbow.spring_stiffness"], 2.0)),
    ]
}

/// Effects of the arm by the parameters that they move.
fn effects() -> Vec<(&'static str, Vec<(&'static str, f64)>)> {
    let both = |of: [&'static str; 2], value: f64| of.map(|name| (name, value)).to_vec();
    vec![
        ("latency", both(["actuator.shoulder.command_latency", "actuator.elbow.command_latency"], 0.012)),
        ("armature", both(["joint.shoulder.armature", "joint.elbow.armature"], 0.02)),
        ("viscous", both(["joint.shoulder.viscous_friction", "joint.elbow.viscous_friction"], 0.2)),
        ("coulomb", both(["joint.shoulder.coulomb_friction", "joint.elbow.coulomb_friction"], 0.2)),
        ("strength", both(["actuator.shoulder.strength", "actuator.elbow.strength"], 0.7)),
        ("kp", both(["actuator.shoulder.kp_scale", "actuator.elbow.kp_scale"], 0.8)),
        ("kd", both(["actuator.shoulder.kd_scale", "actuator.elbow.kd_scale"], 0.6)),
        ("torque", both(["actuator.shoulder.torque_limit", "actuator.elbow.torque_limit"], 0.6)),
        ("payload", vec![("link.lower.payload_mass", 0.3)]),
        ("centre", vec![("link.upper.com_z", -0.04)]),
        ("inertia", vec![("link.lower.inertia_scale", 3.0)]),
    ]
}

fn corrections(parameters: &[(&str, f64)]) -> Vec<Correction> {
    let one = |(name, value): &(&str, f64)| Correction {
        parameter: (*name).into(),
        value: *value,
        nominal: 0.0,
        unit: "1".into(),
    };
    parameters.iter().map(one).collect()
}

/// Joint angles at each step \[rad\].
fn moves(model: &Model, parameters: &[(&str, f64)]) -> Vec<[f64; 2]> {
    let options = SimOptions { timestep: STEP, max_command_latency: 0.05, ..Default::default() };
    let mut sim = Batch::<f64>::new(model, &Terrain::none(), &options, 1).unwrap();
    parameters.iter().for_each(|(name, value)| sim.set_parameter(0, name, *value).unwrap());
    let one = |tick| {
        let zero = [0.0; 2];
        let command = JointCommand { q: &command(tick), dq: &zero, kp: &KP, kd: &KD, tau: &zero };
        sim.set_command(0, &command).unwrap();
        sim.step();
        let q = sim.state(0).unwrap().q;
        [q[0], q[1]]
    };
    (0..TICKS).map(one).collect()
}

fn rms(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares = a.iter().zip(b).flat_map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).map(|x| x * x);
    (squares.sum::<f64>() / (2 * a.len()) as f64).sqrt()
}

/// Least difference that an effect must make for its share to mean something \[rad\], some times that of the nominal robots.
const SEEN: f64 = 5e-3;

/// The share of the difference that is closed.
fn closed(truth: &[[f64; 2]], nominal: &[[f64; 2]], exported: &[[f64; 2]]) -> f64 {
    let difference = rms(truth, nominal);
    assert!(difference > SEEN, "the effect makes a difference of {difference} rad or m only");
    1.0 - rms(truth, exported) / difference
}

fn pairs(text: &str) -> Vec<[f64; 2]> {
    let numbers: Vec<f64> = text.split_whitespace().map(|x| x.parse().unwrap()).collect();
    numbers.chunks(2).map(|c| [c[0], c[1]]).collect()
}

fn commands() -> String {
    let mut text = String::new();
    (0..TICKS).map(command).for_each(|[a, b]| _ = writeln!(text, "{a} {b}"));
    text
}

/// The inertial that a fragment gives a body, else its own.
fn inertial(fragment: &str, body: &str, own: &str) -> String {
    let from = fragment.find(&format!("in <body name=\"{body}\">"));
    from.map_or(own.to_owned(), |from| {
        let at = from + fragment[from..].find("<inertial").unwrap();
        fragment[at..at + fragment[at..].find("/>").unwrap() + 2].to_string()
    })
}

/// The arm as a user has it, with what the head of the fragment asks for where it has a class of a joint.
fn arm_mjcf(fragment: &str) -> String {
    let class = |joint: &str| {
        let class = format!("calibrated_{joint}");
        if fragment.contains(&class) { format!(" class=\"{class}\"") } else { String::new() }
    };
    let has = |joint: &str, what: &str| {
        let class = format!("<default class=\"calibrated_{joint}\">");
        fragment.split_once(&class).is_some_and(|(_, rest)| rest[..rest.find("</default>").unwrap()].contains(what))
    };
    // Attributes that the class sets are deleted from the element.
    let servo = |joint: &str| {
        let own = if has(joint, "<position") { "" } else { " kp=\"12\" kv=\"0.4\"" };
        format!("<position joint=\"{joint}\"{own}{}/>", class(joint))
    };
    let upper = "<inertial mass=\"0.6\" pos=\"0 0 -0.15\" diaginertia=\"0.004 0.004 0.0005\"/>";
    let lower = "<inertial mass=\"0.4\" pos=\"0 0 -0.12\" diaginertia=\"0.002 0.002 0.0003\"/>";
    format!(
        "<mujoco><include file=\"fragment.xml\"/><option timestep=\"{STEP}\" integrator=\"implicitfast\"/><worldbody>\
         <body name=\"upper\" pos=\"0 0 1\"><joint name=\"shoulder\" axis=\"0 1 0\"{}/>{}\
         <body name=\"lower\" pos=\"0 0 -0.3\"><joint name=\"elbow\" axis=\"0 1 0\"{}/>{}</body></body></worldbody>\
         <actuator>{}{}</actuator></mujoco>",
        class("shoulder"),
        inertial(fragment, "upper", upper),
        class("elbow"),
        inertial(fragment, "lower", lower),
        servo("shoulder"),
        servo("elbow")
    )
}

const RUN_MUJOCO: &str = "
import mujoco, numpy as np
m = mujoco.MjModel.from_xml_path('model.xml')
d = mujoco.MjData(m)
for row in np.loadtxt('commands.txt'):
    d.ctrl[:] = row
    mujoco.mj_step(m, d)
    print(repr(float(d.qpos[0])), repr(float(d.qpos[1])))
";

#[test]
fn mujoco_with_the_fragment_moves_as_the_robot_with_the_effect() {
    let Some(with_mujoco) = python_with("mujoco") else { return };
    let (model, commands) = (arm(ARM), commands());
    let run = |name: &str, corrections: &[Correction]| {
        let fragment = to_mjcf(&model, corrections, &KP, &KD);
        let files = [
            ("fragment.xml", fragment.as_str()),
            ("model.xml", &arm_mjcf(&fragment)),
            ("commands.txt", commands.as_str()),
        ];
        pairs(&python(&with_mujoco, &format!("mujoco_{name}"), RUN_MUJOCO, &files))
    };
    let nominal = run("nominal", &[]);
    let same = rms(&moves(&model, &[]), &nominal);
    assert!(same < 1e-3, "the nominal arms are {same} rad apart");
    for (name, parameters) in effects().into_iter().chain(effects_of_mjcf()) {
        let share = closed(&moves(&model, &parameters), &nominal, &run(name, &corrections(&parameters)));
        println!("{name}: {share:.3}");
        assert!(share >= CLOSES, "{name}: the fragment closes {share}");
    }
}

#[test]
fn the_urdf_moves_as_the_robot_with_the_effect() {
    let model = arm(ARM);
    let nominal = moves(&model, &[]);
    let mut said = 0;
    for (name, parameters) in effects() {
        let (text, unsaid) = to_urdf(ARM, &model, &corrections(&parameters)).unwrap();
        let truth = moves(&model, &parameters);
        assert!(rms(&truth, &nominal) > 1e-3, "{name} does nothing");
        if !unsaid.is_empty() {
            // What a URDF cannot say changes nothing in it.
            assert_eq!(text, ARM, "{name}: {unsaid:?}");
            continue;
        }
        said += 1;
        let share = closed(&truth, &nominal, &moves(&arm(&text), &[]));
        assert!(share >= CLOSES, "{name}: the URDF closes {share}");
    }
    assert_eq!(said, 6, "friction of both kinds, torque limit, mass, centre and inertia");
}

/// The actuators of Isaac Lab as its documentation describes them, in a motor that drives the arm's joints: PD, effort limit, delay in
/// physics steps, friction and rotor inertia of the joint. Prints what qv-sim is then given, per joint.
const READ_ISAAC: &str = "
import re, sys, types
class Cfg:
    def __init__(self, **given): self.given = given
package, module = types.ModuleType('isaaclab'), types.ModuleType('isaaclab.actuators')
for name in ('ImplicitActuatorCfg', 'DCMotorCfg', 'DelayedPDActuatorCfg'): setattr(module, name, type(name, (Cfg,), {}))
package.actuators = module
sys.modules.update({'isaaclab': package, 'isaaclab.actuators': module})
found = {}
exec(open('actuators.py').read(), found)
rows = []
for joint in ('shoulder', 'elbow'):
    g, = [c.given for c in found['ACTUATORS'].values() if any(re.fullmatch(e, joint) for e in c.given['joint_names_expr'])]
    delay = 0.5 * (g.get('min_delay', 0) + g.get('max_delay', 0)) * found['PHYSICS_DT']
    limit = g.get('effort_limit', g.get('effort_limit_sim'))
    rows.append((g['stiffness'], g['damping'], g.get('armature', 0.0), g.get('friction', 0.0), g.get('viscous_friction', 0.0), limit, delay))

# The shoulder alone, as a pendulum: the elbow is held by a motor of its own in neither simulation.
import math
kp, kd, armature, coulomb, viscous, limit, delay = rows[0]
mass, length, inertia = 0.6, 0.15, 0.004
step, q, v, queue = 0.0001, 0.0, 0.0, []
for tick in range(30000):
    t = step * tick
    if tick % 10 == 0: queue.append(0.6 * math.sin(3.1 * t) + 0.2 * math.sin(9.3 * t))
    late = max(0, len(queue) - 1 - round(delay / 0.001))
    torque = max(-limit, min(limit, kp * (queue[late] - q) - kd * v))
    whole = inertia + mass * length ** 2 + armature
    free = torque - viscous * v - mass * 9.81 * length * math.sin(q)
    # Friction takes what it may of the impulse that would move the joint on.
    impulse = whole * v + step * free
    taken = max(-coulomb * step, min(coulomb * step, impulse))
    v = (impulse - taken) / whole
    q += step * v
    if tick % 10 == 9: print(repr(q), 0.0)
";

const PENDULUM: &str = r#"<robot name="pendulum"><link name="bench"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/><inertia ixx="0.004" iyy="0.004" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><mass value="1e-6"/><inertia ixx="1e-8" iyy="1e-8" izz="1e-8" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
<joint name="elbow" type="revolute"><parent link="bench"/><child link="lower"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"#;

#[test]
fn the_actuators_of_isaac_lab_move_as_the_robot_with_the_effect() {
    let Some(plain) = python_with("math") else { return };
    let model = arm(PENDULUM);
    let first = |all: Vec<[f64; 2]>| all.into_iter().map(|[a, _]| [a, 0.0]).collect::<Vec<_>>();
    let run = |name: &str, corrections: &[Correction]| {
        let text = to_isaac_lab(&model, corrections, &KP, &KD, 0.005);
        pairs(&python(&plain, &format!("isaac_{name}"), READ_ISAAC, &[("actuators.py", &text)]))
    };
    let nominal = run("nominal", &[]);
    let same = rms(&first(moves(&model, &[])), &nominal);
    assert!(same < 1e-3, "the nominal arms are {same} rad apart");
    for (name, parameters) in effects() {
        // Masses are no actuator's.
        if parameters.iter().any(|(name, _)| name.starts_with("link.")) {
            continue;
        }
        let share = closed(&first(moves(&model, &parameters)), &nominal, &run(name, &corrections(&parameters)));
        println!("{name}: {share:.3}");
        assert!(share >= CLOSES, "{name}: the actuators close {share}");
    }
}

/// A sled of four balls that slides, and one ball that falls: where they are, x and height, at each step \[m\].
const SLED: &str = r#"<robot name="sled"><link name="sled"><inertial><mass value="4"/><inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.2 0.2 0"/><geometry><sphere radius="0.1"/></geometry></collision>
<collision><origin xyz="0.2 -0.2 0"/><geometry><sphere radius="0.1"/></geometry></collision>
<collision><origin xyz="-0.2 0.2 0"/><geometry><sphere radius="0.1"/></geometry></collision>
<collision><origin xyz="-0.2 -0.2 0"/><geometry><sphere radius="0.1"/></geometry></collision></link></robot>"#;

const SLIDE: &str = "
import mujoco
m = mujoco.MjModel.from_xml_path('model.xml')
d = mujoco.MjData(m)
d.qpos[2], d.qvel[0] = START
for _ in range(1000):
    mujoco.mj_step(m, d)
    print(repr(float(d.qpos[0])), repr(float(d.qpos[2])))
";

#[test]
fn mujoco_with_the_ground_of_the_fragment_slides_and_bounces_as_the_effect() {
    let Some(with_mujoco) = python_with("mujoco") else { return };
    let model = Model::from_urdf(SLED, &ModelOptions { base: BaseKind::Floating, ..Default::default() }).unwrap();
    let ours = |parameters: &[(&str, f64)], [height, speed]: [f64; 2]| -> Vec<[f64; 2]> {
        let options = SimOptions { timestep: STEP, iterations: 50, ..Default::default() };
        let mut sim = Batch::<f64>::new(&model, &Terrain::plane(), &options, 1).unwrap();
        parameters.iter().for_each(|(name, value)| sim.set_parameter(0, name, *value).unwrap());
        let mut v = vec![0.0; 6];
        v[0] = speed;
        sim.set_state(0, &State { q: vec![0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0], v }).unwrap();
        let one = |_| {
            sim.step();
            let q = sim.state(0).unwrap().q;
            [q[0], q[2]]
        };
        (0..1000).map(one).collect()
    };
    // The nominal floor is the simulator's, said in full.
    let nominal_ground = "<default><default class=\"calibrated_ground\"><geom priority=\"1\" friction=\"0.8 0.005 0.0001\" solref=\"0.008 1\"/></default></default>";
    let run = |name: &str, corrections: &[Correction], [height, speed]: [f64; 2]| {
        let fragment = to_mjcf(&model, corrections, &[], &[]);
        let grounds = if fragment.contains("calibrated_ground") { "" } else { nominal_ground };
        let feet: String = [(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)]
            .iter()
            .map(|(x, y)| format!("<geom type=\"sphere\" size=\"0.1\" pos=\"{x} {y} 0\" mass=\"0\"/>"))
            .collect();
        let mjcf = format!(
            "<mujoco><option timestep=\"{STEP}\" cone=\"elliptic\" impratio=\"{}\"/><include file=\"fragment.xml\"/>{grounds}<worldbody>\
             <geom type=\"plane\" size=\"0 0 1\" class=\"calibrated_ground\" condim=\"3\"/>\
             <body><freejoint/><inertial mass=\"4\" pos=\"0 0 0\" diaginertia=\"0.05 0.05 0.05\"/>{feet}</body></worldbody></mujoco>",
            SimOptions::default().impratio
        );
        let program = SLIDE.replace("START", &format!("{height}, {speed}"));
        let files = [("fragment.xml", fragment.as_str()), ("model.xml", mjcf.as_str())];
        pairs(&python(&with_mujoco, &format!("ground_{name}"), &program, &files))
    };
    for (name, parameters, start) in [
        ("friction", vec![("contact.friction", 0.3)], [0.1, 2.0]),
        ("restitution", vec![("contact.restitution", 0.6)], [0.3, 0.0]),
    ] {
        let nominal = run(&format!("{name}_nominal"), &[], start);
        let share = closed(&ours(&parameters, start), &nominal, &run(name, &corrections(&parameters), start));
        println!("{name}: {share:.3}, nominal {} apart", rms(&ours(&[], start), &nominal));
        assert!(share >= CLOSES, "{name}: the fragment closes {share}");
    }
}
