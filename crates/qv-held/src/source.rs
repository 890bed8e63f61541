//! Where equations come from: torques that were recorded, or positions of servos.

use crate::HeldError;
use crate::balance::{Balance, Bends, Drive, Robot, Term};
use crate::gram::Layout;
use crate::hypothesis::{Tolerances, nuisance};
use crate::path::{Path, servos};
use crate::servo::{FORMS, LoadForm};
use crate::study::{Reference, Study};
use qv_recording::Run;
use rayon::prelude::*;

/// Steps to a robot that its references ask for, and tolerances within which a step is looked for (Levenberg and Marquardt).
const STEPS: usize = 20;
const SLACKS: [f64; 5] = [10.0, 3.0, 1.0, 0.3, 0.1];
/// Share by which a step must lower the loss to be followed by another.
const LEAST_FALL: f64 = 1e-3;

/// Recordings of one robot, read once.
pub(crate) enum Source<'a> {
    Torques { runs: &'a [Run], bends: &'a Bends },
    Paths(Vec<Path>),
}

impl<'a> Source<'a> {
    /// Reads recordings; those of servos are simulated.
    pub fn new(runs: &'a [Run], robot: &Robot, bends: &'a Bends) -> Result<Self, HeldError> {
        Ok(match robot.servos {
            None => Self::Torques { runs, bends },
            Some(_) => Self::Paths(runs.par_iter().map(|run| Path::new(run, robot)).collect::<Result<_, _>>()?),
        })
    }

    /// Equations about a robot.
    pub fn balance(&self, robot: &Robot) -> Result<Balance, HeldError> {
        let paths = match self {
            Self::Torques { runs, bends } => return Balance::new(runs, robot, bends),
            Self::Paths(paths) => paths,
        };
        let servos = robot.servos.as_ref().ok_or_else(|| HeldError::recording("robot", "it has no servos"))?;
        let all: Vec<Balance> = paths.par_iter().enumerate().map(|(k, path)| path.balance(robot, servos, k)).collect();
        all.into_iter().reduce(Balance::joined).ok_or_else(|| HeldError::recording("recordings", "there is none"))
    }
}

/// A robot with deviations at places among the columns; `None` for one that means nothing, or whose columns are not computed anew by them.
pub(crate) fn moved<'a>(robot: &Robot<'a>, layout: Layout, deviations: &[(usize, f64)]) -> Option<Robot<'a>> {
    let mut robot = robot.clone();
    for &(place, x) in deviations {
        let Some((joint, term)) = layout.term(place) else {
            let inertial = &mut robot.servos.as_mut()?.inertial;
            inertial[place - layout.place_of_links()] += x;
            continue;
        };
        match (term, &mut robot.servos) {
            (Term::Coulomb, _) => robot.coulomb[joint] += x,
            (Term::Viscous, _) => robot.viscous[joint] += x,
            (Term::Armature, _) => robot.armature[joint] += x,
            (Term::StateLatency, Some(_)) => return None,
            (Term::Stribeck, Some(servos)) => servos.stribeck[joint] += x,
            (Term::Load, Some(servos)) => servos.load[joint] += x,
            (Term::Offset, Some(servos)) => servos.offset[joint] += x,
            (Term::Limit, Some(servos)) => servos.clip[joint] *= 1.0 + x,
            (Term::Spring, Some(servos)) => servos.spring[joint] += x,
            (Term::LawOffset, Some(_)) => robot.bias[joint] += x,
            _ if Drive::has(term) => robot.drives[joint].add(term, x),
            _ => return None,
        }
    }
    let is_clipped = robot.servos.as_ref().is_none_or(|s| s.clip.iter().all(|c| (0.2..5.0).contains(c)));
    (is_clipped && robot.drives.iter().all(Drive::is_sound)).then_some(robot)
}

/// Puts what cannot be negative at zero; viscous friction may take from the damping of the motor.
fn clamped(mut robot: Robot) -> Robot {
    let mut all = vec![&mut robot.coulomb, &mut robot.armature];
    if let Some(servos) = &mut robot.servos {
        all.extend([&mut servos.stribeck, &mut servos.load]);
    }
    all.into_iter().flatten().for_each(|x| *x = x.max(0.0));
    robot.drives.iter_mut().for_each(|d| d.latency = d.latency.max(0.0));
    robot
}

