//! From recordings to evidence.

use crate::HeldError;
use crate::balance::{Balance, Column, Equation, Kind, Robot, Term, bends, has_torques, torques};
use crate::decision::{Outcome, decide};
use crate::events::{Wander, left, scan};
use crate::evidence::{Change, Event, Evidence, HypothesisTest, JointRow, Square};
use crate::fleet;
use crate::gram::{Gram, Layout, blocks, totals};
use crate::hypothesis::{Direction, Family, Hypothesis, Nuisance, Tolerances, hypotheses, load_direction, nuisance};
use crate::path;
use crate::profile::Fit;
use crate::request::Request;
use crate::servo::FORMS;
use crate::slices::pieces;
use crate::source::{Source, calibrated};
use crate::study::{Profiles, Reference, Study, free_fit};
use crate::table::joint_rows;
use crate::traces::traces;
use glam::DVec3;
use qv_fit::linear::{Cholesky, Matrix, add_outer, add_scaled_matrix, product, times};
use qv_recording::Run;
use rayon::prelude::*;
use std::ops::Range;

/// Shortest block \[s\], and the fewest.
const BLOCK: f64 = 0.5;
const FEWEST_BLOCKS: f64 = 8.0;
const FOLDS: usize = 5;
/// Rate of rows \[Hz\].
const RATE: f64 = 25.0;
/// Pieces of a single reference.
const PIECES: usize = 4;
/// Torque below which no motor is asked for one \[N m\].
const LEAST_TORQUE: f64 = 1e-6;
/// Standard deviation of a drive's scale below which it counts as known.
const KNOWN: f64 = 0.1;

/// Whether recordings can be judged at the rates of the policy: all have torques, measured or commanded ones, and without references there is the
/// controller that a fleet follows them with; or all are of servos, and there are references.
pub fn can_measure(runs: &[Run], references: &[Run]) -> bool {
    let all_have_torques = runs.iter().chain(references).all(|run| torques(run).is_some());
    if references.is_empty() {
        return all_have_torques && runs.first().is_some_and(fleet::can_follow);
    }
    all_have_torques || runs.iter().chain(references).all(path::can_follow)
}

/// Measures recordings against references.
///
/// # Errors
/// When recordings and model do not belong together, or there is too little to weigh.
pub fn measure(request: &Request) -> Result<Evidence, HeldError> {
    let first = request.runs.first().ok_or_else(|| HeldError::recording("recordings", "there is none"))?;
    let mut robot = Robot::new(first, request.model, request.given)?;
    let is_fleet = request.references.is_empty();
    let recorded = pieces(request.references, PIECES);
    let lacks_torques = request.runs.iter().chain(&recorded).any(|run| torques(run).is_none());
    if lacks_torques && !request.runs.iter().chain(&recorded).all(path::can_follow) {
        return Err(HeldError::recording("recording", "neither torques nor commands of servos"));
    }
    let bends = bends(if is_fleet { request.runs } else { &recorded }, request.runs, &robot)?;
    if lacks_torques {
        robot.servos = Some(path::servos(&robot, FORMS[0], &bends.top));
    }
    let period = first.measured.position.as_ref().map_or(0.0, |p| qv_recording::median_interval(&p.time));
    let tolerances = &request.policy.tolerances;
    let mut sources = recorded.chunks(1).map(|r| Source::new(r, &robot, &bends)).collect::<Result<Vec<_>, _>>()?;
    if robot.servos.is_some() && !is_fleet {
        robot = calibrated(&robot, &sources, tolerances, period)?;
    }
    let source = Source::new(request.runs, &robot, &bends)?;
    bound_torques(&mut robot, sources.iter().chain([&source]));
    let target = source.balance(&robot)?;
    let nuisance = nuisance(&robot, &target, tolerances, period);
    // References of servos say nothing of masses, whose gravity is what gains are known by: in each recording links may be anywhere within tolerances.
    let [joints, links] = if robot.servos.is_some() && !is_fleet {
        nuisance.split(Layout::of(&robot))
    } else {
        [nuisance, Nuisance::default()]
    };
    let uncertain = if is_fleet { Some(&joints) } else { robot.servos.as_ref().map(|_| &links) };
    let simulated =
        if is_fleet { fleet::simulate(request, &robot, &usual_torques(&robot, &target))? } else { Vec::new() };
    let (references, balances) = if is_fleet {
        let read = |run: &[Run]| weighed(&Source::new(run, &robot, &bends)?, &robot, &target);
        simulated.par_chunks(1).map(read).collect::<Result<Vec<_>, _>>()?.into_iter().unzip()
    } else {
        let all = sources.par_iter().map(|s| weighed(s, &robot, &target)).collect::<Result<Vec<_>, _>>()?;
        sources.clear();
        all.into_iter().unzip()
    };
    let (references, balances): (Vec<Reference>, Vec<Balance>) = (references, balances);
    let study = Study::new(Layout::of(&robot), &target.equations, &references, (&joints, uncertain), is_fleet);
    let null = Null::new(&study, &target, &balances);
    let days = (request.references.len() == 1).then_some(tolerances);
    let context =
        Context { limits: bends.limit.clone(), speeds: bends.top.clone(), interval: interval_of(first), days };
    let target = Target::new(&robot, &target, &study, &null, &context);
    let mut evidence = target.evidence(request, &joints);
    target.follow(&mut evidence, request, &source)?;
    if needs_pairs(&decide(&evidence, request.policy).outcome) {
        evidence.pairs = target.pairs(&evidence, request, &source)?;
    }
    Ok(evidence)
}

