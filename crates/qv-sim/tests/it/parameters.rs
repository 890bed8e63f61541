//! Every parameter of the catalogue does something, and nothing when neutral.

use crate::robots::{biped_state, biped_urdf, drive, model};
use qv_core::{Material, TriangleMesh};
use qv_sim::{BaseKind, Batch, JointCommand, ParameterInfo, SensorReading, SimOptions, Terrain};

/// Two large triangles with a material.
fn lawn() -> Terrain {
    let corner = |x: f64, y: f64| glam::DVec3::new(x, y, 0.0);
    Terrain::from_mesh(&TriangleMesh {
        vertices: vec![corner(-9.0, -9.0), corner(9.0, -9.0), corner(9.0, 9.0), corner(-9.0, 9.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        labels: vec![0, 0],
        materials: vec![Material { name: "grass".into(), friction: Some(0.5) }],
    })
    .unwrap()
}

fn simulation(terrain: &Terrain) -> Batch<f64> {
    let robot = model(&biped_urdf(), BaseKind::Floating);
    let options =
        SimOptions { max_command_latency: 0.06, max_sensor_latency: 0.2, contact_dimension: 6, ..Default::default() };
    let mut sim = Batch::new(&robot, terrain, &options, 1).unwrap();
    sim.set_state(0, &biped_state()).unwrap();
    sim
}

/// Readings in the air, on landing, and after.
fn readings(sim: &mut Batch<f64>) -> Vec<SensorReading> {
    (0..12)
        .map(|_| {
            drive(sim, 40, false);
            assert!(!sim.is_faulty(0).unwrap());
            sim.sensors(0).unwrap()
        })
        .collect()
}

/// Motors so weak that their speed limits are felt.
const TIGHT: [(&str, f64); 12] = [
    ("actuator.left_hip.torque_limit", 0.2),
    ("actuator.left_hip.speed_knee", 0.1),
    ("actuator.left_hip.speed_zero", 6.0),
    ("actuator.left_knee.torque_limit", 0.2),
    ("actuator.left_knee.speed_knee", 0.1),
    ("actuator.left_knee.speed_zero", 6.0),
    ("actuator.right_hip.torque_limit", 0.2),
    ("actuator.right_hip.speed_knee", 0.1),
    ("actuator.right_hip.speed_zero", 6.0),
    ("actuator.right_knee.torque_limit", 0.2),
    ("actuator.right_knee.speed_knee", 0.1),
    ("actuator.right_knee.speed_zero", 6.0),
];

/// What must be set beside a parameter for it to act.
const STICKY: [(&str, f64); 4] = [
    ("joint.left_hip.stribeck_friction", 0.5),
    ("joint.left_knee.stribeck_friction", 0.5),
    ("joint.right_hip.stribeck_friction", 0.5),
    ("joint.right_knee.stribeck_friction", 0.5),
];
/// So hard that motors are driven back.
const PUSHED: [(&str, f64); 4] = [
    ("joint.left_hip.external_torque", -12.0),
    ("joint.left_knee.external_torque", 12.0),
    ("joint.right_hip.external_torque", 12.0),
    ("joint.right_knee.external_torque", -12.0),
];
const SPRUNG: [(&str, f64); 4] = [
    ("joint.left_hip.spring_stiffness", 3.0),
    ("joint.left_knee.spring_stiffness", 3.0),
    ("joint.right_hip.spring_stiffness", 3.0),
    ("joint.right_knee.spring_stiffness", 3.0),
];

fn companions(name: &str) -> &'static [(&'static str, f64)] {
    match name {
        "terrain.patch.x_min" | "terrain.patch.x_max" | "terrain.patch.y_min" | "terrain.patch.y_max" => &[
            ("terrain.patch.friction", 0.05),
            ("terrain.patch.x_min", -4.0),
            ("terrain.patch.x_max", 4.0),
            ("terrain.patch.y_min", -4.0),
            ("terrain.patch.y_max", 4.0),
        ],
        "terrain.patch.friction" => &[
            ("terrain.patch.x_min", -4.0),
            ("terrain.patch.x_max", 4.0),
            ("terrain.patch.y_min", -4.0),
            ("terrain.patch.y_max", 4.0),
        ],
        "external.start" | "external.duration" => &[("external.force_x", 10.0)],
        "run.start" => &[("actuator.left_hip.strength_drift", -0.001)],
        "contact.friction_speed" => &[("contact.friction_drop", 0.5)],
        "contact.sink_rate" => &[("contact.yield_force", 5.0)],
        name if name.ends_with("stribeck_speed") || name.ends_with("stribeck_exponent") => &STICKY,
        name if name.ends_with(".quadratic_load_friction_motor") => &PUSHED,
        name if name.ends_with("spring_rest") || name.ends_with("spring_slack") => &SPRUNG,
        name if name.ends_with("speed_knee") || name.ends_with("speed_zero") => &TIGHT,
        name if name.ends_with("payload_x") || name.ends_with("payload_y") || name.ends_with("payload_z") => {
            if name.contains("trunk") {
                &[("link.trunk.payload_mass", 1.0)]
            } else if name.contains("left_thigh") {
                &[("link.left_thigh.payload_mass", 1.0)]
            } else if name.contains("left_shank") {
                &[("link.left_shank.payload_mass", 1.0)]
            } else if name.contains("right_thigh") {
                &[("link.right_thigh.payload_mass", 1.0)]
            } else {
                &[("link.right_shank.payload_mass", 1.0)]
            }
        }
        _ => &[],
    }
}

