//! Folders of files for tests.

use std::fmt::Write;
use std::fs;
use std::path::PathBuf;

/// An empty folder of a test.
pub fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("open").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// A pendulum of one joint about the y axis, 0.5 m long, with a damper of its own.
pub const PENDULUM: &str = r#"<robot name="pendulum"><link name="base"/>
<joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/><dynamics damping="0.05"/></joint>
<link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;

/// What `run.toml` says of it.
pub const DESCRIPTION: &str =
    "robot = \"pendulum.urdf\"\nbase = \"fixed\"\n[actuator]\nkind = \"pd\"\nkp = 4\nkd = 0.1\n";

/// A table of `rows` at 100 Hz: position \[rad\] as `value` gives it, commands twice as far.
pub fn pendulum_table(rows: u32, value: impl Fn(u32) -> f64) -> String {
    let mut csv = "time,cmd_pos.hinge,pos.hinge,vel.hinge\n".to_string();
    (0..rows).for_each(|k| _ = writeln!(csv, "{},{},{},0", 0.01 * f64::from(k), 2.0 * value(k), value(k)));
    csv
}
