//! Where equations come from: torques that were recorded, or positions of servos.

use crate::HeldError;
use crate::balance::{Balance, Bends, Drive, Robot, Term};
use crate::gram::Layout;
use crate::hypothesis::{Nuisance, Tolerances, nuisance};
use crate::path::{Links, Path};
use crate::servo::{FORMS, LoadForm};
use crate::study::{Reference, Study};
use qv_recording::Run;
use rayon::prelude::*;

/// Steps to a robot that its references ask for, and tolerances within which a step is looked for (Levenberg and Marquardt).
const STEPS: usize = 20;
const SLACKS: [f64; 5] = [10.0, 3.0, 1.0, 0.3, 0.1];
/// Share by which a step must lower the loss to be followed by another.
const LEAST_FALL: f64 = 1e-2;

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
        self.equations(robot, &all_of(robot), Links::Uncertain)
    }

    /// The same where a robot differs from that of `base` at some places among the columns: equations that do not depend on these are those of `base`.
    pub fn balance_about(&self, robot: &Robot, base: &Balance, places: &[(usize, f64)]) -> Result<Balance, HeldError> {
        let layout = Layout::of(robot);
        let joints: Option<Vec<usize>> = places.iter().map(|&(place, _)| layout.term(place).map(|(j, _)| j)).collect();
        let (Some(mut joints), Self::Paths(_)) = (joints, self) else { return self.balance(robot) };
        joints.sort_unstable();
        joints.dedup();
        let changed = self.equations(robot, &joints, Links::Uncertain)?;
        let mut all = base.clone();
        for own in changed.equations {
            if let Some(equation) = all.equations.iter_mut().find(|e| e.joint == own.joint) {
                *equation = own;
            }
        }
        Ok(all)
    }

    fn equations(&self, robot: &Robot, joints: &[usize], links: Links) -> Result<Balance, HeldError> {
        let paths = match self {
            Self::Torques { runs, bends } => return Balance::new(runs, robot, bends),
            Self::Paths(paths) => paths,
        };
        let servos = robot.servos.as_ref().ok_or_else(|| HeldError::recording("robot", "it has no servos"))?;
        let all: Vec<Balance> =
            paths.par_iter().enumerate().map(|(k, path)| path.balance(robot, servos, (k, joints), links)).collect();
        all.into_iter().reduce(Balance::joined).ok_or_else(|| HeldError::recording("recordings", "there is none"))
    }

    /// What a robot leaves of the positions of some servos \[rad\], shape `[recordings][joints][rows]`; none of torques.
    fn left(&self, robot: &Robot, joints: &[usize]) -> Result<Vec<Vec<Vec<f64>>>, HeldError> {
        match (self, &robot.servos) {
            (Self::Paths(paths), Some(servos)) => {
                Ok(paths.par_iter().map(|path| path.left(robot, servos, joints)).collect())
            }
            _ => Err(HeldError::recording("robot", "it has no servos")),
        }
    }

    /// Mean over some joints of the log of what a robot leaves of their positions.
    pub fn loss(&self, robot: &Robot, joints: &[usize]) -> Result<f64, HeldError> {
        Ok(loss(&self.left(robot, joints)?))
    }

    /// Torque that a motor is asked for in these recordings \[N m\], quantiles over time, shape `[shares]`; none where torques are weighed.
    pub fn torques(&self, robot: &Robot, joint: usize, shares: &[f64]) -> Option<Vec<f64>> {
        let (Self::Paths(paths), Some(servos)) = (self, &robot.servos) else { return None };
        let all: Vec<Vec<f64>> = paths.par_iter().map(|path| path.torques(robot, servos, (joint, shares))).collect();
        Some((0..shares.len()).map(|k| all.iter().map(|of| of[k]).fold(0.0, f64::max)).collect())
    }
}

fn all_of(robot: &Robot) -> Vec<usize> {
    (0..robot.joints()).collect()
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
            (Term::StateLatency, Some(servos)) => servos.late[joint] += x,
            (Term::Cap, Some(servos)) => servos.cap[joint] += x,
            (Term::Stribeck, Some(servos)) => servos.stribeck[joint] += x,
            (Term::Load, Some(servos)) => servos.load[joint] += x,
            (Term::Offset, Some(servos)) => servos.offset[joint] += x,
            (Term::Limit, Some(servos)) => servos.clip[joint] *= 1.0 + x,
            (Term::Spring, Some(servos)) => servos.spring[joint] += x,
            (Term::Drag, Some(servos)) => servos.drag[joint] += x,
            (Term::Smoothing, Some(servos)) => servos.smoothing[joint] += x,
            (Term::Slew, Some(servos)) => servos.slew[joint] += x,
            (Term::LawOffset, Some(_)) => robot.bias[joint] += x,
            _ if Drive::has(term) => robot.drives[joint].add(term, x),
            _ => return None,
        }
    }
    let is_sound = robot.servos.as_ref().is_none_or(|s| {
        let is_clipped = s.clip.iter().all(|c| (0.2..5.0).contains(c));
        is_clipped && s.cap.iter().all(|c| *c > 0.0) && s.late.iter().all(|t| (0.0..0.2).contains(t))
    });
    (is_sound && robot.drives.iter().all(Drive::is_sound)).then_some(robot)
}

