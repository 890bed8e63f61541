//! The second engine: does it stand, walk, fall and swing as physics says, and do its parameters act?

use qv_core::{Material, TriangleMesh};
use qv_go2::gait::Trot;
use qv_go2::model::{self, ARMATURE, DEFAULT_KD, DEFAULT_KP, STAND};
use qv_sim::rapier::{Motion, RapierEngine, RapierOptions, compare_engines};
use qv_sim::{
    BaseKind, Batch, JointCommand, Model, ModelOptions, ParameterInfo, SensorReading, SimError, SimOptions, State,
    Terrain,
};

fn go2() -> Model {
    let options = ModelOptions { base: BaseKind::Floating, armature: ARMATURE, ..Default::default() };
    Model::from_urdf(&model::urdf(), &options).unwrap()
}

/// On its feet at rest, raised by `height` \[m\].
fn standing(height: f64) -> State {
    let mut q = vec![0.0, 0.0, height + model::touching_height(&STAND), 1.0, 0.0, 0.0, 0.0];
    q.extend(STAND);
    State { q, v: vec![0.0; 18] }
}

fn engine(terrain: &Terrain) -> RapierEngine {
    let mut engine = RapierEngine::new(&go2(), terrain, &RapierOptions::default()).unwrap();
    engine.set_state(&standing(0.0)).unwrap();
    engine
}

