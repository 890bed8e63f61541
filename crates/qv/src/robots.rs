//! `qv robots`: whose messages are known.

use crate::{Outcome, say};
use qv_recording::RecordingError;
use qv_recording::robots::{ModelSource, RobotFile, built_in, names};
use serde_json::json;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv robots\n\
     \x20 qv replay walk.mcap --robot b2.toml --out out/walk\n\
     \n\
     A robot file such as b2.toml: like = \"b2\", name = \"our_b2\", urdf = \"b2.xml\" (docs/reference/formats.md)."
);

#[derive(clap::Args)]
pub struct Robots {
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Robots {
    pub fn execute(&self) -> Result<Outcome, RecordingError> {
        let all: Vec<RobotFile> = names().filter_map(built_in).collect();
        if self.json {
            let all: Vec<serde_json::Value> = all.iter().map(to_json).collect();
            say(&format!("{}\n", json!({"format": "qv-robots/1", "robots": all})))?;
        } else {
            say(&all.iter().map(lines).collect::<String>())?;
        }
        Ok(Outcome::Done)
    }
}

fn model(robot: &RobotFile) -> String {
    match &robot.model {
        ModelSource::BuiltIn(_) => "model built in".into(),
        ModelSource::Nowhere => "its URDF or MJCF is yours to give".into(),
        ModelSource::Recorded => "model in the recording".into(),
        ModelSource::File(file) => format!("model {file}"),
    }
}

fn lines(robot: &RobotFile) -> String {
    let mapping = &robot.mapping;
    let joints = match mapping.joint_names.len() {
        0 => "joints by name".to_owned(),
        n => format!("{n} joints"),
    };
    let found = if robot.found_by_messages { "found by its messages" } else { "by --robot alone" };
    let mut text = format!("{}: {}\n  {joints}, {}, {found}\n", mapping.robot, robot.about, model(robot));
    for stream in &mapping.streams {
        let types: Vec<&str> = stream.messages.iter().map(|m| m.name.as_str()).collect();
        let topics: Vec<&str> =
            std::iter::once(&stream.preferred_topic).chain(&stream.endings).map(String::as_str).collect();
        text += &format!("    {:<15} {}\n{:20}{}\n", stream.role, topics.join(", "), "", types.join(", "));
    }
    text
}

fn to_json(robot: &RobotFile) -> serde_json::Value {
    let stream = |s: &qv_recording::mapping::StreamMapping| {
        let types: Vec<&String> = s.messages.iter().map(|m| &m.name).collect();
        json!({"role": s.role, "topic": s.preferred_topic, "endings": s.endings, "types": types})
    };
    let streams: Vec<serde_json::Value> = robot.mapping.streams.iter().map(stream).collect();
    json!({
        "name": robot.mapping.robot,
        "about": robot.about,
        "joints": robot.mapping.joint_names,
        "model": model(robot),
        "found_by_messages": robot.found_by_messages,
        "streams": streams,
    })
}