/// Puts what cannot be negative at zero; viscous friction may take from the damping of the motor.
fn clamped(mut robot: Robot) -> Robot {
    let mut all = vec![&mut robot.coulomb, &mut robot.armature];
    if let Some(servos) = &mut robot.servos {
        all.extend([&mut servos.stribeck, &mut servos.load, &mut servos.smoothing, &mut servos.slew]);
    }
    all.into_iter().flatten().for_each(|x| *x = x.max(0.0));
    robot.drives.iter_mut().for_each(|d| d.latency = d.latency.max(0.0));
    robot
}

/// Mean over joints of the log of what all references together leave; `left` has shape `[references][joints][rows]`.
fn loss(left: &[Vec<Vec<f64>>]) -> f64 {
    let joints = left.first().map_or(0, Vec::len);
    let squares = |j: usize| left.iter().map(|of| qv_fit::linear::squared(&of[j])).sum::<f64>().max(1e-18).ln();
    (0..joints).map(squares).sum::<f64>() / joints.max(1) as f64
}

/// References of servos, with what a robot may differ in.
struct References<'a> {
    sources: &'a [Source<'a>],
    tolerances: &'a Tolerances,
    /// Between samples \[s\].
    period: f64,
}

impl References<'_> {
    fn loss(&self, robot: &Robot) -> Result<f64, HeldError> {
        let left = self.sources.par_iter().map(|s| s.left(robot, &all_of(robot))).collect::<Result<Vec<_>, _>>()?;
        Ok(loss(&left.concat()))
    }

    fn balances(&self, robot: &Robot) -> Result<Vec<Balance>, HeldError> {
        self.sources.par_iter().map(|s| s.equations(robot, &all_of(robot), Links::Known)).collect()
    }

    fn uncertain(&self, robot: &Robot, first: &Balance) -> Nuisance {
        let [joints, _] = nuisance(robot, first, self.tolerances, self.period).split(Layout::of(robot));
        joints
    }

    /// A robot with the servos that all references ask for, by steps of Levenberg and Marquardt, and its loss.
    fn fit<'b>(&self, robot: &Robot<'b>) -> Result<(Robot<'b>, f64), HeldError> {
        let layout = Layout::of(robot);
        let (mut best, mut lowest) = (robot.clone(), self.loss(robot)?);
        for _ in 0..STEPS {
            let own = self.balances(&best)?;
            let uncertain = self.uncertain(&best, &own[0]);
            let sums: Vec<Reference> = own.iter().filter_map(|b| Reference::new(b, &own[0].equations)).collect();
            let study = Study::new(layout, &own[0].equations, &sums, (&uncertain, None), false);
            let (before, start) = (lowest, best.clone());
            for slack in SLACKS {
                let pinned = study.fit_references(slack);
                let step: Vec<(usize, f64)> = pinned.into_iter().enumerate().filter(|x| x.1 != 0.0).collect();
                let Some(tried) = moved(&start, layout, &step).map(clamped) else { continue };
                let own = self.loss(&tried)?;
                if own < lowest {
                    (best, lowest) = (tried, own);
                }
            }
            if before - lowest < LEAST_FALL {
                break;
            }
        }
        Ok((best, lowest))
    }
}

/// The robot as references show it: with the form of load-dependent friction that predicts those that are left out best, and with a limit of the
/// rate of its commands where they show one.
pub(crate) fn calibrated<'a>(
    robot: &Robot<'a>,
    sources: &[Source],
    tolerances: &Tolerances,
    period: f64,
) -> Result<Robot<'a>, HeldError> {
    let references = References { sources, tolerances, period };
    let (plain, loss) = references.fit(robot)?;
    // Below its limit of the rate a servo does not show it: the fit starts from one at the usual top speed, too.
    let mut limited = plain.clone();
    if let Some(servos) = &mut limited.servos {
        servos.slew = servos.top.iter().map(|top| 1.0 / top).collect();
    }
    let (limited, loss_of_limited) = references.fit(&limited)?;
    let first = if loss_of_limited < loss { limited } else { plain };
    let of = |form: LoadForm| -> Result<(Robot<'a>, f64), HeldError> {
        let mut started = first.clone();
        if let Some(servos) = started.servos.as_mut().filter(|s| s.form != form) {
            servos.form = form;
            servos.load.fill(0.0);
            started = references.fit(&started)?.0;
        }
        let loss = left_out(&started, &references)?;
        Ok((started, loss))
    };
    let all: Vec<(Robot<'a>, f64)> = FORMS.into_iter().map(of).collect::<Result<_, _>>()?;
    let best = all.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|b| b.0).ok_or_else(|| HeldError::recording("references", "no form of friction fits them"))
}

/// Mean log of what each reference leaves by the fit to the others.
fn left_out(robot: &Robot, references: &References) -> Result<f64, HeldError> {
    let layout = Layout::of(robot);
    let balances = references.balances(robot)?;
    let equations = &balances[0].equations;
    let uncertain = references.uncertain(robot, &balances[0]);
    let references: Vec<Reference> = balances.iter().filter_map(|b| Reference::new(b, equations)).collect();
    let study = Study::new(layout, equations, &references, (&uncertain, None), false);
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
