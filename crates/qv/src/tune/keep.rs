//! Stages that are done, in files: a run that was stopped goes on after them.

use crate::Failure;
use crate::output::{self, write_whole};
use qv_residual::ResidualError;
use qv_residual::close::{Inputs, Keep};
use std::fs;
use std::path::{Path, PathBuf};

/// A folder `stages` with one file for each stage. All belong to the same inputs: our files of others are removed.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(out: &Path, inputs: &Inputs) -> Result<Self, Failure> {
        let folder = out.join("stages");
        let key = inputs.key();
        if fs::read_to_string(folder.join("key")).is_ok_and(|kept| kept == key) {
            return Ok(Self(folder));
        }
        output::clear(&folder)?;
        output::make_folder(&folder)?;
        write_whole(&folder.join("key"), key.as_bytes())?;
        output::commit()?;
        Ok(Self(folder))
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(format!("{}.json", name.replace(' ', "_")))
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
