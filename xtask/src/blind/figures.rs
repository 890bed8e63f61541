//! All scores together: the figures that a diagnosis is judged by.

use super::answers::Case;
use super::report::UNKNOWN;
use super::score::DiagnosisScore;
use serde::Serialize;
use std::collections::BTreeMap;

/// What a figure should be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Goal {
    AtLeast(f64),
    AtMost(f64),
    Between(f64, f64),
}

impl Goal {
    /// Whether a value meets it.
    pub fn met(self, value: f64) -> bool {
        match self {
            Self::AtLeast(least) => value >= least,
            Self::AtMost(most) => value <= most,
            Self::Between(least, most) => (least..=most).contains(&value),
        }
    }
}

/// One figure.
#[derive(Debug, Clone, Serialize)]
pub struct Figure {
    /// Name for programs.
    pub name: &'static str,
    /// What it says.
    pub what: &'static str,
    /// Its value; none where nothing was there to count.
    pub value: Option<f64>,
    /// 95 % interval of a share (Wilson).
    pub interval: Option<[f64; 2]>,
    /// How many it is of.
    pub count: usize,
    pub goal: Option<Goal>,
}

/// Rows of one effect.
#[derive(Debug, Clone, Default, Serialize)]
pub struct EffectRow {
    pub count: usize,
    /// Share named first, and share among the three likeliest.
    pub named: f64,
    pub among_three: f64,
    /// Medians over what is rightly named.
    pub error: Option<f64>,
    pub closed: Option<f64>,
}

/// How one baseline does.
#[derive(Debug, Clone, Serialize)]
pub struct BaselineRow {
    pub name: String,
    /// Share of single effects named, of how many; a baseline that never names one has none.
    pub named: Option<f64>,
    pub count: usize,
    /// Median share of the gap closed.
    pub closed: Option<f64>,
    /// Share of recordings without effect, and with a withheld one, in which it names one.
    pub none_accused: Option<f64>,
    pub withheld_accused: Option<f64>,
}

/// The whole result.
#[derive(Debug, Clone, Serialize)]
pub struct Figures {
    pub figures: Vec<Figure>,
    pub effects: BTreeMap<String, EffectRow>,
    /// What is there, and what was said, with counts. Two effects at once are left out.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
    pub baselines: Vec<BaselineRow>,
    /// The same figures of the recordings of each origin; nothing where all are of one.
    pub by_origin: BTreeMap<String, Vec<Figure>>,
    pub recordings: Vec<DiagnosisScore>,
}

/// Counts all scores.
pub fn figures(scored: Vec<DiagnosisScore>) -> Figures {
    let everything: Vec<&DiagnosisScore> = scored.iter().collect();
    let single: Vec<&DiagnosisScore> = scored.iter().filter(|s| s.case == Case::Single).collect();
    let mut by_origin: BTreeMap<String, Vec<&DiagnosisScore>> = BTreeMap::new();
    for s in &scored {
        by_origin.entry(s.origin.clone()).or_default().push(s);
    }
    let by_origin = if by_origin.len() > 1 { by_origin } else { BTreeMap::new() };
    let by_origin = by_origin.into_iter().map(|(origin, of)| (origin, list(&of))).collect();
    let (effects, confusion, baselines) = (effect_rows(&single), confusion(&scored), baseline_rows(&scored));
    Figures { figures: list(&everything), effects, confusion, baselines, by_origin, recordings: scored }
}

/// The figures of some recordings.
fn list(scored: &[&DiagnosisScore]) -> Vec<Figure> {
    let of = |case: Case| scored.iter().copied().filter(|s| s.case == case).collect::<Vec<&DiagnosisScore>>();
    let (none, single, pair, withheld) = (of(Case::None), of(Case::Single), of(Case::Pair), of(Case::Withheld));
    let mut all = single_figures(&single);
    all.push(
        share("none_accused", "no effect: one is identified", &none, |s| !s.accused.is_empty())
            .goal(Goal::AtMost(0.05)),
    );
    all.extend(withheld_figures(&withheld));
    all.extend(left_out_figures(&single));
    all.push(auroc_figure(&single, &pair, &withheld));
    all.push(
        share("pair_among_three", "two at once: both among the three likeliest", &pair, |s| s.among_three)
            .goal(Goal::AtLeast(0.75)),
    );
    all.push(share("pair_accused", "two at once: both identified", &pair, |s| s.all_accused));
    all.extend(time_figures(scored));
    all
}

