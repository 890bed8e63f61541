//! `qv walk roll`: somebody else's policy in our simulator.

use super::inputs::command;
use crate::ground::terrain_of;
use crate::open::{file_error, model_named, write_error};
use crate::output::{make_folder, write_whole};
use crate::policy_child;
use crate::{Failure, Outcome, say};
use qv_policy::onnx::OnnxPolicy;
use qv_policy::roll::{Description, roll};
use qv_sim::{BaseKind, Batch, Model, Shape, SimOptions, State};
use std::fs;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Roll {
    /// Policy in ONNX from any trainer
    policy: PathBuf,
    /// Read the policy description (see: qv walk describe)
    #[arg(long, value_name = "FILE.toml", help_heading = "Input")]
    description: PathBuf,
    /// Set the robot: go2, go1, a1, a2, anymal_c, or a URDF, MJCF or TOML file
    #[arg(long, default_value = "go2", value_name = "ROBOT", help_heading = "Input")]
    robot: String,
    /// Set the terrain: plane, or a labelled mesh
    #[arg(long, default_value = "plane", value_name = "plane|FILE.glb", help_heading = "Input")]
    terrain: String,
    /// Command a velocity [m/s, m/s, rad/s]
    #[arg(long, default_value = "0.5,0,0", value_name = "VX,VY,WZ", value_parser = command, allow_hyphen_values = true, help_heading = "What to test")]
    command: [f32; 3],
    /// Set the length of the walk
    #[arg(long, default_value_t = 4.0, value_name = "SECONDS", value_parser = crate::numbers::positive, help_heading = "What to test")]
    seconds: f64,
    /// Apply the torque-speed limits of the URDF [default: ideal motors]
    #[arg(long, help_heading = "What to test")]
    speed_limits: bool,
    /// Write the results into this directory [created if missing]
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl Roll {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let (mut policy, description) = opened(&self.policy, &self.description)?;
        let model = self.model()?;
        check_joints(&description, &self.description, &model)?;
        let terrain = terrain_of(&self.terrain)?;
        let terrain =
            if terrain.is_plane() { terrain.with_friction(description.simulation.friction)? } else { terrain };
        let options = SimOptions { timestep: description.simulation.timestep, ..Default::default() };
        let mut batch = Batch::<f64>::new(&model, &terrain, &options, 1)?;
        for joint in description.joints.iter().filter(|_| !self.speed_limits) {
            batch.set_parameter(0, &format!("actuator.{joint}.speed_knee"), 1e6)?;
            batch.set_parameter(0, &format!("actuator.{joint}.speed_zero"), 2e6)?;
        }
        let ground = terrain.height_below(0.0, 0.0, 1e6).unwrap_or(0.0);
        let start = standing(&model, &description, ground);
        let wanted = self.command.map(f64::from);
        let rolled = roll(&mut batch, &description, &start, (wanted, self.seconds), &[], |observation| {
            let mut action = Vec::new();
            policy.run(observation, &mut action).map(|()| action)
        })?;
        if let Some(out) = &self.out {
            make_folder(out).map_err(|e| write_error(out, &e))?;
            let json = serde_json::json!({
                "time": rolled.time, "base": rolled.base, "joints": rolled.joints, "torques": rolled.torques,
                "joint_names": description.joints, "observations": rolled.observations, "actions": rolled.actions,
            });
            write_whole(&out.join("roll.json"), format!("{json}\n").as_bytes())?;
        }
        let end = rolled.base.last().ok_or("expected a sample after the start, found none")?;
        let up = upright(end);
        if self.json {
            let line = serde_json::json!({
                "format": "qv-walk-roll/1", "policy": description.name, "seconds": self.seconds, "position": end[..3],
                "upright": up > 0.5, "asked": [wanted[0] * self.seconds, wanted[1] * self.seconds], "out": self.out,
            });
            say(&format!("{line}\n"))?;
            return Ok(Outcome::Done);
        }
        let state = if up > 0.5 { "upright" } else { "fallen over" };
        say(&format!(
            "{}: after {} s at x {:.3}, y {:.3}, z {:.3} m, {state}; the command asked for {:.3}, {:.3} m (without turning)\n",
            description.name,
            self.seconds,
            end[0],
            end[1],
            end[2],
            wanted[0] * self.seconds,
            wanted[1] * self.seconds
        ))?;
        Ok(Outcome::Done)
    }

    fn model(&self) -> Result<Model, Failure> {
        Ok(model_named(&self.robot, BaseKind::Floating)?)
    }
}

/// Cosine of the lean of a base x, y, z, w, x, y, z.
pub(super) fn upright(base: &[f64; 7]) -> f64 {
    1.0 - 2.0 * (base[4] * base[4] + base[5] * base[5])
}

/// A policy in ONNX, and what it sees.
pub(super) fn opened(policy: &Path, description: &Path) -> Result<(OnnxPolicy, Description), Failure> {
    let read = |path: &Path, expected: &str| fs::read(path).map_err(|e| file_error(path, expected, &e.to_string()));
    let expected = "a description of a policy";
    let text = String::from_utf8_lossy(&read(description, expected)?).into_owned();
    let found = Description::from_toml(&text).map_err(|e| file_error(description, expected, &e.to_string()))?;
    Ok((policy_child::policy_at(policy)?, found))
}

/// That all joints of a description, of the file `path`, are the model's.
pub(super) fn check_joints(description: &Description, path: &Path, model: &Model) -> Result<(), Failure> {
    let Some(unknown) = description.joints.iter().find(|joint| model.joint_index(joint).is_none()) else {
        return Ok(());
    };
    let expected = format!("joints of {}: {}", model.name, model.joint_names().join(", "));
    Err(file_error(path, &expected, unknown).into())
}

/// At rest in the description's stand, level, the lowest ball touching the ground.
pub(super) fn standing(model: &Model, description: &Description, ground: f64) -> State {
    let mut q = vec![0.0; model.nq()];
    q[3] = 1.0;
    for (name, angle) in description.joints.iter().zip(&description.stand) {
        if let Some(joint) = model.joint_index(name) {
            q[7 + joint] = *angle;
        }
    }
    let poses = model.world_from_links(&q);
    let lowest = model.geoms.iter().filter_map(|geom| match geom.shape {
        Shape::Sphere(radius) => Some((poses[geom.link] * geom.link_from_geom).position.z - radius),
        _ => None,
    });
    let lowest = lowest.fold(f64::INFINITY, f64::min);
    q[2] = ground - if lowest.is_finite() { lowest } else { 0.0 };
    State { q, v: vec![0.0; model.nv()] }
}
