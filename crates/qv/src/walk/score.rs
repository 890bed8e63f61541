//! `qv walk score`.

use super::inputs::{TerrainOption, as_trained, ground_of, policy_of, range, robot_of};
use crate::open::parameters_of;
use crate::{Failure, Outcome, say};
use qv_policy::gait::{Check, verdict};
use qv_policy::policy::OnnxDecision;
use qv_policy::score::{GAIT_ROBOTS, Score, judge_gait, score};
use qv_policy::velocity::{TaskSettings, VelocityTask};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct ScoreArguments {
    /// Policy in ONNX
    policy: PathBuf,
    /// Read the description of a policy from another trainer
    ///
    /// It walks under eleven fixed commands, one robot each: --robots, --vx, --vy, --wz, --substeps and --robust are rejected with it.
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["vx", "vy", "wz", "substeps", "robust", "robots"], help_heading = "Input")]
    description: Option<PathBuf>,
    /// Set the robot: go2, go1, a1, a2, anymal_c, or a URDF, MJCF or TOML file
    #[arg(long, default_value = "go2", value_name = "ROBOT", help_heading = "Input")]
    robot: String,
    #[command(flatten)]
    terrain: TerrainOption,
    /// Score N robots, one command each [not with --description]
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20), help_heading = "What to test", hide_short_help = true)]
    robots: u32,
    /// Set the length of each walk
    #[arg(long, default_value_t = 8.0, value_name = "SECONDS", value_parser = crate::numbers::positive, help_heading = "What to test")]
    seconds: f64,
    /// Set the range of forward velocity commands [m/s]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "What to test")]
    vx: Option<[f32; 2]>,
    /// Set the range of lateral velocity commands [m/s]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "What to test")]
    vy: Option<[f32; 2]>,
    /// Set the range of yaw rate commands [rad/s]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "What to test")]
    wz: Option<[f32; 2]>,
    /// Set the physics steps per decision
    ///
    /// Finer steps than in training show that the step size does not matter.
    #[arg(long, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    substeps: Option<usize>,
    /// Randomize the robots as `qv walk train --robust`, and push them
    #[arg(long, help_heading = "What to test")]
    robust: bool,
    /// Score on the corrected robot (calibrated.toml)
    #[arg(long, value_name = "FILE.toml", help_heading = "Input")]
    params: Option<PathBuf>,
    /// Set the random seed
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "Advanced", hide_short_help = true)]
    seed: u64,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

impl ScoreArguments {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        if let Some(description) = &self.description {
            return self.judge_others(description);
        }
        let (mut policy, file) = policy_of(&self.policy)?;
        let robot = as_trained(robot_of(&self.robot)?, &file, &self.policy)?;
        let ground = ground_of(&self.terrain.name, self.seed)?;
        let mut settings = TaskSettings { rate: file.rate, clock: file.clock, episode: 1e4, ..Default::default() };
        settings.substeps =
            self.substeps.unwrap_or_else(|| (1.0 / (f64::from(file.rate) * file.timestep)).round() as usize);
        if self.substeps.is_some() {
            settings.iterations = 30;
        }
        if self.robust {
            settings.randomise = qv_policy::velocity::Randomise::robust(&robot.model.links[0].name);
        }
        if self.params.is_some() {
            let found = parameters_of(self.params.as_deref(), &robot.model, &ground.terrain)?;
            settings.parameters = found.into_iter().collect();
        }
        let mut commands = file.commands.clone();
        for (given, range) in [(self.vx, &mut commands.vx), (self.vy, &mut commands.vy), (self.wz, &mut commands.wz)] {
            *range = given.unwrap_or(*range);
        }
        let mut task = VelocityTask::new(robot.clone(), ground.clone(), settings.clone(), self.robots as usize)?;
        task.varied = self.robust;
        let mut decision = OnnxDecision { policy: &mut policy, robot: &robot };
        let mut found = score(&mut decision, &mut task, &commands, self.seconds as f32, self.seed)?;
        let mut task = VelocityTask::new(robot.clone(), ground, settings, GAIT_ROBOTS)?;
        task.varied = self.robust;
        let gait = judge_gait(&mut decision, &mut task, &commands, self.seconds as f32, self.seed)?;
        let names: Vec<String> = robot.feet.iter().map(|&g| robot.model.geoms[g].name.clone()).collect();
        let checks = gait.checks(&names);
        found.gait = Some(gait);
        match self.json {
            true => {
                let mut line = serde_json::to_value(&found)?;
                line["format"] = "qv-walk-score/2".into();
                line["checks"] = checks.iter().map(row).collect();
                line["verdict"] = verdict(&checks).into();
                say(&format!("{line}\n"))?
            }
            false => say(&format!("{}\n{}\n", sentence(&found), table(&checks)))?,
        }
        Ok(Outcome::Done)
    }
}

