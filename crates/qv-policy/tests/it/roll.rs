//! Descriptions, observations and rolls.

use crate::facts::States;
use qv_policy::gait::{GaitMeter, GaitScale};
use qv_policy::roll::{Description, Numbers, Observer, RobotState, RollError, roll};
use qv_sim::{Batch, Model, ModelOptions, Shape, SimOptions, State, Terrain};
use std::path::{Path, PathBuf};

const FILES: [&str; 3] = ["rl_sar_go2", "dls_go2", "playground_go1"];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../qv-go2/descriptions")
}

fn text(name: &str) -> String {
    std::fs::read_to_string(folder().join(format!("{name}.toml"))).unwrap()
}

fn model(name: &str) -> Model {
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots");
    let urdf = match name {
        "playground_go1" => std::fs::read_to_string(robots.join("go1.urdf")).unwrap(),
        _ => qv_go2::model::urdf(),
    };
    Model::from_urdf(&urdf, &ModelOptions { armature: 0.01, ..Default::default() }).unwrap()
}

fn batch(model: &Model, description: &Description) -> Batch<f64> {
    let terrain = Terrain::plane().with_friction(description.simulation.friction).unwrap();
    let options = SimOptions { timestep: description.simulation.timestep, ..Default::default() };
    Batch::new(model, &terrain, &options, 1).unwrap()
}

/// Level, at rest, in the description's stand.
fn standing(model: &Model, description: &Description, height: f64) -> State {
    let mut q = vec![0.0; model.nq()];
    (q[2], q[3]) = (height, 1.0);
    for (joint, angle) in description.joints.iter().zip(&description.stand) {
        q[7 + model.joint_index(joint).unwrap()] = *angle;
    }
    State { q, v: vec![0.0; model.nv()] }
}

#[test]
fn the_descriptions_have_the_lengths_of_their_policies() {
    for (name, frame, observations) in [("rl_sar_go2", 45, 45), ("dls_go2", 52, 260), ("playground_go1", 48, 48)] {
        let description = Description::from_toml(&text(name)).unwrap();
        assert_eq!((description.frame(), description.observations()), (frame, observations), "{name}");
        let model = model(name);
        for (joint, angle) in description.joints.iter().zip(&description.stand) {
            let joint = &model.joints[model.joint_index(joint).unwrap()];
            assert!(joint.lower < *angle && *angle < joint.upper, "{name} {}", joint.name);
        }
    }
}

#[test]
fn action_zero_stands() {
    for name in FILES {
        let mut description = Description::from_toml(&text(name)).unwrap();
        // A policy balances on softer springs; without one, these of 20 N m/rad let the Go2 fall over, in MuJoCo, too.
        (description.kp, description.kd) = (Numbers::One(60.0), Numbers::One(2.0));
        let model = model(name);
        let start = standing(&model, &description, 0.32);
        let mut batch = batch(&model, &description);
        let zeros = |observation: &[f32]| -> Result<Vec<f32>, RollError> {
            assert_eq!(observation.len(), description.observations());
            Ok(vec![0.0; 12])
        };
        let rolled = roll(&mut batch, &description, &start, ([0.0; 3], 2.0), &[], zeros).unwrap();
        assert_eq!((rolled.time.len(), rolled.observations.len()), (101, 100));
        let end = rolled.base.last().unwrap();
        assert!(end[0].hypot(end[1]) < 0.03 && end[2] > 0.2 && end[3] > 0.999, "{name}: {end:?}");
        // By the measures of gaits it stands on all feet, and a command to move finds it without a swing.
        let is_foot = |g: &usize| matches!(model.geoms[*g].shape, Shape::Sphere(_));
        let feet: Vec<usize> = (0..model.geoms.len()).filter(is_foot).collect();
        let efforts = vec![Some(20.0); 12];
        let scale = GaitScale { dt: 1.0 / description.rate as f32, mass: model.mass() as f32, height: 0.3, efforts };
        let mut meter = GaitMeter::new(&scale, feet.len());
        rolled.measure([0.0; 3], &feet, &mut meter);
        rolled.measure([0.5, 0.0, 0.0], &feet, &mut meter);
        let gait = meter.gait();
        assert_eq!((feet.len(), gait.stand, gait.fell), (4, Some(1.0), 0), "{name}: {gait:?}");
        assert!((gait.velocity_error.unwrap() - 0.5).abs() < 0.02 && gait.feet[0].swing.is_none(), "{name}: {gait:?}");
        // It carries its weight: knees bear torque, and their springs are stretched by it.
        let (torques, joints) = (rolled.torques.last().unwrap(), rolled.joints.last().unwrap());
        for k in (0..12).filter(|&k| description.joints[k].contains("calf")) {
            let spring = description.kp.at(k) * (description.stand[k] - joints[k]);
            assert!(torques[k].abs() > 1.0 && (torques[k] - spring).abs() < 0.1, "{name}: {} {spring}", torques[k]);
        }
        let repeated = roll(&mut batch, &description, &start, ([0.0; 3], 2.0), &[], zeros).unwrap();
        assert_eq!(repeated, rolled, "{name}: a second roll gives the same bits");
        // What was calibrated wins over what the description says.
        let knee = (0..12).find(|&k| description.joints[k].contains("calf")).unwrap();
        let weak = [(format!("actuator.{}.torque_limit", description.joints[knee]), 0.5)];
        let limited = roll(&mut batch, &description, &start, ([0.0; 3], 0.2), &weak, zeros).unwrap();
        assert!(limited.torques.iter().all(|torques| torques[knee].abs() <= 0.5 + 1e-9), "{name}");
        assert!(rolled.torques.iter().any(|torques| torques[knee].abs() > 1.0), "{name}");
    }
}