/// Mean over equations of the log of what all references together leave.
fn loss(balances: &[Balance]) -> f64 {
    let squares = |e: usize| {
        let of = |b: &Balance| b.equations[e].values.last().map_or(0.0, |y| qv_fit::linear::squared(y));
        balances.iter().map(of).sum::<f64>().max(1e-18).ln()
    };
    let count = balances.iter().map(|b| b.equations.len()).min().unwrap_or(0);
    (0..count).map(squares).sum::<f64>() / count.max(1) as f64
}

/// A robot with the servos that all references ask for, by steps of Levenberg and Marquardt.
fn fitted<'a>(
    robot: &Robot<'a>,
    sources: &[Source],
    tolerances: &Tolerances,
    period: f64,
) -> Result<(Robot<'a>, f64), HeldError> {
    let balances = |robot: &Robot| sources.par_iter().map(|s| s.balance(robot)).collect::<Result<Vec<Balance>, _>>();
    let layout = Layout::of(robot);
    let mut best = robot.clone();
    let mut own = balances(&best)?;
    let mut lowest = loss(&own);
    for _ in 0..STEPS {
        let first = &own[0];
        let uncertain = nuisance(&best, first, tolerances, period).without_links(layout);
        let references: Vec<Reference> = own.iter().filter_map(|b| Reference::new(b, &first.equations)).collect();
        let study = Study::new(layout, &first.equations, &references, &uncertain, false);
        let before = lowest;
        let mut found: Option<(Robot, Vec<Balance>)> = None;
        for slack in SLACKS {
            let pinned = study.fit_references(slack);
            let step: Vec<(usize, f64)> = pinned.into_iter().enumerate().filter(|x| x.1 != 0.0).collect();
            let Some(tried) = moved(&best, layout, &step).map(clamped) else { continue };
            let equations = balances(&tried)?;
            let own = loss(&equations);
            if own < lowest {
                (found, lowest) = (Some((tried, equations)), own);
            }
        }
        if let Some(found) = found {
            (best, own) = found;
        }
        if before - lowest < LEAST_FALL {
            break;
        }
    }
    Ok((best, lowest))
}

/// The robot as references show it, with the form of load-dependent friction that predicts those that are left out best.
pub(crate) fn calibrated<'a>(
    robot: &Robot<'a>,
    sources: &[Source],
    tolerances: &Tolerances,
    period: f64,
) -> Result<Robot<'a>, HeldError> {
    let of = |form: LoadForm| -> Result<(Robot<'a>, f64), HeldError> {
        let mut stated = robot.clone();
        stated.servos = Some(servos(robot, form));
        let (robot, _) = fitted(&stated, sources, tolerances, period)?;
        let loss = left_out(&robot, sources, tolerances, period)?;
        Ok((robot, loss))
    };
    let all: Vec<(Robot<'a>, f64)> = FORMS.into_iter().map(of).collect::<Result<_, _>>()?;
    let best = all.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|b| b.0).ok_or_else(|| HeldError::recording("references", "no form of friction fits them"))
}

/// Mean log of what each reference leaves by the fit to the others.
fn left_out(robot: &Robot, sources: &[Source], tolerances: &Tolerances, period: f64) -> Result<f64, HeldError> {
    let layout = Layout::of(robot);
    let balances = sources.par_iter().map(|s| s.balance(robot)).collect::<Result<Vec<Balance>, _>>()?;
    let equations = &balances[0].equations;
    let uncertain = nuisance(robot, &balances[0], tolerances, period).without_links(layout);
    let references: Vec<Reference> = balances.iter().filter_map(|b| Reference::new(b, equations)).collect();
    let study = Study::new(layout, equations, &references, &uncertain, false);
    let mut logs = 0.0;
    for (r, balance) in balances.iter().enumerate() {
        let values = study.left_out(r).bands[0].none().values;
        for equation in &balance.equations {
            let rows = crate::events::left(equation, layout, &values);
            logs += (qv_fit::linear::squared(&rows) / rows.len().max(1) as f64).max(1e-18).ln();
        }
    }
    Ok(logs / (balances.len() * equations.len()).max(1) as f64)
}
