//! Signs that what is accused stands for something else: the right effect is another one, which the library lacks.
//!
//! A wrong cause can close most of a gap and bring the level of all features below what engines differ by. It leaves what it
//! cannot imitate where no engine has a part: in the law of the actuators, and in what another effect of the same joints asks for.

use crate::GapError;
use crate::closure::{Closure, mean};
use crate::columns::{Extent, Group, Suspect};
use crate::constancy::{self, Dependence};
use crate::decide::{Level, NO_GAP, Round, SURE_EVENT, is_trifle};
use crate::laws::{LawLeft, laws};
use crate::library::{Effect, Scope};
use crate::search::{Fit, Search};
use crate::study::Study;
use crate::twins::twins;

/// What the law of an actuator may leave, over the null and over what chance makes of it, and as a share of what there was.
const LAW_LEFT: f64 = 2.0;
const LAW_OVER_CHANCE: f64 = 1.3;
const LAW_SHARE: f64 = 0.1;
/// The same of an actuator of which nothing that is accused takes away this share: what an impostor imitates it changes. Impacts
/// alone, between two stamps, make twice of it.
const LAW_LEFT_UNTOUCHED: f64 = 3.0;
const TOUCHED: f64 = 0.2;
/// Log evidence of another effect of the accused joints from which on the accused one does not tell all of them, and as a
/// share of that of the accused one: no large effect is simulated to the last digit.
const EVIDENCE_LEFT: f64 = 80.0;
const EVIDENCE_SHARE: f64 = 0.01;
/// The same where nothing of a joint is accused, of any steady effect: what pulls on the trunk imitates all that does.
const TRUNK_EVIDENCE_LEFT: f64 = 100.0;
const TRUNK_EVIDENCE_SHARE: f64 = 0.1;
/// Standard errors by which the accused value of joints changes with speed, load or time, and as a share of it, from which on it is not one
/// value. Of 35 right ones one changes by more than a twentieth, by 2.2 errors; a friction that fades with speed by 2.4 to 8, one that grows
/// with load by 5 to 13.
const CHANGE_ERRORS: f64 = 3.0;
const CHANGE_SHARE: f64 = 0.05;
/// The same over time: actuators warm up. A right one was seen to change by 5 % in 20 s, by 5 errors.
const DRIFT_SHARE: f64 = 0.08;
/// The same of what acts for a while, in which feet meet the ground otherwise.
const FADING_SHARE: f64 = 0.15;
/// Share of the excess of the level that events must take away where what is left is a gap still.
const EVENTS_SHARE: f64 = 0.25;
/// By how much the level may rise.
const RISE: f64 = 0.05;
/// What engines differ in leaves at least so many times the floor of noise: no cause closes that.
pub const ENGINES_LEAVE: f64 = 1.5;
/// Share of the held-out gap beyond that which causes must close that act all the time and everywhere.
pub const LEAST_CLOSED: f64 = 0.35;
/// Standard errors by which the held-out loss falls if they need not, where what is left is no gap: tolerated deviations may make most
/// of a gap in which a bias of the gyroscope makes a small part of every window.
pub const SURE_FALL: f64 = 4.0;
/// Share of the excess of the level that they leave at most if they need not.
pub const MOST_LEFT: f64 = 0.5;

/// Mean square that is left in windows that no fit has seen, in units of the floor, from which on a cause must have closed half of what there
/// was. Right ones that closed less left up to 6 (a restitution in another engine's bounces once 8), impostors 7 to 12.
const LARGE_GAP: f64 = 7.0;
const HALF: f64 = 0.5;

/// How far from the vertical a weight may seem to pull (cosine of 30 degrees).
const VERTICAL: f64 = 0.866;

/// Time for which several pushes may last together \[s\].
const LONGEST_PUSHES: f64 = 3.0;

/// An accused effect.
pub struct Named {
    /// Name in the library.
    pub effect: String,
    /// Its members.
    pub group: Group,
    /// Value of each axis.
    pub values: Vec<f64>,
    /// What it is confined to.
    pub extent: Option<Extent>,
}

impl Named {
    /// First value, if it acts all the time and everywhere.
    pub fn steady(&self) -> Option<f64> {
        self.extent.is_none().then(|| self.values[0])
    }

    /// From and until, if it is confined to that \[s\].
    fn time(&self) -> Option<[f64; 2]> {
        match self.extent {
            Some(Extent::Time(time)) => Some(time),
            _ => None,
        }
    }
}