/// Caps motors at the greatest torque that they are asked for in any recording, from where a lower limit shows.
fn bound_torques<'a>(robot: &mut Robot, sources: impl Iterator<Item = &'a Source<'a>> + Clone) {
    let greatest = |j: usize| {
        let of = |source: &Source| source.torques(robot, j, &[1.0]).map_or(0.0, |greatest| greatest[0]);
        sources.clone().map(of).fold(LEAST_TORQUE, f64::max)
    };
    let all: Vec<f64> = (0..robot.joints()).map(greatest).collect();
    let Some(servos) = &mut robot.servos else { return };
    servos.cap.iter_mut().zip(all).for_each(|(cap, greatest)| *cap = cap.min(greatest));
}

/// Root mean square torque of each joint \[N m\], shape `[joints]`.
fn usual_torques(robot: &Robot, balance: &Balance) -> Vec<f64> {
    let mut all = vec![0.0; robot.joints()];
    for equation in balance.equations.iter().filter(|e| e.kind != Kind::Law) {
        let mean = qv_fit::linear::squared(&equation.modelled) / equation.modelled.len().max(1) as f64;
        all[equation.joint] = mean.sqrt();
    }
    all
}

/// Friction and rotor of each joint of a recording, by its balance alone; empty where it has none.
pub fn joint_table(request: &Request) -> Vec<JointRow> {
    let Some(first) = request.runs.first().filter(|run| has_torques(run)) else { return Vec::new() };
    let table = || -> Result<Vec<JointRow>, HeldError> {
        let robot = Robot::new(first, request.model, request.given)?;
        let balance = Balance::new(request.runs, &robot, &bends(request.runs, request.runs, &robot)?)?;
        let nuisance = nuisance(&robot, &balance, &request.policy.tolerances, 0.0);
        Ok(joint_rows(&robot, &balance, &nuisance))
    };
    // Whatever it lacks, the diagnosis itself says.
    table().unwrap_or_default()
}

/// A reference as sums, and with its rows.
fn weighed(source: &Source, robot: &Robot, target: &Balance) -> Result<(Reference, Balance), HeldError> {
    let mut balance = source.balance(robot)?;
    let lacks = || HeldError::recording("reference", "it lacks torques or commands that the recording has");
    let reference = Reference::new(&balance, &target.equations).ok_or_else(lacks)?;
    let is_known = |e: &Equation| target.equations.iter().any(|t| t.joint == e.joint && t.kind == e.kind);
    balance.equations.retain(is_known);
    balance.equations.iter_mut().for_each(|e| e.wide = Vec::new());
    Ok((reference, balance))
}

