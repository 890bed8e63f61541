//! What the findings amount to, and the last doubt: what is closed in windows that no fit has seen.

use super::{Findings, setting};
use crate::GapError;
use crate::closure::{closure, mean};
use crate::decide::{self, NO_GAP};
use crate::doubt;
use crate::report::Verdict;
use crate::study::Study;

/// What is left of the excess, and the level, up to which causes are told though something is left: what engines differ in grows
/// with the effect.
const NEARLY_ALL: f64 = 0.12;
const UNEXPLAINED_BESIDE: f64 = 2.0;
/// Share of the held-out gap from which on causes are told up to that level, too: robots that stumble leave as much without an
/// effect.
const MOSTLY_CLOSED: f64 = 0.8;
/// Level up to which a push is told of an arm that nothing else explains.
const QUIET_ENOUGH: f64 = 4.0;

/// Share of the held-out gap from which on it counts as explained.
pub(super) const MOSTLY: f64 = 0.5;

impl Findings<'_> {
    /// The verdict, and no gap where windows that no fit has seen show no more than the null, and all windows together hardly more: a gap is
    /// what exceeds the null, and there is none, whatever fits a part of the noise better.
    pub(super) fn verdict_beyond_null(&self, seed: u64, nominal: &mut Study) -> Result<Verdict, GapError> {
        let verdict = self.verdict();
        let closed =
            |study: &mut Study| Ok::<_, GapError>(closure(study, &setting(study, &self.corrections))?.closed());
        if verdict == Verdict::NoGap || (verdict == Verdict::Explained && closed(nominal)? >= MOSTLY) {
            return Ok(verdict);
        }
        let gap = closure(nominal, &setting(nominal, &[]))?.gap(nominal, seed);
        let is_within_null = gap.before <= gap.floor && self.opening.level.ratio < NO_GAP;
        Ok(if is_within_null { Verdict::NoGap } else { verdict })
    }

    /// Doubts causes that act all the time and everywhere and close too little in windows that no fit has seen.
    pub(super) fn doubt_closure(&mut self, nominal: &mut Study) -> Result<(), GapError> {
        let is_local = self.accused.iter().any(|a| a.fit.suspect.extent.is_some());
        if self.doubt.is_some() || self.accused.is_empty() || is_local || !self.on_feet {
            return Ok(());
        }
        let setting = setting(nominal, &self.corrections);
        let closure = closure(nominal, &setting)?;
        // No contact has a part in the law of an actuator, where what is accused takes most of that.
        let by_law = decide::closes_law(closure.law(nominal, &setting));
        self.doubt = doubt::leaves_too_much(&closure, by_law);
        // Windows that are held out are few, and feet that bounce fall otherwise in each.
        let [before, after] = [self.opening.level.ratio, self.level_after.ratio];
        let is_settled = self.level_after.is_explained() && after - 1.0 < doubt::MOST_LEFT * (before - 1.0);
        if self.doubt.is_some() || is_settled {
            return Ok(());
        }
        let (fall, error) = closure.fall(false);
        // Tolerated deviations may make most of a gap in which a bias of the gyroscope makes a small part of every window.
        let is_quiet = self.level_after.ratio < NO_GAP;
        let falls = fall > doubt::SURE_FALL * error;
        let is_sure = is_quiet && (falls || decide::held_out_evidence(nominal, &setting)? > decide::SURE_HELD_OUT);
        let [before, after] = [&closure.before, &closure.after].map(|losses| mean(losses));
        let closable = before - doubt::ENGINES_LEAVE * closure.floor;
        self.closed = closure.closed();
        if before - after < doubt::LEAST_CLOSED * closable && !by_law && !is_sure {
            let share = 100.0 * self.closed;
            self.doubt = Some(format!("it closes {share:.0} % of the gap in windows that no fit has seen"));
        }
        Ok(())
    }

    fn verdict(&self) -> Verdict {
        let explained = self.level_after.is_explained();
        if self.doubt.is_some() {
            return Verdict::Unexplained;
        }
        let laws_agree = !self.on_feet || doubt::law_left(&self.opening.laws, &[]).is_none();
        let suspicious = self.on_feet && self.rounds.first().is_some_and(|r| r.is_suspicious);
        match (self.accused.is_empty(), explained) {
            (true, _) if self.opening.level.ratio < NO_GAP && laws_agree && !suspicious => Verdict::NoGap,
            (true, _) => Verdict::Unexplained,
            (false, true) => Verdict::Explained,
            (false, false) => self.partly(),
        }
    }

    /// Several effects can be there and one unknown: what was found stays only if it took nearly all of the excess. What
    /// pushed an arm at one time is told whatever the arm lacks at all others.
    fn partly(&self) -> Verdict {
        if !self.on_feet && self.accused.iter().all(|a| a.time().is_some()) {
            let quiet = self.level_after.ratio < QUIET_ENOUGH;
            return if quiet { Verdict::PartlyExplained } else { Verdict::Unexplained };
        }
        let (before, after) = (self.opening.level.ratio - 1.0, self.level_after.ratio - 1.0);
        let nearly_all = after < NEARLY_ALL * before && self.level_after.ratio < UNEXPLAINED_BESIDE;
        if nearly_all || (self.closed > MOSTLY_CLOSED && self.level_after.ratio < UNEXPLAINED_BESIDE) {
            Verdict::PartlyExplained
        } else {
            Verdict::Unexplained
        }
    }
}
