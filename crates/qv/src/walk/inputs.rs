//! Robots, grounds and policies that the command line names.

use crate::Failure;
use crate::ground::{mesh_at, set_friction, terrain_at};
use crate::open::file_error;
use crate::policy_child;
use qv_open::included;
use qv_policy::onnx::OnnxPolicy;
use qv_policy::policy::PolicyFile;
use qv_policy::train::Checkpoint;
use qv_policy::velocity::{Ground, RobotFile, TaskRobot, known_robot};
use std::fs;
use std::path::{Path, PathBuf};

/// A robot that a TOML file or a bare model describes, as text, with the folder that its other files lie in.
struct RobotText {
    file: RobotFile,
    /// What names it.
    path: PathBuf,
    model: String,
}

/// Reads what `--robot` names, unless it is the Go2.
fn robot_text(name: &str) -> Result<RobotText, Failure> {
    let path = PathBuf::from(name);
    if let Some((file, model)) = known_robot(name) {
        return Ok(RobotText { file: RobotFile::parse(file)?, path, model: model.into() });
    }
    let expected = "go2, go1, a1, a2, anymal_c, a URDF or MJCF, or a .toml file that describes a robot";
    let text = fs::read_to_string(&path).map_err(|e| file_error(&path, expected, &e.to_string()))?;
    if path.extension().is_none_or(|ending| ending != "toml") {
        return Ok(RobotText { file: RobotFile::bare(name), path, model: text });
    }
    let file = RobotFile::parse(&text).map_err(|e| file_error(&path, expected, &e.to_string()))?;
    let model = path.parent().unwrap_or(Path::new("")).join(&file.urdf);
    let text =
        fs::read_to_string(&model).map_err(|e| file_error(&model, "the robot's URDF or MJCF", &e.to_string()))?;
    Ok(RobotText { file, path, model: text })
}

/// The robot that `--robot` names: one of the list, a URDF or MJCF, or a TOML file beside one.
pub fn robot_of(name: &str) -> Result<TaskRobot, Failure> {
    if name == "go2" {
        return Ok(qv_go2::walk::robot()?);
    }
    let RobotText { file, path, model } = robot_text(name)?;
    let beside = path.parent().unwrap_or(Path::new(""));
    let robot = file.robot_with(&model, &|name: &str| included(beside, name));
    Ok(robot.map_err(|e| file_error(&path, "a robot that fits its model", &e.to_string()))?)
}

/// The text of the URDF or MJCF of the robot that `--robot` names.
pub fn urdf_of(name: &str) -> Result<String, Failure> {
    match name {
        "go2" => Ok(qv_go2::model::urdf_with_shapes()),
        _ => Ok(robot_text(name)?.model),
    }
}

/// Height of bumps \[m\], slope \[rad\] and steps \[m\] of the grounds that need no file: what issue-free outdoor ground has at most.
const BUMPS: f32 = 0.04;
const SLOPE: f32 = 0.262;
const STEP: f32 = 0.10;

/// Where a policy walks: one option of all commands that need it.
#[derive(clap::Args)]
pub struct TerrainOption {
    /// Set the terrain: plane, bumps, levels, or a labelled mesh
    ///
    /// bumps: up to 4 cm. levels: slopes up to 15 degrees, stairs up to 10 cm, bumps.
    #[arg(
        id = "terrain",
        long = "terrain",
        default_value = "plane",
        value_name = "plane|bumps|levels|FILE.glb",
        alias = "ground",
        help_heading = "Input"
    )]
    pub name: String,
}

/// The ground that `--terrain` names.
pub fn ground_of(name: &str, seed: u64) -> Result<Ground, Failure> {
    match name {
        "plane" => Ok(Ground::plane()),
        "bumps" => Ok(Ground::bumps(BUMPS, seed)?),
        "levels" => Ok(Ground::levels(SLOPE, STEP, seed)?),
        file => of_mesh(file, &[], ROOM, seed),
    }
}

/// Level ground that a robot begins on, unless somebody says otherwise \[m\].
pub const ROOM: f64 = 0.4;