/// A small description with every term, joints in another order than the model's.
const EVERY_TERM: &str = r#"
name = "every term"
rate = 50.0
joints = ["b", "a"]
stand = [0.5, -0.25]
kp = [10.0, 20.0]
kd = 0.5
action_scale = 0.1
[observation]
clip = 3.0
terms = [
    { term = "linear_velocity", at = [0.0, 0.0, 2.0], scale = 2.0 },
    { term = "gyro", scale = [1.0, 2.0, 3.0] },
    { term = "gravity" },
    { term = "command" },
    { term = "joint_positions" },
    { term = "joint_velocities", scale = 0.05 },
    { term = "last_action" },
    { term = "clock", frequency = 2.0, offsets = [0.0, 0.5], form = "sin_cos", standing = -1.0 },
    { term = "height" },
]
"#;

fn seen<'a>(actions: usize, command: [f64; 3]) -> RobotState<'a> {
    // Turned by 90 degrees to the left: the base's x is the world's y.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    RobotState {
        base: [1.0, 2.0, 0.3, half, 0.0, 0.0, half],
        velocity: [0.0, 1.0, 0.0, 0.25, 0.0, 0.5],
        joints: &[0.75, 0.25],
        speeds: &[2.0, -4.0],
        command,
        last_action: &[7.0, -1.0],
        actions,
    }
}

#[test]
fn every_term_by_hand() {
    let description = Description::from_toml(EVERY_TERM).unwrap();
    assert_eq!(description.frame(), 12 + 6 + 4 + 1);
    let found = Observer::new(&description).observe(&seen(0, [0.5, 0.0, 0.1]));
    // Forward 1 m/s; 2 m above a base that rolls by 0.25 rad/s moves to the right: (wx, 0, wz) x (0, 0, 2) = (0, -0.5, 0).
    let expected = [
        2.0, -1.0, 0.0, 0.25, 0.0, 1.5, 0.0, 0.0, -1.0, 0.5, 0.0, 0.1, 0.25, 0.5, 0.1, -0.2, 3.0, -1.0, 0.0, 0.0, 1.0,
        -1.0, 0.3,
    ];
    assert_eq!(found.len(), expected.len());
    for (k, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((f64::from(*a) - b).abs() < 1e-6, "number {k}: {a}, expected {b}");
    }
    // 1/16 of a round later sin and cos of the first clock are equal, and a robot that stands has no clock.
    let mut description = description;
    description.rate = 16.0;
    let clock = Observer::new(&description).observe(&seen(1, [0.5, 0.0, 0.1]))[18..22].to_vec();
    assert!((clock[0] - clock[2]).abs() < 1e-6 && (clock[0] - 0.5_f32.sqrt()).abs() < 1e-6, "{clock:?}");
    assert_eq!(Observer::new(&description).observe(&seen(1, [0.0; 3]))[18..22], [-1.0; 4]);
}

