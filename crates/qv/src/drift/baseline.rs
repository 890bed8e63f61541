//! The calibration that a robot is compared with: what `qv diagnose` left, and the recordings that it was made from.

use super::check::hashes;
use crate::diagnose::{DiagnosisInputs, inputs_of};
use crate::ground::{check_ground, terrain_of};
use crate::open::{file_error, find_gains, model_of, open_run, parameters_of};
use crate::provenance::provenance;
use crate::{Failure, Reading, RunArguments};
use qv_gap::Options;
use qv_gap::inference::linearised::NullOptions;
use qv_gap::problem::library::Effect;
use qv_open::diagnosis;
use qv_recording::Run;
use qv_sim::{Model, Terrain};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// See the module.
pub struct BaselineRobot {
    pub runs: Vec<Run>,
    pub reading: Reading,
    pub model: Model,
    pub terrain: Terrain,
    /// Hashes of the recordings and of the calibrated parameters.
    pub sha256: Vec<String>,
    /// Parameters of the calibrated robot.
    given: Vec<(String, f64)>,
    effects: Vec<Effect>,
    effort: NullOptions,
}

impl BaselineRobot {
    /// Opens the results of `qv diagnose` in `folder`, and its recordings: `elsewhere`, or where it read them.
    ///
    /// # Errors
    /// Something of it is missing, or the recordings are others than those that were diagnosed.
    pub fn open(folder: &Path, elsewhere: &[PathBuf]) -> Result<Self, Failure> {
        let path = folder.join("report.json");
        let expected = "the results of `qv diagnose`";
        let text = fs::read_to_string(&path).map_err(|e| file_error(&path, expected, &e.to_string()))?;
        let report: Value = serde_json::from_str(&text).map_err(|e| file_error(&path, expected, &e.to_string()))?;
        let mut inputs = inputs(&path, &report["provenance"])?;
        if elsewhere.is_empty() {
            same_files(&inputs.runs, &report["provenance"], folder)?;
        } else {
            inputs.runs = elsewhere.to_vec();
        }
        let calibrated = folder.join("calibrated.toml");
        let open = |run: &PathBuf| open_run(&RunArguments { run: run.clone(), reading: inputs.reading.clone() });
        let mut runs: Vec<Run> = inputs.runs.iter().map(open).collect::<Result<_, _>>()?;
        let model = model_of(&runs[0], &inputs.runs[0], inputs.reading.robot.as_deref())?;
        let terrain = terrain_of(&inputs.terrain)?;
        for run in &mut runs {
            let remarks = check_ground(run, &terrain)?;
            run.remarks.extend(remarks);
        }
        let mut given = parameters_of(inputs.params.as_deref(), &model, &terrain)?;
        if has_parameters(&calibrated)? {
            given.extend(parameters_of(Some(&calibrated), &model, &terrain)?);
        }
        find_gains(&mut runs, &model, &terrain, &given)?;
        let ground_error = diagnosis::ground_error(inputs.ground_error, &inputs.terrain)?;
        let files = inputs.runs.iter().map(PathBuf::as_path).chain([calibrated.as_path()]);
        let sha256 = files.flat_map(hashes).collect();
        Ok(Self {
            runs,
            model,
            terrain,
            sha256,
            given,
            effects: diagnosis::effects(inputs.library.as_deref())?,
            effort: NullOptions { seed: inputs.seed, ground_error, ..Default::default() },
            reading: inputs.reading,
        })
    }

    /// How recordings are compared.
    pub fn options(&self) -> Options<'static> {
        let (given, library) = (self.given.clone(), self.effects.clone());
        Options { given, library, effort: self.effort, ..Default::default() }
    }
}

/// The command line that a diagnosis was made with.
fn inputs(path: &Path, provenance: &Value) -> Result<DiagnosisInputs, Failure> {
    let words = provenance["arguments"].as_array().cloned().unwrap_or_default();
    let words: Vec<String> = words.iter().filter_map(|word| Some(word.as_str()?.to_string())).collect();
    let none = || file_error(path, "provenance with the command line of `qv diagnose`", "none");
    Ok(inputs_of(&words).ok_or_else(none)?)
}

/// Whether there is anything in a file of parameters: a robot without a gap has nothing to correct.
fn has_parameters(path: &Path) -> Result<bool, Failure> {
    let text = fs::read_to_string(path).map_err(|e| file_error(path, "a parameter file", &e.to_string()))?;
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| file_error(path, "TOML", e.message()))?;
    Ok(table.get("parameters").and_then(toml::Value::as_table).is_some_and(|all| !all.is_empty()))
}

/// Whether recordings are those that were diagnosed, by their hashes.
fn same_files(runs: &[PathBuf], stated: &Value, folder: &Path) -> Result<(), Failure> {
    let known: Vec<&str> =
        stated["inputs"].as_array().into_iter().flatten().filter_map(|input| input["sha256"].as_str()).collect();
    for run in runs {
        let found = provenance([run.as_path()]);
        let files = found["inputs"].as_array().cloned().unwrap_or_default();
        let is_known = |file: &Value| file["sha256"].as_str().is_some_and(|sha256| known.contains(&sha256));
        let why = match files.iter().find(|file| !is_known(file)) {
            None if !files.is_empty() => continue,
            None => "it is not there".to_string(),
            Some(file) => format!("{} is another file now", file["path"].as_str().unwrap_or_default()),
        };
        let (run, folder) = (run.display(), folder.display());
        return Err(format!(
            "cannot read the calibration '{folder}': its recording '{run}': {why}; name the recordings with --reference"
        )
        .into());
    }
    Ok(())
}
