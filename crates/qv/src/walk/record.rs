//! `qv walk record`: what a robot with hidden effects records under a policy.

use super::inputs::urdf_of;
use super::made_up::MadeUp;
use crate::open::write_error;
use crate::output::{make_folder, write_whole};
use crate::{Failure, Outcome, say};
use qv_core::JointSeries;
use qv_policy::velocity::TaskRobot;
use qv_recording::Run;
use qv_residual::hidden::{Order, wander};
use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Record {
    /// Policy of `qv walk train` (policy.onnx, with policy.toml beside it)
    policy: PathBuf,
    #[command(flatten)]
    made_up: MadeUp,
    /// Set the total length of all walks
    #[arg(long, default_value_t = 10.0, value_name = "MINUTES", value_parser = crate::numbers::positive, help_heading = "What to test")]
    minutes: f64,
    /// Set the length of each walk
    #[arg(long, default_value_t = 20.0, value_name = "SECONDS", value_parser = crate::numbers::positive, help_heading = "What to test")]
    walk: f64,
    /// Write one folder per walk into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Record {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let walked = self.made_up.under(&self.policy)?;
        let (robot, ground, hidden, seed) = (&walked.robot, &walked.ground, &walked.hidden, self.made_up.seed);
        if self.minutes > 600.0 {
            return Err(format!("--minutes: expected at most 600, found {}", self.minutes).into());
        }
        if self.walk > 600.0 {
            return Err(format!("--walk: expected at most 600, found {}", self.walk).into());
        }
        if self.walk < 2.5 {
            let expected = "--walk: expected at least 2.5 s, since `qv tune` takes stretches of 2 s and longer";
            return Err(format!("{expected}, found {}", self.walk).into());
        }
        let seconds = self.walk as f32;
        let count = (60.0 * self.minutes / self.walk).ceil().max(1.0) as u64;
        let commands = &walked.task.commands;
        let drawn: Vec<_> = (0..count).map(|k| wander(commands, seconds, seed * 1000 + k)).collect();
        let places = &ground.places[0];
        let orders: Vec<Order> = drawn
            .iter()
            .zip(0u64..)
            .map(|(commands, k)| Order {
                commands,
                seconds,
                place: places[k as usize % places.len()],
                seed: seed * 1000 + k,
            })
            .collect();
        let is_walk = |e: fs::DirEntry| e.file_name().to_string_lossy().starts_with("walk_");
        if fs::read_dir(&self.out).is_ok_and(|list| list.flatten().any(is_walk)) {
            let found = "walks of another robot or seed";
            return Err(crate::open::file_error(&self.out, "a folder without walks for --out", found).into());
        }
        make_folder(&self.out).map_err(|e| write_error(&self.out, &e))?;
        let urdf = urdf_of(&self.made_up.robot)?;
        let bar = crate::progress::progress(count, "walking");
        // A few at a time: recordings are large.
        let (mut written, decisions) = (0u64, (seconds * walked.task.rate) as usize);
        for orders in orders.chunks(8) {
            for walk in hidden.walks(robot, ground, &walked.policy, &walked.task, orders)? {
                bar.inc(1);
                // Who lets a robot walk catches it when it falls, and begins again.
                if walk.path.len() < decisions {
                    continue;
                }
                let folder = self.out.join(format!("walk_{written:03}"));
                written += 1;
                make_folder(&folder).map_err(|e| write_error(&folder, &e))?;
                write_whole(&folder.join("run.csv"), table(&walk.run)?.as_bytes())?;
                write_whole(&folder.join("run.toml"), description(robot).as_bytes())?;
                write_whole(&folder.join("robot.urdf"), urdf.as_bytes())?;
            }
        }
        bar.finish_and_clear();
        write_whole(&self.out.join("hidden.toml"), walked.answer().as_bytes())?;
        if self.json {
            let line = serde_json::json!({
                "format": "qv-walk-record/1", "walks": written, "seconds": seconds, "fell": count - written, "out": self.out,
            });
            say(&format!("{line}\n"))?;
            return Ok(Outcome::Done);
        }
        say(&format!(
            "{written} walks of {seconds} s, {} more ended in a fall; written to {} (hidden.toml has the answer)\n",
            count - written,
            self.out.display()
        ))?;
        Ok(Outcome::Done)
    }
}

/// run.toml of a robot.
fn description(robot: &TaskRobot) -> String {
    let mut text = format!(
        "robot = \"robot.urdf\"\nbase = \"free\"\n[actuator]\nkind = \"pd\"\nkp = {:?}\nkd = {:?}\n",
        robot.kp, robot.kd
    );
    // No URDF says it.
    for joint in &robot.model.joints {
        _ = writeln!(text, "[joint.\"{}\"]\narmature = {:?}", joint.name, joint.armature);
    }
    text
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
