//! The folder of a fleet: its plan, and a folder for each unit.

use crate::Failure;
use crate::lock::{Lock, LockAttempt};
use crate::outcome::about;
use qv_fleet::state::{FailedUnit, UnitRecord};
use qv_fleet::{Plan, Unit};
use std::fs;
use std::path::{Path, PathBuf};

/// Options that a fleet sets itself.
const OWN: [&str; 4] = ["--out", "--json", "--no-config", "--ask"];

/// A fleet on disk.
pub struct Folder {
    pub path: PathBuf,
    pub plan: Plan,
}

impl Folder {
    /// Reads the plan of a folder.
    ///
    /// # Errors
    /// There is none, or it is of another version of the program: its results would be those of two programs.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let file = path.join("plan.json");
        let text = fs::read_to_string(&file)
            .map_err(|e| about(&file, format!("expected a plan of `qv fleet plan`, found {e}")))?;
        let plan = Plan::parse(&text, &file.display().to_string())?;
        Ok(Self { path: path.into(), plan })
    }

    /// The same for who works on it.
    ///
    /// # Errors
    /// As [`Folder::open`]; or the plan is of another version of the program.
    pub fn open_to_work(path: &Path) -> Result<Self, Failure> {
        let folder = Self::open(path)?;
        let (own, planned) = (env!("CARGO_PKG_VERSION"), &folder.plan.task.version);
        if own != planned {
            let file = path.join("plan.json");
            let words = format!("expected a plan of version {own}, found {planned}: plan again, what is done stays");
            return Err(about(&file, words));
        }
        check_own(&folder.plan.task.options).map_err(|found| about(&path.join("plan.json"), found))?;
        Ok(folder)
    }

    /// The lock of all of a folder, which is made if need be.
    ///
    /// # Errors
    /// Somebody has it.
    pub fn lock(path: &Path) -> Result<Lock, Failure> {
        fs::create_dir_all(path).map_err(|e| about(path, format!("expected to make it, found {e}")))?;
        let file = path.join("lock");
        match Lock::try_take(&file)? {
            LockAttempt::Taken(lock) => Ok(lock),
            LockAttempt::HeldBy(who) => {
                Err(about(&file, format!("expected nobody at work in this folder, found {who}")))
            }
        }
    }

    /// The folder of a unit.
    pub fn of(&self, unit: &Unit) -> PathBuf {
        self.path.join("units").join(&unit.id)
    }

    /// The report of a unit, if there is one.
    pub fn report(&self, unit: &Unit) -> Option<Vec<u8>> {
        fs::read(self.of(unit).join("out").join(self.plan.task.command.report())).ok()
    }

    /// The record and report of a unit that is done.
    pub fn done(&self, unit: &Unit) -> Option<(UnitRecord, Vec<u8>)> {
        let text = fs::read_to_string(self.of(unit).join("done.json")).ok()?;
        let report = self.report(unit)?;
        Some((UnitRecord::read(&text, &self.plan, unit, &report)?, report))
    }

    /// The record of a unit that failed.
    pub fn failed(&self, unit: &Unit) -> Option<FailedUnit> {
        FailedUnit::read(&fs::read_to_string(self.of(unit).join("failed.json")).ok()?, unit)
    }
}

/// Refuses options that a fleet sets itself, or that are never taken from a file such as a plan.
pub fn check_own(options: &[String]) -> Result<(), String> {
    let own = |option: &&String| OWN.iter().any(|own| *option == own || option.starts_with(&format!("{own}=")));
    match options.iter().find(own) {
        Some(option) => Err(format!("options after --: expected none that a fleet sets itself, found {option}")),
        None => Ok(()),
    }
}
