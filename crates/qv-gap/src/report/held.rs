//! The report of a robot with a fixed base that is decided by its torque balance, or by the positions of its servos.

use super::{Gap, Remainder, Report, SetMember, TorqueBalance, Verdict};
use crate::decision::Policy;
use crate::decision::evidence::{Evidence, ReportData};
use crate::findings::{CanTell, Cause, Correction, Lead, ParameterEstimate, RankedEffect, Share, UNKNOWN, Where};
use qv_held::{Decision, Event, HypothesisTest, Outcome, decide};
use std::fmt::Write;

/// Leads at most.
const LEADS: usize = 3;
/// Events that a sentence names at most.
const NAMED: usize = 3;

/// Decides, and renders what comes of it.
pub(super) fn report(evidence: &Evidence, held: &qv_held::Evidence, data: &ReportData, policy: &Policy) -> Report {
    let decision = decide(held, &policy.held);
    let page = Page { evidence, held, decision: &decision, alpha: policy.held.alpha };
    let causes = page.causes();
    let gap = page.gap(data);
    let verdict = page.verdict();
    let leads = if verdict == Verdict::Unexplained { page.leads() } else { Vec::new() };
    let is_none = verdict == Verdict::NoGap;
    Report {
        format: super::FORMAT.into(),
        verdict,
        sentence: page.sentence(&causes, &leads, &gap),
        place: Where { interfaces: page.interfaces(data, &causes), ..data.place.clone() },
        ranking: page.ranking(&causes, &leads),
        leads,
        together: None,
        rounds: Vec::new(),
        visual: None,
        torque_balance: Some(page.balance(data)),
        unexplained: Remainder { share: if is_none { 0.0 } else { 1.0 - gap.closed }, depends_on: Vec::new() },
        cannot_tell: data.cannot_tell.clone(),
        next: page.next(&causes, &gap),
        corrections: page.corrections(),
        corrections_apply: gap.after <= gap.before,
        cannot_show: data.cannot_show.clone(),
        can_tell: page.can_tell(),
        heat_map: data.stated.heat_map.clone(),
        floor_plan: Vec::new(),
        curves: Vec::new(),
        traces: data.traces.clone(),
        stages: data.stages.clone(),
        timing: data.timing.clone(),
        policy: policy.clone(),
        provenance: data.provenance.clone(),
        causes,
        gap,
    }
}

struct Page<'a> {
    evidence: &'a Evidence,
    held: &'a qv_held::Evidence,
    decision: &'a Decision,
    alpha: f64,
}