impl Figure {
    fn goal(mut self, goal: Goal) -> Self {
        self.goal = Some(goal);
        self
    }

    /// Whether the goal is met; `None` without a goal or a value.
    pub fn met(&self) -> Option<bool> {
        Some(self.goal?.met(self.value?))
    }
}

/// Share of the scores for which something holds.
fn share(
    name: &'static str,
    what: &'static str,
    of: &[&DiagnosisScore],
    holds: impl Fn(&DiagnosisScore) -> bool,
) -> Figure {
    let some: Vec<bool> = of.iter().map(|s| holds(s)).collect();
    share_of(name, what, &some)
}

fn share_of(name: &'static str, what: &'static str, of: &[bool]) -> Figure {
    let count = of.len();
    let hits = of.iter().filter(|hit| **hit).count();
    let value = (count > 0).then(|| hits as f64 / count as f64);
    let interval = (count > 0).then(|| wilson(hits, count));
    Figure { name, what, value, interval, count, goal: None }
}

fn middle(name: &'static str, what: &'static str, values: Vec<f64>) -> Figure {
    let count = values.len();
    Figure { name, what, value: median(values), interval: None, count, goal: None }
}

/// 95 % interval of a share (Wilson 1927).
fn wilson(hits: usize, count: usize) -> [f64; 2] {
    const Z: f64 = 1.959_964;
    let (n, p) = (count as f64, hits as f64 / count as f64);
    let center = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + Z * Z / n;
    [((center - half) / scale).max(0.0), ((center + half) / scale).min(1.0)]
}

/// Middle value, of an even number the mean of the two in the middle.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n % 2 == 0 => Some(0.5 * (values[middle - 1] + values[middle])),
        _ => Some(values[middle]),
    }
}

fn single_figures(single: &[&DiagnosisScore]) -> Vec<Figure> {
    let named: Vec<&DiagnosisScore> = single.iter().copied().filter(|s| s.named).collect();
    let inside = |which: usize| named.iter().flat_map(|s| s.inside.iter().map(move |i| i[which])).collect::<Vec<_>>();
    let interface: Vec<bool> = single.iter().filter_map(|s| s.interface).collect();
    let scope: Vec<bool> = named.iter().filter_map(|s| s.scope).collect();
    let outline: Vec<bool> = named.iter().filter_map(|s| s.outline).map(|error| error <= 0.15).collect();
    let holds: Vec<bool> = named.iter().filter_map(|s| s.closure_holds).collect();
    let wrong = |s: &DiagnosisScore| !s.named && !s.accused.is_empty();
    vec![
        share("top_1", "in-library effect named first", single, |s| s.named).goal(Goal::AtLeast(0.85)),
        share("top_3", "among the three likeliest", single, |s| s.among_three).goal(Goal::AtLeast(0.95)),
        share("group", "it or one of its confusable group named first", single, |s| s.in_group),
        share("wrong", "another one identified first", single, wrong),
        share_of("interface", "right interface", &interface).goal(Goal::AtLeast(0.95)),
        share_of("scope", "exactly the right joints, of those named", &scope),
        middle("error", "parameter error over range, median", named.iter().flat_map(|s| s.errors.clone()).collect())
            .goal(Goal::AtMost(0.15)),
        share_of("inside_90", "90 % intervals (from the 95 % ones) hold the truth", &inside(0))
            .goal(Goal::Between(0.8, 0.97)),
        share_of("inside_95", "95 % intervals hold the truth", &inside(1)),
        share_of("outline", "outline of a slick region within 0.15 m", &outline),
        middle(
            "closed",
            "held-out gap closed where rightly named, median",
            named.iter().filter_map(|s| s.closed).collect(),
        )
        .goal(Goal::AtLeast(0.8)),
        share_of("closure_holds", "its 95 % interval holds the share closed in the windows of the fit", &holds)
            .goal(Goal::AtLeast(0.8)),
    ]
}

