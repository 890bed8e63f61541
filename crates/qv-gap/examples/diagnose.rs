//! An arm of one joint whose motor answers 12 ms late, recorded in the simulator, and what the diagnosis says of it.

use qv_gap::{Options, diagnose};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};

const ARM: &str = r#"<robot name="arm"><link name="bench"/><link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="0.8"/>
<inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="shoulder" type="revolute">
<parent link="bench"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint></robot>"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let model = Model::from_urdf(ARM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() })?;
    let mut robot =
        Batch::<f64>::new(&model, &Terrain::none(), &SimOptions { timestep: 0.001, ..Default::default() }, 1)?;
    robot.set_parameter(0, "actuator.shoulder.lag", 0.012)?;
    let mut noise = qv_core::random::SplitMix64::new(7);
    let mut table = String::from("time,cmd_pos.shoulder,pos.shoulder\n");
    for tick in 0..8000 {
        let time = 0.001 * f64::from(tick);
        let command = 0.6 * (2.1 * time).sin() + 0.2 * (7.3 * time).sin();
        let position = robot.state(0)?.q[0] + noise.normal(1e-4);
        table += &format!("{time:.3},{command:.6},{position:.7}\n");
        robot.set_command(0, &JointCommand { q: &[command], dq: &[0.0], kp: &[12.0], kd: &[0.4], tau: &[0.0] })?;
        robot.step();
    }
    let about = "robot = \"arm.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 12.0\nkd = 0.4\n";
    let run = qv_recording::read_table(table.as_bytes(), about, Some(ARM), None)?;
    let report = diagnose(&[run], &model, &Terrain::none(), &Options::default(), 0)?.report;
    println!("{}", report.sentence);
    assert_eq!(report.causes[0].effect, "actuator_lag");
    assert!((report.causes[0].parameters[0].value - 0.012).abs() < 0.002);
    Ok(())
}
