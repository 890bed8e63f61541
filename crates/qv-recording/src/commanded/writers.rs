//! Two programs that write to one command topic: commands jump between two values from message to message.

use super::analysis::Finding;
use crate::run::Run;

/// Messages that are looked at, at least, and the share of them that must go back and forth.
const LEAST: usize = 100;
const OFTEN: f64 = 0.3;
/// A jump between two writers \[rad\].
const JUMP: f64 = 0.05;

/// Reports a second writer: a command that jumps away and comes back with the next message or the one after, time and again.
pub(super) fn several(run: &Run) -> Option<Finding> {
    let commands = run.commands.position.as_ref().filter(|c| c.len() >= LEAST)?;
    let share = |joint: usize| {
        let at = |i: usize| commands.row(i)[joint];
        let returns = |i: &usize| {
            let step = (at(*i) - at(i - 1)).abs();
            let back = (1..4).filter(|k| i + k < commands.len()).any(|k| (at(i + k) - at(i - 1)).abs() < 0.2 * step);
            step > JUMP && back
        };
        (1..commands.len()).filter(returns).count() as f64 / (commands.len() - 1) as f64
    };
    let (joint, share) =
        (0..commands.joints).map(|j| (j, share(j))).max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, s)| *s > OFTEN)?;
    let name = &run.joint_names[joint];
    Some(Finding {
        channel: "commands".into(),
        what: format!(
            "they jump back and forth between two values in {:.0} % of the messages, most at {name}: two programs write to one topic, such as a \
             built-in controller that was not released",
            100.0 * share
        ),
        line: String::new(),
    })
}
