//! One window of a recorded pendulum, whose encoder sits on a motor behind a spring: where its simulation starts, and what is left of it.

use qv_rollout::{Channel, Overrides, Rollout, WindowOptions, compare};
use qv_sim::{BaseKind, Batch, JointCommand, Model, ModelOptions, SimOptions, Terrain};

const PENDULUM: &str = r#"<robot name="pendulum"><link name="bench"/><link name="rod"><inertial><origin xyz="0 0 -0.3"/><mass value="1.2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="pivot" type="revolute">
<parent link="bench"/><child link="rod"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="50" velocity="50"/></joint></robot>"#;
const SPRING: &str = "actuator.pivot.series_compliance";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let model = Model::from_urdf(PENDULUM, &ModelOptions { base: BaseKind::Fixed, ..Default::default() })?;
    let mut robot = Batch::<f64>::new(&model, &Terrain::none(), &SimOptions::default(), 1)?;
    robot.set_parameter(0, SPRING, 0.02)?;
    let mut table = String::from("time,cmd_pos.pivot,pos.pivot,vel.pivot\n");
    for tick in 0..4000 {
        let time = 0.001 * f64::from(tick);
        let command = 0.8 * (2.1 * time).sin() + 0.2 * (7.3 * time).sin();
        let seen = robot.sensors(0)?;
        table += &format!("{time:.3},{command:.9},{:.9},{:.9}\n", seen.q[0], seen.dq[0]);
        robot.set_command(0, &JointCommand { q: &[command], dq: &[0.0], kp: &[20.0], kd: &[0.6], tau: &[0.0] })?;
        robot.step();
    }
    let about = "robot = \"pendulum.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 20.0\nkd = 0.6\n";
    let run = qv_recording::read_table(table.as_bytes(), about, Some(PENDULUM), None)?;
    for given in [vec![], vec![(SPRING.to_string(), 0.02)]] {
        let rollout = Rollout::new(&run, &model, &Terrain::none(), &given, WindowOptions::default())?;
        let windows = rollout.windows(&run)?;
        let residuals = compare(&rollout, &rollout.numerics, &[&windows[3]], &[Overrides::new()])?;
        let bins = rollout.cut.bins();
        let joint = rollout.channels.iter().position(|c| *c == Channel::Position(0)).ok_or("no position")?;
        let of_joint = &residuals.values[0][0][joint * bins..(joint + 1) * bins];
        let worst = of_joint.iter().fold(0.0_f64, |worst, x| worst.max(x.abs()));
        println!(
            "{}: at most {:.2} mrad",
            if given.is_empty() { "without the spring" } else { "with it" },
            1e3 * worst
        );
        assert_eq!(worst < 1e-3, !given.is_empty());
    }
    Ok(())
}
