//! The table of several effects that were fitted at once.

use super::words::{escape, fixed, percent, significant, size, words};
use crate::report::{ParameterEstimate, Together, TogetherEffect};
use std::fmt::Write;

/// The table under its heading.
pub fn together(together: &Together) -> String {
    let mut text = format!(
        "<h2>Joint fit of several effects</h2><div class=\"card\"><p>Several effects may be present. Fitted together these remove {} \
         ({} to {}) of the gap on held-out windows, joints {} to {} mrad. The remaining error is {} times that of a robot without a fault, \
         so none of them is identified.</p><table><tr><th>effect</th><th>where</th><th>size</th>\
         <th title=\"log likelihood ratio without it\">evidence</th></tr>",
        percent(together.closed),
        percent(together.closed_ci95[0]),
        percent(together.closed_ci95[1]),
        significant(1e3 * together.joint_rms[0], 3),
        significant(1e3 * together.joint_rms[1], 3),
        fixed(together.level, 1),
    );
    together.effects.iter().for_each(|effect| text += &row(effect));
    text + "</table></div>"
}

fn row(effect: &TogetherEffect) -> String {
    let names: Vec<String> = effect.names().map(words).collect();
    let named = |p: &ParameterEstimate| format!("{} {}", escape(&words(&p.name)), escape(&size(p)));
    let sizes: Vec<String> = effect.parameters.iter().map(named).collect();
    let mut text = String::new();
    let _ = write!(
        text,
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
        escape(&names.join(", or ")),
        escape(&effect.scope.join(", ")),
        sizes.join("<br>"),
        fixed(effect.log_likelihood_ratio, 0)
    );
    text
}