impl Page<'_> {
    fn verdict(&self) -> Verdict {
        match self.decision.outcome {
            Outcome::None => Verdict::NoGap,
            Outcome::Cause(_, true) | Outcome::Pair(_, true) | Outcome::Events(true) => Verdict::Explained,
            Outcome::Cause(_, false) | Outcome::Pair(_, false) | Outcome::Events(false) => Verdict::PartlyExplained,
            Outcome::Unexplained => Verdict::Unexplained,
        }
    }

    /// Losses before and after; blocks are predicted from others.
    fn gap(&self, data: &ReportData) -> Gap {
        let gap = data.stated.gap.clone();
        let beside = |losses: &[f64]| self.held.none.iter().zip(losses).map(|(a, b)| [*a, *b]).collect();
        let blocks: Vec<[f64; 2]> = match self.decision.outcome {
            Outcome::Cause(k, _) => beside(&self.held.tested[k].losses),
            Outcome::Pair(k, _) => beside(&self.held.pairs[k].test.losses),
            Outcome::Events(_) => {
                let is_quiet = |b: usize| {
                    let [from, until] = self.held.blocks[b];
                    self.decision.events.iter().all(|e| e.time[1] < from || e.time[0] > until)
                };
                let floor = gap.floor;
                self.held
                    .none
                    .iter()
                    .enumerate()
                    .map(|(b, x)| [*x, if is_quiet(b) { *x } else { floor.min(*x) }])
                    .collect()
            }
            _ => return gap,
        };
        let count = blocks.len().max(1) as f64;
        let mean = |k: usize| blocks.iter().map(|b| b[k]).sum::<f64>() / count;
        let (before, after) = (mean(0), mean(1));
        let excess = (before - gap.floor).max(1e-12);
        let share = |x: f64| (x / excess).clamp(-1.0, 1.0);
        let falls: Vec<f64> = blocks.iter().map(|b| b[0] - b[1]).collect();
        let variance = falls.iter().map(|f| (f - (before - after)).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        let half = 1.96 * (variance / count).sqrt();
        let closed_ci95 = [share(before - after - half), share(before - after + half)];
        Gap { before, after, closed: share(before - after), closed_ci95, ..gap }
    }

    fn causes(&self) -> Vec<Cause> {
        match self.decision.outcome {
            Outcome::Cause(k, _) => vec![self.cause(k)],
            Outcome::Pair(k, _) => self.members(k),
            Outcome::Events(_) => self.decision.events.iter().map(|e| self.push(e)).collect(),
            _ => Vec::new(),
        }
    }

    fn cause(&self, k: usize) -> Cause {
        let tested = &self.held.tested[k];
        let effect = &tested.hypothesis.effect;
        let mut alike: Vec<String> = Vec::new();
        for other in self.set().map(|i| &self.held.tested[i].hypothesis.effect).filter(|e| *e != effect) {
            if !alike.contains(other) {
                alike.push(other.clone());
            }
        }
        Cause {
            effect: effect.clone(),
            score: 1.0 - self.alpha,
            scope: tested.hypothesis.scope.clone(),
            parameters: self.parameters(k),
            closed_alone: self.decision.judged[k].share.clamp(-1.0, 1.0),
            confusable_with: alike,
            separating_experiment: self.experiment(effect),
            by_recording: Vec::new(),
        }
    }

    /// The causes of a pair, each with its own numbers.
    fn members(&self, k: usize) -> Vec<Cause> {
        let (pair, judged) = (&self.held.pairs[k], &self.decision.pairs[k]);
        let mut from = 0;
        let mut all = Vec::new();
        for (&member, p) in pair.members.iter().zip(judged.p_members) {
            let hypothesis = &self.held.tested[member].hypothesis;
            let axes = from..from + hypothesis.axes.len();
            from = axes.end;
            all.push(Cause {
                effect: hypothesis.effect.clone(),
                score: 1.0 - self.alpha.max(p),
                scope: hypothesis.scope.clone(),
                parameters: parameters(&pair.test, &judged.tests, axes),
                closed_alone: self.decision.judged[member].share.clamp(-1.0, 1.0),
                confusable_with: Vec::new(),
                separating_experiment: self.experiment(&hypothesis.effect),
                by_recording: Vec::new(),
            });
        }
        all
    }

    fn push(&self, event: &Event) -> Cause {
        let exact = |name: &str, unit: &str, value: f64| ParameterEstimate {
            name: name.into(),
            value,
            ci95: [f64::NAN; 2],
            unit: unit.into(),
        };
        Cause {
            effect: "external_torque".into(),
            score: (1.0 - event.p).max(0.0),
            scope: vec![event.joint.clone()],
            parameters: vec![
                exact("external_torque", "N m", event.torque),
                exact("start", "s", event.time[0]),
                exact("end", "s", event.time[1]),
            ],
            closed_alone: f64::NAN,
            confusable_with: Vec::new(),
            separating_experiment: self.experiment("external_torque"),
            by_recording: Vec::new(),
        }
    }

    fn experiment(&self, effect: &str) -> String {
        self.evidence.effect(effect).map_or(String::new(), |e| e.experiment.clone())
    }

    /// One number for each axis; of joints with a number each, the joints' names are distinguished by the corrections.
    fn parameters(&self, k: usize) -> Vec<ParameterEstimate> {
        let tested = &self.held.tested[k];
        parameters(tested, &self.decision.judged[k], 0..tested.size.len())
    }

    /// Hypotheses that are as good as the best and beyond the wander of references.
    fn set(&self) -> impl Iterator<Item = usize> + '_ {
        let is_in = |k: &usize| self.decision.judged[*k].in_set && self.decision.judged[*k].p_size < self.alpha;
        self.decision.order.iter().copied().filter(is_in)
    }

    fn balance(&self, data: &ReportData) -> TorqueBalance {
        let member = |k: usize| SetMember {
            effect: self.held.tested[k].hypothesis.effect.clone(),
            scope: self.held.tested[k].hypothesis.scope.clone(),
            parameters: self.parameters(k),
            tests: self.decision.judged[k].clone(),
        };
        TorqueBalance {
            references: self.held.references,
            p_gap: Some(self.decision.p_gap),
            set: self.set().map(member).collect(),
            events: self.decision.events.clone(),
            joints: data.joint_rows.clone(),
            traces: data.torque_traces.clone(),
        }
    }

    /// What comes nearest, each effect once.
    fn leads(&self) -> Vec<Lead> {
        let mut all: Vec<Lead> = Vec::new();
        for &k in &self.decision.order {
            let (tested, judged) = (&self.held.tested[k], &self.decision.judged[k]);
            let effect = &tested.hypothesis.effect;
            let is_new = all.iter().all(|lead| lead.effects[0] != *effect);
            if is_new && judged.p_size < self.alpha && judged.is_physical && all.len() < LEADS {
                all.push(Lead {
                    effects: vec![effect.clone()],
                    scope: tested.hypothesis.scope.clone(),
                    parameters: self.parameters(k),
                    closed: judged.share.clamp(-1.0, 1.0),
                    closed_ci95: [f64::NAN; 2],
                    joint_rms: [f64::NAN; 2],
                    separating_experiment: self.experiment(effect),
                    by_recording: Vec::new(),
                });
            }
        }
        all
    }

    /// What is accused at the level of the test; where nothing is, leads share one half evenly with what is unknown.
    fn ranking(&self, causes: &[Cause], leads: &[Lead]) -> Vec<RankedEffect> {
        let mut all: Vec<RankedEffect> = Vec::new();
        for cause in causes {
            if all.iter().all(|r| r.effect != cause.effect) {
                all.push(RankedEffect { effect: cause.effect.clone(), score: 1.0 - self.alpha });
            }
        }
        let each = 0.5 / leads.len().max(1) as f64;
        all.extend(leads.iter().map(|l| RankedEffect { effect: l.effects[0].clone(), score: each }));
        let unknown = match self.decision.outcome {
            Outcome::Unexplained if leads.is_empty() => 1.0 - self.alpha,
            Outcome::Unexplained => 0.5,
            _ => self.alpha,
        };
        all.push(RankedEffect { effect: UNKNOWN.into(), score: unknown });
        all.sort_by(|a, b| b.score.total_cmp(&a.score));
        all
    }

    fn interfaces(&self, data: &ReportData, causes: &[Cause]) -> Vec<Share> {
        let of = |share: &Share| {
            let is_of = |c: &&Cause| self.evidence.effect(&c.effect).is_some_and(|e| e.interface == share.name);
            Share { share: causes.iter().filter(is_of).count() as f64 / causes.len().max(1) as f64, ..share.clone() }
        };
        let visual = Share { name: "visual".into(), share: 0.0 };
        data.interfaces.iter().map(of).chain([visual]).collect()
    }

    fn corrections(&self) -> Vec<Correction> {
        let tested = match self.decision.outcome {
            Outcome::Cause(k, _) => &self.held.tested[k],
            Outcome::Pair(k, _) => &self.held.pairs[k].test,
            _ => return Vec::new(),
        };
        let mut all = Vec::new();
        for (axis, size) in tested.hypothesis.axes.iter().zip(&tested.size) {
            for (parameter, nominal) in axis.parameters.iter().zip(&axis.nominal) {
                let value = axis.at_one.unwrap_or(nominal + size);
                all.push(Correction {
                    parameter: parameter.clone(),
                    value,
                    nominal: *nominal,
                    unit: axis.unit.clone(),
                });
            }
        }
        all.sort_by(|a: &Correction, b| a.parameter.cmp(&b.parameter));
        all
    }

    fn channel(&self) -> &'static str {
        if self.held.is_of_positions { "position" } else { "torque" }
    }

    fn null(&self) -> &'static str {
        if self.held.is_fleet { "simulated robots within the tolerances" } else { "the references" }
    }

    /// Least sizes of hypotheses of one number, by test 1.
    fn can_tell(&self) -> Vec<CanTell> {
        let of_one = |(tested, judged): (&HypothesisTest, &qv_held::Judgement)| {
            let ([axis], [least]) = (&tested.hypothesis.axes[..], &judged.least[..]) else { return None };
            let is_bounded = axis.range.iter().all(|x| x.abs() < f64::MAX);
            Some(CanTell {
                effect: tested.hypothesis.effect.clone(),
                scope: tested.hypothesis.scope.clone(),
                parameter: axis.name.clone(),
                unit: axis.unit.clone(),
                least_size: Some(*least).filter(|x| x.is_finite() && axis.at_one.is_none()),
                tolerance: f64::NAN,
                range: if is_bounded { axis.range } else { [f64::NAN; 2] },
                confusable_with: Vec::new(),
            })
        };
        self.held.tested.iter().zip(&self.decision.judged).filter_map(of_one).collect()
    }

    fn sentence(&self, causes: &[Cause], leads: &[Lead], gap: &Gap) -> String {
        let ratio = gap.before / gap.floor.max(1e-12);
        let p = self.decision.p_gap;
        let residual =
            format!("the {} residual is {ratio:.1} times that of {} (p = {})", self.channel(), self.null(), score(p));
        match &self.decision.outcome {
            Outcome::None => format!("No gap: {residual}."),
            Outcome::Pair(..) => {
                let all: Vec<String> = causes.iter().map(named).collect();
                format!("Causes: {}. {}", all.join("; "), self.removed("them", gap))
            }
            Outcome::Cause(..) => {
                let mut text =
                    format!("Cause: {}. {}", causes.first().map_or(String::new(), named), self.removed("it", gap));
                let alike = causes.first().map_or(&[][..], |cause| &cause.confusable_with[..]);
                if !alike.is_empty() {
                    let _ = write!(
                        text,
                        " This recording cannot distinguish it from {}.",
                        alike.join(", ").replace('_', " ")
                    );
                }
                text
            }
            Outcome::Events(_) => {
                let one = |c: &Cause| {
                    format!(
                        "{} {:.2} to {:.2} s, {:.3} N m",
                        c.scope[0], c.parameters[1].value, c.parameters[2].value, c.parameters[0].value
                    )
                };
                let listed: Vec<String> = causes.iter().take(NAMED).map(one).collect();
                let more = causes.len().saturating_sub(NAMED);
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                format!("Cause: external torque ({}{more}).", listed.join("; "))
            }
            Outcome::Unexplained => {
                let nearest: Vec<String> = leads
                    .iter()
                    .map(|l| format!("{} of {}", l.effects[0].replace('_', " "), l.scope.join(", ")))
                    .collect();
                let nearest = if nearest.is_empty() {
                    "none comes near".into()
                } else {
                    format!("nearest: {}", nearest.join("; "))
                };
                format!("Unexplained: {residual}, and no hypothesis passes all tests ({nearest}).")
            }
        }
    }

    fn removed(&self, what: &str, gap: &Gap) -> String {
        let (share, channel) = (100.0 * gap.closed, self.channel());
        format!(
            "Correcting {what} removes {share:.0} % of the excess {channel} error in blocks that its fit has not seen."
        )
    }

    /// What to do, the first of all with its command.
    fn next(&self, causes: &[Cause], gap: &Gap) -> Vec<String> {
        let mut all = vec![self.first_step(gap)];
        for cause in causes.iter().filter(|c| !c.confusable_with.is_empty() && !c.separating_experiment.is_empty()) {
            all.push(format!(
                "To separate {} from {}: {}.",
                cause.effect,
                cause.confusable_with.join(", "),
                cause.separating_experiment
            ));
        }
        all
    }

    fn first_step(&self, gap: &Gap) -> String {
        match self.decision.outcome {
            Outcome::None => {
                "Nothing to correct. Faster and larger motions test more: `qv inspect RUN --detectable` lists the least sizes.".into()
            }
            Outcome::Events(_) => {
                "Keep the robot free of outside forces, record again and compare: `qv diagnose NEW_RUN --reference RUN --out out/again`.".into()
            }
            Outcome::Unexplained if self.held.is_fleet => {
                "Record references of the robot as it should be, on several days: `qv diagnose RUN --reference OLD_1 OLD_2 OLD_3 --out out/why`.".into()
            }
            Outcome::Unexplained => {
                "Record two more references of the robot as it should be, on other days, since tests become sharper with each: \
                 `qv diagnose RUN --reference OLD_1 OLD_2 ... --out again`."
                    .into()
            }
            _ if gap.after > gap.before => {
                "Do not use the correction: it raises the held-out error. Record again with faster motions, and repeat `qv diagnose`.".into()
            }
            _ => "Check the correction on another recording: `qv replay NEW_RUN --params calibrated.toml --out replay`.".into(),
        }
    }
}

