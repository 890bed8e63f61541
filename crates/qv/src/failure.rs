//! The one place that words errors: `error: cannot VERB 'OBJECT': REASON`, then a `hint:` line with what to do.
//!
//! Crates name what they expected and what they found (`PLACE: expected X, found Y`); what of that a user reads is decided here.

use qv_sim::names::nearest;
use std::path::{Path, PathBuf};

/// Longest place that stands between quotes \[characters\]; longer ones are sentences.
const PLACE: usize = 160;
/// What systems say of files, and how it is worded.
const SYSTEM: [(&str, &str, &str); 9] = [
    ("File exists", "create", "a file has this name"),
    ("No such file or directory", "open", "no such file or folder"),
    ("no such file", "open", "no such file"),
    ("Permission denied", "open", "permission denied"),
    ("Is a directory", "read", "it is a folder"),
    ("Not a directory", "open", "a part of its path is a file"),
    ("stream did not contain valid UTF-8", "read", "it is no text (UTF-8)"),
    ("Read-only file system", "write", "the file system is read-only"),
    ("No space left on device", "write", "no space left on the device"),
];

/// An error as it is printed: the error's line or lines, and one with a hint.
pub fn message(text: &str, command: &str) -> String {
    let (text, own_hint) = match text.split_once("\nhint: ") {
        Some((text, hint)) => (text, Some(hint.to_owned())),
        None => (text, None),
    };
    let ErrorWords { error, hint } = shaped(&without_excerpt(text), command);
    let general = || match command {
        "" => "`qv --help` lists commands, options and examples".to_owned(),
        _ => format!("`qv {command} --help` lists options and examples"),
    };
    format!("error: {error}\nhint: {}", own_hint.or(hint).unwrap_or_else(general))
}

/// An error of TOML without the excerpt of the file: its first line has the place, its last one the reason.
fn without_excerpt(text: &str) -> String {
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    match (lines.next(), lines.next_back()) {
        (Some(first), Some(last)) if first.contains("TOML parse error") => format!("{first}: {last}"),
        _ => text.to_owned(),
    }
}

struct ErrorWords {
    error: String,
    hint: Option<String>,
}

fn shaped(text: &str, command: &str) -> ErrorWords {
    if text.starts_with("cannot ") {
        return ErrorWords { error: text.to_owned(), hint: None };
    }
    let plain = |error: String| ErrorWords { error, hint: None };
    if let Some((what, reason)) = text.strip_prefix("writing ").and_then(split) {
        return plain(format!("cannot write '{what}': {}", system(reason).map_or(reason, |known| known.2)));
    }
    let whole = || plain(format!("cannot run 'qv {command}': {text}").replace("'qv '", "'qv'"));
    let Some((place, reason)) = split(text) else { return whole() };
    let place = place.trim_matches('`');
    // Of a part of a file the file is the object.
    let (place, part) = match place.split_once(": ").filter(|(file, _)| is_file(file)) {
        Some((file, part)) => (file, format!("{part}: ")),
        None => (place, String::new()),
    };
    let found = reason.rsplit_once("found ").map_or(reason, |(_, found)| found);
    if let Some((_, verb, words)) = system(found).filter(|_| found.len() < PLACE) {
        return ErrorWords {
            error: format!("cannot {verb} '{place}': {part}{words}"),
            hint: hint_for_file(place, reason),
        };
    }
    if let Some(misspelt) = found.strip_prefix("unknown ").and_then(|rest| rest.split_once("; nearest: ")) {
        let (what, nearest) = misspelt;
        let error = format!("cannot use '{place}': {part}unknown {what}");
        return ErrorWords { error, hint: Some(format!("did you mean '{nearest}'?")) };
    }
    let verb = if is_file(place) { "read" } else { "use" };
    plain(format!("cannot {verb} '{place}': {part}{reason}"))
}

/// Place and reason of `PLACE: REASON`; `None` where what stands before the colon is a sentence.
fn split(text: &str) -> Option<(&str, &str)> {
    // A path may have a colon: what is expected begins the reason where it is said.
    let at = text.find(": expected ").or_else(|| text.find(": "))?;
    let (place, reason) = (&text[..at], &text[at + 2..]);
    let is_short = place.chars().count() <= PLACE && !place.contains('\n') && !place.contains('\'');
    is_short.then_some((place, reason))
}

