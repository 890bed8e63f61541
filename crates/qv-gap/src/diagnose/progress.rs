//! How far a diagnosis is: the stages that are done, and those to come as far as they are known.

/// Names of the stages; weights below are of them.
pub(super) const REFERENCE: &str = "reference";
pub(super) const STUDY: &str = "sensitivities and null";
pub(super) const SEARCH: &str = "search";
pub(super) const SIZES: &str = "sizes";
pub(super) const CLOSURE: &str = "closure";

/// What a stage costs, in units of the simulations that each study begins with: measured on walks of 20 s.
fn weight(name: &str) -> f64 {
    match name {
        SEARCH => 0.6,
        SIZES => 0.1,
        CLOSURE => 0.05,
        _ => 1.0,
    }
}

/// Where a diagnosis is when a stage begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress<'a> {
    /// Number of the stage, from 1.
    pub stage: usize,
    /// Stages that are known of: each round that finds a cause adds some.
    pub stages: usize,
    /// What the stage does.
    pub name: &'a str,
    /// Share of the whole work that is done, as far as stages are known, 0 to 1.
    pub done: f64,
}

/// The stages of a diagnosis.
pub(super) struct Plan {
    /// Weights of those that have begun.
    begun: Vec<f64>,
    /// Weights of those to come.
    to_come: f64,
    /// How many are to come.
    count: usize,
}

impl Plan {
    /// What is known before anything is found.
    pub fn new(has_reference: bool, leave_out: usize) -> Self {
        let mut plan = Self { begun: Vec::new(), to_come: 0.0, count: 0 };
        if has_reference {
            plan.add(&[REFERENCE]);
        }
        plan.add(&[STUDY, SEARCH, CLOSURE]);
        (0..leave_out).for_each(|_| plan.add(&[SEARCH, CLOSURE]));
        plan
    }

    /// More to do.
    pub fn add(&mut self, stages: &[&str]) {
        self.count += stages.len();
        self.to_come += stages.iter().map(|name| weight(name)).sum::<f64>();
    }

    /// A stage begins; one that was not planned counts from now on.
    pub fn begin<'n>(&mut self, name: &'n str) -> Progress<'n> {
        // A sum of nothing would be -0.
        let behind = self.begun.iter().fold(0.0, |sum, weight| sum + weight);
        let to_come = if self.count == 0 { weight(name) } else { self.to_come.max(weight(name)) };
        self.begun.push(weight(name));
        self.count = self.count.saturating_sub(1);
        self.to_come = (to_come - weight(name)).max(0.0);
        let stage = self.begun.len();
        Progress { stage, stages: stage + self.count, name, done: behind / (behind + to_come) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_counted_and_a_found_cause_adds_some() {
        let mut plan = Plan::new(true, 0);
        let first = plan.begin(REFERENCE);
        assert_eq!((first.stage, first.stages, first.done), (1, 4, 0.0));
        assert!(first.done.is_sign_positive());
        plan.begin(STUDY);
        let search = plan.begin(SEARCH);
        assert_eq!((search.stage, search.stages), (3, 4));
        assert!((search.done - 2.0 / 2.65).abs() < 1e-9, "{}", search.done);
        plan.add(&[STUDY, SIZES]);
        let more = plan.begin(STUDY);
        assert_eq!((more.stage, more.stages), (4, 6));
        plan.begin(SIZES);
        let last = plan.begin(CLOSURE);
        assert_eq!((last.stage, last.stages), (6, 6));
        assert!(last.done > 0.9 && last.done < 1.0);
        let unplanned = plan.begin(CLOSURE);
        assert!(unplanned.done < 1.0 && unplanned.stages == 7);
    }
}