impl ScoreArguments {
    fn judge_others(&self, description: &Path) -> Result<Outcome, Failure> {
        let robot = robot_of(&self.robot)?;
        let ground = ground_of(&self.terrain.name, self.seed)?;
        let found = match &self.params {
            Some(file) => parameters_of(Some(file), &robot.model, &ground.terrain)?,
            None => Vec::new(),
        };
        if let Some(file) = &self.params {
            crate::progress::remark(&format!("{} parameters of {} are applied", found.len(), file.display()));
        }
        let gait = super::others::judge([&self.policy, description], &robot, &ground, &found, self.seconds)?;
        let names: Vec<String> = robot.feet.iter().map(|&g| robot.model.geoms[g].name.clone()).collect();
        let checks = gait.checks(&names);
        if self.json {
            let rows: Vec<serde_json::Value> = checks.iter().map(row).collect();
            let line = serde_json::json!({
                "format": "qv-walk-score/2", "gait": gait, "checks": rows, "verdict": verdict(&checks),
            });
            say(&format!("{line}\n"))?;
        } else {
            say(&format!("{}\n", table(&checks)))?;
        }
        Ok(Outcome::Done)
    }
}

/// A check for JSON; a bound that is not there is null.
fn row(check: &Check) -> serde_json::Value {
    let bound = check.bound.map(|x| x.is_finite().then_some(x));
    serde_json::json!({
        "quantity": check.quantity, "value": check.value, "bound": bound, "unit": check.unit, "source": check.source,
        "passes": check.passes(),
    })
}

/// Each figure of a gait against its bound, and the verdict. Figures that fail stand in their rows alone.
pub fn table(checks: &[Check]) -> String {
    let mut text = format!("{:6}  {:32} {:>12}  {:14} {}\n", "result", "check", "value", "bound", "unit");
    for check in checks {
        let value = check.value.map_or("not measured".into(), |x| format!("{x:.2}"));
        let result = if check.passes() { "pass" } else { "FAIL" };
        text += &format!("{result:6}  {:32} {value:>12}  {:14} {}", check.quantity, check.bound_text(), check.unit);
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    let failed = checks.iter().filter(|check| !check.passes()).count();
    let verdict = match failed {
        0 => format!("yes, all {} checks pass", checks.len()),
        _ => format!("no, {failed} of {} checks fail", checks.len()),
    };
    format!("{text}fit to try on hardware: {verdict}")
}

/// A score in words.
pub fn sentence(score: &Score) -> String {
    format!(
        "{} of {} robots fell. Velocity is off by {:.3} ± {:.3} m/s, turning by {:.3} ± {:.3} rad/s; a swing lasts {:.2} s and clears {:.1} cm.",
        score.fell,
        score.robots,
        score.velocity_error,
        score.velocity_error_se,
        score.turning_error,
        score.turning_error_se,
        score.swing_time,
        100.0 * score.swing_height
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_policy::gait::{FootGait, Gait};

    #[test]
    fn a_limp_fails_with_its_figure() {
        let foot = |duty: f32| FootGait { duty, swing: Some(0.3), touchdown: Some(1.0) };
        let gait = Gait {
            feet: vec![foot(0.2), foot(0.6)],
            duty_spread: Some(0.4),
            mass: 15.0,
            height: 0.32,
            ..Gait::default()
        };
        let text = table(&gait.checks(&["a".into(), "b".into()]));
        assert!(text.starts_with("result  check ") && text.contains("FAIL    duty factor of a"), "{text}");
        assert!(text.contains("pass    duty factor of b"), "{text}");
        let (rows, verdict) = text.rsplit_once('\n').unwrap();
        assert!(verdict.starts_with("fit to try on hardware: no, "), "{verdict}");
        assert!(verdict.contains(&format!("{} of", rows.matches("FAIL").count())), "a failure is a row, once: {text}");
        assert_eq!(text.matches("duty factor of a").count(), 1, "{text}");
    }
}
