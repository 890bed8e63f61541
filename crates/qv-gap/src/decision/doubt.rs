//! Why something is not accused: objections to a candidate, and doubts about all that was accused. Data; their words are `Display`.

use std::fmt;

/// What speaks against a candidate.
#[derive(Debug, Clone, PartialEq)]
pub enum Objection {
    /// An event of so many seconds is a blow of the contact, or noise.
    TooShort(f64),
    /// Log evidence, and what a cause of its kind needs.
    LittleEvidence([f64; 2]),
    /// Its size in tolerances.
    Trifle(f64),
    /// Size in tolerances of the same effect on more than it, which explains the recording better.
    PartOfTrifle(f64),
    /// Its value lies at the edge of its range.
    AtEdge,
    /// It was not looked at in windows that no fit has seen.
    NotLookedAt,
    /// Share of the excess that it takes away, and of the held-out gap that it closes, as a further cause.
    LittleBeside([f64; 2]),
    /// So many windows that no fit has seen become worse.
    Worsens(usize),
    /// Share that it closes of a gap of so many times the null.
    LittleOfSlightGap([f64; 2]),
    /// Share of the excess that it takes away.
    LittleExcess(f64),
    /// Fall of the held-out loss, and its standard error.
    LittleFall([f64; 2]),
}

impl fmt::Display for Objection {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::TooShort(seconds) => {
                write!(f, "an event of {:.0} ms is a blow of the contact, or noise", 1e3 * seconds)
            }
            Self::LittleEvidence([evidence, needed]) => {
                write!(f, "log evidence {evidence:.0} of the {needed:.0} that a cause of its kind needs")
            }
            Self::Trifle(size) => write!(f, "a size of {size:.1} tolerances"),
            Self::PartOfTrifle(size) => {
                write!(f, "the same effect on more than it explains the recording better, with {size:.1} tolerances")
            }
            Self::AtEdge => write!(f, "its value lies at the edge of its range"),
            Self::NotLookedAt => write!(f, "it was not looked at in windows that no fit has seen"),
            Self::LittleBeside(shares) => {
                let [share, closed] = shares.map(|x| 100.0 * x);
                write!(
                    f,
                    "as a further cause it explains {share:.0} % of the excess and closes {closed:.0} % of what is left held out"
                )
            }
            Self::Worsens(windows) => write!(f, "it makes {windows} windows that no fit has seen worse"),
            Self::LittleOfSlightGap([closed, level]) => {
                let closed = 100.0 * closed;
                write!(
                    f,
                    "it closes {closed:.0} % of a gap that is {level:.2} times the null, as large as without an effect"
                )
            }
            Self::LittleExcess(share) => write!(f, "it explains {:.0} % of the excess", 100.0 * share),
            Self::LittleFall([fall, error]) => {
                write!(f, "the held-out loss falls by {fall:.3} only, with error {error:.3}")
            }
        }
    }
}

/// Why what was accused does not explain the recording all the same.
#[derive(Debug, Clone, PartialEq)]
pub enum Doubt {
    /// Two factors of the same joints that are equal, or undo each other, stand for one other cause.
    Twins {
        /// The two.
        effects: [String; 2],
        /// Whether they undo each other.
        are_inverse: bool,
    },
    /// So many pieces of so many seconds together are no pushes.
    Pulled(usize, f64),
    /// A push that changes by this share while it lasts, by so many standard errors.
    Fading([f64; 2]),
    /// A steady vertical force \[N\], upwards.
    Weight(f64),
    /// Share of the excess that events take, where a gap is left.
    LittleExcess(f64),
    /// Level before and after, where it rises.
    Rises([f64; 2]),
    /// A joint, and what the law of its actuator leaves in units of the null.
    ActuatorResidual(String, f64),
    /// What the size changes with, and by how many standard errors.
    Changing(String, f64),
    /// Another steady effect and its log evidence beside what is accused of the trunk, the ground or the sensors.
    BesideTrunk(String, f64),
    /// Another steady effect of the accused joints and its log evidence.
    SameJoints(String, f64),
    /// Share of the held-out gap that is closed; where most of a large gap is left, the loss over the floor.
    LittleClosed(f64, Option<f64>),
    /// Level with all that is accused, and up to which causes are reported beside something unknown.
    TooFar([f64; 2]),
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let words = |effect: &str| effect.replace('_', " ");
        match self {
            Self::Twins { effects: [one, other], are_inverse } => {
                let how = if *are_inverse { "undo each other" } else { "are off by the same share" };
                let [one, other] = [one, other].map(|e| words(e));
                write!(f, "{one} and {other} of the same joints {how}: they stand for one other cause")
            }
            Self::Pulled(pieces, seconds) => write!(
                f,
                "{pieces} pieces of {seconds:.1} s together are no pushes: something pulls that changes with place or time"
            ),
            Self::Fading([share, errors]) => {
                let share = 100.0 * share;
                write!(f, "it is no push: it changes by {share:.0} % while it lasts, by {errors:.1} standard errors")
            }
            Self::Weight(newton) => {
                let (size, way) = (newton.abs(), if *newton < 0.0 { "down" } else { "up" });
                write!(
                    f,
                    "a force of {size:.0} N straight {way} at all times is a weight, of which the library has none"
                )
            }
            Self::LittleExcess(share) => {
                write!(f, "it takes {:.0} % of the excess over the null, and a gap is left", 100.0 * share)
            }
            Self::Rises([before, after]) => {
                write!(f, "the loss in its own windows rises from {before:.2} to {after:.2} times the null")
            }
            Self::ActuatorResidual(joint, ratio) => {
                write!(f, "the actuator's law at {joint} still leaves {ratio:.1} times what noise does")
            }
            Self::Changing(on, errors) => {
                write!(f, "it has no one size: it changes with {on}, by {errors:.1} standard errors")
            }
            Self::BesideTrunk(effect, evidence) => {
                write!(f, "{} is asked for beside it, with log evidence {evidence:.0}", words(effect))
            }
            Self::SameJoints(effect, evidence) => {
                let effect = words(effect);
                write!(f, "{effect} of the same joints is asked for beside it, with log evidence {evidence:.0}")
            }
            Self::LittleClosed(share, left) => {
                write!(f, "it closes {:.0} % of the gap in windows that no fit has seen", 100.0 * share)?;
                left.map_or(Ok(()), |left| write!(f, ", and leaves {left:.0} times the floor of noise"))
            }
            Self::TooFar([level, most]) => write!(
                f,
                "with it the recording is {level:.1} times as far from the simulator as noise and tolerances explain; \
                 beside something unknown a cause is reported up to {most}"
            ),
        }
    }
}
