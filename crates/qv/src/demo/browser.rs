//! A page, opened in the browser of whoever sits there.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest that the opener is waited for: a browser that it started itself may go on for hours.
const PATIENCE: Duration = Duration::from_secs(3);
/// How often it is looked at.
const AGAIN: Duration = Duration::from_millis(50);

/// Words of the system's opener.
fn opener() -> Vec<&'static str> {
    if cfg!(target_os = "macos") {
        vec!["open"]
    } else if cfg!(windows) {
        // `start` takes a first word in quotes for the title of a window.
        vec!["cmd", "/C", "start", ""]
    } else {
        vec!["xdg-open"]
    }
}

/// Opens a page.
///
/// # Errors
/// In words: there is no opener, or it failed.
pub fn open(page: &Path) -> Result<(), String> {
    run(&opener(), page)
}

fn run(words: &[&str], page: &Path) -> Result<(), String> {
    let [program, more @ ..] = words else { return Err("expected a program, found none".into()) };
    let mut command = Command::new(program);
    // A browser within the terminal would take it over.
    command.args(more).arg(page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let child = command.spawn().map_err(|e| format!("{program}: {e}"))?;
    ended(child).map_err(|found| format!("{program}: {found}"))
}

fn ended(mut child: Child) -> Result<(), String> {
    let clock = Instant::now();
    while clock.elapsed() < PATIENCE {
        match child.try_wait().map_err(|e| e.to_string())? {
            Some(status) if status.success() => return Ok(()),
            Some(status) => return Err(status.to_string()),
            None => std::thread::sleep(AGAIN),
        }
    }
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn an_opener_that_fails_or_is_missing_is_named() {
        let page = Path::new("page.html");
        assert_eq!(run(&["true"], page), Ok(()));
        let failed = run(&["false"], page).unwrap_err();
        assert!(failed.starts_with("false: ") && failed.contains('1'), "{failed}");
        assert!(run(&["no-such-opener"], page).unwrap_err().starts_with("no-such-opener: "));
    }
}
