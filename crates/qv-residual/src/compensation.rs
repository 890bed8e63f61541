//! What was learnt of a robot, as a file: every candidate has this form, and simulator, replay and training read nothing else.

use crate::ResidualError;
use crate::identify::{Coordinate, shapes_of, values_of};
use crate::tune::CorrectedSimulator;
use crate::windows::{Errors, Lane, Replayer, Window};
use qv_policy::shape_torques::{SHAPES, ShapeTorques};
use qv_policy::velocity::TaskRobot;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Corrections of a simulator.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compensation {
    /// Version of this form: 1.
    pub version: u32,
    /// Robot that they belong to.
    pub robot: String,
    /// Joints, in order.
    pub joints: Vec<String>,
    /// What kind of candidate this is.
    pub kind: String,
    /// Parameters of the simulator by name.
    pub parameters: BTreeMap<String, f64>,
    /// Ranges within which they are uncertain.
    #[serde(default)]
    pub ranges: BTreeMap<String, [f64; 2]>,
    /// Numbers of the torque's shapes, `[joints][shapes]`, see [`qv_policy::shape_torques`]; empty = none.
    #[serde(default)]
    pub shapes: Vec<f32>,
}

impl Compensation {
    /// The simulator as it is.
    pub fn nominal(robot: &TaskRobot) -> Self {
        Self {
            version: 1,
            robot: robot.name.clone(),
            joints: robot.model.joint_names().to_vec(),
            kind: "nominal".into(),
            ..Default::default()
        }
    }

    /// Parameters that somebody found, such as `calibrated.toml` of a diagnosis.
    pub fn given(robot: &TaskRobot, parameters: &[(String, f64)]) -> Self {
        Self { kind: "calibrated".into(), parameters: parameters.iter().cloned().collect(), ..Self::nominal(robot) }
    }

    /// A point of a fit, with ranges of so many posterior standard deviations.
    ///
    /// # Errors
    /// When the simulator refuses the robot.
    pub fn of_fit(
        kind: &str,
        replayer: &Replayer,
        coordinates: &[Coordinate],
        point: &[f64],
        deviations: &[f64],
        spread: f64,
    ) -> Result<Self, ResidualError> {
        let robot = replayer.robot;
        let batch = replayer.batch(1)?;
        let mut found = Self { kind: kind.into(), ..Self::nominal(robot) };
        for ((c, &x), &d) in coordinates.iter().zip(point).zip(deviations) {
            let at = |x: f64| values_of(c, x.clamp(c.least, c.most), batch.catalogue());
            for ((name, value), ((_, low), (_, high))) in
                at(x).into_iter().zip(at(x - spread * d).into_iter().zip(at(x + spread * d)))
            {
                if x != c.neutral {
                    found.parameters.insert(name.clone(), value);
                }
                // What stayed neutral at a bound is as it was.
                if x != c.neutral || d < c.spread {
                    found.ranges.insert(name, [low.min(high), low.max(high)]);
                }
            }
        }
        found.shapes = shapes_of(coordinates, point, robot.joints());
        Ok(found)
    }

    /// # Errors
    /// When the text is no such file.
    pub fn parse(text: &str) -> Result<Self, ResidualError> {
        let found: Self = serde_json::from_str(text)
            .map_err(|e| ResidualError::input("compensator.json", "a file that `qv tune` wrote", e))?;
        if found.version != 1 {
            return Err(ResidualError::input("compensator.json", "version 1", found.version));
        }
        Ok(found)
    }

    /// # Errors
    /// When it is another robot's, or a number means nothing.
    pub fn check(&self, robot: &TaskRobot) -> Result<(), ResidualError> {
        if self.robot != robot.name || self.joints != robot.model.joint_names() {
            let expected = format!("one of {} with joints {}", robot.name, robot.model.joint_names().join(" "));
            let found = format!("one of {} with joints {}", self.robot, self.joints.join(" "));
            return Err(ResidualError::input("compensator.json", expected, found));
        }
        let count = robot.joints() * SHAPES.len();
        if !self.shapes.is_empty() && self.shapes.len() != count {
            return Err(ResidualError::input("compensator.json", format!("{count} `shapes`"), self.shapes.len()));
        }
        let numbers = self.parameters.values().chain(self.ranges.values().flatten()).copied();
        match numbers.chain(self.shapes.iter().map(|&x| f64::from(x))).find(|x| !x.is_finite()) {
            Some(bad) => Err(ResidualError::input("compensator.json", "finite numbers", bad)),
            None => Ok(()),
        }
    }

    /// For the training of a policy.
    pub fn corrected(&self, robot: &TaskRobot) -> CorrectedSimulator {
        let torques = (!self.shapes.is_empty()).then(|| ShapeTorques::new(robot, self.shapes.clone()));
        CorrectedSimulator { parameters: self.parameters.clone(), ranges: self.ranges.clone(), torques }
    }

    /// A lane of replays with the parameters.
    ///
    /// # Errors
    /// When the simulator does not know a name.
    pub fn lane(&self, replayer: &Replayer) -> Result<Lane, ResidualError> {
        let batch = replayer.batch(1)?;
        let parameters: Result<Vec<(usize, f64)>, ResidualError> =
            self.parameters.iter().map(|(name, x)| Ok((batch.parameter_index(name)?, *x))).collect();
        let bias =
            |joint: &String| self.parameters.get(&format!("sensor.{joint}.encoder_bias")).copied().unwrap_or(0.0);
        Ok(Lane { window: 0, parameters: parameters?, bias: self.joints.iter().map(bias).collect() })
    }

    /// Replays windows with these corrections.
    ///
    /// # Errors
    /// When the simulator refuses a number.
    pub fn replay(&self, replayer: &Replayer, windows: &[Window], length: usize) -> Result<Errors, ResidualError> {
        let lane = self.lane(replayer)?;
        let lanes: Vec<Lane> = (0..windows.len()).map(|window| Lane { window, ..lane.clone() }).collect();
        replayer.replay(windows, &lanes, length, self.corrected(replayer.robot).torques.as_ref())
    }
}
