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
    /// So many windows that no fit has seen become worse.
    Worsens(usize),
    /// Share that it takes of the excess in the windows of the fit, or closes of the gap in others, the larger.
    LittleClosed(f64),
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
            Self::Worsens(windows) => write!(f, "it makes {windows} windows that no fit has seen worse"),
            Self::LittleClosed(share) => {
                write!(f, "it closes {:.0} % of the gap at most", 100.0 * share)
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
    /// So many pieces of so many seconds together are no pushes.
    Pulled(usize, f64),
    /// A push that changes by this share while it lasts, by so many standard errors.
    Fading([f64; 2]),
    /// What the size changes with, and by how many standard errors.
    Changing(String, f64),
    /// Another steady effect of the accused joints and its log evidence.
    SameJoints(String, f64),
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let words = |effect: &str| effect.replace('_', " ");
        match self {
            Self::Pulled(pieces, seconds) => write!(
                f,
                "{pieces} pieces of {seconds:.1} s together are no pushes: something pulls that changes with place or time"
            ),
            Self::Fading([share, errors]) => {
                let share = 100.0 * share;
                write!(f, "it is no push: it changes by {share:.0} % while it lasts, by {errors:.1} standard errors")
            }
            Self::Changing(on, errors) => {
                write!(f, "it has no one size: it changes with {on}, by {errors:.1} standard errors")
            }
            Self::SameJoints(effect, evidence) => {
                let effect = words(effect);
                write!(f, "{effect} of the same joints is asked for beside it, with log evidence {evidence:.0}")
            }
        }
    }
}
