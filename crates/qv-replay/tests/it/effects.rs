//! Whatever the diagnosis can name, a replay with the right parameters shows closed: one recording for each effect of the library.

use qv_gap::problem::library::{Effect, LevelsOf, Scope, built_in};
use qv_go2::synthetic::{self, Robot};
use qv_recording::{BagFile, Run, read_bag, read_table};
use qv_replay::{ReplayOptions, replay};
use qv_rollout::channels::snippet;
use qv_rollout::feet_of;
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};
use std::fmt::Write;
use std::io::Cursor;

/// An arm of two links, held at its foot.
const ARM: &str = r#"<robot name="arm"><link name="bench"/>
<link name="upper"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/><inertia ixx="0.004" iyy="0.004" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.12"/><mass value="0.4"/><inertia ixx="0.002" iyy="0.002" izz="0.0003" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"#;
const ARM_SETTINGS: &str = "robot = \"arm.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 12.0\nkd = 0.4\n";
/// Longest delay of a command or a sensor in the recordings \[s\].
const LATENCY: f64 = 0.05;
/// Of the Go2's recording: it trots then \[s\].
const TROT: [f64; 2] = [6.2, 10.2];
/// What acts from outside begins and ends at \[s\], on the clock of a recording.
const OUTSIDE: [f64; 2] = [1.0, 30.0];

/// Parameters by name.
type NamedValues = Vec<(String, f64)>;

fn arm() -> Model {
    Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap()
}

fn go2() -> Model {
    let options = ModelOptions { base: BaseKind::Floating, armature: qv_go2::model::ARMATURE, ..Default::default() };
    Model::from_urdf(&qv_go2::model::urdf(), &options).unwrap()
}