/// What the accused robot is judged by.
pub struct Judged<'j> {
    /// Levels before anything was accused and now.
    pub levels: [Level; 2],
    /// What the laws left before anything was accused.
    pub opening: &'j [LawLeft],
    /// What is accused, in the study that it was found in.
    pub accused: Vec<Named>,
    /// Largest log evidence of it.
    pub evidence: f64,
    /// The round after the last accusation, if there was one.
    pub round: Option<&'j Round>,
}

impl Judged<'_> {
    /// Whether any of it is confined to a time or a place.
    fn is_local(&self) -> bool {
        self.accused.iter().any(|a| a.extent.is_some())
    }
}

/// The actuator whose law leaves most, if that is more than noise and tolerances make of it.
pub fn law_left<'l>(now: &'l [LawLeft], opening: &[LawLeft]) -> Option<&'l LawLeft> {
    let excess = |left: &&LawLeft| {
        let before = opening.iter().find(|o| o.joint == left.joint).map_or(0.0, |o| o.ratio - 1.0);
        let untouched = before > 0.0 && left.ratio - 1.0 > (1.0 - TOUCHED) * before;
        let most = if untouched { LAW_LEFT_UNTOUCHED } else { LAW_LEFT };
        left.ratio > most.max(LAW_OVER_CHANCE * left.by_chance) && left.ratio - 1.0 > LAW_SHARE * before
    };
    now.iter().filter(excess).max_by(|a, b| a.ratio.total_cmp(&b.ratio))
}

/// Why the corrected robot of `study` is not explained, which is `nominal` without what is accused; `None` if nothing speaks against it.
///
/// # Errors
/// When a value means nothing.
pub fn doubt(nominal: &Study, study: &mut Study, judged: &Judged) -> Result<Option<String>, GapError> {
    let events: Vec<[f64; 2]> = judged.accused.iter().filter_map(Named::time).collect();
    let one = || twins(&study.columns.effects, &judged.accused);
    let other = one().or_else(|| pulled(&events)).or_else(|| fading(nominal, judged)).or_else(|| weight(study, judged));
    if let Some(other) = other {
        return Ok(Some(other));
    }
    let [before, after] = judged.levels.map(|l| l.ratio);
    let is_sure = judged.evidence > SURE_EVENT;
    if !events.is_empty() && !is_sure && after > NO_GAP && before - after < EVENTS_SHARE * (before - 1.0) {
        let share = 100.0 * (before - after) / (before - 1.0);
        return Ok(Some(format!("it takes {share:.0} % of the excess over the null, and a gap is left")));
    }
    if !judged.is_local() && after > before + RISE {
        return Ok(Some(format!("the loss in its own windows rises from {before:.2} to {after:.2} times the null")));
    }
    let now = laws(study);
    if let Some(&LawLeft { joint, ratio, .. }) = law_left(&now, judged.opening) {
        let joint = &study.problem.model.joint_names()[joint];
        return Ok(Some(format!("the actuator's law at {joint} still leaves {ratio:.1} times what noise does")));
    }
    if let Some(changing) = changing(study, judged) {
        return Ok(Some(changing));
    }
    if let Some((evidence, name)) = beside_trunk(study, judged) {
        return Ok(Some(format!("{name} is asked for beside it, with log evidence {evidence:.0}")));
    }
    Ok(another(study, judged, after)?.map(|(evidence, name)| {
        format!("{name} of the same joints is asked for beside it, with log evidence {evidence:.0}")
    }))
}

/// What is left in windows that no fit has seen, if causes that close less than half of the gap leave a large one. `by_law` is whether they
/// take most of what the law of their actuators leaves.
pub fn leaves_too_much(closure: &Closure, by_law: bool) -> Option<String> {
    let (left, share) = (mean(&closure.after) / closure.floor, closure.closed());
    (left > LARGE_GAP && share < HALF && !by_law).then(|| {
        let closes = 100.0 * share;
        format!("it closes {closes:.0} % of the gap in windows that no fit has seen, and leaves {left:.0} times the floor of noise")
    })
}

/// Forces of their own in several long pieces are one that changes: a cable, or wind.
fn pulled(events: &[[f64; 2]]) -> Option<String> {
    let together: f64 = events.iter().map(|t| t[1] - t[0]).sum();
    let pieces = events.len();
    (pieces > 1 && together > LONGEST_PUSHES).then(|| {
        format!(
            "{pieces} pieces of {together:.1} s together are no pushes: something pulls that changes with place or time"
        )
    })
}