/// References as if each were to be diagnosed by the others.
pub(crate) struct Null {
    left_out: Vec<Profiles>,
    /// Fits of these without a cause.
    fits: Vec<Fit>,
    wander: Wander,
    /// Mean square that each equation leaves, and mean loss.
    squares: Vec<f64>,
    loss: f64,
}

impl Null {
    fn new(study: &Study, target: &Balance, references: &[Balance]) -> Self {
        let left_out: Vec<Profiles> = (0..study.references.len()).into_par_iter().map(|r| study.left_out(r)).collect();
        let fits: Vec<Fit> = left_out.iter().map(|r| r.bands[0].none()).collect();
        let rows_left = |r: usize| -> Vec<Vec<f64>> {
            let values = &fits[r].values;
            let same = |e: &Equation| references[r].equations.iter().find(|o| o.joint == e.joint && o.kind == e.kind);
            target.equations.iter().map(|e| same(e).map_or(Vec::new(), |own| left(own, study.layout, values))).collect()
        };
        let rows: Vec<Vec<Vec<f64>>> = (0..references.len()).map(rows_left).collect();
        let mean = |e: usize| {
            let of = |r: &Vec<Vec<f64>>| qv_fit::linear::squared(&r[e]) / r[e].len().max(1) as f64;
            rows.iter().map(of).sum::<f64>() / rows.len().max(1) as f64
        };
        let squares: Vec<f64> = (0..target.equations.len()).map(mean).collect();
        let loss = squares.iter().zip(&study.weights).map(|(s, w)| s * w).sum::<f64>() / squares.len().max(1) as f64;
        Self { left_out, fits, wander: Wander::of(&rows), squares, loss }
    }
}

/// What neither rows nor references say.
pub(crate) struct Context<'a> {
    /// Limits that motors seem to have \[N m\], shape `[joints]`.
    limits: Vec<f64>,
    /// Usual top speeds \[rad/s\], shape `[joints]`.
    speeds: Vec<f64>,
    /// Between commands \[s\].
    interval: f64,
    /// By how much robots differ from day to day, where a single reference does not say.
    days: Option<&'a Tolerances>,
}

/// A recording beside its references.
pub(crate) struct Target<'a> {
    pub robot: &'a Robot<'a>,
    pub balance: &'a Balance,
    pub study: &'a Study<'a>,
    null: &'a Null,
    pub profiles: Profiles,
    none: Fit,
    /// Sums of all rows of the narrow band.
    sum: Matrix,
    /// Sums of each block, both bands.
    blocks: [Vec<Matrix>; 2],
    ranges: Vec<Range<usize>>,
    /// What the equations leave without a cause.
    none_rows: Vec<Vec<f64>>,
    context: &'a Context<'a>,
}

impl<'a> Target<'a> {
    fn new(
        robot: &'a Robot<'a>,
        balance: &'a Balance,
        study: &'a Study<'a>,
        null: &'a Null,
        context: &'a Context<'a>,
    ) -> Self {
        let length = block_length(balance, study.kappa);
        let pinned = study.pinned(None);
        let [sum, wide_sum] = totals(balance).map(|grams| study.sum(&grams));
        let profiles = study.profiles([&sum, &wide_sum], &pinned, balance.time.len() as f64);
        let (narrow, wide) =
            (blocks(&balance.time, &balance.run, length), blocks(&balance.wide_time, &balance.wide_run, length));
        let of = |values: &dyn Fn(&Equation) -> Vec<Gram>, count: usize| -> Vec<Matrix> {
            let grams: Vec<Vec<Gram>> = balance.equations.iter().map(values).collect();
            let block = |b: usize| study.sum(&grams.iter().map(|g| g[b].clone()).collect::<Vec<_>>());
            (0..count).into_par_iter().map(block).collect()
        };
        let of_narrow = |e: &Equation| narrow.iter().map(|r| Gram::of(&e.values, r.clone())).collect();
        let of_wide = |e: &Equation| wide.iter().map(|r| Gram::of(&e.wide, r.clone())).collect();
        let blocks = [of(&of_narrow, narrow.len()), of(&of_wide, wide.len())];
        let none = profiles.bands[0].none();
        let none_rows = balance.equations.iter().map(|e| left(e, study.layout, &none.values)).collect();
        Self { robot, balance, study, null, profiles, none, sum, blocks, ranges: narrow, none_rows, context }
    }

