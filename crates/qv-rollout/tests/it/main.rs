//! A pendulum recorded with one fault: what its windows leave with the right parameter and without, and how late its joint is.

use qv_recording::{Run, read_table};
use qv_rollout::{Channel, Overrides, Rollout, WindowOptions, compare, joint_lags};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};
use std::fmt::Write;

const PENDULUM: &str = r#"<robot name="pendulum"><link name="bench"/><link name="rod"><inertial><origin xyz="0 0 -0.3"/><mass value="1.2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="pivot" type="revolute">
<parent link="bench"/><child link="rod"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint></robot>"#;
const SETTINGS: &str = "robot = \"pendulum.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 20.0\nkd = 0.6\n";

fn model() -> Model {
    Model::from_urdf(PENDULUM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap()
}

/// Six seconds of a pendulum with one parameter that is not its model's.
fn recorded(name: &str, value: f64) -> Run {
    let options = SimOptions { max_command_latency: 0.05, max_sensor_latency: 0.05, ..Default::default() };
    let mut robot = Batch::<f64>::new(&model(), &Terrain::none(), &options, 1).unwrap();
    robot.set_parameter(0, name, value).unwrap();
    let mut table = String::from("time,cmd_pos.pivot,pos.pivot,vel.pivot\n");
    for tick in 0..6000 {
        let time = 0.001 * f64::from(tick);
        let command = 0.8 * (2.1 * time).sin() + 0.2 * (7.3 * time).sin();
        let seen = robot.sensors(0).unwrap();
        writeln!(table, "{time:.3},{command:.9},{:.9},{:.9}", seen.q[0], seen.dq[0]).unwrap();
        let given = JointCommand { q: &[command], dq: &[0.0], kp: &[20.0], kd: &[0.6], tau: &[0.0] };
        robot.set_command(0, &given).unwrap();
        robot.step();
    }
    read_table(table.as_bytes(), SETTINGS, Some(PENDULUM), None).unwrap()
}

fn rollout<'a>(run: &Run, model: &'a Model, given: &[(&str, f64)]) -> Rollout<'a> {
    let given: Vec<(String, f64)> = given.iter().map(|(name, value)| (name.to_string(), *value)).collect();
    Rollout::new(run, model, &Terrain::none(), &given, WindowOptions::default()).unwrap()
}

/// Root mean square of the position's residuals over all windows \[mrad\].
fn left(run: &Run, given: &[(&str, f64)]) -> f64 {
    let model = model();
    let rollout = rollout(run, &model, given);
    let windows = rollout.windows(run).unwrap();
    let all: Vec<_> = windows.iter().collect();
    let residuals = compare(&rollout, &rollout.numerics, &all, &[Overrides::new()]).unwrap();
    let bins = rollout.cut.bins();
    let at = bins * rollout.channels.iter().position(|c| *c == Channel::Position(0)).unwrap();
    let squares: Vec<f64> = residuals.values[0].iter().flat_map(|w| &w[at..at + bins]).map(|x| x * x).collect();
    1e3 * (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn windows_with_the_right_parameter_leave_less_than_a_milliradian() {
    let faults = [
        ("actuator.pivot.series_compliance", 0.02),
        ("actuator.pivot.command_latency", 0.02),
        ("sensor.pivot.encoder_latency", 0.02),
        ("actuator.pivot.lag", 0.02),
        ("actuator.pivot.strength_drift", -0.05),
        ("sensor.pivot.encoder_bias", 0.05),
        ("link.rod.length_scale", 1.1),
        ("joint.pivot.coulomb_friction", 0.3),
    ];
    for (name, value) in faults {
        let run = recorded(name, value);
        let (without, with) = (left(&run, &[]), left(&run, &[(name, value)]));
        assert!(with < 1.0 && without > 2.0 * with, "{name}: {without:.2} mrad without it, {with:.2} with it");
    }
}

#[test]
fn how_late_a_joint_is_is_found_by_its_replay() {
    let (model, latency) = (model(), "actuator.pivot.command_latency");
    let lag = |run: &Run, given: &[(&str, f64)]| joint_lags(&rollout(run, &model, given), run).unwrap()[0];
    let run = recorded(latency, 0.03);
    let found = lag(&run, &[]).unwrap();
    assert!((found - 0.03).abs() < 0.004, "{found}");
    let found = lag(&run, &[(latency, 0.03)]).unwrap();
    assert!(found.abs() < 0.001, "{found}");
    // A pendulum that hangs shows nothing.
    let mut still = run.clone();
    still.measured.position.iter_mut().for_each(|p| p.values.fill(0.0));
    still.measured.velocity.iter_mut().for_each(|v| v.values.fill(0.0));
    still.commands.position.iter_mut().for_each(|c| c.values.fill(0.0));
    assert_eq!(lag(&still, &[]), None);
}
