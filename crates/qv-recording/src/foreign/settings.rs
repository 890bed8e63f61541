//! `[dataset]` of `run.toml`: what the columns of another program's recording are.

use crate::RecordingError;
use serde::Deserialize;
use std::collections::BTreeMap;

/// ```toml
/// [dataset]
/// joints = ["shoulder_pan", "elbow", ""]   # in the order of the columns; "" leaves one out
/// unit = "deg"                             # of positions, and per second of velocities: rad or deg
/// episode = 0
/// position = "observation.state"           # columns of a LeRobot dataset
/// command = "action"
/// [dataset.joint.elbow]                    # rad = scale x number of the file + offset
/// scale = 0.0123
/// offset = -0.5
/// ```
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Names of the joints in the order of the columns, as the model has them; an empty one is left out.
    pub joints: Option<Vec<String>>,
    /// `rad` or `deg`.
    pub unit: Option<String>,
    /// Which episode of a LeRobot dataset; the first one without it.
    pub episode: Option<u64>,
    /// Column with the positions.
    pub position: Option<String>,
    /// Column with the velocities.
    pub velocity: Option<String>,
    /// Column with the torques \[N m\].
    pub torque: Option<String>,
    /// Column with the commanded positions.
    pub command: Option<String>,
    /// What is known of single joints.
    #[serde(default)]
    pub joint: BTreeMap<String, JointSettings>,
}

/// How the numbers of a joint become radians.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointSettings {
    /// Radians for each unit of the file, in place of `unit`.
    pub scale: Option<f64>,
    /// Added after that \[rad\].
    pub offset: Option<f64>,
}

#[derive(Deserialize)]
struct Root {
    dataset: Option<Settings>,
}

impl Settings {
    /// Those of the text of a `run.toml`; none where it says nothing.
    ///
    /// # Errors
    /// A key or a unit that means nothing, or a number that is not finite.
    pub fn of(toml_text: &str) -> Result<Self, RecordingError> {
        let text = toml_text.trim_start_matches('\u{feff}');
        let found = |e: toml::de::Error| e.to_string().trim().replace('\n', " / ");
        let root: Root = toml::from_str(text)
            .map_err(|e| RecordingError::file("run.toml", "[dataset] with joints, unit, episode, columns", found(e)))?;
        let settings = root.dataset.unwrap_or_default();
        settings.factor()?;
        for (name, joint) in &settings.joint {
            let numbers = [joint.scale, joint.offset].into_iter().flatten();
            if let Some(x) = numbers.into_iter().find(|x| !x.is_finite()) {
                let expected = format!("finite numbers in [dataset.joint.{name}]");
                return Err(RecordingError::file("run.toml", expected, x.to_string()));
            }
            if settings.joints.as_ref().is_some_and(|joints| !joints.contains(name)) {
                let expected = format!("one of the joints in [dataset.joint.{name}]");
                return Err(RecordingError::file("run.toml", expected, format!("`{name}`")));
            }
        }
        Ok(settings)
    }

    /// Radians for each unit of joints that have no scale of their own.
    fn factor(&self) -> Result<f64, RecordingError> {
        match self.unit.as_deref() {
            None | Some("rad") => Ok(1.0),
            Some("deg") => Ok(std::f64::consts::PI / 180.0),
            Some(other) => {
                let expected = "[dataset] unit = \"rad\" or \"deg\" (other units: [dataset.joint.NAME] scale, offset)";
                Err(RecordingError::file("run.toml", expected, format!("`{other}`")))
            }
        }
    }

    /// Factor and offset from the file's numbers to radians, of one joint.
    pub(crate) fn conversion(&self, joint: &str) -> (f64, f64) {
        let own = self.joint.get(joint).copied().unwrap_or_default();
        (own.scale.or(self.factor().ok()).unwrap_or(1.0), own.offset.unwrap_or(0.0))
    }

    /// Turns rows of positions, or with `is_rate` of velocities, into radians.
    pub(crate) fn convert(&self, joints: &[String], values: &mut [f64], is_rate: bool) {
        let each: Vec<(f64, f64)> = joints.iter().map(|joint| self.conversion(joint)).collect();
        for row in values.chunks_exact_mut(joints.len().max(1)) {
            for (x, (scale, offset)) in row.iter_mut().zip(&each) {
                *x = *x * scale + if is_rate { 0.0 } else { *offset };
            }
        }
    }

    /// Names for `width` columns: those of `[dataset] joints`, else those that the recording has.
    pub(crate) fn names(
        &self,
        width: usize,
        own: Option<Vec<String>>,
        file: &str,
    ) -> Result<Vec<String>, RecordingError> {
        let (names, from) = match (&self.joints, own) {
            (Some(names), _) => (names.clone(), "[dataset] joints"),
            (None, Some(names)) => (names, file),
            (None, None) => (vec![], file),
        };
        if names.len() != width || names.iter().all(String::is_empty) {
            let expected = format!("names of {width} joints there, or as [dataset] joints = [...] in run.toml");
            let found = format!("{} names in {from}", names.len());
            return Err(RecordingError::file(file, expected, found));
        }
        let twice = names.iter().enumerate().find(|(k, name)| !name.is_empty() && names[..*k].contains(name));
        match twice {
            Some((_, name)) => Err(RecordingError::file(file, "each joint once", format!("`{name}` twice"))),
            None => Ok(names),
        }
    }

    /// What is said where nothing shows the unit.
    #[cfg(feature = "parquet")]
    pub(crate) fn unit_remarks(&self) -> Option<String> {
        let is_known = self.unit.is_some() || !self.joint.is_empty();
        (!is_known).then(|| "positions are taken as radians: [dataset] unit in run.toml says otherwise".to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn what_it_says_is_read_and_faults_are_named() {
        let text = "robot = \"r.urdf\"\n[dataset]\nunit = \"deg\"\njoints = [\"a\", \"b\"]\n[dataset.joint.b]\nscale = 2\noffset = 1";
        let settings = Settings::of(text).unwrap();
        let mut values = [180.0, 3.0];
        settings.convert(&["a".into(), "b".into()], &mut values, false);
        assert_eq!(values, [std::f64::consts::PI, 7.0]);
        settings.convert(&["a".into(), "b".into()], &mut values, true);
        assert_eq!(values[1], 14.0);
        assert_eq!(Settings::of("robot = \"x\"").unwrap(), Settings::default());
        for (toml, word) in [
            ("unit = \"turns\"", "found `turns`"),
            ("joint_names = []", "joint_names"),
            ("joints = [\"a\"]\n[dataset.joint.b]\nscale = 1", "found `b`"),
            ("[dataset.joint.b]\nscale = nan", "finite numbers"),
        ] {
            let error = Settings::of(&format!("[dataset]\n{toml}")).unwrap_err().to_string();
            assert!(error.contains(word), "{toml}: {error}");
        }
        let names = |own| settings.names(2, own, "x").map_err(|e| e.to_string());
        assert_eq!(names(None).unwrap(), ["a", "b"]);
        let none = Settings::default();
        let error = |own: Option<Vec<String>>| none.names(2, own, "info.json").unwrap_err().to_string();
        assert!(error(None).states("info.json 2"));
        assert!(error(Some(vec!["a".into(), "a".into()])).states("`a`"));
    }
}