    /// The same about another robot.
    pub fn about<'b>(&'b self, robot: &'b Robot<'b>, balance: &'b Balance) -> Target<'b> {
        Target::new(robot, balance, self.study, self.null, self.context)
    }

    fn evidence(&self, request: &Request, nuisance: &Nuisance) -> Evidence {
        let all = hypotheses(self.robot, self.balance, &self.context.limits, request.without);
        let scales = self.gain_spread();
        let tested: Vec<HypothesisTest> = all.into_par_iter().filter_map(|h| self.test(h, scales)).collect();
        let everything: Vec<Direction> =
            tested.iter().filter(|t| t.size.len() == 1).map(|t| t.hypothesis.directions[0].clone()).collect();
        let alpha = request.policy.alpha;
        Evidence {
            is_fleet: self.study.is_fleet,
            is_of_positions: self.robot.servos.is_some(),
            references: self.study.references.len(),
            spikes: self.balance.spikes,
            blocks: self.ranges.iter().map(|r| [self.balance.time[r.start], self.balance.time[r.end - 1]]).collect(),
            none: self.none_losses(),
            loss: self.none.loss / self.profiles.rows,
            free: free_loss(&self.profiles, &everything),
            left_out: self
                .null
                .left_out
                .iter()
                .zip(&self.null.fits)
                .map(|(r, fit)| [fit.loss / r.rows, free_loss(r, &everything)])
                .collect(),
            tested,
            pairs: Vec::new(),
            events: self.events(&self.none, 0.0, alpha),
            traces: traces(self.robot, self.balance, &self.none_rows),
            joints: if self.robot.servos.is_some() {
                joint_table(request)
            } else {
                joint_rows(self.robot, self.balance, nuisance)
            },
        }
    }

    /// Events beside a hypothesis, over what it leaves: a large cause leaves more than references do (Birge, Physical Review 40, 1932).
    pub fn events(&self, fit: &Fit, loss: f64, alpha: f64) -> Vec<Event> {
        let rows: Vec<Vec<f64>> =
            self.balance.equations.iter().map(|e| left(e, self.study.layout, &fit.values)).collect();
        let scale = (loss / self.null.loss.max(1e-12)).max(1.0).sqrt();
        scan(self.balance, &rows, (&self.null.wander, scale), self.robot.model.joint_names(), alpha)
    }

    pub fn test(&self, mut hypothesis: Hypothesis, scales: f64) -> Option<HypothesisTest> {
        let narrow = &self.profiles.bands[0];
        let mut own = narrow.fit(&hypothesis.directions)?;
        if let Some(link) = hypothesis.load_on {
            // Its second moment is that of its place.
            for _ in 0..2 {
                let place = DVec3::new(own.size[1], own.size[2], own.size[3]) / own.size[0];
                if !place.is_finite() || place.length() > 1.0 {
                    break;
                }
                hypothesis.directions[0] = load_direction(self.study.layout, link, place);
                own = narrow.fit(&hypothesis.directions)?;
            }
        }
        let directions = &hypothesis.directions;
        // References reached the torques that bound a limit: none of them has one below.
        let is_limit = directions.iter().flatten().all(|d| matches!(self.study.layout.term(d.0), Some((_, Term::Cap))));
        let of_references = |band: usize| -> Option<Vec<Vec<f64>>> {
            if is_limit {
                return Some(vec![vec![0.0; directions.len()]; self.null.left_out.len()]);
            }
            self.null.left_out.iter().map(|r| r.bands[band].fit(directions).map(|own| own.size)).collect()
        };
        let left_out = of_references(0)?;
        let [losses, none, with] = self.losses(directions, &own)?;
        let influences = own.influences(&self.blocks[0])?;
        let change = self.change(directions, &own, (&influences, &left_out), of_references(1));
        let is_of_links = matches!(hypothesis.family, Family::Load | Family::Inertia);
        let mut unseen = if is_of_links {
            self.spread_of(directions, &own, scales)
        } else {
            Matrix::zeros(own.size.len(), own.size.len())
        };
        // What stands at a side of its tolerance may be anywhere within it.
        own.play.iter().enumerate().for_each(|(i, play)| unseen[(i, i)] += play * play / 3.0);
        // When a command came within the one before it is not seen: evenly within an interval.
        for (i, direction) in directions.iter().enumerate() {
            let is_time =
                |term| term == Term::CommandLatency || (term == Term::StateLatency && self.robot.servos.is_some());
            let is_late = direction.iter().all(|d| self.study.layout.term(d.0).is_some_and(|t| is_time(t.1)));
            unseen[(i, i)] += if is_late { self.context.interval.powi(2) / 12.0 } else { 0.0 };
        }
        Some(HypothesisTest {
            size: own.size.clone(),
            information: square(&own.information),
            sandwich: square(&outer_sum(&influences)),
            unseen: square(&unseen),
            drift: self.drift(directions),
            left_out,
            change,
            losses,
            acted: [none, with],
            reference_acted: self.reference_loss(directions),
            loss: own.loss / self.profiles.rows,
            events: None,
            left: Vec::new(),
            hypothesis,
        })
    }