fn withheld_figures(withheld: &[&DiagnosisScore]) -> Vec<Figure> {
    let falsely = |s: &DiagnosisScore| s.said != UNKNOWN && !s.accused.is_empty();
    vec![
        share("withheld_unknown", "out-of-library effect called unknown", withheld, |s| s.said == UNKNOWN)
            .goal(Goal::AtLeast(0.85)),
        share("withheld_accused", "out-of-library effect: one identified first", withheld, falsely)
            .goal(Goal::AtMost(0.08)),
        share("withheld_relative", "of these, a relative that describes it in part", withheld, |s| s.is_relative),
        share("withheld_missed", "out-of-library effect: no gap seen", withheld, |s| s.said == "no_gap"),
    ]
}

fn left_out_figures(single: &[&DiagnosisScore]) -> Vec<Figure> {
    let left_out: Vec<_> = single.iter().filter_map(|s| s.left_out.as_ref()).collect();
    let said = |holds: &dyn Fn(&str) -> bool| left_out.iter().map(|l| holds(&l.said)).collect::<Vec<_>>();
    let accuses = said(&|said| said != UNKNOWN && said != "no_gap");
    let in_group: Vec<bool> = left_out.iter().map(|l| l.in_group).collect();
    vec![
        share_of("left_out_unknown", "right effect excluded from the library: unknown", &said(&|said| said == UNKNOWN))
            .goal(Goal::AtLeast(0.85)),
        share_of("left_out_accused", "right effect excluded: another one identified first", &accuses)
            .goal(Goal::AtMost(0.08)),
        share_of("left_out_group", "of these, one of its confusable group", &in_group),
    ]
}

/// How well leaning to `unknown` shows effects outside the library (withheld, or left out) from those inside.
fn auroc_figure(single: &[&DiagnosisScore], pair: &[&DiagnosisScore], withheld: &[&DiagnosisScore]) -> Figure {
    let answered =
        |of: &[&DiagnosisScore]| of.iter().filter(|s| s.failure.is_none()).map(|s| s.leans).collect::<Vec<_>>();
    let inside = [answered(single), answered(pair)].concat();
    let mut outside = answered(withheld);
    outside.extend(single.iter().filter_map(|s| s.left_out.as_ref()).map(|l| l.leans));
    let what = "abstention, area under the ROC curve";
    let (value, count) = (auroc(&outside, &inside), outside.len() + inside.len());
    Figure { name: "auroc", what, value, interval: None, count, goal: Some(Goal::AtLeast(0.9)) }
}

/// Chance that a positive is above a negative, a tie counting half (Mann and Whitney 1947).
fn auroc(positive: &[f64], negative: &[f64]) -> Option<f64> {
    let wins = |p: f64| -> f64 {
        negative
            .iter()
            .map(|n| {
                if p > *n {
                    1.0
                } else if p == *n {
                    0.5
                } else {
                    0.0
                }
            })
            .sum()
    };
    let pairs = positive.len() * negative.len();
    (pairs > 0).then(|| positive.iter().map(|p| wins(*p)).sum::<f64>() / pairs as f64)
}

fn time_figures(scored: &[&DiagnosisScore]) -> Vec<Figure> {
    let times: Vec<f64> = scored.iter().filter_map(|s| s.runtime).collect();
    let longest = times.iter().copied().fold(None, |most: Option<f64>, t| Some(most.map_or(t, |m| m.max(t))));
    let count = times.len();
    let failed: Vec<bool> = scored.iter().map(|s| s.failure.is_some()).collect();
    vec![
        middle("runtime", "time of a diagnosis, median [s]", times),
        Figure { name: "runtime_most", what: "longest [s]", value: longest, interval: None, count, goal: None }
            .goal(Goal::AtMost(30.0)),
        share_of("failed", "diagnosis failed", &failed).goal(Goal::AtMost(0.0)),
    ]
}

