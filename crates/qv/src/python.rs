//! Python programs of ours, in virtual environments that are made once under the user's cache.

use crate::Failure;
use crate::outcome::about;
use crate::output::{commit, write_whole};
use crate::progress::spinner;
use crate::terminal::shown;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Names that Python goes by.
const PYTHONS: [&str; 2] = ["python3", "python"];

/// A virtual environment with packages.
pub struct Environment {
    /// Folder below the cache.
    pub name: &'static str,
    /// The packages, in words.
    pub packages: &'static str,
    /// All that they need, as pip takes it: versions, and the hashes of the files.
    pub requirements: &'static str,
    /// A statement that fails where they are not there.
    pub import: &'static str,
    /// Variable that names an environment of the user's to take instead.
    pub variable: &'static str,
    /// What it is for, and how large, in words.
    pub purpose: &'static str,
}

impl Environment {
    /// Its folder; none where neither the user nor the system says where it may be.
    fn folder(&self) -> Option<PathBuf> {
        let given = std::env::var_os(self.variable).map(PathBuf::from);
        given.or_else(|| Some(cache()?.join(self.name)))
    }

    fn interpreter(folder: &Path) -> PathBuf {
        folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" })
    }

    fn works(&self, folder: &Path) -> bool {
        let python = Self::interpreter(folder);
        python.is_file() && ends_well(isolated(&python).args(["-c", self.import]))
    }

    /// Whether it was made already, with its packages.
    pub fn is_there(&self) -> bool {
        self.folder().is_some_and(|folder| self.works(&folder))
    }
}

/// Runs a program, showing each line that it says, and gives the last one. The text of the program goes to `file`.
///
/// # Errors
/// Python or its packages cannot be had, or the program fails: then the last line of its errors.
pub fn said(environment: &Environment, text: &str, file: &Path, arguments: &[&Path]) -> Result<String, Failure> {
    let python = python(environment)?;
    write_whole(file, text.as_bytes())?;
    commit().map_err(|e| about(file, e))?;
    let mut command = isolated(&python);
    command.arg("-u").arg(file).args(arguments);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|e| about(&python, format!("expected Python, found {e}")))?;
    let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
    // Read beside, so that neither of the two waits for the other.
    let errors = std::thread::spawn(move || {
        let mut text = String::new();
        stderr.map(|mut pipe| pipe.read_to_string(&mut text));
        text
    });
    let (sign, mut last) = (spinner(environment.purpose.to_string()), String::new());
    for line in stdout.into_iter().flat_map(|pipe| BufReader::new(pipe).lines()).map_while(Result::ok) {
        sign.set_message(shown(&line));
        last = line;
    }
    let status = child.wait().map_err(|e| about(&python, format!("expected it to end, found {e}")))?;
    sign.finish_and_clear();
    if status.success() {
        return Ok(last);
    }
    Err(format!("{status}: {}", last_line(&errors.join().unwrap_or_default())).into())
}

/// Python of an environment that has the packages; made if need be.
fn python(environment: &Environment) -> Result<PathBuf, Failure> {
    let Environment { packages, variable, purpose, .. } = environment;
    let folder = environment.folder().ok_or_else(|| {
        format!("cannot make a Python environment for {purpose}: no HOME says where; set HOME, or {variable} to one with {packages}")
    })?;
    let python = Environment::interpreter(&folder);
    if environment.works(&folder) {
        return Ok(python);
    }
    if std::env::var_os(variable).is_some() {
        let expected = format!("expected a virtual environment with {packages} ({variable}), found none");
        return Err(about(&folder, expected));
    }
    let sign = spinner(format!("making a Python environment for {purpose} (once)"));
    let base = PYTHONS.iter().find(|name| ends_well(isolated(name).arg("--version")));
    let base = base.ok_or_else(|| format!("python3: expected it among the programs for {purpose}, found none"))?;
    said_well(
        isolated(base).args(["-m", "venv"]).arg(&folder),
        "a virtual environment (Debian has it in python3-venv)",
    )?;
    let requirements = folder.join("requirements.txt");
    write_whole(&requirements, environment.requirements.as_bytes())?;
    let install = ["-m", "pip", "install", "--quiet", "--require-hashes", "--only-binary", ":all:", "-r"];
    said_well(isolated(&python).args(install).arg(&requirements), &format!("{packages} from the package index"))?;
    sign.finish_and_clear();
    Ok(python)
}

/// Python that looks for modules in its own folders alone: not in the current one, not beside a program, not where variables say.
fn isolated(python: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(python);
    command.arg("-I");
    command
}

/// Where programs keep what they can make again; none without a home. A folder that all may write into, such as that of temporary files,
/// could hold a Python of somebody else.
fn cache() -> Option<PathBuf> {
    // What is not absolute would depend on the current folder.
    let named = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let home = || named(if cfg!(windows) { "LOCALAPPDATA" } else { "HOME" }).map(|home| home.join(".cache"));
    named("XDG_CACHE_HOME").or_else(home).map(|base| base.join("quadverse"))
}

fn ends_well(command: &mut Command) -> bool {
    let command = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn said_well(command: &mut Command, expected: &str) -> Result<(), Failure> {
    let output = command.stdin(Stdio::null()).output().map_err(|e| format!("expected {expected}, found {e}"))?;
    if output.status.success() {
        return Ok(());
    }
    let why = last_line(&String::from_utf8_lossy(&output.stderr));
    Err(format!("expected {expected}, found {}: {why}", output.status).into())
}

fn last_line(errors: &str) -> String {
    errors.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("nothing said").to_string()
}
