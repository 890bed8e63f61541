//! The answers: what each sealed recording really is.

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The document that the generator of sealed recordings prints.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
pub struct Answers {
    format: String,
    /// What made them; the first generator says nothing.
    #[serde(default = "rapier")]
    origin: String,
    /// Names of the robot's joints, where all are of one robot.
    #[serde(default)]
    joints: Vec<String>,
    /// By name of the recording.
    pub recordings: BTreeMap<String, Answer>,
}

/// What kind of recording it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Case {
    /// Nothing but small differences.
    None,
    /// One effect of the library.
    Single,
    /// Two at once.
    Pair,
    /// One that no library has.
    Withheld,
}

/// One recording.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Answer {
    /// Its kind.
    pub case: Case,
    /// What is wrong with the robot.
    pub effects: Vec<Effect>,
    /// Draws that were no valid recordings.
    #[serde(default)]
    pub redraws: u64,
    /// What made it: `rapier`, `mujoco walk`, `mujoco arm`.
    #[serde(default)]
    pub origin: String,
    /// Names of the robot's joints.
    #[serde(default)]
    robot_joints: Vec<String>,
}

fn rapier() -> String {
    "rapier".into()
}

/// One effect.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Effect {
    /// Its name.
    pub effect: String,
    /// `actuator`, `contact`, `inertial` or `sensing`; none of a withheld one.
    #[serde(default)]
    pub interface: Option<String>,
    /// Effects that it is known to be confused with, itself among them.
    #[serde(default)]
    pub group: Vec<String>,
    /// Effects of the library that describe a withheld one in part.
    #[serde(default)]
    pub relatives: Vec<String>,
    /// Joints that it acts on; empty where it acts on something else.
    #[serde(default)]
    pub joints: Vec<String>,
    /// Part of the floor that it is confined to.
    #[serde(default)]
    pub region: Option<Region>,
    /// Its sizes.
    #[serde(default)]
    pub parameters: Vec<Parameter>,
}

/// A rectangle of the floor \[m\].
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Region {
    /// Least and greatest x.
    pub x: [f64; 2],
    /// Least and greatest y.
    pub y: [f64; 2],
    /// Whether the robot came to the edges of x, and of y.
    pub met: [[bool; 2]; 2],
}

/// One size.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Least and greatest value that it may have.
    #[serde(default)]
    pub range: Option<[f64; 2]>,
    /// Whether a diagnosis is asked for it.
    #[serde(default)]
    pub asked: bool,
}

impl Answers {
    /// Reads one document.
    ///
    /// # Errors
    /// It is malformed, or holds nothing.
    pub fn read(text: &str) -> Result<Self> {
        let mut answers: Self = serde_json::from_str(text).context("answers")?;
        if answers.format != "qv-sealed/1" {
            bail!("answers: expected the format qv-sealed/1, found {:?}", answers.format);
        }
        if answers.recordings.is_empty() {
            bail!("answers: expected recordings, found none");
        }
        for (name, answer) in &answers.recordings {
            let expected = match answer.case {
                Case::None => 0,
                Case::Single | Case::Withheld => 1,
                Case::Pair => 2,
            };
            if answer.effects.len() != expected {
                bail!("answer {name}: expected {expected} effects, found {}", answer.effects.len());
            }
        }
        for answer in answers.recordings.values_mut() {
            if answer.origin.is_empty() {
                answer.origin.clone_from(&answers.origin);
            }
            if answer.robot_joints.is_empty() {
                answer.robot_joints.clone_from(&answers.joints);
            }
        }
        Ok(answers)
    }

    /// Reads several documents as one.
    ///
    /// # Errors
    /// As [`Answers::read`], or a name occurs twice.
    pub fn join<'a>(texts: impl IntoIterator<Item = &'a str>) -> Result<Self> {
        let mut all: Option<Self> = None;
        for text in texts {
            let next = Self::read(text)?;
            let Some(all) = &mut all else {
                all = Some(next);
                continue;
            };
            for (name, answer) in next.recordings {
                if all.recordings.insert(name.clone(), answer).is_some() {
                    bail!("answers: expected each name once, found {name} twice");
                }
            }
        }
        all.context("answers: expected at least one document, found none")
    }
}

impl Answer {
    /// The joints that words of a report's scope mean: `all`, a joint, or a part of joints' names such as a leg.
    pub fn joints_meant(&self, scope: &[String]) -> Vec<&String> {
        let meant = |joint: &&String| {
            scope.iter().any(|word| word == "all" || word == *joint || joint.split('_').any(|part| part == word))
        };
        self.robot_joints.iter().filter(meant).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(name: &str) -> String {
        format!(r#"{{"format": "qv-sealed/1", "recordings": {{"{name}": {{"case": "none", "effects": []}}}}}}"#)
    }

    #[test]
    fn documents_are_joined_and_checked() {
        let (a, b) = (document("a"), document("b"));
        assert_eq!(Answers::join([a.as_str(), b.as_str()]).unwrap().recordings.len(), 2);
        assert!(Answers::join([a.as_str(), a.as_str()]).unwrap_err().to_string().contains("twice"));
        assert!(Answers::join([]).is_err());
        let wrong = a.replace("\"none\"", "\"single\"");
        assert!(Answers::read(&wrong).unwrap_err().to_string().contains("expected 1 effects, found 0"));
        assert!(Answers::read(&a.replace("qv-sealed/1", "other")).is_err());
    }

    #[test]
    fn scopes_are_read_by_part() {
        let joints = ["FL_hip_joint", "FL_calf_joint", "RR_calf_joint"].map(String::from).to_vec();
        let text = document("a").replace("\"recordings\"", &format!("\"joints\": {joints:?}, \"recordings\""));
        let answer = &Answers::read(&text).unwrap().recordings["a"];
        assert_eq!(answer.origin, "rapier");
        let meant = |word: &str| answer.joints_meant(&[word.to_string()]).len();
        assert_eq!([meant("all"), meant("FL"), meant("calf"), meant("RR_calf_joint"), meant("nose")], [3, 2, 2, 1, 0]);
    }
}
