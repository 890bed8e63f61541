//! What recording a command reads, and how.

use clap::Args;
use std::path::{Path, PathBuf};

/// What recording to read, the same for every command.
#[derive(Args)]
pub struct RunArguments {
    /// A bag (.mcap or .db3 file, or the directory of a split bag), a table (run.csv, or its directory), a LeRobot dataset, or a SAGE folder
    pub run: PathBuf,
    #[command(flatten)]
    pub reading: Reading,
}

/// How a recording is read, the same for every command.
#[derive(Args, Clone, Default)]
pub struct Reading {
    /// Topic of the base pose; default that of the robot (`qv robots`), else whichever topic carries poses
    #[arg(long, value_name = "TOPIC")]
    pub pose_topic: Option<String>,
    /// A robot of `qv robots`, a robot file (.toml), or a URDF or MJCF file; default: what the recording says
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,
    /// First part of the topics of the robot that is read, where a recording has several
    #[arg(long, value_name = "/NAME")]
    pub namespace: Option<String>,
    /// Read commands in the convention that they are found in: order of joints, signs, units, offsets, gains, stamps
    #[arg(long)]
    pub fix: bool,
}

impl Reading {
    /// What `--robot` names, where that is a file.
    pub fn robot_file(&self) -> Option<&Path> {
        self.robot.as_deref().map(Path::new).filter(|path| path.is_file())
    }
}
