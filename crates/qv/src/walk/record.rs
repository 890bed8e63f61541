//! `qv walk record`: what a robot with hidden effects records under a policy.

use super::inputs::{as_trained, ground_of, policy_of, robot_of, urdf_of};
use crate::open::{file_error, write_error};
use crate::whole::write_whole;
use crate::{Failure, Outcome, say};
use qv_core::JointSeries;
use qv_policy::policy::Policy;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::TaskRobot;
use qv_replay::Run;
use qv_residual::hidden::{Engine, Hidden, Order, wander};
use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

/// Longest walk of a recording \[s\]: a robot is taken back to its start now and then.
const WALK: f32 = 20.0;

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Effects {
    /// Effects that the simulator's parameters describe: latency, lag, friction, strength; joints that differ for odd seeds
    Inside,
    /// Latency, lag and one effect that no parameter describes: Stribeck, load, heat, elasticity or ripple, by the seed
    Outside,
    /// None
    Nothing,
}

#[derive(clap::Args)]
pub struct Record {
    /// policy.onnx of `qv walk train`, with policy.toml and checkpoint.bin beside it
    policy: PathBuf,
    /// go2, or a TOML file that describes a robot beside its URDF
    #[arg(long, default_value = "go2", value_name = "go2|FILE.toml")]
    robot: String,
    /// Where it walks
    #[arg(long, default_value = "plane", value_name = "plane|bumps|levels|FILE.glb")]
    ground: String,
    /// What is hidden in the robot
    #[arg(long, default_value = "inside")]
    effects: Effects,
    /// Minutes of all walks together
    #[arg(long, default_value_t = 10.0, value_name = "MINUTES", value_parser = crate::numbers::positive)]
    minutes: f64,
    /// Seed of the effects, the commands and the noise
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Directory for the recordings, one folder for each walk; made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Record {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let (_, file) = policy_of(&self.policy)?;
        let robot = as_trained(robot_of(&self.robot)?, &file, &self.policy)?;
        let policy = self.policy(&robot)?;
        let ground = ground_of(&self.ground, self.seed)?;
        let hidden = match self.effects {
            Effects::Inside => Hidden::inside(&robot, Engine::Ours, self.seed),
            Effects::Outside => Hidden::outside(&robot, Engine::Ours, self.seed),
            Effects::Nothing => Hidden::nothing(Engine::Ours),
        };
        if self.minutes > 600.0 {
            return Err(format!("--minutes: expected at most 600, found {}", self.minutes).into());
        }
        let count = (60.0 * self.minutes / f64::from(WALK)).ceil().max(1.0) as u64;
        let drawn: Vec<_> = (0..count).map(|k| wander(&file.commands, WALK, self.seed * 1000 + k)).collect();
        let places = &ground.places[0];
        let orders: Vec<Order> = drawn
            .iter()
            .zip(0u64..)
            .map(|(commands, k)| Order {
                commands,
                seconds: WALK,
                place: places[k as usize % places.len()],
                seed: self.seed * 1000 + k,
            })
            .collect();
        fs::create_dir_all(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let urdf = urdf_of(&self.robot)?;
        let bar = crate::open::progress(count, "walking");
        // A few at a time: recordings are large.
        for (part, orders) in orders.chunks(8).enumerate() {
            for (k, walk) in hidden.walks(&robot, &ground, &policy, file.rate, orders)?.iter().enumerate() {
                let folder = self.out.join(format!("walk_{:03}", 8 * part + k));
                fs::create_dir_all(&folder).map_err(|e| write_error(&folder, &e))?;
                write_whole(&folder.join("run.csv"), table(&walk.run)?.as_bytes())?;
                write_whole(&folder.join("run.toml"), description(&robot).as_bytes())?;
                write_whole(&folder.join("robot.urdf"), urdf.as_bytes())?;
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        let mut text = String::from("# What is hidden in the robot that walked.\n[parameters]\n");
        hidden.parameters.iter().for_each(|(name, x)| _ = writeln!(text, "\"{name}\" = {x:?}"));
        hidden.outside.iter().for_each(|effect| _ = writeln!(text, "# beside them: {effect:?}"));
        write_whole(&self.out.join("hidden.toml"), text.as_bytes())?;
        say(&format!("{count} walks of {WALK} s; written to {} (hidden.toml has the answer)\n", self.out.display()))?;
        Ok(Outcome::Done)
    }

    fn policy(&self, robot: &TaskRobot) -> Result<Policy, Failure> {
        let path = self.policy.with_file_name("checkpoint.bin");
        let expected = "checkpoint.bin of `qv walk train` beside the policy";
        let bytes = fs::read(&path).map_err(|e| file_error(&path, expected, &e.to_string()))?;
        let policy = Checkpoint::from_bytes(&bytes).and_then(|start| start.best_policy(robot));
        Ok(policy.map_err(|e| file_error(&path, expected, &e.to_string()))?)
    }
}

/// run.toml of a robot.
fn description(robot: &TaskRobot) -> String {
    format!(
        "robot = \"robot.urdf\"\nbase = \"free\"\n[actuator]\nkind = \"pd\"\nkp = {:?}\nkd = {:?}\n",
        robot.kp, robot.kd
    )
}

/// run.csv of a run: one row for each sample of the joints; what has no sample then is blank.
fn table(run: &Run) -> Result<String, Failure> {
    let joints = |prefix: &str| run.joint_names.iter().map(|n| format!("{prefix}.{n}")).collect::<Vec<_>>();
    let named = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let m = &run.measured;
    let all: [(&Option<JointSeries>, Vec<String>); 7] = [
        (&m.position, joints("pos")),
        (&m.velocity, joints("vel")),
        (&run.commands.position, joints("cmd_pos")),
        (&m.base_pose, named(&["base.x", "base.y", "base.z", "base.qw", "base.qx", "base.qy", "base.qz"])),
        (&m.orientation, named(&["imu.qw", "imu.qx", "imu.qy", "imu.qz"])),
        (&m.gyro, named(&["gyro.x", "gyro.y", "gyro.z"])),
        (&m.acceleration, named(&["acc.x", "acc.y", "acc.z"])),
    ];
    let Some(position) = &m.position else { return Err("a walk: expected samples, found none".into()) };
    let mut text = String::from("time");
    all.iter().flat_map(|(_, names)| names).for_each(|name| _ = write!(text, ",{name}"));
    text.push('\n');
    let mut next = [0usize; 7];
    for &time in &position.time {
        _ = write!(text, "{time:.3}");
        for ((series, names), next) in all.iter().zip(&mut next) {
            let row = series.as_ref().filter(|s| s.time.get(*next).is_some_and(|t| (t - time).abs() < 5e-4));
            match row {
                Some(series) => {
                    series.row(*next).iter().for_each(|x| _ = write!(text, ",{x:.5}"));
                    *next += 1;
                }
                None => names.iter().for_each(|_| text.push(',')),
            }
        }
        text.push('\n');
    }
    Ok(text)
}
