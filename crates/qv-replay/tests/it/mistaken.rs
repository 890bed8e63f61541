//! Joints that are turned round or exchanged in all channels, which the simulator shows.

use qv_core::JointSeries;
use qv_recording::Run;
use qv_recording::run::{Base, Robot};
use qv_replay::{JointMistake, ReplayOptions, mistaken_joints};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};

const ARM: &str = r#"<robot name="arm">
<link name="bench"/>
<link name="upper"><inertial><origin xyz="0.02 0 -0.15"/><mass value="1.6"/><inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.03 0 -0.12"/><mass value="0.9"/><inertia ixx="0.004" iyy="0.004" izz="0.0006" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="bench"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"#;

fn model() -> Model {
    Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap()
}

/// Six seconds of the arm at 500 Hz.
fn recorded() -> Run {
    let model = model();
    let mut batch = Batch::<f64>::new(&model, &Terrain::none(), &SimOptions::default(), 1).unwrap();
    let mut run = Run::empty(Robot::Urdf(ARM.into()), Base::Fixed, model.joint_names().to_vec());
    let (mut time, mut channels) = (Vec::new(), [const { Vec::new() }; 4]);
    for tick in 0..6000 {
        let t = f64::from(tick) * 1e-3;
        let held = f64::from(tick / 2) * 2e-3;
        let command = [0.6 + 0.5 * (2.1 * held).sin(), 0.3 + 0.6 * (3.3 * held).sin()];
        if tick % 2 == 0 {
            let seen = batch.sensors(0).unwrap();
            time.push(t);
            let rows = [&seen.q, &seen.dq, &seen.tau, &command.to_vec()];
            channels.iter_mut().zip(rows).for_each(|(channel, row)| channel.extend_from_slice(row));
        }
        let (zero, kp, kd) = ([0.0; 2], [25.0; 2], [0.8; 2]);
        batch.set_command(0, &JointCommand { q: &command, dq: &zero, kp: &kp, kd: &kd, tau: &zero }).unwrap();
        batch.step();
    }
    let [q, dq, tau, command] = channels;
    let series = |values: Vec<f64>| Some(JointSeries { time: time.clone(), values, joints: 2 });
    (run.measured.position, run.measured.velocity, run.measured.torque) = (series(q), series(dq), series(tau));
    run.commands.position = series(command);
    (run.actuator.kp, run.actuator.kd) = (Some(25.0), Some(0.8));
    run
}

fn found(run: &Run) -> Option<JointMistake> {
    let found = mistaken_joints(run, &model(), &Terrain::none(), &ReplayOptions::default()).unwrap();
    found.map(|found| found.mistake)
}

#[test]
fn turned_and_exchanged_joints_are_found_and_undone() {
    let right = recorded();
    assert_eq!(found(&right), None);
    for mistake in [JointMistake::Turned(0), JointMistake::Turned(1), JointMistake::Exchanged(0, 1)] {
        let mut run = right.clone();
        mistake.undo(&mut run);
        assert_eq!(found(&run), Some(mistake));
        mistake.undo(&mut run);
        assert_eq!(run, right);
        assert!(mistake.words(&run.joint_names).contains("in all channels"));
    }
}