fn interval([from, until]: [f64; 2]) -> String {
    if from.is_nan() { String::new() } else { format!(" (95 % interval {from:.4} to {until:.4})") }
}

fn score(p: f64) -> String {
    if p < 0.001 { "below 0.001".into() } else { format!("{p:.3}") }
}

/// Some numbers of a hypothesis.
fn parameters(
    tested: &HypothesisTest,
    judged: &qv_held::Judgement,
    axes: std::ops::Range<usize>,
) -> Vec<ParameterEstimate> {
    let one = |i: usize| {
        let axis = &tested.hypothesis.axes[i];
        ParameterEstimate {
            name: axis.name.clone(),
            value: axis.at_one.unwrap_or(axis.at_zero + tested.size[i]),
            ci95: if axis.at_one.is_some() { [f64::NAN; 2] } else { judged.ci95[i].map(|x| axis.at_zero + x) },
            unit: axis.unit.clone(),
        }
    };
    axes.map(one).collect()
}

/// Effect, place and size.
fn named(cause: &Cause) -> String {
    let one = |(p, (name, part)): (&ParameterEstimate, (&str, Option<&str>))| {
        let of = part.map_or(String::new(), |part| format!(" of {part}"));
        format!("{}{of} {:.4} {}{}", name.replace('_', " "), p.value, p.unit, interval(p.ci95))
    };
    let sizes: Vec<String> = cause.parameters.iter().zip(cause.parameter_labels()).map(one).collect();
    format!("{} of {}: {}", cause.effect.replace('_', " "), cause.scope.join(", "), sizes.join(", "))
}