    /// Loss of each block, predicted from the other folds: of all equations, and of those that the hypothesis acts on, without and with it.
    fn losses(&self, directions: &[Direction], own: &Fit) -> Option<[Vec<f64>; 3]> {
        let count = self.blocks[0].len();
        let mut values: Vec<Vec<f64>> = Vec::new();
        for fold in 0..FOLDS.min(count) {
            let mut rest = self.sum.clone();
            (fold..count).step_by(FOLDS).for_each(|b| add_scaled_matrix(&mut rest, -1.0, &self.blocks[0][b]));
            values.push(own.refitted(&rest)?);
        }
        let mut all = [vec![0.0; count], vec![0.0; count], vec![0.0; count]];
        let share = 1.0 / self.balance.equations.len() as f64;
        for e in 0..self.balance.equations.len() {
            let is_acted = self.acts_on(directions, e);
            let without = self.block_losses(e, &self.none_rows[e]);
            // Columns that are eliminated beside it may act elsewhere, too.
            let by_fold: Vec<Vec<f64>> = values
                .iter()
                .map(|v| self.block_losses(e, &left(&self.balance.equations[e], self.study.layout, v)))
                .collect();
            for b in 0..count {
                let with = by_fold[b % FOLDS][b];
                all[0][b] += share * with;
                if is_acted {
                    all[1][b] += share * without[b];
                    all[2][b] += share * with;
                }
            }
        }
        Some(all)
    }

    fn none_losses(&self) -> Vec<f64> {
        let share = 1.0 / self.balance.equations.len() as f64;
        let mut all = vec![0.0; self.ranges.len()];
        for (e, rows) in self.none_rows.iter().enumerate() {
            self.block_losses(e, rows).iter().zip(&mut all).for_each(|(x, sum)| *sum += share * x);
        }
        all
    }

    /// Mean loss that references leave in the equations that a hypothesis acts on.
    fn reference_loss(&self, directions: &[Direction]) -> f64 {
        let share = 1.0 / self.balance.equations.len() as f64;
        let acted = (0..self.balance.equations.len()).filter(|&e| self.acts_on(directions, e));
        acted.map(|e| share * self.null.squares[e] * self.study.weights[e]).sum()
    }

    fn acts_on(&self, directions: &[Direction], e: usize) -> bool {
        let is_in =
            |p: &(usize, f64)| self.balance.equations[e].columns.iter().any(|&c| self.study.layout.place(c) == p.0);
        directions.iter().flatten().any(is_in)
    }

    /// Variance by which friction and scales of drives differ from day to day, of which a single reference knows nothing: evenly within tolerances.
    fn drift(&self, directions: &[Direction]) -> Vec<f64> {
        let Some(tolerances) = self.context.days else { return vec![0.0; directions.len()] };
        let reach = |place: usize| match self.study.layout.term(place) {
            Some((joint, Term::Coulomb | Term::Stribeck)) => tolerances.friction * self.robot.coulomb[joint],
            Some((joint, Term::Viscous)) => tolerances.friction * self.robot.viscous[joint],
            // What viscous friction is off by at the usual top speed.
            Some((joint, Term::Drag)) => tolerances.friction * self.robot.viscous[joint] / self.context.speeds[joint],
            Some((_, Term::TorqueScale | Term::KpScale | Term::KdScale | Term::Strength)) => tolerances.gain,
            _ => 0.0,
        };
        directions.iter().map(|d| d.iter().map(|x| reach(x.0)).fold(0.0, f64::max).powi(2) / 3.0).collect()
    }

