//! `qv report --reproduce DIR`: the same diagnosis once more, from what its report states, and whether it gives the same bits.

use super::json_file::read_json;
use crate::config::with_value;
use crate::outcome::about;
use crate::provenance::provenance;
use crate::terminal::{print_message, say};
use crate::{Failure, Outcome};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, fs};

/// What differs from one run of the same to the next: seconds, the words of the command line, which name the folder of the results, and the
/// version, of which a message says that it differs.
const VOLATILE: [&str; 3] = ["/timing", "/provenance/arguments", "/provenance/version"];
/// Most differences that are printed.
const SHOWN: usize = 5;
/// Words of a command line that change no result.
const QUIET: [&str; 6] = ["-q", "--quiet", "-v", "--verbose", "--no-config", "--json"];

/// Diagnoses again, and compares the reports: `Done` for equal, `Changed` for different, `Partial` where an input is missing or changed.
///
/// # Errors
/// There is no report of a diagnosis, or it cannot be made anew.
pub fn reproduce(folder: &Path, json: bool) -> Result<Outcome, Failure> {
    let path = folder.join("report.json");
    let before = read_json(&path, "sentence")?;
    let words = words_of(&path, &before["provenance"])?;
    let obstacles = changes_of_inputs(&before["provenance"]["inputs"]);
    if !obstacles.is_empty() {
        if json {
            print_json(folder, "inputs", &obstacles)?;
        }
        obstacles.iter().for_each(|what| print_message!("{what}"));
        return Ok(Outcome::Partial);
    }
    if before["provenance"]["version"] != env!("CARGO_PKG_VERSION") {
        let (then, now) = (&before["provenance"]["version"], env!("CARGO_PKG_VERSION"));
        print_message!("'{}' was made by version {then}; this is {now}", path.display());
    }
    let work = WorkFolder::make()?;
    diagnose(words, &work.path)?;
    let after = read_json(&work.path.join("report.json"), "sentence")?;
    let differences = differences(&before, &after);
    let answer = if differences.is_empty() { "equal" } else { "different" };
    if json {
        print_json(folder, answer, &differences)?;
    } else {
        say(&text_of(folder, &differences))?;
    }
    Ok(if differences.is_empty() { Outcome::Done } else { Outcome::Changed })
}

fn print_json(folder: &Path, answer: &str, what: &[String]) -> Result<(), Failure> {
    let line = json!({"format": "qv-reproduce/1", "diagnosis": folder, "answer": answer, "differences": what});
    Ok(say(&format!("{line}\n"))?)
}

fn text_of(folder: &Path, differences: &[String]) -> String {
    let folder = folder.display();
    if differences.is_empty() {
        return format!("{folder}: report.json was reproduced: all values have the same bits\n");
    }
    let mut text = format!("{folder}: report.json was not reproduced: {} values differ\n", differences.len());
    for line in differences.iter().take(SHOWN) {
        text += &format!("  {line}\n");
    }
    if differences.len() > SHOWN {
        text += &format!("  and {} more\n", differences.len() - SHOWN);
    }
    text
}

/// The command line of a diagnosis, from its report.
fn words_of(path: &Path, provenance: &Value) -> Result<Vec<String>, Failure> {
    let words = provenance["arguments"].as_array().into_iter().flatten();
    let words: Vec<String> = words.filter_map(|word| Some(word.as_str()?.to_string())).collect();
    let words: Vec<String> = words.into_iter().filter(|word| !QUIET.contains(&word.as_str())).collect();
    match words.first().map(String::as_str) {
        Some("diagnose") => Ok(words),
        _ => Err(about(path, "expected provenance with the command line of `qv diagnose`, found none")),
    }
}

/// Inputs that are not what they were, a line each.
fn changes_of_inputs(inputs: &Value) -> Vec<String> {
    let change = |input: &Value| {
        let path = input["path"].as_str()?;
        let found = provenance([Path::new(path)]);
        let now = &found["inputs"][0]["sha256"];
        match now.is_null() {
            true => Some(format!(
                "cannot read '{path}': no such file; run this in the folder in which the diagnosis was run"
            )),
            false => {
                (*now != input["sha256"]).then(|| format!("cannot use '{path}': it has changed since the diagnosis"))
            }
        }
    };
    inputs.as_array().into_iter().flatten().filter_map(change).collect()
}