#[test]
fn histories_by_frame_and_by_term() {
    let base = r#"
name = "history"
rate = 50.0
joints = ["a"]
stand = [0.0]
kp = 1.0
kd = 0.0
action_scale = 1.0
observation = { history = { length = 2, layout = "LAYOUT", order = "ORDER", start = "START" }, terms = [
    { term = "last_action" }, { term = "height" } ] }
"#;
    let observe = |layout: &str, order: &str, start: &str| {
        let text = base.replace("LAYOUT", layout).replace("ORDER", order).replace("START", start);
        let description = Description::from_toml(&text).unwrap();
        let mut observer = Observer::new(&description);
        let at = |action: &'static [f64], height: f64| RobotState {
            base: [0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0],
            last_action: action,
            joints: &[0.0],
            speeds: &[0.0],
            ..seen(0, [0.0; 3])
        };
        [observer.observe(&at(&[1.0], 10.0)), observer.observe(&at(&[2.0], 20.0))]
    };
    assert_eq!(observe("frame", "oldest_first", "zeros"), [[0.0, 0.0, 1.0, 10.0], [1.0, 10.0, 2.0, 20.0]]);
    assert_eq!(observe("frame", "newest_first", "repeat"), [[1.0, 10.0, 1.0, 10.0], [2.0, 20.0, 1.0, 10.0]]);
    assert_eq!(observe("term", "oldest_first", "zeros"), [[0.0, 1.0, 0.0, 10.0], [1.0, 2.0, 10.0, 20.0]]);
    assert_eq!(observe("term", "newest_first", "repeat")[1], [2.0, 1.0, 20.0, 10.0]);
}

#[test]
fn what_is_wrong_in_a_description_is_named() {
    let refused = |from: &str, to: &str| {
        assert!(EVERY_TERM.contains(from), "{from}");
        Description::from_toml(&EVERY_TERM.replacen(from, to, 1)).unwrap_err().to_string()
    };
    assert_eq!(
        refused("stand = [0.5, -0.25]", "stand = [0.5]"),
        "description, `stand`: expected a number, or 2 of them, found 1 numbers"
    );
    assert_eq!(refused("rate = 50.0", "rate = -1.0"), "description, `rate`: expected above 0, found -1");
    assert_eq!(refused("rate = 50.0", "rate = nan"), "description, `rate`: expected above 0, found NaN");
    assert!(refused("rate = 50.0", "rate = 51.0").contains("simulation.timestep"));
    assert!(refused(r#"["b", "a"]"#, r#"["a", "a"]"#).states("`a`"));
    assert!(refused("scale = [1.0, 2.0, 3.0]", "scale = [1.0]").contains("observation.terms[1].scale"));
    assert!(refused("frequency = 2.0", "frequency = 0.0").contains("observation.terms[7].frequency"));
    assert!(refused("term = \"gyro\"", "term = \"gyros\"").contains("gyros"));
    assert_eq!(
        refused(r#""command" }"#, r#""command", scales = 2.0 }"#),
        "description, `observation.terms[3]`: expected keys among term, scale, found scales"
    );
    assert!(refused("standing = -1.0", "stand = -1.0").states("stand"));
    assert!(refused("clip = 3.0", "clips = 3.0").contains("clips"));
    assert!(Description::from_toml("name = 3").unwrap_err().to_string().starts_with("description:"));
}

#[test]
fn what_goes_wrong_in_a_roll_is_named() {
    let description = Description::from_toml(&text("rl_sar_go2")).unwrap();
    let model = model("rl_sar_go2");
    let start = standing(&model, &description, 0.32);
    let mut batch = batch(&model, &description);
    let rolled = |batch: &mut Batch<f64>, command: [f64; 3], duration: f64| {
        let zeros = |_: &[f32]| Ok::<_, RollError>(vec![0.0; 12]);
        roll(batch, &description, &start, (command, duration), &[], zeros).unwrap_err().to_string()
    };
    let found = rolled(&mut batch, [0.0; 3], f64::INFINITY);
    assert_eq!(found, "duration of a roll: expected 0 to 1e6 s, found inf");
    let found = rolled(&mut batch, [0.0, f64::NAN, 0.0], 1.0);
    assert_eq!(found, "commanded velocity: expected finite numbers, found NaN");
    let mut refused = |description: &Description, action: Result<Vec<f32>, String>| {
        roll(&mut batch, description, &start, ([0.0; 3], 1.0), &[], |_| action.clone()).unwrap_err().to_string()
    };
    assert_eq!(
        refused(&description, Ok(vec![0.0; 11])),
        "action at 0.000 s: expected 12 finite numbers, found 11 numbers"
    );
    let mut action = vec![0.0; 12];
    action[3] = f32::NAN;
    assert_eq!(refused(&description, Ok(action)), "action at 0.000 s: expected 12 finite numbers, found NaN");
    assert_eq!(refused(&description, Err("no file".into())), "policy, at 0.000 s: no file");
    let mut other = description.clone();
    other.joints[2] = "tail".into();
    assert!(refused(&other, Ok(vec![0.0; 12])).states("`tail`"));
    let mut other = description.clone();
    other.simulation.timestep = 0.002;
    let expected = "description, `simulation.timestep`: expected that of the batch, 0.001 s, found 0.002";
    assert_eq!(refused(&other, Ok(vec![0.0; 12])), expected);
}