/// A value that is far from neutral, and tight where the parameter is a limit.
fn far(info: &ParameterInfo) -> f64 {
    if info.name.ends_with("torque_limit") || info.name.ends_with("position_torque_limit") {
        0.5
    } else if info.name.ends_with("speed_knee") {
        0.01
    } else if info.name.ends_with("speed_zero") {
        0.5
    } else if info.name == "external.duration" {
        0.05
    } else if info.name == "external.start" {
        0.15
    } else if info.name.starts_with("terrain.patch.") && info.name.ends_with("_min") {
        3.9
    } else if info.name.starts_with("terrain.patch.") && info.name.ends_with("_max") {
        -3.9
    } else if (info.range.0 - info.neutral).abs() > (info.range.1 - info.neutral).abs() {
        info.range.0
    } else {
        info.range.1
    }
}

#[test]
fn each_parameter_acts_and_neutral_is_nothing() {
    let catalogue: Vec<ParameterInfo> = simulation(&lawn()).catalogue().to_vec();
    let plain = readings(&mut simulation(&lawn()));
    for info in &catalogue {
        assert!(info.range.0 < info.range.1 && !info.unit.is_empty() && !info.description.is_empty(), "{info:?}");
        // Ground without a material only exists on the plane, and the trunk's shape must be dropped to touch it.
        let terrain = if info.name == "contact.friction" { Terrain::plane() } else { lawn() };
        let reference =
            if info.name == "contact.friction" { readings(&mut simulation(&terrain)) } else { plain.clone() };
        let mut neutral = simulation(&terrain);
        neutral.set_parameter(0, &info.name, info.neutral).unwrap();
        assert_eq!(readings(&mut neutral), reference, "{} at its neutral value", info.name);
        if info.name.starts_with("geom.trunk") {
            continue;
        }
        let mut before = simulation(&terrain);
        let mut after = simulation(&terrain);
        for (name, value) in companions(&info.name) {
            before.set_parameter(0, name, *value).unwrap();
            after.set_parameter(0, name, *value).unwrap();
        }
        after.set_parameter(0, &info.name, far(info)).unwrap();
        assert_eq!(after.parameter(0, &info.name).unwrap(), far(info));
        assert_ne!(readings(&mut after), readings(&mut before), "{} at {}", info.name, far(info));
        after.reset_parameters(0).unwrap();
        after.set_state(0, &biped_state()).unwrap();
        assert_eq!(readings(&mut after), reference, "{} after a reset", info.name);
    }
}

#[test]
fn latency_below_a_step_is_felt_in_proportion() {
    let moved = |latency: f64| {
        let mut sim = simulation(&Terrain::none());
        for joint in ["left_hip", "left_knee", "right_hip", "right_knee"] {
            sim.set_parameter(0, &format!("actuator.{joint}.command_latency"), latency).unwrap();
        }
        drive(&mut sim, 100, false);
        sim.state(0).unwrap().q[7]
    };
    let (none, quarter, half) = (moved(0.0), moved(0.00025), moved(0.0005));
    assert!((half - none).abs() > 1e-7);
    assert!(((half - none) / (quarter - none) - 2.0).abs() < 0.05, "{none} {quarter} {half}");
}

