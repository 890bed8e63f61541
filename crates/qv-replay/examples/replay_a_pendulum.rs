//! A pendulum with friction, recorded in the simulator, and its replay with the right friction and without.

use qv_replay::{ReplayOptions, replay, verdict};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};

const PENDULUM: &str = r#"<robot name="pendulum"><link name="bench"/><link name="rod"><inertial><origin xyz="0 0 -0.3"/><mass value="1.2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="pivot" type="revolute">
<parent link="bench"/><child link="rod"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint></robot>"#;
const FRICTION: &str = "joint.pivot.viscous_friction";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let model = Model::from_urdf(PENDULUM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() })?;
    let mut robot = Batch::<f64>::new(&model, &Terrain::none(), &SimOptions::default(), 1)?;
    robot.set_parameter(0, FRICTION, 0.4)?;
    let mut table = String::from("time,cmd_pos.pivot,pos.pivot\n");
    for tick in 0..6000 {
        let time = 0.001 * f64::from(tick);
        let command = 0.8 * (2.1 * time).sin() + 0.2 * (7.3 * time).sin();
        table += &format!("{time:.3},{command:.9},{:.9}\n", robot.sensors(0)?.q[0]);
        robot.set_command(0, &JointCommand { q: &[command], dq: &[0.0], kp: &[20.0], kd: &[0.6], tau: &[0.0] })?;
        robot.step();
    }
    let about = "robot = \"pendulum.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 20.0\nkd = 0.6\n";
    let run = qv_recording::read_table(table.as_bytes(), about, Some(PENDULUM), None)?;
    let mut errors = Vec::new();
    for parameters in [vec![], vec![(FRICTION.to_string(), 0.4)]] {
        let options = ReplayOptions { parameters, ..Default::default() };
        let found = replay(&run, &model, &Terrain::none(), &options)?;
        println!("{}", verdict(&found));
        errors.push(found.window_errors.position_mean());
    }
    assert!(errors[1] < 1e-3 && errors[0] > 10.0 * errors[1]);
    Ok(())
}
