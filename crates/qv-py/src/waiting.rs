//! Long work that Ctrl-C ends: it runs on a thread of its own while Python's looks for signals.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// How often signals are looked for.
const PATIENCE: Duration = Duration::from_millis(50);

/// Where the work is: number of the stage, how many there are, its name, share of all that is done.
pub type Stage = (usize, usize, String, f64);

enum News<T> {
    Begun(Stage),
    Ended(PyResult<T>),
}

/// What the work reports itself.
pub struct Reporter<T> {
    news: Sender<News<T>>,
    stopped: Arc<AtomicBool>,
}

impl<T> Reporter<T> {
    /// A stage begins. Where nobody waits any longer, the work ends here.
    pub fn begin(&self, stage: Stage) {
        if self.stopped.load(Ordering::Relaxed) {
            // Unlike `panic`, this writes nothing.
            std::panic::resume_unwind(Box::new("nobody waits for it"));
        }
        // Whether somebody still listens is asked above.
        _ = self.news.send(News::Begun(stage));
    }
}

/// The result of `work`; `seen` is called with each stage. What Ctrl-C or `seen` raise is raised at once; the work itself ends with the stage
/// that it is in.
pub fn wait<T: Send + 'static>(
    py: Python<'_>,
    seen: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Reporter<T>) -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    let (news, mut heard) = channel();
    let stopped = Arc::new(AtomicBool::new(false));
    let reporter = Reporter { news, stopped: stopped.clone() };
    std::thread::spawn(move || {
        let ended = work(&reporter);
        _ = reporter.news.send(News::Ended(ended));
    });
    loop {
        let (back, got) = py.detach(move || {
            let got = heard.recv_timeout(PATIENCE);
            (heard, got)
        });
        heard = back;
        let answer = match (got, seen) {
            (Ok(News::Ended(ended)), _) => return ended,
            (Ok(News::Begun(stage)), Some(seen)) => seen.call1(stage).map(|_| ()),
            (Ok(News::Begun(_)), None) | (Err(RecvTimeoutError::Timeout), _) => Ok(()),
            (Err(RecvTimeoutError::Disconnected), _) => Err(PyRuntimeError::new_err("the work broke down")),
        };
        if let Err(error) = answer.and_then(|()| py.check_signals()) {
            stopped.store(true, Ordering::Relaxed);
            return Err(error);
        }
    }
}