/// A simulation that is set into the middle of another one, with the commands before it, goes on as that one does: however its first command
/// is given.
#[test]
fn commands_before_the_start_stay_when_the_first_one_is_given() {
    type Give = fn(&mut Batch<f64>, &JointCommand);
    let one: Give = |sim, command| sim.set_command(0, command).unwrap();
    let some: Give = |sim, command| sim.set_command_in(0..1, command).unwrap();
    let all: Give = |sim, command| sim.set_command_for_all(command).unwrap();
    let asked = |step: usize| vec![0.4 * (0.05 * step as f64).sin(); 4];
    let (kp, kd, zero) = (vec![30.0; 4], vec![1.0; 4], vec![0.0; 4]);
    let late = |sim: &mut Batch<f64>| {
        for joint in ["left_hip", "left_knee", "right_hip", "right_knee"] {
            sim.set_parameter(0, &format!("actuator.{joint}.command_latency"), 0.0125).unwrap();
        }
    };
    let rest = JointCommand { q: &zero, dq: &zero, kp: &kp, kd: &kd, tau: &zero };
    let go_on = |sim: &mut Batch<f64>, from: usize, give: Give| {
        for step in from..from + 60 {
            give(sim, &JointCommand { q: &asked(step), ..rest });
            sim.step();
        }
        sim.state(0).unwrap()
    };
    let mut whole = simulation(&Terrain::none());
    late(&mut whole);
    go_on(&mut whole, 0, one);
    let (middle, end) = (whole.state(0).unwrap(), go_on(&mut whole, 60, one));
    for give in [one, some, all] {
        let mut part = simulation(&Terrain::none());
        late(&mut part);
        part.set_state(0, &middle).unwrap();
        for age in 1..=20 {
            part.set_past_command(0, age, &JointCommand { q: &asked(60 - age), ..rest }).unwrap();
        }
        let at = go_on(&mut part, 60, give);
        let apart = at.q.iter().zip(&end.q).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-12, "{apart}");
    }
}

#[test]
fn sensors_report_delay_bias_and_gravity() {
    let mut sim = simulation(&lawn());
    drive(&mut sim, 1500, false);
    let reading = sim.sensors(0).unwrap();
    let gravity = reading.acc.iter().map(|a| a * a).sum::<f64>().sqrt();
    assert!(gravity > 5.0 && gravity < 20.0, "{:?}", reading.acc);
    sim.set_parameter(0, "sensor.left_hip.encoder_bias", 0.05).unwrap();
    assert!((sim.sensors(0).unwrap().q[0] - reading.q[0] - 0.05).abs() < 1e-12);
    sim.set_parameter(0, "sensor.pose.delay", 0.1).unwrap();
    let now = sim.state(0).unwrap();
    drive(&mut sim, 100, false);
    let late = sim.sensors(0).unwrap();
    for k in 0..3 {
        assert!((late.base_position[k] - now.q[k]).abs() < 1e-9, "{:?} against {:?}", late.base_position, &now.q[..3]);
    }
}

/// The parameter must do what another model would.
#[test]
fn a_longer_link_is_a_longer_link() {
    let by = 1.07;
    let short = model(&biped_urdf(), BaseKind::Floating);
    let mut long = short.clone();
    for link in ["left_thigh", "right_shank"] {
        let l = short.links.iter().position(|x| x.name == link).unwrap();
        long.links[l].com *= by;
        long.links.iter_mut().filter(|x| x.parent == Some(l)).for_each(|x| x.parent_from_link.position *= by);
        long.geoms.iter_mut().filter(|g| g.link == l).for_each(|g| g.link_from_geom.position *= by);
    }
    // How soft a contact is depends on the masses of the model as it is read, by a little.
    for (terrain, share) in [(Terrain::none(), 1e-9), (Terrain::plane(), 0.05), (lawn(), 0.05)] {
        let run = |robot: &qv_sim::Model, scale: f64| {
            let mut sim = Batch::<f64>::new(robot, &terrain, &SimOptions::default(), 1).unwrap();
            sim.set_parameter(0, "link.left_thigh.length_scale", scale).unwrap();
            sim.set_parameter(0, "link.right_shank.length_scale", scale).unwrap();
            sim.set_state(0, &biped_state()).unwrap();
            drive(&mut sim, 200, false);
            sim.state(0).unwrap()
        };
        let apart =
            |a: &qv_sim::State, b: &qv_sim::State| a.q.iter().zip(&b.q).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        let wanted = run(&long, 1.0);
        let (left, all) = (apart(&run(&short, by), &wanted), apart(&run(&short, 1.0), &wanted));
        assert!(all > 1e-3 && left < share * all, "{left} of {all}");
    }
}
