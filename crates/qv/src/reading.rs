//! What recording a command reads, and how.

use clap::Args;
use std::path::{Path, PathBuf};

/// What recording to read, the same for every command.
#[derive(Args)]
pub struct RunArguments {
    /// Recording: bag, table, LeRobot dataset or SAGE folder
    ///
    /// A bag is an .mcap or .db3 file, or the directory of a split bag. A table is run.csv with run.toml beside it, or its directory.
    pub run: PathBuf,
    #[command(flatten)]
    pub reading: Reading,
}

/// How a recording is read, the same for every command.
#[derive(Args, Clone, Default)]
pub struct Reading {
    /// Set the robot: go2, go1, a2, ... or a URDF, MJCF or TOML file
    ///
    /// Names are those of `qv robots`. Without it the robot is that of the recording.
    #[arg(long, value_name = "ROBOT", help_heading = "Input")]
    pub robot: Option<String>,
    /// Read base poses from this topic [default: that of the robot]
    #[arg(long, value_name = "TOPIC", help_heading = "Input", hide_short_help = true)]
    pub pose_topic: Option<String>,
    /// Read the robot under this namespace, if the bag has several
    #[arg(long, value_name = "/NAME", help_heading = "Input", hide_short_help = true)]
    pub namespace: Option<String>,
    /// Read commands in the convention that was identified [see: qv inspect]
    #[arg(long, help_heading = "Input")]
    pub fix: bool,
}

impl Reading {
    /// What `--robot` names, where that is a file.
    pub fn robot_file(&self) -> Option<&Path> {
        self.robot.as_deref().map(Path::new).filter(|path| path.is_file())
    }
}
