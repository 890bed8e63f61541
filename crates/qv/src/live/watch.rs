//! `qv watch`: a robot's data while it runs, on a page that updates itself.

use super::Listening;
use crate::{Failure, Outcome};
use std::path::PathBuf;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv watch --live eth0\n\
     \x20 qv watch --live eth0 --baseline out/why --port 8080\n\
     \n\
     The page shows rates, losses, faults, conventions and, with --baseline, drift. It is served on 127.0.0.1 alone;\n\
     from another machine: ssh -L 8080:127.0.0.1:8080 ROBOT. Nothing is published. See docs/guide/live.md.",
    "3 done, but messages were lost or were none of their type (reported)\n  4 the robot changed (--baseline)"
);

#[derive(clap::Args)]
#[cfg_attr(not(feature = "live"), allow(dead_code))]
pub struct Watch {
    #[command(flatten)]
    listening: Listening,
    /// Test for drift against the results of `qv diagnose`
    #[arg(long, value_name = "DIR", help_heading = "What to test")]
    baseline: Option<PathBuf>,
    /// Serve the page on this port of 127.0.0.1 [default: any free one]
    #[arg(long, default_value_t = 0, value_name = "PORT", hide_default_value = true, help_heading = "Output")]
    port: u16,
    /// Print one line of JSON instead of text
    #[arg(long, help_heading = "Common")]
    json: bool,
}

#[cfg(not(feature = "live"))]
impl Watch {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        Err(super::not_built())
    }
}

#[cfg(feature = "live")]
mod checks {
    use super::super::page::CheckResult;
    use crate::drift::BaselineRobot;
    use qv_gap::drift::{Answer, Baseline, DriftPolicy};
    use qv_recording::conventions::table;
    use qv_recording::{Run, derive};
    use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
    use std::sync::{Arc, Mutex};
    use std::thread;

    /// Checks of runs in a thread of their own, so that no message waits for them.
    pub struct Checker {
        runs: SyncSender<Run>,
        /// What was found last.
        pub found: Arc<Mutex<(CheckResult, Option<Answer>)>>,
    }

    impl Checker {
        pub fn new(calibrated: Option<BaselineRobot>) -> Self {
            let (runs, inbox) = sync_channel(1);
            let found = Arc::new(Mutex::new((CheckResult::default(), None)));
            let shared = found.clone();
            thread::spawn(move || check_all(&inbox, calibrated, &shared));
            Self { runs, found }
        }

        /// Hands on a run; while another one is checked it is dropped.
        pub fn check(&self, run: Run) {
            match self.runs.try_send(run) {
                Ok(()) | Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
            }
        }
    }

    fn check_all(
        inbox: &Receiver<Run>,
        calibrated: Option<BaselineRobot>,
        shared: &Mutex<(CheckResult, Option<Answer>)>,
    ) {
        let mut baseline = None;
        for run in inbox {
            let faults = run.faults.iter().map(|f| format!("{}: {}, {}", f.channel, f.kind, f.detail)).collect();
            let mark = |is_ours| match is_ours {
                Some(true) => "ok",
                Some(false) => "another convention",
                None => "not shown",
            };
            let conventions =
                table(&run).iter().map(|c| format!("{}: {} ({})", c.name, c.found, mark(c.is_ours))).collect();
            let (drift, answer) = match &calibrated {
                Some(calibrated) => drift(&run, calibrated, &mut baseline),
                None => (None, None),
            };
            if let Ok(mut shared) = shared.lock() {
                let answer = answer.or(shared.1);
                *shared = (CheckResult { faults, conventions, drift }, answer);
            }
        }
    }

    fn drift(
        run: &Run,
        calibrated: &BaselineRobot,
        baseline: &mut Option<Baseline>,
    ) -> (Option<String>, Option<Answer>) {
        let (model, terrain, options) = (&calibrated.model, &calibrated.terrain, calibrated.options());
        if baseline.is_none() {
            match Baseline::new(&calibrated.runs, model, terrain, &options, &DriftPolicy::default()) {
                Ok(found) => *baseline = Some(found),
                Err(error) => return (Some(format!("cannot compare: {error}")), None),
            }
        }
        let Some(first) =
            baseline.as_ref().filter(|_| derive::joint_velocity(run).is_some() || run.measured.velocity.is_some())
        else {
            return (None, None);
        };
        match first.compare(std::slice::from_ref(run), model, terrain, &options) {
            Ok(found) => (Some(found.sentence.clone()), Some(found.answer)),
            // A robot that stands still for a while, such as at its charger.
            Err(error) => (Some(format!("cannot compare the last seconds: {error}")), None),
        }
    }
}

/// Seconds that are checked at once, and between two checks; bytes that are kept of a flood.
#[cfg(feature = "live")]
const WINDOW: f64 = 20.0;
#[cfg(feature = "live")]
const BETWEEN: f64 = 10.0;
#[cfg(feature = "live")]
const MOST: usize = 40 << 20;

#[cfg(feature = "live")]
impl Watch {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        use super::listen::Listener;
        use super::page::Topics;
        use super::serve::serve;
        use qv_gap::drift::Answer;
        use std::cell::RefCell;
        use std::sync::{Arc, Mutex};
        use std::time::{Duration, Instant};
        let calibrated =
            self.baseline.as_ref().map(|folder| crate::drift::BaselineRobot::open(folder, &[])).transpose()?;
        let mut listener = Listener::new(&self.listening)?;
        let shown = Arc::new(Mutex::new(String::new()));
        let address =
            serve(self.port, shown.clone()).map_err(|e| format!("cannot serve the page on port {}: {e}", self.port))?;
        crate::progress::remark(&format!("page: http://{address}/"));
        let checker = checks::Checker::new(calibrated);
        let mut topics = Topics::of(&listener);
        let title = format!("{} on {}", self.listening.robot, self.listening.live);
        let recent = RefCell::new(qv_live::Recent::new(WINDOW, MOST));
        let (subscriptions, mapping) = (listener.subscriptions.clone(), listener.mapping.clone());
        let mut drawn: Option<Instant> = None;
        let mut checked = Instant::now();
        let see = |sample| {
            recent.borrow_mut().push(sample);
            Ok(())
        };
        listener.run(see, |health| {
            if drawn.is_none_or(|at| at.elapsed() >= Duration::from_secs(1)) {
                drawn = Some(Instant::now());
                let found = checker.found.lock().map(|found| found.0.clone()).unwrap_or_default();
                let html = topics.render(&title, health, &found);
                shown.lock().map(|mut page| *page = html).ok();
            }
            if checked.elapsed().as_secs_f64() >= BETWEEN {
                checked = Instant::now();
                // Before joint states come there is no run.
                if let Ok(run) = recent.borrow().to_run(&subscriptions, &mapping) {
                    checker.check(run);
                }
            }
            Ok(())
        })?;
        let (found, answer) = checker.found.lock().map(|found| found.clone()).unwrap_or_default();
        if self.json {
            let line = serde_json::json!({
                "format": "qv-watch/1", "topics": listener.to_json(), "faults": found.faults, "drift": found.drift,
            });
            crate::say(&format!("{line}\n"))?;
        } else {
            let faults: String = found.faults.iter().map(|fault| format!("{fault}\n")).collect();
            let drift = found.drift.map_or(String::new(), |drift| format!("{drift}\n"));
            crate::say(&format!("{}{faults}{drift}", listener.to_text()))?;
        }
        Ok(match answer {
            Some(Answer::Changed) => Outcome::Changed,
            _ if listener.is_partial() => Outcome::Partial,
            _ => Outcome::Done,
        })
    }
}