/// A steady force that is all but vertical is what something weighs, where no mass is known that was asked, too.
fn weight(study: &Study, judged: &Judged) -> Option<String> {
    let effects = &study.columns.effects;
    let is_mass = |e: &Effect| e.axes.iter().any(|a| a.moves.keys().any(|m| m.ends_with(".payload_mass")));
    if (0..effects.len()).any(|e| is_mass(&effects[e]) && !study.forgotten.contains(&e)) {
        return None;
    }
    let upwards = |a: &Named| {
        let axes = &effects.iter().find(|e| e.name == a.effect)?.axes;
        let up = axes.iter().position(|axis| axis.moves.contains_key("external.force_z"))?;
        let length = a.values.iter().map(|v| v * v).sum::<f64>().sqrt();
        (a.extent.is_none() && a.values[up].abs() > VERTICAL * length).then_some(a.values[up])
    };
    let newton = judged.accused.iter().find_map(upwards)?;
    let (size, way) = (newton.abs(), if newton < 0.0 { "down" } else { "up" });
    Some(format!("a force of {size:.0} N straight {way} at all times is a weight, of which the library has none"))
}

/// A push that grows or fades is none: a cable, which pulls the harder the farther the robot goes.
fn fading(nominal: &Study, judged: &Judged) -> Option<String> {
    // Whatever else is accused is there in the robot without it, too.
    if judged.accused.iter().any(|a| a.time().is_none()) {
        return None;
    }
    let events = judged.accused.iter().filter_map(|a| Some((a, a.time()?)));
    let all = events.filter_map(|(a, time)| constancy::fading(nominal, &a.effect, &a.group, &a.values, time));
    let most = all.filter(|d| d.errors.abs() > CHANGE_ERRORS && d.change.abs() > FADING_SHARE);
    let most = most.max_by(|a, b| a.errors.abs().total_cmp(&b.errors.abs()))?;
    let (share, errors) = (100.0 * most.change.abs(), most.errors.abs());
    Some(format!("it is no push: it changes by {share:.0} % while it lasts, by {errors:.1} standard errors"))
}

/// What is accused of joints and is no one size.
fn changing(study: &Study, judged: &Judged) -> Option<String> {
    let of_joints = |name: &str| study.columns.effects.iter().any(|e| e.name == name && e.scope == Scope::Joints);
    let steady = judged.accused.iter().filter(|a| of_joints(&a.effect)).filter_map(|a| Some((a, a.steady()?)));
    let all = steady.flat_map(|(a, value)| {
        let dependences = constancy::dependences(study, &a.effect, &a.group).into_iter();
        let share = |d: &Dependence| if d.on == constancy::TIME { DRIFT_SHARE } else { CHANGE_SHARE };
        dependences.filter(move |d| d.errors.abs() > CHANGE_ERRORS && d.change.abs() > share(d) * value.abs())
    });
    let most = all.max_by(|a, b| a.errors.abs().total_cmp(&b.errors.abs()))?;
    Some(format!("it has no one size: it changes with {}, by {:.1} standard errors", most.on, most.errors.abs()))
}

/// A steady effect that has much of the evidence left beside what is accused of the trunk, the ground or the sensors.
fn beside_trunk(study: &Study, judged: &Judged) -> Option<(f64, String)> {
    let round = judged.round?;
    let effect = |fit: &Fit| &study.columns.effects[study.columns.groups[fit.suspect.group].effect];
    let of_joints = |a: &Named| {
        study.columns.effects.iter().any(|e| e.name == a.effect && matches!(e.scope, Scope::Joints | Scope::Links))
    };
    if judged.is_local() || judged.accused.iter().any(of_joints) {
        return None;
    }
    // What is mounted beside the centre of mass moves it: that is no rival of its weight.
    let of_links = |e: &Effect| e.axes.iter().all(|a| a.moves.keys().all(|m| m.starts_with("link.")));
    let named = |name: &String| study.columns.effects.iter().find(|e| e.name == *name);
    let is_mounted = judged.accused.iter().all(|a| named(&a.effect).is_some_and(of_links));
    let least = TRUNK_EVIDENCE_LEFT.max(TRUNK_EVIDENCE_SHARE * judged.evidence);
    let is_one =
        |fit: &&Fit| fit.evidence > least && round.speaks_for(study, fit) && !(is_mounted && of_links(effect(fit)));
    let most = round.fits.iter().filter(is_one).max_by(|a, b| a.evidence.total_cmp(&b.evidence))?;
    Some((most.evidence, effect(most).name.replace('_', " ")))
}