fn effect_rows(single: &[&DiagnosisScore]) -> BTreeMap<String, EffectRow> {
    let mut by_effect: BTreeMap<String, Vec<&DiagnosisScore>> = BTreeMap::new();
    for s in single {
        by_effect.entry(s.truth[0].clone()).or_default().push(s);
    }
    let row = |of: Vec<&DiagnosisScore>| {
        let part = |holds: fn(&DiagnosisScore) -> bool| of.iter().filter(|s| holds(s)).count() as f64 / of.len() as f64;
        let named = || of.iter().filter(|s| s.named);
        EffectRow {
            count: of.len(),
            named: part(|s| s.named),
            among_three: part(|s| s.among_three),
            error: median(named().flat_map(|s| s.errors.clone()).collect()),
            closed: median(named().filter_map(|s| s.closed).collect()),
        }
    };
    by_effect.into_iter().map(|(name, of)| (name, row(of))).collect()
}

fn confusion(scored: &[DiagnosisScore]) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut out: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for s in scored.iter().filter(|s| s.case != Case::Pair) {
        let truth = s.truth.first().map_or("(no effect)", String::as_str);
        let row = if s.case == Case::Withheld { format!("(out-of-library) {truth}") } else { truth.into() };
        *out.entry(row).or_default().entry(s.said.clone()).or_default() += 1;
    }
    out
}

fn baseline_rows(scored: &[DiagnosisScore]) -> Vec<BaselineRow> {
    let mut names: Vec<&String> = scored.iter().flat_map(|s| s.baselines.keys()).collect();
    names.sort();
    names.dedup();
    names.into_iter().map(|name| baseline_row(scored, name)).collect()
}

fn baseline_row(scored: &[DiagnosisScore], name: &str) -> BaselineRow {
    let of = |case: Case| {
        let in_case = scored.iter().filter(move |s| s.case == case);
        in_case.filter_map(move |s| Some((s, s.baselines.get(name)?))).collect::<Vec<_>>()
    };
    let single = of(Case::Single);
    let part = |hits: usize, count: usize| (count > 0).then(|| hits as f64 / count as f64);
    let names_one = |of: &[(&DiagnosisScore, &super::report::Baseline)]| {
        part(of.iter().filter(|(_, b)| b.effect.as_deref().is_some_and(|e| e != UNKNOWN)).count(), of.len())
    };
    let right = single.iter().filter(|(s, b)| b.effect.as_ref() == s.truth.first()).count();
    let ever = scored.iter().filter_map(|s| s.baselines.get(name)).any(|b| b.effect.is_some());
    BaselineRow {
        name: name.into(),
        named: part(right, single.len()).filter(|_| ever),
        count: single.len(),
        closed: median(single.iter().filter_map(|(_, b)| b.closed).collect()),
        none_accused: names_one(&of(Case::None)).filter(|_| ever),
        withheld_accused: names_one(&of(Case::Withheld)).filter(|_| ever),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_and_intervals() {
        assert_eq!(auroc(&[0.9, 0.8], &[0.1, 0.2]), Some(1.0));
        assert_eq!(auroc(&[0.5], &[0.5, 0.1]), Some(0.75));
        assert_eq!(auroc(&[], &[0.1]), None);
        // Newcombe 1998, table I: 81 of 263.
        let [low, high] = wilson(81, 263);
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4, "{low} {high}");
        assert_eq!(median(vec![3.0, 1.0, 2.0, 10.0]), Some(2.5));
        assert_eq!(median(Vec::new()), None);
    }

    #[test]
    fn goals() {
        assert!(Goal::AtLeast(0.85).met(0.85) && !Goal::AtLeast(0.85).met(0.84));
        assert!(Goal::AtMost(0.08).met(0.08) && !Goal::AtMost(0.08).met(0.09));
        assert!(Goal::Between(0.8, 0.97).met(0.9) && !Goal::Between(0.8, 0.97).met(1.0));
    }
}