fn system(reason: &str) -> Option<&'static (&'static str, &'static str, &'static str)> {
    SYSTEM.iter().find(|(said, _, _)| reason.starts_with(said))
}

/// Whether a place is a file, and no part of one or an option.
fn is_file(place: &str) -> bool {
    let path = Path::new(place);
    path.exists()
        || (!place.contains(' ') && !place.starts_with("--") && path.extension().is_some_and(|e| e.len() <= 5))
}

/// A file of the same folder with nearly that name, else what was expected there.
fn hint_for_file(place: &str, reason: &str) -> Option<String> {
    let expected = reason.strip_prefix("expected ").and_then(|rest| rest.rsplit_once(", found ")).map(|(x, _)| x);
    if let Some(near) = near(Path::new(place)) {
        return Some(format!("did you mean '{}'?", near.display()));
    }
    // What a program that is missing needs stands behind what the system says.
    let advice = reason.split_once("; ").map(|(_, advice)| advice.to_owned());
    advice.or_else(|| expected.map(|expected| format!("expected {expected}")))
}

/// The file beside a missing one whose name differs from it by a slip of the fingers.
fn near(missing: &Path) -> Option<PathBuf> {
    let name = missing.file_name()?.to_str()?;
    let folder = missing.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if missing.exists() {
        return None;
    }
    let entries = std::fs::read_dir(folder).ok()?;
    let names: Vec<String> = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
    let found = nearest(name, names.iter().map(String::as_str))?;
    is_slip(name, found).then(|| missing.with_file_name(found))
}

/// Whether names share all but a few letters at one place.
fn is_slip(a: &str, b: &str) -> bool {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let first = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    let last = a.iter().rev().zip(b.iter().rev()).take_while(|(x, y)| x == y).count();
    let longest = a.len().max(b.len());
    longest > 3 && first + last + 3 > longest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> [String; 2] {
        let message = message(text, "diagnose");
        let (error, hint) = message.split_once('\n').unwrap();
        [error.to_owned(), hint.to_owned()]
    }

    #[test]
    fn every_shape_of_the_crates_becomes_one() {
        for (text, error, hint) in [
            (
                "gone/run.mcap: expected a recording, found No such file or directory (os error 2)",
                "error: cannot open 'gone/run.mcap': no such file or folder",
                "hint: expected a recording",
            ),
            (
                "run.toml: expected a robot, found none",
                "error: cannot read 'run.toml': expected a robot, found none",
                "hint: `qv diagnose --help` lists options and examples",
            ),
            (
                "--without: expected an effect of `qv effects`, found unknown effect \"frictoin\"; nearest: ground_friction",
                "error: cannot use '--without': unknown effect \"frictoin\"",
                "hint: did you mean 'ground_friction'?",
            ),
            (
                "joint positions: expected finite values, found none",
                "error: cannot use 'joint positions': expected finite values, found none",
                "hint: `qv diagnose --help` lists options and examples",
            ),
            (
                "writing out/report.html: Permission denied (os error 13)",
                "error: cannot write 'out/report.html': permission denied",
                "hint: `qv diagnose --help` lists options and examples",
            ),
            (
                "C: odd/run.csv: expected a table, found nothing",
                "error: cannot use 'C: odd/run.csv': expected a table, found nothing",
                "hint: `qv diagnose --help` lists options and examples",
            ),
            (
                "something else went wrong",
                "error: cannot run 'qv diagnose': something else went wrong",
                "hint: `qv diagnose --help` lists options and examples",
            ),
            (
                "cannot mesh 'a.ply': no cameras\nhint: give --cameras",
                "error: cannot mesh 'a.ply': no cameras",
                "hint: give --cameras",
            ),
        ] {
            assert_eq!(lines(text), [error, hint], "{text}");
        }
    }

    #[test]
    fn a_slip_of_the_fingers_finds_its_file() {
        for (a, b) in [("wlak.mcap", "walk.mcap"), ("walk.mcp", "walk.mcap"), ("walks.mcap", "walk.mcap")] {
            assert!(is_slip(a, b), "{a} {b}");
        }
        for (a, b) in [("walk.mcap", "report.html"), ("a", "b"), ("monday.mcap", "tuesday.mcap")] {
            assert!(!is_slip(a, b), "{a} {b}");
        }
    }
}
