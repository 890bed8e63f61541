//! The numbers that decide, all of them, in one place: printed in `report.json`, and set anew by whoever scores other rules.

use super::evidence::Level;
use serde::{Deserialize, Serialize};

/// What decides. Losses are mean squares in units of the null; evidence is in nats; shares are of 1. Those of robots on their feet were left over when
/// every number was taken away without which the decisions on the open recordings are as good (docs/experiments/2026-11-30-motions.md).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// Least log evidence of a cause over the whole recording; more where simulated recordings without an effect reach more by chance.
    pub least_evidence: f64,
    /// The same for an event: a contact that another engine resolves otherwise looks like a short blow.
    pub least_event_evidence: f64,
    /// Shortest event \[s\]: a foot that is set down otherwise than in the simulator looks like a push for half a stride.
    pub least_event: f64,
    /// A size below this many tolerances is no cause.
    pub least_size: f64,
    /// Share of the range, of a limit twice this share of its value, within which a value lies at the edge.
    pub edge: f64,
    /// Least share of the excess over the null that a cause takes in the windows of the fit, or of the gap that it closes in others; of an event, of the
    /// excess.
    pub least_share: f64,
    /// Standard errors by which the held-out loss must fall.
    pub least_errors: f64,
    /// Share of the gap in windows that no fit has seen from which on it counts as explained, and of what the laws of actuators leave.
    pub explained: f64,
    /// Evidence, in units of what a cause needs, from which on something is there though no cause is found: the right one may not
    /// be in the library.
    pub suspicious: f64,
    /// Loss over that of the null that 98 % of robots without an effect stay below, of three engines' contacts and within tolerances.
    pub faultless_level: f64,
    /// Held-out gap over the floor from which on one more cause is looked for.
    pub much_left: f64,
    /// Log evidence of another effect of the accused joints from which on the accused one does not show all of them,
    pub evidence_left: f64,
    /// and as a share of that of the accused one: no large effect is simulated to the last digit.
    pub evidence_share: f64,
    /// Standard errors by which the accused value changes with speed, load or time,
    pub change_errors: f64,
    /// or between two parts of several recordings, the largest of all ways to part them,
    pub recording_errors: f64,
    /// and as a share of it, from which on it is not one value.
    pub change_share: f64,
    /// Time for which several pushes may last together \[s\]: a cable pulls longer.
    pub longest_pushes: f64,
    /// Candidates that are judged in a round, the best first.
    pub most_judged: usize,
    /// Most causes that are accused, in one round more at most: several events may come in each.
    pub most_causes: usize,
    /// Nats in which evidence counts one step in the ranking: an odds ratio beyond any doubt about the model itself means nothing.
    pub nats: f64,

    /// What decides of robots with a fixed base whose torques were recorded beside references.
    pub held: qv_held::Policy,
    /// What decides of robots with a fixed base that can only be compared window by window.
    pub held_windows: HeldWindows,
    /// What decides of the camera.
    pub camera: Camera,
}

/// Numbers of robots with a fixed base that are compared window by window: no contact hides a gap there, and nothing but their motors moves them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HeldWindows {
    /// Least log evidence of a cause.
    pub least_evidence: f64,
    /// The same for an event.
    pub least_event_evidence: f64,
    /// Shortest event \[s\].
    pub least_event: f64,
    /// Log evidence in windows that no fit has seen from which on a cause need not lower what is left there without tolerated deviations.
    pub sure_held_out: f64,
    /// Loss over that of the null up to which there is no gap.
    pub no_gap: f64,
    /// Share of the held-out gap from which on a cause is reported though its value lies just within the edge of its range, or much is left.
    pub mostly_closed: f64,
    /// Level up to which a push that takes `least_share` of the excess is reported, and a cause that closes `mostly_closed`,
    pub quiet_enough: f64,
    /// or share of the excess that pushes take at least.
    pub pushes_take: f64,
}

impl Default for HeldWindows {
    fn default() -> Self {
        Self {
            least_evidence: 12.0,
            least_event_evidence: 20.0,
            least_event: 0.05,
            sure_held_out: 5.0,
            no_gap: 1.45,
            mostly_closed: 0.8,
            quiet_enough: 4.0,
            pushes_take: 0.5,
        }
    }
}

/// Numbers of the camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    /// Log evidence over that of no effect from which an effect of the camera is accused,
    pub evidence: f64,
    /// its size in tolerances,
    pub size: f64,
    /// the share of the squares above the floor that it must take away in photographs that its fit has not seen,
    pub closed: f64,
    /// and the standard errors by which the disagreement must fall there.
    pub errors: f64,
    /// An effect whose evidence comes this near to the accused one's looks like it.
    pub alike: f64,
    /// Level below which nothing is left that noise and tolerances do not explain: 1 is expected of a true model, and outliers, which
    /// count as their weight says, bring no more than 1.8.
    pub explained: f64,
    /// Share of a photograph's contrast that the scene must account for at its best in half of the photographs, or it shows another place.
    pub accounted: f64,
    /// Most effects of the camera that are accused.
    pub most: usize,
    /// How much likelier no effect is than the likeliest one, where none is accused.
    pub none: f64,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            evidence: 5.0,
            size: 3.5,
            closed: 0.1,
            errors: 2.0,
            alike: 10.0,
            explained: 1.4,
            accounted: 0.3,
            most: 3,
            none: 4.0,
        }
    }
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            least_evidence: 50.0,
            least_event_evidence: 200.0,
            least_event: 0.25,
            least_size: 3.5,
            edge: 0.01,
            least_share: 0.25,
            least_errors: 2.0,
            explained: 0.5,
            suspicious: 3.0,
            faultless_level: 1.8,
            much_left: 2.0,
            evidence_left: 80.0,
            evidence_share: 0.01,
            change_errors: 2.0,
            recording_errors: 3.0,
            change_share: 0.05,
            longest_pushes: 3.0,
            most_judged: 4,
            most_causes: 3,
            nats: 10.0,
            held: qv_held::Policy::default(),
            held_windows: HeldWindows::default(),
            camera: Camera::default(),
        }
    }
}

impl Policy {
    /// Whether a level is one that robots without an effect have.
    pub(crate) fn is_faultless(&self, level: &Level, is_free: bool) -> bool {
        level.ratio < if is_free { self.faultless_level } else { self.held_windows.no_gap }
    }

    /// Whether a size \[tolerances\] is no more than any robot may deviate by; what has none is no trifle.
    pub(crate) fn is_trifle(&self, size: f64) -> bool {
        size < self.least_size
    }

    /// Whether a correction takes away most of what the law of its actuators leaves, `before` and after. No contact has a part in that, so
    /// that what engines differ in is no excuse.
    pub(crate) fn closes_actuator_residual(&self, [before, after]: [f64; 2]) -> bool {
        before > 1.0 && after - 1.0 < (1.0 - self.explained) * (before - 1.0)
    }
}
