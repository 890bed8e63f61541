//! Stages that are done, in files: a run that was stopped goes on after them.

use crate::Failure;
use crate::output::{self, write_whole};
use qv_residual::ResidualError;
use qv_residual::close::{Inputs, Keep};
use std::fs;
use std::path::{Path, PathBuf};

/// Digits of a digest in names of files.
const DIGITS: usize = 12;

/// A folder `stages` with one file for each stage. The names of files begin with a digest of the inputs that they belong to: files of other
/// inputs are never read, and ours among them are removed.
pub struct Folder {
    path: PathBuf,
    digest: String,
}

impl Folder {
    pub fn new(out: &Path, inputs: &Inputs) -> Result<Self, Failure> {
        let folder = out.join("stages");
        let key = inputs.key();
        let stages = Self { path: folder, digest: qv_fleet::sha256(key.as_bytes())[..DIGITS].into() };
        let own = stages.path.join(format!("{}_key.txt", stages.digest));
        if fs::read_to_string(&own).is_ok_and(|kept| kept == key) {
            return Ok(stages);
        }
        output::clear(&stages.path)?;
        output::make_folder(&stages.path)?;
        write_whole(&own, key.as_bytes())?;
        output::commit()?;
        Ok(stages)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.path.join(format!("{}_{}.json", self.digest, name.replace(' ', "_")))
    }
}

impl Keep for Folder {
    fn get(&self, name: &str) -> Option<String> {
        fs::read_to_string(self.file(name)).ok()
    }

    fn put(&self, name: &str, text: &str) -> Result<(), ResidualError> {
        let path = self.file(name);
        write_whole(&path, text.as_bytes())
            .and_then(|()| Ok(output::commit()?))
            .map_err(|e| ResidualError::input(path.display().to_string(), "to write it", e))
    }
}