    /// Weighted mean square of an equation's rows in each block.
    fn block_losses(&self, e: usize, rows: &[f64]) -> Vec<f64> {
        let of = |r: &Range<usize>| self.study.weights[e] * qv_fit::linear::squared(&rows[r.clone()]) / r.len() as f64;
        self.ranges.iter().map(of).collect()
    }

    fn change(
        &self,
        directions: &[Direction],
        narrow: &Fit,
        (influences_narrow, left_out): (&[Vec<f64>], &[Vec<f64>]),
        of_references: Option<Vec<Vec<f64>>>,
    ) -> Option<Change> {
        let wide = self.profiles.bands[1].fit(directions)?;
        let influences_wide = wide.influences(&self.blocks[1])?;
        if influences_wide.len() != influences_narrow.len() {
            return None;
        }
        let difference = |a: &[f64], b: &[f64]| qv_fit::linear::minus(a, b);
        let stacked: Vec<Vec<f64>> =
            influences_wide.iter().zip(influences_narrow).map(|(w, n)| difference(w, n)).collect();
        Some(Change {
            size: difference(&wide.size, &narrow.size),
            sandwich: square(&outer_sum(&stacked)),
            left_out: of_references?.iter().zip(left_out).map(|(w, n)| difference(w, n)).collect(),
        })
    }

    /// Mean square by which scales of drives differ from 1 in the references, of those that are known.
    pub fn gain_spread(&self) -> f64 {
        if self.study.is_fleet {
            return 0.0;
        }
        let mut squares = Vec::new();
        for (e, equation) in self.balance.equations.iter().enumerate().filter(|(_, e)| e.kind == Kind::Balance) {
            let scale = Column::Joint(equation.joint, Term::TorqueScale);
            let kept: Vec<usize> = (0..equation.columns.len())
                .filter(|&c| match equation.columns[c] {
                    Column::Joint(_, term) => !matches!(term, Term::Spring | Term::StateLatency | Term::Armature),
                    Column::Link(..) => false,
                })
                .collect();
            let mut sum: Option<Gram> = None;
            for reference in self.study.references {
                let picked = picked(&reference.sums[0][e], &kept);
                match &mut sum {
                    Some(sum) => sum.add(&picked),
                    None => sum = Some(picked),
                }
            }
            let (Some(sum), Some(at)) = (sum, kept.iter().position(|&c| equation.columns[c] == scale)) else {
                continue;
            };
            let values = free_fit(&sum);
            let left = length(&sum.sums, &values.iter().map(|x| -x).chain([1.0]).collect::<Vec<_>>()) / sum.rows;
            let width = kept.len();
            let own = Matrix::from_fn(width, width, |i, k| sum.sums[(i, k)] * if i == k { 1.0 + 1e-9 } else { 1.0 });
            let deviation =
                Cholesky::new(&own).map_or(f64::INFINITY, |f| (left * self.study.kappa * f.inverse()[(at, at)]).sqrt());
            if deviation < KNOWN {
                squares.push(values[at] * values[at]);
            }
        }
        squares.iter().sum::<f64>() / squares.len().max(1) as f64
    }

    /// What the spread of the drives' scales adds to the covariance of a size: `sum_j sg² (S_j h)(S_j h)'`.
    fn spread_of(&self, directions: &[Direction], own: &Fit, scales: f64) -> Matrix {
        let count = own.size.len();
        let mut all = Matrix::zeros(count, count);
        let Some(factor) = Cholesky::new(&own.information) else { return all };
        for joint in 0..self.robot.joints() {
            let grams: Vec<Gram> = self
                .balance
                .equations
                .iter()
                .map(|e| {
                    if e.joint == joint {
                        Gram::of(&e.values, 0..self.balance.time.len())
                    } else {
                        Gram::of(&e.values, 0..0)
                    }
                })
                .collect();
            let sum = self.study.sum(&grams);
            let within = |a: &Direction, b: &Direction| -> f64 {
                a.iter().map(|&(i, x)| b.iter().map(|&(k, z)| x * z * sum[(i, k)]).sum::<f64>()).sum()
            };
            let of_joint = Matrix::from_fn(count, count, |i, k| within(&directions[i], &directions[k]));
            add_outer(&mut all, scales, &factor.solve(&times(&of_joint, &own.size)));
        }
        all
    }
}

