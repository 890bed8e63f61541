//! Legs that the command line asks for: a follower of velocities, or a robot that walks in the simulator.

use super::place::{HEIGHT, Place};
use crate::Failure;
use crate::open::{beyond_range, file_error, parameters_of};
use crate::progress::remark;
use crate::walk::inputs::{as_trained, checkpoint_of, of_mesh, policy_of, robot_of};
use qv_nav::legs::{Follower, Legs};
use qv_nav::teacher::World;
use qv_nav::walkers::Walkers;
use qv_policy::policy::Policy;
use qv_policy::velocity::{Ground, TaskRobot, TaskSettings};
use qv_residual::compensation::Compensation;
use qv_residual::tune::judge_of;
use std::path::{Path, PathBuf};

/// Room around a place where a robot begins \[m\]: what the task asks of its starts, and a little less for the grid of heights.
const ROOM: f64 = 0.3;

/// Who carries the camera.
#[derive(clap::Args)]
pub struct LegsArguments {
    /// Use this locomotion policy as low-level controller [default: none]
    ///
    /// The robot then walks in the simulator. Without it an ideal velocity follower moves the base.
    #[arg(long, value_name = "POLICY.onnx", help_heading = "Input")]
    walk: Option<PathBuf>,
    /// Set the robot that walks: go2, go1, ... or URDF, MJCF or TOML file
    #[arg(
        long,
        default_value = "go2",
        value_name = "ROBOT",
        requires = "walk",
        help_heading = "Input",
        hide_short_help = true
    )]
    robot: String,
    /// Read corrections (calibrated.toml or compensator.json)
    #[arg(
        long,
        value_name = "FILE",
        requires = "walk",
        alias = "correction",
        help_heading = "Input",
        hide_short_help = true
    )]
    params: Option<PathBuf>,
}

/// A robot on its ground, ready to walk; or none, where a follower is asked for.
pub struct Stable(Option<Walking>);

struct Walking {
    robot: TaskRobot,
    policy: Policy,
    ground: Ground,
    correction: Compensation,
    task: TaskSettings,
    name: String,
}

impl LegsArguments {
    /// The files that are read.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.walk.iter().chain(&self.params)
    }

    /// Whether a robot walks.
    pub(super) fn is_walking(&self) -> bool {
        self.walk.is_some()
    }

    /// Reads what was named. Nothing walks yet.
    pub(super) fn open(&self, place: &Place) -> Result<Stable, Failure> {
        let Some(path) = &self.walk else { return Ok(Stable(None)) };
        if place.floor.is_some() {
            return Err("--walk needs a mesh that shows its floor; found --floor, which says that it does not".into());
        }
        let (_, file) = policy_of(path)?;
        let robot = as_trained(robot_of(&self.robot)?, &file, path)?;
        let start = checkpoint_of(path, &robot)?;
        let ground = of_mesh(&place.mesh()?.to_string_lossy(), &[], ROOM, place.seed)?;
        let correction = match &self.params {
            None => Compensation::nominal(&robot),
            Some(file) => correction(file, &robot, &ground)?,
        };
        let policy = start.best_policy(&robot)?;
        let corrected = self.params.as_ref().map_or(String::new(), |file| format!(", with {}", file.display()));
        let name = format!("{} in the simulator, by {}{corrected}", robot.name, path.display());
        Ok(Stable(Some(Walking { robot, policy, ground, correction, task: start.settings.task.clone(), name })))
    }
}

/// Ends of names of what only delays what sensors say: robots that walk here by the hundred are read at once.
const SENSED: [&str; 2] = [".encoder_latency", ".delay"];

/// What a file says that the simulator lacks, without what these legs cannot have.
fn correction(file: &Path, robot: &TaskRobot, ground: &Ground) -> Result<Compensation, Failure> {
    let mut found = whole_correction(file, robot, ground)?;
    let is_sensed = |name: &str| SENSED.iter().any(|end| name.ends_with(end));
    for name in found.parameters.keys().filter(|name| is_sensed(name)) {
        remark(&format!("{}: {name} is left out: robots that walk here are read without delay", file.display()));
    }
    found.parameters.retain(|name, _| !is_sensed(name));
    found.ranges.retain(|name, _| !is_sensed(name));
    Ok(found)
}

fn whole_correction(file: &Path, robot: &TaskRobot, ground: &Ground) -> Result<Compensation, Failure> {
    if file.extension().is_none_or(|end| end != "json") {
        let given = parameters_of(Some(file), &robot.model, &ground.terrain)?;
        if given.is_empty() {
            return Err(file_error(file, "at least one parameter under [parameters]", "none").into());
        }
        beyond_range(&given, &robot.model, &ground.terrain).iter().for_each(|line| remark(line));
        return Ok(Compensation::given(robot, &given));
    }
    let expected = "compensator.json of `qv tune`";
    let wrong = |found: &dyn std::fmt::Display| file_error(file, expected, &found.to_string());
    let text = std::fs::read_to_string(file).map_err(|e| wrong(&e))?;
    let found = Compensation::parse(&text).map_err(|e| wrong(&e))?;
    found.check(robot).map_err(|e| wrong(&e))?;
    Ok(found)
}

impl Stable {
    /// So many legs in a place.
    pub fn legs<'a>(&self, world: &'a World, count: usize) -> Result<Box<dyn Legs + 'a>, Failure> {
        let Some(walking) = &self.0 else { return Ok(Box::new(Follower::new(&world.map, count, HEIGHT))) };
        let Walking { robot, policy, ground, correction, task, .. } = walking;
        let corrected = correction.corrected(robot);
        let task = judge_of(robot, ground, task, &corrected, count)?;
        Ok(Box::new(Walkers::new(task, Box::new(policy.clone()))?))
    }

    /// What carries the camera, in words.
    pub fn name(&self) -> &str {
        self.0.as_ref().map_or("velocity follower without physics", |walking| &walking.name)
    }
}
