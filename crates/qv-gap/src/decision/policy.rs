//! The numbers that decide, all of them, in one place: printed in `report.json`, and set anew by whoever scores other rules.

use super::evidence::Level;
use serde::{Deserialize, Serialize};

/// What decides. Losses are mean squares in units of the null; evidence is in nats; shares are of 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// Least log evidence of a cause over the whole recording, whatever the null says: in sealed walks without an effect what is no
    /// trifle reaches 37 (MuJoCo) and 50 (rapier).
    pub least_evidence: f64,
    /// The same of a robot that is held: nothing but its motors moves it, and without an effect 9 is the most.
    pub least_held_evidence: f64,
    /// The same for one that is confined to a region: there are many of those.
    pub least_local_evidence: f64,
    /// The same for an event: a contact that another engine resolves otherwise looks like a short blow.
    pub least_event_evidence: f64,
    /// The same for an event of a robot that is held, which has no contacts.
    pub least_held_event_evidence: f64,
    /// Shortest event \[s\] of a robot on its feet.
    pub least_event: f64,
    /// Shortest event \[s\] of a robot that is held.
    pub least_held_event: f64,
    /// Shortest event \[s\] of a robot on its feet whose evidence is not beyond doubt: a foot that is set down otherwise than in the
    /// simulator looks like a push for half a stride. One of 4 recordings of another engine without an effect had one of 0.153 s.
    pub least_push: f64,
    /// Over the largest log evidence that the effect reaches in simulated recordings without one.
    pub over_null: f64,
    /// Evidence, in units of what a cause needs, from which on something is there though no cause is found: the right one may not
    /// be in the library.
    pub suspicious: f64,
    /// A size below this many tolerances is no cause.
    pub least_size: f64,
    /// Log evidence from which on an event need not take a share of the excess: a robot that is pushed often, or stumbles, too.
    pub sure_event: f64,
    /// Least share of the excess over the null that a cause takes away,
    pub least_share: f64,
    /// or else of the held-out gap that it closes.
    pub least_closed: f64,
    /// Share of the range, of a limit twice this share of its value, within which a value lies at the edge.
    pub edge: f64,
    /// Relative change of a held-out window's loss from which on an event changes it.
    pub changed: f64,
    /// Windows that are changed from which on an event that makes them worse is none: one alone may hold more than the event.
    pub changed_windows: usize,
    /// Loss over that of the null up to which a robot has no gap that anyone should look for.
    pub no_gap: f64,
    /// Loss over that of the null that 98 % of robots without an effect stay below, of three engines' contacts and within tolerances, and
    pub faultless_level: f64,
    /// what the law of an actuator leaves of them, in units of the null. Both are quantiles of the open half of the study of motions
    /// (docs/experiments/2026-11-30-motions.md): up to these nothing that is accused of nothing is called a gap.
    pub faultless_law: f64,
    /// Loss over that of the null from which on the causes do not explain the recording. Another engine alone, with its contacts,
    /// makes 1.2 to 1.4 without an effect, and up to 1.8 beside a large one.
    pub unexplained: f64,
    /// The same where the quieter windows are below `unexplained_in_quiet`.
    pub unexplained_at_contacts: f64,
    /// See `unexplained_at_contacts`.
    pub unexplained_in_quiet: f64,
    /// Share of the excess that every cause but the first must take away, or else `least_later_closed` of the held-out gap that the earlier
    /// ones left: what engines differ in is no second cause. Tolerated deviations take most of a ground that lies lower upon them
    /// at little cost, so that the excess hardly shows it and the held-out gap does.
    pub least_later_share: f64,
    /// See `least_later_share`.
    pub least_later_closed: f64,
    /// Standard errors by which the held-out loss must fall for a steady cause.
    pub least_errors: f64,
    /// The same for one that is confined to a region.
    pub least_local_errors: f64,
    /// The same for the logarithm of the loss where its mean falls by less than `least_errors`.
    pub sure_errors: f64,
    /// Log evidence in windows that no fit has seen, tolerated deviations at their best in them, from which on a steady first cause need not
    /// lower what is left there without them.
    pub sure_held_out: f64,
    /// What the law of an actuator must leave beyond the null, for a further cause that takes little of the whole excess,
    pub least_actuator_excess: f64,
    /// and the share of it that this must take away.
    pub least_actuator_closed: f64,
    /// Candidates that are judged in a round, the best first.
    pub most_judged: usize,
    /// Held-out gap over the floor from which on one more cause is looked for.
    pub much_left: f64,
    /// Most causes that are accused.
    pub most_causes: usize,
    /// Most rounds, in each of which there may be several events.
    pub most_rounds: usize,

    /// What the law of an actuator may leave, over the null,
    pub actuator_left: f64,
    /// over what chance makes of it,
    pub actuator_over_chance: f64,
    /// and as a share of what there was.
    pub actuator_share: f64,
    /// The same of an actuator of which nothing that is accused takes away the share `touched`: what an impostor imitates it changes.
    /// Impacts alone, between two stamps, make twice of it.
    pub actuator_left_untouched: f64,
    /// See `actuator_left_untouched`.
    pub touched: f64,
    /// Log evidence of another effect of the accused joints from which on the accused one does not show all of them,
    pub evidence_left: f64,
    /// and as a share of that of the accused one: no large effect is simulated to the last digit.
    pub evidence_share: f64,
    /// The same where nothing of a joint is accused, of any steady effect: what pulls on the trunk imitates all that does.
    pub trunk_evidence_left: f64,
    /// See `trunk_evidence_left`.
    pub trunk_evidence_share: f64,
    /// Standard errors by which the accused value of joints changes with speed, load or time,
    pub change_errors: f64,
    /// and as a share of it, from which on it is not one value. Of 35 right ones one changes by more than a twentieth, by 2.2 errors;
    /// a friction that fades with speed by 2.4 to 8, one that grows with load by 5 to 13.
    pub change_share: f64,
    /// The same over time: actuators warm up. A right one was seen to change by 5 % in 20 s, by 5 errors.
    pub drift_share: f64,
    /// The same of what acts for a while, in which feet meet the ground otherwise.
    pub fading_share: f64,
    /// Share of the excess of the level that events must take away where what is left is a gap still.
    pub events_share: f64,
    /// By how much the level may rise.
    pub rise: f64,
    /// How much the logarithms of two factors differ that are taken for equal or for inverse, as a share of the larger one.
    pub alike: f64,
    /// How far from the vertical a weight may seem to pull (cosine of 30 degrees).
    pub vertical: f64,
    /// Time for which several pushes may last together \[s\].
    pub longest_pushes: f64,
    /// What engines differ in leaves at least so many times the floor of noise: no cause closes that.
    pub engines_leave: f64,
    /// Share of the held-out gap beyond that which causes must close that act all the time and everywhere.
    pub least_gap_closed: f64,
    /// Standard errors by which the held-out loss falls if they need not, where what is left is no gap: tolerated deviations may
    /// make most of a gap in which a bias of the gyroscope makes a small part of every window.
    pub sure_fall: f64,
    /// Share of the excess of the level that they leave at most if they need not.
    pub most_left: f64,
    /// Mean square that is left in windows that no fit has seen, in units of the floor, from which on a cause must have closed
    /// `large_gap_closed` of what there was. Right ones that closed less left up to 6 (a restitution in another engine's bounces once 8),
    /// impostors 7 to 12.
    pub large_gap: f64,
    /// See `large_gap`.
    pub large_gap_closed: f64,

    /// What is left of the excess up to which causes are reported though something is left: what engines differ in grows with the effect.
    pub nearly_all: f64,
    /// Level up to which they are.
    pub unexplained_beside: f64,
    /// Share of the held-out gap from which on causes are reported up to that level, too: robots that stumble leave as much without an
    /// effect. Of a robot that is held they are reported up to `quiet_enough` then, and a value at the edge of its range is a cause all the same.
    pub mostly_closed: f64,
    /// Level up to which a push that takes `least_closed` of the excess is reported for an arm that nothing else explains, and a cause that closes
    /// `mostly_closed`,
    pub quiet_enough: f64,
    /// or share of the excess that pushes take at least: most of what is wrong is theirs then. Pushes of an arm without a gap need it, too.
    pub pushes_take: f64,
    /// Share of the held-out gap from which on it counts as explained.
    pub mostly: f64,
    /// Nats in which evidence counts one step in the ranking: an odds ratio beyond any doubt about the model itself means nothing.
    pub nats: f64,

    /// Width of the step from explained to unknown, as a level.
    pub unexplained_width: f64,
    /// The same from no gap to a gap that is too small to be seen.
    pub no_gap_width: f64,
    /// Largest probability of `unknown` without a gap: what is there may be too small to be seen,
    pub unknown_in_no_gap: f64,
    /// and that of all effects of the library together.
    pub known_in_no_gap: f64,
    /// Probability of `unknown` where what is accused is doubted,
    pub unknown_doubted: f64,
    /// least where nothing is accused: what is nearest was not good enough,
    pub unknown_unexplained: f64,
    /// and most where something is accused beside what is unknown.
    pub unknown_beside: f64,
    /// Least share of what is known that each accused effect has: one of a later round has no rival left in the first.
    pub accused_share: f64,
    /// Largest share of one that is asked for beside what is accused.
    pub beside_share: f64,
    /// Share of the evidence of what is accused from which on another effect does nearly as well.
    pub nearly_as_good: f64,
    /// Gap over floor from which on the model is to be checked first: of 157 recordings of one or two effects the largest had 143.
    pub huge_gap: f64,
    /// The same where no effect explains it: a model with all masses times 3 makes 60 to 90, with half as much again 30.
    pub large_unexplained: f64,

    /// What decides of robots with a fixed base whose torques were recorded beside references.
    pub held: qv_held::Policy,

    /// Log evidence over that of no effect from which an effect of the camera is accused,
    pub camera_evidence: f64,
    /// its size in tolerances,
    pub camera_size: f64,
    /// the share of the squares above the floor that it must take away in photographs that its fit has not seen,
    pub camera_closed: f64,
    /// and the standard errors by which the disagreement must fall there.
    pub camera_errors: f64,
    /// An effect whose evidence comes this near to the accused one's looks like it.
    pub camera_alike: f64,
    /// Level below which nothing is left that noise and tolerances do not explain: 1 is expected of a true model, and outliers, which
    /// count as their weight says, bring no more than 1.8.
    pub camera_explained: f64,
    /// Share of a photograph's contrast that the scene must account for at its best in half of the photographs, or it shows another place.
    pub camera_accounted: f64,
    /// Most effects of the camera that are accused.
    pub camera_most: usize,
    /// How much likelier no effect is than the likeliest one, where none is accused.
    pub camera_none: f64,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            least_evidence: 50.0,
            least_held_evidence: 12.0,
            least_local_evidence: 60.0,
            least_event_evidence: 200.0,
            least_held_event_evidence: 20.0,
            least_event: 0.15,
            least_held_event: 0.05,
            least_push: 0.25,
            over_null: 1.3,
            suspicious: 3.0,
            least_size: 3.5,
            sure_event: 1000.0,
            least_share: 0.1,
            least_closed: 0.25,
            edge: 0.01,
            changed: 0.02,
            changed_windows: 2,
            no_gap: 1.45,
            faultless_level: 1.8,
            faultless_law: 6.9,
            unexplained: 1.8,
            unexplained_at_contacts: 2.5,
            unexplained_in_quiet: 1.5,
            least_later_share: 0.3,
            least_later_closed: 0.4,
            least_errors: 2.0,
            least_local_errors: 0.5,
            sure_errors: 3.0,
            sure_held_out: 5.0,
            least_actuator_excess: 0.5,
            least_actuator_closed: 0.5,
            most_judged: 4,
            much_left: 2.0,
            most_causes: 3,
            most_rounds: 4,
            actuator_left: 2.0,
            actuator_over_chance: 1.3,
            actuator_share: 0.1,
            actuator_left_untouched: 3.0,
            touched: 0.2,
            evidence_left: 80.0,
            evidence_share: 0.01,
            trunk_evidence_left: 100.0,
            trunk_evidence_share: 0.1,
            change_errors: 3.0,
            change_share: 0.05,
            drift_share: 0.08,
            fading_share: 0.15,
            events_share: 0.25,
            rise: 0.05,
            alike: 1.0 / 3.0,
            vertical: 0.866,
            longest_pushes: 3.0,
            engines_leave: 1.5,
            least_gap_closed: 0.35,
            sure_fall: 4.0,
            most_left: 0.5,
            large_gap: 7.0,
            large_gap_closed: 0.5,
            nearly_all: 0.12,
            unexplained_beside: 2.0,
            mostly_closed: 0.8,
            quiet_enough: 4.0,
            pushes_take: 0.5,
            mostly: 0.5,
            nats: 10.0,
            unexplained_width: 0.1,
            no_gap_width: 0.15,
            unknown_in_no_gap: 0.5,
            known_in_no_gap: 0.05,
            unknown_doubted: 0.8,
            unknown_unexplained: 0.5,
            unknown_beside: 0.4,
            accused_share: 0.9,
            beside_share: 0.5,
            nearly_as_good: 0.95,
            huge_gap: 200.0,
            large_unexplained: 25.0,
            held: qv_held::Policy::default(),
            camera_evidence: 5.0,
            camera_size: 3.5,
            camera_closed: 0.1,
            camera_errors: 2.0,
            camera_alike: 10.0,
            camera_explained: 1.4,
            camera_accounted: 0.3,
            camera_most: 3,
            camera_none: 4.0,
        }
    }
}

impl Policy {
    /// Whether what is left is what engines differ in: everywhere, or but for the windows in which feet met the ground otherwise.
    pub(crate) fn is_explained(&self, level: &Level) -> bool {
        let but_for_contacts = level.ratio < self.unexplained_at_contacts && level.quiet < self.unexplained_in_quiet;
        level.ratio < self.unexplained || but_for_contacts
    }

    /// Whether a size \[tolerances\] is no more than any robot may deviate by; what has none is no trifle.
    pub(crate) fn is_trifle(&self, size: f64) -> bool {
        size < self.least_size
    }

    /// Whether a correction takes away most of what the law of its actuators leaves, `before` and after. No contact has a part in that, so
    /// that what engines differ in is no excuse.
    pub(crate) fn closes_actuator_residual(&self, [before, after]: [f64; 2]) -> bool {
        before > 1.0 + self.least_actuator_excess && after - 1.0 < (1.0 - self.least_actuator_closed) * (before - 1.0)
    }
}