/// A mesh with frictions by label in the place of the file's, and so much level ground around each place where a robot begins.
pub fn of_mesh(file: &str, friction: &[(String, f64)], room: f64, seed: u64) -> Result<Ground, Failure> {
    let path = Path::new(file);
    let expected = "plane, bumps, levels, or a .glb file";
    let mut mesh = mesh_at(path, expected)?;
    set_friction(&mut mesh, friction, path)?;
    let bound = |axis: usize, least: bool| {
        let all = mesh.vertices.iter().map(|v| v[axis]);
        if least { all.fold(f64::INFINITY, f64::min) } else { all.fold(f64::NEG_INFINITY, f64::max) }
    };
    let area = [[bound(0, true), bound(1, true)], [bound(0, false), bound(1, false)]];
    let ground = Ground::of_terrain(terrain_at(path, &mesh)?, area, room, seed);
    Ok(ground.map_err(|e| file_error(path, "ground that a robot can begin on", &e.to_string()))?)
}

/// A policy of ours: the network and what policy.toml beside it says.
pub fn policy_of(path: &Path) -> Result<(OnnxPolicy, PolicyFile), Failure> {
    let policy = policy_child::policy_at(path)?;
    let beside = path.with_file_name("policy.toml");
    let expected = "what `qv walk train` wrote beside policy.onnx (for a policy of another trainer: `--description FILE.toml`, which `qv walk describe` begins)";
    let text = fs::read_to_string(&beside).map_err(|e| file_error(&beside, expected, &e.to_string()))?;
    let file = PolicyFile::parse(&text).map_err(|e| file_error(&beside, expected, &e.to_string()))?;
    Ok((policy, file))
}

/// The training that a `policy.onnx` comes from, beside it.
pub fn checkpoint_of(path: &Path, robot: &TaskRobot) -> Result<Checkpoint, Failure> {
    let beside = path.with_file_name("checkpoint.bin");
    let expected = "checkpoint.bin of `qv walk train` or `qv tune` beside the policy";
    let wrong = |e: &dyn std::fmt::Display| file_error(&beside, expected, &e.to_string());
    let start = Checkpoint::from_bytes(&fs::read(&beside).map_err(|e| wrong(&e))?).map_err(|e| wrong(&e))?;
    let policy = start.best_policy(robot).map_err(|e| wrong(&e))?;
    let given = fs::read(path).map_err(|e| file_error(path, "a policy in ONNX", &e.to_string()))?;
    if policy.to_onnx(robot)? != given {
        let found =
            "another policy than that of checkpoint.bin (a training of a whole number of epochs writes both alike)";
        return Err(file_error(path, "the best policy of checkpoint.bin beside it", found).into());
    }
    Ok(start)
}

/// A robot with the gains, stand and scale of a policy's file, so that it is run as it was trained.
pub fn as_trained(mut robot: TaskRobot, file: &PolicyFile, policy: &Path) -> Result<TaskRobot, Failure> {
    let beside = policy.with_file_name("policy.toml");
    let expected = "a policy of this robot (--robot names it)";
    file.check(&robot).map_err(|e| file_error(&beside, expected, &e.to_string()))?;
    robot.stand.clone_from(&file.stand);
    robot.kp.clone_from(&file.kp);
    robot.kd.clone_from(&file.kd);
    robot.action_scale.clone_from(&file.action_scale);
    Ok(robot)
}

/// Numbers of commands on the command line: `vx,vy,wz`.
pub fn command(text: &str) -> Result<[f32; 3], String> {
    crate::numbers::three(text, "VX,VY,WZ").map(|three| three.map(|x| x as f32))
}

/// Two numbers, the first not above the second: `LOW,HIGH`.
pub fn range(text: &str) -> Result<[f32; 2], String> {
    let found = || format!("expected two numbers LOW,HIGH, found `{text}`");
    let numbers: Option<Vec<f32>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[low, high]) if low.is_finite() && high.is_finite() && low <= high => Ok([low, high]),
        _ => Err(found()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn ranges_and_commands() {
        assert_eq!(range("-0.5,1"), Ok([-0.5, 1.0]));
        for odd in ["", "1", "2,1", "nan,1", "0,1,2", "0,1,x", "a,b"] {
            assert!(range(odd).unwrap_err().contains("LOW,HIGH"), "{odd}");
        }
        assert_eq!(command("0.5,0,-1"), Ok([0.5, 0.0, -1.0]));
    }

    #[test]
    fn what_is_no_robot_or_ground_is_named() {
        let said = |e: Failure| e.to_string();
        assert!(said(robot_of("nobody.toml").unwrap_err()).contains("nobody.toml"));
        assert!(said(ground_of("nowhere.glb", 0).unwrap_err()).states("levels"));
        assert!(said(policy_of(Path::new("none.onnx")).unwrap_err()).contains("none.onnx"));
        assert!(ground_of("plane", 0).unwrap().is_plane());
    }
}