/// Eight seconds of an arm that swings, without noise.
fn record_arm(parameters: &NamedValues) -> Run {
    let options = SimOptions { max_command_latency: LATENCY, max_sensor_latency: LATENCY, ..Default::default() };
    let mut batch = Batch::<f64>::new(&arm(), &Terrain::none(), &options, 1).unwrap();
    parameters.iter().for_each(|(name, value)| batch.set_parameter(0, name, *value).unwrap());
    let mut csv = "time".to_string();
    for channel in ["cmd_pos", "pos", "vel", "tau"] {
        write!(csv, ",{channel}.shoulder,{channel}.elbow").unwrap();
    }
    csv.push('\n');
    for tick in 0..8_000 {
        let time = f64::from(tick) * 1e-3;
        let command = [0.6 * (2.1 * time).sin() + 0.2 * (5.3 * time).sin(), 0.5 * (3.1 * time).sin()];
        if tick % 2 == 0 {
            let seen = batch.sensors(0).unwrap();
            let values = command.iter().chain(&seen.q).chain(&seen.dq).chain(&seen.tau);
            write!(csv, "{time:.4}").unwrap();
            values.for_each(|x| write!(csv, ",{x:.9}").unwrap());
            csv.push('\n');
        }
        let (zero, kp, kd) = ([0.0; 2], [12.0; 2], [0.4; 2]);
        batch.set_command(0, &JointCommand { q: &command, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        batch.step();
    }
    read_table(csv.as_bytes(), ARM_SETTINGS, Some(ARM), None).unwrap()
}

/// Four seconds of a Go2 that trots, with the noise of its sensors.
fn record_go2(parameters: &NamedValues) -> Run {
    // It settles for half a second before the recording begins, on the simulator's clock.
    let later = |(name, value): &(String, f64)| match name.as_str() {
        "external.start" => (name.clone(), value + 0.5),
        _ => (name.clone(), *value),
    };
    let robot = Robot { parameters: parameters.iter().map(later).collect(), seed: 11, start: [0.0; 3] };
    let messages = synthetic::record(&Terrain::plane(), &robot).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    synthetic::write_bag(&messages, &mut bytes).unwrap();
    bytes.set_position(0);
    let file = BagFile { name: "trot".into(), source: bytes };
    let run = read_bag(vec![file], &qv_go2::wire::mapping(None)).unwrap();
    Run { robot: run.robot.clone(), ..snippet(&run, TROT[0], TROT[1]) }
}

/// A robot, how it is recorded, and what it did without an effect.
struct Bench {
    model: Model,
    terrain: Terrain,
    record: fn(&NamedValues) -> Run,
    plain: Run,
}

impl Bench {
    fn new(model: Model, terrain: Terrain, record: fn(&NamedValues) -> Run) -> Self {
        let plain = record(&Vec::new());
        Self { model, terrain, record, plain }
    }

    /// What an effect acts on.
    fn members(&self, scope: Scope) -> Vec<String> {
        let links = || self.model.links.iter().filter(|l| l.mass > 0.0).map(|l| l.name.clone());
        match scope {
            Scope::Joints => self.model.joint_names().to_vec(),
            Scope::Base if self.model.base == BaseKind::Floating => links().take(1).collect(),
            Scope::Links | Scope::Base => links().collect(),
            Scope::Feet => {
                feet_of(&self.plain, &self.model).geoms.iter().map(|&g| self.model.geoms[g].name.clone()).collect()
            }
            Scope::Ground => vec!["contact".into()],
            Scope::World => vec!["all".into()],
        }
    }

    /// The effect at its strongest level, on all that it acts on.
    fn parameters(&self, effect: &Effect) -> NamedValues {
        let batch = Batch::<f64>::new(&self.model, &self.terrain, &SimOptions::default(), 1).unwrap();
        let weight = 9.81 * self.model.links.iter().map(|l| l.mass).sum::<f64>();
        let largest = |series: &Option<qv_core::JointSeries>, joint: usize| {
            series.as_ref().map_or(0.0, |s| s.column(joint).fold(0.0_f64, |most, x| most.max(x.abs())))
        };
        let mut all = Vec::new();
        for (index, member) in self.members(effect.scope).iter().enumerate() {
            let scale = match effect.levels_of {
                Some(LevelsOf::Torque) => largest(&self.plain.measured.torque, index),
                Some(LevelsOf::Speed) => largest(&self.plain.measured.velocity, index),
                Some(LevelsOf::Weight) => weight,
                None => 1.0,
            };
            let level = scale * effect.levels.last().unwrap();
            for (pattern, factor) in effect.axes.iter().flat_map(|a| &a.moves) {
                let slots = ["{joint}", "{link}", "{base}", "{foot}", "{ground}"];
                let name = slots.iter().fold(pattern.clone(), |p, slot| p.replace(slot, member));
                let neutral = batch.catalogue()[batch.parameter_index(&name).unwrap()].neutral;
                all.push((name, factor * level + if effect.absolute { 0.0 } else { neutral }));
            }
        }
        if effect.name.starts_with("external") {
            all.push(("external.start".into(), OUTSIDE[0]));
            all.push(("external.duration".into(), OUTSIDE[1] - OUTSIDE[0]));
        }
        all
    }

    /// Errors in windows: of positions \[mrad\], of torques \[N m\], both means of joints.
    fn errors(&self, run: &Run, parameters: &NamedValues) -> [f64; 2] {
        let options = ReplayOptions { parameters: parameters.clone(), ..Default::default() };
        let errors = replay(run, &self.model, &self.terrain, &options).unwrap().window_errors;
        let torque = errors.joints.iter().map(|j| j.torque).sum::<f64>() / errors.joints.len() as f64;
        [1e3 * errors.position_mean(), torque]
    }
}

/// Effects of ground that remembers: how far it has given way, or swings, when a window starts was not measured.
const REMEMBERED: [&str; 2] = ["ground_sinkage", "contact_restitution"];

/// Effects that positions of joints do not show in these recordings: on other channels, or of what a start is moved by.
const UNSEEN: [&str; 6] =
    ["supply_sag", "torque_sensor_scale", "terrain_height", "foot_radius", "gyro_bias", "pose_delay"];

#[test]
fn what_the_diagnosis_can_name_closes_in_a_replay() {
    let arm = Bench::new(arm(), Terrain::none(), record_arm);
    let go2 = Bench::new(go2(), Terrain::plane(), record_go2);
    for effect in built_in() {
        let bench = if effect.held_only { &arm } else { &go2 };
        let truth = bench.parameters(&effect);
        let run = (bench.record)(&truth);
        let [floor, _] = bench.errors(&bench.plain, &Vec::new());
        let [[without, _], [with, _]] = [bench.errors(&run, &Vec::new()), bench.errors(&run, &truth)];
        let closed = 1.0 - (with.powi(2) - floor.powi(2)) / (without.powi(2) - floor.powi(2));
        let is_seen = without > 1.3 * floor;
        let remarks = format!(
            "{}: {floor:.3} mrad without an effect; with it {without:.3}, with the right parameters {with:.3}: closed {closed:.3}",
            effect.name
        );
        if REMEMBERED.contains(&effect.name.as_str()) {
            assert!(with < without, "{remarks}");
        } else if is_seen {
            assert!(closed > 0.9, "{remarks}");
        } else {
            assert!(UNSEEN.contains(&effect.name.as_str()), "{remarks}");
            assert!(with < 1.15 * floor, "{remarks}");
        }
    }
}

#[test]
fn a_scaled_torque_sensor_closes_in_the_torques() {
    let go2 = Bench::new(go2(), Terrain::plane(), record_go2);
    let effect = built_in().into_iter().find(|e| e.name == "torque_sensor_scale").unwrap();
    let truth = go2.parameters(&effect);
    let run = record_go2(&truth);
    let floor = go2.errors(&go2.plain, &Vec::new())[1];
    let [without, with] = [go2.errors(&run, &Vec::new())[1], go2.errors(&run, &truth)[1]];
    assert!(without > 1.2 * floor && with < 1.05 * floor, "{floor} {without} {with}");
}