/// Steps with a target of each instant.
fn drive(engine: &mut RapierEngine, steps: std::ops::Range<usize>, target: impl Fn(f64) -> [f64; 12]) {
    for step in steps {
        let q = target(step as f64 * 0.001);
        let (kp, kd, zero) = ([DEFAULT_KP; 12], [DEFAULT_KD; 12], [0.0; 12]);
        engine.set_command(&JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        engine.step().unwrap();
        assert!(!engine.is_faulty(), "fault at step {step}");
    }
}

#[test]
fn it_stands_and_feels_its_weight() {
    let mut robot = engine(&Terrain::plane());
    drive(&mut robot, 0..4000, |_| STAND);
    let (state, reading) = (robot.state(), robot.sensors());
    let weight = go2().mass() * 9.81;
    let felt: f64 = reading.foot_force.iter().sum();
    println!("stands at {:.4} m, feels {felt:.2} N of {weight:.2} N, acc {:?}", state.q[2], reading.acc);
    assert!((felt / weight - 1.0).abs() < 0.01, "{felt} N of {weight} N");
    assert!((reading.acc[2] - 9.81).abs() < 0.05, "{:?}", reading.acc);
    assert!(state.q[2] > 0.28 && state.q[3] > 0.999 && state.v.iter().all(|v| v.abs() < 0.05), "{state:?}");
}

/// Measured: 74 mm apart after 4 s and 0.63 m on friction 0.8, 21 mm after 1.5 m on 0.2. MuJoCo's two cones are 62 mm
/// apart on the same trot. The bound says that both walk the same way, not that they agree. Most of the difference is
/// how contacts give way: with contacts four times as stiff it is less than half.
#[test]
fn it_walks_the_trot_as_far() {
    let trot = Trot::default();
    let (start, target) = (standing(0.0), |t: f64| trot.target(t).to_vec());
    let differences = [(0.8, 0.008), (0.2, 0.008), (0.8, 0.002)].map(|(friction, time_constant)| {
        let ground = Terrain::plane().with_friction(friction).unwrap();
        let parameters = [("contact.time_constant", time_constant)];
        let (kp, kd) = (DEFAULT_KP, DEFAULT_KD);
        let motion = Motion { start: &start, duration: 4.0, kp, kd, target: &target, parameters: &parameters };
        let found = compare_engines(&go2(), &ground, &SimOptions::default(), &motion).unwrap();
        println!("friction {friction}, time constant {time_constant} s: {found}");
        let (ours, theirs) = (&found.first.q, &found.second.q);
        assert!(theirs[2] > 0.23 && theirs[3] > 0.95, "fell: {theirs:?}");
        assert!((theirs[0] / ours[0] - 1.0).abs() < 0.2, "friction {friction}: {} m against {} m", theirs[0], ours[0]);
        assert!(found.joint_rms < 0.01 && found.end_position > 0.0, "{found}");
        found.end_position
    });
    assert!(differences[2] < 0.5 * differences[0], "{differences:?} m");
}

#[test]
fn it_falls_freely_and_keeps_its_momentum() {
    let robot = go2();
    let mut falling = RapierEngine::new(&robot, &Terrain::none(), &RapierOptions::default()).unwrap();
    let mut start = standing(1.0);
    start.v = vec![0.3, -0.2, 0.5, 1.0, -0.7, 0.4, 0.5, -1.0, 0.8, 0.3, 0.2, -0.6, 1.0, -0.4, 0.2, 0.1, 0.6, -0.2];
    falling.set_state(&start).unwrap();
    for _ in 0..300 {
        falling.step().unwrap();
    }
    let end = falling.state();
    let (before, after) = (robot.mechanics(&start.q, &start.v), robot.mechanics(&end.q, &end.v));
    let t = 0.3;
    let expected = before.center_of_mass + before.center_of_mass_velocity * t - glam::DVec3::Z * (0.5 * 9.81 * t * t);
    let off = (after.center_of_mass - expected).length();
    println!("free fall: centre of mass off by {:.3} mm in {t} s", off * 1e3);
    assert!(off < 1e-3, "{off} m");
    let drift = (after.angular_momentum - before.angular_momentum).length() / before.angular_momentum.length();
    println!("angular momentum of the links changes by {:.1e} of itself", drift);
    assert!(drift < 1e-3, "{drift}");
}

/// A rod on a hinge whose axis is no coordinate axis, hung from the world.
fn pendulum() -> Model {
    let urdf = r#"<robot name="pendulum"><link name="world"/><link name="rod"><inertial><origin xyz="0 0 -0.3"/><mass value="0.5"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="hinge" type="continuous"><parent link="world"/><child link="rod"/><axis xyz="0.6 0.8 0"/></joint></robot>"#;
    Model::from_urdf(urdf, &ModelOptions { base: BaseKind::Fixed, armature: 0.02, ..Default::default() }).unwrap()
}

#[test]
fn a_pendulum_keeps_its_period_and_its_energy() {
    let mut swinging = RapierEngine::new(&pendulum(), &Terrain::none(), &RapierOptions::default()).unwrap();
    swinging.set_state(&State { q: vec![0.1], v: vec![0.0] }).unwrap();
    let (mut crossings, mut last, mut most) = (Vec::new(), 0.1, 0.0f64);
    for step in 1..=6000 {
        swinging.step().unwrap();
        let q = swinging.state().q[0];
        if last > 0.0 && q <= 0.0 {
            crossings.push(0.001 * (f64::from(step) - q / (q - last)));
        }
        last = q;
        if step > 4500 {
            most = most.max(q);
        }
    }
    let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
    let (inertia, torque) = (0.01 + 0.5 * 0.09 + 0.02, 0.5 * 9.81 * 0.3);
    let theory = std::f64::consts::TAU * f64::sqrt(inertia / torque) * (1.0 + 0.01 / 16.0);
    println!("period {period:.6} s, theory {theory:.6} s; amplitude {most:.5} rad of 0.1");
    assert!((period / theory - 1.0).abs() < 1e-3, "{period} s against {theory} s");
    assert!((most / 0.1 - 1.0).abs() < 0.01, "{most} rad");
}

/// A free body of 1 kg with one collision shape: no joints, hence no multibody inside.
fn body(geometry: &str, ground: &Terrain, height: f64, speed: f64, set: &[(&str, f64)]) -> RapierEngine {
    let urdf = format!(
        r#"<robot name="body"><link name="body"><inertial><origin xyz="0 0 0.01"/><mass value="1"/>
        <inertia ixx="0.002" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><geometry>{geometry}</geometry></collision></link></robot>"#
    );
    let model = Model::from_urdf(&urdf, &ModelOptions::default()).unwrap();
    let mut body = RapierEngine::new(&model, ground, &RapierOptions::default()).unwrap();
    set.iter().for_each(|(name, value)| body.set_parameter(name, *value).unwrap());
    let q = vec![0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0];
    body.set_state(&State { q, v: vec![speed, 0.0, 0.0, 0.0, 0.0, 0.0] }).unwrap();
    body
}

#[test]
fn a_box_slides_to_a_stop_and_a_ball_bounces() {
    let ground = Terrain::plane().with_friction(0.4).unwrap();
    let mut sliding = body(r#"<box size="0.3 0.3 0.1"/>"#, &ground, 0.05, 1.0, &[]);
    (0..600).for_each(|_| sliding.step().unwrap());
    let (stopped, expected) = (sliding.state(), 1.0 / (2.0 * 0.4 * 9.81));
    println!("box stops after {:.4} m, theory {expected:.4} m", stopped.q[0]);
    assert!((stopped.q[0] / expected - 1.0).abs() < 0.03 && stopped.v[0].abs() < 1e-3, "{stopped:?}");
    for restitution in [0.0, 0.6] {
        let set = [("contact.restitution", restitution)];
        let mut ball = body(r#"<sphere radius="0.1"/>"#, &Terrain::plane(), 0.6, 0.0, &set);
        let (mut down, mut up) = (0.0f64, 0.0f64);
        for _ in 0..500 {
            ball.step().unwrap();
            let speed = ball.state().v[2];
            (down, up) = (down.min(speed), up.max(speed));
        }
        println!("restitution {restitution}: ball leaves with {:.3} of its speed", -up / down);
        assert!((-up / down - restitution).abs() < 0.03, "{up} after {down}");
    }
}

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

const PATCH: [(&str, f64); 5] = [
    ("terrain.patch.friction", 0.05),
    ("terrain.patch.x_min", -4.0),
    ("terrain.patch.x_max", 4.0),
    ("terrain.patch.y_min", -4.0),
    ("terrain.patch.y_max", 4.0),
];
const TIGHT: [(&str, f64); 3] = [
    ("actuator.FL_calf_joint.torque_limit", 2.0),
    ("actuator.FL_calf_joint.speed_knee", 0.1),
    ("actuator.FL_calf_joint.speed_zero", 20.0),
];

/// What must be set beside a parameter for it to act.
fn companions(name: &str) -> Vec<(String, f64)> {
    let owned = |rows: &[(&str, f64)]| rows.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    match name {
        _ if name == PATCH[0].0 => owned(&PATCH[1..]),
        _ if name.starts_with("terrain.patch") => owned(&PATCH),
        "external.start" | "external.duration" => owned(&[("external.force_x", 10.0)]),
        _ if name.contains(".speed_") => owned(&TIGHT),
        // At 600 s two fifths of the strength are left.
        "run.start" => owned(&[("actuator.FL_calf_joint.strength_drift", -0.001)]),
        _ if name.contains(".payload_") && !name.ends_with("mass") => {
            let link = name.split(".payload_").next().unwrap_or_default();
            vec![(format!("{link}.payload_mass"), 0.2)]
        }
        _ => Vec::new(),
    }
}

/// A value far from neutral, tight where the parameter is a limit.
fn far(info: &ParameterInfo) -> f64 {
    let (low, high) = info.range;
    match info.name.as_str() {
        name if name.ends_with("torque_limit") => 0.5,
        name if name.ends_with("speed_knee") => 0.01,
        name if name.ends_with("speed_zero") => 0.5,
        "external.duration" | "external.start" => 0.05,
        name if name.starts_with("terrain.patch") && name.ends_with("_min") => 3.9,
        name if name.starts_with("terrain.patch") && name.ends_with("_max") => -3.9,
        // A quarter of a metre for the mass that goes with it.
        name if name.contains(".payload_moment_") => 0.05,
        // Keeps a light link's mass positive.
        name if name.ends_with("payload_mass") => high,
        _ if (low - info.neutral).abs() > (high - info.neutral).abs() => low,
        _ => high,
    }
}

/// Readings while the robot lands and trots off, with some parameters set.
fn readings(terrain: &Terrain, set: &[(String, f64)]) -> Vec<SensorReading> {
    let mut robot = engine(terrain);
    let mut start = standing(0.01);
    start.v[0] = 0.5;
    robot.set_state(&start).unwrap();
    for (name, value) in set {
        robot.set_parameter(name, *value).unwrap();
    }
    let trot = Trot { ramp: 0.05, ..Trot::default() };
    (0..8)
        .map(|part| {
            drive(&mut robot, 20 * part..20 * (part + 1), |t| trot.target(t));
            robot.sensors()
        })
        .collect()
}

/// The same readings from qv-sim.
fn readings_of_first(terrain: &Terrain, set: &[(String, f64)]) -> Vec<SensorReading> {
    let options = SimOptions { max_command_latency: 0.1, max_sensor_latency: 0.1, ..Default::default() };
    let mut robot = Batch::<f64>::new(&go2(), terrain, &options, 1).unwrap();
    let mut start = standing(0.01);
    start.v[0] = 0.5;
    for (name, value) in set {
        robot.set_parameter(0, name, *value).unwrap();
    }
    robot.set_state(0, &start).unwrap();
    let trot = Trot { ramp: 0.05, ..Trot::default() };
    let mut out = Vec::new();
    for step in 0..160 {
        let q = trot.target(f64::from(step) * 0.001);
        let (kp, kd, zero) = ([DEFAULT_KP; 12], [DEFAULT_KD; 12], [0.0; 12]);
        robot.set_command(0, &JointCommand { q: &q, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        robot.step();
        if step % 20 == 19 {
            out.push(robot.sensors(0).unwrap());
        }
    }
    out
}

/// What a parameter changes in the smooth readings, each in a typical unit of its own. Accelerations and forces are
/// left out: while feet land they say more of the contact than of the parameter.
fn effect(plain: &[SensorReading], changed: &[SensorReading]) -> Vec<f64> {
    let flat = |r: &SensorReading| -> Vec<f64> {
        let scaled = |values: &[f64], unit: f64| values.iter().map(|x| x / unit).collect::<Vec<_>>();
        [
            scaled(&r.q, 0.01),
            scaled(&r.dq, 1.0),
            scaled(&r.gyro, 0.3),
            scaled(&r.imu_orientation, 0.005),
            scaled(&r.base_position, 0.005),
            scaled(&r.base_orientation, 0.005),
        ]
        .concat()
    };
    let pairs = plain.iter().zip(changed).flat_map(|(a, b)| flat(a).into_iter().zip(flat(b)));
    pairs.map(|(a, b)| b - a).collect()
}

/// Where the engines differ by construction: after its soft pass rapier solves contact velocities once more without any
/// give, so that compliance hardly acts, and it bounces a contact at once where qv-sim's spring takes its time.
const OTHER_CONTACT: [&str; 3] = ["contact.time_constant", "contact.damping_ratio", "contact.restitution"];

/// Same sign, same axis, same size: the effect of each parameter in this engine lies along its effect in qv-sim.
/// Measured: cosines from 0.69, mostly above 0.98; sizes within a factor of 1.4.
#[test]
fn effects_point_the_same_way_in_both_engines() {
    let plane = Terrain::plane();
    let both = |set: &[(String, f64)]| (readings(&plane, set), readings_of_first(&plane, set));
    let plain = both(&[]);
    let (mut compared, mut unseen) = (0, Vec::new());
    for info in engine(&plane).catalogue().iter().filter(|info| of_interest(&info.name)) {
        let name = info.name.as_str();
        // Ground at the end of its range would swallow the feet.
        let value = if name == "terrain.height" { 0.005 } else { far(info) };
        let lacks = engine(&plane).set_parameter(name, value).is_err();
        if lacks || OTHER_CONTACT.contains(&name) {
            continue;
        }
        let beside = companions(name);
        let before = if beside.is_empty() { plain.clone() } else { both(&beside) };
        let after = both(&beside.into_iter().chain([(name.to_owned(), value)]).collect::<Vec<_>>());
        let (second, first) = (effect(&before.0, &after.0), effect(&before.1, &after.1));
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (size, other) = (dot(&first, &first).sqrt(), dot(&second, &second).sqrt());
        if size == 0.0 && other == 0.0 {
            unseen.push(name.to_owned());
            continue;
        }
        let cosine = dot(&first, &second) / (size * other);
        println!("{name} {value}: cosine {cosine:.3}, sizes {size:.3} and {other:.3}");
        assert!(cosine > 0.6, "{name}: cosine {cosine}");
        assert!((0.6..1.7).contains(&(other / size)), "{name}: {other} against {size}");
        compared += 1;
    }
    assert!(compared > 50, "{compared}");
    // These act on what `effect` leaves out.
    let expected = ["sensor.FL_calf_joint.torque_scale", "sensor.imu.acc_bias_x", "sensor.imu.acc_bias_y"];
    assert_eq!(unseen[..3], expected);
    assert_eq!(unseen[3..], ["sensor.imu.acc_bias_z", "sensor.foot_force.scale"]);
}

/// One leg's last joint stands for all joints, its link and the base for all links.
fn of_interest(name: &str) -> bool {
    let of_one_part = ["_joint", "link.", "geom."].iter().any(|part| name.contains(part));
    name.contains("FL_calf") || name.contains(".base.") || !of_one_part
}

#[test]
fn each_parameter_acts_or_says_that_it_cannot() {
    let (lawn, plane) = (lawn(), Terrain::plane());
    let whole = engine(&lawn);
    let plain = [readings(&lawn, &[]), readings(&plane, &[])];
    let (mut acting, mut lacking) = (0, Vec::new());
    for info in whole.catalogue().iter().filter(|info| of_interest(&info.name)) {
        let value = far(info);
        // Ground without a material only exists on the plane.
        let (terrain, plain) = if info.name == "contact.friction" { (&plane, &plain[1]) } else { (&lawn, &plain[0]) };
        let mut alone = engine(terrain);
        alone.set_parameter(&info.name, info.neutral).unwrap();
        match alone.set_parameter(&info.name, value) {
            Err(SimError::NotInSecondEngine { name, .. }) => {
                assert_eq!(name, info.name);
                lacking.push(name);
                continue;
            }
            other => other.unwrap(),
        }
        assert_eq!(alone.parameter(&info.name).unwrap(), value);
        let beside = companions(&info.name);
        let before = if beside.is_empty() { plain.clone() } else { readings(terrain, &beside) };
        let all: Vec<_> = beside.into_iter().chain([(info.name.clone(), value)]).collect();
        assert!(readings(terrain, &all) != before, "{} at {value} does nothing", info.name);
        acting += 1;
    }
    println!("{acting} parameters act; without a counterpart: {lacking:?}");
    let of_servo = qv_sim::servos::KEYS.iter().map(|key| format!("joint.FL_calf_joint.{key}"));
    let of_contact =
        ["torsional_friction", "rolling_friction", "friction_drop", "friction_speed", "yield_force", "sink_rate"]
            .map(|field| format!("contact.{field}"));
    assert_eq!(lacking, of_servo.chain(of_contact).collect::<Vec<_>>());
    assert!(acting > 60, "{acting}");
}

#[test]
fn the_same_run_gives_the_same_bits() {
    assert_eq!(readings(&lawn(), &[]), readings(&lawn(), &[]));
}

#[test]
fn a_parameter_set_to_neutral_in_mid_run_changes_nothing_but_the_solver_s_memory() {
    let run = |touch: bool| {
        let mut robot = engine(&Terrain::plane());
        drive(&mut robot, 0..500, |_| STAND);
        if touch {
            robot.set_parameter("joint.FL_calf_joint.armature", ARMATURE).unwrap();
        }
        drive(&mut robot, 500..600, |_| STAND);
        robot.state()
    };
    let (plain, touched) = (run(false), run(true));
    for (a, b) in plain.q.iter().zip(&touched.q) {
        assert!((a - b).abs() < 2e-4, "{plain:?} {touched:?}");
    }
}

#[test]
fn outside_forces_may_change_at_every_step() {
    let set = |robot: &mut RapierEngine| {
        robot.set_parameter("external.force_x", 6.0).unwrap();
        robot.set_parameter("joint.FL_calf_joint.external_torque", 0.5).unwrap();
    };
    let run = |often: bool| {
        let mut robot = engine(&Terrain::plane());
        set(&mut robot);
        for step in 0..300 {
            if often {
                // Away and back: what is left is the same, and the contact solver must not have forgotten anything.
                robot.set_parameter("external.force_x", 0.0).unwrap();
                set(&mut robot);
            }
            drive(&mut robot, step..step + 1, |_| STAND);
        }
        robot.state()
    };
    let (once, often) = (run(false), run(true));
    assert_eq!(once, often);
    let mut calm = engine(&Terrain::plane());
    drive(&mut calm, 0..300, |_| STAND);
    let moved = once.q[0] - calm.state().q[0];
    assert!(moved > 1e-4, "{moved} m");
    let index = calm.parameter_index("external.force_x").unwrap();
    calm.set_parameter_at(index, 3.0).unwrap();
    assert_eq!(calm.parameter("external.force_x").unwrap(), 3.0);
    assert!(calm.set_parameter_at(100_000, 3.0).is_err());
}

#[test]
fn nonsense_is_refused_by_name() {
    let mut robot = engine(&Terrain::plane());
    let named = |error: SimError, part: &str| assert!(error.to_string().contains(part), "{error}");
    named(robot.set_parameter("joint.FL_calf_joint.armatur", 0.0).unwrap_err(), "nearest");
    named(robot.set_parameter("joint.FL_calf_joint.armature", f64::NAN).unwrap_err(), "armature");
    named(robot.set_parameter("link.FL_calf.payload_mass", -1.0).unwrap_err(), "FL_calf");
    named(robot.set_parameter("sensor.pose.delay", 2.0).unwrap_err(), "sensor.pose.delay");
    // What was refused is not in force.
    assert_eq!(robot.parameter("link.FL_calf.payload_mass").unwrap(), 0.0);
    named(robot.set_state(&State { q: vec![0.0; 3], v: vec![0.0; 18] }).unwrap_err(), "positions");
    let mut state = standing(0.0);
    state.v[4] = f64::INFINITY;
    named(robot.set_state(&state).unwrap_err(), "velocity 4");
    let options = RapierOptions { substeps: 0, ..Default::default() };
    assert!(RapierEngine::new(&go2(), &Terrain::plane(), &options).is_err());
    drive(&mut robot, 0..10, |_| STAND);
}
