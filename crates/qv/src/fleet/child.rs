//! One child process within limits of memory and time.
//!
//! Memory is watched and not limited by the system: a limit on addresses would count what a program reserves and never uses.
//! The resident memory of the child is read every few milliseconds, and a child above its limit is killed.

use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Names the process whose end is the end of its child.
const PARENT: &str = "QV_FLEET_PARENT";
/// How long a child is left alone at first, and at most.
const LOOKS: [Duration; 2] = [Duration::from_millis(2), Duration::from_millis(25)];
/// Ticks of a second in which Linux counts the time of processors.
const TICKS: f64 = 100.0;

/// What a child may take.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limits {
    /// Memory \[MiB\].
    pub memory: Option<u64>,
    /// Time \[s\].
    pub timeout: Option<f64>,
}

/// How a child ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    Code(i32),
    /// By a signal of somebody else.
    Signal(i32),
    Timeout,
    Memory,
    /// The caller wanted it.
    Stopped,
    NotStarted(String),
}

/// How a child ended, and what it took.
#[derive(Debug)]
pub struct ChildExit {
    pub end: End,
    /// Time of processors \[s\]; 0 where the system does not show.
    pub cpu_seconds: f64,
    /// \[MiB\]; 0 where the system does not show.
    pub peak_mib: f64,
}

/// Whether memory can be watched here.
pub fn watches_memory() -> bool {
    cfg!(target_os = "linux")
}

/// Called first in every process: a child of `qv fleet run` ends with it, also where that is killed. (Ctrl-C reaches only the
/// parent, since each child has a process group of its own.)
pub fn end_with_parent() {
    #[cfg(target_os = "linux")]
    if let Some(parent) = std::env::var(PARENT).ok().and_then(|text| text.parse::<i32>().ok()) {
        use rustix::process::{Signal, getppid, set_parent_process_death_signal};
        // Without it a child lives on, and holds the lock of its unit until it ends.
        _ = set_parent_process_death_signal(Some(Signal::KILL));
        if getppid().is_some_and(|pid| pid.as_raw_nonzero().get() != parent) {
            std::process::exit(1);
        }
    }
}

/// Runs a command to its end within limits, or until `stop`.
pub fn run(mut command: Command, limits: Limits, stop: &AtomicBool) -> ChildExit {
    command.env(PARENT, std::process::id().to_string());
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let begun = Instant::now();
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(e) => return ChildExit { end: End::NotStarted(e.to_string()), cpu_seconds: 0.0, peak_mib: 0.0 },
    };
    let (mut seen, mut pause) = (ProcessStatus::default(), LOOKS[0]);
    let mut broken = None;
    loop {
        seen.look(child.id());
        let is_over = if seen.is_known { seen.is_over } else { matches!(child.try_wait(), Ok(Some(_)) | Err(_)) };
        if is_over {
            break;
        }
        broken = if stop.load(Ordering::Relaxed) {
            Some(End::Stopped)
        } else if limits.timeout.is_some_and(|most| begun.elapsed().as_secs_f64() > most) {
            Some(End::Timeout)
        } else if limits.memory.is_some_and(|most| seen.mib > most as f64) {
            Some(End::Memory)
        } else {
            None
        };
        if broken.is_some() {
            kill(&mut child);
            break;
        }
        std::thread::sleep(pause);
        pause = (pause * 3 / 2).min(LOOKS[1]);
    }
    let end = match (broken, child.wait()) {
        (Some(end), _) => end,
        (None, Ok(status)) => of_status(status),
        (None, Err(e)) => End::NotStarted(e.to_string()),
    };
    ChildExit { end, cpu_seconds: seen.cpu_seconds, peak_mib: seen.peak_mib }
}

fn of_status(status: std::process::ExitStatus) -> End {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return End::Signal(signal);
    }
    End::Code(status.code().unwrap_or(1))
}

/// Ends a child and what it started.
fn kill(child: &mut Child) {
    #[cfg(unix)]
    if let Some(pid) = i32::try_from(child.id()).ok().and_then(rustix::process::Pid::from_raw) {
        _ = rustix::process::kill_process_group(pid, rustix::process::Signal::KILL);
    }
    _ = child.kill();
}

/// What the system reports a process.
#[derive(Default)]
struct ProcessStatus {
    /// Whether it shows anything.
    is_known: bool,
    /// It ended, and waits to be asked how.
    is_over: bool,
    cpu_seconds: f64,
    mib: f64,
    peak_mib: f64,
}

impl ProcessStatus {
    fn look(&mut self, pid: u32) {
        let Ok(stat) = std::fs::read_to_string(format!("/proc/{pid}/stat")) else { return };
        // The name, in brackets, may hold anything; state is what comes behind it.
        let Some((_, rest)) = stat.rsplit_once(')') else { return };
        let words: Vec<&str> = rest.split_whitespace().collect();
        self.is_known = true;
        self.is_over = matches!(words.first(), Some(&"Z" | &"X"));
        let ticks = [11, 12].iter().filter_map(|&k| words.get(k)?.parse::<f64>().ok()).sum::<f64>();
        self.cpu_seconds = self.cpu_seconds.max(ticks / TICKS);
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
        let mib = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key))?;
            line.split_whitespace().next()?.parse::<f64>().ok().map(|kib| kib / 1024.0)
        };
        self.mib = mib("VmRSS:").unwrap_or(0.0);
        self.peak_mib = self.peak_mib.max(mib("VmHWM:").unwrap_or(0.0));
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::process::Stdio;

    fn shell(text: &str, limits: Limits, stop: bool) -> ChildExit {
        let mut command = Command::new("sh");
        command.args(["-c", text]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        run(command, limits, &AtomicBool::new(stop))
    }

    #[test]
    fn children_end_in_all_ways() {
        let none = Limits::default();
        assert_eq!(shell("exit 3", none, false).end, End::Code(3));
        assert_eq!(shell("kill -9 $$", none, false).end, End::Signal(9));
        assert_eq!(shell("sleep 60", Limits { timeout: Some(0.1), ..none }, false).end, End::Timeout);
        assert_eq!(shell("sleep 60", none, true).end, End::Stopped);
        // Any program has a mebibyte; what it started ends with it.
        let ended = shell("sleep 60 & sleep 60", Limits { memory: Some(0), ..none }, false);
        assert_eq!(ended.end, End::Memory);
        assert!(ended.peak_mib > 0.0);
        let missing = run(Command::new("no/such/program"), none, &AtomicBool::new(false));
        assert!(matches!(missing.end, End::NotStarted(_)));
        assert!(shell("i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done", none, false).cpu_seconds > 0.0);
    }
}