/// Another steady effect of the accused joints that has evidence left.
fn another(study: &mut Study, judged: &Judged, level: f64) -> Result<Option<(f64, String)>, GapError> {
    let mut search = Search::new(study, 1.0)?;
    let base = search.base(&[])?;
    let linear = search.linear(&base.sums).into_iter().map(|(evidence, suspect)| (evidence / level.max(1.0), suspect));
    let mut asked: Vec<(f64, Suspect)> = linear.collect();
    let steady = |f: &&Fit| f.suspect.extent.is_none();
    let fits = judged.round.iter().flat_map(|r| r.fits.iter().filter(steady));
    asked.extend(fits.map(|f| (f.evidence, f.suspect.clone())));
    let columns = &study.columns;
    let is_another = |(evidence, suspect): &(f64, Suspect)| {
        let group = &columns.groups[suspect.group];
        let effect = &columns.effects[group.effect];
        let shares = |a: &Named| a.effect != effect.name && a.group.members.iter().any(|m| group.members.contains(m));
        let of_joints = |a: &&Named| columns.effects.iter().any(|e| e.name == a.effect && e.scope == Scope::Joints);
        effect.scope == Scope::Joints
            && *evidence > EVIDENCE_LEFT.max(EVIDENCE_SHARE * judged.evidence)
            && !is_trifle(study, suspect)
            && judged.accused.iter().all(|a| a.effect != effect.name)
            && judged.accused.iter().filter(of_joints).any(shares)
    };
    let most = asked.into_iter().filter(is_another).max_by(|a, b| a.0.total_cmp(&b.0));
    Ok(most.map(|(evidence, suspect)| {
        (evidence, columns.effects[columns.groups[suspect.group].effect].name.replace('_', " "))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left(joint: usize, ratio: f64, by_chance: f64) -> LawLeft {
        LawLeft { joint, ratio, by_chance }
    }

    #[test]
    fn a_law_that_leaves_more_than_noise_and_a_share_of_what_it_left_is_told() {
        let opening = [left(0, 1.0, 1.1), left(1, 60.0, 1.2), left(2, 3.0, 1.1)];
        let nothing = [left(0, 1.6, 1.1), left(1, 2.9, 1.2), left(2, 2.4, 1.9)];
        assert_eq!(law_left(&nothing, &opening), None);
        let two = [left(0, 2.2, 1.1), left(1, 9.0, 1.2), left(2, 1.1, 1.1)];
        assert_eq!(law_left(&two, &opening), Some(&left(1, 9.0, 1.2)));
        assert_eq!(law_left(&opening[2..], &[]), Some(&opening[2]));
        // What nothing accused has a part in: impacts leave as much.
        let impacts = [left(0, 2.4, 1.1), left(1, 4.0, 1.2)];
        assert_eq!(law_left(&impacts[..1], &impacts), None);
        assert_eq!(law_left(&impacts, &impacts), Some(&impacts[1]));
        assert_eq!(law_left(&[left(1, 2.4, 1.2)], &impacts), Some(&left(1, 2.4, 1.2)));
    }

    #[test]
    fn a_large_gap_that_is_left_held_out_is_told() {
        let closure = |before: f64, after: f64| Closure {
            windows: vec![0, 1],
            before: vec![before; 2],
            after_raw: Vec::new(),
            after: vec![after; 2],
            floor: 0.8,
        };
        let told = leaves_too_much(&closure(9.0, 6.8), false).unwrap();
        assert!(told.contains("27 %") && told.contains("8 times the floor"), "{told}");
        assert_eq!(leaves_too_much(&closure(9.0, 6.8), true), None, "no contact has a part in the law of an actuator");
        assert_eq!(leaves_too_much(&closure(2.0, 1.9), false), None, "a small gap");
        assert_eq!(leaves_too_much(&closure(40.0, 6.8), false), None, "most of a large one is closed");
    }

    #[test]
    fn a_cable_is_no_row_of_pushes() {
        assert_eq!(pulled(&[[1.0, 9.0]]), None);
        assert_eq!(pulled(&[[1.0, 1.6], [4.0, 5.2]]), None);
        assert!(pulled(&[[13.2, 19.9], [8.6, 13.0]]).unwrap().contains("11.1 s"));
    }
}