/// Whether more than one cause may be there.
fn needs_pairs(outcome: &Outcome) -> bool {
    matches!(outcome, Outcome::Unexplained | Outcome::Cause(_, false) | Outcome::Events(false))
}

/// Deviations of a hypothesis at places among the columns.
pub(crate) fn places(hypothesis: &Hypothesis, size: &[f64]) -> Vec<(usize, f64)> {
    let of_axis = |(direction, x): (&Direction, &f64)| -> Vec<(usize, f64)> {
        direction.iter().map(|&(place, factor)| (place, x * factor)).collect()
    };
    hypothesis.directions.iter().zip(size).flat_map(of_axis).collect()
}

/// Median time between changes of the commanded positions \[s\]; 0 without any.
fn interval_of(run: &Run) -> f64 {
    let Some(series) = &run.commands.position else { return 0.0 };
    let changes: Vec<f64> =
        (1..series.len()).filter(|&k| series.row(k) != series.row(k - 1)).map(|k| series.time[k]).collect();
    let mut intervals: Vec<f64> = changes.windows(2).map(|w| w[1] - w[0]).collect();
    if intervals.is_empty() { 0.0 } else { qv_core::statistics::median(&mut intervals) }
}

/// Some columns of sums, and `y`.
fn picked(gram: &Gram, columns: &[usize]) -> Gram {
    let places: Vec<usize> = columns.iter().copied().chain([gram.sums.nrows() - 1]).collect();
    Gram {
        rows: gram.rows,
        sums: Matrix::from_fn(places.len(), places.len(), |i, k| gram.sums[(places[i], places[k])]),
    }
}

fn block_length(balance: &Balance, kappa: f64) -> f64 {
    let span = balance.time.len() as f64 / RATE;
    BLOCK.max(4.0 * kappa / RATE).min(span / FEWEST_BLOCKS)
}

/// Loss of a row with every hypothesis of one number free at once.
fn free_loss(profiles: &Profiles, directions: &[Direction]) -> f64 {
    let sum = &profiles.free;
    let d = crate::profile::spread(sum.nrows(), directions);
    let across = product(sum, &d);
    let own = qv_fit::linear::transposed_product(&d, &across);
    let y = sum.nrows() - 1;
    let scale: Vec<f64> = (0..own.nrows()).map(|i| own[(i, i)].sqrt().max(1e-12)).collect();
    let unit = |i: usize, k: usize| own[(i, k)] / (scale[i] * scale[k]) + if i == k { 1e-6 } else { 0.0 };
    let right: Vec<f64> = (0..own.nrows()).map(|i| across[(y, i)] / scale[i]).collect();
    let fall = Cholesky::new(&Matrix::from_fn(own.nrows(), own.nrows(), unit)).map_or(0.0, |f| f.length(&right));
    (sum[(y, y)] - fall).max(0.0) / profiles.rows
}

/// `x' a x`.
fn length(a: &Matrix, x: &[f64]) -> f64 {
    qv_fit::linear::dot(x, &times(a, x))
}

/// Covariance of a sum of independent terms, `n / (n - 1) sum x x'` (Liang and Zeger, Biometrika 73, 1986).
fn outer_sum(terms: &[Vec<f64>]) -> Matrix {
    let size = terms.first().map_or(0, Vec::len);
    let count = terms.len() as f64;
    let mut all = Matrix::zeros(size, size);
    terms.iter().for_each(|t| add_outer(&mut all, count / (count - 1.0).max(1.0), t));
    all
}

fn square(a: &Matrix) -> Square {
    (0..a.nrows()).map(|i| (0..a.ncols()).map(|k| a[(i, k)]).collect()).collect()
}
