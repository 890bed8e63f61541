//! A stop that somebody asks for, by Ctrl-C or a signal.

use crate::terminal::print_message;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Exit code of a command that was stopped.
pub const STOPPED: u8 = 130;
/// How often it is looked whether somebody asks.
const EVERY: Duration = Duration::from_millis(50);

/// Whether the command ends by itself when somebody asks: it belongs to the process, as signals do.
static IS_HEEDED: AtomicBool = AtomicBool::new(false);

/// Ends the process when somebody asks for a stop: what was there stays. A command that ends by itself has until somebody asks again.
pub fn watch() {
    let flag = flag();
    std::thread::spawn(move || {
        let mut is_asked_again = false;
        loop {
            std::thread::sleep(EVERY);
            if !flag.swap(false, Ordering::Relaxed) {
                continue;
            }
            if !IS_HEEDED.load(Ordering::Relaxed) || is_asked_again {
                crate::output::abandon();
                print_message!("stopped before the end: no result was written");
                std::process::exit(i32::from(STOPPED));
            }
            is_asked_again = true;
        }
    });
}

/// A flag that becomes true on Ctrl-C and SIGTERM, and when the terminal is closed (SIGHUP) unless that is ignored, as under `nohup`.
/// The command ends by itself then.
pub fn asked() -> Arc<AtomicBool> {
    IS_HEEDED.store(true, Ordering::Relaxed);
    flag()
}

fn flag() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in signals() {
        // What cannot be caught ends the process at once, as without a flag.
        _ = signal_hook::flag::register(signal, flag.clone());
    }
    flag
}

fn signals() -> Vec<i32> {
    let mut all = vec![signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM];
    #[cfg(unix)]
    if !std::fs::read_to_string("/proc/self/status").is_ok_and(|status| ignores(&status, signal_hook::consts::SIGHUP)) {
        all.push(signal_hook::consts::SIGHUP);
    }
    all
}

/// Whether a process ignores a signal, by what Linux says of it: `SigIgn` is a mask in hexadecimal whose lowest bit is signal 1.
#[cfg(unix)]
fn ignores(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn an_ignored_signal_is_read_from_the_mask() {
        let status = "Name:\tqv\nSigBlk:\t0000000000000003\nSigIgn:\t0000000000001001\nSigCgt:\t0\n";
        let found: Vec<bool> = [1, 2, 12, 13, 15].map(|signal| ignores(status, signal)).to_vec();
        assert_eq!(found, [true, false, false, true, false]);
        assert!(!ignores("Name:\tqv\n", 1) && !ignores("SigIgn:\tnothing\n", 1));
    }
}
