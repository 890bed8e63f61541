//! What a calibration found, as plain data.

use crate::measured::SlipPlace;
use crate::posterior::Distribution;
use crate::prior::Prior;
use crate::robot::IdentifiedValue;
use crate::segments::Search;
use serde::Serialize;

/// What became of a label's prior.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The recordings show more than the prior.
    Refined,
    /// Feet stood on it, but the recordings show hardly more than the prior: it is kept.
    Insensitive,
    /// Feet hardly slip on it by prior and posterior: the prior is used, the posterior reported.
    Grips,
    /// No foot stood on it for long enough: the prior is kept.
    NotTouched,
}

impl Status {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Refined => "refined",
            Self::Insensitive => "insensitive",
            Self::Grips => "grips: prior used",
            Self::NotTouched => "not touched",
        }
    }
}

/// Friction with intervals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// From the 5 % to the 95 % quantile.
    pub interval90: [f64; 2],
    /// From the 2.5 % to the 97.5 % quantile.
    pub interval95: [f64; 2],
}

impl Estimate {
    /// Of a distribution.
    pub fn of(d: &Distribution) -> Self {
        Self {
            mean: d.mean(),
            interval90: [d.quantile(0.05), d.quantile(0.95)],
            interval95: [d.quantile(0.025), d.quantile(0.975)],
        }
    }
}

/// Curves of a label for pictures, on one grid of frictions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curves {
    /// Frictions.
    pub friction: Vec<f64>,
    /// Probability by friction before, relative to the greatest.
    pub prior: Vec<f64>,
    /// Probability by friction after, relative to the greatest.
    pub posterior: Vec<f64>,
}

/// One label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Region {
    /// Name in the mesh.
    pub label: String,
    /// The friction to use: the posterior's mean, or the prior's where it is kept.
    pub friction: f64,
    /// What became of the prior.
    pub status: Status,
    /// The prior.
    pub prior: Prior,
    /// Intervals of the prior.
    pub prior_estimate: Estimate,
    /// The posterior; the prior where nothing more was learned. Not what is used where feet grip (`status`).
    pub posterior: Estimate,
    /// Whether the recording contradicts the prior, which is then left out of the posterior.
    pub prior_is_contradicted: bool,
    /// Whether what was seen bounds the friction from below only.
    pub is_lower_bound: bool,
    /// Log likelihood of the posterior's mean over that of the prior's mean, weighted as the posterior weighs it.
    pub evidence: f64,
    /// Standard deviation of log friction that comes of what is not known of the robot, within the intervals.
    pub of_robot: f64,
    /// Information that the posterior has over the prior \[nats\].
    pub information: f64,
    /// How far the end of a window moves when the friction changes by a tenth, in units of its usual deviation: at the
    /// prior's mean, and at the posterior's.
    pub sensitivity: [f64; 2],
    /// Time that feet stood on it, summed over feet \[s\].
    pub contact_time: f64,
    /// Share of that time in which they slipped.
    pub slip_share: f64,
    /// Windows that touch it.
    pub windows: usize,
    /// Share of a loss that counts, since windows disagree more than their losses allow.
    pub weight: f64,
    /// The paper's grid search; none for labels above the slip threshold, or not touched.
    pub grid: Option<Search>,
    /// Prior and posterior.
    pub curves: Curves,
}

impl Region {
    /// Intervals of the friction to use.
    pub fn used(&self) -> &Estimate {
        if self.status == Status::Refined { &self.posterior } else { &self.prior_estimate }
    }
}

/// Mean error of the base under frictions \[m\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Errors {
    /// One friction everywhere.
    pub uniform: f64,
    /// Prior means.
    pub prior: f64,
    /// The grid search, prior means elsewhere.
    pub grid: f64,
    /// Posterior.
    pub posterior: f64,
    /// Segments that this is the mean of.
    pub segments: usize,
}

/// Errors of the base in open-loop replay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BaseError {
    /// Length of a segment \[s\].
    pub segment: f64,
    /// The one friction.
    pub uniform_friction: f64,
    /// In segments that no fit has seen; none where the recording is too short for any.
    pub held_out: Option<Errors>,
    /// In all segments.
    pub all: Option<Errors>,
}

/// Windows of the fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WindowCount {
    /// Length \[s\].
    pub length: f64,
    /// Number.
    pub count: usize,
    /// Windows that do not ask for friction and show what is usual; all of them where those are too few.
    pub background: usize,
    /// Whether the background is of all windows.
    pub background_is_all: bool,
}

/// A point of the robot's path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Place {
    /// Run.
    pub run: usize,
    /// Time \[s\].
    pub time: f64,
    /// Where the base was \[m\].
    pub at: [f64; 2],
}

/// A calibration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// `qv-contact/1`.
    pub format: &'static str,
    /// Labels in the order of the mesh.
    pub regions: Vec<Region>,
    /// Motors and the ground's softness, identified beforehand; empty where they cannot be found, or all is given.
    pub robot: Vec<IdentifiedValue>,
    /// Errors of the base before and after.
    pub base_error: BaseError,
    /// Windows of the fit.
    pub windows: WindowCount,
    /// Every tenth second of the path.
    pub path: Vec<Place>,
    /// Where feet slipped.
    pub slips: Vec<SlipPlace>,
    /// What the reader should know.
    pub notes: Vec<String>,
    /// How long it took: another time in every run, so that it stands in a field of its own.
    pub timing: Timing,
}

/// How long a calibration took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Seconds in all; 0 without a clock.
    pub runtime_s: f64,
}

impl Report {
    /// Frictions to use, in the order of the labels.
    pub fn frictions(&self) -> Vec<f64> {
        self.regions.iter().map(|r| r.friction).collect()
    }

    /// The outcome in a sentence.
    pub fn sentence(&self) -> String {
        let refined: Vec<String> = self
            .regions
            .iter()
            .filter(|r| r.status == Status::Refined)
            .map(|r| {
                let [low, high] = r.posterior.interval90;
                format!("{} {:.2} ({low:.2} to {high:.2}) instead of {:.2}", r.label, r.friction, r.prior.mean)
            })
            .collect();
        let found = if refined.is_empty() {
            "No label's friction is known better than before".to_string()
        } else {
            format!("Friction found: {}", refined.join(", "))
        };
        let errors = self.base_error.held_out.or(self.base_error.all);
        let errors = errors.map_or(String::new(), |e| {
            format!(
                "; replayed open loop for {} s, the base is off by {:.0} mm instead of {:.0}",
                self.base_error.segment,
                1e3 * e.posterior,
                1e3 * e.prior
            )
        });
        format!("{found}{errors}.")
    }

    /// Parameters of the simulator, for `--params`.
    pub fn to_toml(&self) -> String {
        let mut text =
            String::from("# Friction by material, calibrated from recordings by qv contact.\n[parameters]\n");
        for value in &self.robot {
            let name = toml::Value::String(value.parameter.clone());
            text += &format!(
                "{name} = {:.5} # {:.5} before, deviation {:.5}\n",
                value.value, value.before, value.deviation
            );
        }
        for region in &self.regions {
            let [low, high] = region.used().interval90;
            text += &format!(
                "{} = {:.4} # {}, 90 % interval {low:.3} to {high:.3}\n",
                toml::Value::String(format!("material.{}.friction", region.label)),
                region.friction,
                region.status.words(),
            );
        }
        text
    }
}