/// Runs `qv` with the words of a diagnosis, and another folder for its results.
fn diagnose(words: Vec<String>, out: &Path) -> Result<(), Failure> {
    let program = env::current_exe().map_err(|e| format!("cannot run 'qv diagnose': {e}"))?;
    let words = with_value(words, "out", &out.display().to_string());
    let mut command = Command::new(program);
    command.arg(&words[0]).args(["--quiet", "--no-config"]).args(&words[1..]);
    let output = command.stdin(Stdio::null()).output().map_err(|e| format!("cannot run 'qv diagnose': {e}"))?;
    // 3: part of the input was lost, as it was the first time.
    if matches!(output.status.code(), Some(0 | 3)) {
        return Ok(());
    }
    let messages = String::from_utf8_lossy(&output.stderr);
    let reason = messages.trim().trim_start_matches("error: ").split("\nhint: ").next().unwrap_or_default().to_string();
    Err(format!("cannot reproduce the diagnosis: {reason}").into())
}

/// Values of two reports that differ, by their places.
fn differences(before: &Value, after: &Value) -> Vec<String> {
    let mut found = Vec::new();
    compare("", before, after, &mut found);
    found
}

fn compare(place: &str, before: &Value, after: &Value, found: &mut Vec<String>) {
    if VOLATILE.contains(&place) {
        return;
    }
    match (before, after) {
        (Value::Object(a), Value::Object(b)) => {
            let added = b.keys().filter(|key| !a.contains_key(*key));
            for key in a.keys().chain(added) {
                let (a, b) = (a.get(key).unwrap_or(&Value::Null), b.get(key).unwrap_or(&Value::Null));
                compare(&format!("{place}/{key}"), a, b, found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (k, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&format!("{place}/{k}"), a, b, found);
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            found.push(format!("{place}: {} entries before, {} now", a.len(), b.len()));
        }
        _ => {
            // As they are written: the shortest text of a number has its bits, and the sign of zero.
            let [a, b] = [before, after].map(ToString::to_string);
            if a != b {
                found.push(format!("{place}: {} before, {} now", shortened(&a), shortened(&b)));
            }
        }
    }
}

/// A value in a few words.
fn shortened(text: &str) -> String {
    const MOST: usize = 60;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// A folder for one diagnosis, removed at the end.
struct WorkFolder {
    path: PathBuf,
}

impl WorkFolder {
    fn make() -> Result<Self, Failure> {
        let path = env::temp_dir().join(format!("qv-reproduce-{}", std::process::id()));
        fs::create_dir_all(&path).map_err(|e| about(&path, format!("expected a folder, found {e}")))?;
        Ok(Self { path })
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        _ = fs::remove_dir_all(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_differ_are_named_by_place_and_seconds_are_not_compared() {
        let before = json!({"timing": {"runtime_s": 1.0}, "gap": {"closed": 0.9}, "causes": [1, 2], "zero": 0.0,
            "provenance": {"arguments": ["a"], "version": "1"}});
        let mut after = before.clone();
        after["timing"]["runtime_s"] = json!(2.0);
        after["provenance"]["arguments"] = json!(["b"]);
        assert!(differences(&before, &after).is_empty());
        after["gap"]["closed"] = json!(f64::from_bits(0.9_f64.to_bits() + 1));
        after["causes"] = json!([1]);
        after["zero"] = json!(-0.0);
        after["more"] = json!(true);
        let found = differences(&before, &after);
        let expected = [
            "/causes: 2 entries before, 1 now",
            "/gap/closed: 0.9 before, 0.9000000000000001 now",
            "/zero: 0.0 before, -0.0 now",
            "/more: null before, true now",
        ];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        assert!(expected.iter().all(|line| found.iter().any(|f| f == line)), "{found:?}");
    }

    #[test]
    fn inputs_that_changed_or_are_gone_are_named() {
        let folder = WorkFolder::make().unwrap();
        let path = folder.path.join("run.csv");
        fs::write(&path, "time").unwrap();
        let stated = provenance([path.as_path()]);
        assert!(changes_of_inputs(&stated["inputs"]).is_empty());
        fs::write(&path, "time,pos").unwrap();
        let changed = changes_of_inputs(&stated["inputs"]);
        assert!(changed.len() == 1 && changed[0].contains("run.csv': it has changed"), "{changed:?}");
        fs::remove_file(&path).unwrap();
        let gone = changes_of_inputs(&stated["inputs"]);
        assert!(gone.len() == 1 && gone[0].contains("run.csv': no such file"), "{gone:?}");
    }
}
